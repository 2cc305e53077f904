"""What the datum demands of the coefficients, as rows of linear constraints (CONVENTIONS 4)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from volid.model.error_functions import reference_of, settings_for, spline_axes
from volid.model.geometry import across_pair
from volid.model.iso230 import parse
from volid.model.machine import Datum, Machine
from volid.model.splines import Spline, end_slope_row, harmonic_rows, mean_row, refinement, slope_row, value_row

Reach = Mapping[str, tuple[float, float]]
"""Lowest and highest position by axis letter that splines hold, where that is more than the travel."""


def make_splines(
    machine: Machine, name: str, segments: tuple[int, ...], reach: Reach | None = None
) -> tuple[Spline, ...]:
    """Splines of an error motion with the given number of intervals per axis; period 360° on full-turn rotary axes.

    `reach`: with as many intervals of the same width more as that takes, so that the travel ends at knots.
    """
    degree = settings_for(machine, name).degree or 3
    splines = []
    for letter, n in zip(spline_axes(machine, name), segments, strict=True):
        axis = machine.axis(letter)
        low, high = axis.travel
        if axis.is_full_turn:
            low, high, n = -180.0, 180.0, max(n, degree + 1)
        elif letter in (reach or {}):
            low, high, n = _widened(low, high, n, *(reach or {})[letter])
        splines.append(Spline(machine.index(letter), low, high, n, degree, axis.is_full_turn))
    return tuple(splines)


def _widened(low: float, high: float, n: int, start: float, end: float) -> tuple[float, float, int]:
    """A range of n intervals with as many more on either side as reach `start` and `end`."""
    width = (high - low) / n
    before, after = (max(0, int(np.ceil(d / width - 1e-9))) for d in (low - start, end - high))
    return low - before * width, high + after * width, n + before + after


def range_of(machine: Machine, spline: Spline) -> tuple[float, float]:
    """The range that the datum refers to: the travel of the spline's axis, or its period."""
    return (spline.low, spline.high) if spline.periodic else machine.axes[spline.axis].travel


def linear_constraints(machine: Machine, datum: Datum, name: str, splines: tuple[Spline, ...]) -> np.ndarray:
    """Datum rows of a linear axis's error motion: zero at the reference, zero-slope straightness (CONVENTIONS 4)."""
    error = parse(name)
    spline = splines[0]
    at_reference = value_row(spline, reference_of(machine, datum, error.axis))
    slope = (slope_row if datum.line == "least_squares" else end_slope_row)(spline, *range_of(machine, spline))
    across, every = _across(machine, datum, splines)
    rows = [np.kron(at_reference, row) for row in every]
    if not error.is_rotation and error.direction != error.axis:
        rows.append(np.kron(slope, across))
    return np.array(rows)


def _across(machine: Machine, datum: Datum, splines: tuple[Spline, ...]) -> tuple[np.ndarray, np.ndarray]:
    """For a cross effect: value row at the other axis's reference, and one row for every value of it; else 1, 1."""
    if len(splines) == 1:
        return np.ones(1), np.ones((1, 1))
    other = splines[1]
    return value_row(other, reference_of(machine, datum, machine.letters[other.axis])), np.eye(other.size)


def rotary_constraints(
    machine: Machine, datum: Datum, group: tuple[str, ...], splines: list[tuple[Spline, ...]]
) -> np.ndarray:
    """Datum rows of coupled error motions of a rotary axis (CONVENTIONS 4), in the group's concatenated coefficients.

    Translations and tilts: zero mean. Angular positioning: zero at the reference. Co-rotating part of the pair across the
    axis: zero, i.e. the mean of the pair times v turned with the axis vanishes for both v across it:
    v cos q + s (d × v) sin q, s = +1 on the tool side, -1 on the workpiece side.
    """
    axis = machine.axis(parse(group[0]).axis)
    along = axis.frame.T @ np.asarray(axis.unit_vector)
    across = across_pair(along)
    components = [parse(n).component % 3 for n in group]
    zero = reference_of(machine, datum, axis.letter)
    spans = [range_of(machine, f[0]) for f in splines]
    means = [mean_row(f[0], *span) for f, span in zip(splines, spans, strict=True)]
    at_zero = [value_row(f[0], zero) for f in splines] if parse(group[0]).is_rotation else means

    rows = []
    for others in _values_of_other(machine, datum, splines):
        rows.append(_row(along, components, at_zero, others))
        rows += [_row(v, components, means, others) for v in across]
    if len(group) > 1:
        lines = [_across(machine, datum, f)[0] for f in splines]
        harmonics = [harmonic_rows(f[0], *span) for f, span in zip(splines, spans, strict=True)]
        cosine, sine = [h[1] for h in harmonics], [h[2] for h in harmonics]
        sense = -1.0 if axis.primed else 1.0
        for v in across:
            turned = sense * np.cross(along, v)
            rows.append(_row(v, components, cosine, lines) + _row(turned, components, sine, lines))
    return np.array([r for r in rows if np.any(np.abs(r) > 1e-14)])


def _row(direction: np.ndarray, components: list[int], own: list[np.ndarray], others: list[np.ndarray]) -> np.ndarray:
    """Σ_k direction[k] · functional of component k, each the product of a row on its own axis and one on the other axis."""
    each = zip(components, own, others, strict=True)
    return np.concatenate([direction[k] * np.kron(row, other) for k, row, other in each])


def _values_of_other(machine: Machine, datum: Datum, splines: list[tuple[Spline, ...]]) -> list[list[np.ndarray]]:
    """For every value of the other axis of cross effects, one row per function; a function with fewer repeats its last one."""
    every = [_across(machine, datum, f)[1] for f in splines]
    return [[e[min(number, len(e) - 1)] for e in every] for number in range(max(len(e) for e in every))]


def refine_all(coarse: tuple[Spline, ...], fine: tuple[Spline, ...]) -> np.ndarray:
    """Coefficient map from chosen to carrier splines, tensor products included."""
    result = np.ones((1, 1))
    for c, f in zip(coarse, fine, strict=True):
        result = np.kron(result, refinement(c, f))
    return result
