"""Conditions of a positioning test (TOML), from which the uncertainty of ISO 230-2's quantities follows.

```
[device]                 # as its certificate has it: expanded uncertainty, k = 2
U = 0.0002               # mm or degrees, at every target
U_per_length = 5e-7      # mm/mm
[misalignment]
angle = 0.001            # rad: the line of measurement is within this of the axis
offset = 0.5             # mm: or so far the returning beam walked over the targets
[temperature]            # of the scale or workpiece by which lengths are reduced to 20 °C
u = 0.2                  # K
at = 22.0                # °C
expansion = 11.5e-6      # 1/K
u_expansion = 1e-6       # 1/K
[drift]
range = 0.0008           # mm or degrees, during the test, from a drift test at one place
form = "independent"     # from approach to approach; or "linear": evenly through the test
[setup]
u = 0.0002               # mm or degrees, of what each run has in common
[noise]
u = 0.0001               # mm or degrees, of a single reading
```
"""

from __future__ import annotations

from pathlib import Path

from volid.io.basics.toml_table import Table, read_toml
from volid.standards.positioning.conditions import FORMS, INDEPENDENT, REFERENCE, Conditions

_KEYS = {
    "device": ("U", "U_per_length", "k"),
    "misalignment": ("angle", "offset"),
    "temperature": ("u", "at", "expansion", "u_expansion"),
    "drift": ("range", "form"),
    "setup": ("u",),
    "noise": ("u",),
}
COVERAGE = 2.0  # k of certificates


def read_conditions(path: str | Path, length: float) -> Conditions:
    """The conditions that a file states; `length`: from the first target to the last [mm], over which an `offset` counts.

    Raises `InputError` naming file and key.
    """
    top = Table(read_toml(path), str(path))
    top.only(_KEYS)
    tables = {name: top.table(name, {}) for name in _KEYS}
    for name, table in tables.items():
        table.only(_KEYS[name])
    device, temperature, drift = tables["device"], tables["temperature"], tables["drift"]
    k = device.number("k", COVERAGE, above=0.0)
    return Conditions(
        device=_size(device, "U") / k,
        device_scale=_size(device, "U_per_length") / k,
        misalignment=max(_size(tables["misalignment"], "angle"), _size(tables["misalignment"], "offset") / length),
        temperature_u=_size(temperature, "u"),
        temperature=temperature.number("at", REFERENCE),
        expansion=_expansion(temperature),
        expansion_u=_size(temperature, "u_expansion"),
        drift=_size(drift, "range"),
        drift_form=drift.text("form", INDEPENDENT, choices=FORMS),
        setup=_size(tables["setup"], "u"),
        noise=_size(tables["noise"], "u"),
    )


def _size(table: Table, key: str) -> float:
    return float(table.number(key, 0.0, least=0.0))


def _expansion(temperature: Table) -> float:
    """The coefficient, without which a temperature says nothing about lengths."""
    wanted = _size(temperature, "u") > 0.0
    return float(temperature.number("expansion", *(() if wanted else (0.0,)), above=0.0))
