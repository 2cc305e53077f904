"""Down to a minimum of the sum of squares: damped Newton steps, a check of the curvature there, and no stop on a saddle.

Gauss-Newton is not enough where an unknown point lies in the plane of the points it is measured from: the distances depend on the
square of its height alone, so the Jacobian vanishes there, and steps from it either run away or stay in the plane, which may be a
maximum. The exact second derivatives tell one from the other.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve, eigh

from volid.exceptions import InputError
from volid.multilateration.equations import Equations

if TYPE_CHECKING:
    from jaxtyping import Float

_ITERATIONS = 300
_SADDLES = 20  # times that a saddle is left
_FIRST, _LEAST, _MOST = 1e-4, 1e-13, 1e13  # damping, relative to Σ 1/u² of each point
_SMALL = 1e-11  # of the extent: below, a step has arrived
_EARNED = 1e-14  # relative decrease of the sum of squares: below, a step has arrived
_NEGATIVE = 1e-11  # curvature relative to Σ 1/u²: below minus this, it is negative and not rounding
_EPSILON = float(np.finfo(float).eps)


def descend(equations: Equations, x: Float[np.ndarray, "p d"]) -> Float[np.ndarray, "p d"]:
    """The minimum below x; of what the distances do not determine, nothing is moved.

    Raises `InputError` when no minimum is reached.
    """
    start = x
    for _ in range(_SADDLES):
        x, arrived = _slide(equations, x)
        if not arrived:
            break
        away = _off_the_saddle(equations, x, start)
        if away is None:
            return x
        x = away
    worst = int(np.argmax(np.abs(equations.residuals(x))))
    raise InputError(
        f"no solution within {_ITERATIONS} iterations from the approximate coordinates; the worst observation is "
        f"number {worst + 1} of those used. Expected better approximate coordinates, or readings without mixed-up names"
    )


def within_the_plane(equations: Equations) -> Float[np.ndarray, "p d"] | None:
    """The minimum in the plane (line) in which all approximate coordinates lie, a saddle or not; None where they lie in none."""
    centred = equations.approximate - equations.approximate.mean(axis=0)
    sizes, axes = np.linalg.svd(centred, full_matrices=False)[1:]
    if sizes.size < centred.shape[1] or sizes[-1] > 1e-12 * sizes[0]:
        return None
    x, arrived = _slide(equations, equations.approximate)
    return x - np.outer((x - equations.approximate) @ axes[-1], axes[-1]) if arrived else None


class _Step(NamedTuple):
    """A step, the decrease of the cost that it promises, and the damping it needed."""

    step: Float[np.ndarray, " k"]
    promised: float
    damping: float


def _slide(equations: Equations, x: Float[np.ndarray, "p d"]) -> tuple[Float[np.ndarray, "p d"], bool]:
    """Where steps lead that lower the sum of squares, and whether they ended by themselves."""
    cost, damping, scale = equations.cost(x), _FIRST, equations.weights()
    for _ in range(_ITERATIONS):
        gradient = equations.gradient(x)
        found = _step(equations, x, gradient, scale, damping)
        trial = equations.moved(x, found.step)
        lowered = equations.cost(trial)
        small = np.abs(found.step).max() < _SMALL * equations.extent
        if small or found.promised < _EARNED * (1 + cost) + _rounding(equations, x):
            return (trial if lowered <= cost + _rounding(equations, x) else x), True
        if lowered < cost:
            good = (cost - lowered) / found.promised
            x, cost, damping = trial, lowered, max(found.damping * (0.1 if good > 0.5 else 1.0), _LEAST)
        else:
            damping = 5 * found.damping
        if damping > _MOST:
            return x, True
    return x, False


def _step(equations: Equations, x: np.ndarray, gradient: np.ndarray, scale: np.ndarray, damping: float) -> _Step:
    """Damped Newton step where the curvature allows it, else a Levenberg-Marquardt step."""
    for exact in (True, False):
        curvature = equations.curvature(x, exact)
        for tried in (damping,) if exact else damping * 10.0 ** np.arange(8):
            try:
                factor = cho_factor(curvature + np.diag(tried * scale), overwrite_a=True, check_finite=False)
            except LinAlgError:
                continue
            step = -cho_solve(factor, gradient, check_finite=False)
            promised = -(gradient @ step) - step @ (curvature @ step) / 2
            return _Step(step, float(promised), float(tried))
    return _Step(-gradient / (scale * max(damping, 1.0)), float((gradient**2 / scale).sum()), damping)


def _rounding(equations: Equations, x: Float[np.ndarray, "p d"]) -> float:
    """Size of the rounding of the cost: that of the lengths, over u, times the residuals."""
    lengths = np.linalg.norm(x[equations.end] - x[equations.start], axis=1) + equations.extent
    return 4 * _EPSILON * float(np.abs(equations.residuals(x)) @ (lengths / equations.u))


def _off_the_saddle(equations: Equations, x: np.ndarray, start: np.ndarray) -> np.ndarray | None:
    """A lower place along the directions of negative curvature, on the side of the start; None at a minimum."""
    root = np.sqrt(equations.weights())
    curvature = equations.curvature(x, exact=True) / root[:, None] / root
    try:
        cho_factor(curvature + _NEGATIVE * np.eye(root.size), check_finite=False)
        return None
    except LinAlgError:
        sizes, axes = eigh(curvature, check_finite=False)
    axes = axes[:, sizes < -_NEGATIVE] / root[:, None]
    largest = np.argmax(np.abs(axes).round(12), axis=0)
    axes *= np.sign(axes[largest, np.arange(axes.shape[1])])  # up, where nothing else tells
    side = (start - x)[equations.free].ravel() @ axes
    direction = axes @ np.where(side < -_SMALL * equations.extent * np.linalg.norm(axes, axis=0), -1.0, 1.0)
    cost, length = equations.cost(x), 0.05 * equations.extent / max(float(np.abs(direction).max(initial=0.0)), 1e-300)
    for _ in range(40):
        trial = equations.moved(x, length * direction)
        if equations.cost(trial) < cost - _rounding(equations, x):
            return trial
        length /= 2
    return None
