"""Readings of another campaign as a solution can predict them: on its machine, within its measured range, with their u."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from volid.campaign import Campaign, ObservationSet
from volid.effects.environment.reduction import reduced
from volid.exceptions import InputError
from volid.fitting.nominal import check_nominal
from volid.fitting.solution import Solution
from volid.model.machine import Machine
from volid.observations import sets_by_kind
from volid.observations.base import takes_large_errors
from volid.plausibility.checks import check_campaign

MOST = 40_000_000  # numbers of the readings' sensitivities, 320 MB: above, readings are thinned out
REJECTED, OPEN_END = "the solution was rejected by its own readings", "the solution's own fit had not converged"
SAME_AXIS = ("primed", "unit_vector", "point", "error_point")


class HeldOut(NamedTuple):
    """The readings that are predicted, on the solution's machine.

    `solution`: what predicts them. `rows`: numbers of the rows of every set in the campaign that was given. `left_out`: rows
    outside the measured range, by set. `notes`: what to say of them.
    """

    campaign: Campaign
    solution: Solution
    rows: tuple[np.ndarray, ...]
    left_out: dict[str, int]
    notes: tuple[str, ...]


def held_out(solution: Solution, campaign: Campaign, extrapolate: bool = False) -> HeldOut:
    """What of a campaign the solution predicts.

    Args:
        solution: the solution.
        campaign: the other readings.
        extrapolate: predict beyond the measured range too, with the u that the smoothness of the functions leaves there.

    Raises:
        InputError: another machine, no readings, or none within the measured range.
    """
    _ask(solution, campaign)
    campaign = reduced(campaign)
    notes = (*_doubts(solution), *check_campaign(campaign))
    if not all(map(takes_large_errors, campaign.sets)):
        check_nominal(campaign)
    if extrapolate:
        solution = solution.extrapolated(_reach(solution, campaign))
    inside = [_inside(solution, s) for s in campaign.sets]
    left_out = {s.name: int((~i).sum()) for s, i in zip(campaign.sets, inside, strict=True) if not i.all()}
    if not any(i.any() for i in inside):
        raise InputError(
            f"{_source(campaign)}: no reading lies within what the solution had measured, {_ranges(solution)}; measure there, or "
            "predict beyond it with `extrapolate=True`"
        )
    if left_out:
        count = sum(left_out.values())
        names = ", ".join(f"{n} of set '{name}'" for name, n in left_out.items())
        notes = (
            *notes,
            f"{count} rows lie outside what the solution had measured ({_ranges(solution)}) and are not predicted: {names}",
        )
    step = _step(solution, sum(int(i.sum()) for i in inside))
    if step > 1:
        notes = (*notes, f"one row in {step} is tested, evenly over every set: all of them would not fit into memory")
    kept = [np.flatnonzero(i)[::step] for i in inside]
    pairs = [(s.rows_of(k), k) for s, k in zip(campaign.sets, kept, strict=True) if len(k)]
    chosen = replace(campaign, machine=solution.campaign.machine, sets=tuple(s for s, _ in pairs))
    return HeldOut(chosen, solution, tuple(k for _, k in pairs), left_out, notes)


def _doubts(solution: Solution) -> list[str]:
    """What the solution's own readings say against it."""
    found = []
    if solution.adequacy.rejected:
        found.append(f"{REJECTED}: {solution.adequacy.verdict}")
    if not solution.statistics.converged:
        found.append(OPEN_END)
    if solution.prior_root is not None:
        found.append(
            "an earlier solution is part of this one: readings that it was made of are no test, and are not recognised"
        )
    if not solution.fully_determined or solution.held_tool_rotation:
        found.append("the solution does not determine everything: what the readings see of the rest is not tested")
    return found


def with_factor(held: HeldOut) -> HeldOut:
    """With the u of readings enlarged where the fit found that those of their kind are larger than stated (`Solution.factor`).

    What made the fit enlarge its u by κ is to be expected of new readings of these kinds too.
    """
    factor, known = held.solution.factor, set(sets_by_kind(held.solution.campaign))
    concerned = [s.name for kind, sets in sets_by_kind(held.campaign).items() if kind in known for s in sets]
    if factor == 1.0 or not concerned:
        return held
    sets = tuple(replace(s, u=s.u * factor) if s.name in concerned else s for s in held.campaign.sets)
    note = (
        f"the fit enlarged every u by the factor {factor:.3g}, because its readings fitted worse than their u says, so u of "
        f"readings of the same kind is taken {factor:.3g} times as large here too ({', '.join(concerned)})"
    )
    return held._replace(campaign=replace(held.campaign, sets=sets), notes=(*held.notes, note))


def _ask(solution: Solution, campaign: Campaign) -> None:
    """Raises `InputError` for what is no campaign with readings on the solution's machine."""
    if not isinstance(campaign, Campaign):
        raise InputError(
            f"validate takes a Campaign; got {type(campaign).__name__}. Read a file with volid.load_campaign(path)"
        )
    for s in campaign.sets:
        if np.isnan(s.readings).any():
            row = s.where(int(np.argmax(np.isnan(s.readings).any(axis=1))))
            raise InputError(f"{row}: there is no reading; expected a campaign with its readings, this may be a plan")
    _same_machine(solution.campaign.machine, campaign.machine, _source(campaign))


def _same_machine(own: Machine, other: Machine, source: str) -> None:
    """Raises `InputError` unless both have the same axes, one after the other, in the same places."""
    if own.letters != other.letters:
        raise InputError(
            f"{source}: its machine '{other.name}' has axes {', '.join(other.letters)} from workpiece to tool, that of the "
            f"solution, '{own.name}', has {', '.join(own.letters)}; expected the same machine"
        )
    for a, b in zip(own.axes, other.axes, strict=True):
        for what in SAME_AXIS:
            if getattr(a, what) != getattr(b, what):
                raise InputError(
                    f"{source}: {what} of axis {a.letter} is {getattr(b, what)} in its machine, {getattr(a, what)} in that of "
                    "the solution; expected the same machine"
                )


def _reach(solution: Solution, campaign: Campaign) -> dict[str, tuple[float, float]]:
    """What the campaign and the solution cover together, by axis letter."""
    ranges = zip(solution.machine.axes, campaign.measured_range(), strict=True)
    return {a.letter: (min(a.travel[0], float(lo)), max(a.travel[1], float(hi))) for a, (lo, hi) in ranges}


def _inside(solution: Solution, readings: ObservationSet) -> np.ndarray:
    """Rows all of whose functional points lie within what the solution predicts, bool (m,)."""
    return np.all([solution.model.holds(end.positions) for end in readings.ends], axis=0)


def _step(solution: Solution, rows: int) -> int:
    return max(1, -(-rows * solution.model.n_parameters // MOST))


def _source(campaign: Campaign) -> str:
    return campaign.source or "campaign"


def _ranges(solution: Solution) -> str:
    """The measured ranges in words."""
    return ", ".join(f"{a.letter} {a.travel[0]:g} … {a.travel[1]:g}" for a in solution.machine.axes)
