"""Sound campaigns of every kind on the exact chain, and the ordinary mistakes that people make in what they write of one.

The mistakes are written here apart from the package's own list of slips. Each has words by which a message is known to name it.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from exact_chain import ExactMachine, random_truth, spread_positions, tracker_campaign

from support.machines import MACHINES, exact_machine, volid_machine
from support.points import PLACE, TURN
from support.rtests import NO_LINEAR, r_test, r_test_campaign, rotary_only
from support.trackers import distance_campaign
from volid.campaign import Campaign, ObservationSet, Station

TOOLS = np.array([(0.0, 0.0, -150.0), (80.0, 0.0, -250.0), (0.0, 90.0, -200.0)])


class Sound(NamedTuple):
    """A campaign without a mistake: its name, itself."""

    name: str
    campaign: Campaign


# --------------------------------------------------------------------------------------------------- sound campaigns


def distances(exact: ExactMachine, seed: int, u: float = 0.0005, scale: float = 1.0, n: int = 90, **plan) -> Campaign:
    """Six unknown stations, three tool vectors, one dead path for every station and tool."""
    rng = np.random.default_rng(seed)
    truth = random_truth(exact, rng, scale=scale)
    plan = {"every_station_sees_every_tool": True, "u_constant": u, "u_proportional": 0.0} | plan
    tracker = tracker_campaign(exact, truth, rng, n_per_station=n, **plan)
    return distance_campaign(volid_machine(exact), tracker, 5.0, seed)


def points(exact: ExactMachine, seed: int, u: float = 0.003, scale: float = 1.0, n: int = 200) -> Campaign:
    """Coordinates from one station in its own frame."""
    rng = np.random.default_rng(seed)
    truth = random_truth(exact, rng, scale=scale)
    q = spread_positions(exact, n, rng)
    tool = TOOLS[np.arange(n) % 3]
    target = exact.functional_point(q, tool, truth)
    read = (target - PLACE) @ TURN.T + u * rng.standard_normal(target.shape)
    labels = {"station": np.full(n, "T")}
    s = ObservationSet(
        "tracker", "point", q, np.zeros_like(q), tool, read, np.full_like(read, u), labels, source="t.csv"
    )
    return Campaign(volid_machine(exact), (Station("T"),), (s,))


def ball_bar(exact: ExactMachine, seed: int, u: float = 0.0005, scale: float = 1.0, n: int = 60) -> Campaign:
    """Lengths of 150 mm from three sockets amid the volume, on spheres, with three tool vectors."""
    rng = np.random.default_rng(seed)
    truth = random_truth(exact, rng, scale=scale)
    low, high = (np.array([exact.travel[a][k] for a in exact.axes]) for k in (0, 1))
    order = [exact.axes.index(a) for a in "XYZ"]
    places, rows = {}, []
    for k, share in enumerate(((0.4, 0.5, 0.5), (0.6, 0.5, 0.45), (0.5, 0.55, 0.5))):
        for tool in TOOLS:
            way = rng.standard_normal((n // 3, 3))
            way /= np.linalg.norm(way, axis=1)[:, None]
            centre = (low + np.array(share) * (high - low))[order]
            q = np.empty_like(way)
            q[:, order] = centre + 150.0 * way
            name = f"C{k}{TOOLS.tolist().index(tool.tolist())}"
            places[name] = centre + tool
            target = exact.functional_point(q, np.tile(tool, (len(q), 1)), truth)
            rows.append(
                (q, np.tile(tool, (len(q), 1)), np.linalg.norm(target - places[name], axis=1), np.full(len(q), name))
            )
    q, tool, length, station = (np.concatenate(part) for part in zip(*rows, strict=True))
    reading = (length + u * rng.standard_normal(len(q)))[:, None]
    labels = {"station": station, "segment": np.full(len(q), "1")}
    s = ObservationSet(
        "bar", "distance", q, np.zeros_like(q), tool, reading, np.full_like(reading, u), labels,
        options={"relative": False, "calibrated_u": 0.0}, source="bar.csv",
    )  # fmt: skip
    stations = tuple(Station(name, position=tuple((p + rng.normal(0, 1, 3)).tolist())) for name, p in places.items())
    return Campaign(volid_machine(exact), stations, (s,))


def components(exact: ExactMachine, seed: int, u: float = 0.0005, scale: float = 1.0, n: int = 21) -> Campaign:
    """All six components along every axis, twice, by instruments of their own."""
    rng = np.random.default_rng(seed)
    truth = random_truth(exact, rng, scale=scale)
    middle = np.array([np.mean(exact.travel[a]) for a in exact.axes])
    q, kind, line = [], [], []
    for i, axis in enumerate(exact.axes):
        run = np.tile(middle, (n, 1))
        run[:, i] = np.linspace(*exact.travel[axis], n)
        for c in "XYZABC":
            for _ in range(2):
                q.append(run)
                kind += [c] * n
                line += [axis] * n
    positions, tool = np.concatenate(q), np.zeros((len(kind), 3))
    pick = np.array(["XYZABC".index(c) for c in kind])
    value = exact.deviation(positions, tool, truth)[np.arange(len(kind)), pick]
    uncertainty = np.where(pick < 3, u, u / 500.0)
    value = value + uncertainty * rng.standard_normal(len(value))
    labels = {"component": np.array(kind), "line": np.array(line)}
    s = ObservationSet(
        "direct", "component", positions, np.zeros_like(positions), tool, value[:, None], uncertainty[:, None], labels,
        options={"slope": False}, source="direct.csv", time=np.arange(len(kind)) * 10.0,
    )  # fmt: skip
    return Campaign(volid_machine(exact), (), (s,))


def spheres(structure: str, seed: int, u: float = 0.0005, scale: float = 1.0) -> Campaign:
    """An R-test of the rotary axes."""
    exact = exact_machine(structure)
    truth = rotary_only(random_truth(exact, np.random.default_rng(seed), scale=scale))
    counts = dict(zip((a for a in exact.axes if a in "ABC"), (7, 13), strict=False))
    data = r_test(exact, truth, np.random.default_rng(seed), counts=counts, noise=u)
    return r_test_campaign(volid_machine(exact, NO_LINEAR), data, u=u, range=max(2.0, 2000.0 * scale))


def sound_campaigns(seed: int) -> Iterator[Sound]:
    """One of every kind and layout."""
    for layout, exact in MACHINES.items():
        yield Sound(f"distance, {layout}", distances(exact, seed))
        yield Sound(f"point, {layout}", points(exact, seed))
        yield Sound(f"ball bar, {layout}", ball_bar(exact, seed))
        yield Sound(f"component, {layout}", components(exact, seed))
    for structure in ("w C' A' Y' X' b Z t", "w b X Y Z C B t"):
        yield Sound(f"displacement, {structure}", spheres(structure, seed))


# ------------------------------------------------------------------------------------------------------------- mistakes


class Mistake(NamedTuple):
    """What was done wrong, a pattern that a message has when it names it, and the campaign as it was written down; None where the
    mistake cannot be made in it."""

    name: str
    named: str
    make: Callable[[Campaign], Campaign | None]


def is_same(one: Campaign, other: Campaign) -> bool:
    """Whether a mistake changed nothing, because it could not be made."""

    def text(c: Campaign) -> str:
        with np.printoptions(threshold=10**9):
            return repr([(s.positions, s.tool, s.readings, s.u, s.labels, s.options, s.temperature) for s in c.sets])

    return one.stations == other.stations and text(one) == text(other)


def _each(change: Callable[[ObservationSet], ObservationSet]) -> Callable[[Campaign], Campaign]:
    return lambda c: replace(c, sets=tuple(change(s) for s in c.sets))


def _kinds(*kinds: str) -> Callable[[Callable[[Campaign], Campaign | None]], Callable[[Campaign], Campaign | None]]:
    def only(make: Callable[[Campaign], Campaign | None]) -> Callable[[Campaign], Campaign | None]:
        return lambda c: make(c) if all(s.kind in kinds for s in c.sets) else None

    return only


def _linear(c: Campaign) -> np.ndarray:
    return np.array([axis.is_linear for axis in c.machine.axes])


def _positions(factor: float) -> Callable[[Campaign], Campaign]:
    return lambda c: _each(lambda s: replace(s, positions=s.positions * np.where(_linear(c), factor, 1.0)))(c)


def _readings(factor: float) -> Callable[[Campaign], Campaign]:
    return _each(lambda s: replace(s, readings=s.readings * factor))


def _tools(*factors: float) -> Callable[[Campaign], Campaign | None]:
    def make(c: Campaign) -> Campaign | None:
        if not any((s.tool * (np.array(factors) != 1.0)).any() for s in c.sets):
            return None
        return _each(lambda s: replace(s, tool=s.tool * np.array(factors)))(c)

    return make


def _negated(letter: str) -> Callable[[Campaign], Campaign | None]:
    def make(c: Campaign) -> Campaign | None:
        if letter not in c.machine.letters or not c.positions[:, c.machine.index(letter)].any():
            return None
        i = c.machine.index(letter)
        return _each(
            lambda s: replace(s, positions=np.where(np.arange(s.positions.shape[1]) == i, -1, 1) * s.positions)
        )(c)

    return make


def _swapped(a: str, b: str) -> Callable[[Campaign], Campaign | None]:
    def make(c: Campaign) -> Campaign | None:
        if not {a, b} <= set(c.machine.letters):
            return None
        i, j = c.machine.index(a), c.machine.index(b)
        columns = [j if k == i else i if k == j else k for k in range(len(c.machine.axes))]
        return _each(lambda s: replace(s, positions=s.positions[:, columns], directions=s.directions[:, columns]))(c)

    return make


def _radians(c: Campaign) -> Campaign | None:
    if _linear(c).all():
        return None
    return _each(lambda s: replace(s, positions=np.where(_linear(c), s.positions, np.deg2rad(s.positions))))(c)


def _labels(c: Campaign) -> Campaign:
    """Two stations exchanged in the rows with one tool vector."""

    def change(s: ObservationSet) -> ObservationSet:
        rows, names = (s.tool == TOOLS[1]).all(axis=1), s.labels["station"]
        turned = np.where(names == "S1", "S2", np.where(names == "S2", "S1", names))
        return replace(s, labels={**s.labels, "station": np.where(rows, turned, names)})

    return _each(change)(c)


def _one_segment(c: Campaign) -> Campaign:
    return _each(lambda s: replace(s, labels={**s.labels, "segment": np.full(len(s), "1")}))(c)


def _absolute(c: Campaign) -> Campaign | None:
    if not any(s.options.get("relative") for s in c.sets):
        return None
    return _each(lambda s: replace(s, options={**s.options, "relative": False}))(c)


def _u(factor: float) -> Callable[[Campaign], Campaign]:
    return _each(lambda s: replace(s, u=s.u * factor))


def _degrees(c: Campaign) -> Campaign:
    def change(s: ObservationSet) -> ObservationSet:
        rows = np.isin(s.labels["component"], list("ABC"))[:, None]
        return replace(
            s, readings=np.where(rows, np.rad2deg(s.readings), s.readings), u=np.where(rows, np.rad2deg(s.u), s.u)
        )

    return _each(change)(c)


def _only_degrees(c: Campaign) -> Campaign:
    """Angles in degrees, with their u in rad."""
    turned = _degrees(c)
    return replace(turned, sets=tuple(replace(s, u=o.u) for s, o in zip(turned.sets, c.sets, strict=True)))


def _both(factor: float) -> Callable[[Campaign], Campaign]:
    return _each(lambda s: replace(s, readings=s.readings * factor, u=s.u * factor))


_mirrored = _each(lambda s: replace(s, readings=s.readings * np.array([1.0, -1.0, 1.0])))


def _stations(factor: float) -> Callable[[Campaign], Campaign]:
    def make(c: Campaign) -> Campaign:
        moved = (replace(s, position=tuple(factor * v for v in s.position)) if s.position else s for s in c.stations)
        return replace(c, stations=tuple(moved))

    return make


def _known(c: Campaign) -> Campaign | None:
    """Approximate positions stated as known in the machine's frame."""
    if not any(s.position for s in c.stations):
        return None
    return replace(c, stations=tuple(replace(s, known=True, frame="machine") for s in c.stations))


def _kelvin(c: Campaign) -> Campaign:
    return _each(lambda s: replace(s, temperature=np.full(len(s), 293.15)))(c)


U_IS_OFF = "stated u .* times as large|all u are too small|u is .* nm|worse than stated|u is at most|far below"
MISTAKES = (
    Mistake("readings in metres", "metres", _kinds("distance", "point")(_readings(1e-3))),
    Mistake("readings in metres, u too", "metres", _kinds("distance", "point")(_both(1e-3))),
    Mistake("readings in micrometres", "micrometres|µm|µrad", _kinds("distance", "point", "component")(_readings(1e3))),
    Mistake(
        "readings in micrometres, u too", "micrometres|µm|µrad", _kinds("distance", "point", "component")(_both(1e3))
    ),
    Mistake("readings in inches", "inch", _kinds("distance", "point")(_readings(1 / 25.4))),
    Mistake("positions in metres", "metres", _positions(1e-3)),
    Mistake("positions in inches", "inch", _kinds("distance", "point", "displacement")(_positions(1 / 25.4))),
    Mistake("positions in micrometres", "micrometres", _positions(1e3)),
    Mistake("rotary positions in radians", "radians", _radians),
    Mistake("angles in degrees", "degrees", _kinds("component")(_only_degrees)),
    Mistake("angles and their u in degrees", "degrees", _kinds("component")(_degrees)),
    Mistake("tool vectors in metres", "tool vectors", _tools(1e-3, 1e-3, 1e-3)),
    Mistake("tool vectors negated", "tool vectors", _tools(-1.0, -1.0, -1.0)),
    Mistake("tool_z with the wrong sign", "tool vectors", _tools(1.0, 1.0, -1.0)),
    *(Mistake(f"{a} counts the other way", f"{a} counts|{a}.*outside", _negated(a)) for a in "XYZABC"),
    *(
        Mistake(f"columns {a} and {b} exchanged", f"{a} and {b}|{b} and {a}", _swapped(a, b))
        for a, b in (("X", "Y"), ("X", "Z"), ("Y", "Z"), ("C", "A"), ("C", "B"))
    ),
    Mistake("frame of the other hand", "hand", _kinds("point", "displacement")(_mirrored)),
    Mistake("readings negated", "sign|negative", _kinds("distance")(_readings(-1.0))),
    Mistake("two stations exchanged with one tool", "exchanged", _kinds("distance")(_labels)),
    Mistake("beams broken at tool changes, one segment", "segment|broken|dead path", _kinds("distance")(_one_segment)),
    Mistake("dead paths taken for absolute lengths", "dead path|relative", _kinds("distance")(_absolute)),
    Mistake("stations in metres", "metres|station", _kinds("distance")(_stations(1e-3))),
    Mistake("approximate stations stated as known", "known", _kinds("distance")(_known)),
    Mistake("u in micrometres", U_IS_OFF, _u(1e3)),
    Mistake("u in metres", U_IS_OFF, _u(1e-3)),
    Mistake("u ten times too large", U_IS_OFF, _u(15.0)),
    Mistake("u ten times too small", U_IS_OFF, _u(1 / 15.0)),
    Mistake("temperatures in kelvin", "kelvin", _kelvin),
)


def is_named(mistake: Mistake, text: str) -> bool:
    """Whether a message names the mistake."""
    return re.search(mistake.named, text) is not None
