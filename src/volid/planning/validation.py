"""A second set-up that tests a solution: other stations, positions between those of the fit, other tool vectors.

ISO/TR 16907 11.3: what validates a set of error functions must not repeat what they were identified from. A mistake that both
set-ups share (a station's mirror, a tool that is longer than stated, functions that only run through the measured levels) stays
unseen.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.stats import qmc

from volid.backend.even_points import round_position
from volid.campaign import Campaign, ObservationSet, Station, standard_uncertainty
from volid.exceptions import InputError
from volid.model.machine import Axis, Machine
from volid.model.requests import LARGEST, ask_plan, ask_tools, ask_uncertainty, checked_count
from volid.observations import KINDS
from volid.observations.base import STATION
from volid.planning.circles import circles
from volid.planning.following import rotary_axes, with_rotary
from volid.planning.places import Places, spheres_and_tools
from volid.planning.rtest import displacement_plan
from volid.planning.standard import places_beside

STATIONS = 4
# in travels from the lower ends: around the volume, from which those farthest from the fit's stations are taken
FRACTIONS = (
    (0.5, -0.3, 0.4), (1.3, 0.45, 0.2), (0.5, 1.3, 0.8), (-0.3, 0.55, 0.6), (-0.2, -0.3, 0.9), (1.25, -0.2, 0.9), (1.2, 1.3, 0.9),
    (-0.3, 1.2, 0.1), (0.2, -0.35, -0.1), (0.8, 1.35, -0.1), (1.35, 0.9, 0.6),
)  # fmt: skip
LEVELS = 60  # positions of an axis on more of them are scattered: any other position stands between them
ROTARY_LEVELS = (12, 6)
MOVED = (
    (0.0, 0.0, -40.0),
    (-60.0, 50.0, -20.0),
    (70.0, -40.0, 10.0),
)  # mm, tool vectors against the middle of the fit's
TURN, RAISE = 45.0, 20.0  # degrees and mm: where spheres stand against those that a plan of the fit would choose
BAR = 0.8  # of the length of the fit's ball bar
U, U_SENSOR = 0.0005, 0.0005  # mm


def validation_plan(
    machine: Machine,
    fitted: Campaign,
    n: int = 60,
    tools: Sequence[Sequence[float]] | None = None,
    u: float | None = None,
    seed: int = 0,
) -> Campaign:
    """Plan of a campaign that tests what was identified from another one.

    A fit of R-test readings is tested by an R-test with other spheres, tool vectors and rotary positions; one of ball-bar
    readings alone by circles about another centre with another bar and tool; every other one by distances from stations where
    none of the fit's stood, to positions between the fit's levels. Collisions and lines of sight are not considered.

    Args:
        machine: The machine.
        fitted: The campaign that the solution was made from.
        n: Distances of every station, or readings of every circle.
        tools: Tool vectors [mm]; None: others than the fit's.
        u: Standard uncertainty of a reading [mm]; None: 0.5 µm.
        seed: Of the positions, an integer from 0.

    Returns:
        A campaign without readings, within the measured range of the fit.

    Raises:
        InputError: a number is none, the campaign was measured on another machine, or the machine cannot be measured so.

    Source: ISO/TR 16907 11.3.

    >>> import volid
    >>> fitted = volid.load_campaign("datasets/vertical_multilateration/campaign.toml")
    >>> plan = validation_plan(fitted.machine, fitted)
    >>> len(plan.stations), plan.n_readings
    (4, 240)
    """
    if machine.structure.split() != fitted.machine.structure.split():
        raise InputError(
            f"machine '{machine.name}' is '{machine.structure}', that of the solution '{fitted.machine.structure}'; expected the "
            "machine that was measured"
        )
    checked_count("n", n, 2, LARGEST)
    checked_count("seed", seed, 0, LARGEST)
    if tools is not None:
        ask_tools(machine, tools)
    if u is not None:
        ask_uncertainty("u", u)
    vectors = _other_tools(fitted) if tools is None else np.array(tools, dtype=float).reshape(-1, 3)
    if any(map(_is_sensor, fitted.sets)) and any(not a.is_linear for a in machine.axes):
        return _titled(_rtest(machine, fitted, None if tools is None else vectors, U_SENSOR if u is None else u))
    if all(map(_is_bar, fitted.sets)):
        return _titled(_circles(machine, fitted, vectors, n, U if u is None else u))
    return _titled(_distances(machine, fitted, vectors, n, U if u is None else u, seed))


def _is_sensor(readings: ObservationSet) -> bool:
    """Whether a set was read from a nest of sensors around a sphere."""
    return "sensor_on" in readings.options and bool(KINDS[readings.kind].standing)


def _is_bar(readings: ObservationSet) -> bool:
    """Whether a set was read with a bar about a pivot, whose length is known."""
    return STATION in KINDS[readings.kind].labels and not readings.options.get("relative", True)


def _titled(plan: Campaign) -> Campaign:
    return replace(plan, title="Validation", source="validation plan")


def _other_tools(fitted: Campaign) -> np.ndarray:
    """Tool vectors that the fit has not used."""
    return np.round(fitted.tool_vectors().mean(axis=0) + np.array(MOVED))


def between(axis: Axis, positions: np.ndarray) -> np.ndarray:
    """Positions of an axis between those of a fit, at a third of every interval and two, alternately; () where it stood still.

    >>> import volid
    >>> axis = volid.load_machine("models/wYXbZt_vertical.toml").axis("X")
    >>> between(axis, np.array([0.0, 300.0, 600.0, 600.0])).tolist()
    [100.0, 500.0]
    """
    levels = np.unique(np.round(positions, 6))
    share = np.where(np.arange(len(levels) - 1) % 2 == 0, 1.0 / 3.0, 2.0 / 3.0)
    return np.asarray(round_position(np.round(levels[:-1] + share * np.diff(levels), 1)))


def _lines(machine: Machine, fitted: Campaign) -> list[np.ndarray]:
    """Positions to choose from, by axis: between the fit's levels, or where it was measured without any, everywhere."""
    lines = []
    for axis, q in zip(machine.axes, fitted.positions.T, strict=True):
        low, high = float(q.min()), float(q.max())
        line = between(axis, q)
        lines.append(np.unique(np.round(np.linspace(low, high, 2 * LEVELS + 1), 1)) if len(line) > LEVELS else line)
    return [line if len(line) else q[:1] for line, q in zip(lines, fitted.positions.T, strict=True)]


def _distances(machine: Machine, fitted: Campaign, tools: np.ndarray, n: int, u: float, seed: int) -> Campaign:
    ask_plan("validation plan", STATIONS * n)
    unit = qmc.Halton(len(machine.axes), seed=seed + 1).random(STATIONS * n)
    lines = _lines(machine, fitted)
    numbers = [
        np.minimum((share * len(line)).astype(int), len(line) - 1) for line, share in zip(lines, unit.T, strict=True)
    ]
    positions = np.stack([line[number] for line, number in zip(lines, numbers, strict=True)], axis=1)
    segment = np.arange(n) * len(tools) // n
    names, empty = [f"V{i + 1}" for i in range(STATIONS)], np.full((len(positions), 1), np.nan)
    readings = ObservationSet(
        name="validation",
        kind="distance",
        positions=positions,
        directions=np.zeros_like(positions),
        tool=np.tile(tools[segment], (STATIONS, 1)),
        readings=empty,
        u=standard_uncertainty(u, empty),
        labels={"station": np.repeat(names, n), "segment": np.tile((segment + 1).astype(str), STATIONS)},
        options={"relative": True, "calibrated_u": 0.0, "u": u},
        source="validation plan",
    )
    chosen = _farthest(places_beside(machine, readings, tools, FRACTIONS), _stated(fitted))
    stations = tuple(Station(name, position=place) for name, place in zip(names, chosen, strict=True))
    return Campaign(machine, stations, (readings,))


def _stated(fitted: Campaign) -> np.ndarray:
    """Approximate places of the fit's stations, (s, 3) [mm]."""
    return np.array([s.position for s in fitted.stations if s.position is not None]).reshape(-1, 3)


def _farthest(places: list[tuple[float, float, float]], others: np.ndarray) -> list[tuple[float, float, float]]:
    """Four places, one after the other farthest from all before and from the fit's stations."""
    chosen: list[tuple[float, float, float]] = []
    for _ in range(STATIONS):
        taken = np.concatenate([others, np.array(chosen).reshape(-1, 3)])
        gaps = [float(np.min(np.linalg.norm(taken - p, axis=1), initial=1e9)) for p in np.array(places)]
        chosen.append(places[int(np.argmax(gaps))])
    return chosen


def _rtest(machine: Machine, fitted: Campaign, tools: np.ndarray | None, u: float) -> Campaign:
    axes = rotary_axes(machine)
    if len(axes) > 2:
        raise InputError(f"machine '{machine.name}' has {len(axes)} rotary axes; expected one or two for an R-test")
    lines = [
        _few(between(a, fitted.positions[:, machine.index(a.letter)]), m)
        for a, m in zip(axes, ROTARY_LEVELS, strict=False)
    ]
    grid = np.stack(
        [g.ravel() for g in np.meshgrid(*[line if len(line) else np.zeros(1) for line in lines], indexing="ij")]
    )
    positions = with_rotary(machine, **{a.letter: q for a, q in zip(axes, grid, strict=True)})
    vectors = _other_tools(fitted)[:1] if tools is None else tools
    places = spheres_and_tools(machine, positions, None, vectors.tolist())
    moved: dict[str, Sequence[float]] = {
        f"V{i + 1}": _moved(np.array(p), axes) for i, p in enumerate(places.spheres.values())
    }
    sensor_on = next(str(s.options["sensor_on"]) for s in fitted.sets if _is_sensor(s))
    still = np.zeros_like(positions)
    return displacement_plan(machine, positions, still, "validation", Places(moved, places.tools), sensor_on, u)


def _few(line: np.ndarray, n: int) -> np.ndarray:
    """At most n of the positions, spread over all."""
    return line[np.unique(np.linspace(0, len(line) - 1, min(n, len(line))).astype(int))] if len(line) else line


def _moved(place: np.ndarray, axes: Sequence[Axis]) -> tuple[float, float, float]:
    """A sphere turned about the table's axis and raised along it; without a table, moved aside."""
    table = next((a for a in axes if a.primed), None)
    if table is None:
        x, y, z = np.round(place + np.array([30.0, -25.0, RAISE])).tolist()
        return x, y, z
    along, centre, angle = np.array(table.unit_vector), np.array(table.point), np.deg2rad(TURN)
    arm = place - centre
    turned = np.cos(angle) * arm + np.sin(angle) * np.cross(along, arm) + (1 - np.cos(angle)) * (along @ arm) * along
    x, y, z = np.round(centre + turned + RAISE * along).tolist()
    return x, y, z


def _circles(machine: Machine, fitted: Campaign, tools: np.ndarray, n: int, u: float) -> Campaign:
    length = round(BAR * float(np.mean([np.mean(s.readings) for s in fitted.sets])))
    ranges = dict(
        zip(
            machine.letters, np.stack([fitted.positions.min(axis=0), fitted.positions.max(axis=0)], axis=1), strict=True
        )
    )
    at = [float(np.mean(ranges[a]) + 0.05 * np.ptp(ranges[a])) if a in ranges else 0.0 for a in "XYZ"]
    planes = [p for p in ("XY", "YZ", "ZX") if set(p) <= set(machine.letters)]
    calibrated = max(float(s.options.get("calibrated_u", 0.0)) for s in fitted.sets)
    return circles(
        machine, planes, tools[0], np.round(at + tools[0]), length=length, n=n, u=u, calibrated_u=calibrated or u
    )
