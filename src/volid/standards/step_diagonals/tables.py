"""Compensation tables from the nine functions: positioning, straightness and squareness of each axis in three tables.

The straightness tables hold squareness as their slope (ISO/TR 16907, L-SQU), and both hold what rotations leaked into the nine
functions. A control that applies them makes the displacements along the four diagonals right, and the volume as far as the leak
is small.
"""

from __future__ import annotations

import numpy as np

from volid.compensation.tables.error_table import MODEL, ErrorTable
from volid.model.iso230 import LINEAR_AXES
from volid.standards.step_diagonals.separation import NineFunctions

TYPES = ("L-POS", "L-STR", "L-SQU")
NOTE = (
    "separated from sequential step diagonals: rotations of the axes and tilts of the mirror leaked into these values, and the "
    "diagonals cannot tell how much"
)


def tables_of(nine: NineFunctions) -> tuple[ErrorTable, ...]:
    """Nine tables of error values, EXX, EYX, EZX, EXY, …, alike in both approach directions; 0 at the low end of each axis.

    >>> import volid
    >>> from volid.planning.diagonals import step_diagonals
    >>> from volid.standards.step_diagonals.separation import separate
    >>> from volid.standards.step_diagonals.steps import steps_of
    >>> plan = step_diagonals(volid.load_machine("models/wYXbZt_vertical.toml"), 10)
    >>> tables = tables_of(separate(steps_of(plan.sets[0], plan)))
    >>> [table.function for table in tables][:4], tables[0].positions[:2].tolist()
    (['EXX', 'EYX', 'EZX', 'EXY'], [0.0, 100.0])
    """
    return tuple(_table(nine, a, c) for a in range(len(LINEAR_AXES)) for c in range(3))


def _table(nine: NineFunctions, axis: int, component: int) -> ErrorTable:
    positions, letter = nine.steps.nodes[axis], LINEAR_AXES[axis]
    values, u = nine.values[axis][:, component], nine.u[axis][:, component]
    tool = ", ".join(f"{t:g}" for t in nine.steps.observations.tool[0])
    return ErrorTable(
        type=" + ".join(TYPES),
        function=f"E{LINEAR_AXES[component]}{letter}",
        positions=positions,
        forward=values,
        reverse=values,
        u=np.stack([u, u], axis=1),
        outside=np.zeros(len(positions), dtype=bool),
        applied=MODEL,
        interpolation=np.nan,
        basis={"line": "none: separated from four body diagonals", "tool vector": f"{tool} mm"},
        zero=f"{letter} = {positions[0]:g} mm",
        datum="directions of the beams along the four body diagonals",
        notes=(NOTE,),
    )
