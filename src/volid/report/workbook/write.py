"""Tables as sheets of an Excel workbook (xlsxwriter).

Texts are written as texts, so that none is run as a formula or followed as a link; numbers as numbers, with as many decimal
places shown as two digits of U have. The first row is the heading; it stays in sight, is repeated on every printed page, and has
filters.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from itertools import islice
from pathlib import Path
from typing import Any

from volid.exceptions import cut, shown
from volid.io.basics.atomic import atomic_output
from volid.report.plot.palette import FAINT, NEUTRAL, SERIES
from volid.report.workbook.table import Chart, Column, Table

LONGEST = 32000  # characters of a cell; the format takes 32767
ROWS = 1_048_575  # of a sheet, its heading aside
DECIMALS, MOST_DECIMALS = 2, 4  # where the uncertainty tells none, and at most: 0.1 nm
PLAIN = "General"
SHORT = 80  # rows that fit on a page with charts
LINE = 15.0  # height of a line of text, points
_TOGETHER = {"strings_to_formulas": False, "strings_to_urls": False, "strings_to_numbers": False}
_DASHES = ("solid", "dash", "dash_dot", "round_dot", "long_dash", "square_dot", "solid")


def write_workbook(path: str | Path, tables: Sequence[Table], title: str, overwrite: bool = False) -> None:
    """Write the tables as sheets; the file appears completely or not at all. Raises `OutputError`."""
    from xlsxwriter import Workbook

    with atomic_output(path, overwrite) as temporary:
        book = Workbook(str(temporary), {"constant_memory": True, **_TOGETHER})
        book.set_properties({"title": cut(shown(title), 200), "comments": "volid"})
        formats = Formats(book)
        for table in tables:
            _write_table(book, table, formats)
        book.close()


def decimals_of(u: float | None) -> int:
    """Decimal places that show two digits of an uncertainty, at most `MOST_DECIMALS`; `DECIMALS` where it tells none.

    >>> decimals_of(0.38), decimals_of(12.0), decimals_of(1.0), decimals_of(None)
    (2, 0, 1, 2)
    """
    if u is None or not math.isfinite(u) or u < 0.1**MOST_DECIMALS:  # below: rounding
        return DECIMALS
    return min(max(1 - math.floor(math.log10(u)), 0), MOST_DECIMALS)


class Formats:
    """Formats of a workbook, each made once."""

    def __init__(self, book: Any) -> None:
        self._book = book
        self._made: dict[str, Any] = {}
        self.heading = book.add_format(
            {"bold": True, "text_wrap": True, "valign": "top", "bottom": 1, "bg_color": FAINT}
        )
        self.text = book.add_format({"valign": "top", "text_wrap": True, "indent": 1})

    def number(self, decimals: int | None) -> Any:
        """The format of a number with so many decimal places; None: as it is."""
        code = PLAIN if decimals is None else "0" if decimals == 0 else f"0.{'0' * decimals}"
        if code not in self._made:
            self._made[code] = self._book.add_format({"num_format": code, "valign": "top"})
        return self._made[code]


def _write_table(book: Any, table: Table, formats: Formats) -> None:
    """The sheet of a table, and others beside it where it has more rows than a sheet."""
    rows, number = iter(table.rows), 1
    part = list(islice(rows, ROWS))
    while part or number == 1:
        name = table.name if number == 1 else f"{table.name} {number}"
        sheet = book.add_worksheet(name)
        _prepare(sheet, table.columns, len(part), formats)
        for i, row in enumerate(part, start=1):
            _write_row(sheet, i, table.columns, row, formats)
        for i, note in enumerate(table.notes if number == 1 else (), start=len(part) + 2):
            sheet.write_string(i, 0, cut(shown(note), LONGEST))  # goes on over the blank cells beside it
        if number == 1 and table.charts:
            _add_charts(book, sheet, table, len(part))
            sheet.fit_to_pages(1, 1 if len(part) < SHORT else 0)
        part, number = list(islice(rows, ROWS)), number + 1


def _prepare(sheet: Any, columns: Sequence[Column], n_rows: int, formats: Formats) -> None:
    """Heading, widths, filters, what stays in sight, and how it is printed."""
    sheet.set_row(0, LINE * max(_lines(column.heading, column.wide) for column in columns))
    for j, column in enumerate(columns):
        sheet.set_column(j, j, column.wide)
        sheet.write_string(0, j, shown(column.heading), formats.heading)
    sheet.freeze_panes(1, 0)
    sheet.autofilter(0, 0, max(n_rows, 1), len(columns) - 1)
    sheet.set_landscape()
    sheet.set_paper(9)  # A4
    sheet.fit_to_pages(1, 0)
    sheet.repeat_rows(0)
    sheet.set_footer("&L&A&R&P / &N")


def _lines(text: str, width: int) -> int:
    """Lines that a text takes in a column of that width, blanks at the ends of lines reckoned with."""
    return len(textwrap.wrap(text, max(width - 3, 4))) or 1


def _write_row(sheet: Any, i: int, columns: Sequence[Column], row: Sequence[Any], formats: Formats) -> None:
    texts = [(column, cell) for column, cell in zip(columns, row, strict=True) if isinstance(cell, str)]
    lines = max((_lines(cell, column.wide) for column, cell in texts if len(cell) > column.wide - 3), default=1)
    if lines > 1:
        sheet.set_row(i, LINE * min(lines, 25))
    for j, (column, cell) in enumerate(zip(columns, row, strict=True)):
        if isinstance(cell, str):
            if cell:
                sheet.write_string(i, j, cut(shown(cell), LONGEST), formats.text)
        elif isinstance(cell, bool):
            sheet.write_boolean(i, j, cell, formats.number(None))
        elif cell is not None and math.isfinite(cell):
            sheet.write_number(i, j, cell + 0.0, formats.number(_decimals(column, row, j)))


def _decimals(column: Column, row: Sequence[Any], j: int) -> int | None:
    """Decimal places of the number in column `j` of a row; None: as a spreadsheet shows it."""
    if column.spread is None:
        return None
    return decimals_of(column.spread(row) if callable(column.spread) else row[j + column.spread])


def _add_charts(book: Any, sheet: Any, table: Table, n_rows: int) -> None:
    """Charts below the table, beside each other."""
    for number, chart in enumerate(table.charts):
        drawn = book.add_chart({"type": "scatter", "subtype": "straight_with_markers"})
        for line, (title, *columns) in enumerate(chart.lines):
            drawn.add_series(_series(table.name, title, columns, n_rows, line))
        _label(drawn, chart)
        sheet.insert_chart(n_rows + 3 + len(table.notes), 6 * number, drawn)


def _series(sheet: str, title: str, columns: Sequence[int], n_rows: int, number: int) -> dict[str, Any]:
    from xlsxwriter.utility import quote_sheetname, xl_range_abs

    x, y, u = columns
    colour, dash = SERIES[number % len(SERIES)], _DASHES[number % len(_DASHES)]
    bars = f"={quote_sheetname(sheet)}!{xl_range_abs(1, u, n_rows, u)}"
    return {
        "name": title,
        "categories": [sheet, 1, x, n_rows, x],
        "values": [sheet, 1, y, n_rows, y],
        "line": {"color": colour, "width": 1.25, "dash_type": dash},
        "marker": {"type": "automatic", "size": 4, "fill": {"color": colour}, "border": {"color": colour}},
        "y_error_bars": {"type": "custom", "plus_values": bars, "minus_values": bars, "line": {"color": colour}},
    }


def _label(drawn: Any, chart: Chart) -> None:
    font, line = {"size": 9, "bold": False}, {"color": FAINT}
    drawn.set_title({"name": chart.title, "name_font": {"size": 11, "bold": False}})
    drawn.set_x_axis(
        {
            "name": chart.x,
            "name_font": font,
            "label_position": "low",
            "line": {"color": NEUTRAL},
            "min": chart.reach[0],
            "max": chart.reach[1],
        }
    )
    drawn.set_y_axis(
        {
            "name": chart.y,
            "name_font": font,
            "label_position": "low",
            "major_gridlines": {"visible": True, "line": line},
        }
    )
    drawn.set_legend({"position": "bottom"})
    drawn.show_blanks_as("span")
    drawn.set_size({"width": 560, "height": 400})
