"""What bends a circle: geometry told apart from dynamics, by least squares of the radius over the angle, both senses together.

For axes a and b of the plane, φ the angle from +a to +b, s = ±1 the sense, R the radius, a small deviation e of the
functional point reads as Δr = e·(cos φ, sin φ):

    centre of the socket (x, y)         -x cos φ - y sin φ
    length of the bar, mean scale       one number for all
    scale of a less that of b           (R/2) cos 2φ
    squareness α                        -(R/2) sin 2φ         angle between +a and +b less 90°
    lag of a less that of b             s sin 2φ              v/2 (τ_a - τ_b), with v the feed
    reversal B of E_aa, E_bb            (d_a/2) cos φ, (d_b/2) sin φ
    reversal B of E_ba, E_ab            (d_a/2) sin φ, (d_b/2) cos φ
    bow of E_ba, E_ab                   (1/4) sin 3φ, -(1/4) cos 3φ

d_a = -s sgn(sin φ) and d_b = s sgn(cos φ) are the directions in which the axes move; at a change of quadrant itself, those
before it. A bow k is a parabola k (q/R)² of the straightness: k cos²φ sin φ, of which the part in sin φ moves the centre. A
parabola of the other axis's positioning looks alike. Bows are the first of the waves by which the path may differ from the
named terms (`volid.standards.circular.waves`); u of every term contains what waves can do to it.

Within a window behind every change of quadrant nothing is fitted: there the pulses of friction stand, the reversal spikes.
Each is the largest residual within its window, and nothing that the fit knows of.

Not modelled: reversal that depends on the position, and pulses that last longer than the window.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from volid.exceptions import InputError
from volid.standards.circular.readings import CircularReadings
from volid.standards.circular.waves import fit_waves, waves
from volid.standards.circular.zone import LeastSquaresCircle

BEFORE = 2.0  # degrees: readings are taken somewhat before the angle they are given to
_EDGE = 1e-6  # degrees: rounding
_SPARE = 4  # readings more than terms
_VAGUE = 0.02  # mm: u of what a term does to the radius; above, the readings say nothing of it
QUADRANTS = (0, 90, 180, 270)


class Term(NamedTuple):
    """One term: `value` and standard uncertainty `u`, mm but for scale (1) and squareness (rad); NaN where the readings do
    not tell."""

    value: float
    u: float


class Spike(NamedTuple):
    """A reversal spike: `sense`, at which `quadrant` [degrees], its mean height over the runs, outwards positive, and u
    [mm]."""

    sense: int
    quadrant: int
    height: float
    u: float


@dataclass(frozen=True)
class Decomposition:
    """The terms of a test by name, its spikes, and what is left.

    `named` (m,) [mm]: what the named terms explain, about the least-squares centre; `fitted` (m,): with all waves;
    `residual` (m,): the readings less that; `masked` (m,): behind changes of quadrant; `ratio`: scatter of the residual in
    u, NaN where no u is known.
    """

    terms: Mapping[str, Term]
    spikes: tuple[Spike, ...]
    named: np.ndarray
    fitted: np.ndarray
    residual: np.ndarray
    masked: np.ndarray
    ratio: float


def decompose(test: CircularReadings, circle: LeastSquaresCircle, window: float) -> Decomposition:
    """Terms of a test; `window`: degrees behind a change of quadrant that are left out of the fit."""
    columns = _columns(test, circle.direction)
    A, p = np.stack(list(columns.values()), axis=1), len(columns)
    Z, orders = waves(test.angle, test.step)
    masked = in_windows(test, -BEFORE, window)
    used = ~masked
    _check_left(test, used, p)
    found = fit_waves(A[used], Z[used], orders, circle.deviation[used], None if test.u is None else test.u[used])
    named = A @ found.value[:p] + Z[:, :2] @ found.value[p : p + 2]
    fitted = named + Z[:, 2:] @ found.value[p + 2 :]
    residual = circle.deviation - fitted
    scatter = np.full(len(test), found.scatter) if test.u is None else found.scatter * test.u
    value, u = (np.where(found.unknown, np.nan, of_all[:p]) for of_all in (found.value, found.u))
    vague = u * np.abs(A).max(axis=0) > _VAGUE
    value = np.where(vague, np.nan, value)
    terms = {name: Term(float(v), float(w)) for name, v, w in zip(columns, value, u, strict=True)}
    terms["bow ba"] = Term(4.0 * float(found.value[p + 1]), 4.0 * float(found.u[p + 1]))
    terms["bow ab"] = Term(-4.0 * float(found.value[p]), 4.0 * float(found.u[p]))
    spikes = _spikes(test, residual, scatter, window)
    ratio = np.nan if test.u is None else found.ratio
    return Decomposition(_with_centre(terms, circle), spikes, named, fitted, residual, masked, ratio)


def _check_left(test: CircularReadings, used: np.ndarray, terms: int) -> None:
    """Raises `InputError` where the windows leave fewer readings than it takes to find the terms and to judge them."""
    if int(used.sum()) < terms + _SPARE:
        raise InputError(
            f"{f'{test.source}: ' if test.source else ''}{int(used.sum())} readings stand outside the windows behind changes of "
            f"quadrant; expected at least {terms + _SPARE}: a longer arc, smaller steps, or a smaller `spike_window`"
        )


def _columns(test: CircularReadings, direction: np.ndarray) -> dict[str, np.ndarray]:
    """Every term's factor, (m,); those of the centre about the socket that was found."""
    phi, s = np.deg2rad(test.angle), test.sense
    c, d = np.cos(phi), np.sin(phi)
    before = phi - s * np.deg2rad(_EDGE)
    along_a, along_b = -s * np.sign(np.sin(before)), s * np.sign(np.cos(before))
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
    }


def in_windows(test: CircularReadings, start: float, end: float) -> np.ndarray:
    """Which readings were taken from `start` to `end` degrees behind a change of quadrant, (m,)."""
    behind = np.mod(test.sense * test.angle - start + 1e-9, 90.0)  # quadrants change every 90 degrees in either sense
    return np.asarray(behind <= end - start + 2e-9)


def _with_centre(terms: dict[str, Term], circle: LeastSquaresCircle) -> dict[str, Term]:
    """Centre terms from the programmed centre."""
    for i, name in enumerate(("centre a", "centre b")):
        terms[name] = terms[name]._replace(value=terms[name].value + float(circle.centre[i]))
    return terms


def _spikes(test: CircularReadings, residual: np.ndarray, u: np.ndarray, window: float) -> tuple[Spike, ...]:
    """The spike of every sense at every change of quadrant of which both sides were run over."""
    found = [_spike(test, residual, u, (sense, q, window)) for sense in test.senses for q in QUADRANTS]
    return tuple(spike for spike in found if spike is not None)


def _spike(test: CircularReadings, residual: np.ndarray, u: np.ndarray, place: tuple[int, int, float]) -> Spike | None:
    """The spike of one sense at one change of quadrant, mean over the runs; None where no run passes it."""
    sense, quadrant, window = place
    behind = (sense * (test.angle - quadrant) + 180.0) % 360.0 - 180.0
    near = max(5.0, 2.0 * test.step)  # degrees, on either side of the window
    rows = []
    for run in (r for r in test.runs if test.sense[r[0]] == sense):
        here = run[(behind[run] >= -_EDGE) & (behind[run] <= window + _EDGE)]
        after = (behind[run] > window + _EDGE) & (behind[run] <= window + near)
        before = (behind[run] < -_EDGE) & (behind[run] >= -near)
        if len(here) and after.any() and before.any():
            rows.append(here[np.argmax(np.abs(residual[here]))])
    if not rows:
        return None
    height = float(residual[rows].mean())
    return Spike(sense, quadrant, height, float(np.sqrt(np.mean(u[rows] ** 2) / len(rows))))
