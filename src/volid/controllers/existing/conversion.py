"""What one control holds, in the format of another one, where that is exact (ISO/TR 16907 9.2, 9.3).

What the other control can hold too goes in as it is; else it takes another form, where `volid.controllers.existing.forms`
has an exact one. Whatever was done, the axes must move as before: the files that were written are read back, and both
controls are asked for their commands at all positions of the tables, between them, in both directions. More than the quantum
apart is refused.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from typing import Any, NamedTuple

import numpy as np

from volid.compensation.grids.grid import Grid
from volid.compensation.on_top import add_compensations, with_opposite
from volid.compensation.package import Compensation
from volid.compensation.types import GRID
from volid.controllers import Controller
from volid.controllers.base import Declaration, Job, options_of, sign_of
from volid.controllers.choice import instead_of
from volid.controllers.existing.contents import types_of
from volid.controllers.existing.forms import BY_DIRECTION, in_form, no_sum, one_direction
from volid.controllers.existing.reading import ExistingCompensation, control_called
from volid.controllers.existing.sameness import (
    EXACT,
    KINDS,
    in_words,
    largest_change,
    refuse_change,
    rounding_of,
    shift_notes,
)
from volid.controllers.exported import Export, write
from volid.exceptions import InputError
from volid.model.machine import Machine

ROUNDINGS = 4  # of the sum, the new and the old values, one for each of two tables of an axis
SECOND_ORDER = 1e-3  # of the correction: where a control multiplies, as by a matrix, not adds
BESIDE = 100.0 * np.eye(3)  # mm, of other tools
# types that hold what is said at the left: a control that carries one of them can carry it
_CONTAINED = {
    "L-POS": ("L-POS", "L-VOL", "L-VOL+"),
    "L-STR": ("L-STR", "L-SQU", "L-VOL", "L-VOL+"),
    "L-VOL": ("L-VOL", "L-ANG", "L-VOL+"),
    "R-POS": ("R-POS", "R-VOL", "R-VOL+"),
    "R-RAX": ("R-RAX", "R-VOL", "R-VOL+"),
}


@dataclass(frozen=True, eq=False)
class Target:
    """The control into whose format something is converted.

    Args:
        cnc: Its name, one of `volid.CONTROLS`.
        sign: "error" or "compensation" where public sources leave it open.
        options: Its options.
        at: Positions of the lines by axis letter, where rotations act through lever arms [mm or °]; by default the references.
        tool: Tool vector of those lever arms, (3,) [mm]; by default that of the grids, else none, (0, 0, 0).
        mean: Whether the mean of both directions is taken where the control has none, instead of a refusal.
    """

    cnc: str
    sign: str | None = None
    options: Mapping[str, Any] | None = None
    at: Mapping[str, float] | None = None
    tool: tuple[float, float, float] | None = None
    mean: bool = False


def convert(made: Compensation, machine: Machine, target: Target) -> Export:
    """A compensation as files of another control.

    Args:
        made: What a control holds, such as `volid.load_compensation` reads it.
        machine: The machine whose axes it moves.
        target: The other control.

    Raises:
        InputError: the other control cannot hold it, or not without a change; the message says what would change and by how much.

    >>> import volid
    >>> x, e = np.array([0.0, 500.0, 1000.0]), np.array([0.0, 0.010, -0.004])
    >>> machine = volid.load_machine("models/wYXbZt_vertical.toml")
    >>> old = Compensation((), (), (), (volid.AxisTable("X", "X", x, e, e - 0.003),))
    >>> [file.name for file in convert(old, machine, Target("linuxcnc")).written.files][0]
    'x.comp'
    """
    chosen = control_called(target.cnc)
    given = one_direction(made) if target.mean else made
    at = machine.order(**{**{a.letter: a.reference for a in machine.axes}, **(target.at or {})})
    tool = np.asarray(_tool_of(made) if target.tool is None else target.tool, dtype=float)
    options, sign = options_of(chosen.declaration, target.options or {}), sign_of(chosen.declaration, target.sign)
    try:
        found = fitted(chosen, Job(machine, given, at, tool, sign, options))
    except InputError as error:
        if BY_DIRECTION in str(error):
            raise InputError(f"{error}. `mean=True` takes the mean of both directions") from None
        raise
    return replace(found, notes=(*found.notes, *_for_one_tool(given, found, tool)))


def fitted(chosen: Controller, job: Job) -> Export:
    """The files of a job whose compensation is taken into the form that the control holds, without a change.

    Raises `InputError` where the control cannot hold it so.
    """
    before, declared = job.compensation, chosen.declared_for(job.machine, job.options)
    made = in_form(before, job.machine, declared, job.tool)
    types = carried(made, job.machine, declared)
    made = replace(made, names=types)
    try:  # a control of tables may hold a grid over two axes all the same
        found = write(chosen, replace(job, compensation=made), types)
        refuse_change(before, found, declared, job.tool)
    except InputError:
        if made.grids and GRID not in declared.carries.values():
            raise no_sum(made, declared) from None
        raise
    return replace(found, notes=(*found.notes, *shift_notes(before, found, declared, job.tool)))


class Sum(NamedTuple):
    """A job on top of existing files, those files in the control's form, and what is to be said of the sum."""

    job: Job
    existing: Compensation | None = None
    notes: tuple[str, ...] = ()


def on_top(chosen: Controller, job: Job, existing: Sequence[ExistingCompensation]) -> Sum:
    """The job with what the control holds already (ISO/TR 16907 10.5). Raises `InputError` where it cannot hold that as it is."""
    if not existing:
        return Sum(job)
    declared = chosen.declared_for(job.machine, job.options)
    old = reduce(add_compensations, (e.compensation for e in existing))
    held = fitted(chosen, replace(job, compensation=old)).job.compensation
    if held.axis_tables and job.compensation.tables and not declared.model:
        job = replace(job, compensation=_by_axis(job, declared))
    both = in_form(add_compensations(job.compensation, held), job.machine, declared, job.tool)
    notes = [
        f"the new files are a sum with {e.words}: load them in the place of those, not beside them" for e in existing
    ]
    whole = replace(job, compensation=replace(both, names=job.compensation.names))
    _refuse_loss(chosen, job, whole, old)
    return Sum(whole, old, tuple(notes))


def _refuse_loss(chosen: Controller, job: Job, whole: Job, old: Compensation) -> None:
    """Raises `InputError` where the files of the sum do not move the axes as the new ones and the old ones together."""
    types = job.compensation.names
    new, both = write(chosen, job, types), write(chosen, whole, types)
    rest = replace(both, held=with_opposite(both.held, old))
    nothing = with_opposite(both.held, both.held)
    for linear in KINDS:
        apart, at = largest_change(new.held, rest, job.tool, shifted=both.declaration.zero_fixed, linear=linear)
        moved = largest_change(nothing, both, job.tool, linear=linear)[0]
        if not apart <= EXACT + ROUNDINGS * rounding_of(both, linear) + SECOND_ORDER * moved:
            raise InputError(
                f"{both.declaration.name}: the files of the sum would not move the axes as the old and the new ones together: by "
                f"up to {in_words(apart, linear)} at {at}. Load the new ones beside the old, where the control allows it"
            )


def _by_axis(job: Job, declared: Declaration) -> Compensation:
    """Tables of error functions as the tables of axes that a control without a kinematic model holds."""
    return replace(job.compensation, tables=(), axis_tables=job.axis_tables(products=declared.products))


def _tool_of(made: Compensation) -> tuple[float, float, float]:
    """The tool vector for which the grids of linear axes hold [mm]; none without such grids."""
    return next((g.tool for g in made.grids if isinstance(g, Grid)), (0.0, 0.0, 0.0))


def _for_one_tool(before: Compensation, found: Export, tool: np.ndarray) -> list[str]:
    """A note where the two forms move the axes otherwise with another tool, because rotations act through its vector."""
    shifted = found.declaration.zero_fixed
    here, *others = (
        largest_change(before, found, tool + beside, shifted=shifted)[0] for beside in (np.zeros(3), *BESIDE)
    )
    if max(others) <= here + EXACT + found.written.rounding:
        return []
    at = ", ".join(f"{v:g}" for v in tool)
    return [
        f"right for the tool vector {at} mm alone: the old files turn rotations into motion by the tool vector, these do not; "
        f"with a tool 100 mm beside it the axes move up to {1e3 * max(others):.1f} µm otherwise"
    ]


def carried(made: Compensation, machine: Machine, declared: Declaration) -> tuple[str, ...]:
    """The types that the control is given, under names that it has. Raises `InputError` for one that it cannot carry."""
    found = []
    for name in types_of(made, machine):
        fits = next((n for n in _CONTAINED.get(name, (name,)) if n in declared.carries), None)
        if fits is None:
            raise InputError(
                f"{declared.name} cannot carry {name}, which these files hold: {declared.nearest}. "
                f"{instead_of(declared, name)}"
            )
        found.append(fits)
    return tuple(dict.fromkeys(found))
