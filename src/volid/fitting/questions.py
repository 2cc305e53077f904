"""Questions that a careful colleague asks of a fit that agrees with itself: are the numbers those of a machine?

A campaign whose readings, positions and u all share a mistake fits well. What gives it away is size: errors of a hundredth of the
travel, angles that no guideway follows, a station where the tool moves, residuals far below their u. None of these is impossible,
so they are asked and not refused, and a set that says `large_errors` is not asked about size.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from volid.fitting.diagnosis.adequacy import QUESTIONED, REJECTED, Question
from volid.fitting.solution import Solution
from volid.model.axis_lines import constant_rows
from volid.model.iso230 import parse
from volid.observations import KINDS
from volid.observations.base import takes_large_errors

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
_UNITS = {1e3: "µm", 25.4: "inches"}
_INSIST = "if they are real, set large_errors = true in the [[set]], or pass `accept_large_errors=True`"


def questions(solution: Solution) -> tuple[Question, ...]:
    """What has to be asked of a solution before it is accepted, what concerns its values first.

    >>> import volid
    >>> questions(volid.fit(volid.load_campaign("datasets/published_positioning/campaign.toml")))
    ()
    """
    found = [Question(text, False) for text in _large_u(solution)]
    if not any(takes_large_errors(s) for s in solution.campaign.sets):
        texts = (*_large_errors(solution), *_steep(solution), *_stations_inside(solution))
        found = [*(Question(f"{text}; {_INSIST}", True) for text in texts), *found]
    return tuple(found)


def asked(solution: Solution) -> Solution:
    """The solution with its questions; what is accepted otherwise is questioned then."""
    found, adequacy = questions(solution), solution.adequacy
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


def _has_angles(labels: object) -> bool:
    components = labels.get("component", np.zeros(0)) if hasattr(labels, "get") else np.zeros(0)
    return bool(np.isin(components, list("ABC")).any())


# ----------------------------------------------------------------------------------------------------------------------- stations


def _stations_inside(solution: Solution) -> Iterator[str]:
    """Stations on the workpiece that stand amid the places of the tool they see, where lengths are relative to a dead path."""
    values = {n.key: float(v) for n, v in zip(solution.nuisance_table, np.asarray(solution.nuisance), strict=True)}
    boxes: dict[str, list[np.ndarray]] = {}
    for s in solution.campaign.sets:
        for beam in KINDS[s.kind].beams(s, solution.campaign):
            if beam.relative and beam.station.body == "workpiece":
                boxes.setdefault(beam.station.name, []).append(beam.targets)
    for name, targets in boxes.items():
        place = np.array([values.get(("station", name, c), np.nan) for c in "XYZ"])
        low, high = np.min(np.concatenate(targets), axis=0), np.max(np.concatenate(targets), axis=0)
        if np.all(place > low + DEEP * (high - low)) and np.all(place < high - DEEP * (high - low)):
            at = ", ".join(f"{v:.4g}" for v in place)
            yield f"station {name} is found at ({at}) mm, amid the places of the tool that it sees: are all lengths in mm?"


# --------------------------------------------------------------------------------------------------------------------------- of u


def _large_u(solution: Solution) -> Iterator[str]:
    """Sets whose residuals are far below the u that they were stated with."""
    for s, normalised, residual in zip(
        solution.campaign.sets, solution.readings.normalised, solution.readings.residuals, strict=True
    ):
        with np.errstate(divide="ignore", invalid="ignore"):
            redundancy = np.where(normalised != 0.0, (residual / s.u / normalised) ** 2, 0.0)
        counted = redundancy > SEEN
        if np.count_nonzero(counted) < ENOUGH:
            continue
        weight = float(np.sqrt(np.mean(normalised[counted] ** 2)))
        if weight < TOO_LARGE:
            times = 1.0 / max(weight, 1e-9)
            unit = next((said for k, said in _UNITS.items() if 0.1 < k / times < 30.0), "")
            hint = f"is it in {unit}, where the unit of the readings is expected" if unit else "is it in another unit"
            yield (
                f"set '{s.name}': the stated u (median {np.median(s.u):.3g} {KINDS[s.kind].unit_words}) is {times:.0f} times "
                f"as large as what the residuals show; {hint}? Every u below is as much too large"
            )
