"""The workbook of a solution, and its public function."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from volid.compensation.residual.forecast import Forecast
from volid.exceptions import InputError
from volid.fitting.solution import Solution
from volid.io.basics.targets import find_target
from volid.report.language import Texts
from volid.report.text.summary import summary_data
from volid.report.workbook.readings import readings_sheet
from volid.report.workbook.record import campaign_sheet, open_sheet, provenance_sheet, result_sheet, sets_sheet
from volid.report.workbook.results import (
    budget_sheet,
    forecast_sheet,
    function_sheets,
    location_sheet,
    squareness_sheet,
    volume_sheet,
)
from volid.report.workbook.table import Table
from volid.report.workbook.write import write_workbook


def save_workbook(
    solution: Solution,
    path: str | Path,
    overwrite: bool = False,
    *,
    tool: Sequence[float] | None = None,
    forecast: Forecast | None = None,
    source: str = "",
    lang: str = "en",
) -> None:
    """Write a solution as an Excel workbook, one sheet per table.

    The sheets: result, campaign record, sets, squareness, location errors, error motions (one sheet per axis, with charts),
    working volume, compensation types (where a forecast is given), residuals of every reading, budget, what is not determined,
    provenance. Lengths are in µm, rotations in µrad, positions in mm or degrees, U has k = 2; the heading of every column says
    its unit, or the column "unit" beside it where rows differ. Numbers keep 16 digits; two digits of U are shown. A cell
    is blank where the data do not determine the value. Texts are never run as formulas.

    Args:
        solution: As `volid.fit` or `volid.load_solution` gives it.
        path: The file, such as "result.xlsx".
        overwrite: Whether an existing file may be replaced.
        tool: Tool vector of the volumetric numbers, shape (3,) [mm]; None: the one of most readings.
        forecast: What compensation types leave, as `volid.forecast` gives it.
        source: Name of the solution's file, whose hash is stated; "" for none.
        lang: Language of headings, "en" or "de".

    Raises:
        InputError: the numbers of the solution follow from a mistake in the campaign, which is named.
        OutputError: the file exists, or cannot be written.

    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/published_positioning/campaign.toml"))
    >>> volid.save_workbook(solution, getfixture("tmp_path") / "result.xlsx")
    """
    if reason := solution.adequacy.barrier:
        raise InputError(f"no workbook is made of this solution: {reason}. Mend the campaign, and fit again")
    find_target(path, overwrite)  # refused now, not after the work
    tables = list(_sheets(solution, Texts(lang), tool, forecast, source))
    write_workbook(path, tables, solution.machine.name, overwrite)


def _sheets(
    solution: Solution, texts: Texts, tool: Sequence[float] | None, forecast: Forecast | None, source: str
) -> Iterator[Table]:
    summary = summary_data(solution, tool)
    yield result_sheet(solution, summary, texts)
    yield campaign_sheet(solution, texts)
    yield sets_sheet(summary, texts)
    if summary["squareness"]:
        yield squareness_sheet(summary, texts)
    if summary["location_errors"] or summary["tool_frame"]:
        yield location_sheet(summary, texts)
    yield from function_sheets(solution, texts)
    yield volume_sheet(solution, summary, texts)
    if forecast is not None:
        yield forecast_sheet(forecast, texts)
    yield budget_sheet(solution, summary["tool"], texts)
    yield open_sheet(solution, summary, texts)
    yield readings_sheet(solution, texts)
    yield provenance_sheet(solution, source, texts)
