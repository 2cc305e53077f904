"""R-tests by the exact chain: linear axes follow so that the nominal sphere stays in the nest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from exact_chain import ROTARY, ExactMachine, Truth, apply, random_truth, rigid

from support.machines import volid_machine
from volid.campaign import Campaign, ObservationSet
from volid.model.machine import Machine

SPHERES = {"P1": (100.0, 30.0, 40.0), "P2": (-80.0, 90.0, 60.0), "P3": (20.0, -110.0, 120.0)}
TOOLS = ((0.0, 0.0, -150.0), (60.0, 0.0, -200.0), (0.0, 70.0, -180.0))
NOISE = 0.0005
NO_LINEAR = '[model.functions]\n"E?[XYZ]" = false\n"E??[XYZ]" = false\n'


def rotary_only(truth: Truth, keep: str = "ABC") -> Truth:
    """The truth without errors of linear axes and tool frame."""
    return Truth(
        functions={k: f for k, f in truth.functions.items() if k[2] in keep},
        constants={k: v for k, v in truth.constants.items() if k[3] in keep},
    )


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


def displacement(exact: ExactMachine, q, tool, place, truth: Truth, on_tool: bool = True) -> np.ndarray:
    """Exact readings (m, 3), sensor axes parallel to those of the body that it stands on; the nest is where `tool` ends. [mm]."""
    pose = exact.pose(q, truth)
    if on_tool:
        return apply(np.linalg.inv(pose), place) - np.asarray(tool)
    return apply(pose, tool) - np.asarray(place)


@dataclass
class RTest:
    """Rows of a virtual R-test: positions, tool vectors, sphere names and readings [mm]."""

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
    on_tool: bool = True,
) -> RTest:
    """Sphere i seen with tool vector i, over all pairs of rotary positions. [mm]."""
    q, tool, name, reading = [], [], [], []
    for (label, place), vector in zip(spheres.items(), tools, strict=True):
        grid = index_grid(exact, counts)
        own = np.tile(np.asarray(vector, float), (len(grid), 1))
        commanded = following(exact, grid, own, np.asarray(place, float))
        q.append(commanded)
        tool.append(own)
        name += [label] * len(grid)
        reading.append(displacement(exact, commanded, own + np.asarray(nest), place, truth, on_tool))
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
        options={"sensor_on": "tool", "sphere": {k: [c + off_by for c in v] for k, v in spheres.items()}}
        | {"nest_u": 0.0, "rotation_u": 0.0, "scale_u": 0.0}
        | options,
    )
    return Campaign(machine, (), (observations,))


def rtest(
    exact: ExactMachine,
    truth: Truth,
    *,
    n: tuple[int, ...] = (7, 13),
    on_tool: bool = True,
    u: float = NOISE,
    noise: bool = True,
    extra: str = NO_LINEAR,
    **options,
) -> Campaign:
    """A campaign with n positions of each rotary axis, in their order; `extra`: further tables of the machine file."""
    counts = dict(zip((a for a in exact.axes if a in ROTARY), n, strict=False))
    rng = np.random.default_rng(0)
    data = r_test(exact, truth, rng, counts=counts, noise=u if noise else 0.0, on_tool=on_tool)
    options = {"sensor_on": "tool" if on_tool else "workpiece", "range": 2.0} | options
    return r_test_campaign(volid_machine(exact, extra), data, u=u, **options)


def rotary_truth(exact: ExactMachine, seed: int = 3) -> Truth:
    """Random errors of the rotary axes alone."""
    return rotary_only(random_truth(exact, np.random.default_rng(seed)))


def small_rotation(vector) -> np.ndarray:
    """Exact rotation matrix (3, 3) of a rotation vector [rad]."""
    return rigid(vector, np.zeros(3))[0, :3, :3]
