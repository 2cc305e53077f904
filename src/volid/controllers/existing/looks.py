"""What existing tables look like: extent, largest value, reversal, and what of it is odd.

Numbers in a file of a control may be wrong while everything looks fine: read with another option or sense they are positions, not
deviations; a digit is wrong in one row; the table ends before the travel does. What can be seen of that is said here.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import PurePosixPath

import numpy as np

from volid.compensation.tables.axis_table import AxisTable
from volid.compensation.tables.error_table import ErrorTable
from volid.controllers.base import HELD, NOT_KNOWN, ROLLS_OVER
from volid.controllers.existing.reading import ExistingCompensation
from volid.model.iso230 import SPINDLE

LARGEST = {"mm": 1.0, "rad": 0.01}  # of a deviation: what is larger is no deviation of a machine
STEEPEST = 1e-3  # mm per mm, or rad per rad: 1 mm in 1 m
OUT_OF_LINE, LEAST = 8.0, {"mm": 0.002, "rad": 5e-6}  # times the middle of all such values, and at least so much
ALIKE = 0.5  # of what a single wrong value does to the lines beside it
FEWEST = 6  # positions among which one can be told to stand out of line
BEYOND = 1e-6  # mm or °


@dataclass(frozen=True, eq=False)
class Look:
    """One table as a person looks at it.

    Args:
        name: Such as "X over Y" or "EXY".
        argument: Letter of the axis whose position is looked up.
        unit: Unit of the values, "mm" or "rad"; with a factor that is a lever arm "rad" too.
        positions: Positions, shape (n,) [mm or °].
        forward, reverse: Error values in + and -, shape (n,) [mm or rad].
        factor: The axis that it is multiplied by, or "".
        source: Error functions that it holds, or "".
        period: 360 where it closes a turn, else 0.
    """

    name: str
    argument: str
    unit: str
    positions: np.ndarray
    forward: np.ndarray
    reverse: np.ndarray
    factor: str = ""
    source: str = ""
    period: float = 0.0

    @property
    def largest(self) -> float:
        """Largest size of a value [mm or rad]."""
        return float(np.maximum(np.abs(self.forward), np.abs(self.reverse)).max())

    @property
    def at(self) -> float:
        """Where that is [mm or °]."""
        return float(self.positions[int(np.argmax(np.maximum(np.abs(self.forward), np.abs(self.reverse))))])

    @property
    def reversal(self) -> tuple[float, float]:
        """Mean and largest size of B = E(+) - E(-) [mm or rad]."""
        apart = self.forward - self.reverse
        return float(np.mean(apart)), float(np.abs(apart).max())

    @property
    def step(self) -> float | None:
        """The step of equal positions [mm or °]; None where they are not equal, or there is one position."""
        steps = np.diff(self.positions)
        return float(steps[0]) if len(steps) and np.ptp(steps) < 1e-6 * abs(steps[0]) else None


def looks(found: ExistingCompensation) -> list[Look]:
    """All tables of a compensation, those of error functions first."""
    made = found.compensation
    return [*(_of_function(t) for t in made.tables), *(_of_axis(t, found) for t in made.axis_tables)]


def _of_function(t: ErrorTable) -> Look:
    return Look(t.function, t.axis, t.unit, t.positions, t.forward, t.reverse, "", t.function, t.period)


def _of_axis(t: AxisTable, found: ExistingCompensation) -> Look:
    lever = t.factor is not None
    unit = "mm" if found.machine.axis(t.output).is_linear and not lever else "rad"
    name = f"{t.output} over {t.argument}" + (f", times {t.factor.axis}" if t.factor else "")
    factor = t.factor.axis if t.factor else ""
    return Look(name, t.argument, unit, t.positions, t.forward, t.reverse, factor, _short(t.source), t.period)


def _short(source: str) -> str:
    """Where a table comes from; of a file its name without the folders."""
    return PurePosixPath(source).name


def oddities(found: ExistingCompensation) -> list[str]:
    """What needs attention before anybody relies on the files, one sentence each."""
    said = [text for look in looks(found) for text in _odd(look, found)]
    said += [f"{g.type} grid: all values are 0" for g in found.compensation.grids if not np.nan_to_num(g.values).any()]
    return [*said, *found.control().corrected_twice]


def _odd(look: Look, found: ExistingCompensation) -> Iterator[str]:
    if look.largest > LARGEST[look.unit]:
        yield _no_deviation(look, found)
        return
    if look.largest == 0.0:
        yield f"{look.name}: all values are 0, the table does nothing"
    yield from _steep(look)
    for way, values in _ways(look):
        yield from _out_of_line(look, way, values)


def _ways(look: Look) -> list[tuple[str, np.ndarray]]:
    if np.array_equal(look.forward, look.reverse):
        return [("", look.forward)]
    return [(" in +", look.forward), (" in -", look.reverse)]


def _no_deviation(look: Look, found: ExistingCompensation) -> str:
    declared = found.declaration
    options = [] if declared is None else [o.name for o in declared.options]
    other = f", or with another option ({', '.join(options)})" if options else ""
    return (
        f"{look.name}: values up to {look.largest:.4g} {look.unit} are no deviations of a machine; the file is meant in another "
        f"unit or sense{other}"
    )


def _steep(look: Look) -> Iterator[str]:
    """Between which positions a table changes by more than 1 mm in 1 m."""
    rotary = look.argument in "ABC"
    steps = np.diff(np.deg2rad(look.positions) if rotary else look.positions)
    slopes = np.abs(np.diff(np.stack([look.forward, look.reverse]), axis=1)).max(axis=0) / steps
    if len(slopes) and look.unit == "mm" and not rotary and slopes.max() > STEEPEST:
        i = int(np.argmax(slopes))
        yield (
            f"{look.name}: between {look.positions[i]:g} and {look.positions[i + 1]:g} the value changes by "
            f"{1e6 * slopes[i]:.0f} µm/m; expected less than 1000 µm/m"
        )


def _out_of_line(look: Look, way: str, values: np.ndarray) -> Iterator[str]:
    """The value that stands farthest off the line through its neighbours, where it stands alone, as a wrong digit does."""
    x = look.positions
    if len(x) < FEWEST:
        return
    share = (x[1:-1] - x[:-2]) / (x[2:] - x[:-2])
    off = values[1:-1] - ((1.0 - share) * values[:-2] + share * values[2:])
    i = int(np.argmax(np.abs(off)))
    others = np.abs(np.delete(off, [k for k in (i - 1, i, i + 1) if 0 <= k < len(off)]))
    usual = float(np.median(others)) if len(others) else 0.0
    alone = abs(off[i]) > max(OUT_OF_LINE * usual, LEAST[look.unit], 2.0 * others.max(initial=0.0))
    if alone and _pulls_neighbours(x, off, i):
        scale, unit = (1e3, "µm") if look.unit == "mm" else (1e6, "µrad")
        yield (
            f"{look.name}: the value at {x[i + 1]:g}{way} stands {scale * off[i]:+.1f} {unit} off the line of its neighbours, "
            f"others {scale * usual:.1f} {unit}; look for a wrong digit"
        )


def _pulls_neighbours(x: np.ndarray, off: np.ndarray, i: int) -> bool:
    """Whether the values beside position i + 1 are off to the other side, as a single wrong value makes them.

    Where a table only bends, they are not off.
    """
    left = -off[i] * (x[i] - x[i - 1]) / (x[i + 1] - x[i - 1]) if i > 0 else None
    right = -off[i] * (x[i + 3] - x[i + 2]) / (x[i + 3] - x[i + 1]) if i + 1 < len(off) else None
    pairs = [(off[k], e) for k, e in ((i - 1, left), (i + 1, right)) if e is not None]
    return all(abs(v - e) < ALIKE * abs(e) for v, e in pairs)


def beyond(found: ExistingCompensation) -> list[str]:
    """Where axes travel beyond the positions of a table or grid, and what the control does there, one sentence each."""
    said = []
    for name, letter, positions, period in _spans(found):
        low, high = found.machine.axis(letter).travel
        ends = [f"below {positions[0]:g}"] if low < positions[0] - BEYOND else []
        ends += [f"above {positions[-1]:g}"] if high > positions[-1] + BEYOND else []
        if ends and not period:
            said.append(f"{name}: {letter} travels from {low:g} to {high:g}; {' and '.join(ends)} {_does(found)}")
    return said


def _spans(found: ExistingCompensation) -> list[tuple[str, str, np.ndarray, float]]:
    """Of every table, and every axis of a grid: name, letter, positions, and 360 where they close a turn."""
    spans = [(k.name, k.argument, k.positions, k.period) for k in looks(found) if k.argument != SPINDLE]
    grids = found.compensation.grids
    return spans + [
        (f"{g.type} grid", a, n, p) for g in grids for a, n, p in zip(g.axes, g.nodes, g.periods, strict=True)
    ]


def points_beyond(found: ExistingCompensation, positions: np.ndarray) -> list[str]:
    """How many of some positions, machine axis order, lie beyond a table or grid, and what the control does there."""
    said = []
    for name, letter, nodes, period in _spans(found):
        q = positions[:, found.machine.index(letter)]
        count = 0 if period else int(((q < nodes[0] - BEYOND) | (q > nodes[-1] + BEYOND)).sum())
        if count:
            said.append(f"{count} of {len(q)} points lie beyond {name} ({nodes[0]:g} … {nodes[-1]:g}): {_does(found)}")
    return said


def _does(found: ExistingCompensation) -> str:
    declared = found.declaration
    outside = HELD if declared is None else declared.outside
    words = {
        HELD: "the end value is held",
        ROLLS_OVER: "the table begins again",
        NOT_KNOWN: "public sources do not say what the control does; volid takes the end value as held",
    }
    return words.get(outside, outside)
