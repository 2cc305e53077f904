"""Error and compensation tables, one per function (ISO/TR 16907 Table 1), for controls that know single-axis functions.

A table holds the absolute error value of one function over one axis, for both approach directions. A control interpolates it
linearly and adds the compensation value, which is minus the error value. Translations move X, Y, Z. The rotations of L-ANG,
L-VOL, R-ANG and R-VOL act through the kinematic model of the control, with the lever arms of the current tool. R-POS moves the
rotary axis itself.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from volid.compensation.alignment import alignment_notes
from volid.compensation.base import Base, condensed
from volid.compensation.effects import axis_errors, tool_frame_errors
from volid.compensation.grids.interpolation import period_of
from volid.compensation.tables.axes import judged_axes, polygon_knots, reach
from volid.compensation.tables.error_table import ITSELF, MODEL, ErrorTable
from volid.compensation.tables.sampling import DENSE, Sampling, choose_nodes, interpolation_error
from volid.compensation.types import LINEAR_EFFECTS, ROTARY_EFFECTS, TABLES, CompensationType
from volid.exceptions import InputError, NotDeterminedError
from volid.fitting.prediction.spread import linear_uncertainty
from volid.fitting.solution import Solution
from volid.model.error_functions import describe_datum
from volid.model.iso230 import DIRECTIONS, SPINDLE, parse
from volid.model.kinematics import ROWS
from volid.model.machine import Axis, Machine
from volid.model.requests import ask_metres, ask_step

NEGLIGIBLE = 1e-9  # mm at the offset: a function that is nowhere larger needs no table
FEW = 20  # positions at which a function that is 0 is looked at for whether the data determine it


@dataclass(frozen=True, eq=False)
class TableRequest:
    """What is asked of tables: types, base and sampling; `zero`, `approach` and `ranges`, as of `error_tables`."""

    types: Sequence[CompensationType]
    base: Base
    sampling: Sampling
    zero: Mapping[str, float]
    ranges: Mapping[str, tuple[float, float]]
    approach: float = 0.0


def error_tables(
    solution: Solution,
    types: Sequence[CompensationType],
    base: Base,
    sampling: Sampling | None = None,
    zero: Mapping[str, float] | None = None,
    ranges: Mapping[str, tuple[float, float]] | None = None,
    approach: float = 0.0,
) -> tuple[ErrorTable, ...]:
    """Tables of every function that the `types` correct by tables, axis by axis.

    Args:
        solution: A solution, as `volid.fit` makes it.
        types: Types of ISO/TR 16907, values of `volid.COMPENSATION_TYPES`.
        base: What the types are based on, as `volid.compensation_base` makes it.
        sampling: How each table is sampled; by default at 21 points, or at the knots of a polygon.
        zero: Position by axis letter where the values of its tables are zero, instead of at the crossing of the lines [mm or °].
        ranges: Lowest and highest position by axis letter [mm or °]; the travel by default.
        approach: Direction in which the position of `zero` is approached, +1 or -1; 0 for the mean of both.

    Raises:
        InputError: a type has no tables, or a limit on the points is too small for the stated error.
        NotDeterminedError: the data do not determine a function.

    Source: ISO/TR 16907 8.2, Table 1.

    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/five_axis_rtest/campaign.toml"))
    >>> base = volid.compensation_base(solution, (0.0, 0.0, -150.0))
    >>> tables = volid.error_tables(solution, [volid.COMPENSATION_TYPES["R-POS"]], base)
    >>> [(t.function, t.applied) for t in tables]
    [('ECC', 'the axis itself'), ('EAA', 'the axis itself')]
    """
    for t in types:
        if TABLES not in t.forms:
            raise InputError(f"{t.name} has no tables of single functions; it is a grid")
    _check_zero(solution.campaign.machine, zero or {})
    _ask_step(solution, types, sampling, ranges or {})
    solution = solution.without_waves()
    request = TableRequest(
        types, base, Sampling() if sampling is None else sampling, zero or {}, ranges or {}, approach
    )
    tables: list[ErrorTable] = []
    for axis in solution.machine.axes:
        chosen = _types_of(axis, types)
        if chosen:
            tables += _AxisTables(solution, axis, chosen, request).tables()
    return tuple(tables + _tool_frame(solution, request))


def _check_zero(machine: Machine, zero: Mapping[str, float]) -> None:
    """Raises `InputError` for positions beyond the travels, or in metres."""
    ask_metres(machine, zero, "`zero`")
    for letter, value in zero.items():
        low, high = machine.axis(letter).travel
        if not low <= value <= high:
            raise InputError(f"`zero={letter}={value:g}` lies outside the travel; expected {low:g} … {high:g}")


def _ask_step(
    solution: Solution,
    types: Sequence[CompensationType],
    sampling: Sampling | None,
    ranges: Mapping[str, tuple[float, float]],
) -> None:
    """Raises `InputError` for a step longer than the ranges of all axes that have tables."""
    if sampling is not None and sampling.step is not None:
        axes = [axis for axis in solution.machine.axes if _types_of(axis, types)]
        ask_step(sampling.step, {a.letter: ranges.get(a.letter, a.travel) for a in axes})


def _types_of(axis: Axis, types: Sequence[CompensationType]) -> list[CompensationType]:
    group = LINEAR_EFFECTS if axis.is_linear else ROTARY_EFFECTS
    return [t for t in types if set(t.effects) & set(group)]


@dataclass(frozen=True, eq=False)
class _Curve:
    """One component on the dense sampling: `values` of both directions (m, 2), `scale`: what makes them mm."""

    types: Sequence[CompensationType]
    component: int
    values: np.ndarray
    scale: float
    itself: bool


class _AxisTables:
    """The tables of one axis; the linear maps of its error values serve all six components."""

    def __init__(
        self, solution: Solution, axis: Axis, chosen: Sequence[CompensationType], request: TableRequest
    ) -> None:
        self.solution, self.axis, self.chosen, self.request = solution, axis, chosen, request
        ends = request.ranges.get(axis.letter, axis.travel)
        self.knots = polygon_knots(solution, axis, ends)
        dense = np.linspace(*ends, DENSE)
        self.dense = dense if self.knots is None else np.union1d(dense, self.knots)
        self._known: dict[tuple[str, bytes, float], np.ndarray] = {}

    def tables(self) -> list[ErrorTable]:
        """One table for each function that at least one type moves; R-POS, which the axis itself corrects, has its own."""
        small, plain = condensed(self.solution, self.request.base)
        ways = [self._values(small, plain, w) for w in (1.0, -1.0)]  # (types, m, 6) each
        offset = self.request.sampling.offset
        arm = reach(self.solution.machine, self.axis, self.request.base) if offset is None else offset
        found: list[_Curve] = []
        for itself in (False, True):
            group = [k for k, t in enumerate(self.chosen) if t.by_axis_itself == itself]
            for component in range(ROWS):
                scale = arm if component >= 3 else 1.0
                curves = np.stack([way[:, :, component] for way in ways])  # (ways, types, m)
                active = [k for k in group if np.abs(scale * curves[:, k]).max() > NEGLIGIBLE]
                self._require_known([self.chosen[k] for k in group if k not in active], component)
                if active:
                    types = [self.chosen[k] for k in active]
                    found.append(_Curve(types, component, curves[:, active].sum(axis=1).T, scale, itself))
        return [self._table(c, self._nodes(found if self.request.sampling.together else [c])) for c in found]

    def _nodes(self, curves: Sequence[_Curve]) -> np.ndarray:
        """Points of the tables of some functions together."""
        name = ", ".join(f"E{DIRECTIONS[c.component]}{self.axis.letter}" for c in curves)
        values = np.hstack([c.scale * c.values for c in curves])
        return choose_nodes(name, self.dense, values, self.request.sampling, self.knots)

    def _require_known(self, types: Sequence[CompensationType], component: int) -> None:
        """A component without a table is nothing that the data leave open, which would stand at 0 as well.

        Raises `NotDeterminedError`.
        """
        if not types or self.solution.fully_determined:
            return
        nodes = self.dense[:: max(len(self.dense) // FEW, 1)]
        for way in (1.0, -1.0):
            rows = self._rows(types, nodes, way, component)
            _require_determined(self.solution, f"E{DIRECTIONS[component]}{self.axis.letter}", rows)

    def _values(self, solution: Solution, base: Base, way: float) -> np.ndarray:
        """Error values of each type along the axis approached in one direction, (types, m, 6)."""
        ways = np.full(len(self.dense), way)
        found = [axis_errors(solution, self.axis, t.effects, base, self.dense, ways) for t in self.chosen]
        return np.stack(found).sum(axis=3)

    def _rows(self, types: Sequence[CompensationType], nodes: np.ndarray, way: float, component: int) -> np.ndarray:
        """One component of the types' sum as linear map of θ, (m, n)."""
        total = np.zeros((len(nodes), self.solution.model.n_parameters))
        for t in types:
            key = (t.name, nodes.tobytes(), way)
            if key not in self._known:
                ways = np.full(len(nodes), way)
                self._known[key] = axis_errors(self.solution, self.axis, t.effects, self.request.base, nodes, ways)
            total += self._known[key][:, component]
        return total

    def _table(self, curve: _Curve, nodes: np.ndarray) -> ErrorTable:
        """The table of one component."""
        solution, axis, base = self.solution, self.axis, self.request.base
        types, component = curve.types, curve.component
        name = f"E{DIRECTIONS[component]}{axis.letter}"
        both = [self._rows(types, nodes, way, component) for way in (1.0, -1.0)]
        zero = self.request.zero.get(axis.letter)
        crossing = base.at[solution.machine.index(axis.letter)] if zero is None else zero
        if zero is not None:
            shift = self._rows(types, np.array([zero]), self.request.approach, component)
            both = [rows - shift for rows in both]
        for rows in both:
            _require_determined(solution, name, rows)
        theta, covariance = np.asarray(solution.parameters), solution.parameter_covariance
        scatter = solution.scatter_of(name)
        positions = np.tile(base.at, (len(nodes), 1))
        positions[:, solution.machine.index(axis.letter)] = nodes
        return ErrorTable(
            type=" + ".join(t.name for t in types),
            function=name,
            positions=nodes,
            forward=both[0] @ theta,
            reverse=both[1] @ theta,
            u=np.hypot(np.stack([linear_uncertainty(rows, covariance) for rows in both], axis=1), scatter),
            outside=solution.outside(positions, judged_axes(solution, axis)),
            applied=ITSELF if curve.itself else MODEL,
            interpolation=float(interpolation_error(self.dense, curve.values, nodes).max()),
            basis=_basis(solution.machine, axis, base),
            zero=f"{axis.letter} = {crossing:g} {axis.unit}"
            + _approached(0.0 if zero is None else self.request.approach),
            datum=describe_datum(solution.machine, solution.datum),
            period=period_of(axis, nodes),
            notes=(*alignment_notes(solution, base, axis.letter), *_notes(solution, axis)),
        )


def _require_determined(solution: Solution, name: str, rows: np.ndarray) -> None:
    if solution.is_not_determined(rows).any():
        raise NotDeterminedError(
            f"tables: the data do not determine {name} on this line. {' '.join(solution.statements)} Measure what is missing, "
            "or choose another line (`at`), tool vector (`tool`) or type."
        )


def _approached(direction: float) -> str:
    return f", approached in {'+' if direction > 0 else '-'}" if direction else ""


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
            f"{', '.join(crossed)}: depends on a second axis too; held at the line. best_rigid finds what is best overall"
        )
    if solution.adequacy.rejected:
        notes.append("MODEL REJECTED BY THE DATA: " + solution.adequacy.verdict)
    return tuple(notes)


def _tool_frame(solution: Solution, request: TableRequest) -> list[ErrorTable]:
    """Constants of the tool frame, one row each."""
    theta, tool = np.asarray(solution.parameters), ", ".join(f"{v:g}" for v in request.base.tool)
    rows = [
        (t.name, tool_frame_errors(solution, t.effects, request.base)) for t in request.types if t.needs_tool
    ]  # (6, n) of each type
    tables = []
    for component, direction in enumerate(DIRECTIONS):
        used = {name: errors[component] for name, errors in rows if np.any(errors[component])}
        if not used:
            continue
        total, function = np.sum(list(used.values()), axis=0)[None], f"E{direction}0{SPINDLE}"
        _require_determined(solution, function, total)
        value, u = total @ theta, linear_uncertainty(total, solution.parameter_covariance)
        tables.append(
            ErrorTable(
                type=" + ".join(used),
                function=function,
                positions=np.zeros(1),
                forward=value,
                reverse=value.copy(),
                u=np.full((1, 2), u[0]),
                outside=np.zeros(1, dtype=bool),
                applied=MODEL,
                interpolation=0.0,
                basis={"tool vector": f"{tool} mm"},
                zero="a constant",
                datum=describe_datum(solution.machine, solution.datum),
            )
        )
    return tables
