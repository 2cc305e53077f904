"""Touches of a probe on spheres, as rows of a set: a sphere is fitted to each group, and its centre becomes a row.

A set with `touches = true` holds one touch a row: columns X, Y, Z (axis positions) or x, y, z (tool-tip coordinates of a
control with its tool-centre-point function on) of the centre of the stylus ball, the rotary axes, and optional labels `path`
(one tool path touches one sphere once) and `sphere` (its name). What follows are sphere centres
(`volid.io.campaign.probe_centres`) with the u that the scatter of the touches and their places give, as
`volid.multilateration.sphere_scatter` describes it.

Keys of the set, all optional: `count` (touches of each sphere), `gap` (mm, between spheres), `origin` (mm, added to the
coordinates: where their zero lies), `sphere_diameter` and `ball_diameter` (mm), `fix_radius = true` (the radius is that of
the two), `touch_u` (mm, of one touch; default: the scatter), `u` (mm, of a centre besides the touches: repeatability of the
machine).

Not modelled: correlations between the three coordinates of a centre, and errors of the machine within the few millimetres of
a sphere."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from volid.exceptions import InputError
from volid.io.basics.csv_form import PLAIN
from volid.io.basics.csv_table import CsvTable
from volid.io.basics.toml_table import Table
from volid.io.campaign import probe_centres
from volid.io.campaign.rules import find_kind
from volid.io.campaign.touch_groups import Touches, groups_of
from volid.io.campaign.touch_spheres import Probe, fitted
from volid.model.iso230 import LINEAR_AXES
from volid.model.kinematics import nominal_point
from volid.model.machine import Machine
from volid.observations import KINDS

KEYS = ("touches", "count", "gap", "origin", "sphere_diameter", "ball_diameter", "fix_radius", "touch_u", "u")
PATH = "path"  # label: one tool path touches one sphere once
BALL = "ball_radius"  # column: of the stylus ball [mm]
TOOL_COLUMNS = ("tool_x", "tool_y", "tool_z")
_PURPOSE = "every touch needs one"


def as_centres(table: Table, csv: CsvTable, machine: Machine) -> tuple[Table, CsvTable, dict[str, Any]]:
    """The set and its rows with a sphere's centre in place of its touches, and a record of it; as they are for another set.

    Raises `InputError` naming file, rows or key.
    """
    if not table.flag("touches", False):
        return table, csv, {}
    kind = find_kind(table.text("kind"), table.where)
    if not kind.takes_centres:
        taking = ", ".join(name for name, other in KINDS.items() if other.takes_centres)
        raise InputError(f"{table.where}: touches = true in a set of kind '{kind.name}'; expected one of {taking}")
    touches = _touches(table, csv, machine, tuple(kind.labels))
    found = fitted(touches, groups_of(touches, _count(table), _gap(table)), _probe(table, csv))
    extra = table.number("u", above=0.0) if "u" in table.data else 0.0
    columns = found.columns(machine, kind, extra)
    if not any(name in csv for name in TOOL_COLUMNS):
        columns = {name: cells for name, cells in columns.items() if name not in TOOL_COLUMNS}
    for name, values in _recorded(csv).items():
        columns[name] = found.means(values)
    rows = touches.rows[found.first]
    data = {key: value for key, value in table.data.items() if key not in KEYS} | {"centres": True}
    remarks = (*csv.remarks, *found.said())
    csv = replace(csv, columns=columns, rows=rows, form=PLAIN, units={}, underscores=False, remarks=remarks)
    stated = {key: value for key, value in table.data.items() if key in KEYS}
    return Table(data, table.where), csv, {**stated, "touches_fitted": found.record()}


def _count(table: Table) -> int | None:
    if "count" not in table.data:
        return None
    value = table.data["count"]
    if not isinstance(value, int) or isinstance(value, bool) or value < 4:
        raise table.wrong("count", "the number of touches of each sphere, at least 4")
    return value


def _gap(table: Table) -> float | None:
    if "gap" in table.data:
        return table.number("gap", above=0.0)
    return 2.0 * table.number("sphere_diameter", above=0.0) if "sphere_diameter" in table.data else None


def _touches(table: Table, csv: CsvTable, machine: Machine, own: tuple[str, ...]) -> Touches:
    """The touches of a file. `own`: labels of the set's kind."""
    linear = [a for a in LINEAR_AXES if a in machine.letters]
    tip = probe_centres.gives_tip(csv, machine, Table({}, table.where))
    letters = [a.letter for a in machine.axes if not a.is_linear]
    required = [*(probe_centres.TIP if tip else linear), *letters]
    known = (*required, PATH, *own, *TOOL_COLUMNS, BALL, "time", "temperature")
    csv.require(required, _PURPOSE, known)
    csv.only(known)
    tool, origin = _tool(table, csv), np.array(table.vector("origin", 3, probe_centres.ORIGIN))
    positions = np.zeros((len(csv), len(machine.axes)))
    for i, axis in enumerate(machine.axes):
        if axis.letter in csv:
            positions[:, i] = csv.numbers(axis.letter, axis.unit, _PURPOSE)
            positions[:, i] += origin[LINEAR_AXES.index(axis.letter)] if axis.is_linear else 0.0
    if tip:
        points = np.stack([csv.numbers(c, "mm", _PURPOSE) for c in probe_centres.TIP], axis=1) + origin
    else:
        points = nominal_point(machine, positions, tool)
    rotary = positions[:, [machine.index(a) for a in letters]]
    labels = {name: csv.labels(name, "every touch needs one") for name in (PATH, *own) if name in csv}
    return Touches(csv.source, points, rotary, tool, labels, csv.rows)


def _tool(table: Table, csv: CsvTable) -> np.ndarray:
    """Tool vectors of the touches, (n, 3) [mm]: to the centre of the stylus ball."""
    if any(name in csv for name in TOOL_COLUMNS):
        csv.require(TOOL_COLUMNS, "a tool vector has three coordinates", tuple(csv.columns))
        return np.stack([csv.numbers(name, "mm", _PURPOSE) for name in TOOL_COLUMNS], axis=1)
    if "tool" not in table.data:
        raise InputError(
            f"{table.where}: there is no tool vector; add tool = [x, y, z] (mm, tool frame), to the centre of the stylus ball"
        )
    return np.tile(np.array(table.vector("tool", 3)), (len(csv), 1))


def _probe(table: Table, csv: CsvTable) -> Probe:
    """What is stated of sphere and probe. Raises `InputError` for half of it."""
    fixed = bool(table.flag("fix_radius", False))
    radius = _expected_radius(table, csv)
    if fixed and radius is None:
        raise InputError(f"{table.where}: fix_radius = true but no sphere_diameter; add that of the certificate (mm)")
    return Probe(radius, fixed, table.number("touch_u", above=0.0) if "touch_u" in table.data else None)


def _expected_radius(table: Table, csv: CsvTable) -> float | None:
    """Radius of the fitted spheres [mm] from the diameters of sphere and stylus ball; None where they are not stated."""
    if "sphere_diameter" not in table.data:
        return None
    sphere = table.number("sphere_diameter", above=0.0) / 2.0
    if "ball_diameter" in table.data:
        return sphere + table.number("ball_diameter", least=0.0) / 2.0
    if BALL not in csv:
        raise InputError(f"{table.where}: sphere_diameter without ball_diameter, that of the stylus ball (mm); add it")
    balls = np.unique(csv.numbers(BALL, "mm", _PURPOSE))
    if len(balls) > 1:
        raise InputError(f"{csv.source}: stylus balls of {balls[0]:g} … {balls[-1]:g} mm; import each probe by itself")
    return sphere + float(balls[0])


def _recorded(csv: CsvTable) -> dict[str, np.ndarray]:
    """Time and temperature of the touches, where they are recorded throughout."""
    purpose, found = "leave the column out where it was not recorded", {}
    if "time" in csv:
        found["time"] = csv.times("time", purpose)
    if "temperature" in csv:
        found["temperature"] = csv.numbers("temperature", "°C", purpose, gaps=True)
    return {name: values for name, values in found.items() if np.isfinite(values).all()}
