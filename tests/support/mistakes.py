"""Campaigns with one mistake each: what a user may get wrong, or what a machine does that the model leaves out.

Every maker takes a layout of `MACHINES`, a seed and a size [mm], and gives the campaign as its user has it, with the truth.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from exact_chain import ExactMachine, Truth, default_tools, random_truth
from exact_chain.tracker import TrackerCampaign, tracker_campaign
from exact_chain.truth import Product

from support.machines import MACHINES, volid_machine
from support.trackers import distance_campaign
from volid.campaign import Campaign

PER_STATION = 400
PITCHES = (5.0, 10.0, 20.0)


class Case(NamedTuple):
    """A machine with its truth, what was measured, and the exact places of the target (m, 3) [mm]."""

    exact: ExactMachine
    truth: Truth
    tracker: TrackerCampaign
    points: np.ndarray


class Made(NamedTuple):
    """A campaign as its user has it, and the truth and machine that it is judged by."""

    campaign: Campaign
    truth: Truth
    exact: ExactMachine


def case_of(
    layout: str, seed: int, *, n: int = PER_STATION, scale: float = 1.0, truth_of: Any = None, levels: int | None = None
) -> Case:
    """Six stations of n distances; every station sees every tool, one after another."""
    exact, rng = MACHINES[layout], np.random.default_rng(31_000 + seed)
    truth = random_truth(exact, rng, scale=scale)
    if truth_of is not None:
        truth = truth_of(exact, truth, rng)
    tracker = tracker_campaign(exact, truth, rng, n_per_station=n, every_station_sees_every_tool=True, n_grid=levels)
    return Case(exact, truth, tracker, exact.functional_point(tracker.q, tracker.tool, truth, tracker.direction))


def campaign_of(
    case: Case, distance: np.ndarray | None = None, stated: ExactMachine | None = None, **columns: Any
) -> Made:
    """The campaign with other distances, on another stated machine, with further columns."""
    tracker = case.tracker if distance is None else replace(case.tracker, distance=distance)
    machine = volid_machine(stated or case.exact)
    made = distance_campaign(volid_machine(case.exact), tracker, 5.0, 1)
    own = [case.exact.axes.index(a) for a in machine.letters]
    (s,) = made.sets
    s = replace(s, positions=s.positions[:, own], directions=s.directions[:, own], **columns)
    return Made(replace(made, machine=machine, sets=(s,)), case.truth, case.exact)


def _longer(case: Case, moved: np.ndarray, rows: np.ndarray | None = None) -> np.ndarray:
    """Distances when the target is displaced by `moved` (m, 3) [mm] in the workpiece frame, in some rows."""
    stations = np.array([case.tracker.station_positions[name] for name in case.tracker.station])
    ray = case.points - stations
    change = np.linalg.norm(ray + moved, axis=1) - np.linalg.norm(ray, axis=1)
    return case.tracker.distance + (change if rows is None else np.where(rows, change, 0.0))


def drift(layout: str, seed: int, size: float, **how: Any) -> Made:
    """One station moves on a straight line while it measures."""
    case, rng = case_of(layout, seed, **how), np.random.default_rng(seed)
    name = f"S{1 + seed % 6}"
    rows = case.tracker.station == name
    t = np.zeros(len(rows))
    t[rows] = np.linspace(-0.5, 0.5, int(rows.sum()))
    way = rng.standard_normal(3)
    way /= np.linalg.norm(way)
    return campaign_of(case, _longer(case, -size * np.outer(t, way), rows))


def growth(layout: str, seed: int, size: float, *, by_temperature: bool = False, **how: Any) -> Made:
    """Axes and spindle grow with time, or with a temperature that rises and falls."""
    case = case_of(layout, seed, **how)
    m = len(case.points)
    t = np.linspace(0.0, 1.0, m)
    grown = np.sin(5.0 * t + seed) + 0.3 * t if by_temperature else 1.0 - np.exp(-2.0 * t)
    low, high = (np.array([case.exact.travel[a][k] for a in case.exact.axes]) for k in (0, 1))
    share = (case.tracker.q - low) / (high - low) - 0.5
    moved = np.zeros((m, 3))
    for i, axis in enumerate(case.exact.axes):
        moved[:, "XYZ".index(axis)] = grown * share[:, i] * (1.0, 0.7, 0.4)[i]
    moved[:, 2] += 0.3 * grown
    columns: dict[str, Any] = {"time": 3600.0 * 6.0 * t}
    if by_temperature:
        columns["temperature"] = 20.0 + grown
    return campaign_of(case, _longer(case, size * moved), **columns)


def warmth(layout: str, seed: int, size: float, **how: Any) -> Made:
    """Growth with a recorded temperature."""
    return growth(layout, seed, size, by_temperature=True, **how)


def broken(layout: str, seed: int, size: float, **how: Any) -> Made:
    """A beam is broken inside a segment, and nobody notices."""
    case, rng = case_of(layout, seed, **how), np.random.default_rng(seed)
    tracker = case.tracker
    rows = np.flatnonzero((tracker.station == f"S{1 + seed % 6}") & (tracker.segment == 1 + seed % 3))
    first = rows[int(len(rows) * rng.uniform(0.25, 0.75))]
    later = np.isin(np.arange(len(tracker.distance)), rows) & (np.arange(len(tracker.distance)) >= first)
    return campaign_of(case, tracker.distance + size * later)


CROSSED = {
    "vertical": (("EYX", "Z"), ("EAX", "Y"), ("EZX", "Y"), ("ECY", "Z"), ("EXZ", "Y"), ("EAZ", "X")),
    "gantry": (("EYX", "Z"), ("EAY", "X"), ("EZY", "X"), ("EBX", "Z"), ("EXZ", "X"), ("ECX", "Y")),
    "horizontal": (("EXY", "Z"), ("EAY", "X"), ("EZX", "Y"), ("EBZ", "X"), ("EYZ", "X"), ("ECX", "Z")),
}


def crossed(layout: str, seed: int, size: float, **how: Any) -> Made:
    """A function of one axis changes with another: f(q) g(other)."""
    name, other = CROSSED[layout][seed % 6]

    def with_cross(exact: ExactMachine, truth: Truth, rng: Any) -> Truth:
        found = random_truth(exact, np.random.default_rng(500 + seed), cross={name: other}).cross[name][1]
        cross = {name: (other, Product(found.own.times(100.0 * size), found.across))}
        return Truth(truth.functions, truth.constants, truth.reversal, cross)

    return campaign_of(case_of(layout, seed, truth_of=with_cross, **how))


def tool(layout: str, seed: int, size: float, **how: Any) -> Made:
    """One tool is longer than stated."""
    case = case_of(layout, seed, **how)
    rows = np.all(case.tracker.tool == default_tools()[seed % 3], axis=1)
    longer = case.tracker.tool - size * np.outer(rows, [0.0, 0.0, 1.0])
    actual = case.exact.functional_point(case.tracker.q, longer, case.truth, case.tracker.direction)
    return campaign_of(case, _longer(case, actual - case.points))


def waves(layout: str, seed: int, size: float, **how: Any) -> Made:
    """A positioning function has waves of the screw's pitch, and nobody stated it."""
    axis, pitch = "XYZ"[seed % 3], PITCHES[(seed // 3) % 3]

    def with_waves(exact: ExactMachine, truth: Truth, rng: Any) -> Truth:
        name = f"E{axis}{axis}"
        smooth = truth.functions[name]
        functions = {
            **truth.functions,
            name: lambda q: smooth(q) + size * np.sin(2.0 * np.pi * np.asarray(q) / pitch + seed),
        }
        return Truth(functions, truth.constants, truth.reversal, truth.cross)

    return campaign_of(case_of(layout, seed, truth_of=with_waves, **how))


def reversed_(layout: str, seed: int, size: float, **how: Any) -> Made:
    """An axis has a reversal that the model leaves out."""
    axis = "XYZ"[seed % 3]
    name = (f"E{axis}{axis}", f"EC{axis}" if axis != "Z" else f"EA{axis}")[seed // 3 % 2]

    def with_reversal(exact: ExactMachine, truth: Truth, rng: Any) -> Truth:
        reversal = {name: lambda q: size * (1.0 if name[1] == axis else 2e-3) * np.ones_like(np.asarray(q, float))}
        return Truth(truth.functions, truth.constants, reversal, truth.cross)

    return campaign_of(case_of(layout, seed, truth_of=with_reversal, **how))


OTHER = {
    "order": {"vertical": "w Y' X' b Z (C) t", "gantry": "w b Y X Z (C) t", "horizontal": "w Z' b Y X (C) t"},
    "side": {"vertical": "w Y' b Z X (C) t", "gantry": "w Z' b X Y (C) t", "horizontal": "w b X Y Z (C) t"},
}


def _stated(kind: str, layout: str, seed: int, size: float, **how: Any) -> Made:
    case = case_of(layout, seed, scale=100.0 * size, **how)
    return campaign_of(case, stated=ExactMachine(OTHER[kind][layout], case.exact.travel))


def order(layout: str, seed: int, size: float, **how: Any) -> Made:
    """The machine file has two axes in the other order; the machine's errors are scaled."""
    return _stated("order", layout, seed, size, **how)


def side(layout: str, seed: int, size: float, **how: Any) -> Made:
    """The machine file has an axis on the other side of the bed."""
    return _stated("side", layout, seed, size, **how)


def outlying(layout: str, seed: int, size: float, **how: Any) -> Made:
    """Some readings in a thousand are wrong by up to a hundred times the size."""
    case, rng = case_of(layout, seed, **how), np.random.default_rng(seed)
    m = len(case.points)
    gross = np.zeros(m)
    chosen = rng.choice(m, max(4, m // 400), replace=False)
    gross[chosen] = rng.choice([-1.0, 1.0], len(chosen)) * rng.uniform(20.0, 100.0, len(chosen)) * size
    return campaign_of(case, case.tracker.distance + gross)


def worse(layout: str, seed: int, size: float, **how: Any) -> Made:
    """The instrument is worse than stated by the factor √(1 + (1000 size)²)."""
    case, rng = case_of(layout, seed, **how), np.random.default_rng(seed)
    return campaign_of(
        case, case.tracker.distance + 1e3 * size * case.tracker.u * rng.standard_normal(len(case.points))
    )


def sound(layout: str, seed: int, size: float, **how: Any) -> Made:
    """Nothing is wrong."""
    return campaign_of(case_of(layout, seed, **how))


MISTAKES = {
    "drift of a station": drift,
    "growth with time": growth,
    "growth with temperature": warmth,
    "beam break": broken,
    "cross effect": crossed,
    "tool length": tool,
    "pitch waves": waves,
    "reversal left out": reversed_,
    "order of the axes": order,
    "side of an axis": side,
    "outliers": outlying,
    "u as a whole": worse,
}
CALLED = {
    "order of the axes": "order or side of the axes",
    "side of an axis": "order or side of the axes",
}  # as the verdict has them
