"""The distance equations in numbers: residuals, Jacobian, gradient, second derivatives; offsets eliminated."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from scipy.sparse import csr_array

from volid.backend.rms import rms

if TYPE_CHECKING:
    from jaxtyping import Bool, Float, Int

ABSOLUTE = -1  # group of the readings without an offset


@dataclass(frozen=True)
class Equations:
    """A distance network in numbers: coordinates minus their mean, points as rows; one row per observation.

    Readings of one `group` share an unknown offset; those of the group -1 have none. An offset is linear, and therefore always at
    its best value: the mean, weighted by 1/u², of reading - distance. Taking it off each row leaves equations in the
    coordinates alone (variable projection).
    """

    approximate: Float[np.ndarray, "p d"]
    free: Bool[np.ndarray, " p"]
    start: Int[np.ndarray, " m"]
    end: Int[np.ndarray, " m"]
    readings: Float[np.ndarray, " m"]
    u: Float[np.ndarray, " m"]
    group: Int[np.ndarray, " m"]

    @cached_property
    def extent(self) -> float:
        """Root mean square distance of the points from their mean; where all are in one place, that of the readings."""
        return rms(np.linalg.norm(self.approximate, axis=1)) or rms(self.readings) or 1.0

    @cached_property
    def shares(self) -> csr_array | None:
        """Orthonormal columns of the offsets as rows, shape (g, m): 1/u of their readings, over its norm; None without any."""
        return self.shares_by(np.ones(self.u.size, bool))

    def shares_by(self, kept: Bool[np.ndarray, " m"]) -> csr_array | None:
        """The same where only the readings `kept` tell the offsets; where none of a group is kept, the others share nothing."""
        if (self.group == ABSOLUTE).all():
            return None
        rows = np.flatnonzero(self.group != ABSOLUTE)
        group, weight = self.group[rows], 1 / self.u[rows]
        norm = np.sqrt(np.bincount(group, np.where(kept[rows], weight**2, 0.0)))
        values = weight / np.where(norm > 0, norm, np.inf)[group]
        return csr_array((values, (group, rows)), shape=(norm.size, self.u.size))

    @property
    def offsets(self) -> int:
        """Number of unknown offsets."""
        return np.unique(self.group[self.group != ABSOLUTE]).size

    def centred(self, values: np.ndarray, kept: Bool[np.ndarray, " m"] | None = None) -> np.ndarray:
        """Rows, shape (m, …), already divided by u, without the offsets that the readings `kept` give; default: all."""
        if self.shares is None:
            return values
        if kept is None:
            return values - self.shares.T @ (self.shares @ values)
        shares: Any = self.shares_by(kept)
        return values - shares.T @ (shares[:, kept] @ values[kept])

    def beams(self, x: Float[np.ndarray, "p d"]) -> Beams:
        """Lengths and unit vectors of all distances at coordinates x."""
        vectors = x[self.end] - x[self.start]
        lengths = np.linalg.norm(vectors, axis=1)
        return Beams(lengths, vectors / np.maximum(lengths, 1e-12 * self.extent)[:, None])

    def residuals(
        self, x: Float[np.ndarray, "p d"], kept: Bool[np.ndarray, " m"] | None = None
    ) -> Float[np.ndarray, " m"]:
        """Reading - predicted at coordinates x, divided by u; the readings `kept` give the offsets."""
        return self.centred((self.readings - np.linalg.norm(x[self.end] - x[self.start], axis=1)) / self.u, kept)

    def cost(self, x: Float[np.ndarray, "p d"]) -> float:
        """Half the sum of squared residuals."""
        residuals = self.residuals(x)
        return float(residuals @ residuals) / 2

    def uncentred_jacobian(self, x: Float[np.ndarray, "p d"]) -> Float[np.ndarray, "m k"]:
        """Derivative of the distances alone by the free coordinates, divided by u: plus and minus the direction."""
        directions = self.beams(x).directions / self.u[:, None]
        rows, full = np.arange(self.u.size), np.zeros((self.u.size, *x.shape))
        full[rows, self.end], full[rows, self.start] = directions, -directions
        return full[:, self.free].reshape(self.u.size, -1)

    def jacobian(self, x: Float[np.ndarray, "p d"]) -> Float[np.ndarray, "m k"]:
        """Derivative of the predicted readings by the free coordinates, divided by u."""
        return self.centred(self.uncentred_jacobian(x))

    def bending(self, x: Float[np.ndarray, "p d"], motions: Float[np.ndarray, "k q"]) -> Float[np.ndarray, "m q"]:
        """Second derivative of the predicted readings along motions of the free coordinates, divided by u.

        Of a distance ρ with unit vector e: (|v|² - (e·v)²)/ρ, v the difference of its ends' motions.
        """
        full = np.zeros((*x.shape, motions.shape[1]))
        full[self.free] = motions.reshape(self.free.sum(), x.shape[1], motions.shape[1])
        apart = full[self.end] - full[self.start]
        lengths, directions = self.beams(x)
        along = np.einsum("md,mdq->mq", directions, apart)
        across = (apart**2).sum(axis=1) - along**2
        return self.centred(across / (np.maximum(lengths, 1e-12 * self.extent) * self.u)[:, None])

    def moved(self, x: Float[np.ndarray, "p d"], step: Float[np.ndarray, " k"]) -> Float[np.ndarray, "p d"]:
        """Coordinates x with a step in the free ones."""
        result = x.copy()
        result[self.free] += step.reshape(-1, x.shape[1])
        return result

    def gradient(self, x: Float[np.ndarray, "p d"]) -> Float[np.ndarray, " k"]:
        """Derivative of the cost by the free coordinates."""
        pull = (self.residuals(x) / self.u)[:, None] * self.beams(x).directions
        return self._gathered(-pull)[self.free].ravel()

    def _gathered(self, rows: Float[np.ndarray, "m d"]) -> Float[np.ndarray, "p d"]:
        """Rows of the observations added to their ends, taken from their starts."""
        result = np.zeros_like(self.approximate)
        np.add.at(result, self.end, rows)
        np.subtract.at(result, self.start, rows)
        return result

    def curvature(self, x: Float[np.ndarray, "p d"], exact: bool) -> Float[np.ndarray, "k k"]:
        """Second derivative of the cost by the free coordinates; without `exact` JᵀJ alone, which is never negative.

        Each observation adds w (e eᵀ - (ε/ρ)(I - e eᵀ)), w = 1/u², to the blocks of its two ends, ε being its residual.
        """
        lengths, e = self.beams(x)
        count, d = x.shape
        bend = exact * self.residuals(x) * self.u / np.maximum(lengths, 1e-12 * self.extent)
        outer = (1 + bend)[:, None, None] * e[:, :, None] * e[:, None, :] - bend[:, None, None] * np.eye(d)
        blocks, full = outer / self.u[:, None, None] ** 2, np.zeros((count, count, d, d))
        for a, b, sign in ((0, 0, 1), (1, 1, 1), (0, 1, -1), (1, 0, -1)):
            ends = (self.start, self.end)
            np.add.at(full, (ends[a], ends[b]), sign * blocks)
        result = full[np.ix_(self.free, self.free)].transpose(0, 2, 1, 3).reshape(self.free.sum() * d, -1)
        return result if self.shares is None else result - self._taken(e)

    def _taken(self, e: Float[np.ndarray, "m d"]) -> Float[np.ndarray, "k k"]:
        """What the offsets take from JᵀJ."""
        assert self.shares is not None
        rows = self.shares.tocoo()
        full = np.zeros((rows.shape[0], *self.approximate.shape))
        values = (rows.data / self.u[rows.col])[:, None] * e[rows.col]
        np.add.at(full, (rows.row, self.end[rows.col]), values)
        np.subtract.at(full, (rows.row, self.start[rows.col]), values)
        sums = full[:, self.free].reshape(rows.shape[0], -1)
        return sums.T @ sums

    def weights(self) -> Float[np.ndarray, " k"]:
        """Scale of the curvature for each free coordinate: Σ 1/u² of the observations of its point."""
        weight, count = self.u**-2.0, len(self.free)
        sums = np.bincount(self.start, weight, count) + np.bincount(self.end, weight, count)
        return np.repeat(np.maximum(sums, 1e-12 * sums.max())[self.free], self.approximate.shape[1])


class Beams(NamedTuple):
    """Lengths (m,) and unit vectors (m, d) of the distances, from start to end."""

    lengths: Float[np.ndarray, " m"]
    directions: Float[np.ndarray, "m d"]


def part(equations: Equations, kept: np.ndarray, weights: np.ndarray | None = None) -> Equations:
    """The network of the observations `kept`, with u divided by the square root of the weights."""
    u = equations.u if weights is None else equations.u / np.sqrt(weights)
    return replace(
        equations,
        start=equations.start[kept],
        end=equations.end[kept],
        readings=equations.readings[kept],
        u=u[kept],
        group=equations.group[kept],
    )
