"""A table before it becomes a sheet: columns with their units, rows of numbers and texts, and what is drawn of them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

from volid.report.text.basics import scale_of, unit_of

TEXT, NUMBER = 28, 13  # widths of columns, in characters


@dataclass(frozen=True)
class Column:
    """A column of a sheet.

    Args:
        title: Its heading, in the language of the workbook.
        unit: Unit of its numbers, "" for none.
        width: At least so many characters.
        spread: Which number of a row, as its place counted from this column or as a function of the row, is the uncertainty of
            this one, so that two of its digits are shown; None: as a spreadsheet shows numbers.
    """

    title: str
    unit: str = ""
    width: int = NUMBER
    spread: int | Callable[[Sequence[Any]], Any] | None = None

    @property
    def heading(self) -> str:
        """Title and unit: "U [µm]"."""
        return f"{self.title} [{self.unit}]" if self.unit else self.title

    @property
    def wide(self) -> int:
        """Its width, in which no word of the heading is broken."""
        return max(self.width, 4 + max(map(len, self.heading.split())))


@dataclass(frozen=True)
class Chart:
    """Lines over a position: each a title with the numbers of the columns of x, y and U.

    Args:
        title: What is drawn.
        x: Title of the horizontal axis, with its unit.
        y: Title of the vertical axis, with its unit.
        lines: Title, column of x, column of y, column of U.
        reach: Lowest and highest x.
    """

    title: str
    x: str
    y: str
    lines: Sequence[tuple[str, int, int, int]]
    reach: tuple[float, float]


@dataclass(frozen=True)
class Table:
    """A sheet before it is written.

    Args:
        name: Name of the sheet.
        columns: Its columns.
        rows: Cells, as many a row as there are columns: numbers, texts; None or NaN where there is none.
        charts: What is drawn beside the table.
        notes: Sentences below the table.
    """

    name: str
    columns: Sequence[Column]
    rows: Iterable[Sequence[Any]]
    charts: Sequence[Chart] = field(default=())
    notes: Sequence[str] = field(default=())


def micro_of(value: float | None, unit: str) -> float | None:
    """A number of mm or rad as one of µm or µrad, others as they are; None stays None.

    >>> micro_of(0.0125, "mm"), micro_of(None, "rad")
    (12.5, None)
    """
    return None if value is None else value * scale_of(unit)


def micro_row(row: dict[str, Any], *keys: str) -> list[Any]:
    """Numbers of an entry of a summary in µm or µrad, followed by that unit."""
    return [*(micro_of(row[key], row["unit"]) for key in keys), unit_of(row["unit"])]
