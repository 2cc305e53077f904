"""A quick check in words and as plain data. µm and µrad in the text, mm and rad elsewhere."""

from __future__ import annotations

from typing import Any

import numpy as np

from volid.model.iso230 import describe, parse
from volid.report.text.basics import bullets, paragraph, table, unit_of
from volid.report.text.comparison import place_words, probability_cell, size_cell
from volid.validation.check import Check, Finding
from volid.validation.search import LEVEL
from volid.validation.solutions.function_changes import POWER


def check_lines(found: Check) -> list[str]:
    """The verdict, what changed, what would have been found."""
    lines = paragraph(_verdict(found))
    lines += paragraph(
        f"chi-square {found.chi_square:.1f} of the new readings against their prediction, {found.degrees_of_freedom} degrees of "
        f"freedom, probability {probability_cell(found.probability)}",
        "test",
    )
    if found.findings:
        lines += paragraph(f"probability of what these leave: {probability_cell(found.rest)}", "rest")
    lines += ["", *_power_table(found.smallest_found)]
    return [*lines, *bullets("notes", found.notes)]


def check_data(found: Check) -> dict[str, Any]:
    """For JSON, lengths in mm, rotations in rad."""
    return {
        "changed": found.changed,
        "chi_square": found.chi_square,
        "degrees_of_freedom": found.degrees_of_freedom,
        "probability": found.probability,
        "findings": [
            {
                "name": f.name,
                "what": f.words,
                "size": f.size,
                "u": f.u,
                "unit": f.unit,
                "at": f.at,
                "probability": f.probability,
                "is_machine": f.is_machine,
                "rivals": f.rivals,
            }
            for f in found.findings
        ],
        "rest": found.rest,
        "smallest_found": {name: size if np.isfinite(size) else None for name, size in found.smallest_found.items()},
        "left_out": found.left_out,
        "notes": found.notes,
    }


def check_attention(found: Check) -> list[str]:
    """What changed, one sentence each."""
    if found.changed and not found.findings:
        return [_verdict(found)]
    return [*(finding_words(f) for f in found.findings), *_unexplained(found)]


def _unexplained(found: Check) -> list[str]:
    """A sentence where what was found leaves more than chance does."""
    if not found.findings or not found.rest <= 0.5 * LEVEL:
        return []
    chance = probability_cell(found.rest)
    return [
        f"this does not explain all that the new readings show (probability of the rest {chance}); measure the machine anew"
    ]


def finding_words(finding: Finding) -> str:
    """One finding, with its rivals."""
    size = ""
    if np.isfinite(finding.size):
        unit = "µm/m" if finding.unit == "mm/mm" else unit_of(finding.unit)
        cells = [size_cell(v, "rad" if finding.unit == "mm/mm" else finding.unit) for v in (finding.size, finding.u)]
        size = f" by {cells[0]} {unit} (u {cells[1]} {unit})"
    place = f" at {place_words(finding.name, finding.at)}" if np.isfinite(finding.at) else ""
    rivals = f"; these readings cannot tell it from {', '.join(finding.rivals)}" if finding.rivals else ""
    verb = "changed" if finding.is_machine else "differs"
    return f"{finding.name} {verb}{size}{place} ({finding.words}){rivals}"


def _verdict(found: Check) -> str:
    if not found.changed:
        return (
            "no change found: the new readings agree with the old solution; they see a single change from the sizes below on, "
            "and not several that cancel in these places"
        )
    if not found.findings:
        return "something has changed, and no single function, constant, tool or scale explains it; measure the machine anew"
    return f"changed: {'; '.join([*(finding_words(f) for f in found.findings), *_unexplained(found)])}"


def _power_table(smallest: dict[str, float]) -> list[str]:
    rows = []
    for name, size in smallest.items():
        is_scale = name.startswith("scale of")
        unit = "mm" if is_scale or not parse(name).is_rotation else "rad"
        words = "change over its range" if is_scale else describe(name)
        shown = size_cell(size, unit) if np.isfinite(size) else "not seen"
        rows.append([name, shown, unit_of(unit) if np.isfinite(size) else "", words])
    header = ["", f"found with {100 * POWER:.0f} %", "unit", "meaning"]
    return table(header, rows, right=2)
