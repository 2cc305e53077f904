"""What is said of a solution whose u were estimated: notes, and questions about factors that no instrument explains."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from volid.fitting.diagnosis.adequacy import Question
from volid.fitting.mixed.records import ESTIMATED, VarianceComponent
from volid.fitting.questions import with_questions
from volid.fitting.solution import Solution

ODD = 10.0  # factors from which on, or below whose inverse, another unit is likelier than another instrument


def with_components(solution: Solution, found: Sequence[VarianceComponent]) -> Solution:
    """The solution with its variance components, what a user should know about them, and what has to be asked."""
    solution = replace(solution, variance_components=tuple(found), notes=(*solution.notes, *_notes(found)))
    asked = [_question(c) for c in found if c.is_estimated and not 1.0 / ODD < c.factor < ODD]
    return with_questions(solution, (*solution.adequacy.questions, *asked)) if asked else solution


def _notes(found: Sequence[VarianceComponent]) -> list[str]:
    estimated = [c for c in found if c.is_estimated]
    kept = [f"u of set '{c.set}' ({c.part}) {c.state}" for c in found if not c.is_estimated]
    if not estimated:
        return kept
    names = ", ".join(f"'{c.set}' ({c.part})" for c in estimated)
    return [
        f"u of {names} was estimated from the residuals; so the unit weight of these readings is 1 whatever the model is, and "
        "agreement of the sets with each other and patterns in their residuals are what tests it",
        *(f"u of set '{c.set}' ({c.part}) was {c.state}" for c in estimated if c.state != ESTIMATED),
        *kept,
    ]


def _question(c: VarianceComponent) -> Question:
    return Question(
        f"set '{c.set}' ({c.part}): its residuals are {c.factor:.3g} times as large as the stated u; is u in another unit, or "
        "does something else than the instrument disturb the readings? The estimated u is used, and no instrument explains it",
        False,
    )
