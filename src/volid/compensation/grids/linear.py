"""Spatial error and compensation grids of the linear axes (ISO/TR 16907 Table 2; type L-VOL)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from volid.compensation.grids.interpolation import interpolate
from volid.compensation.grids.parts import evaluate_part, full_positions, part_letters, part_notes
from volid.exceptions import InputError, NotDeterminedError
from volid.fitting.results import Deviations
from volid.fitting.solution import Solution
from volid.model.iso230 import DIRECTIONS, LINEAR_AXES
from volid.model.machine import Axis
from volid.plausibility.checks import SAME_POSITION

POINTS = 21
LARGEST = 2_000_000
_IN_DEGREES = np.array([1.0] * 3 + [180.0 / np.pi] * 3)


@dataclass(frozen=True, eq=False)
class Grid:
    """Deviations at the nodes of a regular grid over the linear axes.

    `axes`: letters, in the order X, Y, Z. `nodes`: positions per axis [mm]. `positions`: (n, k), X varying fastest.
    `values`: ERROR values (n, 6), translations at `tool` [mm] and rotations [rad], machine frame; a control gets another
    tool from e(tool) = e(tool0) + rotation × (tool - tool0). `u`: standard uncertainties (n, 6). NaN where the data do not
    determine a component. `outside`: (n,) True where a node lies outside what was measured. `datum`: words.
    `bands`: (4, n, 6) ends of 95 % coverage intervals, symmetric and shortest, where asked for (`grid_intervals`).
    With rotary axes the grid holds the errors of the linear axes alone, and `tool` is a *rotated* tool vector: what the rotary
    axes of the head make of the tool vector; `rotary_grids` hold the rest.
    """

    type: str
    axes: tuple[str, ...]
    nodes: tuple[np.ndarray, ...]
    positions: np.ndarray
    values: np.ndarray
    u: np.ndarray
    outside: np.ndarray
    tool: tuple[float, float, float]
    frame: str
    datum: str
    notes: tuple[str, ...] = ()
    bands: np.ndarray | None = None

    @property
    def compensation(self) -> np.ndarray:
        """Compensation values, minus the error values, (n, 6) [mm, rad] (CONVENTIONS 5)."""
        return -self.values

    def table_2(self, *, errors: bool = False) -> tuple[tuple[str, ...], np.ndarray]:
        """The table of ISO/TR 16907, Table 2: columns n, X, Y, Z [mm], ΔX, ΔY, ΔZ [mm], ΔA, ΔB, ΔC [°]; one row per node.

        Compensation values, or error values (`errors`).
        """
        columns = ("n", *self.axes, *(f"Δ{letter}" for letter in DIRECTIONS))
        values = (self.values if errors else self.compensation) * _IN_DEGREES
        return columns, np.column_stack([np.arange(1, len(values) + 1), self.positions, values])

    def interpolate(self, positions: np.ndarray) -> np.ndarray:
        """Error values by linear interpolation, as a control does it, at (m, k) positions in `axes` order; (m, 6)."""
        shape = tuple(len(n) for n in reversed(self.nodes))
        table = self.values.reshape(*shape, 6)
        return interpolate(tuple(reversed(self.nodes)), table, positions[:, ::-1])


def describe_datum(solution: Solution) -> str:
    """The datum in words, for headers and reports."""
    datum = solution.datum
    lines = {"least_squares": "least-squares reference lines", "end_point": "end-point reference lines"}[datum.line]
    at = {a.letter: f"{a.letter} = {dict(datum.reference).get(a.letter, a.reference):g}" for a in solution.machine.axes}
    origin = ", ".join(at[a] for a in sorted(at) if a in LINEAR_AXES) + " mm"
    rotary = ", ".join(f"{at[a]}°" for a in sorted(at) if a not in LINEAR_AXES)
    means = f", angular positioning at {rotary}; other rotary error motions have zero mean" if rotary else ""
    return f"primary axis {datum.primary}, secondary axis {datum.secondary}; zero at {origin}{means}; {lines}"


def axis_nodes(axis: Axis, step: float | None, points: int, own: tuple[float, float] | None = None) -> np.ndarray:
    """Grid positions over an axis's travel, or its `own` range, both ends included: every `step`, else `points` of them."""
    low, high = axis.travel if own is None else own
    if step is None:
        return np.linspace(low, high, points)
    if not step > 0:
        raise InputError(f"grid: step = {step:g}; expected a distance > 0 in {axis.unit}")
    inner = low + step * np.arange(int(np.floor((high - low) / step + 1e-9)) + 1)
    return inner if high - inner[-1] < 1e-6 * step else np.append(inner, high)


def node_lines(
    solution: Solution,
    axes: tuple[str, ...],
    step: float | None,
    points: int | None,
    default: int,
    nodes: Mapping[str, np.ndarray] | None = None,
    ranges: Mapping[str, tuple[float, float]] | None = None,
) -> tuple[np.ndarray, ...]:
    """Node positions of each axis. Raises `InputError` for numbers that make no grid, or one of more than two million nodes."""
    if points is not None and points < 2:
        raise InputError(f"grid: points = {points}; expected at least 2 per axis")
    own, reach, count = nodes or {}, ranges or {}, points or default
    lines = tuple(
        np.asarray(own[a]) if a in own else axis_nodes(solution.machine.axis(a), step, count, reach.get(a))
        for a in axes
    )
    size = int(np.prod([len(n) for n in lines]))
    if size > LARGEST:
        raise InputError(f"grid: {size} points asked for, more than {LARGEST}; take a larger step")
    return lines


def grid_positions(nodes: tuple[np.ndarray, ...]) -> np.ndarray:
    """All nodes, shape (n, k), the first axis varying fastest."""
    mesh = np.meshgrid(*reversed(nodes), indexing="ij")
    return np.stack([m.ravel() for m in reversed(mesh)], axis=1)


def linear_grid(
    solution: Solution,
    *,
    step: float | None = None,
    points: int | None = None,
    tool: tuple[float, float, float] = (0.0, 0.0, 0.0),
    nodes: Mapping[str, np.ndarray] | None = None,
) -> Grid:
    """Spatial grid of the linear axes over the whole travel, for (rotated) tool vector `tool` [mm].

    On a machine with rotary axes: the errors of the linear axes alone, see `volid.rotary_grids`.

    `step` [mm], or `points` per axis (default 21), or `nodes` by axis letter. Raises `NotDeterminedError` when the data do not
    determine the translations for this tool vector, `InputError` for a step or a number of points that makes no grid. ISO/TR
    16907 7.5.
    """
    axes = tuple(a for a in LINEAR_AXES if a in solution.machine.letters)
    lines = node_lines(solution, axes, step, points, POINTS, nodes)
    positions = grid_positions(lines)
    size = len(positions)
    tools = np.broadcast_to(np.asarray(tool, dtype=float), (size, 3))
    letters = part_letters(solution.machine, None)
    found = evaluate_part(solution, letters, full_positions(solution.machine, axes, positions), tools, axes)
    _require_translations(solution, found.determined, tool)
    return Grid(
        type="L-VOL",
        axes=axes,
        nodes=lines,
        positions=positions,
        values=found.values,
        u=found.u,
        outside=found.outside,
        tool=(float(tool[0]), float(tool[1]), float(tool[2])),
        frame="machine",
        datum=describe_datum(solution),
        notes=_notes(solution, found),
    )


def _require_translations(solution: Solution, determined: np.ndarray, tool: tuple[float, float, float]) -> None:
    lost = [f"d{a}" for k, a in enumerate(LINEAR_AXES) if not determined[:, k].all()]
    if lost:
        where = ", ".join(f"{v:g}" for v in tool)
        reasons = " ".join(solution.statements)
        tools = np.concatenate([s.tool for s in solution.campaign.sets])
        measured = bool((np.abs(tools - np.asarray(tool)).max(axis=1) < SAME_POSITION[True]).any())
        advice = "Measure" if measured else "Ask for a measured tool vector (--tool), or measure"
        raise NotDeterminedError(
            f"grid: the data do not determine {', '.join(lost)} for tool vector ({where}) mm. {reasons} "
            f"{advice} what is missing."
        )


def _notes(solution: Solution, found: Deviations) -> tuple[str, ...]:
    determined, outside = found.determined, found.outside
    notes = part_notes(solution, part_letters(solution.machine, None))
    lost = [f"d{c}" for k, c in enumerate("ABC", start=3) if not determined[:, k].all()]
    if lost:
        notes.append(f"{', '.join(lost)} are not determined by the data and left blank; use no other tool vector")
    if found.rigid is not None and found.rigid.any():
        notes.append(
            "known for this tool vector up to a rigid motion of the workpiece frame; given with its own least-squares "
            "rigid motion over the travel taken out"
        )
    if solution.held_tool_rotation:
        notes.append(
            f"{', '.join(solution.held_tool_rotation)} are not determined and held at 0: rotations, and other tool vectors, "
            "up to a constant rotation of the tool"
        )
    if outside.any():
        notes.append(f"{int(outside.sum())} of {len(outside)} nodes lie outside the measured positions: extrapolated")
    if solution.adequacy.rejected:
        notes.append("MODEL REJECTED BY THE DATA: " + solution.adequacy.verdict)
    return tuple(notes)
