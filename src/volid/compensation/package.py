"""A compensation: the tables and grids of several types together, as they are given to one control."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from volid.compensation.base import Base
from volid.compensation.control import Control
from volid.compensation.grids.builder import build_grids
from volid.compensation.grids.grid import AnyGrid
from volid.compensation.grids.request import GridRequest, Rule
from volid.compensation.tables.axis_table import AxisTable
from volid.compensation.tables.by_function import error_tables
from volid.compensation.tables.error_table import ErrorTable
from volid.compensation.tables.sampling import Sampling
from volid.compensation.types import GRID, TABLES, TYPES, CompensationType, select
from volid.exceptions import InputError
from volid.fitting.solution import Solution
from volid.model.machine import Machine


@dataclass(frozen=True, eq=False)
class Compensation:
    """Tables and grids of the types `names`, before or after they were files; see `compensate`.

    Args:
        names: Names of the types of ISO/TR 16907 that it contains.
        tables: Tables of single error functions.
        grids: Spatial grids, each for the axes of one side.
        axis_tables: What single axes are moved by, as controls without a kinematic model hold it.

    >>> import volid
    >>> machine = volid.load_machine("models/wYXbZt_vertical.toml")
    >>> nothing = volid.Compensation((), (), ())
    >>> nothing.control(machine, clamped=("X",)).clamped
    ('X',)
    """

    names: tuple[str, ...]
    tables: tuple[ErrorTable, ...]
    grids: tuple[AnyGrid, ...]
    axis_tables: tuple[AxisTable, ...] = ()

    def control(self, machine: Machine, **options: Any) -> Control:
        """A simulated control of `machine` with this compensation; `options`: those of `Control`, such as tool or increment."""
        return Control(machine, self.tables, self.grids, axis_tables=self.axis_tables, **options)


def in_full(types: Sequence[CompensationType]) -> tuple[CompensationType, ...]:
    """The types with orientation in one place: beside a type that turns rotary axes, L-VOL becomes L-VOL+, R-VOL R-VOL+."""
    if not any(t.turns for t in types):
        return tuple(types)
    raised = {"L-VOL": "L-VOL+", "R-VOL": "R-VOL+"}
    names = [raised.get(t.name, t.name) for t in types]
    kept = [n for n in names if n != "FOR" or not {"L-VOL+", "R-VOL+"} & set(names)]
    return tuple(TYPES[n] for n in dict.fromkeys(kept))


@dataclass(frozen=True, eq=False)
class CompensationRequest:
    """What is asked of a compensation, whatever its types; the fields are the keywords of `compensate`."""

    base: Base
    tables: Sampling | None = None
    grids: Sampling | None = None
    points: int | None = None
    form: str | None = None
    rule: Rule | None = None
    reference_point: Sequence[float] | None = None
    uncertainty: bool = True
    ranges: Mapping[str, tuple[float, float]] | None = None
    zero: Mapping[str, float] | None = None

    def form_of(self, kind: CompensationType) -> str:
        """The form of a type: the one asked for where the type has it, else its first one."""
        return self.form if self.form is not None and self.form in kind.forms else kind.forms[0]

    def of_grids(self, kind: CompensationType) -> GridRequest:
        """What is asked of the grids of one type."""
        return GridRequest(
            type=kind,
            base=self.base,
            sampling=Sampling() if self.grids is None else self.grids,
            points=self.points,
            ranges=self.ranges,
            reference_point=self.reference_point,
            rule=self.rule if kind.is_chosen else None,
            zero=self.zero if kind.is_linear else None,
            uncertainty=self.uncertainty,
        )


def compensate(
    solution: Solution,
    names: Sequence[str],
    base: Base,
    *,
    tables: Sampling | None = None,
    grids: Sampling | None = None,
    points: int | None = None,
    form: str | None = None,
    rule: Rule | None = None,
    reference_point: Sequence[float] | None = None,
    uncertainty: bool = True,
    ranges: Mapping[str, tuple[float, float]] | None = None,
    zero: Mapping[str, float] | None = None,
) -> Compensation:
    """Tables and grids of several types, each in its first form, or in the `form` asked for where it has it.

    Args:
        solution: A solution, as `volid.fit` makes it.
        names: Names of types of ISO/TR 16907, from `volid.COMPENSATION_TYPES`.
        base: What the types are based on, as `volid.compensation_base` makes it.
        tables: How the tables are sampled.
        grids: How the grids are sampled.
        points: Number of points per axis of a grid, where `grids` does not state it.
        form: The preferred form, "tables" or "grid"; a type that does not have it takes its own.
        rule: Function that computes what L-SPEC and R-SPEC correct, as `GridRequest` describes it.
        reference_point: Point for which the grids of rotary axes hold the translations, (3,) [mm].
        uncertainty: Whether the grids contain standard uncertainties; the error values are the same without them.
        ranges: Lowest and highest position of tables and grids by axis letter [mm or °]; the travel by default.
        zero: Position by axis letter where tables and the translations of linear grids are 0 [mm or °].

    Raises:
        InputError: types do not go together, or the machine cannot have one of them, or an L-SPEC or R-SPEC has neither
            `base.functions` nor `rule`.
        NotDeterminedError: the data do not determine what a type contains.

    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/five_axis_rtest/campaign.toml"))
    >>> base = volid.compensation_base(solution, (0.0, 0.0, -150.0))
    >>> made = volid.compensate(solution, ["R-POR"], base, points=5, uncertainty=False)
    >>> made.names, [(grid.type, grid.side) for grid in made.grids]
    (('R-POR',), [('R-POR', 'table')])
    """
    request = CompensationRequest(base, tables, grids, points, form, rule, reference_point, uncertainty, ranges, zero)
    return compensation_of(solution, names, request)


def compensation_of(solution: Solution, names: Sequence[str], request: CompensationRequest) -> Compensation:
    """`compensate` with everything that is asked for in one object."""
    types = in_full(select(names, solution.machine))
    for t in types:
        if t.is_chosen and request.rule is None and not request.base.functions:
            raise InputError(f"{t.name} needs what it corrects: `functions` of the base, such as EXX,EAX, or a `rule`")
    in_tables = [t for t in types if request.form_of(t) == TABLES]
    given = (request.base, request.tables, request.zero, request.ranges)
    in_lines = error_tables(solution, in_tables, *given) if in_tables else ()
    found: list[AnyGrid] = []
    for t in types:
        if request.form_of(t) == GRID:
            found += build_grids(solution, request.of_grids(t))
    return Compensation(tuple(t.name for t in types), in_lines, _once(found))


def _once(grids: Sequence[AnyGrid]) -> tuple[AnyGrid, ...]:
    """Each side's grid once: L-VOL+ and R-VOL+ both bring FOR grids, which the + grids already contain when both are there."""
    plus = {g.side for g in grids if g.type in ("L-VOL+", "R-VOL+")}
    kept: list[AnyGrid] = []
    for g in grids:
        again = TYPES[g.type].only_turns and (
            g.side in plus or any(k.type == g.type and k.side == g.side for k in kept)
        )
        if not again:
            kept.append(g)
    return tuple(kept)
