"""What every source contributes to the expanded uncertainty of every output, in mm and rad, ready for a figure and a table.

Contributions are expanded with k = 2 as U is, so that their root sum of squares is U. Functions of position appear once, as the
root mean square over the travel.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np

from volid.fitting.solution import Solution
from volid.report.language import Texts
from volid.uncertainty.budget import LACK, SCATTER, SMOOTHNESS, Line, budget, budget_lines, headline_rows
from volid.uncertainty.outputs import FIELD, headline_outputs

K = 2.0
MOST = 6  # sources that are named; the others are taken together
KEYS = {"form of artefact": "form", "angle of artefact": "angle", "length": "length"}  # of unknowns known beforehand


class Contributions(NamedTuple):
    """What makes up U of one output.

    `output`: its symbol or name; `unit`: "mm" or "rad"; `expanded`: U, k = 2; `parts`: contribution to U by source.
    """

    output: str
    unit: str
    expanded: float
    parts: Mapping[str, float]

    @property
    def is_of_volume(self) -> bool:
        """Whether it is a number of the deviation field."""
        return self.output in FIELD


def headline_contributions(
    solution: Solution, tool: tuple[float, float, float], texts: Texts
) -> tuple[Contributions, ...]:
    """Contributions of a solution's error motions, constants and numbers of the volume, its main sources in words.

    Args:
        solution: A solution.
        tool: Tool vector of the numbers of the volume, shape (3,) [mm].
        texts: The language of the sources' names.

    Raises `InputError` for a solution that cannot be refitted, because it was fitted in parts or extrapolated.
    """
    lines = budget_lines(budget(solution), headline_rows(solution, headline_outputs(solution, np.asarray(tool))))
    return with_main_sources(contributions(lines, source_words(solution, texts)), texts)


def contributions(lines: Iterable[Line], words: Mapping[str, str] | None = None) -> tuple[Contributions, ...]:
    """The lines of a budget by output. `words`: of sources; those that share their words are taken together."""
    outputs: dict[str, list[Line]] = {}
    for line in lines:
        outputs.setdefault(line.output, []).append(line)
    return tuple(_of_output(name, found, words or {}) for name, found in outputs.items())


def _of_output(name: str, lines: list[Line], words: Mapping[str, str]) -> Contributions:
    places = len({line.position for line in lines if not math.isnan(line.position)}) or 1
    squares: dict[str, float] = {}
    for line in lines:
        source = words.get(line.source, line.source)
        squares[source] = squares.get(source, 0.0) + (K * line.contribution) ** 2 / places
    total = math.sqrt(math.fsum(squares.values()))
    return Contributions(name, lines[0].unit, total, {source: math.sqrt(v) for source, v in squares.items()})


def with_main_sources(found: tuple[Contributions, ...], texts: Texts, most: int = MOST) -> tuple[Contributions, ...]:
    """The sources that matter most first, by their largest share of any U²; all beyond `most` are one."""
    shares: dict[str, float] = {}
    for output in found:
        for source, part in output.parts.items():
            share = (part / output.expanded) ** 2 if output.expanded > 0.0 else 0.0
            shares[source] = max(shares.get(source, 0.0), share)
    order = sorted(shares, key=lambda source: -shares[source])
    kept = order if len(order) <= most else order[: most - 1]
    rest = texts("budget.others", n=len(order) - len(kept))
    return tuple(output._replace(parts=_joined(output.parts, kept, rest)) for output in found)


def _joined(parts: Mapping[str, float], kept: list[str], rest: str) -> dict[str, float]:
    found = {source: parts.get(source, 0.0) for source in kept}
    others = [part for source, part in parts.items() if source not in found]
    return found | ({rest: math.hypot(*others)} if others else {})


def source_words(solution: Solution, texts: Texts) -> dict[str, str]:
    """The sources of a solution's budget in words; unknowns of one kind, such as the form of an artefact, share theirs."""
    words = {
        SMOOTHNESS: texts("budget.smoothness"),
        LACK: texts("budget.lack"),
        SCATTER: texts("budget.scatter"),
        "earlier solution": texts("budget.earlier"),
    }
    words |= {f"readings of set '{s.name}'": texts("budget.set", name=s.name) for s in solution.campaign.sets}
    for entry in solution.nuisance_table:
        if entry.effect:
            words[f"effect '{entry.effect}'"] = texts("budget.effect", name=entry.effect)
        elif isinstance(entry.key, tuple) and entry.key[0] in KEYS:
            words[entry.name] = texts(f"budget.{KEYS[entry.key[0]]}")
    return words
