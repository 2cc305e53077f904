"""The campaigns that are timed: truth in the span of the model, so that every solver has the same minimum to find.

Three axes: 18 error motions of 14 cubic B-spline coefficients under 24 datum constraints, 3 squareness parameters, three tool
vectors, and per station a position and a dead path: n = 231 + 4 x stations. S: 1,200 readings, n = 247. M: 20,000, n = 263. L:
1,000,000, n = 263, at points spread over the volume (L) or along straight scan lines on the fly, with time stamps (L lines).
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np
from scipy.stats import qmc

import volid
from volid.campaign import Campaign, ObservationSet, Station
from volid.fitting.diagnosis.identifiability import parameter_units
from volid.fitting.equations.compiled import Compiled
from volid.fitting.equations.problem import Problem, build_problem, scatter
from volid.io.machines import parse_machine
from volid.model.error_functions import motion_names, spline_axes
from volid.model.error_model import build_model
from volid.model.machine import Machine

U = 0.0005  # mm
OFF = 5.0  # mm: how far stations and dead paths stand from the truth at the start
TOOLS = np.array([(0.0, 0.0, -150.0), (80.0, 0.0, -250.0), (0.0, 90.0, -200.0)])
STATIONS = ((-0.3, -0.2, -0.1), (1.25, -0.3, 0.55), (1.3, 1.2, 0.0), (-0.2, 1.3, 0.9), (0.45, -0.4, 1.1), (0.55, 1.35, 0.3),
            (-0.4, 0.5, 0.2), (1.4, 0.4, 0.8))  # fmt: skip
SIZES = {"S": (1_200, 4), "M": (20_000, 8), "L": (1_000_000, 8), "L lines": (1_000_000, 8)}
THREE_AXES = """format = "volid-machine/1"
name = "benchmark"
structure = "w Y' X' b Z (C) t"
[axis.X]
travel = [0.0, 1000.0]
[axis.Y]
travel = [0.0, 600.0]
[axis.Z]
travel = [-500.0, 0.0]
[model]
segments = 11
[model.functions]
"E?0S" = false
"""
SPHERES = {"P1": (100.0, 30.0, 40.0), "P2": (-80.0, 90.0, 60.0), "P3": (20.0, -110.0, 80.0)}
TRAVEL = {"Y": (0.0, 600.0), "X": (0.0, 1000.0), "Z": (-500.0, 0.0)}


class Case(NamedTuple):
    """A campaign, its problem begun at the nominal machine with stations `OFF` away, and the true unknowns z."""

    campaign: Campaign
    problem: Problem
    truth: np.ndarray


def three_axis_machine() -> Machine:
    """The cross-table machine of all three-axis cases."""
    return parse_machine(THREE_AXES, "benchmark.toml")


def _positions(m: int, lines: bool, seed: int = 0) -> np.ndarray:
    """Commanded positions (m, 3), axis order of the machine: spread evenly, or 1,000 points each along straight lines in X."""
    low, high = np.array(list(TRAVEL.values())).T
    if not lines:
        return low + qmc.Halton(3, seed=seed).random(m) * (high - low)
    n_lines, each = m // 1000, 1000
    start = qmc.Halton(2, seed=seed).random(n_lines)
    unit = np.empty((n_lines, each, 3))
    unit[:, :, [0, 2]] = start[:, None, :]
    forth = np.linspace(0.0, 1.0, each)
    unit[:, :, 1] = np.where(np.arange(n_lines)[:, None] % 2 == 0, forth, forth[::-1])
    return low + unit.reshape(-1, 3) * (high - low)


def _distance_set(m: int, stations: int, lines: bool) -> ObservationSet:
    """`m` distances, station by station and tool by tool; on the fly at 1 kHz with time stamps when `lines`."""
    q = _positions(m, lines)
    station = np.arange(m) * stations // m
    tool = (np.arange(m) * stations * len(TOOLS) // m) % len(TOOLS)
    return ObservationSet(
        name="volume", kind="distance", positions=q, directions=np.zeros_like(q), tool=TOOLS[tool],
        readings=np.zeros((m, 1)), u=np.full((m, 1), U),
        labels={"station": np.array([f"S{i + 1}" for i in range(stations)])[station], "segment": np.full(m, "1")},
        time=np.arange(m) * 1e-3 if lines else None, options={"relative": True, "calibrated_u": 0.0},
    )  # fmt: skip


def _stations(count: int, shift: np.ndarray) -> tuple[Station, ...]:
    low, high = np.array([TRAVEL[a] for a in "XYZ"]).T
    places = low + np.array(STATIONS[:count]) * (high - low) + TOOLS.mean(axis=0) + shift
    return tuple(Station(f"S{i + 1}", position=tuple(p)) for i, p in enumerate(places.tolist()))


@cache
def three_axis(name: str) -> Case:
    """Case S, M, L or "L lines"."""
    m, count = SIZES[name]
    plan = Campaign(three_axis_machine(), _stations(count, np.zeros(3)), (_distance_set(m, count, "lines" in name),))
    segments = {n: (11,) for n in motion_names(plan.machine)}
    return read(plan, build_model(plan.machine, segments), shift=np.random.default_rng(5).normal(0.0, OFF, (count, 3)))


def read(plan: Campaign, model, shift: np.ndarray | None = None) -> Case:
    """The plan's readings by the model's own prediction, errors of 5 µm and 10 µrad, noise of one u."""
    rng = np.random.default_rng(1)
    exact = build_problem(plan, model, engine=Compiled())
    theta = rng.standard_normal(model.n_parameters) * parameter_units(model) * np.array([0.05])
    truth = exact.start.copy()
    truth[: model.layout.n_coefficients] = model.parametrisation @ theta
    values = scatter(exact, plan, exact.equations.predictions(truth))
    sets = tuple(
        replace(s, readings=v + s.u * rng.standard_normal(v.shape)) for s, v in zip(plan.sets, values, strict=True)
    )
    stations = plan.stations if shift is None else _stations(len(plan.stations), shift)
    campaign = replace(plan, sets=sets, stations=stations)
    problem = build_problem(campaign, model, engine=Compiled())
    start = problem.start.copy()
    for i, entry in enumerate(problem.nuisance):
        if entry.name.startswith("dead path"):
            start[model.layout.n_coefficients + i] += OFF
    return Case(campaign, problem._replace(start=start), truth)


def distances(m: int) -> Campaign:
    """`m` distances of a random virtual machine, read from four stations or eight, with splines to be chosen."""
    machine = parse_machine(THREE_AXES.replace("segments = 11\n", ""), "benchmark.toml")
    count = 4 if m < 5_000 else 8
    one = _distance_set(m, count, False)
    one = replace(one, options={**one.options, "u": U})
    return volid.simulate(Campaign(machine, _stations(count, np.zeros(3)), (one,)), seed=1)[0]


def rtest_readings() -> Campaign:
    """12,825 readings of an R-test at 57 x 25 positions of a tilting rotary table, splines to be chosen; linear axes known."""
    from volid.io import read_machine
    from volid.planning.rtest import rtest_static_grid

    machine = read_machine("datasets/five_axis_rtest/machine.toml")
    plan = rtest_static_grid(machine, SPHERES, (0.0, 0.0, -180.0), 57, 25)
    return volid.simulate(plan, seed=1)[0]


@cache
def five_axis() -> Case:
    """An R-test at 37 x 9 positions of a tilting rotary table with 3 spheres, rotary splines, location errors: 2,997 readings."""
    from volid.io import read_machine
    from volid.planning.rtest import rtest_static_grid

    machine = read_machine("models/wCAYXbZt_trunnion.toml")
    rotary = machine.__class__(**{**vars(machine), "model": replace(machine.model, segments=6)})
    plan = rtest_static_grid(rotary, SPHERES, (0.0, 0.0, -150.0), 37, 9)
    return _determined(plan)


@cache
def mixed() -> Case:
    """The R-test and 3,000 tracker distances of the same machine's linear axes in one fit."""
    base = five_axis().campaign
    rng = np.random.default_rng(3)
    axes = base.machine.axes
    q = np.array([[*(rng.uniform(*a.travel) if a.is_linear else 0.0 for a in axes)] for _ in range(3000)])
    names = np.array([f"S{i % 6 + 1}" for i in range(3000)])
    low, high = np.array([next(a.travel for a in axes if a.letter == c) for c in "XYZ"]).T
    places = low + np.array(STATIONS[:6]) * (high - low) + TOOLS.mean(axis=0)
    stations = tuple(Station(f"S{i + 1}", position=tuple(p)) for i, p in enumerate(places.tolist()))
    tracker = ObservationSet(
        name="volume", kind="distance", positions=q, directions=np.zeros_like(q), tool=TOOLS[np.arange(3000) // 1000],
        readings=np.zeros((3000, 1)), u=np.full((3000, 1), U),
        labels={"station": names, "segment": np.full(3000, "1")}, options={"relative": True, "calibrated_u": 0.0},
    )  # fmt: skip
    return _determined(replace(base, stations=stations, sets=(*base.sets, tracker)))


SEGMENTS = 8  # of every function, for cases whose machine files state none: what the solvers are compared on


def _determined(plan: Campaign) -> Case:
    """A case restricted to what its readings determine."""
    from volid.fitting.diagnosis.identifiability import analyse

    segments = {name: (SEGMENTS,) * len(spline_axes(plan.machine, name)) for name in motion_names(plan.machine)}
    case = read(plan, build_model(plan.machine, segments))
    found = analyse(case.problem, case.campaign)
    return case._replace(problem=case.problem._replace(free=case.problem.free @ found.basis))
