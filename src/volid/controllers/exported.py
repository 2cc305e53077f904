"""The files of one control together with what they were made from, and with what the control then holds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from volid.compensation.control import Control
from volid.compensation.grids.grid import AnyGrid, Grid
from volid.compensation.helping_axes import HelpingMotion
from volid.compensation.on_top import with_opposite
from volid.compensation.package import Compensation
from volid.compensation.tables.axis_table import AxisTable
from volid.compensation.types import ANG, TYPES
from volid.controllers import Controller
from volid.controllers.axes import Axes
from volid.controllers.base import Declaration, Job, Written
from volid.exceptions import InputError
from volid.fitting.solution import Solution


@dataclass(frozen=True, eq=False)
class Export:
    """The files of one control, with what they were made from.

    Args:
        controller: The control.
        job: The tables and grids that were written, before the control's rounding.
        written: The files, the parameters and the notes.
        held: The tables and grids as the control holds them: read back from the files.
        types: Types of ISO/TR 16907 that they carry.
        axes: What the axes can do.
        solution: The solution, where they were made from one.
        helping: What axes do that move only because another one does.
        notes: What a user should know, one sentence each: of the choice, of the control, of the files.
        existing: What the control held already and is part of the sum; None where nothing was.
        before: What the files stand in the place of: errors of the solution are relative to it. None where nothing was active.

    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/published_positioning/campaign.toml"))
    >>> made = volid.export(solution, "linuxcnc", ["L-POS"])
    >>> made.types, [table.output for table in made.held.axis_tables]
    (('L-POS',), ['X', 'Z'])
    """

    controller: Controller
    job: Job
    written: Written
    held: Compensation
    types: tuple[str, ...]
    axes: Axes = field(default_factory=Axes)
    solution: Solution | None = None
    helping: tuple[HelpingMotion, ...] = ()
    notes: tuple[str, ...] = ()
    existing: Compensation | None = None
    before: Compensation | None = None

    @property
    def declaration(self) -> Declaration:
        """What the control declares."""
        return self.controller.declared_for(self.job.machine, self.job.options)

    def control(self, **options: Any) -> Control:
        """The simulated control with these files loaded; `options`: those of `volid.Control`."""
        return self.held.control(self.job.machine, **{**self.axes.limits, **options})

    def added_control(self, **options: Any) -> Control:
        """The simulated control with what these files add to those that were active while measuring, in whose place they stand.

        Without such files it is `control`; `options`: those of `volid.Control`.
        """
        made = self.held if self.before is None else with_opposite(self.held, self.before)
        return made.control(self.job.machine, **{**self.axes.limits, **options})


def write(chosen: Controller, job: Job, types: Sequence[str]) -> Export:
    """The files of a job, and what the control then holds."""
    _ask_something(chosen, job)
    written = chosen.write(job)
    files = {f.name: f.content for f in written.files}
    held = _with_sources(chosen.read(files, job.machine, {**job.options, "sign": job.sign}), chosen, job)
    held = replace(held, names=tuple(types), grids=tuple(_named(g, job, types) for g in held.grids))
    return Export(chosen, job, written, held, tuple(types), notes=tuple(written.notes))


def _named(held: AnyGrid, job: Job, types: Sequence[str]) -> AnyGrid:
    """A grid with its type and the tool vector for which it is right, which files of a control without lever arms do not say.

    Without rotations the tool vector changes no motion, only what is said of it.
    """
    if not isinstance(held, Grid) or np.any(held.values[:, 3:]):
        return held
    own = [g for g in job.compensation.grids if isinstance(g, Grid) and g.axes == held.axes]
    if any(g.type == held.type and np.array_equal(held.tool, job.tool) for g in own):
        return held
    if own:
        return replace(held, type=own[0].type, tool=own[0].tool)
    of_rotations = (t for t in types if ANG in TYPES[t].effects)  # products of two tables
    x, y, z = (float(v) for v in job.tool)
    return replace(held, type=next(of_rotations, held.type), tool=(x, y, z))


def _ask_something(chosen: Controller, job: Job) -> None:
    """Raises `InputError` where the job would move no axis, so that files would be empty."""
    made, declared = job.compensation, chosen.declaration
    held = (*made.tables, *made.axis_tables) if declared.model else job.axis_tables(products=declared.products)
    if not (held or made.grids):
        types = ", ".join(made.names) or "these types"
        raise InputError(
            f"{declared.name}: nothing to write; what {types} would correct is 0 everywhere, or was not measured"
        )


def _with_sources(held: Compensation, chosen: Controller, job: Job) -> Compensation:
    """The tables of axes with the error functions that they were made of, which many files do not say."""
    if all(t.source for t in held.axis_tables):
        return held
    made = job.axis_tables(products=chosen.declaration.products)
    known = {_key(t): t.source for t in made}
    named = tuple(t if t.source else replace(t, source=known.get(_key(t), "")) for t in held.axis_tables)
    return replace(held, axis_tables=named)


def _key(table: AxisTable) -> tuple[str, str, str]:
    return table.output, table.argument, "" if table.factor is None else table.factor.axis
