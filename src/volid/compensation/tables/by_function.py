"""Error and compensation tables, one per function (ISO/TR 16907 Table 1), for controls that know single-axis functions.

A table holds the error value of one function over one axis, absolute, for both approach directions. A control adds the
compensation value, minus it, by linear interpolation: translations move X, Y, Z; the rotations of L-ANG, L-VOL, R-ANG, R-VOL
go through its kinematic model (lever arms of the current tool); R-POS moves the rotary axis itself.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from volid.compensation.alignment import alignment_notes
from volid.compensation.base import Base, condensed
from volid.compensation.effects import axis_errors, tool_frame_errors
from volid.compensation.grids.interpolation import period_of
from volid.compensation.grids.linear import describe_datum
from volid.compensation.tables.axes import judged_axes, polygon_knots, reach
from volid.compensation.tables.error_table import ITSELF, MODEL, ErrorTable
from volid.compensation.tables.sampling import DENSE, Sampling, choose_nodes, interpolation_error
from volid.compensation.types import LINEAR_EFFECTS, ROTARY_EFFECTS, TABLES, CompensationType
from volid.exceptions import InputError, NotDeterminedError
from volid.fitting.prediction.spread import linear_uncertainty
from volid.fitting.solution import Solution
from volid.model.iso230 import DIRECTIONS, SPINDLE, parse
from volid.model.machine import Axis, Machine

NEGLIGIBLE = 1e-9  # mm at the offset: a function that is nowhere larger needs no table


def error_tables(
    solution: Solution,
    types: Sequence[CompensationType],
    base: Base,
    sampling: Sampling | None = None,
    zero: Mapping[str, float] | None = None,
    ranges: Mapping[str, tuple[float, float]] | None = None,
) -> tuple[ErrorTable, ...]:
    """Tables of every function that the `types` correct by tables, axis by axis.

    `zero`: by axis letter, where the values of its tables are to be zero (mean of both directions) instead of at the lines'
    crossing. `ranges`: lowest and highest position by axis letter, default the travel [mm or °]. Raises `InputError` for a
    type without tables or a limit too small for the stated error; `NotDeterminedError` when the data do not determine a
    function. ISO/TR 16907 8.2, Table 1.
    """
    for t in types:
        if TABLES not in t.forms:
            raise InputError(
                f"--type {t.name} has no tables of single functions; it is a grid: volid grid --type {t.name}"
            )
    for letter in zero or {}:
        solution.machine.index(letter)
    sampling = Sampling() if sampling is None else sampling
    tables: list[ErrorTable] = []
    covariance = solution.parameter_covariance
    for axis in solution.machine.axes:
        own = (ranges or {}).get(axis.letter, axis.travel)
        tables += _axis_tables(solution, axis, types, base, sampling, (zero or {}).get(axis.letter), covariance, own)
    return tuple(tables + _tool_frame(solution, types, base, covariance))


def _own(axis: Axis, types: Sequence[CompensationType]) -> list[CompensationType]:
    group = LINEAR_EFFECTS if axis.is_linear else ROTARY_EFFECTS
    return [t for t in types if set(t.effects) & set(group)]


def _axis_tables(
    solution: Solution,
    axis: Axis,
    types: Sequence[CompensationType],
    base: Base,
    sampling: Sampling,
    zero: float | None,
    covariance: np.ndarray,
    own: tuple[float, float],
) -> list[ErrorTable]:
    chosen = _own(axis, types)
    if not chosen:
        return []
    knots = polygon_knots(solution, axis, own)
    dense = np.linspace(*own, DENSE)
    dense = dense if knots is None else np.union1d(dense, knots)
    small, plain = condensed(solution, base)
    ways = [axis_values(small, axis, chosen, plain, dense, w).sum(axis=3) for w in (1.0, -1.0)]  # (types, m, 6)
    arm = reach(solution.machine, axis, base) if sampling.offset is None else sampling.offset
    tables = []
    rows = _Rows(solution, axis, base)
    for itself in (False, True):
        group = [k for k, t in enumerate(chosen) if (t.name == "R-POS") == itself]
        for component, direction in enumerate(DIRECTIONS):
            scale = arm if component >= 3 else 1.0
            held = [k for k in group if np.abs(scale * np.stack([w[k, :, component] for w in ways])).max() > NEGLIGIBLE]
            if held:
                name = f"E{direction}{axis.letter}"
                curve = np.stack([w[held, :, component].sum(axis=0) for w in ways], axis=1)
                nodes = choose_nodes(name, dense, scale * curve, sampling, knots)
                table = _table(rows, [chosen[k] for k in held], component, nodes, zero, covariance)
                off = float(interpolation_error(dense, curve, nodes).max())
                tables.append(replace(table, interpolation=off, applied=ITSELF if itself else MODEL))
    return tables


def axis_values(
    solution: Solution, axis: Axis, types: Sequence[CompensationType], base: Base, own: np.ndarray, direction: float
) -> np.ndarray:
    """Error values of each type along the axis as linear map of θ, (types, m, 6, n)."""
    ways = np.full(len(own), direction)
    return np.stack([axis_errors(solution, axis, t.effects, base, own, ways) for t in types])


@dataclass(frozen=True, eq=False)
class _Rows:
    """Linear maps of one axis's tables, kept for its six components."""

    solution: Solution
    axis: Axis
    base: Base
    known: dict[tuple[str, bytes, float], np.ndarray] = field(default_factory=dict)

    def __call__(self, types: Sequence[CompensationType], nodes: np.ndarray, way: float, component: int) -> np.ndarray:
        """Rows (m, n) of the types' sum."""
        total = np.zeros((len(nodes), self.solution.model.n_parameters))
        for t in types:
            key = (t.name, nodes.tobytes(), way)
            if key not in self.known:
                self.known[key] = axis_values(self.solution, self.axis, [t], self.base, nodes, way)[0]
            total += self.known[key][:, component]
        return total


def _table(
    rows: _Rows,
    types: Sequence[CompensationType],
    component: int,
    nodes: np.ndarray,
    zero: float | None,
    covariance: np.ndarray,
) -> ErrorTable:
    solution, axis, base = rows.solution, rows.axis, rows.base
    name = f"E{DIRECTIONS[component]}{axis.letter}"
    both = [rows(types, nodes, way, component) for way in (1.0, -1.0)]
    if zero is not None:
        origin = [rows(types, np.array([zero]), way, component) for way in (1.0, -1.0)]
        both = [own - 0.5 * (origin[0] + origin[1]) for own in both]
    _require_determined(solution, name, np.concatenate(both))
    theta = np.asarray(solution.parameters)
    positions = np.tile(base.at, (len(nodes), 1))
    positions[:, solution.machine.index(axis.letter)] = nodes
    crossing = base.at[solution.machine.index(axis.letter)] if zero is None else zero
    return ErrorTable(
        type=" + ".join(t.name for t in types),
        function=name,
        positions=nodes,
        forward=both[0] @ theta,
        reverse=both[1] @ theta,
        u=np.stack([linear_uncertainty(own, covariance) for own in both], axis=1),
        outside=solution.outside(positions, judged_axes(solution, axis)),
        applied=MODEL,
        interpolation=0.0,
        basis=_basis(solution.machine, axis, base),
        zero=f"{axis.letter} = {crossing:g} {axis.unit}",
        datum=describe_datum(solution),
        period=period_of(axis, nodes),
        notes=(*alignment_notes(solution, base, axis.letter), *_notes(solution, axis)),
    )


def _require_determined(solution: Solution, name: str, rows: np.ndarray) -> None:
    if solution.is_not_determined(rows).any():
        raise NotDeterminedError(
            f"tables: the data do not determine {name} on this line. {' '.join(solution.statements)} Measure what is missing, "
            "or choose another line (--at), tool vector (--tool) or type."
        )


def _basis(machine: Machine, axis: Axis, base: Base) -> dict[str, str]:
    at = ", ".join(
        f"{a.letter} = {v:g} {a.unit}" for a, v in zip(machine.axes, base.at, strict=True) if a.letter != axis.letter
    )
    lines = {"line": at, "tool vector": f"{', '.join(f'{v:g}' for v in base.tool)} mm"}
    if not axis.is_linear and axis.primed:
        lines["elevation"] = f"{base.elevation:g} mm above the point of axis {axis.letter}, along its line"
    return lines


def _notes(solution: Solution, axis: Axis) -> tuple[str, ...]:
    notes = []
    crossed = [f.name for f in solution.model.functions if f.part == "mean" and len(f.splines) > 1]
    crossed = [name for name in crossed if parse(name).axis == axis.letter]
    if crossed:
        notes.append(
            f"{', '.join(crossed)}: depends on a second axis too; held at the line. --rigid finds what is best overall"
        )
    if solution.adequacy.rejected:
        notes.append("MODEL REJECTED BY THE DATA: " + solution.adequacy.verdict)
    return tuple(notes)


def _tool_frame(
    solution: Solution, types: Sequence[CompensationType], base: Base, covariance: np.ndarray
) -> list[ErrorTable]:
    """Constants of the tool frame, one row each."""
    theta = np.asarray(solution.parameters)
    holding = [t for t in types if t.needs_tool]
    tables = []
    for component, direction in enumerate(DIRECTIONS):
        rows = [tool_frame_errors(solution, t.effects, base)[component] for t in holding]
        used = [(t, row) for t, row in zip(holding, rows, strict=True) if np.any(row)]
        if used:
            total = sum(row for _, row in used)[None]  # type: ignore[index]
            name = f"E{direction}0{SPINDLE}"
            _require_determined(solution, name, total)
            value, u = total @ theta, np.full((1, 2), linear_uncertainty(total, covariance)[0])
            types_of = " + ".join(t.name for t, _ in used)
            basis = {"tool vector": f"{', '.join(f'{v:g}' for v in base.tool)} mm"}
            zero, at, inside = "a constant", np.zeros(1), np.zeros(1, dtype=bool)
            datum = describe_datum(solution)
            tables.append(
                ErrorTable(types_of, name, at, value, value.copy(), u, inside, MODEL, 0.0, basis, zero, datum)
            )
    return tables
