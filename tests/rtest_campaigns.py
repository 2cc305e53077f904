"""R-tests on the exact virtual machines of `exact_chain`: linear axes follow so that the nominal sphere stays in the nest."""

from __future__ import annotations

import numpy as np
from exact_chain import LINEAR, ROTARY, ExactMachine, Truth, apply, random_truth, rigid
from virtual_campaigns import volid_machine

from volid.campaign import Campaign, ObservationSet
from volid.model.machine import Machine

TRAVEL = {"X": (-350, 350), "Y": (-350, 350), "Z": (-250, 550), "A": (-100, 40), "B": (-95, 95), "C": (-180, 180)}
LAYOUTS = {
    "table C on A": "w C' A' Y' X' b Z t",
    "table C on B": "w C' B' X' b Y Z t",
    "split C and B": "w C' b X Y Z B t",
    "fork C A": "w b X Y Z C A t",
    "fork C B": "w b X Y Z C B t",
    "rotary table": "w B' X' b Y Z t",
}
SPHERES = {"P1": (100.0, 30.0, 40.0), "P2": (-80.0, 90.0, 60.0), "P3": (20.0, -110.0, 120.0)}
TOOLS = {"P1": (0.0, 0.0, -150.0), "P2": (60.0, 0.0, -200.0), "P3": (0.0, 70.0, -180.0)}
NO_LINEAR = '[model.functions]\n"E?[XYZ]" = false\n"E??[XYZ]" = false\n'


def exact_machine(structure: str) -> ExactMachine:
    """A machine of this structure; rotary axes 50 mm below the spindle nose but for C."""
    letters = [c for c in structure if c in LINEAR + ROTARY]
    points = {a: (0.0, 0.0, 0.0 if a == "C" else -50.0) for a in letters if a in ROTARY}
    return ExactMachine(structure, {a: TRAVEL[a] for a in letters}, point=points)


def rotary_truth(exact: ExactMachine, seed: int = 3) -> Truth:
    """Random errors of the rotary axes alone."""
    truth = random_truth(exact, np.random.default_rng(seed))
    rotary = [a for a in exact.axes if a in ROTARY]
    functions = {n: f for n, f in truth.functions.items() if n[2] in rotary}
    return Truth(functions, {n: v for n, v in truth.constants.items() if n[3] in rotary})


def rotary_grid(exact: ExactMachine, n: tuple[int, ...]) -> np.ndarray:
    """Positions on a grid over the rotary travels, linear axes at 0, shape (m, n_axes)."""
    rotary = [a for a in exact.axes if a in ROTARY]
    lines = [np.linspace(*exact.travel[a], k) for a, k in zip(rotary, n, strict=False)]
    grid = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, len(lines))
    q = np.zeros((len(grid), len(exact.axes)))
    q[:, [exact.column(a) for a in rotary]] = grid
    return q


def follow(exact: ExactMachine, q: np.ndarray, tool, sphere) -> np.ndarray:
    """Positions with linear axes at which the nominal functional point is the sphere: linear in them, one solution."""
    columns = [exact.column(a) for a in LINEAR]
    at = exact.functional_point(q, tool)
    steps = [exact.functional_point(q + np.eye(len(exact.axes))[c], tool) - at for c in columns]
    move = np.linalg.solve(np.stack(steps, axis=-1), (np.asarray(sphere) - at)[..., None])[..., 0]
    q = q.copy()
    q[:, columns] += move
    return q


def displacement(exact: ExactMachine, q, tool, place, truth: Truth, on_tool: bool = True) -> np.ndarray:
    """Exact readings (m, 3), sensor axes parallel to those of the body that it stands on."""
    pose = exact.pose(q, truth)
    if on_tool:
        return apply(np.linalg.inv(pose), place) - np.asarray(tool)
    return apply(pose, tool) - np.asarray(place)


def rtest(
    exact: ExactMachine,
    truth: Truth,
    *,
    n: tuple[int, ...] = (7, 13),
    spheres=SPHERES,
    tools=TOOLS,
    on_tool: bool = True,
    u: float = 0.0005,
    noise: bool = True,
    extra: str = NO_LINEAR,
    machine: Machine | None = None,
    **options,
) -> Campaign:
    """A campaign of one displacement set; approximate spheres 1 mm off in each coordinate."""
    rng = np.random.default_rng(0)
    q, tool, d, name = [], [], [], []
    for sphere, place in spheres.items():
        here = follow(exact, rotary_grid(exact, n), tools[sphere], place)
        q.append(here)
        tool.append(np.tile(tools[sphere], (len(here), 1)))
        d.append(displacement(exact, here, tools[sphere], place, truth, on_tool))
        name += [sphere] * len(here)
    readings = np.concatenate(d)
    readings = readings + u * rng.standard_normal(readings.shape) if noise else readings
    approximate = {s: [c + 1.0 for c in place] for s, place in spheres.items()}
    given = {"sensor_on": "tool" if on_tool else "workpiece", "sphere": approximate}
    given |= {"nest_u": 0.0, "rotation_u": 0.0, "scale_u": 0.0, "range": 2.0} | options
    positions = np.concatenate(q)
    one = ObservationSet(
        "R-test", "displacement", positions, np.zeros_like(positions), np.concatenate(tool), readings,
        np.full_like(readings, u), {"sphere": np.array(name)}, options=given,
    )  # fmt: skip
    return Campaign(volid_machine(exact, extra) if machine is None else machine, (), (one,), title="R-test")


def small_rotation(vector) -> np.ndarray:
    """Exact rotation matrix (3, 3) of a rotation vector [rad]."""
    return rigid(vector, np.zeros(3))[0, :3, :3]
