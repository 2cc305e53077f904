"""Virtual machines of `exact_chain` as volid machines and campaigns, in memory, and solutions judged by the exact chain."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from exact_chain import (
    ExactMachine,
    TrackerCampaign,
    Truth,
    default_tools,
    gauge_free,
    machine_grid,
    machine_toml,
    random_truth,
    tracker_campaign,
)
from scipy.interpolate import BSpline

from volid.campaign import Campaign, ObservationSet, Station
from volid.fitting.prediction.deviations import gradient_matrix
from volid.fitting.solution import Solution
from volid.io.machines import parse_machine
from volid.model.error_model import ErrorModel
from volid.model.machine import Machine

# The machines of models/: cross-table vertical, gantry of 3 m, horizontal with Z table.
VERTICAL = ExactMachine("w X' Y' b Z (C) t", {"X": (0, 760), "Y": (0, 430), "Z": (-460, 0)})
GANTRY = ExactMachine("w b X Y Z (C) t", {"X": (0, 3000), "Y": (0, 2000), "Z": (-1000, 0)})
HORIZONTAL = ExactMachine("w Z' b X Y (C) t", {"X": (0, 800), "Y": (0, 700), "Z": (0, 750)})
MACHINES = {"vertical": VERTICAL, "gantry": GANTRY, "horizontal": HORIZONTAL}


def volid_machine(machine: ExactMachine, extra: str = "") -> Machine:
    """The package's machine; `extra`: further tables of the machine file, such as [model]."""
    return parse_machine(machine_toml(machine, extra=extra), "machine.toml")


def fixed(segments: int, more: str = "") -> str:
    """[model] with a fixed resolution: for tests that are not about its choice, and much faster."""
    return f"[model]\nsegments = {segments}\n{more}"


def distance_set(tracker: TrackerCampaign, rows=slice(None), name: str = "volume", **changes) -> ObservationSet:
    """The readings of a virtual tracking interferometer as a set."""
    q = tracker.q[rows]
    direction = np.zeros_like(q) if tracker.direction is None else tracker.direction[rows].astype(float)
    fields = dict(
        name=name,
        kind="distance",
        positions=q,
        directions=direction,
        tool=tracker.tool[rows],
        readings=tracker.distance[rows, None],
        u=tracker.u[rows, None],
        labels={"station": tracker.station[rows], "segment": tracker.segment[rows].astype(str)},
        options={"relative": True, "calibrated_u": 0.0},
        source=f"{name}.csv",
    )
    return ObservationSet(**(fields | changes))


def distance_campaign(
    machine: Machine, tracker: TrackerCampaign, off_by: float | None = 5.0, seed: int = 0
) -> Campaign:
    """Campaign with approximate stations wrong by `off_by` mm per coordinate (None: no approximate stations)."""
    rng = np.random.default_rng(seed)
    stations = []
    for name, position in tracker.station_positions.items():
        wrong = None if off_by is None else tuple((position + off_by * rng.standard_normal(3)).tolist())
        stations.append(Station(name, position=wrong))
    return Campaign(machine, tuple(stations), (distance_set(tracker),), title="virtual")


def simulated(
    exact: ExactMachine,
    seed: int,
    *,
    extra: str = "",
    truth: Truth | None = None,
    waviness: float = 1.0,
    off_by: float | None = 5.0,
    **plan,
) -> tuple[Campaign, Truth, TrackerCampaign]:
    """A campaign of `tracker_campaign(**plan)` on a machine with random errors, and its truth."""
    rng = np.random.default_rng(seed)
    truth = random_truth(exact, rng, waviness=waviness) if truth is None else truth
    tracker = tracker_campaign(exact, truth, rng, **plan)
    return distance_campaign(volid_machine(exact, extra), tracker, off_by, seed), truth, tracker


def evaluation_points(exact: ExactMachine, n: int = 5) -> tuple[np.ndarray, np.ndarray]:
    """A grid over the whole travel for each default tool: positions and tool vectors."""
    grid, tools = machine_grid(exact, n), default_tools()
    return np.tile(grid, (len(tools), 1)), np.repeat(tools, len(grid), axis=0)


def spline_truth(model: ErrorModel, theta: np.ndarray) -> Truth:
    """Truth of the exact chain whose functions are the model's, coefficients P θ, by SciPy's splines."""
    truth, c = Truth(), model.parametrisation @ theta
    for f in model.functions:
        if f.part == "location":
            truth.constants[f.name] = float(theta[f.parameters][0])
            continue
        (spline,) = f.splines
        step = (spline.high - spline.low) / spline.segments
        knots = spline.low + step * np.arange(-spline.degree, spline.segments + spline.degree + 1)
        own = np.resize(c[f.coefficients], len(knots) - spline.degree - 1)  # a periodic one begins again
        truth.functions[f.name] = BSpline(knots, own, spline.degree)
    return truth


@dataclass
class Judgement:
    """A solution against the truth over the volume, gauge removed from difference and covariance alike.

    `normalised`: difference / u, (n, 3). `rms`: 3-D root mean square difference [mm]. `nees`: chi-square of the
    difference in the subspace that the covariance spans, and its degrees of freedom.
    """

    normalised: np.ndarray
    rms: float
    nees: float
    rank: int
    difference: np.ndarray
    u: np.ndarray

    @property
    def normalised_rms(self) -> float:
        return float(np.sqrt(np.mean(self.normalised**2)))


def judge(
    solution: Solution, exact: ExactMachine, truth: Truth, q=None, tool=None, tool_rotation: bool = True
) -> Judgement:
    """Compare deviation fields (translations) of solution and exact chain."""
    if q is None:
        q, tool = evaluation_points(exact)
    tool = np.broadcast_to(np.asarray(tool, float), (len(q), 3))
    direction = np.zeros_like(q)
    difference = np.asarray(solution.deviation(q, tool))[:, :3] - exact.deviation(q, tool, truth)[:, :3]
    rows = gradient_matrix(solution.model, np.asarray(solution.parameters), q, tool, direction)[:, :3]
    rows = rows.reshape(3 * len(q), -1)
    values, vectors = np.linalg.eigh(solution.parameter_covariance)
    root = rows @ (vectors * np.sqrt(np.maximum(values, 0.0)))  # C = root rootᵀ
    projected, _ = gauge_free(difference, q, tool, tool_rotation=tool_rotation, machine=exact)
    removed = gauge_basis(q, tool, exact, tool_rotation)
    root = root - removed @ (removed.T @ root)  # as `gauge_free` does with C, but cheaper
    u = np.linalg.norm(root, axis=1).reshape(-1, 3)
    left, sizes, _ = np.linalg.svd(root, full_matrices=False)
    kept = sizes > 0.02 * sizes[0]
    along = left[:, kept].T @ projected.reshape(-1) / sizes[kept]
    return Judgement(
        projected / u, float(np.sqrt(np.mean(np.sum(projected**2, 1)))), float(along @ along), int(kept.sum()),
        projected, u,
    )  # fmt: skip


def gauge_basis(q, tool, exact: ExactMachine, tool_rotation: bool = True) -> np.ndarray:
    """Orthonormal basis (3n, r) of what `gauge_free` removes from fields of a three-axis machine."""
    p = exact.functional_point(q, tool)
    columns = [np.tile(np.eye(3), (len(q), 1)), _turn(p - p.mean(axis=0))]
    if tool_rotation:
        columns.append(_turn(np.broadcast_to(np.asarray(tool, float), p.shape)))
    matrix = np.concatenate(columns, axis=1)
    left, sizes, _ = np.linalg.svd(matrix / np.maximum(np.linalg.norm(matrix, axis=0), 1e-300), full_matrices=False)
    return left[:, sizes > 1e-9 * sizes[0]]


def _turn(arms: np.ndarray) -> np.ndarray:
    """e_k × arm for k = X, Y, Z as columns, (3n, 3)."""
    return np.cross(np.eye(3)[None], arms[:, None, :]).transpose(0, 2, 1).reshape(-1, 3)
