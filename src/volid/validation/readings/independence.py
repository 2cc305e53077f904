"""Whether a campaign tests a solution, or only repeats what it was made from: ISO/TR 16907 11.3 asks for another set-up."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from volid.campaign import SAME_PLACE, SAME_TOOL, Campaign, ObservationSet
from volid.compensation.control import Control
from volid.fitting.solution import Solution
from volid.fitting.streamed import STREAMED
from volid.model.kinematics import nominal_point
from volid.observations import KINDS, sets_by_kind
from volid.observations.base import Nuisance
from volid.observations.response import Key, PlaceOf
from volid.plausibility.conditions import active_compensations

SEEN, UNSTATED = "the fit has seen", "compensations were active"
NEAR = 0.1  # of the diagonal of the volume: stations and spheres nearer to one of the fit's see the machine as that one did
SAME_READING = 0.1  # of u
FEW = 60  # levels: positions on more of them are scattered, and stand between those of the fit as well


def same_readings(solution: Solution, campaign: Campaign) -> list[str]:
    """Sets more than half of whose readings the fit has seen: of a streamed fit, of which a sample is kept, half of that sample.

    A reading is the same where position and tool are, and where it differs by less than a tenth of its u, the n-th of a place
    compared with the n-th: digits that were cut off do not hide it, and readings of other places that happen to be the same
    number, as rounded ones often are, are others.
    """
    theirs = {place: rows for s in solution.campaign.sets for place, rows in _by_place(s)}
    sizes = {kind: sum(map(len, sets)) for kind, sets in sets_by_kind(solution.campaign).items()}
    found = []
    for s in campaign.sets:
        n = sum(_in_common(rows, theirs.get(place, [])) for place, rows in _by_place(s))
        whole = min(len(s), sizes.get(KINDS[s.kind], 0)) if STREAMED in solution.options else len(s)
        if n > 0.5 * whole and np.any(s.readings != 0.0):
            found.append(s.name)
    return found


_Rows = list[tuple[np.ndarray, np.ndarray]]  # readings and their u, (k,) each


def _by_place(readings: ObservationSet) -> Iterator[tuple[tuple[object, ...], _Rows]]:
    """Readings by kind, station, axis positions and tool vectors, those of one place in the order of the set."""
    ends = readings.ends
    places = np.hstack([np.hstack([np.round(e.positions, 6), np.round(e.tool, SAME_TOOL)]) for e in ends]) + 0.0
    labels = list(zip(*(readings.labels[name] for name in sorted(readings.labels)), strict=True))
    found: dict[tuple[object, ...], _Rows] = {}
    for i, place in enumerate(places.tolist()):
        key = (readings.kind, readings.readings.shape[1], *(labels[i] if labels else ()), *place)
        found.setdefault(key, []).append((readings.readings[i], readings.u[i]))
    yield from found.items()


def _in_common(own: _Rows, theirs: _Rows) -> int:
    """How many readings of one place are those of another campaign."""
    pairs = zip(own, theirs, strict=False)
    return sum(bool(np.all(np.abs(a - b) < SAME_READING * np.minimum(u, v))) for (a, u), (b, v) in pairs)


def dependences(solution: Solution, campaign: Campaign, places: dict[tuple[Key, ...], np.ndarray]) -> tuple[str, ...]:
    """What the campaign has in common with the fit's, in words; a mistake of that part would be in both, and not be found.

    `places`: of the campaign's stations and spheres, as `places_of` finds them.
    """
    found = [
        f"{SEEN} the readings of set '{name}' already, so that they are no test"
        for name in same_readings(solution, campaign)
    ]
    theirs = list(places_of(solution.nuisance_table, np.asarray(solution.nuisance)).values())
    limit = NEAR * _diagonal(campaign)
    near = [min((float(np.linalg.norm(p - t)) for t in theirs), default=np.inf) < limit for p in places.values()]
    if near and all(near):
        found.append(
            f"all stations or spheres stand within {limit:.0f} mm of where those of the fit stood: take other places"
        )
    levels = ", ".join(sorted(_levels(solution, campaign)))
    found += [f"all positions of {levels} are those of the fit: between them nothing is tested"] if levels else []
    return tuple(found)


def _diagonal(campaign: Campaign) -> float:
    """Of the box of all functional points, workpiece frame [mm]."""
    ends = [s.all_ends for s in campaign.sets]
    points = np.concatenate([nominal_point(campaign.machine, e.positions, e.tool) for e in ends])
    return float(np.linalg.norm(np.ptp(points, axis=0)))


def active_notes(solution: Solution, campaign: Campaign, control: Control | None) -> Iterator[str]:
    """Sentences about compensations that were active in one campaign and not in the other, by their records of conditions."""
    before, now = (set(active_compensations(c.conditions)) for c in (solution.campaign, campaign))
    if control is None and now - before:
        yield (
            f"{UNSTATED} that were not when the solution was measured: {', '.join(sorted(now - before))}; state "
            "them with `compensation`, or the prediction is that of the machine without"
        )
    if control is not None and now - before and not set(control.active) <= now:
        yield (
            f"the campaign records as active: {', '.join(sorted(now - before))}; what is stated is: {', '.join(control.active)}. "
            "The prediction follows what is stated; look whether both are the same"
        )
    if control is not None:
        yield from control.corrected_twice
    if control is not None and before:
        yield (
            f"the solution was measured with {', '.join(sorted(before))} active already: what is stated now counts on top of that"
        )


def tools_in_common(solution: Solution, campaign: Campaign) -> str:
    """A sentence where every tool vector is one of the fit's; empty else."""
    theirs = set(map(tuple, solution.campaign.tool_vectors().tolist()))
    own = set(map(tuple, np.round(campaign.tool_vectors(), SAME_TOOL).tolist()))
    if not own <= theirs:
        return ""
    return (
        "all tool vectors are those of the fit: what is wrong with a tool's length, or with rotations through other arms, is "
        "hardly tested"
    )


def _levels(solution: Solution, campaign: Campaign) -> list[str]:
    """Axes that move, all of whose positions are among a few of the fit's."""
    found = []
    for i, axis in enumerate(campaign.machine.axes):
        step = SAME_PLACE * axis.length
        own, theirs = (np.unique(np.round(c.positions[:, i] / step)) for c in (campaign, solution.campaign))
        if len(own) > 1 and len(theirs) <= FEW and np.all(np.isin(own, theirs)):
            found.append(axis.letter)
    return found


def places_of(entries: Sequence[Nuisance], values: np.ndarray) -> dict[tuple[Key, ...], np.ndarray]:
    """Places of stations, spheres and nests (3,) [mm] among unknowns, by the keys of their coordinates."""
    found: dict[tuple[Key, ...], np.ndarray] = {}
    for entry, value in zip(entries, values, strict=True):
        if isinstance(entry.response, PlaceOf):
            at = entry.response
            found.setdefault(at.of, np.array(at.offset, dtype=float))[at.component] += float(value)
    return found
