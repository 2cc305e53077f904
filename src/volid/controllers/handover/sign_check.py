"""One point for each table at which a person sees at the machine whether its sign is right.

Only a motion shows a sign. For each table and grid that the control holds, the place is taken where it moves an axis most, and
the correction c = command to the drive - programmed position is computed by the simulated control: with this table alone, and
with everything that is loaded. An indicator at the axis, or the service display of the drive, must show it when the compensation
is switched on.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np

from volid.compensation.active import axis_table_words, grid_words
from volid.compensation.control import Control
from volid.compensation.grids.grid import AnyGrid
from volid.compensation.package import Compensation
from volid.compensation.tables.axis_table import AxisTable
from volid.compensation.tables.error_table import ErrorTable
from volid.controllers.base import Job
from volid.model.iso230 import SPINDLE
from volid.model.machine import Machine

SMALL = 0.001  # mm or °: a dial shows less badly
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
    """

    table: str
    at: Mapping[str, float]
    way: float
    axis: str
    alone: float
    together: float

    @property
    def is_small(self) -> bool:
        """Whether a dial indicator will hardly show it."""
        return abs(self.alone) < SMALL


def sign_checks(made: Compensation, job: Job, both: bool = True) -> tuple[SignCheck, ...]:
    """One point for each table, and one for each axis that a grid moves; what moves nothing has none.

    Args:
        made: What the control holds, as it was read back.
        job: The job that was written: machine, tool vector and lines.
        both: Whether tables hold both directions; else the mean of both is checked, without a reversal value beside the table.
    """
    look = _Look(job, made.control(job.machine), (1.0, -1.0) if both else (0.0,))
    found: list[SignCheck] = []
    for t in made.axis_tables:
        found += look.at(axis_table_words(t), Compensation((), (), (), (t,)), _on_table(job, t))
    for e in (e for e in made.tables if e.axis != SPINDLE):
        found += look.at(f"table of {e.function} over {e.axis}", Compensation((), (e,), ()), _on_function(job, e))[:1]
    for g in made.grids:
        found += look.at(grid_words(g), Compensation((), (), (g,)), _on_grid(job, g))
    return tuple(found)


class _Look(NamedTuple):
    """Where one part of what is loaded moves each axis most. `ways`: directions of approach that are looked at."""

    job: Job
    whole: Control
    ways: tuple[float, ...]

    def at(self, words: str, part: Compensation, places: np.ndarray) -> list[SignCheck]:
        """One point for each axis that the part moves, the most moved axis first; `places` (m, axes)."""
        job, alone, found = self.job, part.control(self.job.machine), []
        steps = np.stack([_steps(alone, places, w, job.tool) for w in self.ways])  # (ways, places, axes)
        for k, axis in enumerate(job.machine.axes):
            w, m = np.unravel_index(int(np.argmax(np.abs(steps[:, :, k]))), steps.shape[:2])
            step = float(steps[w, m, k])
            if abs(step) > NOTHING:
                total = float(_steps(self.whole, places[m][None], self.ways[w], job.tool)[0, k])
                at = {a: round(float(v), 6) for a, v in zip(job.machine.letters, places[m], strict=True)}
                found.append(SignCheck(words, at, self.ways[w], axis.letter, step, total))
        return sorted(found, key=lambda c: -abs(c.alone))


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
    nodes = {a: grid.nodes[k] for k, a in enumerate(grid.axes)}
    every = np.array(list(_places(job, nodes))) if np.prod([len(n) for n in nodes.values()]) <= MANY else None
    if every is not None:
        return every
    thinned = {a: n[:: max(len(n) // 8, 1)] for a, n in nodes.items()}
    return np.array(list(_places(job, thinned)))


def _places(job: Job, lines: Mapping[str, object]) -> Iterator[np.ndarray]:
    """All combinations of positions by axis letter, the other axes on the lines."""
    letters = list(lines)
    for values in product(*(np.asarray(lines[a], dtype=float) for a in letters)):
        q = np.array(job.at, dtype=float)
        for a, v in zip(letters, values, strict=True):
            q[job.machine.index(a)] = v
        yield q


def _line(job: Job, letter: str) -> float:
    return float(job.at[job.machine.index(letter)])


def with_unit(machine: Machine, letter: str, value: float, sign: bool = False) -> str:
    """A position, or with `sign` a motion of an axis: "-0.0100 mm"."""
    linear = machine.axis(letter).is_linear
    text = f"{value:+.4f}" if sign and linear else f"{value:+.6f}" if sign else f"{value:.9g}"
    return f"{text} {'mm' if linear else '°'}"
