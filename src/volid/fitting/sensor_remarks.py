"""What a careful colleague would ask about the sensor of an R-test: is its sign right, and does it see the tilt of a head?

*Sign.* The readings of a sensor that gives the nest relative to the sphere, instead of the reverse, are negated. Where the linear
axes follow the sphere exactly they fit as well, with errors of the opposite sign. What tells is any motion that was commanded and
not followed: a position measured again with one linear axis moved aside, or errors of the linear axes that are known otherwise.

*Tilt.* With a single tool vector a tilt of the last body of a head displaces the nest as a translation would. Only because the
sphere stands off the nest by a deflection d is the reading turned by tilt × d: that determines the tilt formally, with a large u,
and with all that the rotation, scale and linearity of the sensor do.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from volid.campaign import Campaign, ObservationSet
from volid.fitting.change_of_datum import held_constants
from volid.fitting.diagnosis.identifiability import analyse
from volid.fitting.equations.choice import INTERPRETED, engine_named
from volid.fitting.equations.problem import build_problem
from volid.fitting.linear_trial import Trial, few_coefficients, thin, trial_of
from volid.fitting.location_errors import location_parameter
from volid.fitting.smoothness.spreading import spread_out
from volid.fitting.solution import Solution
from volid.model.error_model import LOCATION
from volid.model.iso230 import SPINDLE, parse
from volid.model.kinematics import nominal_point
from volid.model.machine import Machine
from volid.observations import KINDS

CLEAR = 25.0  # difference of chi-square, for unit weight 1: two fits five standard deviations apart
ASIDE = 0.05  # mm: well above the errors of a machine, well within the range of a sensor
FEW = 2  # intervals: the question is one of geometry, not of shape


def sensor_remarks(solution: Solution) -> Iterator[str]:
    """Sentences about the sign of R-test readings, and about tilts that only the sensor's deflection shows."""
    sensors = [i for i, s in enumerate(solution.campaign.sets) if _is_sensor(s)]
    if not sensors:
        return
    if not solution.options.get("prior") and any(solution.campaign.sets[i].readings.any() for i in sensors):
        yield from _sign(solution, trial_of(solution), sensors)
    yield from _tilt(solution)


def _is_sensor(readings: ObservationSet) -> bool:
    """Whether a set was read from a nest of sensors around what stands on the other side."""
    return "sensor_on" in readings.options and bool(KINDS[readings.kind].standing)


def _sign(solution: Solution, trial: Trial, sensors: list[int]) -> Iterator[str]:
    """One sentence when readings fit better with the other sign, or as well."""
    given = trial.chi_square()
    choices = [sensors] + ([[i] for i in sensors] if len(sensors) > 1 else [])
    negated = [trial.chi_square(choice) for choice in choices]
    best = int(np.argmin(negated))
    if given - negated[best] > CLEAR * _variance(trial, negated[best]):
        weights = [np.sqrt(x / max(trial.degrees_of_freedom, 1)) for x in (given, negated[best])]
        yield (
            f"readings of {_named(solution, choices[best])} fit better when they are negated (unit weight {weights[1]:.3g} "
            f"instead of {weights[0]:.3g} in a linear fit): does the sensor give the nest relative to the sphere? Expected are "
            "sphere minus nest; all errors found from them have the wrong sign otherwise"
        )
    elif negated[0] - given < CLEAR * _variance(trial, given):
        yield (
            f"the sign of the readings of {_named(solution, sensors)} cannot be told from the data: negated they fit as well, "
            "with all rotary errors of the opposite sign. Check that they are sphere minus nest, or measure one position again "
            f"with a linear axis moved aside by {ASIDE:g} mm, which shows it"
        )


def _variance(trial: Trial, chi_square: float) -> float:
    """Square of the unit weight of the better fit, 1 at least: what the model leaves is no evidence."""
    return max(1.0, chi_square / max(trial.degrees_of_freedom, 1))


def _named(solution: Solution, numbers: list[int]) -> str:
    names = ", ".join(f"'{solution.campaign.sets[i].name}'" for i in numbers)
    return f"set{'s' if len(numbers) > 1 else ''} {names}"


# --------------------------------------------------------------------------------------------------------------- tilt


def _tilt(solution: Solution) -> Iterator[str]:
    """One sentence when tilts of a head are determined, but would not be if the sphere stood in the nest."""
    campaign, machine = solution.campaign, solution.campaign.machine
    head = {a.letter for a in machine.axes if not a.is_linear and not a.primed} | {SPINDLE}
    on_tool = [s for s in campaign.sets if _is_sensor(s) and s.options["sensor_on"] == "tool"]
    if len(head) == 1 or not on_tool or len(machine.linear) < 3 or len(campaign.tool_vectors()) > 1:
        return
    names = [n for n in _by_deflection(solution) if parse(n).axis in head and parse(n).is_rotation]
    if names:
        largest = max(_deflection(s, machine) for s in on_tool)
        tool = ", ".join(f"{v:g}" for v in campaign.tool_vectors()[0])
        yield (
            f"{', '.join(names)}: the tilt of the head is known only through the deflection of the sensor (up to {largest:.2g} "
            f"mm), because all readings have one tool vector, ({tool}) mm: rotation and scale of the sensor act in the same way; "
            "measure with a second tool length"
        )


def _deflection(readings: ObservationSet, machine: Machine) -> float:
    """Largest distance of a sphere from the nest [mm]; of centres, which read 0, from where it stands on average."""
    if readings.readings.any():
        return float(np.linalg.norm(readings.readings, axis=1).max())
    kind, means = KINDS[readings.kind], _mean_places([readings], machine)
    places, labels = kind.places(readings, machine), readings.labels[kind.standing]
    if places is None:
        return 0.0
    return float(np.linalg.norm(places - np.array([means[str(n)] for n in labels]), axis=1).max())


def _by_deflection(solution: Solution) -> list[str]:
    """Functions and constants that have a value, but would have none with every sphere in the nest."""
    model, measured = few_coefficients(solution, FEW), thin(solution)
    unknowns = model.n_parameters + len(solution.nuisance_table)
    campaign = in_the_nest(spread_out(measured, unknowns), measured)
    found = analyse(build_problem(campaign, model, engine=engine_named(INTERPRETED)), campaign)
    lost = {*found.undetermined, *held_constants(model, found.tool_rotation)}
    return [name for name in model.names if name in lost and _has_value(solution, name)]


def _has_value(solution: Solution, name: str) -> bool:
    if (name, LOCATION) in solution.model.by_name:
        return bool(np.isfinite(location_parameter(solution, name).value))
    return name not in solution.undetermined


def in_the_nest(campaign: Campaign, measured: Campaign) -> Campaign:
    """The campaign with linear axes that follow every sphere exactly, so that no sensor is deflected on a nominal machine.

    Each sphere stands where the readings of the `measured` campaign put it on average.
    """
    sets = []
    for s in campaign.sets:
        places = _mean_places([m for m in measured.sets if _is_sensor(m) and m.name == s.name], measured.machine)
        sets.append(_followed(s, campaign.machine, places) if _is_sensor(s) else s)
    return replace(campaign, sets=tuple(sets))


def _mean_places(sets: list[ObservationSet], machine: Machine) -> dict[str, np.ndarray]:
    """Place (3,) [mm] of every sphere of sets on the workpiece."""
    found: dict[str, np.ndarray] = {}
    for s in sets:
        kind = KINDS[s.kind]
        places, labels = kind.places(s, machine), s.labels[kind.standing]
        found |= {} if places is None else {str(n): places[labels == n].mean(axis=0) for n in np.unique(labels)}
    return found


def _followed(readings: ObservationSet, machine: Machine, places: dict[str, np.ndarray]) -> ObservationSet:
    """One set whose functional point stands at the places, readings 0."""
    kind = KINDS[readings.kind]
    want = np.array([places[str(name)] for name in readings.labels[kind.standing]])
    start = nominal_point(machine, readings.positions, readings.tool)
    columns = [i for i, axis in enumerate(machine.axes) if axis.is_linear]
    steps = np.eye(len(machine.axes))[columns]
    slope = np.stack([nominal_point(machine, readings.positions + s, readings.tool) - start for s in steps], axis=-1)
    positions = readings.positions.copy()
    positions[:, columns] += np.linalg.solve(slope, (want - start)[..., None])[..., 0]
    still = replace(readings, positions=positions, readings=np.zeros_like(readings.readings))
    only = want[0].tolist()  # of a set with one sphere, whose place stands under the set's name
    return kind.approximate(still, lambda name, _: places[name].tolist() if name in places else only)
