"""What a compensation asks of the axes: how far it moves them, and how fast, with limits on both."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from volid.compensation.control import Control
from volid.exceptions import InputError
from volid.model.machine import Machine
from volid.model.requests import checked_number


class Motion(NamedTuple):
    """What a compensation asks of the axes. `largest`: largest |correction| of each axis, (n_axes,) [mm, °]. `slope`: largest
    change of a correction per unit of an axis's motion, (n_axes, n_axes), one row per corrected, one column per moving axis."""

    largest: np.ndarray
    slope: np.ndarray


def asked_motion(control: Control, positions: np.ndarray, tool: np.ndarray, fraction: float = 1e-3) -> Motion:
    """Largest corrections at positions (m, n_axes), and how fast they change, by steps of `fraction` of each travel."""
    machine = control.machine
    start = control.command(positions, tool) - positions
    slope = np.zeros((len(machine.axes), len(machine.axes)))
    for j, axis in enumerate(machine.axes):
        moved = positions.copy()
        inwards = np.where(positions[:, j] + fraction * axis.length > axis.travel[1], -1.0, 1.0)
        moved[:, j] += inwards * fraction * axis.length
        change = control.command(moved, tool) - moved - start
        slope[:, j] = np.abs(change).max(axis=0) / (fraction * axis.length)
    return Motion(np.abs(start).max(axis=0), slope)


def asked_speed(motion: Motion, feeds: np.ndarray) -> np.ndarray:
    """Largest speed of the corrections, (n_axes,), when axis j moves with feeds[j] [mm/min or °/min], one axis at a time."""
    return np.asarray((motion.slope * feeds).max(axis=1))


def check_motion(
    machine: Machine, motion: Motion, speed: np.ndarray, motions: Mapping[str, float], speeds: Mapping[str, float]
) -> None:
    """Raises `InputError` when an axis is asked for more than `motions` [mm, °] or `speeds` [mm/min, °/min] allow."""
    for letter, limit in (*motions.items(), *speeds.items()):
        checked_number(f"limit={letter}", limit, above=0.0)
    for name, found, limits, unit in (("moves", motion.largest, motions, ""), ("speed", speed, speeds, "/min")):
        for letter, limit in limits.items():
            i = machine.index(letter)
            if found[i] > limit:
                raise InputError(
                    f"the compensation asks axis {letter} for {name} of {found[i]:.4g} {machine.axes[i].unit}{unit}, "
                    f"more than the limit "
                    f"of {limit:g}; keep out of poles (`poles`), or allow more"
                )
