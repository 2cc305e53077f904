"""Values at multiples of the least increment that a control can move."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from volid.compensation.grids.grid import AnyGrid
from volid.exceptions import InputError


def round_to(values: np.ndarray, least: float | None) -> np.ndarray:
    """Values at the nearest multiple of the least increment."""
    return values if least is None else np.round(values / least) * least


def rounded_grid(grid: AnyGrid, increment: float | None, angle_increment: float | None) -> AnyGrid:
    """The grid with translations at multiples of `increment` [mm], rotations of `angle_increment` [rad], and a note of the loss.

    None: all digits. Values are absolute, so that rounding does not add up. Raises `InputError` for an increment that is none.
    """
    notes, values = list(grid.notes), grid.values.copy()
    for own, least, scale, unit in (
        (slice(0, 3), increment, 1.0, "mm"),
        (slice(3, 6), angle_increment, 180.0 / np.pi, "degrees"),
    ):
        if least is None:
            continue
        if not least > 0:
            raise InputError(f"least increment {scale * least:g} {unit}; expected a number > 0")
        values[:, own] = round_to(grid.values[:, own], least)
        loss = np.nanmax(np.abs(values[:, own] - grid.values[:, own]), initial=0.0)
        notes.append(
            f"least increment {scale * least:.9g} {unit}; largest change by rounding {scale * loss:.6g} {unit}"
        )
    return replace(grid, values=values, notes=tuple(notes))
