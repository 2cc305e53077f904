"""An existing compensation in words and as plain data: what the files hold, in which sense, and what is odd about them."""

from __future__ import annotations

from pathlib import PurePosixPath
from typing import Any

import numpy as np

from volid.compensation.active import reference_words
from volid.compensation.grids.grid import AnyGrid
from volid.controllers.base import POSITION
from volid.controllers.existing.looks import Look, beyond, looks, oddities
from volid.controllers.existing.reading import ExistingCompensation
from volid.report.text.basics import bullets, micro, paragraph, table, unit_of

_SENSES = {
    "error": "the file holds errors (actual - nominal)",
    "compensation": "the file holds what is added to the command, minus the error",
    POSITION: "the file holds actual positions (or, by its option, what is added to the command)",
}
HERE = "values below are errors, actual - nominal; the control moves each axis by minus that"


def inspection_lines(found: ExistingCompensation, name: str) -> list[str]:
    """Files, control, sense, tables, grids, and what the control does where they end."""
    lines = paragraph(", ".join(PurePosixPath(n).name for n in found.files), "files")
    lines += paragraph(f"{_title(found)}; sha256 {found.sha256[:12]}", "control")
    lines += paragraph(f"{name}; types {', '.join(found.types) or 'none'}", "machine")
    lines += paragraph("; ".join([*_sense(found), HERE]), "sense")
    for text in found.assumed:
        lines += paragraph(text, "assumed")
    lines += [""]
    if rows := [_row(look) for look in looks(found)]:
        lines += table(["table", "points", "from", "to", "step", "largest", "at", "B mean", "B max", ""], rows, right=1)
    lines += [line for g in found.compensation.grids for line in paragraph(_grid_words(g))]
    return [*lines, *bullets("beyond the tables", beyond(found)), *bullets("notes", _notes(found))]


def _notes(found: ExistingCompensation) -> list[str]:
    return list(dict.fromkeys(n for t in _parts(found) for n in t.notes))


def _parts(found: ExistingCompensation) -> list[Any]:
    made = found.compensation
    return [*made.tables, *made.axis_tables, *made.grids]


def _title(found: ExistingCompensation) -> str:
    declared = found.declaration
    return "tables and grids of volid" if declared is None else f"{declared.name}, {declared.title}"


def _sense(found: ExistingCompensation) -> list[str]:
    """In which sense the file's values are."""
    declared = found.declaration
    if declared is None:
        return []
    if found.sign is not None:
        return [f"{_SENSES[found.sign]}, as you state it: public sources leave it open"]
    return [_SENSES.get(declared.sign, declared.sign)]


def _row(look: Look) -> list[str]:
    mean, most = look.reversal
    step = "one value" if len(look.positions) == 1 else "free" if look.step is None else f"{look.step:g}"
    values = [micro(v, look.unit, 2) for v in (look.largest, mean, most)]
    ends = [f"{v:g}" for v in (look.positions[0], look.positions[-1])]
    named = look.name if look.source in ("", look.name) else f"{look.name} ({look.source})"
    return [named, str(len(look.positions)), *ends, step, values[0], f"{look.at:g}", *values[1:], unit_of(look.unit)]


def _grid_words(grid: AnyGrid) -> str:
    size = np.linalg.norm(grid.values[:, :3], axis=1)
    i = int(np.nanargmax(size)) if np.isfinite(size).any() else 0
    at = ", ".join(f"{a} {v:g}" for a, v in zip(grid.axes, grid.positions[i], strict=True))
    spans = "; ".join(f"{a} {n[0]:g} … {n[-1]:g} ({len(n)})" for a, n in zip(grid.axes, grid.nodes, strict=True))
    turns = f", rotations up to {1e6 * np.nanmax(np.abs(grid.values[:, 3:])):.1f} µrad" if _turned(grid) else ""
    return (
        f"{grid.type} grid ({grid.side}), {len(grid.positions)} nodes: {spans}; {reference_words(grid)}; largest "
        f"{1e3 * size[i]:.2f} µm at {at}{turns}"
    )


def _turned(grid: AnyGrid) -> bool:
    return bool(np.nan_to_num(grid.values[:, 3:]).any())


def inspection_data(found: ExistingCompensation) -> dict[str, Any]:
    """The same for JSON; mm, rad and degrees."""
    return {
        "files": [PurePosixPath(n).name for n in found.files],
        "sha256": found.sha256,
        "cnc": found.cnc,
        "sign": found.sign,
        "types": list(found.types),
        "assumed": list(found.assumed),
        "tables": [_table_data(look) for look in looks(found)],
        "grids": [_grid_data(g) for g in found.compensation.grids],
        "beyond": beyond(found),
        "notes": _notes(found),
        "attention": oddities(found),
    }


def _table_data(look: Look) -> dict[str, Any]:
    mean, most = look.reversal
    return {
        "table": look.name,
        "axis": look.argument,
        "functions": look.source,
        "unit": look.unit,
        "positions": look.positions.tolist(),
        "forward": look.forward.tolist(),
        "reverse": look.reverse.tolist(),
        "largest": look.largest,
        "at": look.at,
        "reversal_mean": mean,
        "reversal_largest": most,
    }


def _grid_data(grid: AnyGrid) -> dict[str, Any]:
    return {
        "type": grid.type,
        "side": grid.side,
        "nodes": {a: n.tolist() for a, n in zip(grid.axes, grid.nodes, strict=True)},
        "reference": grid.reference.tolist(),
        "largest": float(np.nanmax(np.linalg.norm(grid.values[:, :3], axis=1))),
    }
