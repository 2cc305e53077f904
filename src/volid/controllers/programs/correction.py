"""A polyline corrected: where its lines are cut so that the corrected path is followed within a tolerance.

Along a line, the correction c(t) of grids (trilinear, with rotations through the lever arm of a constant tool vector) and of
tables (linear, times a lever arm or a factor that is linear itself) is a polynomial of degree three between the places where the
line crosses a node. Four values give its control points, and no point of it departs from the chord between its ends by more than
the largest distance of a control point from that chord: Bernstein polynomials are positive and add up to 1. So the bound is one,
not an estimate from samples. Chords of a smooth part fall with the square of their number, those about a node with the number.

Not modelled: a smoothing or rounding control; of second order, that the correction is looked up at the programmed position.

Source: G. Farin, Curves and Surfaces for CAGD, 5th ed. 2002, 4.3 (convex hull), 5.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from volid.backend.steps import Step
from volid.compensation.control import TURNING, Control
from volid.controllers.programs.lines import LETTERS, Lines, Places, crossings, divided
from volid.exceptions import InputError

_MOST = 64  # parts into which a line is cut at once
_ROUNDS = 40
_NEGLIGIBLE = 1e-12  # of a line: pieces below are rounding
CHUNK = 50_000  # lines at once


class Corrected(NamedTuple):
    """Lines cut so that their corrected ends carry the path. `lines`: the cut lines. `first`, `last`: corrected ends, (m, 3)
    [mm]. `bound`: largest distance of a corrected line from the corrected curve, (m,) [mm]. `outside`: whether an end lies
    outside the nodes of a table or grid, (m,)."""

    lines: Lines
    first: np.ndarray
    last: np.ndarray
    bound: np.ndarray
    outside: np.ndarray


def nodes_of(control: Control) -> dict[str, list[np.ndarray]]:
    """Positions of X, Y and Z at which each table and grid of a control bends, rising, by letter."""
    found: dict[str, list[np.ndarray]] = {letter: [] for letter in LETTERS}
    for grid in control.grids:
        for letter, nodes in zip(grid.axes, grid.nodes, strict=True):
            found[letter].append(np.asarray(nodes))
    for table in control.tables:
        if table.axis in found:
            found[table.axis].append(table.positions)
    for moved in control.axis_tables:
        found[moved.argument].append(moved.positions)
        if moved.factor:
            found[moved.factor.axis].append(moved.factor.positions)
    return found


def ask_followable(control: Control) -> None:
    """Raises `InputError` where the correction along a line is not of the form that this module bounds."""
    letters = [a.letter for a in control.machine.axes]
    if sorted(letters) != list(LETTERS):
        raise InputError(
            f"machine '{control.machine.name}' has the axes {', '.join(letters)}; a program is corrected on X, Y and Z. "
            "With rotary axes that stand still, leave `machine` out and give the grid of the linear axes, with the turned tool "
            "vector as `tool`"
        )
    turning = [g.type for g in control.grids if g.type in TURNING]
    if turning:
        raise InputError(
            f"control: a grid of {turning[0]} turns rotary axes; give one of L-VOL, which moves X, Y and Z alone"
        )
    if control.increment or control.smoothing or control.clamped:
        raise InputError(
            "control: increments, smoothing and clamped axes are a control's own; a program is corrected without them"
        )


class Corrector:
    """Corrects lines as a simulated control does."""

    def __init__(self, control: Control) -> None:
        ask_followable(control)
        self.control = control
        found = nodes_of(control)
        self.nodes = {a: np.unique(np.concatenate([np.zeros(0), *parts])) for a, parts in found.items()}
        self._low = np.array([max((n[0] for n in found[a]), default=-np.inf) for a in LETTERS])
        self._high = np.array([min((n[-1] for n in found[a]), default=np.inf) for a in LETTERS])
        self._columns = [control.machine.index(a) for a in LETTERS]

    def shift(self, places: np.ndarray, tool: np.ndarray, way: np.ndarray) -> np.ndarray:
        """Corrections of X, Y, Z at places, with tool vectors and directions, all (m, 3); (m, 3) [mm]."""
        q, d = np.empty_like(places), np.empty_like(places)
        q[:, self._columns], d[:, self._columns] = places, way
        return np.asarray((self.control.command(q, tool, d) - q)[:, self._columns])

    def bounds(self, lines: Lines) -> tuple[np.ndarray, np.ndarray]:
        """Largest distance of the correction along each line from its chord, (m,) [mm], and the share of the line at which it
        crosses a node and is farthest from the chord, where that is the larger part of it; else NaN."""
        owner, t0, t1 = self._pieces(lines)
        share = np.stack([t0, (2.0 * t0 + t1) / 3.0, (t0 + 2.0 * t1) / 3.0, t1], axis=1)
        span = (lines.end - lines.start)[owner]
        places = lines.start[owner][:, None, :] + share[:, :, None] * span[:, None, :]
        tool, way = (np.repeat(a[owner], 4, axis=0) for a in (lines.tool, lines.way))
        p = self.shift(places.reshape(-1, 3), tool, way).reshape(-1, 4, 3)
        inner = (
            -5 * p[:, 0] + 18 * p[:, 1] - 9 * p[:, 2] + 2 * p[:, 3],
            2 * p[:, 0] - 9 * p[:, 1] + 18 * p[:, 2] - 5 * p[:, 3],
        )
        points = np.stack([p[:, 0], inner[0] / 6.0, inner[1] / 6.0, p[:, 3]], axis=1)
        new = np.r_[True, owner[1:] != owner[:-1]] if len(owner) else np.zeros(0, dtype=bool)
        begins = np.flatnonzero(new)
        a, b = points[begins, 0], points[np.r_[begins[1:], len(owner)] - 1, 3]  # ends of each line
        apart = points - a[owner][:, None] - share[:, :, None] * (b - a)[owner][:, None]
        size = np.linalg.norm(apart, axis=2)
        bound = np.maximum.reduceat(size.max(axis=1), begins)
        at_node = np.maximum.reduceat(size[:, 0], begins)
        farthest = np.full(len(bound), np.nan)
        chosen = (size[:, 0] == at_node[owner]) & (2.0 * at_node > bound)[owner] & (t0 > 0.0)
        farthest[owner[chosen]] = t0[chosen]
        return bound, farthest

    def _pieces(self, lines: Lines) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Line, and shares of it between which it crosses no node: every line has at least one."""
        m = np.arange(len(lines.start))
        owner, share = [m, m], [np.zeros(len(m)), np.ones(len(m))]
        for k, letter in enumerate(LETTERS):
            which, t = crossings(lines.start[:, k], lines.end[:, k], self.nodes[letter])
            owner.append(which)
            share.append(t)
        line, t = np.concatenate(owner), np.concatenate(share)
        order = np.lexsort((t, line))
        line, t = line[order], t[order]
        piece = (line[1:] == line[:-1]) & (t[1:] - t[:-1] > _NEGLIGIBLE)
        return line[:-1][piece], t[:-1][piece], t[1:][piece]

    def outside(self, places: np.ndarray) -> np.ndarray:
        """Whether places (m, 3) lie outside the nodes of a table or grid, (m,)."""
        return np.asarray(((places < self._low - 1e-6) | (places > self._high + 1e-6)).any(axis=1))

    def correct(self, lines: Lines, progress: Callable[[Step], None] | None = None) -> Corrected:
        """Lines cut to their tolerance, and corrected.

        Args:
            lines: The lines of a path, in its order.
            progress: Is told about every chunk of lines.
        """
        parts = []
        for begin in range(0, len(lines.start), CHUNK):
            if progress is not None:
                progress(Step(begin, len(lines.start), "lines", of="correcting"))
            parts.append(self._part(lines.rows(slice(begin, begin + CHUNK))))
        if not parts:
            parts = [self._part(lines)]
        return Corrected(Lines(*map(np.concatenate, zip(*(p.lines for p in parts), strict=True))), *(
            np.concatenate(column) for column in list(zip(*parts, strict=True))[1:]
        ))  # fmt: skip

    def first_refused(self, lines: Lines) -> int:
        """The owner of the first line whose ends the control cannot correct, as where a grid is blank; -1 where it can."""
        low, high = 0, len(lines.owner)
        if high == 0 or self._can(lines):
            return -1
        while high - low > 1:  # the first one lies in low … high
            middle = (low + high) // 2
            low, high = (middle, high) if self._can(lines.rows(slice(low, middle))) else (low, middle)
        return int(lines.owner[low])

    def _can(self, lines: Lines) -> bool:
        try:
            for places in (lines.start, lines.end):
                self.shift(places, lines.tool, lines.way)
        except InputError:
            return False
        return True

    def _part(self, lines: Lines) -> Corrected:
        cut, bound = self._cut(lines)
        first, last = (places + self.shift(places, cut.tool, cut.way) for places in (cut.start, cut.end))
        touched = ~np.isnan(cut.origin[:, 0])
        if touched.any():
            zero = self.shift(cut.origin[touched], cut.tool[touched], np.zeros_like(cut.way[touched]))
            first[touched] -= zero
            last[touched] -= zero
        return Corrected(cut, first, last, bound, self.outside(cut.start) | self.outside(cut.end))

    def _cut(self, lines: Lines) -> tuple[Lines, np.ndarray]:
        """Lines in parts whose bound is below the tolerance, in their order, and the bounds."""
        bound = np.zeros(len(lines.start))
        index, at = np.arange(len(lines.start)), np.zeros(len(lines.start))
        open_ = np.isfinite(lines.tolerance)
        closed: list[tuple[Lines, np.ndarray, np.ndarray, np.ndarray]] = [_kept(lines, bound, index, at, ~open_)]
        lines, index, at = lines.rows(open_), index[open_], at[open_]
        length = np.ones(len(index))
        for _ in range(_ROUNDS):
            if not len(index):
                break
            bound, node = self.bounds(lines)
            good = bound <= lines.tolerance
            closed.append(_kept(lines, bound, index, at, good))
            bad = ~good
            parts = np.clip(np.ceil(np.sqrt(bound[bad] / lines.tolerance[bad])), 2, _MOST).astype(int)
            parts = np.where(np.isnan(node[bad]), parts, 2)
            places = Places(index[bad], at[bad], length[bad])
            lines, (index, at, length) = divided(lines.rows(bad), places, parts, node[bad])
        else:
            raise InputError(
                "the correction jumps between two places of a line; look at the nodes of its tables and grids"
            )
        cut = Lines(*map(np.concatenate, zip(*(c[0] for c in closed), strict=True)))
        bound, index, at = (np.concatenate([c[i] for c in closed]) for i in (1, 2, 3))
        order = np.lexsort((at, index))
        return cut.rows(order), bound[order]


def _kept(
    lines: Lines, bound: np.ndarray, index: np.ndarray, at: np.ndarray, which: np.ndarray
) -> tuple[Lines, np.ndarray, np.ndarray, np.ndarray]:
    return lines.rows(which), bound[which], index[which], at[which]
