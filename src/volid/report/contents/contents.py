"""The contents of a report: the solution, its summary in mm and rad, and what was asked of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from volid.compensation.residual.accuracy import VolumeSizes, motion_ranges, volume_sizes
from volid.fitting.solution import Solution
from volid.io.basics.provenance import provenance
from volid.io.evaluations.limits import Limits, judge_all
from volid.plausibility.record import Item, record
from volid.report.contents.outlook import DRAWS, Outlook, outlook
from volid.report.contents.quantities import quantities, unproved
from volid.report.text.summary import summary_data
from volid.standards.results import Evaluation, withhold


@dataclass(frozen=True)
class Contents:
    """What a report says.

    Args:
        solution: The solution.
        summary: Its numbers, as `summary_data` gives them, mm and rad.
        tool: The tool vector of the volumetric numbers, shape (3,) [mm].
        source: Name of the solution's file, "" where it has none.
        title: The title that the user gave, "" for one made from the machine's name.
        limits: Name of the file of limits, "" without limits or where they were given otherwise.
        evaluation: Every number that a limit can be set for, with U, and its verdict where there is a limit.
        sizes: Volumetric accuracy and largest deviation with U; None behind a barrier.
        outlook: What each compensation type is expected to leave.
        record: The record of the campaign, item by item.
        made: Date, versions, command and hashes of the report itself, as `provenance` gives them.
    """

    solution: Solution
    summary: Mapping[str, Any]
    tool: tuple[float, float, float]
    source: str = ""
    title: str = ""
    limits: str = ""
    evaluation: Evaluation = field(default_factory=lambda: quantities({}, {}))
    sizes: VolumeSizes | None = None
    outlook: Outlook = field(default_factory=Outlook)
    record: tuple[Item, ...] = ()
    made: Mapping[str, str] = field(default_factory=dict)

    @property
    def barrier(self) -> str:
        """Why no numbers of the solution are shown; "" where they are."""
        return self.solution.adequacy.barrier

    @property
    def judged(self) -> bool:
        """Whether limits were given."""
        return any(q.limit is not None for q in self.evaluation.quantities)


def gather(
    solution: Solution,
    tool: Sequence[float] | None = None,
    source: str = "",
    limits: str | Path | Limits | None = None,
    title: str = "",
    command: Sequence[str] = (),
    expected: bool = True,
) -> Contents:
    """The contents of the report of `solution`.

    Args:
        solution: As `volid.fit` or `volid.load_solution` gives it.
        tool: Tool vector of the volumetric numbers, shape (3,) [mm]; None: the most used one.
        source: Name of the solution's file.
        limits: Largest sizes allowed by symbol, mm and rad, a file or a mapping of its form; see `quantities` for the symbols.
        title: Title of the report.
        command: The command line that asked for the report.
        expected: Whether it says what each compensation type is expected to leave, which takes most of the time.

    Raises `InputError` for a tool vector that looks like another unit than mm, and for limits as `judge_all` does.
    """
    if tool is not None:
        solution.ask(tool)
    summary = summary_data(solution, tool, DRAWS)
    x, y, z = summary["tool"]
    shown = not solution.adequacy.barrier
    sizes = volume_sizes(solution, (x, y, z)) if shown else None
    found = quantities(summary, motion_ranges(solution) if shown else {}, sizes)
    files = [f for f in (source, limits) if isinstance(f, str | Path) and Path(f).is_file()]
    return Contents(
        solution=solution,
        summary=summary,
        tool=(x, y, z),
        source=source,
        title=title,
        limits=str(limits) if isinstance(limits, str | Path) else "",
        evaluation=withhold(judge_all([found], limits)[0], unproved(summary, found)) if shown else found,
        sizes=sizes,
        outlook=outlook(solution, (x, y, z)) if shown and expected else Outlook(),
        record=record(solution.campaign),
        made=provenance(files, command),
    )
