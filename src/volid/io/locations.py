"""The table of location errors as CSV: axis average line and parameter (tool relative to workpiece), with u."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from volid.fitting.location_errors import LocationError
from volid.fitting.solution import Solution
from volid.io.functions_csv import Sheet, source_lines
from volid.model.axis_lines import PARAMETER

COLUMNS = ("location_error", "axis", "relative_to", "parameter", "axis_line", "u", "remark")


def locations_sheet(rows: Sequence[LocationError], solution: Solution, source: str | Path | None = None) -> Sheet:
    """One row per location error of `location_errors`; NaN, an empty cell, where the data do not determine it."""
    meaning = {
        "values": "location errors of rotary axes (ISO 230-1); positions mm, orientations rad",
        "parameter": f"{PARAMETER}: minus axis_line for an axis that carries the workpiece",
        "axis_line": "what ISO 230-1 means by the symbol: displacement or tilt of the axis average line, machine frame "
        "directions, at the axis's nominal point",
        "u": "standard uncertainty (k = 1) of both; an empty cell is not determined by the data",
    }
    table = [(r.symbol, r.axis, r.relative_to, r.parameter, r.line, r.u, r.remark) for r in rows]
    return Sheet(meaning | source_lines(solution, source), COLUMNS, table)
