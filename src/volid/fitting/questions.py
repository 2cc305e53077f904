"""Questions that a careful colleague asks of a fit that agrees with itself: are the numbers those of a machine?

A campaign whose readings, positions and u all share a mistake fits well. What gives it away is size: errors of a hundredth of the
travel, angles that no guideway follows, a station where the tool moves, residuals far below their u. None of these is impossible,
so they are asked and not refused, and a set that says `large_errors` is not asked about size.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations

import numpy as np

from volid.campaign import SAME_TOOL
from volid.fitting.diagnosis.adequacy import QUESTIONED, REJECTED, Question
from volid.fitting.solution import Solution
from volid.model.axis_lines import constant_rows
from volid.model.iso230 import parse
from volid.model.machine import WORKPIECE
from volid.observations import KINDS
from volid.observations.base import MM, takes_large_errors
from volid.plausibility.tools import SHORT

LARGE = 0.01  # of the travel, and rad: errors from here on are asked about
LARGEST_OF_ROTARY = 5.0  # mm, translations of a rotary axis
POINTS = 41
K = 2.0
TOO_LARGE = 0.1  # residuals over their u, below which u is asked about
ENOUGH = 30  # residuals
SEEN = 0.5  # share of a reading that others check, from which on its residual counts
STEEP = 40.0  # rise of a guideway that its angles demand, over its straightness error
LEAST_ANGLE = 1e-4  # rad
DEEP = 0.15  # of the box of its targets, from every face: a station there stands where the tool moves
LEAST_U = 2e-5  # mm: 20 nm
FAR = 20.0  # mm, from its stated position to where a station is found, from which on a reason is looked for
NEARER, MUCH_NEARER = 0.2, 0.05  # of that distance: what a reason has to leave at most; for fewer than `FEW` stations
FEW = 3
_MICRO = 30.0  # times too large: a u in µm is 1000 times too large, of which smoother functions hide a part
_INSIST = "If that is so, set large_errors = true in the [[set]], and fit again"


def questions(solution: Solution, scale: float = 1.0) -> tuple[Question, ...]:
    """What has to be asked of a solution before it is accepted, what concerns its values first. `scale`: residuals over their u.

    >>> import volid
    >>> questions(volid.fit(volid.load_campaign("datasets/published_positioning/campaign.toml")))
    ()
    """
    found = [Question(text, False) for text in (*_small_u(solution), *_large_u(solution, scale))]
    answered = [takes_large_errors(s) for s in solution.campaign.sets]
    texts = () if any(answered) else (*_large_errors(solution), *_steep(solution))
    if not all(answered):
        texts = (*texts, *_short_tools(solution), *_stations_inside(solution), *_stations_elsewhere(solution))
    found = [*(Question(f"{text} {_INSIST}", True) for text in texts), *found]
    return tuple(found)


def asked(solution: Solution, scale: float = 1.0) -> Solution:
    """The solution with its questions; what is accepted otherwise is questioned then. `scale`: residuals over their u."""
    return with_questions(solution, questions(solution, scale))


def with_questions(solution: Solution, found: tuple[Question, ...]) -> Solution:
    """The solution with these questions; what is accepted otherwise is questioned then."""
    adequacy = solution.adequacy
    if not found:
        return solution
    if adequacy.grade == REJECTED:
        return replace(solution, adequacy=replace(adequacy, questions=found))
    verdict = f"not accepted before a question is answered: {found[0].text}"
    return replace(solution, adequacy=replace(adequacy, grade=QUESTIONED, verdict=verdict, questions=found))


# ------------------------------------------------------------------------------------------------------------- size of the errors


def _large_errors(solution: Solution) -> Iterator[str]:
    """Error motions and lines of a hundredth of the travel, or a hundredth of a radian, beyond their U."""
    sizes = [(name, size, _limit(solution, name)) for name, size in (*_ranges(solution), *_constants(solution))]
    large = sorted(((size / limit, name, size) for name, size, limit in sizes if size > limit), reverse=True)
    if not large:
        return
    named = ", ".join(f"{name} {_in_words(name, size)}" for _, name, size in large[:3])
    more = f" and {len(large) - 3} more" if len(large) > 3 else ""
    yield (
        f"{named}{more}: few machines have errors of 1 % of the travel (10 mrad) and more; are readings, positions, tool vectors "
        "and travels in mm, and angles in rad?"
    )


def _ranges(solution: Solution) -> Iterator[tuple[str, float]]:
    """Largest minus smallest value of every error motion that is determined, less its U."""
    rows = solution.functions(points=POINTS)
    for name in dict.fromkeys(row.name for row in rows if not parse(row.name).location):
        values = np.array([row.value for row in rows if row.name == name])
        u = np.array([row.u for row in rows if row.name == name])
        if np.isfinite(values).all():
            yield name, float(np.ptp(values) - K * np.max(u))


def _constants(solution: Solution) -> Iterator[tuple[str, float]]:
    """Size of squareness and location errors, less their U."""
    for name in dict.fromkeys(line.name for line in constant_rows(solution.model)):
        row = solution.location(name)
        if np.isfinite(row.u):
            yield name, abs(row.value) - K * row.u


def _limit(solution: Solution, name: str) -> float:
    error = parse(name)
    if error.is_rotation:
        return LARGE
    axes = {a.letter: a for a in solution.campaign.machine.axes}
    axis = axes.get(error.axis)
    return LARGE * axis.length if axis is not None and axis.is_linear else LARGEST_OF_ROTARY


def _in_words(name: str, size: float) -> str:
    return f"{1e3 * size:.3g} mrad" if parse(name).is_rotation else f"{size:.3g} mm"


def _steep(solution: Solution) -> Iterator[str]:
    """Pitch and yaw that the straightness of the same axis contradicts, where angles were read by an instrument of their own.

    A carriage that pitches by ρ over the travel L along a bowed guideway rises by about ρ L / 8.
    """
    if not any(KINDS[s.kind].unit_words == "mm or rad" and _has_angles(s.labels) for s in solution.campaign.sets):
        return
    size = dict(_ranges(solution))
    for axis in (a for a in solution.machine.axes if a.is_linear):
        across = [c for c in "XYZ" if c != axis.letter]
        for up, about in zip(across, reversed(["ABC"["XYZ".index(c)] for c in across]), strict=True):
            angle, rise = size.get(f"E{about}{axis.letter}"), size.get(f"E{up}{axis.letter}")
            if angle is None or rise is None or angle < LEAST_ANGLE or rise <= 0.0:
                continue
            bow = angle * axis.length / 8.0
            if bow > STEEP * rise:
                yield (
                    f"E{about}{axis.letter} ranges over {1e3 * angle:.3g} mrad, which a bow of some {bow:.2g} mm would explain, "
                    f"but E{up}{axis.letter} over {rise:.2g} mm alone: are the angles in degrees?"
                )


def _short_tools(solution: Solution) -> Iterator[str]:
    """Tool vectors that are all shorter than any tool, though not 0."""
    tools = [s.tool for s in solution.campaign.sets if KINDS[s.kind].sees_tool(s)]
    longest = float(np.linalg.norm(np.concatenate(tools), axis=1).max()) if tools else 0.0
    if 0.0 < longest < SHORT:
        yield f"all tool vectors are shorter than {SHORT:g} mm, the longest {longest:.3g} mm: are they in metres?"


def _has_angles(labels: object) -> bool:
    components = labels.get("component", np.zeros(0)) if hasattr(labels, "get") else np.zeros(0)
    return bool(np.isin(components, list("ABC")).any())


# ----------------------------------------------------------------------------------------------------------------------- stations


def _found(solution: Solution) -> dict[str, np.ndarray]:
    """Where the fit puts the stations whose places are unknown, by name, (3,) [mm]."""
    values = {n.key: float(v) for n, v in zip(solution.nuisance_table, np.asarray(solution.nuisance), strict=True)}
    names = [s.name for s in solution.campaign.stations if not s.known and ("station", s.name, "X") in values]
    return {name: np.array([values["station", name, c] for c in "XYZ"]) for name in names}


def _stations_inside(solution: Solution) -> Iterator[str]:
    """Stations on the workpiece that stand amid the places of the tool they see, where lengths are relative to a dead path."""
    places, boxes = _found(solution), dict[str, list[np.ndarray]]()
    for s in solution.campaign.sets:
        for beam in KINDS[s.kind].beams(s, solution.campaign):
            if beam.relative and beam.station.body == WORKPIECE and beam.station.name in places:
                boxes.setdefault(beam.station.name, []).append(beam.targets)
    for name, targets in boxes.items():
        place, points = places[name], np.concatenate(targets)
        low, high = points.min(axis=0), points.max(axis=0)
        if np.all(place > low + DEEP * (high - low)) and np.all(place < high - DEEP * (high - low)):
            at = ", ".join(f"{v:.4g}" for v in place)
            yield f"station {name} is found at ({at}) mm, amid the places of the tool that it sees: are all lengths in mm?"


def _stations_elsewhere(solution: Solution) -> Iterator[str]:
    """Stations that are found where they would be if an axis counted the other way, columns were exchanged, or tools negated."""
    found = _found(solution)
    stated = {s.name: np.array(s.position) for s in solution.campaign.stations if s.position is not None}
    names = [name for name in found if name in stated]
    if not names:
        return
    places, said, tools = (np.array([d[n] for n in names]) for d in (found, stated, _tool_of(solution, names)))
    before = float(np.median(np.linalg.norm(places - said, axis=1)))
    after = {what: _median_distance(places, other) for what, other in _otherwise(said, tools)}
    best = min(after, key=lambda k: after[k])
    if before > FAR and after[best] < (NEARER if len(names) >= FEW else MUCH_NEARER) * before:
        yield (
            f"stations are found {before:.0f} mm from their stated positions, but {after[best]:.2g} mm if {best}: is that so, or "
            "are the stated positions wrong?"
        )


def _median_distance(places: np.ndarray, other: np.ndarray) -> float:
    return float(np.median(np.linalg.norm(places - other, axis=1)))


def _tool_of(solution: Solution, names: list[str]) -> dict[str, np.ndarray]:
    """The tool vector with which each station is seen, (3,) [mm]; not a number where there are several."""
    seen: dict[str, np.ndarray] = {}
    for s in solution.campaign.sets:
        stations = KINDS[s.kind].stations_of(s)
        for name in names:
            own = np.unique(np.round(s.tool[stations == name], SAME_TOOL), axis=0) if len(stations) else s.tool[:0]
            if len(own):
                seen[name] = own[0] if len(own) == 1 and name not in seen else np.full(3, np.nan)
    return {name: seen.get(name, np.full(3, np.nan)) for name in names}


def _otherwise(said: np.ndarray, tools: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
    """Where stations (n, 3) would be found after a slip, and its name."""
    offset = np.where(np.isfinite(tools), tools, 0.0)
    for i, letter in enumerate("XYZ"):
        turned = (said - offset) * np.where(np.arange(3) == i, -1.0, 1.0)
        yield f"axis {letter} counts the other way", turned + offset
    for i, j in combinations(range(3), 2):
        columns = [j if k == i else i if k == j else k for k in range(3)]
        yield f"columns {'XYZ'[i]} and {'XYZ'[j]} are exchanged", (said - offset)[:, columns] + offset
    if np.isfinite(tools).all():
        for i, letter in enumerate("xyz"):
            yield f"tool vectors have the wrong sign in {letter}", said + 2.0 * tools * (np.arange(3) == i)
        yield "tool vectors are negated", said + 2.0 * tools


# --------------------------------------------------------------------------------------------------------------------------- of u


def _large_u(solution: Solution, scale: float) -> Iterator[str]:
    """Sets whose residuals are far below the u that they were stated with; `scale`: residuals over u, all sets together."""
    for s, residual, normalised in zip(
        solution.campaign.sets, solution.readings.residuals, solution.readings.normalised, strict=True
    ):
        with np.errstate(divide="ignore", invalid="ignore"):
            redundancy = np.where(normalised != 0.0, (residual / s.u / normalised) ** 2, 0.0)
        counted = redundancy > SEEN
        if np.count_nonzero(counted) < ENOUGH:
            continue
        weight = float(np.sqrt(np.mean(normalised[counted] ** 2)))
        weight = min(weight, scale) if weight < 0.5 else weight
        if weight < TOO_LARGE:
            times, unit = 1.0 / max(weight, 1e-9), KINDS[s.kind].unit_words
            hint = "is it in µm, where mm is expected" if MM in unit and times > _MICRO else "is it in another unit"
            yield (
                f"set '{s.name}': the stated u (median {np.median(s.u):.3g} {unit}) is about {times:.0f} times as large as what "
                f"the residuals show; {hint}? Every u below is too large as well"
            )


def _small_u(solution: Solution) -> Iterator[str]:
    """Sets with a u that no instrument for machines has."""
    for s in solution.campaign.sets:
        for part in KINDS[s.kind].parts(s):
            u, readings = s.u[part.rows], s.readings[part.rows]
            if part.unit == MM and readings.any() and np.median(u) < LEAST_U:
                yield (
                    f"set '{s.name}': u is {1e6 * np.median(u):.2g} nm, which no such instrument has; is it in metres, where mm "
                    "is expected? Functions follow the noise of readings whose u is too small"
                )
