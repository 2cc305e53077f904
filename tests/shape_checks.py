"""The checker of types and shapes that tests put on signatures: beartype, an int or a float counting as complex (PEP 484)."""

from beartype import BeartypeConf, beartype

# closed forms and iterations of one station; elsewhere arrays of NumPy, JAX and tracers pass alike, shapes stand in docstrings
MODULES = ["volid.multilateration", "volid.ranging"]
checked = beartype(conf=BeartypeConf(is_pep484_tower=True))
