"""Many spheres touched with one probe: the scatter of a touch from all of them together, and touches that contradict the
others.

The scatter is s² = Σ v² / f over all spheres, with f = Σ (touches - unknowns) degrees of freedom: a sphere with five touches
has one degree of freedom, a hundred of them have a hundred. The u of a touch that follows from it is s √(f / (f - 2)), the
standard deviation of Student's t distribution (JCGM 101:2008, 6.4.9), so that few touches that agree by chance do not promise
more than they know; two degrees of freedom tell none. A touch is left out when its residual is too large for chance:
v/√ρ, with ρ its redundancy, is compared with the scatter of all others (externally studentized, Cook and Weisberg 1982), or
with that of most of them (from the median) where several outlying touches hide each other; together at 1 % for the whole file
(Bonferroni). What several touches of a sphere explain alike is not decided: the sphere is left out then."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import stdtrit

from volid.exceptions import NotDeterminedError
from volid.multilateration.sphere import Sphere, fit_sphere

if TYPE_CHECKING:
    from jaxtyping import Float

_CHANCE = 0.01  # of naming a good touch, in a whole file
_TO_DEVIATION, _EFFICIENCY = 1.4826, 0.37  # of the median of absolute normal deviates
_LEAST = 1e-6  # mm: no probe scatters less; exact numbers otherwise have outliers of rounding
_MANY = 1e7  # degrees of freedom of an uncertainty that is stated
_TELLING = 3  # degrees of freedom from which on a scatter has a standard uncertainty
_NO_CHECK = 1e-6  # redundancy of a touch that no other one checks
_ALIKE = (
    0.98  # correlation of two residuals above which an error in one looks like an error in the other (Förstner 1983)
)


@dataclass(frozen=True)
class SphereFits:
    """Spheres fitted to touches of one probe.

    Args:
        spheres: One for each group of touches; None where the centre is not determined or contradicted.
        reasons: Why a sphere is missing, in words, "" where it is there.
        u: Standard uncertainty of a touch: the stated one, or what follows from the scatter. [mm]
        scatter: Of the touches used, from all spheres together; NaN without redundancy. [mm]
        degrees_of_freedom: Of the scatter.
    """

    spheres: tuple[Sphere | None, ...]
    reasons: tuple[str, ...]
    u: float
    scatter: float
    degrees_of_freedom: int

    @property
    def outliers(self) -> tuple[tuple[int, int], ...]:
        """Touches that were left out: group and place in it, both from 0."""
        found = [(i, np.flatnonzero(~s.used)) for i, s in enumerate(self.spheres) if s is not None]
        return tuple((i, int(j)) for i, places in found for j in places)


def fit_spheres(
    groups: Sequence[Float[np.ndarray, "_ 3"]], radius: float | None = None, u: float | None = None
) -> SphereFits:
    """Spheres of one probe from groups of touches, outlying touches left out.

    Args:
        groups: Touches of every sphere, each of shape (n, 3). [mm]
        radius: Of the fitted spheres where it is known, stylus ball included. [mm]
        u: Standard uncertainty of one touch along the normal; None: the scatter of all touches. [mm]

    Raises:
        InputError: Numbers that are not finite, or a wrong radius.
        NotDeterminedError: No `u`, and no sphere has more touches than unknowns.

    >>> import numpy as np
    >>> touches = np.concatenate([np.eye(3), -np.eye(3), [[0.6, 0.8, 0.0], [0.0, 0.6, 0.8]]]) * 15.0
    >>> touches[6] *= 1.01  # 0.15 mm too far out
    >>> fits = fit_spheres([touches], u=0.001)
    >>> fits.outliers, fits.degrees_of_freedom, np.round(fits.spheres[0].centre, 6).tolist()
    (((0, 6),), 3, [0.0, 0.0, 0.0])
    """
    state = _State([*groups], radius, u)
    while (worst := state.worst()) is not None:
        state.leave_out(*worst)
    scatter, freedom = state.scatter()
    touch_u = state.u_of(scatter)
    for i, sphere in enumerate(state.spheres):
        try:
            if sphere is not None:
                sphere.check_coverage(touch_u)
        except NotDeterminedError as error:
            state.spheres[i], state.reasons[i] = None, str(error)
    return SphereFits(tuple(state.spheres), tuple(state.reasons), touch_u, scatter, freedom)


class _State:
    """The fits while touches are left out one by one; what is asked of all spheres again and again is kept in arrays."""

    def __init__(self, groups: list[np.ndarray], radius: float | None, u: float | None) -> None:
        self.groups, self.radius, self.stated = groups, radius, u
        self.spheres: list[Sphere | None] = [None] * len(groups)
        self.reasons = [""] * len(groups)
        self.squares, self.largest = np.zeros(len(groups)), np.zeros(len(groups))
        self.freedom, self.used = np.zeros(len(groups), int), np.zeros(len(groups), int)
        self.place = np.zeros(len(groups), int)  # of the touch with the largest residual
        for i, points in enumerate(groups):
            self.fit(i, np.ones(len(points), bool))
        self.robust = _robust_scatter(self.spheres)

    def fit(self, i: int, used: np.ndarray) -> None:
        """Sphere `i` with the touches `used`, or why there is none."""
        try:
            self.put(i, fit_sphere(self.groups[i], self.radius, used))
        except NotDeterminedError as error:
            self.put(i, None, str(error))

    def put(self, i: int, sphere: Sphere | None, reason: str = "") -> None:
        """Sphere `i`, or the reason why there is none."""
        self.spheres[i], self.reasons[i] = sphere, reason
        self.squares[i] = self.largest[i] = self.freedom[i] = self.used[i] = 0
        if sphere is not None:
            self.squares[i], self.freedom[i], self.used[i] = (
                sphere.square_sum,
                sphere.degrees_of_freedom,
                sphere.used.sum(),
            )
            self.largest[i], self.place[i] = _largest(sphere) if self.freedom[i] else (0.0, 0)

    def scatter(self) -> tuple[float, int]:
        """Standard deviation of a touch from all spheres, NaN without redundancy, and its degrees of freedom."""
        freedom = int(self.freedom.sum())
        return (float(np.sqrt(self.squares.sum() / freedom)) if freedom else np.nan), freedom

    def u_of(self, scatter: float) -> float:
        """Standard uncertainty of a touch. Raises `NotDeterminedError` where it is neither stated nor seen."""
        if self.stated is not None:
            return self.stated
        if not any(s is not None for s in self.spheres):
            return _LEAST
        freedom = int(self.freedom.sum())
        if freedom < _TELLING:
            raise NotDeterminedError(
                f"the spheres have {int(self.used.sum())} touches, {freedom} more than unknowns, which do not tell how touches "
                "scatter; state the standard uncertainty of a touch as `touch_u`, or touch more points"
            )
        return max(scatter * float(np.sqrt(freedom / (freedom - 2.0))), _LEAST)

    def worst(self) -> tuple[int, int] | None:
        """Group and place of the touch that is farthest beyond chance; None when there is none."""
        if not self.freedom.any():
            return None
        i = int(np.argmax(self.largest))
        return (i, int(self.place[i])) if self.largest[i] > self._limit(float(self.largest[i])) else None

    def _limit(self, size: float) -> float:
        """What v/√ρ [mm] stays below by chance: with the scatter of all other touches, or that of most of them if it is less."""
        share = _CHANCE / (2 * int(self.used.sum()))  # of each side
        scatter, freedom = self.scatter()
        if self.stated is not None:
            return self.stated * float(-stdtrit(_MANY, share))
        if freedom < 2:
            return np.inf
        others = np.sqrt(max(freedom * scatter**2 - size**2, 0.0) / (freedom - 1))
        of_others = max(others, _LEAST) * float(-stdtrit(freedom - 1, share / 2))
        return min(of_others, max(self.robust, _LEAST) * float(-stdtrit(_EFFICIENCY * freedom, share / 2)))

    def leave_out(self, i: int, place: int) -> None:
        """Leave out a touch; or the whole sphere where other touches explain the contradiction alike."""
        sphere = self.spheres[i]
        assert sphere is not None
        alike = _alike(sphere, place, self.groups[i])
        if not alike:
            self.fit(i, sphere.used & (np.arange(len(sphere.used)) != place))
            return
        numbers = ", ".join(str(j + 1) for j in sorted((*alike, place)))
        self.put(
            i,
            None,
            f"one of the touches {numbers} contradicts the others by "
            f"{1e3 * abs(float(sphere.residuals[place])):.3g} µm or more, "
            "and they do not tell which; touch more points",
        )


def _robust_scatter(spheres: Sequence[Sphere | None]) -> float:
    """Standard deviation of a touch from the median of |v|/√ρ [mm], which a few outlying touches do not change; 0 for none."""
    sizes = [_sizes(s) for s in spheres if s is not None and s.degrees_of_freedom]
    together = np.concatenate([v[v >= 0.0] for v in sizes]) if sizes else np.zeros(0)
    return _TO_DEVIATION * float(np.median(together)) if together.size else 0.0


def _sizes(sphere: Sphere) -> np.ndarray:
    """v/√ρ [mm] of every touch; -1 for touches that nothing checks or that were left out."""
    checked = sphere.used & (np.nan_to_num(sphere.redundancies) > _NO_CHECK)
    return np.where(checked, np.abs(sphere.residuals) / np.sqrt(np.where(checked, sphere.redundancies, 1.0)), -1.0)


def _largest(sphere: Sphere) -> tuple[float, int]:
    """The largest v/√ρ [mm] of the touches used, and its place."""
    sizes = _sizes(sphere)
    return max(float(sizes.max()), 0.0), int(np.argmax(sizes))


def _alike(sphere: Sphere, place: int, points: np.ndarray) -> tuple[int, ...]:
    """Places of other touches whose residuals an error in `place` changes in proportion."""
    away = points - sphere.centre
    normals = away / np.linalg.norm(away, axis=1)[:, None]
    design = normals if len(sphere.cofactor) == 3 else np.column_stack([normals, np.ones(len(normals))])
    shared = -design @ sphere.cofactor @ design[place]
    redundancies = np.nan_to_num(sphere.redundancies, nan=1.0)
    correlation = shared / np.sqrt(np.maximum(redundancies * redundancies[place], 1e-12))
    others = (
        sphere.used & (np.arange(len(points)) != place) & (redundancies > _NO_CHECK) & (np.abs(correlation) > _ALIKE)
    )
    return tuple(int(j) for j in np.flatnonzero(others))
