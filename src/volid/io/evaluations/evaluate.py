"""Tests evaluated by a standard, from their files in one call: one function for each standard, found by its name."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from volid.campaign import Campaign
from volid.effects.environment.reduction import reduced
from volid.exceptions import InputError
from volid.io.basics.toml_table import nearest
from volid.io.campaign.files import is_campaign, load_campaign
from volid.io.evaluations.circular import Stated, read_circular, vendors_evaluations
from volid.io.evaluations.diagonals import is_diagonals, read_diagonals
from volid.io.evaluations.limits import judge_all
from volid.io.evaluations.positioning import read_positioning
from volid.io.evaluations.positioning_conditions import read_conditions
from volid.io.evaluations.step_diagonals import read_step_diagonals
from volid.io.machines import read_machine
from volid.io.solutions import read_solution
from volid.io.truths import is_solution, load_truth
from volid.standards.circular.evaluation import WINDOW, evaluate_circular
from volid.standards.diagonals.evaluation import evaluate_diagonals
from volid.standards.diagonals.lines import diagonals_of
from volid.standards.positioning.conditions import contributions_of
from volid.standards.positioning.evaluation import evaluate_positioning
from volid.standards.results import Evaluation
from volid.standards.step_diagonals.evaluation import evaluate_step_diagonals
from volid.standards.step_diagonals.leak import leak_of, not_known
from volid.standards.step_diagonals.model import by_model
from volid.standards.step_diagonals.steps import step_sets

Files = Sequence[str | Path]


def evaluate(
    standard: str,
    *files: str | Path,
    limits: str | Path | Mapping[str, Any] | None = None,
    allow_outside: bool = False,
    **options: Any,
) -> list[Evaluation]:
    """Tests evaluated by a standard, without an error model.

    Args:
        standard: "iso230-2" (positioning), "iso230-4" (ball bar), "iso230-6" (diagonals), "step-diagonal".
        files: Campaigns, tables or files of instruments, as `volid evaluate STANDARD --help` lists them.
        limits: Largest values allowed, a file or a mapping of its form, `{"E": 0.010, "X": {"E": 0.008}}` [mm, °, rad, mm/mm].
        allow_outside: As of `volid.load_campaign`.
        options: `sets`, names of a campaign's sets, and those of the standard: `positioning`, `circular`, `diagonals`,
            `step_diagonals` in `volid.io.evaluations.evaluate`.

    Returns:
        One evaluation for each axis, plane, kind of diagonals or set; a quantity by its symbol, `evaluation["E"]`.

    Raises:
        InputError: naming file and row, column or key; for a standard or option that is not there.

    Source: ISO 230-2, ISO 230-4, ISO 230-6.

    >>> import volid
    >>> [x] = volid.evaluate("iso230-2", "datasets/iso230_2_synthetic/X_wide.csv", axis="X")
    >>> x["E"].unit, x["E"].value > 0.0
    ('mm', True)
    """
    if standard not in STANDARDS:
        raise InputError(f"'{standard}' is no standard that is evaluated; expected one of {', '.join(STANDARDS)}")
    own = STANDARDS[standard]
    known = [name for name in own.__kwdefaults__ or {} if name != "allow_outside"]
    for name in options:
        if name not in known:
            raise InputError(f"{standard} has no `{name}`{nearest(name, known)}; expected some of {', '.join(known)}")
    return judge_all(own(files, allow_outside=allow_outside, **options), limits)


def positioning(
    files: Files,
    *,
    axis: str | None = None,
    sets: Sequence[str] | None = None,
    keys: Mapping[str, Any] | None = None,
    uncertainty: str | Path | None = None,
    allow_outside: bool = False,
) -> list[Evaluation]:
    """By ISO 230-2. `axis`: that moved; `keys`: of a file of another program; `uncertainty`: file of the test's conditions."""
    found = [f for path in files for f in read_positioning(path, axis, sets or (), keys, allow_outside)]
    stated = [read_conditions(uncertainty, f.runs.length) if uncertainty else None for f in found]
    return [
        evaluate_positioning(f.runs, (*f.contributions, *(contributions_of(known, f.runs) if known else ())))
        for f, known in zip(found, stated, strict=True)
    ]


def circular(
    files: Files,
    *,
    plane: str | None = None,
    radius: float | None = None,
    feed: float | None = None,
    u: float | None = None,
    length_u: float | None = None,
    sets: Sequence[str] | None = None,
    window: float | None = None,
    setup_centre: bool = False,
    allow_outside: bool = False,
) -> list[Evaluation]:
    """By ISO 230-4. `plane`, `radius` [mm], `feed` [mm/min], `u` of a reading and `length_u` of the bar's length [mm]: of a table
    that does not say them; `window`: of spikes [°]; `setup_centre`: F from the centre as set up."""
    stated = Stated(plane, radius, feed, u, length_u)
    found: list[Evaluation] = []
    for path in files:
        vendors = vendors_evaluations(path)
        found += vendors
        for test in [] if vendors else read_circular(path, stated, sets, allow_outside):
            known = replace(test, feed=stated.feed) if stated.feed else test
            found.append(evaluate_circular(known, WINDOW if window is None else window, setup_centre))
    return found


def diagonals(files: Files, *, sets: Sequence[str] | None = None, allow_outside: bool = False) -> list[Evaluation]:
    """By ISO 230-6: body and face diagonals of every set and file."""
    found = []
    for path in files:
        if is_campaign(path):
            there = diagonals_of(load_campaign(path, allow_outside=allow_outside), sets)
        elif is_diagonals(path):
            there = {"": read_diagonals(path)}
        else:
            there = {"": diagonals_of(read_step_diagonals(path))["step diagonals"]}
        for name, lines in there.items():
            found += evaluate_diagonals(lines, f"{path}, set {name}" if name else str(path))
    return found


def step_diagonals(
    files: Files,
    *,
    sets: Sequence[str] | None = None,
    machine: str | Path | None = None,
    leak: str | Path | None = None,
    model: str | Path | None = None,
    allow_outside: bool = False,
) -> list[Evaluation]:
    """Nine functions of sequential step diagonals; `details` holds them.

    `machine`: file of the machine that a table is of; `leak`: solution or truth, which tells what rotations leak into the nine;
    `model`: solution to put beside them.
    """
    own = read_machine(machine) if machine else None
    found = []
    for path in files:
        campaign: Campaign = (
            reduced(load_campaign(path, allow_outside=allow_outside))
            if is_campaign(path)
            else read_step_diagonals(path, own)
        )
        there = step_sets(campaign, list(sets) if sets else None)
        if not there:
            named = f" named {' or '.join(sets)}" if sets else ""
            raise InputError(f"{path}: no set{named} holds steps of single axes along body diagonals")
        found += [replace(evaluate_step_diagonals(s, campaign), source=str(path)) for s in there]
    return [_beside(e, leak, model) for e in found]


def _beside(evaluation: Evaluation, leak: str | Path | None, model: str | Path | None) -> Evaluation:
    """The evaluation with tables of leak and model, and what a solution does not know of its rotations."""
    sections, attention = [], list(evaluation.attention)
    if leak:
        sections.append(leak_of(evaluation.details, load_truth(leak)).section())
        attention += _unknown(leak)
    if model:
        sections.append(by_model(evaluation.details, read_solution(model)).section())
    return replace(evaluation, sections=tuple(sections), attention=tuple(attention))


def _unknown(leak: str | Path) -> Iterator[str]:
    if is_solution(leak) and (names := not_known(read_solution(leak))):
        yield f"{leak} does not determine {', '.join(names)}: the leak is predicted as if they were 0"


STANDARDS: dict[str, Callable[..., list[Evaluation]]] = {
    "iso230-2": positioning,
    "iso230-4": circular,
    "iso230-6": diagonals,
    "step-diagonal": step_diagonals,
}
