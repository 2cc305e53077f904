"""Tables as a joint of LinuxCNC takes them: one for each axis over its travel, and what a user should know of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from volid.compensation.tables.axis_table import AxisTable
from volid.controllers.base import Declaration, Job, outputs
from volid.controllers.linuxcnc.joints.comp_file import DIGITS
from volid.controllers.linuxcnc.joints.ini import LETTERS, unit_of
from volid.exceptions import InputError
from volid.model.machine import Machine

SHOWN = 0.005  # µm or µrad: smaller steps are not worth a note


def one_per_axis(declared: Declaration, job: Job) -> list[AxisTable]:
    """The sum of the tables of each axis. Raises `InputError` for what moves an axis by the position of another one."""
    made = job.axis_tables()
    for table in made:
        if not table.is_pitch:
            raise InputError(
                f"{declared.name}: {table.source or 'a table'} moves {table.output} by the position of {table.argument}; "
                f"{declared.nearest}. Export L-POS and R-POS alone"
            )
    return [
        _summed([_unrolled(t, job.machine) for t in made if t.output == a])
        for a in sorted(outputs(made), key=LETTERS.index)
    ]


def _summed(tables: Sequence[AxisTable]) -> AxisTable:
    """The sum of tables of one axis, exact on the union of their positions."""
    if len(tables) == 1:
        return tables[0]
    at = np.unique(np.concatenate([t.positions for t in tables]))
    up, down = (np.sum([t.of_argument(at, np.full(len(at), w)) for t in tables], axis=0) for w in (1.0, -1.0))
    source = " + ".join(dict.fromkeys(t.source for t in tables if t.source))
    return replace(tables[0], positions=at, forward=up, reverse=down, source=source)


def _unrolled(table: AxisTable, machine: Machine) -> AxisTable:
    """A table that repeats after a turn, written out over the travel, because LinuxCNC holds the ends and does not roll over."""
    low, high = machine.axis(table.argument).travel
    first, last = table.positions[0], table.positions[-1]
    if not table.period or (first <= low and high <= last):
        return replace(table, period=0.0)
    turns = table.period * np.arange(np.floor((low - last) / table.period), np.ceil((high - first) / table.period) + 1)
    at = np.round((table.positions + turns[:, None]).ravel(), DIGITS)
    at = np.unique(np.concatenate([[low], at[(at > low) & (at < high)], [high]]))
    up, down = (table.of_argument(at, np.full(len(at), w)) for w in (1.0, -1.0))
    return replace(table, positions=at, forward=up, reverse=down, period=0.0)


def scales(machine: Machine, letter: str, linear_units: str) -> tuple[float, float]:
    """What positions [mm or °] and errors [mm or rad] are multiplied by for the unit of the joint."""
    unit = unit_of(machine, letter, linear_units)
    return 1.0 / unit, (1.0 if machine.axis(letter).is_linear else 180.0 / np.pi) / unit


def left_by_backlash(table: AxisTable, machine: Machine) -> str:
    """What BACKLASH alone does not correct."""
    size, unit = _shown(table, machine)
    varies = 0.5 * np.abs(table.forward - table.reverse - table.reversal_value).max()
    mean, left = size * np.abs(table.mean).max(), size * varies
    return (
        f"{table.output}: BACKLASH corrects the mean reversal of {size * table.reversal_value:.2f} {unit} alone; the mean of "
        f"both directions, up to {mean:.2f} {unit}, stays, and up to {left:.2f} {unit} of the reversal in each direction"
    )


def step_at_home(table: AxisTable, machine: Machine, home: Mapping[str, float] | None) -> list[str]:
    """The step that the axis makes at its first motion after homing, where it is worth a note."""
    at = (home or {}).get(table.output, 0.0)
    size, unit = _shown(table, machine)
    up, down = (0.0 - size * float(np.interp(at, table.positions, v)) for v in (table.forward, table.reverse))
    if max(abs(up), abs(down)) < SHOWN:
        return []
    return [
        f"{table.output}: at HOME = {at:g} {machine.axis(table.output).unit} the correction is {up:.2f} {unit} for motion in +, "
        f"{down:.2f} {unit} in -; the axis makes this step when it first moves after homing"
    ]


def _shown(table: AxisTable, machine: Machine) -> tuple[float, str]:
    """Factor and unit in which people read a value."""
    return (1e3, "µm") if machine.axis(table.output).is_linear else (1e6, "µrad")
