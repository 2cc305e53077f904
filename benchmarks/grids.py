"""Grids: values with standard uncertainties against the bare values; coverage bands from streamed samples."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

import volid
from benchmarks import cases
from benchmarks.measure import REPEATS, Row, interleaved, peak_memory, row
from volid.compensation.grids.intervals import with_intervals
from volid.fitting.prediction.deviations import deviation_values

POINTS = (100, 60, 50)
TOOL = (0.0, 0.0, -150.0)


def grid_row(quick: bool) -> Row:
    """300,000 points x 6: values with u, the way `Solution.grid` makes them, against the deviations alone."""
    solution = volid.fit(cases.three_axis("S").campaign)
    positions = grid_positions(solution, tuple(p // 2 for p in POINTS) if quick else POINTS)
    tool, still = np.broadcast_to(np.array(TOOL), (len(positions), 3)), np.zeros_like(positions)
    theta = np.asarray(solution.parameters)

    def bare() -> Any:
        return deviation_values(solution.model, theta, positions, np.asarray(tool), still)

    times = interleaved({"volid": lambda: solution.evaluate(positions, np.array(TOOL)), "values alone": bare}, REPEATS)
    result = row(f"grid {len(positions):,} × 6 with u", times, "values alone")
    share = times["volid"] / times["values alone"]
    result.notes.append(f"{np.median(share):.1f} ({share.min():.1f} … {share.max():.1f}) times the bare values")
    return result


def bands_row(quick: bool) -> Row:
    """Coverage intervals of 300,000 points x 6 from 10,000 samples; memory is the question."""
    solution = volid.fit(cases.three_axis("S").campaign).monte_carlo(1_000 if quick else 10_000)
    nodes = {
        a: np.linspace(*solution.machine.axis(a).travel, n)
        for a, n in zip("XYZ", tuple(p // 2 for p in POINTS) if quick else POINTS, strict=True)
    }
    grid = volid.linear_grid(solution, tool=TOOL, nodes=nodes)
    before = peak_memory()
    began = time.perf_counter()
    found = with_intervals(solution, grid)
    spent = time.perf_counter() - began
    result = Row(f"bands of {len(found.positions):,} × 6 values from {solution.samples.trials:,} samples", spent)
    result.memory_mb = peak_memory()
    result.notes.append(f"peak before the bands {before:.0f} MB (fit and refits)")
    return result


def grid_positions(solution: Any, points: tuple[int, ...]) -> np.ndarray:
    """All nodes of a grid over the travels in the order X, Y, Z of `points`, (n, n_axes)."""
    lines = [np.linspace(*solution.machine.axis(a).travel, n) for a, n in zip("XYZ", points, strict=True)]
    mesh = np.meshgrid(*reversed(lines), indexing="ij")
    full = np.zeros((mesh[0].size, len(solution.machine.axes)))
    for letter, values in zip("ZYX", mesh, strict=True):
        full[:, solution.machine.index(letter)] = values.ravel()
    return full
