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
        names: types of ISO/TR 16907.
        tables: of single functions.
        grids: spatial grids, each of one side.

    >>> import volid
    >>> machine = volid.load_machine("models/wYXbZt_vertical.toml")
    >>> nothing = volid.Compensation((), (), ())
    >>> nothing.control(machine, clamped=("X",)).clamped
    ('X',)
    """

    names: tuple[str, ...]
    tables: tuple[ErrorTable, ...]
    grids: tuple[AnyGrid, ...]

    def control(self, machine: Machine, **options: Any) -> Control:
        """A simulated control of `machine` with this compensation; `options`: those of `Control`, such as tool or increment."""
        return Control(machine, self.tables, self.grids, **options)


def in_full(types: Sequence[CompensationType]) -> tuple[CompensationType, ...]:
    """The types with orientation in one place: beside a type that turns rotary axes, L-VOL becomes L-VOL+, R-VOL R-VOL+."""
    if not any(t.turns for t in types):
        return tuple(types)
    raised = {"L-VOL": "L-VOL+", "R-VOL": "R-VOL+"}
    names = [raised.get(t.name, t.name) for t in types]
    kept = [n for n in names if n != "FOR" or not {"L-VOL+", "R-VOL+"} & set(names)]
    return tuple(TYPES[n] for n in dict.fromkeys(kept))


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
        solution: of `fit`.
        names: types of ISO/TR 16907, see `volid.COMPENSATION_TYPES`.
        base: on what they are based, see `volid.compensation_base`.
        tables: sampling of tables.
        grids: sampling of grids.
        points: per axis of a grid, where its sampling leaves it open.
        form: "tables" or "grid".
        rule: of L-SPEC and R-SPEC, see `GridRequest`.
        reference_point: of the grids of rotary axes, (3,) [mm].
        uncertainty: of grids; False changes no value.
        ranges: lowest and highest position of tables and grids by axis letter [mm or °], default the travel.
        zero: where tables and the translations of linear grids are 0, by axis letter [mm or °].

    Raises `InputError` for types that do not go together or that the machine cannot have, or an L-SPEC or R-SPEC without
    `base.functions` or `rule`; `NotDeterminedError` when the data do not determine what a type holds.

    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/five_axis_rtest/campaign.toml"))
    >>> base = volid.compensation_base(solution, (0.0, 0.0, -150.0))
    >>> made = volid.compensate(solution, ["R-POR"], base, points=5, uncertainty=False)
    >>> made.names, [(grid.type, grid.side) for grid in made.grids]
    (('R-POR',), [('R-POR', 'table')])
    """
    types = in_full(select(names, solution.machine))
    for t in types:
        if t.is_chosen and rule is None and not base.functions:
            raise InputError(f"{t.name} needs what it corrects: `functions` of the base, such as EXX,EAX, or a `rule`")
    form_of = {t.name: form if form in t.forms else t.forms[0] for t in types}
    in_tables = [t for t in types if form_of[t.name] == TABLES]
    in_lines = error_tables(solution, in_tables, base, tables, zero, ranges) if in_tables else ()
    found: list[AnyGrid] = []
    for t in (t for t in types if form_of[t.name] == GRID):
        request = GridRequest(
            type=t,
            base=base,
            sampling=Sampling() if grids is None else grids,
            points=points,
            ranges=ranges,
            reference_point=reference_point,
            rule=rule if t.is_chosen else None,
            zero=zero if t.is_linear else None,
            uncertainty=uncertainty,
        )
        found += build_grids(solution, request)
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
