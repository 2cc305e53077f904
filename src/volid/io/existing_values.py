"""What an existing compensation expects and does at given positions, as a table."""

from __future__ import annotations

import numpy as np

from volid.controllers.existing.forms import expected_point
from volid.controllers.existing.reading import ExistingCompensation
from volid.io.campaign.sets import TOOL_COLUMNS
from volid.io.functions_csv import Points, Sheet

EXPECTED = ("ex", "ey", "ez")
DIGITS = 9  # decimal places, mm or degrees: files of controls do not hold more


def values_sheet(found: ExistingCompensation, points: Points) -> Sheet:
    """Expected deviation of the functional point and correction of every axis at given positions.

    Columns: those of the points; `ex, ey, ez`, the deviation that the control expects, actual - nominal, machine frame [mm]; and
    `correction_X`, … for every axis of the machine, what the control adds to its command [mm or °].

    Raises `InputError` where rotations act through a tool vector and the points have none.
    """
    machine = found.machine
    tool = points.tool if TOOL_COLUMNS[0] in points.columns else None
    expected = expected_point(found.compensation, machine, points.positions, tool, points.directions)
    moves = found.control().command(points.positions, tool, points.directions) - points.positions
    header = {
        "values": "ex, ey, ez: deviation that the control expects, actual - nominal, machine frame, mm; correction_…: what it "
        "adds to the command of an axis, mm or degrees",
        "directions": "a column X_dir, … says how an axis moves: 1, -1, or 0 for the mean of both",
        "existing compensation": found.words,
        "machine": f"{machine.name} [{machine.structure.strip().strip('[]')}]",
    }
    header |= {f"assumed {i}": text for i, text in enumerate(found.assumed, start=1)}
    columns = (*points.columns, *EXPECTED, *(f"correction_{a}" for a in machine.letters))
    numbers = np.column_stack([expected, moves]) + 0.0
    rows = [
        (*given, *values)
        for given, values in zip(zip(*points.columns.values(), strict=True), numbers.tolist(), strict=True)
    ]
    digits = dict.fromkeys(columns[len(points.columns) :], DIGITS)
    return Sheet(header, columns, rows, digits, short=True)
