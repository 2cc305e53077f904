"""Cells of the working volume, some spline intervals wide on every axis: readings of one reach the same coefficients."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from volid.model.splines import Spline


def finest_segments(splines: Sequence[Spline]) -> dict[int, int]:
    """Segments of the finest spline of every axis."""
    finest: dict[int, int] = {}
    for spline in splines:
        finest[spline.axis] = max(finest.get(spline.axis, 1), spline.segments)
    return finest


def window_width(spline: Spline, share: int, finest: int, size: int) -> int:
    """Coefficients of `size` that a cell of `share` intervals of the axis's `finest` segments reaches."""
    return min(size, -(-share * spline.segments // finest) + spline.degree)


def cell_numbers(splines: Sequence[Spline], intervals: Sequence[np.ndarray], share: int) -> np.ndarray:
    """Number of the cell of every reading, (m,), with `share` intervals of every axis's finest spline together.

    `intervals` (splines, m): the interval of every reading in every spline.
    """
    finest, done = finest_segments(splines), set()
    numbers = np.zeros(len(intervals[0]), dtype=np.int64)
    for spline, own in sorted(zip(splines, intervals, strict=True), key=lambda pair: -pair[0].segments):
        if spline.axis not in done:
            done.add(spline.axis)
            numbers = numbers * (finest[spline.axis] + 1) + own // share
    return numbers


def count_cells(numbers: np.ndarray) -> int:
    """How many cells have a reading."""
    if len(numbers) and int(numbers.max()) < 4 * len(numbers):
        return int(np.count_nonzero(np.bincount(numbers)))
    return len(np.unique(numbers))
