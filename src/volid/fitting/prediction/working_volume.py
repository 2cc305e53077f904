"""Positions that stand for the working volume: wherever its largest deviation is asked for, the same ones are looked at."""

from __future__ import annotations

import numpy as np

from volid.backend.even_points import even_points
from volid.model.machine import Machine

NODES = 9  # per axis, of up to three axes
MANY = 2048  # points with more than three axes, beside the corners


def spread_positions(machine: Machine, n: int, seed: int = 0) -> np.ndarray:
    """`n` positions spread evenly over the travels (Halton), shape (n, n_axes) [mm or degrees], machine axis order."""
    return _over_travels(machine, even_points(n, len(machine.axes), seed))


def volume_positions(machine: Machine) -> np.ndarray:
    """Positions (m, n_axes) [mm or degrees] over the whole travels, corners included, machine axis order.

    A grid of 9 nodes per axis; with more than three axes, where a grid would be too large, the corners and 2048 points spread
    evenly (Halton).
    """
    n_axes = len(machine.axes)
    nodes = np.linspace(0.0, 1.0, NODES if n_axes <= 3 else 2)
    unit = np.stack([m.ravel() for m in np.meshgrid(*([nodes] * n_axes), indexing="ij")], axis=1)
    if n_axes > 3:
        unit = np.concatenate([unit, even_points(MANY, n_axes)])
    return _over_travels(machine, unit)


def _over_travels(machine: Machine, unit: np.ndarray) -> np.ndarray:
    """Positions at fractions (m, n_axes) of the travels."""
    low, length = np.array([a.travel[0] for a in machine.axes]), np.array([a.length for a in machine.axes])
    return np.asarray(low + unit * length)
