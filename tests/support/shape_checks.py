"""The checker of types and shapes that tests put on signatures: beartype, where every argument is an array or a plain type.

Not on public functions that take `ArrayLike`: beartype knows no tuple of numbers as one. Nor on what JAX traces: arrays of NumPy,
JAX and tracers pass there alike, and shapes stand in the docstrings.
"""

from beartype import BeartypeConf, beartype

MODULES = ["volid.multilateration.one_station"]
checked = beartype(conf=BeartypeConf(is_pep484_tower=True))  # an int counts as a float, PEP 484
