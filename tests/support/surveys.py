"""Surveys of one machine at several times, and few readings in between, from the exact chain."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
from exact_chain import Truth, default_stations, default_tools, random_truth
from exact_chain.tracker import tracker_campaign

from support.machines import VERTICAL, fixed, volid_machine
from support.trackers import distance_campaign
from volid.campaign import Campaign, Effect, ObservationSet, Station
from volid.fitting.fit import fit
from volid.fitting.solution import Solution
from volid.observations import KINDS

EXACT = VERTICAL
STATED = fixed(3)
TOOL = (0.0, 0.0, -150.0)
CENTRE = np.array([380.0, 215.0, -230.0])


@cache
def truth_of_tests() -> Truth:
    """Errors that three segments can follow nearly, so that a fit with these is accepted."""
    return random_truth(EXACT, np.random.default_rng(77), waviness=0.3, scale=0.4)


def changed(truth: Truth, name: str, size: float, place: float = 0.5) -> Truth:
    """The truth with one constant changed by `size`, or a cos² bump over half of the travel, highest at `place` of it."""
    other = copy.deepcopy(truth)
    if name[2] == "0":
        other.constants[name] = other.constants.get(name, 0.0) + size
        return other
    low, high = EXACT.travel[name[2]]
    before = other.functions[name]

    def bumped(q):
        away = (np.asarray(q, float) - low) / (high - low) - place
        return before(q) + size * np.where(np.abs(away) < 0.25, np.cos(2 * np.pi * away) ** 2, 0.0)

    other.functions[name] = bumped
    return other


def stretched(truth: Truth, axis: str, slope: float) -> Truth:
    """The truth with another scale of one axis, mm per mm about the middle of its travel."""
    other = copy.deepcopy(truth)
    name, middle = f"E{axis}{axis}", float(np.mean(EXACT.travel[axis]))
    before = other.functions[name]
    other.functions[name] = lambda q: before(q) + slope * (np.asarray(q, float) - middle)
    return other


def survey(
    truth: Truth,
    seed: int,
    extra: str = STATED,
    *,
    n: int = 50,
    scale: float | None = None,
    reach: float = 1.0,
    date: str = "",
) -> Campaign:
    """Six stations, three tools seen by all. `scale`: error of the tracker's scale, which is then stated as an effect with
    u = 1e-6; `reach`: part of X that is measured."""
    rng = np.random.default_rng(seed)
    tracker = tracker_campaign(EXACT, truth, rng, n_per_station=n, every_station_sees_every_tool=True)
    tracker.distance = tracker.distance * (1.0 + (scale or 0.0))
    kept = np.flatnonzero(tracker.q[:, EXACT.axes.index("X")] <= reach * EXACT.travel["X"][1])
    found = distance_campaign(volid_machine(EXACT, extra), tracker, 5.0, seed)
    effects = () if scale is None else (Effect("tracker scale", "scale", 1e-6, "campaign"),)
    sets = tuple(replace(s.rows_of(kept), effects=effects) for s in found.sets)
    return replace(found, sets=sets, conditions={"date": date} if date else {}, source=f"survey {seed}")


@cache
def surveyed(seed: int, change: tuple[str, float] = ("", 0.0), extra: str = STATED) -> Solution:
    """The solution of a survey of the tests' machine, after a change."""
    truth = changed(truth_of_tests(), *change) if change[0] else truth_of_tests()
    return fit(survey(truth, seed, extra))


def few_distances(truth: Truth, seed: int, extra: str = STATED, stations: int = 2, n: int = 20) -> Campaign:
    """Forty distances with one tool, from two of the stations."""
    chosen = dict(list(default_stations(EXACT).items())[:stations])
    rng = np.random.default_rng(seed)
    tracker = tracker_campaign(EXACT, truth, rng, stations=chosen, tools=default_tools()[:1], n_per_station=n)
    return distance_campaign(volid_machine(EXACT, extra), tracker, 5.0, seed)


def _one_set(machine, q: np.ndarray, **fields) -> ObservationSet:
    still = np.zeros_like(q)
    return ObservationSet(positions=q, directions=still, tool=np.tile(TOOL, (len(q), 1)), **fields)


def circle(truth: Truth, seed: int, extra: str = STATED, plane: str = "XY", radius: float = 150.0) -> Campaign:
    """A circle of a calibrated ball bar, 36 places, u = 0.5 µm."""
    machine, rng = volid_machine(EXACT, extra), np.random.default_rng(seed)
    angle = np.deg2rad(np.arange(0.0, 360.0, 10.0))
    at = np.tile(CENTRE, (len(angle), 1))
    for letter, value in zip(plane, (np.cos(angle), np.sin(angle)), strict=True):
        at[:, "XYZ".index(letter)] += radius * value
    q = at[:, ["XYZ".index(a) for a in EXACT.axes]]
    socket = CENTRE + np.array(TOOL)
    length = np.linalg.norm(EXACT.functional_point(q, np.tile(TOOL, (len(q), 1)), truth, None) - socket, axis=1)
    readings = (length + 0.0005 * rng.standard_normal(len(q)))[:, None]
    labels = {"station": np.full(len(q), "ball"), "segment": np.full(len(q), "1")}
    options = {**KINDS["distance"].options, "relative": False, "calibrated_u": 0.0005}
    s = _one_set(
        machine, q, name="circle", kind="distance", readings=readings, u=np.full_like(readings, 0.0005), labels=labels,
        options=options,
    )  # fmt: skip
    return Campaign(machine, (Station("ball", position=tuple((socket + 0.1).tolist())),), (s,), source="circle")


def diagonals(truth: Truth, seed: int, extra: str = STATED, n: int = 10) -> Campaign:
    """Four body diagonals by an interferometer, n places each, u = 0.5 µm."""
    machine, rng = volid_machine(EXACT, extra), np.random.default_rng(seed)
    low, high = (np.array([EXACT.travel[a][i] for a in "XYZ"], float) for i in (0, 1))
    rows, readings, names, lines = [], [], [], {}
    for k, signs in enumerate(((1, 1, 1), (-1, 1, 1), (1, -1, 1), (1, 1, -1))):
        start, end = np.where(np.array(signs) > 0, low, high), np.where(np.array(signs) > 0, high, low)
        along = (end - start) / np.linalg.norm(end - start)
        at = start + np.linspace(0.0, 1.0, n)[:, None] * (end - start)
        q = at[:, ["XYZ".index(a) for a in EXACT.axes]]
        point = EXACT.functional_point(q, np.tile(TOOL, (n, 1)), truth, None)
        rows.append(q)
        readings.append((point - point[0]) @ along + 0.0005 * rng.standard_normal(n))
        names += [f"D{k}"] * n
        lines[f"D{k}"] = along.tolist()
    values = np.concatenate(readings)[:, None]
    options = {**KINDS["projection"].options, "lines": lines}
    s = _one_set(
        machine, np.concatenate(rows), name="diagonals", kind="projection", readings=values, options=options,
        u=np.full_like(values, 0.0005), labels={"line": np.array(names), "segment": np.full(len(names), "1")},
    )  # fmt: skip
    return Campaign(machine, (), (s,), source="diagonals")


def together(campaigns: Sequence[Campaign]) -> Campaign:
    """All sets as one campaign, stations of each by names of their own."""
    sets, stations = [], []
    for i, campaign in enumerate(campaigns):
        stations += [replace(s, name=f"{s.name} {i}") for s in campaign.stations]
        for s in campaign.sets:
            labels = {**s.labels, "station": np.array([f"{n} {i}" for n in s.labels["station"]])}
            sets.append(replace(s, name=f"{s.name} {i}", labels=labels))
    return replace(campaigns[0], stations=tuple(stations), sets=tuple(sets))
