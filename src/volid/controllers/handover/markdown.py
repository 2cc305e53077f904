"""Texts that print well: headings, numbered steps, tables of Markdown. What names and files hold is shown escaped."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from volid.exceptions import cut, shown

LONGEST = 300  # characters of a cell


def text_of(lines: Iterable[str]) -> str:
    """The lines as one text, without two blank lines on end; a line stays one, whatever names in it hold.

    >>> text_of(["a", "", "", "b"])
    'a\\n\\nb\\n'
    """
    found: list[str] = []
    for line in (shown(x).replace("\n", " ") for x in lines):
        if line or (found and found[-1]):
            found.append(line)
    return "\n".join(found).rstrip("\n") + "\n"


def heading(text: str, level: int = 2) -> list[str]:
    """A heading and a blank line, with a blank line before all but the first level."""
    return [*([""] if level > 1 else []), f"{'#' * level} {shown(text)}", ""]


def steps(texts: Iterable[str]) -> list[str]:
    """Numbered steps, each with a box to tick.

    >>> steps(["Copy the file."])
    ['1. [ ] Copy the file.']
    """
    return [f"{i}. [ ] {shown(t)}" for i, t in enumerate(texts, start=1)]


def bullets(texts: Iterable[str]) -> list[str]:
    """One line for each text."""
    return [f"- {shown(t)}" for t in texts]


def table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """A table, its columns as wide as their longest cell so that it reads well as plain text.

    >>> table(["axis", "moves"], [["X", "-0.0100"]])
    ['| axis | moves   |', '|------|---------|', '| X    | -0.0100 |']
    """
    cells = [[_cell(c) for c in row] for row in (header, *rows)]
    widths = [max(len(row[i]) for row in cells) for i in range(len(header))]
    lines = ["| " + " | ".join(c.ljust(w) for c, w in zip(row, widths, strict=True)) + " |" for row in cells]
    return [lines[0], "|" + "|".join("-" * (w + 2) for w in widths) + "|", *lines[1:]]


def _cell(text: str) -> str:
    return cut(shown(text), LONGEST).replace("|", "/").replace("\n", " ")
