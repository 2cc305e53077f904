"""Plain text for terminals: aligned tables, wrapped paragraphs, numbers in µm and µrad."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

from volid.exceptions import cut, shown

WIDTH = 100
_MICRO = {"mm": (1e3, "µm"), "rad": (1e6, "µrad")}


def unit_of(unit: str) -> str:
    """The unit of a report: µm for mm, µrad for rad, others as they are."""
    return _MICRO.get(unit, (1.0, unit))[1]


def scale_of(unit: str) -> float:
    """What a number is multiplied by for a report: 1000 for mm (µm), a million for rad (µrad), 1 for others."""
    return _MICRO.get(unit, (1.0, unit))[0]


def micro(value: float | None, unit: str, digits: int) -> str:
    """A number of mm or rad in µm or µrad with so many decimal places; "n.d." (not determined) for None.

    >>> micro(-0.01234, "mm", 1)
    '-12.3'
    """
    if value is None:
        return "n.d."
    return f"{round(value * _MICRO.get(unit, (1.0, unit))[0], digits) + 0.0:.{digits}f}"


def probability_words(value: float) -> str:
    """A probability with as many digits as matter.

    >>> probability_words(0.8847), probability_words(4.2e-5), probability_words(1e-135)
    ('0.885', '4e-05', '< 1e-09')
    """
    return f"{value:.3f}" if value >= 1e-3 else f"{value:.0e}" if value >= 1e-9 else "< 1e-09"


def vector(values: Sequence[float]) -> str:
    """A vector as people write it: (0, 0, -150)."""
    return "(" + ", ".join(f"{v:g}" for v in values) + ")"


def table(header: Sequence[str], rows: Sequence[Sequence[str]], left: int = 1, right: int = 0) -> list[str]:
    """Lines of a table, columns two blanks apart; the first `left` and last `right` columns left justified.

    What names in cells hold is shown escaped, and cut to 80 characters.
    """
    cells = [[cut(shown(cell)) for cell in row] for row in (header, *rows)]
    widths = [max(len(row[i]) for row in cells) for i in range(len(header))]
    flush = [i < left or i >= len(header) - right for i in range(len(header))]
    return [
        "  ".join(
            cell.ljust(w) if is_left else cell.rjust(w) for cell, w, is_left in zip(row, widths, flush, strict=True)
        ).rstrip()
        for row in cells
    ]


def paragraph(text: str, label: str = "", indent: int = 10) -> list[str]:
    """Wrapped lines, the first after `label`, the others indented as far."""
    first = label.ljust(indent) if label else ""
    return _wrap(text, first, " " * len(first))


def bullets(title: str, texts: Sequence[str]) -> list[str]:
    """A title and one wrapped entry per text; nothing when there is none."""
    if not texts:
        return []
    lines = [f"{title}:"]
    for text in texts:
        lines += _wrap(text, "- ", "  ")
    return lines


def _wrap(text: str, first: str, others: str) -> list[str]:
    return textwrap.wrap(
        shown(text),
        WIDTH,
        initial_indent=first,
        subsequent_indent=others,
        break_long_words=False,
        break_on_hyphens=False,
    )
