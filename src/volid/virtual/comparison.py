"""A solution against the truth of a virtual machine: differences with their u, the gauge removed from both (CONVENTIONS 4).

The functions of a solution refer to the measured range of their axes, those of a truth to the whole travels. So the truth is
expressed first in the solution's own model: the parameters whose deviations are nearest to the true ones over the measured
ranges, for tool vectors all around, up to a rigid motion of the workpiece frame.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from volid.backend.even_points import even_points
from volid.fitting.prediction.deviations import deviation_values, gradient_matrix
from volid.fitting.prediction.spread import covariance_root, linear_uncertainty
from volid.fitting.prediction.working_volume import spread_positions
from volid.fitting.solution import Solution
from volid.model.axis_lines import line_row
from volid.model.iso230 import parse
from volid.model.jacobian import rigid_motion_rows, tool_rotation_rows
from volid.model.rigid_fields import column_space, without
from volid.virtual.truth import Truth

POINTS = 64  # of the deviation field, over the travel (Halton)
POSITIONS = 7  # of every error motion
COVERAGE_FACTOR = 1.96  # 95 % of a normal distribution
TIMES = 6  # equations per unknown by which a truth is expressed in a model
ARM = 500.0  # mm: largest component of the tool vectors there; weighs rotations against translations
RANK = 1e-9  # of the largest singular value
STEPS = 2  # of Gauss-Newton: errors of second order are 1e-6 mm
NOTHING = 1e-6  # of the largest u of a function: below, the datum fixes the value and u has no meaning


class Comparison(NamedTuple):
    """Solution minus truth, and the standard uncertainty of the solution; NaN where the data do not determine the value.

    Attributes:
        field: Difference of the deviations at `POINTS` places, shape (POINTS, 3) [mm], without the gauge.
        field_u: Its standard uncertainty, shape (POINTS, 3) [mm], from the covariance without the gauge.
        functions: Difference by name, in the stated datum, at `POSITIONS` places of the travel, or one value of a constant
            [mm or rad]; location errors are those of the axis average lines.
        functions_u: Their standard uncertainties, of the same shapes.
    """

    field: np.ndarray
    field_u: np.ndarray
    functions: dict[str, np.ndarray]
    functions_u: dict[str, np.ndarray]


def compare(solution: Solution, truth: Truth) -> Comparison:
    """Differences of a solution from the truth it was measured on; mean of both approach directions.

    d = (I - Q Qᵀ)(e_solution - e_truth), u² = diag((I - Q Qᵀ) G C Gᵀ (I - Q Qᵀ)), with Q the gauge (`gauge_basis`) and G the
    gradient of the field with respect to the parameters. Tool vectors are those of the campaign, in turn.

    Args:
        solution: The solution of a campaign on the virtual machine, in any datum.
        truth: The truth of that machine, as `simulate` returns it.

    Example:
        >>> import volid
        >>> from volid.io import read_machine
        >>> plan = volid.standard_plan(read_machine("models/wYXbZt_vertical.toml"), n_per_station=60)
        >>> campaign, truth = volid.simulate(plan, seed=1)
        >>> found = compare(volid.fit(campaign), truth)
        >>> found.field.shape, found.functions["EXX"].shape
        ((64, 3), (7,))
    """
    if solution.datum != truth.machine.datum:
        solution = solution.in_datum(truth.machine.datum)
    field, field_u = _field(solution, truth)
    true, functions, functions_u = true_parameters(solution, truth), {}, {}
    for name in solution.model.names:
        functions[name], functions_u[name] = _function(solution, true, name)
    return Comparison(field, field_u, functions, functions_u)


def covered(difference: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Whether |difference| ≤ 1.96 u, as 1.0 or 0.0; NaN where there is no value, or the datum fixes it (u = 0)."""
    size = np.nanmax(u) if np.isfinite(u).any() else 0.0
    counts = np.isfinite(difference) & (u > NOTHING * size)
    return np.where(counts, np.abs(difference) <= COVERAGE_FACTOR * u, np.nan)


def gauge_basis(solution: Solution, positions: np.ndarray, tool: np.ndarray) -> np.ndarray:
    """Orthonormal basis (3m, r) of what no comparison of fields at m points may contain.

    That is a rigid motion of the workpiece frame, and a constant tool rotation or translation too where its parameters are held
    at 0 or not determined.
    """
    columns = [rigid_motion_rows(solution.machine, positions, tool)[:, :3]]
    tool_frame = [f.name for f in solution.model.tool_frame]
    open_ones = [parse(name) for name in tool_frame if not np.isfinite(solution.location(name).value)]
    rows = tool_rotation_rows(solution.machine, positions, tool)
    if any(error.is_rotation for error in open_ones):
        columns.append(rows[:, :3])
    if any(not error.is_rotation for error in open_ones):
        columns.append(rows[:, 3:])  # R_h itself: a translation that turns with the head
    return column_space(np.concatenate(columns, axis=2).reshape(3 * len(positions), -1))


def _field(solution: Solution, truth: Truth) -> tuple[np.ndarray, np.ndarray]:
    """Difference of the deviation fields and its u, (POINTS, 3) each."""
    positions = spread_positions(solution.machine, POINTS)
    vectors = solution.campaign.tool_vectors()
    tool, still = vectors[np.arange(POINTS) % len(vectors)], np.zeros_like(positions)
    known: np.ndarray = np.ones(POINTS, dtype=bool)
    if not solution.fully_determined:
        known = np.all(solution.evaluate(positions, tool).determined[:, :3], axis=1)
    difference, u = np.full((2, POINTS, 3), np.nan)
    if not known.any():
        return difference, u
    basis = gauge_basis(solution, positions[known], tool[known])
    if 3 * known.sum() <= basis.shape[1]:
        return difference, u
    theta = np.asarray(solution.parameters)
    found = deviation_values(solution.model, theta, positions, tool, still)[:, :3]
    plain = (found - truth.deviation(positions, tool)[:, :3])[known].ravel()
    gradient = gradient_matrix(solution.model, theta, positions, tool, still)[known, :3].reshape(len(plain), -1)
    root = gradient @ covariance_root(solution.parameter_covariance)
    difference[known] = without(basis, plain).reshape(-1, 3)
    u[known] = np.linalg.norm(without(basis, root), axis=1).reshape(-1, 3)
    return difference, u


def true_parameters(solution: Solution, truth: Truth) -> np.ndarray:
    """θ, shape (n,), of the solution's model that is nearest to the truth over the measured ranges, mean of both directions."""
    model, machine = solution.model, solution.machine
    n = int(np.ceil(TIMES * (model.n_parameters + 6) / 6))
    unit = even_points(n, len(machine.axes) + 3)
    low, length = np.array([a.travel[0] for a in machine.axes]), np.array([a.length for a in machine.axes])
    positions, tool = low + unit[:, : len(low)] * length, (unit[:, len(low) :] - 0.5) * 2.0 * ARM
    weight = np.array([1.0, 1.0, 1.0, ARM, ARM, ARM])[None, :, None]
    gradient = gradient_matrix(model, np.zeros(model.n_parameters), positions, tool, np.zeros_like(positions))
    rows = np.concatenate([gradient, rigid_motion_rows(machine, positions, tool)], axis=2) * weight
    design = rows.reshape(-1, rows.shape[2])
    scale = 1.0 / np.maximum(np.linalg.norm(design, axis=0), 1e-300)
    left, sizes, right = np.linalg.svd(design * scale, full_matrices=False)
    seen = sizes > RANK * sizes[0]
    true, found = truth.deviation(positions, tool), np.zeros(design.shape[1])
    for _ in range(STEPS):
        own = deviation_values(model, found[: model.n_parameters], positions, tool, np.zeros_like(positions))
        moved = np.einsum("mkr,r->mk", rigid_motion_rows(machine, positions, tool), found[model.n_parameters :])
        rest = ((true - own - moved) * weight[0, :, 0]).ravel()
        found = found + scale * (right[seen].T @ ((left[:, seen].T @ rest) / sizes[seen]))
    return np.asarray(found[: model.n_parameters])


def _function(solution: Solution, true: np.ndarray, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Difference of one function from that of the true parameters, and its u; NaN where the data do not determine it."""
    error = parse(name)
    if error.location:
        found = solution.location(name)
        return np.array([found.value - line_row(solution.model, name) @ true]), np.array([found.u])
    at = np.linspace(*solution.machine.axis(error.axis).travel, POSITIONS)
    rows = solution.motion_rows(name, at, 0)
    u = linear_uncertainty(rows, solution.parameter_covariance)
    open_rows = solution.is_not_determined(rows)
    difference = rows @ (np.asarray(solution.parameters) - true)
    return np.where(open_rows, np.nan, difference), np.where(open_rows, np.nan, u)
