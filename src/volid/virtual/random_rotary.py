"""Smooth functions of a rotary axis brought into the datum of CONVENTIONS 4: zero mean, no co-rotating part.

A vector that is fixed in the rotor turns in the stator: v cos q + s (d × v) sin q, d the axis direction, s = +1 on the tool
side, -1 on the workpiece side. Its least-squares component over the travel (one turn of a full-turn axis) is subtracted.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from volid.model.error_functions import reference_of
from volid.model.geometry import across_pair
from volid.model.iso230 import parse
from volid.model.machine import Axis, Machine
from volid.model.splines import gauss_legendre

Function = Callable[[np.ndarray], Any]
_NODES = 400  # of Gauss-Legendre quadrature: exact to rounding for waves of a hundredth of the travel


def periodic_wave(rng: np.random.Generator, waviness: float) -> Function:
    """Harmonics 1 to 3 times `waviness` of a full turn, power falling with order, random phases; q in degrees."""
    order = np.unique(np.maximum(1, np.round(waviness * np.arange(1, 4))))
    phase = rng.uniform(0.0, 2.0 * np.pi, len(order))
    amplitude = rng.uniform(0.5, 1.0, len(order)) / np.sqrt(np.arange(1, len(order) + 1))
    return lambda q: np.sin(np.deg2rad(np.asarray(q))[..., None] * order + phase) @ amplitude


def in_datum(machine: Machine, group: tuple[str, ...], functions: Sequence[Function]) -> list[Function]:
    """The coupled error motions `group` of a rotary axis, each minus what belongs to the location errors."""
    axis = machine.axis(parse(group[0]).axis)
    components = [parse(name).component % 3 for name in group]
    fields = [f for f in _fields(axis, components) if np.any(np.abs(f(np.array([10.0, 130.0]))) > 1e-12)]
    q, weight = _quadrature(axis)
    basis = np.stack([f(q) for f in fields])  # (fields, components, nodes)
    values = np.stack([np.broadcast_to(f(q), q.shape) for f in functions])
    normal = np.einsum("n,ikn,jkn->ij", weight, basis, basis)
    share = np.linalg.lstsq(normal, np.einsum("n,ikn,kn->i", weight, basis, values), rcond=1e-12)[0]
    shift = np.zeros(len(group))
    along = (axis.frame.T @ np.asarray(axis.unit_vector))[components]
    if (
        parse(group[0]).is_rotation and along @ along > 1e-9
    ):  # angular positioning: zero at the reference, whatever its mean
        zero = np.array([reference_of(machine, machine.datum, axis.letter)])
        there = np.array([f(zero)[0] for f in functions]) - np.einsum(
            "i,ikn->k", share, np.stack([f(zero) for f in fields])
        )
        shift = along * (along @ there) / (along @ along)

    def corrected(k: int) -> Function:
        return lambda q: functions[k](q) - sum(c * f(q)[k] for c, f in zip(share, fields, strict=True)) - shift[k]

    return [corrected(k) for k in range(len(group))]


def _fields(axis: Axis, components: list[int]) -> list[Function]:
    """Constants along and across the axis, and for two or three components the co-rotating vectors; each (components, n)."""
    along = axis.frame.T @ np.asarray(axis.unit_vector)
    across = across_pair(along)
    sense = -1.0 if axis.primed else 1.0
    nothing = np.zeros(3)
    pairs = [(v, nothing, nothing) for v in (along, *across)]
    if len(components) > 1:
        pairs += [(nothing, v, sense * np.cross(along, v)) for v in across]

    def field(constant: np.ndarray, cosine: np.ndarray, sine: np.ndarray) -> Function:
        c, a, b = (v[components][:, None] for v in (constant, cosine, sine))
        return lambda q: c + a * np.cos(np.deg2rad(q)) + b * np.sin(np.deg2rad(q))

    return [field(*pair) for pair in pairs]


def _quadrature(axis: Axis) -> tuple[np.ndarray, np.ndarray]:
    """Nodes over the travel, or over one turn of a full-turn axis, and weights that sum to one."""
    low, high = (-180.0, 180.0) if axis.is_full_turn else axis.travel
    node, weight = gauss_legendre(_NODES)
    return 0.5 * (low + high) + 0.5 * (high - low) * node, 0.5 * weight
