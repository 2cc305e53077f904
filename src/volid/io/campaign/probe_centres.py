"""Sphere centres found by a touch probe, as readings of kind `displacement`: d = 0 at the axis positions of the centre.

Centres can be given in two forms. Columns of the linear axes hold the axis positions at which the probe's tip is in the centre.
Columns x, y, z hold the tool-tip coordinates that a control shows with its tool-centre-point function (TCP, TRAORI) on; the axis
positions then follow by nominal inverse kinematics, p_nominal(q, tool) = (x, y, z) + origin, which has one exact solution. Not
modelled: a control whose nominal kinematics differ from those of the machine file.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from volid.exceptions import InputError
from volid.io.basics.csv_table import CsvTable
from volid.io.basics.toml_table import Table
from volid.model.iso230 import LINEAR_AXES
from volid.model.kinematics import nominal_point
from volid.model.machine import Machine
from volid.planning.following import follow

TIP = ("x", "y", "z")
KEYS = ("centres", "origin")
ORIGIN = (0.0, 0.0, 0.0)


def asked_for(table: Table) -> bool:
    """Whether the set holds sphere centres. Raises `InputError` for an origin of nothing."""
    centres = bool(table.flag("centres", False))
    if "origin" in table.data and not centres:
        raise InputError(f"{table.where}: origin is for tool-tip coordinates; add centres = true or remove it")
    return centres


def gives_tip(csv: CsvTable, machine: Machine, table: Table) -> bool:
    """True when the file holds tool-tip coordinates, False for linear axis positions.

    Raises `InputError` when it holds both or parts of both.
    """
    linear = [a for a in LINEAR_AXES if a in machine.letters]
    axes, tip = [a for a in linear if a in csv], [c for c in TIP if c in csv]
    if axes and tip:
        raise InputError(
            f"{csv.source}, header: centres are given twice, by axis positions {', '.join(axes)} and by tool-tip coordinates "
            f"{', '.join(tip)}; keep one of them and name the others in `ignore`"
        )
    if axes and "origin" in table.data:
        raise InputError(f"{table.where}: origin is for tool-tip coordinates, and {csv.source} holds axis positions")
    return not axes


def axis_positions(csv: CsvTable, machine: Machine, tool: np.ndarray, table: Table, purpose: str) -> np.ndarray:
    """Axis positions (m, n_axes) [mm, degrees] of tool-tip coordinates x, y, z in the workpiece frame.

    `tool`: (m, 3) [mm]. The key `origin` of the set is the control's zero point in the workpiece frame: a constant that only
    matters with rotary axes under the workpiece. Raises `InputError` for a machine whose X, Y, Z cannot follow.
    """
    positions = np.zeros((len(csv), len(machine.axes)))
    for i, axis in enumerate(machine.axes):
        if not axis.is_linear:
            positions[:, i] = csv.numbers(axis.letter, axis.unit, purpose)
    tip = np.stack([csv.numbers(c, "mm", purpose) for c in TIP], axis=1)
    return follow(machine, positions, tool, tip + np.array(table.vector("origin", 3, ORIGIN)))


def places(machine: Machine, positions: np.ndarray, tool: np.ndarray, spheres: np.ndarray) -> Mapping[str, Any]:
    """Approximate places of the spheres, workpiece frame [mm]: means of their nominal centres; (m,) sphere names."""
    centres = nominal_point(machine, positions, tool)
    return {str(name): centres[spheres == name].mean(axis=0).tolist() for name in dict.fromkeys(spheres.tolist())}
