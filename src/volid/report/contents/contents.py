"""The contents of a report: the solution, its summary in mm and rad, and what was asked of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from volid.fitting.solution import Solution
from volid.report.text.summary import summary_data


@dataclass(frozen=True)
class Contents:
    """What a report says.

    Args:
        solution: The solution.
        summary: Its numbers, as `summary_data` gives them, mm and rad.
        tool: The tool vector of the volumetric numbers, shape (3,) [mm].
        source: Name of the solution's file, "" where it has none.
        limits: Upper limits by symbol, mm and rad, as `--limits` names them.
    """

    solution: Solution
    summary: Mapping[str, Any]
    tool: tuple[float, float, float]
    source: str = ""
    limits: Mapping[str, float] = field(default_factory=dict)


def gather(
    solution: Solution,
    tool: Sequence[float] | None = None,
    source: str = "",
    limits: Mapping[str, float] | None = None,
) -> Contents:
    """The contents of the report of `solution`.

    Args:
        solution: As `volid.fit` or `volid.load_solution` gives it.
        tool: Tool vector of the volumetric numbers, shape (3,) [mm]; None: the most used one.
        source: Name of the solution's file.
        limits: Upper limits by symbol, mm and rad.
    """
    summary = summary_data(solution, tool)
    x, y, z = summary["tool"]
    return Contents(solution, summary, (x, y, z), source, dict(limits or {}))
