"""Values at multiples of the least increment that a control can move."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from volid.compensation.grids.grid import AnyGrid
from volid.model.requests import ask_increments


def round_to(values: np.ndarray, least: float | None) -> np.ndarray:
    """Values at the nearest multiple of the least increment."""
    return values if least is None else np.round(values / least) * least


def rounded_grid(grid: AnyGrid, increment: float | None, angle_increment: float | None) -> AnyGrid:
    """The grid with translations at multiples of `increment` [mm], rotations of `angle_increment` [rad], and a note of the loss.

    None keeps all digits. Values are absolute, so that rounding errors do not add up. Raises `InputError` for an increment that
    is not positive.
    """
    degrees = None if angle_increment is None else float(np.rad2deg(angle_increment))
    ask_increments((("increment", True, increment), ("angle_increment", False, degrees)))
    notes, values = list(grid.notes), grid.values.copy()
    for columns, least, scale, unit in (
        (slice(0, 3), increment, 1.0, "mm"),
        (slice(3, 6), angle_increment, 180.0 / np.pi, "degrees"),
    ):
        if least is None:
            continue
        values[:, columns] = round_to(grid.values[:, columns], least)
        loss = np.nanmax(np.abs(values[:, columns] - grid.values[:, columns]), initial=0.0)
        notes.append(
            f"least increment {scale * least:.9g} {unit}; largest change by rounding {scale * loss:.6g} {unit}"
        )
    return replace(grid, values=values, notes=tuple(notes))
