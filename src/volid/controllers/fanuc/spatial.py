"""Fanuc: three-dimensional error compensation, a vector at each vertex of boxes of equal size.

Between the eight vertices of the box that holds the machine position the amounts of each axis are blended trilinearly. Public
sources show the formula and neither parameter numbers nor a file; therefore the vectors are written as a neutral list.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from volid.compensation.grids.grid import AnyGrid, Grid
from volid.compensation.grids.interpolation import grid_positions
from volid.compensation.package import Compensation
from volid.compensation.types import GRID
from volid.controllers.axis_values import positive, whole
from volid.controllers.base import (
    DOCUMENTED,
    EQUAL,
    INFERRED,
    NO_REVERSAL,
    NOT_KNOWN,
    OPEN,
    Commissioning,
    ControlFile,
    Controller,
    Declaration,
    Fact,
    Job,
    Option,
    Written,
    text_of,
)
from volid.controllers.tables.lists import list_text, read_list, same_sign, the_list
from volid.controllers.tables.position_grid import position_grid
from volid.controllers.turning import refuse_turning
from volid.exceptions import InputError
from volid.model.iso230 import LINEAR_AXES
from volid.model.jacobian import axis_directions
from volid.model.machine import Machine

VECTORS = "fanuc_3d.csv"
COLUMNS = ("n", "X", "Y", "Z", "CX", "CY", "CZ")
_EVEN = 1e-6  # of a spacing
_MANUAL = "Series 30i-A, three-dimensional error compensation, A-79351E, p. 3"

DECLARATION = Declaration(
    name="fanuc-3d",
    title="Fanuc, three-dimensional error compensation",
    carries={name: GRID for name in ("L-VOL", "L-ANG", "L-POS", "L-STR", "L-SQU", "L-SPEC")},
    nearest="it moves X, Y and Z by a grid over X, Y and Z; fanuc-pitch carries angular positioning of rotary axes",
    sign=OPEN,
    units="positions mm; values in detection units × magnification",
    reversal=NO_REVERSAL,
    outside=NOT_KNOWN,
    spacing=EQUAL,
    limits="how many there may be is not stated by public sources",
    quantum=(0.001, None),
    zero="wherever the grid is 0",
    switching="as a whole, by its own parameter and option",
    options=(
        Option("detection_unit", "detection unit of X, Y and Z, mm", 0.001, positive),
        Option("magnification", "magnification of the values", 1, whole),
    ),
    commissioning=Commissioning(
        backup=("Punch out the parameters and the data of the three-dimensional error compensation.",),
        load=(
            "Enter numbers of positions, intervals, magnification and reference from the parameter manual of the series.",
            "Enter the vectors of fanuc_3d.csv in the order that the manual of the series gives for its positions.",
        ),
        activate=(
            "Switch the function on as the manual says, switch off and on, and return to the reference position.",
        ),
        remove=("Restore the parameters and the data that were punched out.",),
    ),
    facts=(
        Fact("amounts of X, Y, Z at the vertices of boxes, trilinear between eight vertices", DOCUMENTED, _MANUAL),
        Fact("taken at the current position, whatever the tool", INFERRED, f"{_MANUAL}: the formula knows no tool"),
        Fact("detection unit 0.001 mm where none is stated", INFERRED, "a public program for pitch tables"),
        Fact("the sign of the amounts", OPEN),
        Fact("parameter numbers, order and file of the vectors, and how many there may be", OPEN),
    ),
)


class Fanuc3D(Controller):
    """The list of vectors."""

    declaration = DECLARATION

    def declared_for(self, machine: Machine, options: Mapping[str, Any]) -> Declaration:
        """The declaration with the step that is stated."""
        return replace(DECLARATION, quantum=(options["detection_unit"] * options["magnification"], None))

    def write(self, job: Job) -> Written:
        """The list. Raises `InputError` for anything but one even grid over X, Y and Z."""
        grid = _only(job.compensation)
        refuse_turning(DECLARATION.name, job.machine)
        quantum = job.options["detection_unit"] * job.options["magnification"]
        wanted = job.factor * _along_axes(job.machine, grid.values[:, :3]) / quantum
        held = np.rint(wanted).astype(np.int64)
        lines = (
            f"values: {job.sign}",
            f"CX, CY, CZ: amounts of X, Y, Z in steps of {quantum:.9g} mm; X runs fastest",
            f"tool vector: {', '.join(f'{v:.9g}' for v in grid.reference)} mm",
        )
        places = zip(grid.positions.tolist(), held.tolist(), strict=True)
        text = list_text(lines, COLUMNS, ((n, *p, *c) for n, (p, c) in enumerate(places, 1)))
        parameters = tuple(
            (f"{axis}: {what}", f"{value:.9g}", f"{what} of the grid along {axis}")
            for axis, nodes in zip(LINEAR_AXES, grid.nodes, strict=True)
            for what, value in (("positions", len(nodes)), ("lowest", nodes[0]), ("interval", nodes[1] - nodes[0]))
        )
        loss = float(quantum * np.abs(held - wanted).max())
        return Written(
            (ControlFile(VECTORS, text, "vectors at the positions of the grid"),), parameters, _notes(grid), loss
        )

    def read(self, files: Mapping[str, str | bytes], machine: Machine, options: Mapping[str, Any]) -> Compensation:
        """The grid of a list, of translations alone."""
        name = the_list(files, ".csv", DECLARATION.name)
        text = text_of(name, files[name])
        same_sign(name, text, options["sign"])
        rows = read_list(name, text, COLUMNS[1:])
        at = np.array([[row.number(a) for a in LINEAR_AXES] for row in rows]).reshape(-1, 3)
        steps = np.array([[row.whole(c) for c in COLUMNS[4:]] for row in rows], dtype=float).reshape(-1, 3)
        nodes = tuple(np.unique(column) for column in at.T)
        order = np.lexsort(at.T)
        if len(at) != np.prod([float(len(n)) for n in nodes]) or not np.array_equal(grid_positions(nodes), at[order]):
            raise InputError(
                f"{name}: its {len(at)} positions are no grid; expected every combination of X, Y and Z once"
            )
        _ask_even(name, nodes)
        size = (
            options["detection_unit"] * options["magnification"] * (-1.0 if options["sign"] == "compensation" else 1.0)
        )
        errors = size * steps[order] @ _directions(machine).T
        grid = position_grid(tuple(LINEAR_AXES), nodes, errors, "the control adds no lever arm: rotations are 0")
        return Compensation((), (), (grid,))

    def recognises(self, name: str, content: str | bytes) -> bool:
        """A list whose columns are those of the vectors."""
        lines = text_of(name, content[:4000]).splitlines()
        return [line for line in lines if not line.startswith("#")][:1] == [",".join(COLUMNS)]


def _only(made: Compensation) -> Grid:
    """The one grid. Raises `InputError` for tables, several grids, another grid, gaps or uneven nodes."""
    grids: Sequence[AnyGrid] = made.grids
    have = [f"grid of {g.type} over {', '.join(g.axes)}" for g in grids]
    have += [f"table of {t.function}" for t in made.tables] + [f"table of {t.source}" for t in made.axis_tables]
    if len(grids) != 1 or len(have) != 1 or grids[0].axes != tuple(LINEAR_AXES) or not isinstance(grids[0], Grid):
        raise InputError(f"{DECLARATION.name}: {'; '.join(have) or 'nothing'}; expected one grid over X, Y and Z")
    if not np.isfinite(grids[0].values[:, :3]).all():
        raise InputError(
            f"{DECLARATION.name}: the grid has gaps that the data do not determine; expected a value everywhere"
        )
    _ask_even(DECLARATION.name, grids[0].nodes)
    return grids[0]


def _ask_even(where: str, nodes: Sequence[np.ndarray]) -> None:
    for axis, line in zip(LINEAR_AXES, nodes, strict=True):
        steps = np.diff(line)
        if len(steps) == 0 or np.ptp(steps) > _EVEN * steps[0]:
            found = ", ".join(f"{v:g}" for v in line[:4])
            raise InputError(
                f"{where}: positions of {axis} are {found} …; expected equal distances, as with `max_points`"
            )


def _directions(machine: Machine) -> np.ndarray:
    """Motion of the functional point per mm of X, Y and Z, columns, with the rotary axes at 0."""
    for axis in LINEAR_AXES:
        machine.index(axis)
    found = axis_directions(machine, np.zeros((1, len(machine.axes))))[0]
    return np.asarray(found[:, [machine.index(a) for a in LINEAR_AXES]])


def _along_axes(machine: Machine, deviation: np.ndarray) -> np.ndarray:
    """Deviations along X, Y and Z, (n, 3), of deviations in the machine frame, (n, 3) [mm]."""
    return np.asarray(np.linalg.solve(_directions(machine), deviation.T).T)


def _notes(grid: Grid) -> tuple[str, ...]:
    turn = float(np.nanmax(np.abs(grid.values[:, 3:]), initial=0.0))
    at = ", ".join(f"{v:g}" for v in grid.reference)
    if turn == 0.0:
        return grid.notes
    return (
        *grid.notes,
        f"right for the tool vector {at} mm: the control adds no lever arm, so that a tool 100 mm longer is off by up to "
        f"{1e5 * turn:.3g} µm",
    )


FANUC_3D = Fanuc3D()
