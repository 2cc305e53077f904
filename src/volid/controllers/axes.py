"""What the axes can do and may be asked for: least increments, clamped axes, how often an axis may turn that only helps.

What is written keeps to it where files can: tables that would move a clamped axis are left out, and tables of helping axes are
made steady. What files cannot keep is refused, with the pair of axes that is concerned.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from volid.compensation.control import Control
from volid.compensation.grids.grid import AnyGrid
from volid.compensation.helping_axes import HelpingMotion, helping_axes, helping_words
from volid.compensation.package import Compensation
from volid.compensation.steady import steadied
from volid.compensation.tables.axis_table import AxisTable
from volid.compensation.tables.error_table import MODEL
from volid.controllers.base import Declaration, Job
from volid.exceptions import InputError
from volid.model.iso230 import LINEAR_AXES
from volid.model.machine import Machine
from volid.model.requests import ask_increments


@dataclass(frozen=True)
class Axes:
    """What the axes can do.

    Args:
        increment: Least increment by axis letter [mm or °].
        clamped: Letters of axes that no file may move.
        most_turns: Largest number of turns of an axis that only helps, along the travel of another one; None: any.
        reversal: Reversal |B| by axis letter [mm or °], in place of the model's.
    """

    increment: Mapping[str, float] = field(default_factory=dict)
    clamped: tuple[str, ...] = ()
    most_turns: int | None = None
    reversal: Mapping[str, float] = field(default_factory=dict)

    @property
    def limits(self) -> dict[str, Any]:
        """Those that a simulated control knows."""
        return {"increment": self.increment, "clamped": self.clamped}

    def check(self, machine: Machine) -> None:
        """Raises `InputError` for axes that the machine does not have, and numbers that cannot be."""
        for letter in (*self.increment, *self.clamped, *self.reversal):
            machine.index(letter)
        ask_increments((f"increment={a}", machine.axis(a).is_linear, v) for a, v in self.increment.items())
        if self.most_turns is not None:
            lacking = [
                a.letter for a in machine.axes if a.is_linear and a.letter not in (*self.increment, *self.clamped)
            ]
            if lacking:
                raise InputError(
                    f"`most_turns={self.most_turns}` needs the least increment of every axis that may help; "
                    f"`increment` lacks {', '.join(lacking)}"
                )


class Kept(NamedTuple):
    """The job that keeps to the limits, and what that costs, one sentence each."""

    job: Job
    notes: tuple[str, ...] = ()


def kept_to(axes: Axes, job: Job, declared: Declaration) -> Kept:
    """The job without motion of clamped axes and, where turns are limited, with steady tables of helping axes."""
    axes.check(job.machine)
    if not axes.clamped and axes.most_turns is None:
        return Kept(job)
    made, notes = job.compensation, []
    if not declared.model:
        made = replace(made, tables=(), axis_tables=job.axis_tables(products=declared.products))
    for letter in axes.clamped:
        made, lost = _without(made, letter, job.machine)
        notes += lost
    if axes.most_turns is not None:
        tables, more = _steady(made.axis_tables, axes, job.machine)
        made, notes = replace(made, axis_tables=tables), [*notes, *more]
    return Kept(replace(job, compensation=made), tuple(notes))


def _without(made: Compensation, letter: str, machine: Machine) -> tuple[Compensation, list[str]]:
    """The compensation without what moves an axis. Raises `InputError` where no file can keep it still."""
    linear, notes = letter in LINEAR_AXES, []
    if linear and any(t.applied == MODEL for t in made.tables):
        raise InputError(
            f"`clamped={letter}`: tables of error functions move X, Y, Z through the kinematic model of the control, and no file "
            f"keeps {letter} still; switch it off at the control, or take a control with tables of axes"
        )
    moving = [t for t in made.axis_tables if t.output == letter]
    notes += [
        f"{letter} is clamped: its table over {t.argument} ({t.source}) is left out, which leaves up to {_largest(t, linear)}"
        for t in moving
    ]
    kept = tuple(t for t in made.tables if t.axis != letter or t.applied == MODEL)
    grids = tuple(_still(g, letter, notes) if linear else g for g in made.grids)
    others = tuple(t for t in made.axis_tables if t.output != letter)
    return replace(made, tables=kept, axis_tables=others, grids=grids), notes


def _largest(table: AxisTable, linear: bool) -> str:
    reach = 1.0 if table.factor is None else np.abs(table.factor.values).max()
    value = float(max(np.abs(table.forward).max(), np.abs(table.reverse).max()) * reach)
    return f"{1e3 * value:.2f} µm" if linear else f"{1e6 * value:.2f} µrad"


def _still(grid: AnyGrid, letter: str, notes: list[str]) -> AnyGrid:
    """A grid whose values do not move a linear axis."""
    values = grid.values.copy()
    column = LINEAR_AXES.index(letter)
    left = float(np.nanmax(np.abs(values[:, column])))
    values[:, column] = 0.0
    notes.append(
        f"{letter} is clamped: its values in the {grid.type} grid are 0, which leaves up to {1e3 * left:.2f} µm"
    )
    return replace(grid, values=values)


def _steady(tables: tuple[AxisTable, ...], axes: Axes, machine: Machine) -> tuple[tuple[AxisTable, ...], list[str]]:
    """Tables of helping axes at multiples of the least increment and with few turns, and the loss."""
    found: list[AxisTable] = []
    notes: list[str] = []
    for t in tables:
        linear = machine.axis(t.output).is_linear
        least = axes.increment.get(t.output)
        if t.is_pitch or t.factor is not None or least is None or axes.most_turns is None:
            found.append(t)
            continue
        step = least if linear else float(np.deg2rad(least))
        up, down = (steadied(v, step, axes.most_turns) for v in (t.forward, t.reverse))
        loss = max(up.loss, down.loss)
        size = f"{1e3 * loss:.2f} µm" if linear else f"{1e6 * loss:.2f} µrad"
        notes.append(f"{t.output} over {t.argument}: steady values, at most {size} from the exact ones")
        found.append(replace(t, forward=up.values, reverse=down.values))
    return tuple(found), notes


def helping_motions(
    made: Compensation, job: Job, axes: Axes, reversal: Mapping[str, float]
) -> tuple[HelpingMotion, ...]:
    """What axes do that only help, with the files as the control holds them."""
    control = Control(job.machine, made.tables, made.grids, clamped=axes.clamped, axis_tables=made.axis_tables)
    return helping_axes(control, job.tool, None, axes.increment, {**reversal, **axes.reversal})


def refuse_unsteady(found: tuple[HelpingMotion, ...], axes: Axes, machine: Machine) -> None:
    """Raises `InputError` where the files do not keep what is asked of helping axes."""
    if axes.most_turns is None:
        return
    for one in found:
        if one.turns > axes.most_turns or one.too_small:
            raise InputError(
                f"`most_turns={axes.most_turns}` cannot be kept: {helping_words(machine, one)}. Values of grids, products and "
                "tables of error functions follow several axes at once; take tables of axes (L-POS, L-STR, L-SQU), larger "
                "increments, or more turns"
            )
