"""Solutions judged by the exact chain: differences of deviation fields against their stated uncertainty."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from exact_chain import ExactMachine, Truth, default_tools, gauge_basis, gauge_free, machine_grid
from scipy.interpolate import BSpline

from volid.fitting.prediction.deviations import gradient_matrix
from volid.fitting.solution import Solution
from volid.model.error_model import ErrorModel


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
