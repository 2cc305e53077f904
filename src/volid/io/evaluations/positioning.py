"""Positioning runs from whatever holds them: campaigns, files of laser interferometers, tables, compensation tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from volid.exceptions import InputError
from volid.io.basics.csv_table import CsvTable, read_csv
from volid.io.basics.toml_table import Table
from volid.io.campaign.files import is_campaign, load_campaign
from volid.io.campaign.foreign import AS, RECOGNISE, read_foreign
from volid.io.evaluations.positioning_tables import FORMS, is_runs_table, runs_of_table
from volid.io.instruments.recognition import known_as
from volid.io.layouts import function_of
from volid.io.record import COMPENSATION, read_header
from volid.io.table_reader import read_table
from volid.model.iso230 import LINEAR_AXES, ROTARY_AXES, parse
from volid.model.machine import Axis, Machine
from volid.standards.positioning.runs import Approaches, PositioningRuns, arranged, from_means
from volid.standards.positioning.sets import Found, positioning_of

FAR = 1e6  # mm or degrees: travel of an axis of which nothing else is known
_EXPECTED = (
    "expected a campaign (.toml, .h5), a file of a laser interferometer (.rtl, .rta, .pos), a table of targets and approaches "
    f"(.csv), or a compensation table of positioning (.csv); a table needs {FORMS.removeprefix('expected ')}"
)


def read_positioning(
    path: str | Path,
    axis: str | None = None,
    sets: Sequence[str] = (),
    keys: Mapping[str, Any] | None = None,
    allow_outside: bool = False,
) -> list[Found]:
    """The runs that a file holds, each with what the file says of its uncertainty.

    Args:
        path: A campaign, a file of a laser interferometer, a table of runs × targets, or a compensation table.
        axis: The axis that moved: where a file does not say, or of several the one that counts.
        sets: Names of sets of a campaign; none: all that fit.
        keys: Keys by which a file of another program is read, as of a `[[set]]`: unit, sign, one_way, incomplete …
        allow_outside: As of `load_campaign`.

    Raises:
        InputError: naming file and row, column or key.

    >>> [found] = read_positioning("datasets/iso230_2_synthetic/X_wide.csv", axis="X")
    >>> found.runs.deviations.shape
    (11, 2, 5)
    """
    path = Path(path)
    axis = axis.upper() if axis and len(axis) == 1 else axis
    if is_campaign(path):
        return _of_axis(positioning_of(load_campaign(path, allow_outside=allow_outside), sets), axis, path)
    if sets:
        raise InputError(f"{path}: this is no campaign and has no sets; leave `set` out")
    if keys or known_as(path):
        return [Found(_of_instrument(path, axis, dict(keys or {})))]
    csv = read_csv(path)
    if is_runs_table(csv):
        return [Found(runs) for runs in runs_of_table(csv, axis)]
    if function_of(csv.columns) is None:
        raise InputError(f"{path}: columns {', '.join(csv.columns)}; {_EXPECTED}")
    return _of_axis([Found(_of_compensation(path))], axis, path)


def _of_axis(found: list[Found], axis: str | None, path: Path) -> list[Found]:
    kept = [f for f in found if axis in (None, f.runs.axis)]
    if not kept:
        there = ", ".join(dict.fromkeys(f.runs.axis for f in found))
        raise InputError(f"{path}: no runs of axis {axis}; expected one of {there}")
    return kept


def _of_instrument(path: Path, axis: str | None, keys: dict[str, Any]) -> PositioningRuns:
    """Readings of a laser interferometer; of the machine nothing but the axis need be known."""
    letters = (*LINEAR_AXES, *ROTARY_AXES)
    axes = tuple(Axis(letter, False, (-FAR, FAR), 0.0) for letter in letters)
    machine = Machine("the machine", "w b " + " ".join(letters) + " t", axes)
    at = {"at": {letter: 0.0 for letter in letters}}
    table = Table({"file": path.name, AS: RECOGNISE, **at, **({"axis": axis} if axis else {}), **keys}, str(path))
    csv = read_foreign(table, path.parent, machine).csv
    return _of_columns(csv, letters)


def _of_columns(csv: CsvTable, letters: Sequence[str]) -> PositioningRuns:
    """Runs of the columns that a set of one line has. Raises `InputError` for another component than that of the axis."""
    component = csv.columns.get("component", ("",))[0]
    moving = next(letter for letter in letters if f"{letter}_dir" in csv)
    if component != moving:
        raise InputError(
            f"{csv.source}: component {component or 'of another kind'} while {moving} moved; ISO 230-2 evaluates positioning: "
            f"component {moving}"
        )
    linear = moving in LINEAR_AXES
    unit, purpose = ("mm", "every reading needs one") if linear else ("degrees", "every reading needs one")
    run = csv.labels("run", purpose).tolist()
    target, direction = csv.numbers(moving, unit, purpose), csv.numbers(f"{moving}_dir", "steps of one", purpose)
    value, where = csv.numbers("value", unit, purpose), [csv.where(i) for i in range(len(csv))]
    found = Approaches(target, direction, run, value, where)
    averaged = not any(name.isdigit() for name in run)  # a file of averages calls them forward and back
    known = {"source": csv.source, "notes": csv.notes, "are_means": averaged}
    return arranged(moving, found, "mm" if linear else "°", **known)


def _of_compensation(path: Path) -> PositioningRuns:
    """Mean deviations as a compensation table holds them: running sums of increments, with the sign of a deviation."""
    table = read_table(path)
    name = parse(table.function)
    if name.location or name.direction != name.axis:
        raise InputError(f"{path}: a table of {table.function}; ISO 230-2 evaluates positioning, such as EXX or ECC")
    factor = 1.0 if name.axis in LINEAR_AXES else float(np.rad2deg(1.0))
    runs = from_means(
        name.axis,
        table.positions,
        {1: factor * table.forward, -1: factor * table.reverse},
        unit="mm" if name.axis in LINEAR_AXES else "°",
        source=str(path),
    )
    header = read_header(path)
    rows = header.get("rows", "absolute, because the file has no line '# rows: incremental'")
    minus = "minus " if header.get("values") == COMPENSATION else ""
    note = (
        f"the values of a compensation table were taken for {minus}the mean deviations that it was made from; "
        f"its rows were read as {rows}"
    )
    return replace(runs, notes=(note,))
