"""Axes that move only because another one does: how far, how often they turn, and what their own reversal adds.

A compensation moves axes that would rest (ISO/TR 16907 4 e, 10.5 d, 11.2 a-c). While one axis goes along its travel, with the
others at the middle, at the corners of theirs and at the nodes of grids, every other axis k follows the correction c_k. Each
turn of it loses the axis's own reversal B_k, and a run shorter than its least increment is not made at all. Not modelled:
dynamics, the time that a turn takes, marks that it leaves on a surface.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from volid.compensation.control import Control
from volid.compensation.steady import turns_of
from volid.fitting.solution import Solution
from volid.model.iso230 import parse
from volid.model.machine import Machine

POINTS = 401  # along a travel, besides the points of tables and grids
TINY = 1e-9  # mm or °: no motion
LINES = 11  # nodes of a grid on either side of a line, at most


@dataclass(frozen=True)
class HelpingMotion:
    """What one axis does while another one moves.

    Args:
        moving: Letter of the axis that goes along its travel.
        helping: Letter of the axis that follows.
        largest: Largest range of its correction along a line [mm or °].
        turns: Largest number of its turns along a line, in steps of its least increment where that is stated.
        smallest: Shortest run between two turns or standstills [mm or °].
        least: Its least increment [mm or °]; None where it is not stated.
        reversal: Its own reversal, |B|, which it loses at each turn [mm or °]; None where neither model nor user states it.
    """

    moving: str
    helping: str
    largest: float
    turns: int
    smallest: float
    least: float | None = None
    reversal: float | None = None

    @property
    def too_small(self) -> bool:
        """Whether it is asked for runs that it cannot make."""
        return self.least is not None and self.smallest < self.least * (1.0 - 1e-6)


def helping_axes(
    control: Control,
    tool: np.ndarray,
    ranges: Mapping[str, tuple[float, float]] | None = None,
    increment: Mapping[str, float] | None = None,
    reversal: Mapping[str, float] | None = None,
) -> tuple[HelpingMotion, ...]:
    """Every pair of axes of which the first moves and the second follows.

    Args:
        control: The simulated control with its compensation, without least increments.
        tool: Tool vector, shape (3,) [mm].
        ranges: Lowest and highest position by axis letter [mm or °]; the travel by default.
        increment: Least increments by axis letter [mm or °].
        reversal: Reversal values |B| by axis letter [mm or °].

    >>> import volid
    >>> machine = volid.load_machine("models/wYXbZt_vertical.toml")
    >>> y, e = np.array([0.0, 300.0, 600.0]), np.array([0.0, 0.006, 0.0])
    >>> control = volid.Control(machine, axis_tables=(volid.AxisTable("X", "Y", y, e, e),))
    >>> [(h.moving, h.helping, round(h.largest, 4), h.turns) for h in helping_axes(control, np.zeros(3))]
    [('Y', 'X', 0.006, 1)]
    """
    machine, found = control.machine, []
    least, lost = increment or {}, reversal or {}
    for i, axis in enumerate(machine.axes):
        paths = list(_paths(control, i, np.asarray(tool, dtype=float), ranges or {}))
        for k, other in enumerate(machine.axes):
            runs = [r for p in paths for r in _runs(p[:, k])]
            if k != i and runs:
                found.append(
                    HelpingMotion(
                        axis.letter,
                        other.letter,
                        max(float(np.ptp(p[:, k])) for p in paths),
                        max(_turns(p[:, k], least.get(other.letter)) for p in paths),
                        min(runs),
                        least.get(other.letter),
                        lost.get(other.letter),
                    )
                )
    return tuple(found)


def model_reversal(solution: Solution) -> dict[str, float]:
    """Largest |B| of the positioning of each axis over its travel, by letter [mm or °], of axes whose reversal the model has."""
    theta, found = np.asarray(solution.parameters), {}
    for name in dict.fromkeys(f.name for f in solution.model.functions if f.part == "reversal"):
        symbol = parse(name)
        axis = solution.machine.axis(symbol.axis)
        if name == f"E{axis.letter}{axis.letter}":
            q = np.linspace(*axis.travel, POINTS)
            up, down = (solution.motion_rows(name, q, way) @ theta for way in (1, -1))
            largest = float(np.abs(up - down).max())
            found[axis.letter] = largest if axis.is_linear else float(np.rad2deg(largest))
    return found


def helping_words(machine: Machine, one: HelpingMotion) -> str:
    """Such as "while Y moves, X is moved by up to 6.00 µm and turns 1 time; each turn loses its reversal of 4.00 µm"."""
    axis = machine.axis(one.helping)
    times = "does not turn" if not one.turns else f"turns {one.turns} time{'s' if one.turns > 1 else ''}"
    text = f"while {one.moving} moves, {one.helping} is moved by up to {_size(axis, one.largest)} and {times}"
    if one.reversal is not None and one.turns:
        text += f"; each turn loses its own reversal of {_size(axis, one.reversal)}"
    if one.too_small and one.least is not None:
        text += f"; runs of {_size(axis, one.smallest)} are below its least increment of {_size(axis, one.least)}"
    return text


def _size(axis: Any, value: float) -> str:
    return f"{1e3 * value:.2f} µm" if axis.is_linear else f"{value:.6f}°"


def _paths(
    control: Control, i: int, tool: np.ndarray, ranges: Mapping[str, tuple[float, float]]
) -> Iterator[np.ndarray]:
    """Corrections (m, axes) along the travel of axis i in both directions, the others where `_places` says."""
    machine = control.machine
    ends = [ranges.get(a.letter, a.travel) for a in machine.axes]
    along = np.union1d(np.linspace(*ends[i], POINTS), _nodes(control, machine.axes[i].letter, ends[i]))
    others = [k for k in range(len(ends)) if k != i]
    for places in _places(control, others, ends):
        q = np.zeros((len(along), len(ends)))
        q[:, i], q[:, others] = along, places
        for way in (1.0, -1.0):
            ways = np.zeros_like(q)
            ways[:, i] = way
            yield control.command(q, tool, ways) - q


def _places(control: Control, others: Sequence[int], ends: Sequence[tuple[float, float]]) -> list[tuple[float, ...]]:
    """Positions of the other axes: the middle, all corners, and the lines through the nodes of grids, the rest at the middle.

    Tables bend along the axis that moves alone, so that corners show the largest motion; a grid may bend along any of its lines.
    """
    middle = tuple(0.5 * (ends[k][0] + ends[k][1]) for k in others)
    found = [middle, *product(*(ends[k] for k in others))]
    for grid in control.grids:
        nodes = dict(zip(grid.axes, grid.nodes, strict=True))
        letters = [control.machine.axes[k].letter for k in others]
        choices = [
            _spread(nodes[a], ends[k]) if a in nodes else (m,) for a, k, m in zip(letters, others, middle, strict=True)
        ]
        found += product(*choices)
    return list(dict.fromkeys(found))


def _spread(nodes: np.ndarray, ends: tuple[float, float]) -> tuple[float, ...]:
    """The nodes of a grid between both ends, at most `LINES` of them, spread evenly."""
    inside = nodes[(nodes >= ends[0]) & (nodes <= ends[1])]
    chosen = np.unique(np.linspace(0, len(inside) - 1, min(len(inside), LINES)).round().astype(int))
    return tuple(float(v) for v in inside[chosen]) or (0.5 * (ends[0] + ends[1]),)


def _nodes(control: Control, letter: str, ends: tuple[float, float]) -> np.ndarray:
    """Points of all tables and grids over an axis, within its range; of a full turn in every turn of it."""
    periods = [(t.positions, t.period) for t in control.axis_tables if t.argument == letter]
    periods += [(t.positions, t.period) for t in control.tables if t.axis == letter]
    factors = [t.factor for t in control.axis_tables if t.factor is not None and t.factor.axis == letter]
    periods += [(f.positions, 0.0) for f in factors]
    for grid in (g for g in control.grids if letter in g.axes):
        k = grid.axes.index(letter)
        periods.append((grid.nodes[k], grid.periods[k]))
    every = np.unique(np.concatenate([np.asarray(ends), *(_turned(x, period, ends) for x, period in periods)]))
    return every[(every >= ends[0]) & (every <= ends[1])]


def _turned(positions: np.ndarray, period: float, ends: tuple[float, float]) -> np.ndarray:
    """Positions, and those a whole number of turns beside them as far as the axis goes."""
    if not period:
        return positions
    first, last = np.floor((ends[0] - positions[-1]) / period), np.ceil((ends[1] - positions[0]) / period)
    return np.concatenate([positions + k * period for k in np.arange(first, last + 1)])


def _runs(values: np.ndarray) -> list[float]:
    """Lengths of the motions between turns and standstills."""
    steps = np.diff(values)
    ways = np.where(np.abs(steps) < TINY * 1e-3, 0.0, np.sign(steps))
    ends = np.flatnonzero(np.diff(ways)) + 1
    pieces = np.split(steps, ends)
    return [length for p in pieces if (length := float(abs(p.sum()))) > TINY]


def _turns(values: np.ndarray, least: float | None) -> int:
    return turns_of(values, TINY) if least is None else turns_of(np.round(values / least), 0.5)
