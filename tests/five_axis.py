"""Five-axis machines for tests: the layouts people own, R-test campaigns by the exact chain, solutions made without a fit."""

from __future__ import annotations

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from exact_chain import ExactMachine, Truth, machine_toml, random_truth
from exact_chain import apply as carried

from volid.campaign import Campaign, ObservationSet
from volid.fitting.diagnosis.adequacy import Adequacy
from volid.fitting.results import Residuals, Statistics
from volid.fitting.solution import Solution
from volid.io.machines import parse_machine
from volid.model.error_functions import spline_axes
from volid.model.error_model import build_model
from volid.model.iso230 import parse
from volid.model.machine import Datum, Machine

LINEAR = {"X": (-400.0, 400.0), "Y": (-350.0, 350.0), "Z": (-200.0, 500.0)}
TILTING = (-100.0, 100.0)
POINTS = {"A": (12.0, -7.0, -50.0), "B": (-9.0, 5.0, -40.0), "C": (4.0, -6.0, 3.0)}
STRUCTURES = {
    "tilting table C'A'": "w C' A' Y' X' b Z t",
    "tilting table C'B'": "w C' B' X' b Y Z t",
    "table and head": "w C' Y' b X Z B t",
    "fork head CA": "w Y' b X Z C A t",
    "fork head CB": "w b X Y Z C B t",
    "mill-turn": "w C' b Z X Y B t",
}
# B at 45° between Y and Z, its components in its own frame, as in models/
NUTATING = {"nutating head": "w C' b X Y Z B t", "nutating table": "w C' B' Y' b X Z t"}
THREE_ROTARY = "w C' Y' b X Z B A t"
ROTARY_TABLE = "w C' Y' X' b Z t"
SPHERES = {"P1": (100.0, 30.0, 40.0), "P2": (-80.0, 90.0, 60.0), "P3": (20.0, -110.0, 120.0)}
TOOLS = ((0.0, 0.0, -150.0), (60.0, 0.0, -200.0), (0.0, 70.0, -180.0))
NOISE = 0.0005
LINEAR_OFF = '"E?[XYZ]" = false\n"E?0[XYZ]" = false'


def exact_machine(structure: str) -> ExactMachine:
    """Exact machine of a structural code, rotary axes off the origin and off one another; B inclined for `NUTATING`."""
    letters = [c for c in structure if c in "XYZABC"]
    travel = {a: LINEAR.get(a, (-180.0, 180.0) if a == "C" else TILTING) for a in letters}
    points = {a: POINTS[a] for a in letters if a in POINTS}
    if structure in NUTATING.values():
        return ExactMachine(structure, travel, point=points, direction={"B": (0.0, 1.0, 1.0)}, axis_frame="B")
    return ExactMachine(structure, travel, point=points)


def volid_machine(exact: ExactMachine, functions: str = "", segments: object = 12) -> Machine:
    """The package's machine; `functions`: lines of [model.functions]."""
    segments = f'"{segments}"' if isinstance(segments, str) else segments
    extra = f"[model]\nsegments = {segments}\n[model.functions]\n{functions}"
    return parse_machine(machine_toml(exact, extra=extra), "machine.toml")


def rotary_only(truth: Truth, keep: str = "ABC") -> Truth:
    """The truth without errors of linear axes and tool frame."""
    return Truth(
        functions={k: f for k, f in truth.functions.items() if k[2] in keep},
        constants={k: v for k, v in truth.constants.items() if k[3] in keep},
    )


# ------------------------------------------------------------------------------------------------------ virtual R-test


def following(exact: ExactMachine, q: np.ndarray, tool: np.ndarray, sphere: np.ndarray) -> np.ndarray:
    """Linear positions such that the nominal functional point stays on the sphere: one Newton step is exact."""
    q = q.copy()
    start = exact.functional_point(q, tool)
    columns = [exact.column(a) for a in "XYZ"]
    step = np.eye(len(exact.axes))
    slope = np.stack([exact.functional_point(q + step[c], tool) - start for c in columns], axis=-1)
    q[:, columns] += np.linalg.solve(slope, (sphere - start)[..., None])[..., 0]
    return q


def index_grid(exact: ExactMachine, counts: dict[str, int] | None = None) -> np.ndarray:
    """All pairs of rotary positions (13 of the tilting axis x 37 of C by default), linear axes at 0."""
    rotary = [a for a in exact.axes if a in "ABC"]
    counts = {"A": 13, "B": 13, "C": 37} | (counts or {})
    lines = [np.linspace(*exact.travel[a], counts[a]) if counts[a] > 1 else np.zeros(1) for a in rotary]
    mesh = np.meshgrid(*lines, indexing="ij")
    q = np.zeros((mesh[0].size, len(exact.axes)))
    q[:, [exact.column(a) for a in rotary]] = np.stack([m.ravel() for m in mesh], axis=1)
    return q


@dataclass
class RTest:
    """Rows of a virtual R-test, sensor on the tool: positions, tool vectors, sphere names and readings [mm]."""

    q: np.ndarray
    tool: np.ndarray
    sphere: np.ndarray
    reading: np.ndarray


def r_test(
    exact: ExactMachine,
    truth: Truth,
    rng: np.random.Generator,
    *,
    spheres=SPHERES,
    tools=TOOLS,
    counts=None,
    noise: float = NOISE,
    nest=(0.0, 0.0, 0.0),
) -> RTest:
    """Sphere i seen with tool vector i, over all pairs of rotary positions: d = T^-1 sphere - nest origin. [mm]."""
    q, tool, name, reading = [], [], [], []
    for (label, place), vector in zip(spheres.items(), tools, strict=True):
        grid = index_grid(exact, counts)
        own = np.tile(np.asarray(vector, float), (len(grid), 1))
        commanded = following(exact, grid, own, np.asarray(place, float))
        seen = carried(np.linalg.inv(exact.pose(commanded, truth)), place)
        q.append(commanded)
        tool.append(own)
        name += [label] * len(grid)
        reading.append(seen - own - np.asarray(nest))
    d = np.concatenate(reading)
    return RTest(np.concatenate(q), np.concatenate(tool), np.array(name), d + noise * rng.standard_normal(d.shape))


def r_test_campaign(
    machine: Machine, data: RTest, *, off_by: float = 1.0, spheres=SPHERES, u: float = NOISE, **options
):
    """Campaign of an R-test; approximate sphere positions are wrong by `off_by` mm. `options`: nest_u and the like."""
    observations = ObservationSet(
        "R-test",
        "displacement",
        data.q,
        np.zeros_like(data.q),
        data.tool,
        data.reading,
        np.full_like(data.reading, u),
        {"sphere": data.sphere},
        options={"sensor_on": "tool", "sphere": {k: tuple(np.add(v, off_by)) for k, v in spheres.items()}}
        | {"nest_u": 0.0, "rotation_u": 0.0, "scale_u": 0.0}
        | options,
    )
    return Campaign(machine, (), (observations,))


# --------------------------------------------------------------------------------------- solutions without a fit


def made_up(
    machine: Machine, seed: int = 0, scale: float = 1.0, u: float = 0.05, segments: int = 6, datum: Datum | None = None
) -> Solution:
    """A solution with random errors (about 5 µm, 15 µrad, times `scale`) and uncertainties of `u` of that: no fit needed."""
    rng = np.random.default_rng(seed)
    names = [f"E{d}{a}" for d in "XYZABC" for a in machine.letters]
    every = {n: (segments,) * len(spline_axes(machine, n)) for n in names}
    model = build_model(machine, every, datum=datum)
    size = np.empty(model.n_parameters)
    for f in model.functions:
        size[f.parameters] = 15e-6 if parse(f.name).is_rotation else 5e-3
    travel = np.array([a.travel for a in machine.axes])
    ends = ObservationSet(
        "ends",
        "displacement",
        travel.T.copy(),
        np.zeros((2, len(travel))),
        np.zeros((2, 3)),
        np.zeros((2, 3)),
        np.ones((2, 3)),
        {"sphere": np.array(["1", "1"])},
        options={"sensor_on": "tool", "sphere": (0.0, 0.0, 0.0), "nest_u": 0.0, "rotation_u": 0.0, "scale_u": 0.0},
    )
    root = rng.standard_normal((model.n_parameters, model.n_parameters)) / np.sqrt(model.n_parameters)
    half = u * scale * size[:, None] * root
    values = rng.uniform(0.5, 1.5, model.n_parameters) * rng.choice([-1, 1], model.n_parameters)
    return Solution(
        parameters=jnp.asarray(scale * size * values),
        nuisance=jnp.zeros(0),
        covariance=jnp.asarray(half @ half.T),
        null_space=jnp.zeros((model.n_parameters, 0)),
        held_directions=jnp.zeros((sum(n.endswith("0S") for n in model.names), 0)),
        model=model,
        campaign=Campaign(machine, (), (ends,)),
        nuisance_table=(),
        adequacy=Adequacy(0.0, 0, 1.0, 1.0, (), (), False, "model accepted by the data"),
        statistics=Statistics(6, 0, {}, 1, True),
        readings=Residuals((), (), ()),
    )


def truth_of(solution: Solution) -> Truth:
    """What the exact chain must be told to have the same errors: functions sampled from the tables, and constants."""
    theta = np.asarray(solution.parameters)

    def function(name: str):
        return lambda q: (solution.motion_rows(name, np.ravel(q), 0) @ theta).reshape(np.shape(q))

    constants = {n: solution.location(n).value for n in solution.model.names if parse(n).location}
    return Truth({n: function(n) for n in solution.model.names if not parse(n).location}, constants)


__all__ = [name for name in dir() if not name.startswith("_")] + ["random_truth"]
