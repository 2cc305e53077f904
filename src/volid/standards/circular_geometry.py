"""What bends a circle: geometry told apart from dynamics, by linear least squares of the radius over the angle, both senses together.

For axes a and b of the plane, φ the angle from +a to +b, s = ±1 the sense, R the radius, a small deviation e of the functional point
reads as Δr = e·(cos φ, sin φ):

    centre of the socket (x, y)         -x cos φ - y sin φ
    length of the bar, mean scale       one number for all
    scale of a less that of b           (R/2) cos 2φ
    squareness α                        -(R/2) sin 2φ         angle between +a and +b less 90°
    lag of a less that of b             s sin 2φ              v/2 (τ_a - τ_b), with v the feed
    reversal B of E_aa, E_bb            (d_a/2) cos φ, (d_b/2) sin φ
    reversal B of E_ba, E_ab            (d_a/2) sin φ, (d_b/2) cos φ
    bow of E_ba, E_ab                   (1/4) sin 3φ, -(1/4) cos 3φ

d_a = -s sgn(sin φ) and d_b = s sgn(cos φ) are the directions in which the axes move. A bow k is a parabola k (q/R)² of the
straightness: k cos²φ sin φ, of which the part in sin φ moves the centre. A parabola of the other axis's positioning looks alike.

Within a window behind every change of quadrant nothing is fitted: there the pulses of friction stand, the reversal spikes. Each is the
largest residual within its window, and nothing that the fit knows of. What the terms leave is the residual; where it is smooth over
the angle it is no noise, and u of the terms contains what it can do to them (`volid.standards.circular_spread`).

Not modelled: waves of a pitch, angular errors whose effect is no such term, and pulses that last longer than the window.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from volid.standards.circular_readings import CircularReadings
from volid.standards.circular_spread import correlated_variance
from volid.standards.circular_zone import LeastSquaresCircle

BEFORE = 2.0  # degrees: readings are taken somewhat before the angle they are given to
FEW_DEGREES = 200.0  # an arc below does not tell a bow from centre, radius and scale
BOW = 0.005  # mm over the diameter: standard uncertainty of what is known beforehand of a bow, on such arcs
_NOISE = 1e-9  # of the largest singular value: a combination that no reading sees
_PART = 1e-6  # share of a term in such a combination
_EDGE = 1e-6  # degrees: rounding
QUADRANTS = (0, 90, 180, 270)


class Term(NamedTuple):
    """One term: `value` and standard uncertainty `u`, mm but for scale (1) and squareness (rad); NaN where not determined."""

    value: float
    u: float


class Spike(NamedTuple):
    """A reversal spike: `sense`, at which `quadrant` [degrees], its mean height over the runs, outwards positive, and u [mm].

    `lasting`: what remains of it behind the window, as a share.
    """

    sense: int
    quadrant: int
    height: float
    u: float
    lasting: float


@dataclass(frozen=True)
class Decomposition:
    """The terms of a test by name, its spikes, and what is left.

    `fitted`, `residual` (m,) [mm]: about the least-squares centre; `masked` (m,): behind changes of quadrant; `unit_weight`: root
    mean square of residual / u, NaN where no u is known.
    """

    terms: Mapping[str, Term]
    spikes: tuple[Spike, ...]
    fitted: np.ndarray
    residual: np.ndarray
    masked: np.ndarray
    unit_weight: float


def decompose(test: CircularReadings, circle: LeastSquaresCircle, window: float) -> Decomposition:
    """Terms of a test; `window`: degrees behind a change of quadrant that are left out of the fit."""
    columns = _columns(test, circle.direction)
    A = np.stack(list(columns.values()), axis=1)
    masked = in_windows(test, -BEFORE, window)
    prior = _prior(test, tuple(columns))
    gain, beforehand, unknown = _solve(A, ~masked, test.u, prior)
    value = gain @ circle.deviation
    fitted = A @ value
    residual = circle.deviation - fitted
    scatter, unit_weight = _scatter(test, residual, ~masked, A.shape[1] - np.count_nonzero(prior))
    smooth = correlated_variance(gain, residual, test.angle, ~masked, test.step)
    u = np.sqrt(gain**2 @ scatter**2 + beforehand + smooth)
    value, u = np.where(unknown, np.nan, value), np.where(unknown, np.nan, u)
    terms = {name: Term(float(v), float(w)) for name, v, w in zip(columns, value, u, strict=True)}
    spikes = _spikes(test, residual, scatter, window)
    return Decomposition(_with_centre(terms, circle), spikes, fitted, residual, masked, unit_weight)


def _columns(test: CircularReadings, direction: np.ndarray) -> dict[str, np.ndarray]:
    """Every term's factor, (m,); those of the centre about the socket that was found."""
    phi, s = np.deg2rad(test.angle), test.sense
    c, d = np.cos(phi), np.sin(phi)
    along_a, along_b = -s * np.sign(np.round(d, 12)), s * np.sign(np.round(c, 12))
    parts = {f"radius {k}": (test.parts == k) * 1.0 for k in range(int(test.parts.max()) + 1)}
    return {
        **parts,
        "centre a": -direction[:, 0],
        "centre b": -direction[:, 1],
        "scale": 0.5 * test.radius * np.cos(2.0 * phi),
        "squareness": -0.5 * test.radius * np.sin(2.0 * phi),
        "lag": s * np.sin(2.0 * phi),
        "reversal aa": 0.5 * along_a * c,
        "reversal bb": 0.5 * along_b * d,
        "reversal ba": 0.5 * along_a * d,
        "reversal ab": 0.5 * along_b * c,
        "bow ba": 0.25 * np.sin(3.0 * phi),
        "bow ab": -0.25 * np.cos(3.0 * phi),
    }


def in_windows(test: CircularReadings, start: float, end: float) -> np.ndarray:
    """Which readings were taken from `start` to `end` degrees behind a change of quadrant, (m,)."""
    behind = np.mod(test.sense * test.angle - start + 1e-9, 90.0)  # quadrants change every 90 degrees in either sense
    return np.asarray(behind <= end - start + 2e-9)


def _prior(test: CircularReadings, names: tuple[str, ...]) -> np.ndarray:
    """1/u of what is known beforehand, by term; 0 for nothing."""
    short = test.arc < FEW_DEGREES
    return np.array([1.0 / BOW if short and name.startswith("bow") else 0.0 for name in names])


class _Solved(NamedTuple):
    """`gain` (p, m): ∂term/∂reading; `beforehand` (p,): variance by what was known; `unknown` (p,): terms no reading determines."""

    gain: np.ndarray
    beforehand: np.ndarray
    unknown: np.ndarray


def _solve(A: np.ndarray, used: np.ndarray, u: np.ndarray | None, prior: np.ndarray) -> _Solved:
    """Least squares of the readings used, weighted by 1/u; without u, priors count as if it were 1 µm."""
    weight = used / (np.full(len(A), 1e-3) if u is None else u)
    both = np.vstack([weight[:, None] * A, np.diag(prior)])
    size = np.linalg.norm(both, axis=0)
    size[size == 0.0] = 1.0
    U, s, Vt = np.linalg.svd(both / size, full_matrices=False)
    kept = s > _NOISE * s[0]
    inverse = (Vt[kept].T / s[kept]) @ U[:, kept].T / size[:, None]
    unknown = np.abs(Vt[~kept]).max(axis=0, initial=0.0) > _PART
    return _Solved(inverse[:, : len(A)] * weight, (inverse[:, len(A) :] ** 2).sum(axis=1), unknown)


def _scatter(test: CircularReadings, residual: np.ndarray, used: np.ndarray, p: int) -> tuple[np.ndarray, float]:
    """Standard uncertainty of the readings (m,), enlarged where the residuals scatter more; and their ratio to u."""
    free = max(int(used.sum()) - p, 1)
    if test.u is None:
        return np.full(len(residual), np.sqrt(np.sum(residual[used] ** 2) / free)), np.nan
    ratio = float(np.sqrt(np.sum((residual[used] / test.u[used]) ** 2) / free))
    return test.u * max(ratio, 1.0), ratio


def _with_centre(terms: dict[str, Term], circle: LeastSquaresCircle) -> dict[str, Term]:
    """Centre terms from the programmed centre."""
    for i, name in enumerate(("centre a", "centre b")):
        terms[name] = terms[name]._replace(value=terms[name].value + float(circle.centre[i]))
    return terms


def _spikes(test: CircularReadings, residual: np.ndarray, u: np.ndarray, window: float) -> tuple[Spike, ...]:
    """The spike of every sense at every change of quadrant of which both sides were run over."""
    found = [_spike(test, residual, u, (sense, q, window)) for sense in test.senses for q in QUADRANTS]
    return tuple(spike for spike in found if spike is not None)


def _spike(
    test: CircularReadings, residual: np.ndarray, u: np.ndarray, place: tuple[int, int, float]
) -> Spike | None:
    """The spike of one sense at one change of quadrant, mean over the runs; None where no run passes it."""
    sense, quadrant, window = place
    behind = (sense * (test.angle - quadrant) + 180.0) % 360.0 - 180.0
    near = max(5.0, 2.0 * test.step)  # degrees, on either side of the window
    rows, left = [], []
    for run in (r for r in test.runs if test.sense[r[0]] == sense):
        here = run[(behind[run] >= -_EDGE) & (behind[run] <= window + _EDGE)]
        after = run[(behind[run] > window + _EDGE) & (behind[run] <= window + near)]
        before = (behind[run] < -_EDGE) & (behind[run] >= -near)
        if len(here) and len(after) and before.any():
            rows.append(here[np.argmax(np.abs(residual[here]))])
            left.append(float(residual[after].mean()))
    if not rows:
        return None
    height = float(residual[rows].mean())
    lasting = float(np.mean(left)) / height if height else 0.0
    return Spike(sense, quadrant, height, float(np.sqrt(np.mean(u[rows] ** 2) / len(rows))), lasting)
