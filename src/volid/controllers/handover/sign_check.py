"""One point for each table at which a person sees at the machine whether its sign is right.

Only a motion shows a sign. For each table and grid that the control holds, the correction c = command to the drive - programmed
position is computed by the simulated control: with this table alone, and with everything that is loaded. The place is taken where
the smaller of both is largest among those that have the same sign, so that either way of checking shows the same direction; where
a dial shows none of these, that of the largest motion alone. It can be approached from both sides: ends of travels are no places.
An indicator at the axis, or the service display of the drive, must show the motion when the compensation is switched on.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import product
from typing import NamedTuple

import numpy as np

from volid.compensation.active import axis_table_words, grid_words
from volid.compensation.control import Control
from volid.compensation.grids.grid import AnyGrid
from volid.compensation.grids.sides import LINEAR
from volid.compensation.package import Compensation
from volid.compensation.tables.axis_table import AxisTable
from volid.compensation.tables.error_table import ErrorTable
from volid.controllers.base import Job
from volid.model.iso230 import SPINDLE
from volid.model.machine import Axis, Machine

SMALL = {"mm": 0.003, "°": 0.001}  # a dial, or one at 100 mm from a rotary axis, shows less badly
EDGE = 0.02  # of a travel: room at its ends for the approach and for the correction
NOTHING = 1e-9  # mm or °: no motion
MANY = 2000  # nodes of a grid that are looked at


@dataclass(frozen=True)
class SignCheck:
    """One point.

    Args:
        table: What is checked, in words.
        at: Programmed positions by axis letter [mm or °].
        way: Direction in which all axes come, +1 or -1; 0 for the mean of both.
        axis: Letter of the axis that must move.
        alone: Its motion by this table alone [mm or °].
        together: Its motion with everything that is loaded [mm or °].
        unit: Unit of both.
        is_together: Whether only everything together can be seen, as where a table is multiplied by another one.
    """

    table: str
    at: Mapping[str, float]
    way: float
    axis: str
    alone: float
    together: float
    unit: str = "mm"
    is_together: bool = False

    @property
    def is_small(self) -> bool:
        """Whether a dial indicator will hardly show it."""
        return abs(self.together if self.is_together else self.alone) < SMALL[self.unit]


def sign_checks(
    made: Compensation,
    job: Job,
    both: bool = True,
    only_together: Callable[[AxisTable], bool] = lambda table: table.factor is not None,
) -> tuple[SignCheck, ...]:
    """One point for each table, and one for each axis that a grid moves; what moves nothing has none.

    Args:
        made: What the control holds, as it was read back.
        job: The job that was written: machine, tool vector and lines.
        both: Whether tables hold both directions; else the mean of both is checked, without a reversal value beside the table.
        only_together: Whether what a table does can be seen with all others loaded alone.
    """
    look = _Look(job, made.control(job.machine), (1.0, -1.0) if both else (0.0,))
    found: list[SignCheck] = []
    for t in made.axis_tables:
        checks = look.at(axis_table_words(t), Compensation((), (), (), (t,)), _on_table(job, t))
        found += [replace(c, is_together=only_together(t)) for c in checks]
    for e in (e for e in made.tables if e.axis != SPINDLE):
        found += look.at(f"table of {e.function} over {e.axis}", Compensation((), (e,), ()), _on_function(job, e))[:1]
    for g in made.grids:
        found += look.at(short_grid_words(g), Compensation((), (), (g,)), _on_grid(job, g))
    return tuple(found)


class _Look(NamedTuple):
    """Where one part of what is loaded moves each axis most. `ways`: directions of approach that are looked at."""

    job: Job
    whole: Control
    ways: tuple[float, ...]

    def at(self, words: str, part: Compensation, places: np.ndarray) -> list[SignCheck]:
        """One point for each axis that the part moves, the one that is seen best first; `places` (m, axes)."""
        job, found = self.job, []
        alone, total = (self._motions(c, places) for c in (part.control(job.machine), self.whole))
        seen = np.where(alone * total > 0.0, np.minimum(np.abs(alone), np.abs(total)), 0.0)
        for k, axis in enumerate(job.machine.axes):
            unit = "mm" if axis.is_linear else "°"
            sure = seen[:, :, k] if seen[:, :, k].max() >= SMALL[unit] else np.abs(alone[:, :, k])
            w, m = np.unravel_index(int(np.argmax(sure)), sure.shape)
            if abs(alone[w, m, k]) > NOTHING:
                at = {a: round(float(v), 6) for a, v in zip(job.machine.letters, places[m], strict=True)}
                moves = float(alone[w, m, k]), float(total[w, m, k])
                check = SignCheck(words, at, self.ways[w], axis.letter, *moves, unit)
                found.append((float(sure[w, m]), check))
        return [check for _, check in sorted(found, key=lambda f: -f[0])]

    def _motions(self, control: Control, places: np.ndarray) -> np.ndarray:
        """What a control adds to its commands, shape (ways, places, axes)."""
        return np.stack([_steps(control, places, way, self.job.tool) for way in self.ways])


def _steps(control: Control, q: np.ndarray, way: float, tool: np.ndarray) -> np.ndarray:
    return np.asarray(control.command(q, tool, np.full_like(q, way)) - q)


def _on_table(job: Job, table: AxisTable) -> np.ndarray:
    """The points of a table on its line, with the lever arm at its ends."""
    factor = table.factor
    levers: tuple[float, ...] = () if factor is None else (float(factor.positions[0]), float(factor.positions[-1]))
    return np.array(list(_places(job, {table.argument: table.positions, **({factor.axis: levers} if factor else {})})))


def _on_function(job: Job, table: ErrorTable) -> np.ndarray:
    """The points of a table of an error function, the other linear axes at their lines and at the ends of their travels."""
    machine = job.machine
    others = {
        a.letter: (_line(job, a.letter), *a.travel) for a in machine.axes if a.is_linear and a.letter != table.axis
    }
    return np.array(list(_places(job, {**others, table.axis: table.positions})))


def _on_grid(job: Job, grid: AnyGrid) -> np.ndarray:
    """The nodes of a grid, thinned where there are many."""
    nodes = {a: _reachable(job.machine.axis(a), grid.nodes[k]) for k, a in enumerate(grid.axes)}
    if np.prod([len(n) for n in nodes.values()]) > MANY:
        nodes = {a: n[:: max(len(n) // 8, 1)] for a, n in nodes.items()}
    return np.array(list(_places(job, nodes)))


def _places(job: Job, lines: Mapping[str, object]) -> Iterator[np.ndarray]:
    """All combinations of positions by axis letter, the other axes on the lines, all of them within reach."""
    resting = [_reachable(a, [v])[0] for a, v in zip(job.machine.axes, job.at, strict=True)]
    letters = list(lines)
    for values in product(*(_reachable(job.machine.axis(a), lines[a]) for a in letters)):
        q = np.array(resting, dtype=float)
        for a, v in zip(letters, values, strict=True):
            q[job.machine.index(a)] = v
        yield q


def _reachable(axis: Axis, positions: object) -> np.ndarray:
    """Those of the positions that can be approached from both sides; where fewer than three can, all, moved in from the ends."""
    q, (low, high) = np.asarray(positions, dtype=float), axis.travel
    if not axis.is_linear and high - low >= 360.0:
        return q  # it goes on
    gap = EDGE * (high - low)
    inside = q[(q >= low + gap) & (q <= high - gap)]
    return inside if len(inside) > 2 else np.unique(np.clip(q, low + gap, high - gap).round(3))


def short_grid_words(grid: AnyGrid) -> str:
    """A grid without its tool vector, which files of many controls do not hold: "L-VOL: grid over X, Y, Z"."""
    return grid_words(grid) if grid.side != LINEAR else f"{grid.type}: grid over {', '.join(grid.axes)}"


def _line(job: Job, letter: str) -> float:
    return float(job.at[job.machine.index(letter)])


def with_unit(machine: Machine, letter: str, value: float, sign: bool = False) -> str:
    """A position, or with `sign` a motion of an axis: "-0.0100 mm"."""
    linear = machine.axis(letter).is_linear
    text = f"{value:+.4f}" if sign and linear else f"{value:+.6f}" if sign else f"{value:.9g}"
    return f"{text} {'mm' if linear else '°'}"
