"""Truth of a virtual machine in one HDF5 file, `volid-truth/1`, readable with plain h5py.

Root attributes: `format`; `seed` (-1: none); `source` (text). Units: mm, rad, positions mm or degrees.
- `machine`: the text of the machine file, scalar.
- `functions/<name>`, `reversal/<name>`: error motions E(q) and reversal values B(q) by ISO 230-1 symbol, each with
  `positions` (n,) of its own axis and `values` (n,); between the points a spline of attribute `degree` goes through them:
  3, cubic with not-a-knot ends (scipy.interpolate.make_interp_spline), or 1, straight lines.
- `cross/<name>`: functions of two axes, added to `functions`: attribute `axis` (letter of the second one), `positions`
  (n,), `across` (p,) of the second axis, `values` (n, p), tensor product of the same splines.
- `constants/`: `name` (k,), `value` (k,): squareness, location errors, tool-frame constants, as parameters of the model: tool
  relative to workpiece, as attribute `refers_to` says. An axis that carries the workpiece has its line on the other side.
- `stations/`: `name` (k,), `position` (k, 3), true positions on their bodies. `instruments/`: `name` (k,), `value` (k,):
  dead paths, offsets and the like, by the names they have in a solution.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from volid.exceptions import InputError
from volid.io.basics.hdf5_group import Group
from volid.io.basics.hdf5_structure import shown
from volid.io.basics.hdf5_values import is_hdf5, opened, reading, write_array, write_text
from volid.io.basics.hdf5_writing import hdf5_output
from volid.io.machines import format_machine, parse_machine
from volid.io.solutions import read_solution
from volid.model.axis_lines import PARAMETER
from volid.model.machine import Machine
from volid.virtual.truth import CrossTable, Table, Truth, truth_of_solution

FORMAT = "volid-truth/1"


def write_truth(truth: Truth, path: str | Path, *, overwrite: bool = False) -> None:
    """Write a truth, its functions as dense tables, to one HDF5 file.

    Raises `OutputError` when `path` exists (unless `overwrite`) or cannot be written; then nothing is written.
    """
    truth = truth.tabulated()
    with hdf5_output(path, overwrite) as file:
        file.attrs["format"] = FORMAT
        file.attrs["seed"] = -1 if truth.seed is None else truth.seed
        file.attrs["source"] = truth.source
        file["machine"] = format_machine(truth.machine)
        for group, tables in (("functions", truth.functions), ("reversal", truth.reversal)):
            parent = file.create_group(group)
            for name, table in tables.items():
                _write_table(parent.create_group(name), table)
        parent = file.create_group("cross")
        for name, (other, cross) in truth.cross.items():
            group = parent.create_group(name)
            _write_table(group, cross)
            group.attrs["axis"] = other
        constants = file.create_group("constants")
        constants.attrs["refers_to"] = PARAMETER
        _write_values(constants, "value", truth.constants)
        _write_values(file.create_group("stations"), "position", truth.stations)
        _write_values(file.create_group("instruments"), "value", truth.instruments)


def _write_table(group: h5py.Group, table: Any) -> None:
    group.attrs["degree"] = table.degree
    for name in ("positions", "across", "values"):
        if hasattr(table, name):
            write_array(group, name, getattr(table, name))


def _write_values(group: h5py.Group, name: str, values: Mapping[str, Any]) -> None:
    write_text(group, "name", list(values))
    rows = np.array(list(values.values()), dtype=float)
    write_array(group, name, rows.reshape(-1, 3) if name == "position" else rows)


def read_truth(path: str | Path) -> Truth:
    """The truth in a `volid-truth` file. Raises `InputError` when the file is missing, damaged or another one."""
    with reading(path, "truth", FORMAT) as file:
        machine = parse_machine(file.text("machine"), f"{path}, machine")
        seed = file.attributes.integer("seed")
        cross = file.group("cross").groups()
        return Truth(
            machine,
            functions=_read_tables(file.group("functions")),
            cross={name: (_second_axis(group, machine), _read_cross(group)) for name, group in cross.items()},
            reversal=_read_tables(file.group("reversal")),
            constants={name: float(value) for name, value in _read_values(file.group("constants"), "value")},
            stations={name: (p[0], p[1], p[2]) for name, p in _read_values(file.group("stations"), "position")},
            instruments={name: float(value) for name, value in _read_values(file.group("instruments"), "value")},
            seed=None if seed < 0 else seed,
            source=shown(str(path)),
        )


def _read_tables(group: Group) -> dict[str, Table]:
    return {name: _read_table(table) for name, table in group.groups().items()}


def _read_table(group: Group) -> Table:
    positions = _increasing(group, "positions")
    values = group.array("values", (len(positions),), finite=True)
    return Table(positions, values, _degree(group, len(positions)))


def _read_cross(group: Group) -> CrossTable:
    positions, across = _increasing(group, "positions"), _increasing(group, "across")
    values = group.array("values", (len(positions), len(across)), finite=True)
    return CrossTable(positions, across, values, _degree(group, min(len(positions), len(across))))


def _increasing(group: Group, name: str) -> np.ndarray:
    found = group.array(name, (None,), finite=True)
    if not (np.diff(found) > 0.0).all():
        raise InputError(f"{group.place(name)}: expected increasing positions")
    return found


def _degree(group: Group, points: int) -> int:
    degree = group.attributes.integer("degree")
    if degree not in (1, 3) or points <= degree:
        raise InputError(
            f"{group.where}: degree {degree} with {points} points; expected 1, or 3 with at least 4 points"
        )
    return degree


def _second_axis(group: Group, machine: Machine) -> str:
    letter = group.attributes.text("axis")
    if letter not in machine.letters:
        raise InputError(f"{group.where}, attribute axis is '{shown(letter)}'; expected an axis of the machine")
    return letter


def _read_values(group: Group, name: str) -> list[tuple[str, Any]]:
    n = group.length("name")
    if n == 0:  # an earlier version wrote positions of no station with another shape
        return []
    shape = (n, 3) if name == "position" else (n,)
    return list(zip(group.texts("name", (n,)).tolist(), group.array(name, shape, finite=True).tolist(), strict=True))


def is_solution(path: str | Path) -> bool:
    """Whether a file says that it is a solution."""
    if not is_hdf5(path):
        return False
    with opened(path, "truth") as file:
        return file.attributes.text("format", "").startswith("volid-solution/")


def load_truth(path: str | Path) -> Truth:
    """The truth in a `volid-truth` file, or the machine that a `volid-solution` file describes.

    Raises `InputError` when the file is neither.
    """
    if not is_hdf5(path):
        raise InputError(f"{path}: not an HDF5 file; expected a truth, '{FORMAT}', or a solution, 'volid-solution/1'")
    with opened(path, "truth") as file:
        found = file.attributes.text("format", "")
    if found.startswith("volid-solution/"):
        return replace(truth_of_solution(read_solution(path)), source=shown(str(path)))
    if found and not found.startswith("volid-truth/"):
        raise InputError(
            f"{path}: format is '{shown(found)}'; expected a truth, '{FORMAT}', or a solution, 'volid-solution/1'"
        )
    return read_truth(path)
