"""Small plans for every observation kind, from every body that an instrument or a sphere can stand on, and truths for them.

A plan holds distances from four stations that see every tool vector, which determine the machine, and one set of the kind.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from support.judging import spline_truth
from volid.campaign import Alignment, Campaign, End, ObservationSet, Station
from volid.fitting.equations.interpreted import Interpreted
from volid.fitting.equations.problem import build_problem, scatter
from volid.fitting.solution import Solution
from volid.fitting.starts import find_starts
from volid.io.machines import parse_machine
from volid.model.error_functions import motion_names, spline_axes
from volid.model.error_model import ErrorModel, build_model
from volid.model.kinematics import nominal_point
from volid.model.machine import Machine
from volid.observations import KINDS
from volid.virtual.truth import Truth

THREE = """format = "volid-machine/1"
name = "three axes"
structure = "w Y' b X Z t"
[axis.X]
travel = [0.0, 600.0]
[axis.Y]
travel = [0.0, 400.0]
[axis.Z]
travel = [-300.0, 0.0]
[model]
segments = 2
"""
FIVE = """format = "volid-machine/1"
name = "table and head"
structure = "w C' Y' b X Z B t"
[axis.X]
travel = [-300.0, 300.0]
[axis.Y]
travel = [-250.0, 250.0]
[axis.Z]
travel = [-100.0, 300.0]
[axis.C]
travel = [-180.0, 180.0]
point = [4.0, -6.0, 3.0]
[axis.B]
travel = [-90.0, 90.0]
point = [-9.0, 5.0, -40.0]
[model]
segments = 2
"""
TOOLS = np.array([(0.0, 0.0, -150.0), (80.0, 0.0, -200.0), (0.0, 70.0, -180.0)])
PLACES = {
    "S1": (-400.0, -300.0, -500.0),
    "S2": (900.0, -250.0, -450.0),
    "S3": (800.0, 700.0, 250.0),
    "S4": (-300.0, 650.0, -100.0),
}


@cache
def machine_of(text: str) -> Machine:
    """The machine of a machine file's text."""
    return parse_machine(text, "machine.toml")


def positions_of(machine: Machine, m: int, seed: int = 0) -> np.ndarray:
    """Positions spread at random over the travels, (m, n_axes)."""
    low, high = np.array([a.travel for a in machine.axes]).T
    return low + np.random.default_rng(seed).random((m, len(low))) * (high - low)


def plan_set(name: str, kind: str, positions, tool, labels=None, u=None, seed: int = 1, **options) -> ObservationSet:
    """A set without readings, every option that it does not state at its default, times and temperatures recorded."""
    declared, m = KINDS[kind], len(positions)
    units = [declared.unit_of(i) for i in range(len(declared.readings))]
    u = [1e-4 if unit == "degrees" else 5e-4 for unit in units] if u is None else np.atleast_1d(u)
    texts = {label: default for label, default in declared.labels.items() if default} | (labels or {})
    rng = np.random.default_rng(seed)
    return ObservationSet(
        name,
        kind,
        positions,
        np.zeros_like(positions),
        np.broadcast_to(tool, (m, 3)).copy(),
        np.full((m, len(units)), np.nan),
        np.tile(u, (m, 1)),
        {k: np.broadcast_to(v, m).astype(str) for k, v in texts.items()},
        time=np.sort(rng.uniform(0.0, 7200.0, m)),
        temperature=rng.uniform(19.0, 22.0, m),
        options=dict(declared.options) | options,
    )  # fmt: skip


def distances(machine: Machine, m: int, single: bool = False) -> tuple[tuple[Station, ...], ObservationSet]:
    """Four stations on the workpiece that see every tool vector at `m` places each: enough for the whole error model.

    `single`: each sees one tool vector, so that a constant rotation of the tool is not determined.
    """
    n = len(PLACES)
    labels = {"station": np.repeat(list(PLACES), m), "segment": np.tile(np.where(np.arange(m) < m // 2, "1", "2"), n)}
    numbers = np.arange(n * m)
    tool = TOOLS[(numbers // m if single else numbers) % len(TOOLS)]
    stations = tuple(Station(name, position=place) for name, place in PLACES.items())
    return stations, plan_set("volume", "distance", positions_of(machine, n * m), tool, labels)


@dataclass(frozen=True)
class Example:
    """A plan: machine text, what makes the stations and the set of the kind; `wrong`: factors of other units, and what is said.

    `single`: every station sees a single tool vector. `loose`: what of u the fit leaves of exact readings, where a drawn
    property of the instrument is drawn back to what was stated of it.
    """

    kind: str
    machine: str
    make: Callable[[Machine], tuple[tuple[Station, ...], tuple[ObservationSet, ...]]]
    wrong: tuple[tuple[float, str], ...] = ()
    single: bool = False
    loose: float = 1e-3
    alignments: tuple[Alignment, ...] = ()

    def plan(self) -> Campaign:
        """The campaign without readings."""
        machine = machine_of(self.machine)
        stations, volume = distances(machine, 60 if self.machine == THREE else 150, self.single)
        own, sets = self.make(machine)
        return Campaign(machine, (*stations, *own), (volume, *sets), title="contract", alignments=self.alignments)


def _seen_from(kind: str, body: str, place=(-700.0, -350.0, 400.0)):
    def make(machine):
        q = positions_of(machine, 40, seed=3)
        own = plan_set("own", kind, q, TOOLS[np.arange(40) % 3], {"station": "T"})
        return (Station("T", body, place),), (own,)

    return make


def _single_tool(kind: str):
    def make(machine):
        (station,), (own,) = _seen_from(kind, "workpiece")(machine)
        return (station,), (replace(own, tool=np.broadcast_to(TOOLS[1], own.tool.shape).copy()),)

    return make


def _reflector(station: str, target: str):
    def make(machine):
        q = positions_of(machine, 40, seed=4)
        options = {"target_body": target, "target": [60.0, -90.0, 80.0]}
        return (Station("R", station, (700.0, -300.0, 250.0)),), (
            plan_set("own", "distance", q, np.zeros(3), {"station": "R"}, **options),
        )

    return make


def _network(machine):
    names = {f"N{i}": p for i, p in enumerate([(-500.0, 0.0, 100.0), (900.0, 50.0, 0.0), (300.0, 800.0, -300.0)])}
    q = positions_of(machine, 90, seed=5)
    own = plan_set("own", "distance", q, TOOLS[np.arange(90) % 3], {"station": np.resize(list(names), 90)})
    return tuple(Station(n, position=p, known=True) for n, p in names.items()), (own,)


def _sensor(on: str, **options):
    """R-test: the sphere is found where it nominally is, the linear axes do not follow a rotary one exactly."""

    def make(machine):
        m = 60
        q = positions_of(machine, m, seed=6) * 0.5
        linear = [i for i, a in enumerate(machine.axes) if a.is_linear]
        tool, sphere = TOOLS[np.arange(m) % 3], np.array([40.0, -30.0, 60.0])
        at = nominal_point(machine, q, tool)
        steps = [nominal_point(machine, q + np.eye(len(machine.axes))[i], tool) - at for i in linear]
        move = np.linalg.solve(np.stack(steps, axis=-1), (sphere - at)[..., None])[..., 0]
        q[:, linear] += move
        own = plan_set(
            "own", "displacement", q, tool, {"sphere": "P"}, sensor_on=on, sphere={"P": sphere.tolist()}, **options
        )
        return (), (own,)

    return make


def _lines(slope: bool, letters: str = "XYB"):
    """Every component along three lines of one axis each."""

    def make(machine):
        sets = []
        for axis in "XY":
            i, lines = machine.index(axis), []
            for _ in letters:
                q = np.tile([0.5 * sum(a.travel) for a in machine.axes], (9, 1))
                q[:, i] = np.linspace(*machine.axes[i].travel, 9)
                lines.append(q)
            labels = {"component": np.repeat(list(letters), 9), "line": axis}
            u = np.where(np.isin(labels["component"], list("ABC")), 1e-6, 5e-4)
            own = plan_set(f"lines {axis}", "component", np.concatenate(lines), TOOLS[1], labels, slope=slope)
            sets.append(replace(own, u=u[:, None]))
        return (), tuple(sets)

    return make


def _lengths(two_tools: bool = False, **options):
    """Lengths of three artefacts between places all over the travels, at both ends with one tool vector or with two."""

    def make(machine):
        m = 45
        q, p = positions_of(machine, m, seed=3), positions_of(machine, m, seed=11)
        tool = TOOLS[np.arange(m) % 3]
        labels = {"artefact": np.array(["bar", "gauge", "piece"])[np.arange(m) * 3 // m]}
        own = plan_set("own", "length", q, tool, labels, **options)
        return (), (replace(own, to=End(p, np.zeros_like(p), np.roll(tool, 1, axis=0) if two_tools else tool)),)

    return make


def _artefact(placed: bool, **options):
    """Two legs of a square, each read along its normal and from above."""
    x, y, z = np.eye(3).tolist()
    legs = {"leg_X": {"along": x, "normal": y}, "top_X": {"along": x, "normal": z}}
    legs |= {"leg_Y": {"along": y, "normal": x}, "top_Y": {"along": y, "normal": z}}

    def make(machine):
        lines, m = [], 9
        for axis in "XXYY":
            q = np.tile([0.5 * sum(a.travel) for a in machine.axes], (m, 1))
            i = machine.index(axis)
            q[:, i] = np.linspace(*machine.axes[i].travel, m)
            lines.append(q)
        labels = {"component": np.repeat(list("YZXZ"), m), "line": np.repeat(list(legs), m)}
        own = plan_set("own", "component", np.concatenate(lines), TOOLS[1], labels, u=5e-4)
        stated = {"alignment": "square", "lines": legs} | ({"offset": False} if placed else {}) | options
        return (), (replace(own, options={**own.options, **stated}),)

    return make


PLATE_AT = (  # directions of the plate's x and y: flat, upright, upright across, inclined
    ((1, 0, 0), (0, 1, 0)),
    ((0, 0, 1), (1, 0, 0)),
    ((0, 1, 0), (0, 0, 1)),
    ((0.8, 0, 0.6), (0, 1, 0)),
)


def plate_points(
    nx: int = 3, ny: int = 3, pitch: float = 60.0, u: float = 0.0, height: float = 0.02
) -> dict[str, list[float]]:
    """Coordinates of a plate's points, off their grid by some 20 µm and off their plane by some `height`, with u."""
    off = np.random.default_rng(4).normal(size=(nx, ny, 3)) * [0.02, 0.02, height]
    at = {f"{'ABCDEFGH'[j]}{i + 1}": (i, j) for j in range(ny) for i in range(nx)}
    return {n: [*(np.array([pitch * i, pitch * j, 0.0]) + off[i, j]).tolist(), u, u, u] for n, (i, j) in at.items()}


def _plate(points: dict[str, list[float]], places=PLATE_AT, tools=TOOLS, **options):
    """A plate placed somewhere several times, each point seen with every tool vector; rotary axes stand differently each time."""

    def make(machine):
        rng, names = np.random.default_rng(8), list(points)
        xyz = np.array([points[n][:3] for n in names])
        sets, body = [], machine.body_index(options.get("body", "workpiece"))
        for k, (x, y) in enumerate(places):
            turn = np.stack([x, y, np.cross(x, y)], axis=1).astype(float)
            q = np.tile([0.5 * sum(a.travel) for a in machine.axes], (len(names), 1))
            q[:, [i for i, a in enumerate(machine.axes) if not a.is_linear]] = (
                20.0 * rng.normal(size=2)[: 2 * (len(q[0]) > 3)]
            )
            tool = tools[np.arange(len(names)) % len(tools)]
            middle = nominal_point(machine, q, tool, body).mean(axis=0)
            q = _reached(machine, q, tool, middle + (xyz - xyz.mean(axis=0)) @ turn.T, body)
            labels = {"artefact": "plate", "point": np.array(names), "placement": str(k + 1)}
            sets.append(plan_set("own", "artefact", q, tool, labels, points={"plate": points}, **options))
        rows = {
            n: np.concatenate([getattr(s, n) for s in sets])
            for n in ("positions", "directions", "tool", "readings", "u")
        }
        labels = {n: np.concatenate([s.labels[n] for s in sets]) for n in sets[0].labels}
        m = len(rows["u"])
        return (), (replace(sets[0], labels=labels, time=np.arange(float(m)), temperature=np.full(m, 20.0), **rows),)

    return make


BEAM = {f"B{i}": [30.0 * i + 0.01 * i * i, 0.0, 0.0, 0.0, 0.0, 0.0] for i in range(7)}  # its roll moves nothing
BEAM_AT = (((0, 0, 1), (1, 0, 0)), ((0.6, 0.8, 0), (-0.8, 0.6, 0)))


def _reached(machine, q, tool, target, body):
    """Positions whose linear axes bring the nominal functional point to places on a body."""
    q, linear = q.copy(), [i for i, a in enumerate(machine.axes) if a.is_linear]
    at = nominal_point(machine, q, tool, body)
    steps = [nominal_point(machine, q + np.eye(len(machine.axes))[i], tool, body) - at for i in linear]
    q[:, linear] += (np.linalg.pinv(np.stack(steps, axis=-1)) @ (target - at)[..., None])[..., 0]
    return q


METRES, MICRO = 1e-3, 1e3
IN_METRES, IN_MICRO = "seem.* to be in metres", "seem.* to be in micrometres"
SQUARE = (Alignment("square"),)
EXAMPLES = {
    "distance": Example(
        "distance", THREE, _seen_from("distance", "workpiece"), ((METRES, IN_METRES), (MICRO, IN_MICRO))
    ),
    "distance from the bed": Example("distance", THREE, _seen_from("distance", "bed")),
    "distance from a carriage": Example("distance", THREE, _seen_from("distance", "X")),
    "distance of a network": Example("distance", THREE, _network),
    "distance of a reflector on a carriage": Example("distance", THREE, _reflector("workpiece", "X")),
    "distance of a reflector on the workpiece": Example("distance", THREE, _reflector("Z", "workpiece")),
    "distance, single tool vectors": Example("distance", THREE, _single_tool("distance"), single=True),
    "distance, table and head": Example("distance", FIVE, _seen_from("distance", "bed")),
    "distance of a reflector on the table": Example("distance", FIVE, _reflector("X", "workpiece")),
    "point": Example("point", THREE, _seen_from("point", "workpiece"), ((METRES, IN_METRES), (MICRO, IN_MICRO))),
    "point from the bed": Example("point", THREE, _seen_from("point", "bed")),
    "point, single tool vectors": Example("point", THREE, _single_tool("point"), single=True),
    "point, table and head": Example("point", FIVE, _seen_from("point", "workpiece")),
    "polar": Example("polar", THREE, _seen_from("polar", "workpiece"), ((METRES, IN_METRES), (MICRO, IN_MICRO))),
    "polar from a carriage": Example("polar", THREE, _seen_from("polar", "X")),
    "displacement": Example("displacement", FIVE, _sensor("tool"), ((MICRO, "outside the sensor's range"),)),
    "displacement, unknown sensor": Example(
        "displacement", FIVE, _sensor("tool", nest_u=0.1, rotation_u=5e-3, scale_u=1e-3), loose=0.2
    ),
    "displacement, sensor on the workpiece": Example(
        "displacement", FIVE, _sensor("workpiece", nest_u=0.1, rotation_u=5e-3), loose=0.2
    ),
    "component": Example(
        "component",
        THREE,
        _lines(True),
        ((MICRO, r"is it in (µm\? Expected mm|degrees, µrad or arcseconds\? Expected rad)"),),
    ),
    "component, rotations": Example("component", THREE, _lines(False, "AC")),
    "component, table and head": Example("component", FIVE, _lines(True)),
    "component, one artefact": Example("component", THREE, _artefact(False), alignments=SQUARE),
    "component, an artefact placed": Example("component", THREE, _artefact(True), alignments=SQUARE),
    "component, angle and form": Example(
        "component", THREE, _artefact(False, form_u=1e-3, angle_u=1e-5), loose=1.0, alignments=SQUARE
    ),
    "component, an artefact on the bed": Example(
        "component", FIVE, _artefact(False), alignments=(Alignment("square", "bed"),)
    ),
    "component, an artefact on the table": Example("component", FIVE, _artefact(True), alignments=SQUARE),
    "artefact": Example("artefact", THREE, _plate(plate_points(), scale_u=0.0), ((MICRO, IN_MICRO),)),
    "artefact, calibrated": Example("artefact", THREE, _plate(plate_points(u=5e-4), scale_u=1e-6), loose=1.0),
    "artefact, of unknown scale": Example("artefact", THREE, _plate(plate_points(), scale_u=np.inf)),
    "artefact, holes": Example("artefact", THREE, _plate(plate_points(height=0.0), components="XY")),
    "artefact, a beam": Example("artefact", THREE, _plate(BEAM, places=BEAM_AT)),
    "artefact, on the bed": Example(
        "artefact", THREE, _plate(plate_points(), body="bed", places=PLATE_AT[1:2], tools=TOOLS[:2])
    ),
    "artefact, table and head": Example("artefact", FIVE, _plate(plate_points())),
    "length": Example("length", THREE, _lengths(), ((METRES, IN_METRES), (MICRO, IN_MICRO))),
    "length, relative": Example("length", THREE, _lengths(relative=True, scale_u=np.inf)),
    "length, calibrated": Example("length", THREE, _lengths(calibrated_u=1e-3, scale_u=1e-5), loose=0.5),
    "length, two tool vectors": Example("length", THREE, _lengths(True)),
    "length, table and head": Example("length", FIVE, _lengths(True)),
    "length, table and head, relative": Example("length", FIVE, _lengths(relative=True)),
}


def exact_parameters(model: ErrorModel, seed: int = 7) -> np.ndarray:
    """θ of a machine with errors of some 5 µm and 15 µrad, shape (n,)."""
    theta = np.random.default_rng(seed).normal(size=model.n_parameters)
    for f in model.functions:
        theta[f.parameters] *= 15e-6 if f.name[1] in "ABC" else 5e-3
    return theta


def exact_truth(machine: Machine, seed: int = 7) -> Truth:
    """A machine whose errors are splines of its own model, those of `exact_parameters`."""
    segments = {n: (2,) * len(spline_axes(machine, n)) for n in motion_names(machine)}
    model = build_model(machine, segments)
    found = spline_truth(model, exact_parameters(model, seed))
    return Truth(machine, found.functions, constants=found.constants)


def predictions(solution: Solution, samples: np.ndarray | None = None) -> list[np.ndarray]:
    """What the solution predicts for its own readings, one (m, k) per set, then what each of its `samples` (b, n + k) does."""
    campaign = solution.campaign
    problem = build_problem(campaign, solution.model, find_starts(campaign), engine=Interpreted())
    assert [e.key for e in problem.nuisance] == [e.key for e in solution.nuisance_table]
    n, found = solution.model.n_parameters, []
    own = np.concatenate([np.asarray(solution.parameters), np.asarray(solution.nuisance)])
    for x in [own, *(() if samples is None else samples)]:
        z = np.concatenate([solution.model.parametrisation @ x[:n], x[n:]])
        found += scatter(problem, campaign, problem.equations.predictions(z))
    return found


def exact_readings(plan: Campaign, seed: int = 2) -> Campaign:
    """Exact readings of a machine whose errors are splines of its model; stations and spheres are said to be 2 mm off."""
    machine, rng = plan.machine, np.random.default_rng(seed)
    segments = {n: (2,) * len(spline_axes(machine, n)) for n in motion_names(machine)}
    problem = build_problem(plan, build_model(machine, segments), engine=Interpreted())
    theta = exact_parameters(problem.model)
    unknowns = [
        e.start
        + (rng.uniform(-e.spread, e.spread) if e.prior_u > 0.0 else 0.0) * min(1.0, e.prior_u / max(e.spread, 1e-9))
        for e in problem.nuisance
    ]
    z = np.concatenate([problem.model.parametrisation @ theta, unknowns])
    found = scatter(problem, plan, problem.equations.predictions(z))
    sets = [replace(s, readings=r) for s, r in zip(plan.sets, found, strict=True)]

    def near(name, place):
        return (np.asarray(place) + 2.0 * rng.normal(size=3)).round(3).tolist()

    sets = [KINDS[s.kind].approximate(s, near) for s in sets]
    stations = [s if s.known else replace(s, position=tuple(near(s.name, s.position))) for s in plan.stations]
    return replace(plan, sets=tuple(sets), stations=tuple(stations))
