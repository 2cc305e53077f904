"""What a fit is for, in one list of numbers: the deviation over the measured volume, free of what no measurement can see.

A misfit is judged by what it does to these numbers, each in units of its own u. They are the six components of the deviation at
places over the volume, with the tool vectors of the campaign, less the rigid motion of the workpiece that their translations
contain (CONVENTIONS 4).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import solve_triangular

from volid.campaign import Campaign
from volid.fitting.diagnosis.sensitivities import Sensitivities
from volid.fitting.prediction.deviations import error_gradients, gradient_matrix
from volid.fitting.prediction.working_volume import spread_positions
from volid.model.error_model import ErrorModel
from volid.model.rigid_fields import WorkpieceMotion

PLACES = 24  # over the volume, beside up to 16 corners
LEAST = 0.5  # of the root mean square u of its kind: a number with less (near a reference) is not judged
TOOLS = 4  # tool vectors at most


@dataclass(frozen=True, eq=False)
class Outcome:
    """q numbers of the outcome. `rows` (q, r): how they answer steps along the columns of the covariance's root, over their u.

    `u` (q,): their standard uncertainties [mm, rad]. `errors` (q, e): how they answer error values, over their u. `positions`
    (q, n_axes), where they are. `is_length` (q,): translations; the others are rotations.
    """

    rows: np.ndarray
    u: np.ndarray
    errors: np.ndarray
    positions: np.ndarray
    is_length: np.ndarray

    def turned(self, lower: np.ndarray) -> Outcome:
        """The same numbers for the root L `lower`⁻ᵀ of another covariance; u stays."""
        return replace(self, rows=solve_triangular(lower, self.rows.T, lower=True).T)

    @classmethod
    def nothing(cls, width: int) -> Outcome:
        """For tests that nobody asks what they do to; `width` r."""
        none = np.zeros(0)
        return cls(np.zeros((0, width)), none, np.zeros((0, 0)), np.zeros((0, 0)), none.astype(bool))

    @property
    def seen(self) -> Sensitivities:
        """As readings have them; a tool vector changes what is asked, not the outcome."""
        still = np.zeros_like(self.positions)
        return Sensitivities(self.errors.T, np.zeros((3, len(self.u))), self.positions, still + 1.0)


def outcome_of(
    campaign: Campaign, model: ErrorModel, theta: np.ndarray, root: np.ndarray, extra: np.ndarray, scatter: np.ndarray
) -> Outcome:
    """The outcome of a solution.

    Args:
        campaign: the readings, for their tool vectors.
        model: the error model, whose travels are the measured range.
        theta: parameters θ (n,).
        root: of the covariance of θ as far as it follows from readings, (n, r).
        extra: what else is in the covariance of θ, as further columns (n, h).
        scatter: standard deviation of what is independent from place to place, by component (6,) [mm, rad].
    """
    positions, tools = _places(model, campaign.tool_vectors())
    partials = error_gradients(model, theta, positions, tools)  # (places, 6, error values)
    gradients = gradient_matrix(model, theta, positions, tools, np.zeros_like(positions))
    motion = WorkpieceMotion(model.machine, positions, tools)
    free = np.moveaxis(motion.removed_from(np.moveaxis(gradients, 2, 0)), 0, 2).reshape(-1, gradients.shape[2])
    errors = np.moveaxis(motion.removed_from(np.moveaxis(partials, 2, 0)), 0, 2).reshape(-1, partials.shape[2])
    rows, more = free @ root, free @ extra
    alone = np.tile(scatter, len(positions))
    u = np.sqrt(np.sum(rows**2, axis=1) + np.sum(more**2, axis=1) + alone**2)
    is_length = np.tile(np.arange(6) < 3, len(positions))
    kept = _judged(u, is_length)
    at = np.repeat(positions, 6, axis=0)[kept]
    return Outcome(rows[kept] / u[kept, None], u[kept], errors[kept] / u[kept, None], at, is_length[kept])


def _judged(u: np.ndarray, is_length: np.ndarray) -> np.ndarray:
    """Which numbers have a u that is not nearly 0 by the choice of a reference."""
    kept = np.zeros(len(u), dtype=bool)
    for kind in (is_length, ~is_length):
        size = float(np.sqrt(np.mean(u[kind] ** 2))) if kind.any() else 0.0
        kept |= kind & (u > max(LEAST * size, 1e-12))
    return kept


def _places(model: ErrorModel, tools: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Places over the measured volume, corners among them, with tool vectors in turn."""
    machine = model.machine
    travels = np.array([axis.travel for axis in machine.axes])
    corners = np.array(list(np.ndindex(*[2] * len(travels))))
    corners = corners[:: max(len(corners) // 16, 1)]
    ends = travels[np.arange(len(travels)), corners]
    positions = np.concatenate([spread_positions(machine, PLACES), ends])
    few = tools[np.unique(np.linspace(0, len(tools) - 1, min(len(tools), TOOLS)).astype(int))]
    return positions, few[np.arange(len(positions)) % len(few)]


def largest(change: np.ndarray) -> float:
    """The largest of changes given in units of u, over U = 2 u."""
    return float(np.max(np.abs(change), initial=0.0)) / 2.0


def typical(change: np.ndarray | Sequence[float]) -> float:
    """Root mean square of changes in units of u."""
    values = np.asarray(change)
    return float(np.sqrt(np.mean(values**2))) if values.size else 0.0
