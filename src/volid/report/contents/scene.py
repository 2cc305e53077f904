"""Where everything of a campaign stood: stations, beams, measured points, spheres, lines and tools, as places in space.

Places are those of the nominal chain. Readings from a station stand in the frame of the station's body, all others where the
functional point is while the rotary axes of the table are at 0, so that turned spheres and lines are seen where the tool was.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from volid.campaign import Campaign, ObservationSet, Station
from volid.exceptions import VolidError
from volid.fitting.solution import Solution
from volid.model.iso230 import LINEAR_AXES
from volid.model.kinematics import nominal_point
from volid.model.machine import WORKPIECE, Machine
from volid.observations import KINDS

if TYPE_CHECKING:
    from jaxtyping import Float

MOST_POINTS, MOST_BEAMS, MOST_TOOLS = 1500, 40, 6  # of a campaign, of a station, of a campaign
TOOL_DIGITS = 3  # decimal places of mm: tool vectors nearer than this are drawn as one
LINE = "line"  # label of sets that are read line by line


class Points(NamedTuple):
    """Measured points of one set: places (m, 3) [mm], the largest |residual| / u of each (m,), NaN where there is none; names of
    the stations they are measured from, () without stations."""

    name: str
    kind: str
    places: np.ndarray
    normalised: np.ndarray
    stations: tuple[str, ...] = ()


class Stand(NamedTuple):
    """A station or a sphere: its name, body and place (3,) [mm] with all axes at 0."""

    name: str
    body: str
    place: np.ndarray


@dataclass(frozen=True, eq=False)
class Scene:
    """What a campaign looked like.

    Args:
        box: Corners of the working volume, functional point of the tool vector that was asked for, shape (8, 3) [mm].
        points: Measured points, set by set.
        stations: Stations, where the fit found them or the campaign states them.
        beams: By station, places that its beams go to, thinned, shape (m, 3) [mm].
        spheres: Spheres and nests, where the campaign states them.
        lines: Places along every line of readings, and between the two ends of every measured length, each (m, 3) [mm].
        tools: Ends of every tool vector, spindle side and functional point, each (2, 3) [mm].
        not_placed: Names of stations of which no place is known.
        n_points: Number of points before they were thinned.
    """

    box: Float[np.ndarray, "8 3"]
    points: tuple[Points, ...]
    stations: tuple[Stand, ...]
    beams: Mapping[str, np.ndarray]
    spheres: tuple[Stand, ...]
    lines: tuple[np.ndarray, ...]
    tools: tuple[np.ndarray, ...]
    not_placed: tuple[str, ...]
    n_points: int


def scene_of(solution: Solution, tool: Sequence[float]) -> Scene:
    """Places of a solution's campaign.

    Args:
        solution: A solution, as `volid.fit` makes it.
        tool: Tool vector that the working volume is drawn for, shape (3,) [mm].

    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/vertical_multilateration/campaign.toml"))
    >>> found = scene_of(solution, (0.0, 0.0, -150.0))
    >>> [s.name for s in found.stations], found.n_points, found.beams["S1"].shape
    (['S1', 'S2', 'S3', 'S4', 'S5', 'S6'], 2400, (40, 3))
    """
    campaign = solution.campaign
    stations, lost = _stations(solution)
    seen = [_points(solution, i) for i in range(len(campaign.sets))]
    n_points = sum(len(p.places) for p in seen)
    step = max(1, -(-n_points // MOST_POINTS))
    return Scene(
        box=_box(solution.machine, np.asarray(tool, dtype=float)),
        points=tuple(p._replace(places=p.places[::step], normalised=p.normalised[::step]) for p in seen),
        stations=stations,
        beams={s.name: b for s in stations if len(b := _beams(campaign, s.name))},
        spheres=tuple(_spheres(campaign)),
        lines=tuple(line for s in campaign.sets for line in _lines(s, campaign.machine)),
        tools=tuple(_tools(campaign)),
        not_placed=lost,
        n_points=n_points,
    )


def seen_from_table(machine: Machine, positions: np.ndarray, tool: np.ndarray) -> np.ndarray:
    """Functional points (m, 3) [mm] in the workpiece frame, as if the rotary axes of the table stood at 0."""
    turning = [i for i, a in enumerate(machine.axes) if a.primed and not a.is_linear]
    still = np.array(positions, dtype=float)
    still[:, turning] = 0.0
    return nominal_point(machine, still, tool)


def _box(machine: Machine, tool: np.ndarray) -> np.ndarray:
    axes = {a.letter: a for a in machine.axes if a.is_linear}
    corners = product(*(axes[a].travel if a in axes else (0.0, 0.0) for a in LINEAR_AXES))
    q = np.zeros((8, len(machine.axes)))
    for row, corner in enumerate(corners):
        for letter, value in zip(LINEAR_AXES, corner, strict=True):
            if letter in axes:
                q[row, machine.index(letter)] = value
    return nominal_point(machine, q, tool)


def _points(solution: Solution, number: int) -> Points:
    campaign, s = solution.campaign, solution.campaign.sets[number]
    stations = tuple(str(n) for n in dict.fromkeys(KINDS[s.kind].stations_of(s).tolist()))
    with np.errstate(invalid="ignore"):
        size = np.abs(np.asarray(solution.readings.normalised[number], dtype=float)).reshape(len(s), -1)
    largest = np.where(np.isfinite(size).any(axis=1), np.max(np.nan_to_num(size), axis=1), np.nan)
    return Points(s.name, s.kind, _places(campaign, s), largest, stations)


def _places(campaign: Campaign, observations: ObservationSet) -> np.ndarray:
    """Where the points of a set are drawn: as its stations see them, else where the tool was."""
    places = seen_from_table(campaign.machine, observations.positions, observations.tool)
    for beam in KINDS[observations.kind].beams(observations, campaign):
        if beam.rows is not None:
            places[beam.rows] = beam.targets
    return places


def _stations(solution: Solution) -> tuple[tuple[Stand, ...], tuple[str, ...]]:
    """Stations that readings are made from, with their places; names of those without."""
    campaign, found = solution.campaign, _found_places(solution)
    used = [n for s in campaign.sets for n in dict.fromkeys(KINDS[s.kind].stations_of(s).tolist())]
    stands, lost = [], []
    for name in dict.fromkeys(used):
        station = campaign.station(name)
        place = _place(station, found)
        if place is None:
            lost.append(str(name))
        else:
            stands.append(Stand(str(name), station.body, place))
    return tuple(stands), tuple(lost)


def _found_places(solution: Solution) -> dict[tuple[str, ...], float]:
    """Coordinates of stations by their keys: as fitted, else as the readings alone place them."""
    campaign = solution.campaign
    fitted = zip(solution.nuisance_table, np.asarray(solution.nuisance).tolist(), strict=True)
    found = {n.key: value for n, value in fitted if n.key[:1] == ("station",)}
    if any(s.is_placed for s in campaign.stations):
        try:
            starts = [KINDS[name].starts(campaign) for name in dict.fromkeys(s.kind for s in campaign.sets)]
        except VolidError:  # the fit had help that the readings alone do not give
            starts = []
        found = {k: v for part in starts for k, v in part.items() if k[:1] == ("placed",)} | found
    return found


def _place(station: Station, found: Mapping[tuple[str, ...], float]) -> np.ndarray | None:
    for what in ("station", "placed"):
        keys = [(what, station.name, c) for c in "XYZ"]
        if all(k in found for k in keys):
            return np.array([found[k] for k in keys])
    stated = station.position is not None and not station.is_placed
    return np.array(station.position, dtype=float) if stated else None


def _beams(campaign: Campaign, name: str) -> np.ndarray:
    """Places that the beams of a station go to, thinned, (m, 3) [mm]; none for a kind whose readings are no lengths."""
    found = [b.targets for s in campaign.sets for b in KINDS[s.kind].beams(s, campaign) if b.station.name == name]
    targets = np.concatenate(found) if found else np.zeros((0, 3))
    return np.asarray(targets[:: max(1, -(-len(targets) // MOST_BEAMS))])


def _spheres(campaign: Campaign) -> Iterator[Stand]:
    """Spheres and nests by name, each once."""
    given = {n: p for s in campaign.sets for n, p in KINDS[s.kind].standing_at(s).items()}
    for name, place in given.items():
        yield Stand(str(name), WORKPIECE, np.asarray(place, dtype=float))


def _lines(observations: ObservationSet, machine: Machine) -> Iterator[np.ndarray]:
    """Places along every line of a set; of lengths between two functional points the two of every row."""
    first = seen_from_table(machine, observations.positions, observations.tool)
    if observations.to is not None:
        second = seen_from_table(machine, observations.to.positions, observations.to.tool)
        step = max(1, len(first) // MOST_BEAMS)
        yield from np.stack([first, second], axis=1)[::step]
    elif LINE in observations.labels:
        labels = observations.labels[LINE]
        for name in dict.fromkeys(labels.tolist()):
            yield first[labels == name]


def _tools(campaign: Campaign) -> Iterator[np.ndarray]:
    """The tool vectors of readings that see the tool, each drawn once, at the middle one of its points."""
    sets = [s for s in campaign.sets if KINDS[s.kind].sees_tool(s)]
    if not sets:
        return
    tools = np.concatenate([s.tool for s in sets])
    positions = np.concatenate([s.positions for s in sets])
    vectors, numbers = np.unique(np.round(tools, TOOL_DIGITS), axis=0, return_inverse=True)
    for k, vector in enumerate(vectors[:MOST_TOOLS]):
        if not vector.any():
            continue
        own = positions[np.ravel(numbers) == k]
        middle = own[[int(np.argmin(np.linalg.norm(own - own.mean(axis=0), axis=1)))]]
        ends = [seen_from_table(campaign.machine, middle, t)[0] for t in (np.zeros(3), vector)]
        yield np.array(ends)
