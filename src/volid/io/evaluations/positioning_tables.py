"""Tables of approaches × targets as people keep them, recognised by their header.

    target, direction, run, actual        long: one row per approach
    target, up_1, up_2, …, down_1, …      wide: one row per target

Long: `actual` is the position reached; instead of it `deviation` from the target. `run` may be left out: approaches of a
target then count in the order of the file. `axis` where one file holds several. Wide: cells are deviations, or positions where
they follow the targets; a cell may be empty. Directions are +1 and -1, also up and down, forward and reverse. mm, degrees for
rotary axes; a header may state the unit of a column, "deviation [µm]".
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from volid.exceptions import InputError
from volid.io.basics.csv_rows import names_shown
from volid.io.basics.csv_table import CsvTable
from volid.io.basics.units import conversion, split_unit
from volid.io.evaluations.sizes import ask_size
from volid.model.iso230 import ROTARY_AXES
from volid.standards.positioning.runs import Approaches, PositioningRuns, arranged, run_numbers

TARGET, DIRECTION, RUN, ACTUAL, DEVIATION, AXIS = "target", "direction", "run", "actual", "deviation", "axis"
FORMS = (
    "expected the columns target, direction, run and actual (or deviation), a row for each approach; or target, up_1, up_2, …, "
    "down_1, …, a row for each target"
)
_WAYS = {
    "up": 1.0,
    "forward": 1.0,
    "+": 1.0,
    "pos": 1.0,
    "down": -1.0,
    "reverse": -1.0,
    "backward": -1.0,
    "-": -1.0,
    "neg": -1.0,
}
_CELL = re.compile(r"(?:(actual|deviation)[ _])?(up|down|forward|reverse|backward|pos|neg|\+|-)[ _]?(\d{1,4})")
_LETTER = re.compile(r"[A-Za-z]\d{0,2}")
_FOLLOWS = 0.5  # slope over the targets above which numbers are positions, and not deviations
DIGITS = 10  # decimal places of a difference of positions: more are of the computer's arithmetic
_PURPOSE = "every approach needs one"


def is_runs_table(csv: CsvTable) -> bool:
    """Whether a CSV has a column of targets."""
    return any(_plain(name) == TARGET for name in csv.columns)


def runs_of_table(csv: CsvTable, axis: str | None) -> list[PositioningRuns]:
    """The runs of a table, of every axis in it. `axis`: the axis that moved, where the table does not say.

    Raises `InputError` naming file and column, or row, for columns that are missing, and cells that are none of what is
    expected.
    """
    axis = axis and _named(axis)
    names = {_plain(name): name for name in csv.columns}
    csv = csv.renamed({plain: name for plain, name in names.items() if plain != name}, (), csv.source)
    cells = {name: match for name in csv.columns if (match := _CELL.fullmatch(name))}
    if cells:
        return [_wide(csv, cells, axis)]
    csv.require((TARGET, DIRECTION), FORMS, tuple(csv.columns))
    if len({ACTUAL, DEVIATION} & set(csv.columns)) != 1:
        raise InputError(f"{csv.source}, header: columns {names_shown(list(csv.columns))}; {FORMS}")
    csv.only((TARGET, DIRECTION, RUN, ACTUAL, DEVIATION, AXIS))
    return list(_long(csv, axis))


def _plain(name: str) -> str:
    """A column's name without unit and capitals."""
    return split_unit(name)[0].strip().casefold()


# ------------------------------------------------------------------------------------------------------------- long form


def _long(csv: CsvTable, axis: str | None) -> Iterator[PositioningRuns]:
    axes = np.array([_named(a) for a in csv.labels(AXIS, _PURPOSE)]) if AXIS in csv else np.full(len(csv), axis or AXIS)
    if AXIS in csv and axis is not None and axis not in axes:
        raise InputError(f"{csv.source}: no row is of axis {axis}; expected one of {', '.join(sorted(set(axes)))}")
    for letter in dict.fromkeys(axes.tolist() if axis is None else [axis]):
        yield _runs_of(csv, letter, np.flatnonzero(axes == letter))


def _named(axis: str) -> str:
    """The axis as machines call it: c is C, or its angles would be taken for mm."""
    return axis.upper() if _LETTER.fullmatch(axis) else axis


def _runs_of(csv: CsvTable, axis: str, rows: np.ndarray) -> PositioningRuns:
    unit = _unit(csv, axis)
    target = csv.numbers(TARGET, unit.words, _PURPOSE)[rows]
    direction = _directions(csv)[rows]
    if DEVIATION in csv:
        deviation = csv.numbers(DEVIATION, unit.words, _PURPOSE)[rows]
        _check_deviations(csv, DEVIATION, target, deviation, unit)
    else:
        actual = csv.numbers(ACTUAL, unit.words, _PURPOSE)[rows]
        deviation = _difference(actual, target, unit)
        _check_actual(csv, target, target + deviation)
        ask_size(csv.source, DEVIATION, deviation, unit.symbol)
    run = csv.labels(RUN, _PURPOSE)[rows].tolist() if RUN in csv else run_numbers(target, direction, unit.symbol)
    where = [csv.where(int(i)) for i in rows]
    found = Approaches(target, direction, run, deviation, where)
    return arranged(axis, found, unit.symbol, source=csv.source, notes=(*csv.notes, *_assumed(csv, axis, unit)))


def _directions(csv: CsvTable) -> np.ndarray:
    """±1 for every row. Raises `InputError` for a cell that is no direction."""
    found = []
    for i, cell in enumerate(csv.labels(DIRECTION, _PURPOSE).tolist()):
        text = cell.casefold()
        try:
            way = _WAYS[text] if text in _WAYS else float(text)
        except ValueError:
            way = 0.0
        if abs(way) != 1.0:
            raise InputError(f"{csv.where(i)}: direction is '{cell}'; expected +1 or -1, or up or down")
        found.append(way)
    return np.array(found)


# ------------------------------------------------------------------------------------------------------------- wide form


def _wide(csv: CsvTable, cells: Mapping[str, re.Match[str]], axis: str | None) -> PositioningRuns:
    csv.require((TARGET,), FORMS, tuple(csv.columns))
    csv.only((TARGET, *cells))
    axis = axis or AXIS
    unit = _unit(csv, axis)
    _check_alike(csv, cells)
    target = csv.numbers(TARGET, unit.words, "every row needs one")
    grid = np.stack([csv.numbers(name, unit.words, "or an empty cell", gaps=True) for name in cells], axis=1)
    actual, notes = _are_actual(csv, cells, target, grid)
    deviation = _difference(grid, target[:, None], unit) if actual else grid
    ask_size(csv.source, next(iter(cells)), deviation, unit.symbol)
    there = np.isfinite(deviation)
    if not there.any(axis=1).all():
        raise InputError(
            f"{csv.where(int(np.argmin(there.any(axis=1))))}: no approach of this target; leave the row out"
        )
    rows, columns = np.nonzero(there)
    ways = np.array([_WAYS[match[2]] for match in cells.values()])
    runs = [match[3] for match in cells.values()]
    names = list(cells)
    where = [f"{csv.where(int(i))}, {names[j]}" for i, j in zip(rows, columns, strict=True)]
    found = Approaches(target[rows], ways[columns], [runs[j] for j in columns], deviation[rows, columns], where)
    return arranged(
        axis, found, unit.symbol, source=csv.source, notes=(*_how(csv, list(cells)), *notes, *_assumed(csv, axis, unit))
    )


def _check_alike(csv: CsvTable, cells: Mapping[str, re.Match[str]]) -> None:
    """Raises `InputError` where some approaches state a unit, and others none or another one."""
    stated = {name: csv.units.get(name) for name in cells}
    first, *others = stated
    odd = next((name for name in others if stated[name] != stated[first]), None)
    if odd is not None:
        said = [f"column {name} is in {stated[name] or 'no unit that it says'}" for name in (first, odd)]
        raise InputError(f"{csv.source}, header: {', '.join(said)}; expected one unit for all approaches")


def _how(csv: CsvTable, cells: list[str]) -> tuple[str, ...]:
    """How the file was read, with the unit that all cells have said once."""
    units = {csv.units[name] for name in cells if name in csv.units}
    of_cells = {f"{name} in {unit}" for name in cells for unit in units}
    said = [text for text in csv.said if text not in of_cells]
    return replace(csv, said=said + [f"approaches in {unit}" for unit in sorted(units)]).notes


def _are_actual(
    csv: CsvTable, cells: Mapping[str, re.Match[str]], target: np.ndarray, grid: np.ndarray
) -> tuple[bool, tuple[str, ...]]:
    """Whether the cells are positions: their names say it, or whether they follow the targets. And what was recognised."""
    stated = {match[1] for match in cells.values()}
    if len(stated) > 1:
        raise InputError(
            f"{csv.source}, header: some columns are called actual or deviation, others not; call them alike"
        )
    follows = _slope(np.repeat(target[:, None], grid.shape[1], axis=1), grid) > _FOLLOWS
    (name,) = stated
    if name is not None and follows != (name == ACTUAL):
        found = "follow the targets" if follows else "do not follow the targets"
        raise InputError(
            f"{csv.source}: columns called {name} {found}; expected {'deviations' if follows else 'positions'}"
        )
    return follows, ("the cells follow the targets and were read as positions",) if follows and name is None else ()


# ----------------------------------------------------------------------------------------------------------- units and sizes


class _Unit(NamedTuple):
    """`symbol`: "mm" or "°"; `words`: as `CsvTable.numbers` asks for it."""

    symbol: str
    words: str


def _unit(csv: CsvTable, axis: str) -> _Unit:
    """Degrees for a rotary axis, and where the header gives targets in an angle and nobody names the axis; else mm."""
    stated = csv.units.get(TARGET)
    angle = stated is not None and conversion(stated, "mm") is None
    rotary = axis[:1] in ROTARY_AXES and not axis[1:].strip("0123456789")  # C, and a second one C2
    return _Unit("°", "degrees") if rotary or (axis == AXIS and angle) else _Unit("mm", "mm")


def _assumed(csv: CsvTable, axis: str, unit: _Unit) -> tuple[str, ...]:
    """What was taken for granted, where neither the axis nor the unit of its targets is stated."""
    if axis != AXIS or TARGET in csv.units:
        return ()
    return (
        f"no axis is stated: targets and deviations were read in {unit.words}; state `axis`, such as C for degrees",
    )


def _difference(actual: np.ndarray, target: np.ndarray, unit: _Unit) -> np.ndarray:
    """actual - target; of angles within half a turn, as a display begins anew after a whole one."""
    difference = np.round(actual - target, DIGITS)
    return difference if unit.symbol == "mm" else (difference + 180.0) % 360.0 - 180.0


def _slope(target: np.ndarray, values: np.ndarray) -> float:
    """Of a straight line through values over targets, NaN left out; 0 where the targets do not differ."""
    kept = np.isfinite(values)
    t, v = target[kept] - target[kept].mean(), values[kept]
    return float(t @ v / (t @ t)) if t.any() else 0.0


def _check_actual(csv: CsvTable, target: np.ndarray, actual: np.ndarray) -> None:
    if _slope(target, actual) <= _FOLLOWS:
        raise InputError(
            f"{csv.source}: the column actual does not follow the targets; expected positions; call the column deviation if it "
            "holds actual - target"
        )


def _check_deviations(csv: CsvTable, name: str, target: np.ndarray, deviation: np.ndarray, unit: _Unit) -> None:
    if _slope(target, deviation) > _FOLLOWS:
        raise InputError(
            f"{csv.source}: the column {name} follows the targets; expected actual - target; call the column actual if it holds "
            "the positions reached"
        )
    ask_size(csv.source, DEVIATION, deviation, unit.symbol)
