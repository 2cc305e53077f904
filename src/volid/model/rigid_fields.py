"""Motions that are taken out of a deviation field because no measurement can see them (CONVENTIONS 4)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from volid.model.jacobian import rigid_motion_rows
from volid.model.machine import Machine

if TYPE_CHECKING:
    from jaxtyping import Float

EVERY = slice(None)
DEPENDENT = 1e-9  # of the largest singular value: below, a combination of unit columns is rounding


class WorkpieceMotion:
    """The rigid motion of the workpiece frame that is in fields over some places: what fits their translations best.

    `rows` (m, 6, 6): deviations that the motion (t, ω) causes. `inverse` (6, 3 n): the least-squares motion [mm, rad] of
    translations (3 n,) [mm] at the n places that it is fitted to; the smallest one where these leave a part of it open.

    Args:
        machine: whose nominal chain places the points.
        positions: of the axes, shape (m, n_axes) [mm or degrees].
        tool: tool vectors, shape (m, 3) or (3,) [mm].
        fitted: the places that the motion is fitted to, all by default: those spread evenly, where others were added.
    """

    def __init__(
        self,
        machine: Machine,
        positions: Float[np.ndarray, "m axes"],
        tool: Float[np.ndarray, "*m 3"],
        fitted: slice = EVERY,
    ) -> None:
        self.rows, self.fitted = rigid_motion_rows(machine, positions, tool), fitted
        columns = self.rows[fitted, :3].reshape(-1, 6)
        scale = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)  # a rotation about the line that all points lie on
        smallest = np.finfo(float).eps * len(columns)
        self.inverse = np.linalg.pinv(columns / scale, rcond=smallest) / scale[:, None]

    @property
    def translations(self) -> Float[np.ndarray, "m3 6"]:
        """Translations that the motion causes, (3m, 6)."""
        return np.asarray(self.rows[:, :3].reshape(-1, 6))

    def motions(self, fields: np.ndarray) -> np.ndarray:
        """The motions (s, 6) [mm, rad] that fit the translations of fields (s, m, 6) or (s, m, 3) best."""
        return np.asarray(fields[:, self.fitted, :3].reshape(len(fields), -1) @ self.inverse.T)

    def removed_from(self, fields: np.ndarray) -> np.ndarray:
        """Fields (s, m, 6) or translations (s, m, 3) less the rigid motion that fits their translations best."""
        motion = self.motions(fields)
        rows = self.rows[:, : fields.shape[2]].reshape(-1, motion.shape[1])
        return np.asarray(fields - (motion @ rows.T).reshape(fields.shape))


def column_space(columns: Float[np.ndarray, "m k"]) -> Float[np.ndarray, "m r"]:
    """Orthonormal basis of what columns of any size span; combinations that are only rounding are left out."""
    unit = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    vectors, sizes, _ = np.linalg.svd(unit, full_matrices=False)
    return np.asarray(vectors[:, sizes > DEPENDENT * np.max(sizes, initial=0.0)])


def without(basis: Float[np.ndarray, "m r"], values: np.ndarray) -> np.ndarray:
    """Values (m,) or columns (m, k) less their part in the span of an orthonormal `basis`: v - Q Qᵀ v."""
    return np.asarray(values - basis @ (basis.T @ values))
