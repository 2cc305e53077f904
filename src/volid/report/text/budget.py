"""The uncertainty budget as text for a terminal: µm and µrad, one paragraph per output, largest contribution first."""

from __future__ import annotations

import math
from collections.abc import Iterable

from volid.model.axis_lines import AXIS_LINE, is_of_a_line
from volid.report.text.basics import micro, paragraph, unit_of
from volid.uncertainty.budget import Line
from volid.uncertainty.lack_of_fit import LackOfFit

NEGLIGIBLE = 5e-4  # of the variance: 0.0 % in print


def format_budget(lines: Iterable[Line], lack_of_fit: LackOfFit) -> str:
    """The text of a budget. A function of position appears once, as its RMS over the travel; `lack_of_fit` is stated below."""
    outputs: dict[str, list[Line]] = {}
    for line in lines:
        outputs.setdefault(line.output, []).append(line)
    width = max((len(name) for name in outputs), default=0) + 2
    text = ["standard uncertainty u, k = 1, and what it is made of (share of u²); functions: RMS over the travel", ""]
    for name, lines_of_output in outputs.items():
        text += _entry(name, lines_of_output, width)
    text += [f"location errors: {AXIS_LINE}"] if any(map(is_of_a_line, outputs)) else []
    text += ["", *paragraph(str(lack_of_fit), "lack of fit", 13)]
    return "\n".join(text)


def _entry(name: str, lines: list[Line], width: int) -> list[str]:
    places = len({line.position for line in lines if not math.isnan(line.position)}) or 1
    squares: dict[str, float] = {}
    for line in lines:
        squares[line.source] = squares.get(line.source, 0.0) + line.contribution**2 / places
    total = sum(squares.values())
    unit, parts = lines[0].unit, []
    for source, square in sorted(squares.items(), key=lambda item: -item[1]):
        share = square / total if total > 0.0 else 0.0
        if share >= NEGLIGIBLE:
            parts.append(f"{source} {micro(math.sqrt(square), unit, 3)} ({100.0 * share:.1f} %)")
    label = f"{name.ljust(width)}{micro(math.sqrt(total), unit, 3):>9} {unit_of(unit):4}  "
    return paragraph("; ".join(parts) or "fixed by the datum", label, len(label))
