"""Positions that stand for the working volume: wherever its largest deviation is asked for, the same ones are looked at.

Means and quantiles are taken over positions spread evenly, largest values over these and a grid that contains the corners, edges
and faces, and over the places that a search finds from the largest of them (`volid.fitting.prediction.largest`).
"""

from __future__ import annotations

import numpy as np

from volid.backend.even_points import even_points
from volid.model.machine import Machine

POINTS = 1024  # spread evenly, over which means and quantiles are taken
BORDER = {1: 33, 2: 17, 3: 7, 4: 4}  # nodes per axis of the grid with the ends, by number of axes
FEWEST = 3  # nodes per axis: ends and middle


def spread_positions(machine: Machine, n: int, seed: int = 0) -> np.ndarray:
    """`n` positions spread evenly over the travels (Halton), shape (n, n_axes) [mm or degrees], machine axis order."""
    return _over_travels(machine, even_points(n, len(machine.axes), seed))


def border_positions(machine: Machine) -> np.ndarray:
    """A grid (m, n_axes) [mm or degrees] over the travels that contains both ends of every axis: corners, edges and faces.

    Up to seven nodes per axis with three axes, three (243 in all) with five.
    """
    n_axes = len(machine.axes)
    nodes = np.linspace(0.0, 1.0, BORDER.get(n_axes, FEWEST))
    unit = np.stack([m.ravel() for m in np.meshgrid(*([nodes] * n_axes), indexing="ij")], axis=1)
    return _over_travels(machine, unit)


def _over_travels(machine: Machine, unit: np.ndarray) -> np.ndarray:
    """Positions at fractions (m, n_axes) of the travels."""
    low, length = np.array([a.travel[0] for a in machine.axes]), np.array([a.length for a in machine.axes])
    return np.asarray(low + unit * length)
