"""The workbook of a solution, and its public function."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from volid.exceptions import InputError
from volid.fitting.solution import Solution
from volid.io.basics.targets import find_target
from volid.report.contents.contents import Contents, gather
from volid.report.language import Texts
from volid.report.workbook.readings import readings_sheet
from volid.report.workbook.record import campaign_sheet, open_sheet, provenance_sheet, result_sheet, sets_sheet
from volid.report.workbook.results import (
    budget_sheet,
    forecast_sheet,
    function_sheets,
    limits_sheet,
    location_sheet,
    squareness_sheet,
    volume_sheet,
)
from volid.report.workbook.table import Table
from volid.report.workbook.write import write_workbook


def save_workbook(
    solution: Solution,
    path: str | Path,
    *,
    tool: Any = None,
    limits: str | Path | Mapping[str, Any] | None = None,
    lang: str = "en",
    overwrite: bool = False,
) -> None:
    """Write a solution as an Excel workbook, one sheet per table.

    The sheets: result, campaign record, sets, squareness, location errors, error motions (one sheet per axis, with charts),
    working volume, limits, compensation types, budget, what is not determined, residuals of every reading, provenance. Lengths
    are in µm, rotations in µrad, positions in mm or degrees, U has k = 2; the heading of every column says its unit, or the
    column "unit" beside it where rows differ. Numbers keep 16 digits; two digits of U are shown. A cell is blank where the data
    do not determine the value. Texts are never run as formulas.

    Args:
        solution: As `volid.fit` or `volid.load_solution` gives it.
        path: The file, such as "result.xlsx"; it appears completely or not at all.
        tool: Tool vector of the volumetric numbers, shape (3,) [mm]; None: the one of most readings.
        limits: Largest sizes allowed by symbol [mm, rad], as for `save_report`.
        lang: Language of headings, "en" or "de".
        overwrite: Whether an existing file may be replaced.

    Raises:
        InputError: the numbers of the solution follow from a mistake in the campaign, which is named; wrong limits.
        OutputError: the file exists, or cannot be written.

    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/published_positioning/campaign.toml"))
    >>> volid.save_workbook(solution, getfixture("tmp_path") / "result.xlsx")
    """
    find_target(path, overwrite)  # refused now, not after the work
    texts = Texts(lang)
    workbook_of(gather(solution, tool, limits=limits), path, texts, overwrite)


def workbook_of(contents: Contents, path: str | Path, texts: Texts, overwrite: bool = False) -> None:
    """Write the workbook of the contents of a report. Raises as `save_workbook` does."""
    if contents.barrier:
        raise InputError(f"no workbook is made of this solution: {contents.barrier}. Mend the campaign, and fit again")
    write_workbook(path, list(_sheets(contents, texts)), contents.solution.machine.name, overwrite)


def _sheets(contents: Contents, texts: Texts) -> Iterator[Table]:
    solution, summary = contents.solution, contents.summary
    yield result_sheet(contents, texts)
    yield campaign_sheet(contents, texts)
    yield sets_sheet(contents, texts)
    if summary["squareness"]:
        yield squareness_sheet(summary, texts)
    if summary["location_errors"] or summary["tool_frame"]:
        yield location_sheet(summary, texts)
    yield from function_sheets(solution, texts)
    yield volume_sheet(contents, texts)
    if contents.judged:
        yield limits_sheet(contents.evaluation, texts)
    if contents.outlook.forecast is not None:
        yield forecast_sheet(contents.outlook.forecast, texts)
    yield budget_sheet(solution, contents.tool, texts)
    yield open_sheet(solution, summary, texts)
    yield readings_sheet(solution, texts)
    yield provenance_sheet(solution, contents.source, texts)
