"""From a solution to the files of one control: the types that it can carry, sampled as it wants, written, and read back."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from volid.compensation.base import Base, base_of
from volid.compensation.grids.request import Rule
from volid.compensation.helping_axes import HelpingMotion, helping_words, model_reversal
from volid.compensation.package import Compensation, compensate
from volid.compensation.ranges import Ranges, chosen_ranges, cut_notes, refuse_extrapolation
from volid.compensation.tables.by_axis import bent_between
from volid.compensation.tables.sampling import POINTS, Sampling
from volid.controllers import CONTROLS, Controller
from volid.controllers.axes import Axes, helping_motions, kept_to, refuse_unsteady
from volid.controllers.base import EQUAL, Declaration, Job, Written, options_of, sign_of
from volid.controllers.choice import Choice, asked_types, most_types
from volid.controllers.existing.conversion import on_top
from volid.controllers.existing.measured_state import not_in_sum, refuse_same_files, stood_for
from volid.controllers.existing.reading import ExistingCompensation, unknown_control
from volid.controllers.existing.state import not_described, not_recorded, would_replace
from volid.controllers.exported import Export, write
from volid.controllers.other_tools import other_tool_notes
from volid.controllers.unsupported import reason
from volid.exceptions import InputError
from volid.fitting.solution import Solution
from volid.model.iso230 import DIRECTIONS, SPINDLE
from volid.model.machine import Machine

COARSE = 3  # points of tables and grids: to see whether a type can be made and held at all
FEW = 3  # notes of one kind
LEFT_OUT = {"mm": 1e-6, "rad": 1e-8}  # what tables miss between their points is worth a word from here on
BENT = 5e-5  # mm: so are curves of tables of axes


@dataclass(frozen=True, eq=False)
class ExportRequest:
    """What is asked of an export, whatever the control; the fields are the keywords of `export`."""

    types: tuple[str, ...] = ()
    base: Base | None = None
    sampling: Sampling | None = None
    sign: str | None = None
    options: Mapping[str, Any] = field(default_factory=dict)
    zero: Mapping[str, float] | None = None
    ranges: Ranges | None = None
    extrapolate: bool = False
    axes: Axes = field(default_factory=Axes)
    rule: Rule | None = None
    add_to: tuple[ExistingCompensation, ...] = ()


def controller(name: str) -> Controller:
    """The control of that name. Raises `InputError` for a name that there is not, with what serves instead."""
    if name in CONTROLS:
        return CONTROLS[name]
    why = reason(name)
    if why:
        raise InputError(f"`cnc={name}`: nothing can be written for it: {why}")
    raise unknown_control(name)


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
    ranges: Ranges | None = None,
    extrapolate: bool = False,
    axes: Axes | None = None,
    rule: Rule | None = None,
    add_to: Sequence[ExistingCompensation] = (),
) -> Export:
    """Files that a control loads, from a solution.

    Args:
        solution: A solution, as `volid.fit` makes it.
        cnc: Name of the control, one of `volid.CONTROLS`.
        types: Types of ISO/TR 16907; by default the most complete that the control carries and the data determine.
        base: What the types are based on, as `volid.compensation_base` makes it; by default the most used tool vector.
        sampling: How tables and grids are sampled; by default as the control wants it.
        sign: "error" or "compensation" where public sources leave the sign of the control open.
        options: Options of the control, see its declaration.
        zero: Position by axis letter where tables are 0 [mm or °].
        ranges: Lowest and highest position by axis letter [mm or °]; what was measured by default.
        extrapolate: Whether values beyond what was measured are intended.
        axes: What the axes can do and may be asked for; by default everything.
        rule: Function that computes what L-SPEC and R-SPEC correct, as of `volid.compensate`.
        add_to: What the control holds already, as `volid.load_compensation` reads it or `volid.recorded_compensations` finds it
            in the campaign: the files then hold the sum (ISO/TR 16907 10.5). It is right where that was active while measuring.

    Raises:
        InputError: the control cannot carry a type, or hold what was made, or its sign must be stated; or positions lie outside
            what was measured; or the control cannot hold exactly what it is added to.
        NotDeterminedError: the data do not determine what a type contains.

    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/published_positioning/campaign.toml"))
    >>> made = volid.export(solution, "linuxcnc", ["L-POS"])
    >>> [file.name for file in made.written.files if file.name.endswith(".comp")]
    ['x.comp', 'z.comp']
    """
    asked = Axes() if axes is None else axes
    request = ExportRequest(
        tuple(types), base, sampling, sign, options or {}, zero, ranges, extrapolate, asked, rule, tuple(add_to)
    )
    return export_of(solution, controller(cnc), request)


def export_of(solution: Solution, chosen: Controller, request: ExportRequest) -> Export:
    """`export` with everything that is asked for in one object."""
    refuse_same_files(request.add_to)
    declared = chosen.declaration
    stated, sign = options_of(declared, request.options), sign_of(declared, request.sign)
    declared = chosen.declared_for(solution.machine, stated)
    work = _Work(solution, declared, request, sign, stated)
    found = work.choice(lambda job: chosen.write(job))
    made = work.compensation(found.types, work.sampling)
    job, without = work.job(made)
    job, old, summed = on_top(chosen, job, request.add_to)
    job, kept = kept_to(request.axes, job, declared)
    written = write(chosen, job, found.types)
    helping = helping_motions(written.held, job, request.axes, model_reversal(solution))
    refuse_unsteady(helping, request.axes, job.machine)
    notes = (*found.notes, *work.notes(made), *without, *summed, *kept, *_helping_notes(helping, job.machine))
    notes = (
        *notes,
        *other_tool_notes(job, declared),
        *written.notes,
        *_state_notes(solution, found.types, declared, request),
    )
    before = stood_for(solution.campaign, declared.name, request.add_to)
    return replace(
        written, axes=request.axes, solution=solution, helping=helping, notes=notes, existing=old, before=before
    )


def _state_notes(
    solution: Solution, types: Sequence[str], declared: Declaration, request: ExportRequest
) -> tuple[str, ...]:
    """To which state of the machine the files belong, and what they would replace (10.5)."""
    if request.add_to:
        lost = not_in_sum(solution.campaign, request.add_to, types, declared.name)
        return (*lost, *not_recorded(solution.campaign, request.add_to), *not_described(solution, request.add_to))
    return tuple(would_replace(solution.campaign, types, declared.name))


def _without_tool_frame(made: Compensation, declared: Declaration, base: Base) -> tuple[Compensation, list[str]]:
    """The tables without constants of the tool frame, and what they do at the base tool, for a control without a model."""
    constants = {t.function: float(t.forward[0]) for t in made.tables if t.axis == SPINDLE}
    if not constants:
        return made, []
    values = np.array([constants.get(f"E{d}0{SPINDLE}", 0.0) for d in DIRECTIONS])
    moved = 1e3 * float(np.linalg.norm(values[:3] + np.cross(values[3:], base.tool)))
    longer = 1e3 * 100.0 * float(np.linalg.norm(values[3:]))
    note = (
        f"{', '.join(constants)}: constants of the tool frame are left out, because {declared.name} has no kinematic model: the "
        f"base tool is displaced by {moved:.2f} µm everywhere, and 100 mm of another tool by up to {longer:.2f} µm more"
    )
    return replace(made, tables=tuple(t for t in made.tables if t.axis != SPINDLE)), [note]


def _helping_notes(found: Sequence[HelpingMotion], machine: Machine) -> list[str]:
    """The axis that turns most often, and all that are asked for runs below their least increment."""
    most = max(found, key=lambda h: h.turns, default=None)
    small = [h for h in found if h.too_small and h is not most]
    told = [most] if most is not None and (most.turns or most.too_small) else []
    return [f"axes that only help: {helping_words(machine, h)}" for h in (*told, *small[:FEW])]


class _Work:
    """One export: base, ranges and sampling, and what is made with them."""

    def __init__(
        self, solution: Solution, declared: Declaration, request: ExportRequest, sign: str, options: Mapping[str, Any]
    ) -> None:
        self.declared, self.request, self.sign, self.options = declared, request, sign, options
        self.base = base_of(solution, solution.most_used_tool()) if request.base is None else request.base
        self.ranges = chosen_ranges(solution, request.ranges, request.extrapolate)
        self.sampling = sampling_for(declared, request.sampling)
        self.solution = solution.extrapolated() if request.extrapolate else solution

    def choice(self, write: Callable[[Job], Written]) -> Choice:
        """The types asked for, or the most complete that the control can hold together."""
        if self.request.types:
            return asked_types(self.declared, self.request.types, self.solution.machine)

        def probe(names: Sequence[str]) -> Compensation:
            made = self.compensation(names, replace(self.sampling, step=None, max_error=None, max_points=COARSE))
            if made.tables or made.grids:
                write(self.job(made)[0])
            return made

        return most_types(self.declared, self.solution, self.base.functions, probe)

    def job(self, made: Compensation) -> tuple[Job, list[str]]:
        """What is to be written, and what is left out because a control without a model has no place for it."""
        left: list[str] = []
        if not self.declared.model:
            made, left = _without_tool_frame(made, self.declared, self.base)
        return Job(self.solution.machine, made, self.base.at, self.base.tool, self.sign, self.options), left

    def compensation(self, names: Sequence[str], sampling: Sampling) -> Compensation:
        """Tables and grids of the types, each in the form in which the control carries it. Raises as `export` does."""
        parts = [self._of_form(f, names, sampling) for f in dict.fromkeys(self.declared.carries[n] for n in names)]
        made = Compensation(
            tuple(n for p in parts for n in p.names),
            tuple(t for p in parts for t in p.tables),
            tuple(g for p in parts for g in p.grids),
        )
        if not self.request.extrapolate:
            refuse_extrapolation(self.solution, (*made.tables, *made.grids), self.base, self.ranges)
        return made

    def _of_form(self, form: str, names: Sequence[str], sampling: Sampling) -> Compensation:
        return compensate(
            self.solution,
            [n for n in names if self.declared.carries[n] == form],
            self.base,
            tables=sampling,
            grids=replace(sampling, together=False, even=False),
            form=form,
            rule=self.request.rule,
            zero=self.request.zero,
            ranges=self.ranges,
            uncertainty=False,
        )

    def notes(self, made: Compensation) -> list[str]:
        """Ranges that are less than the travels, and what tables miss between their points."""
        letters = [t.axis for t in made.tables] + [a for g in made.grids for a in g.axes]
        notes = cut_notes(self.solution, self.ranges, letters)
        for unit, size, word in (("mm", 1e3, "µm"), ("rad", 1e6, "µrad")):
            missed = max((t for t in made.tables if t.unit == unit), key=lambda t: t.interpolation, default=None)
            if missed is not None and missed.interpolation > LEFT_OUT[unit] and not self.declared.linear:
                notes.append(
                    f"linear interpolation between the points misses at most {size * missed.interpolation:.3g} {word} "
                    f"({missed.function}, {len(missed.positions)} points); `max_error` or `step` take more points"
                )
        return [*notes, *self._bent(made)]

    def _bent(self, made: Compensation) -> list[str]:
        """What tables of axes miss between their points of rotations with lever arms that contain the axis's own position."""
        if self.declared.model or self.declared.linear or not made.tables:
            return []
        tables = tuple(t for t in made.tables if t.axis != SPINDLE)
        products = self.declared.products
        missed = bent_between(self.solution.machine, tables, self.base.at, self.base.tool, products=products)
        if missed <= BENT:
            return []
        return [
            f"tables of axes miss at most {1e3 * missed:.3g} µm between their points: rotations of an axis that carries the "
            "workpiece act through its own position, and lines times lines are curves; `step` or `max_points` take more points"
        ]


def sampling_for(declared: Declaration, asked: Sampling | None) -> Sampling:
    """Sampling as the control wants it: equal steps where it knows no others, and no more positions than it holds."""
    found = replace(Sampling() if asked is None else asked, together=True)
    if declared.spacing == EQUAL:
        found = replace(found, spacing=EQUAL, even=True)
    if found.step is None and found.max_points is None and declared.most_points is not None:
        few = POINTS if found.max_error is None else declared.most_points
        found = replace(found, max_points=min(few, declared.most_points))
    return found
