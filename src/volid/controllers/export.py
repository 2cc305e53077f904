"""From a solution to the files of one control: the types that it can carry, sampled as it wants, written, and read back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from volid.compensation.base import Base, base_of
from volid.compensation.control import Control
from volid.compensation.package import Compensation, compensate
from volid.compensation.tables.sampling import POINTS, Sampling
from volid.compensation.types import TYPES
from volid.controllers import CONTROLS, Controller
from volid.controllers.base import EQUAL, Declaration, Job, Written, options_of, sign_of
from volid.exceptions import InputError
from volid.fitting.solution import Solution
from volid.model.machine import Machine


@dataclass(frozen=True, eq=False)
class Export:
    """The files of one control, with what they were made from.

    Args:
        controller: The control.
        job: The tables and grids that were written, before the control's rounding.
        written: The files, the parameters and the notes.
        held: The tables and grids as the control holds them: read back from the files.
        types: Types of ISO/TR 16907 that they carry.
    """

    controller: Controller
    job: Job
    written: Written
    held: Compensation
    types: tuple[str, ...]

    @property
    def declaration(self) -> Declaration:
        """What the control declares."""
        return self.controller.declaration

    def control(self, **options: Any) -> Control:
        """The simulated control with these files loaded; `options`: those of `volid.Control`."""
        return self.held.control(self.job.machine, **options)


def controller(name: str) -> Controller:
    """The control of that name. Raises `InputError` for a name that there is not."""
    if name not in CONTROLS:
        raise InputError(f"`cnc={name}` is no control that volid knows; available: {', '.join(CONTROLS)}")
    return CONTROLS[name]


def export(
    solution: Solution,
    cnc: str,
    types: Sequence[str] = (),
    *,
    base: Base | None = None,
    sampling: Sampling | None = None,
    sign: str | None = None,
    options: Mapping[str, Any] | None = None,
    zero: Mapping[str, float] | None = None,
    ranges: Mapping[str, tuple[float, float]] | None = None,
) -> Export:
    """Files that a control loads, from a solution.

    Args:
        solution: A solution, as `volid.fit` makes it.
        cnc: Name of the control, one of `volid.CONTROLS`.
        types: Types of ISO/TR 16907; by default the most that the control can carry on this machine.
        base: What the types are based on, as `volid.compensation_base` makes it; by default the most used tool vector.
        sampling: How tables and grids are sampled; by default as the control wants it.
        sign: "error" or "compensation" where public sources leave the sign of the control open.
        options: Options of the control, see its declaration.
        zero: Position by axis letter where tables are 0 [mm or °].
        ranges: Lowest and highest position by axis letter [mm or °]; what was measured by default.

    Raises:
        InputError: the control cannot carry a type, or hold what was made, or its sign must be stated.
        NotDeterminedError: the data do not determine what a type contains.

    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/published_positioning/campaign.toml"))
    >>> made = volid.export(solution, "linuxcnc", ["L-POS"])
    >>> [file.name for file in made.written.files]
    ['x.comp', 'z.comp']
    """
    chosen = controller(cnc)
    declared = chosen.declaration
    stated, meaning = options_of(declared, options or {}), sign_of(declared, sign)
    names = _types(declared, types, solution)
    found = base_of(solution, solution.most_used_tool()) if base is None else base
    made = compensate(
        solution,
        names,
        found,
        tables=_sampling(declared, sampling),
        grids=sampling,
        form=chosen.form(names, stated),
        zero=zero,
        ranges=ranges,
    )
    job = Job(solution.machine, made, found.at, found.tool, meaning, stated)
    return write(chosen, job, made.names)


def write(chosen: Controller, job: Job, types: Sequence[str]) -> Export:
    """The files of a job, and what the control then holds."""
    written = chosen.write(job)
    files = {f.name: f.content for f in written.files}
    held = chosen.read(files, job.machine, {**job.options, "sign": job.sign})
    return Export(chosen, job, written, replace(held, names=tuple(types)), tuple(types))


def _types(declared: Declaration, types: Sequence[str], solution: Solution) -> tuple[str, ...]:
    """The types asked for, or the most that the control can carry. Raises `InputError` for one that it cannot."""
    for name in types:
        if name not in declared.carries:
            can = ", ".join(declared.carries)
            raise InputError(
                f"`type={name}`: {declared.name} cannot carry {name}: {declared.nearest}. It carries {can}"
            )
    if types:
        return tuple(types)
    return _most(declared, solution.machine)


def _most(declared: Declaration, machine: Machine) -> tuple[str, ...]:
    """The most complete types that the control carries on a machine, none of which corrects what another one does."""
    have = {a.is_linear for a in machine.axes}
    found: list[str] = []
    corrected: set[str] = set()
    for name in declared.carries:
        kind = TYPES[name]
        if kind.is_linear in have and kind.is_rotary != kind.is_linear and not corrected & set(kind.effects):
            found.append(name)
            corrected |= set(kind.effects)
    return tuple(found)


def _sampling(declared: Declaration, asked: Sampling | None) -> Sampling:
    """Sampling within the limits of the control."""
    found = Sampling() if asked is None else asked
    if declared.spacing == EQUAL:
        found = replace(found, spacing="equal")
    if found.step is None and found.max_points is None and declared.most_points is not None:
        found = replace(
            found, max_points=min(POINTS, declared.most_points) if found.max_error is None else declared.most_points
        )
    return found
