"""Figures of a solution, for reports and notebooks: error functions with bands, deviations in the volume, residuals.

Needs matplotlib (`pip install 'volid[plots]'`). Lengths in µm, rotations in µrad, positions in mm.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from volid.fitting.solution import Solution
from volid.iso230 import DIRECTIONS, describe, motion, parse

if TYPE_CHECKING:
    from matplotlib.figure import Figure

K = 2.0
COLUMNS = ("#0b5fa5", "#d1495b", "#2e8b57")


def _subplots(*args: Any, **kwargs: Any) -> Any:
    import matplotlib.pyplot as plt

    return plt.subplots(*args, layout="constrained", **kwargs)


def error_functions(
    solution: Solution, truth: Mapping[str, Callable[[np.ndarray], np.ndarray]] | None = None
) -> Figure:
    """All error motions over their axes with bands of ± U (k = 2); `truth` adds known functions, position -> mm or rad."""
    axes = [a for a in solution.machine.axes if a.is_linear]
    figure, panels = _subplots(len(DIRECTIONS), len(axes), figsize=(4.2 * len(axes), 11), squeeze=False, sharex="col")
    for column, axis in enumerate(sorted(axes, key=lambda a: a.letter)):
        for row, direction in enumerate(DIRECTIONS):
            _function_panel(panels[row][column], solution, motion(direction, axis.letter), truth or {})
        panels[-1][column].set_xlabel(f"{axis.letter} position / mm")
    figure.suptitle(f"{solution.machine.name}: error motions with U (k = 2)")
    return figure


def _function_panel(panel: Any, solution: Solution, name: str, truth: Mapping[str, Any]) -> None:
    panel.axhline(0.0, color="0.8", lw=0.8)
    error = parse(name)
    panel.set_ylabel(f"{name} / {error.report_unit}")
    panel.set_title(describe(name), fontsize=8, loc="left", color="0.35")
    if (name, "mean") not in solution.model.by_name:
        panel.text(0.5, 0.5, "not in the model", transform=panel.transAxes, ha="center", color="0.5", fontsize=8)
        return
    x = np.linspace(*solution.machine.axis(error.axis).travel, 201)
    rows = solution.motion(name, x)
    for direction, colour in zip((0, 1, -1), COLUMNS, strict=True):
        chosen = [r for r in rows if r.direction == direction]
        if chosen:
            value = 1e3 * np.array([r.value for r in chosen]) * (1e3 if error.is_rotation else 1.0)
            u = 1e3 * np.array([r.u for r in chosen]) * (1e3 if error.is_rotation else 1.0)
            label = {0: None, 1: "approached in +", -1: "approached in -"}[direction]
            panel.fill_between(x, value - K * u, value + K * u, color=colour, alpha=0.25, lw=0)
            panel.plot(x, value, color=colour, lw=1.4, label=label)
    if not np.isfinite([r.value for r in rows]).any():
        panel.text(0.5, 0.5, "not determined", transform=panel.transAxes, ha="center", color="#d1495b", fontsize=8)
    if name in truth:
        scale = 1e6 if error.is_rotation else 1e3
        panel.plot(x, scale * truth[name](x), color="black", lw=0.9, ls="--", label="truth")
    if panel.get_legend_handles_labels()[0]:
        panel.legend(fontsize=7, frameon=False)


def volume_sections(solution: Solution, tool: tuple[float, float, float], scale: float | None = None) -> Figure:
    """Deviation of the functional point on three sections through the middle of the volume.

    Grey the commanded grid, dark the actual one with deviations in the plane enlarged `scale` times (default: the largest
    spans most of a mesh), colour the 3-D length of the deviation [µm].
    """
    letters = [a for a in "XYZ" if a in solution.machine.letters]
    pairs = [(a, b) for i, a in enumerate(letters) for b in letters[i + 1 :]]
    fields = [_section(solution, tool, pair) for pair in pairs]
    widths = [np.ptp(a) for a, _, _ in fields]
    figure, panels = _subplots(1, len(pairs), figsize=(15, 4.6), squeeze=False, width_ratios=widths)
    largest = max(float(np.nanmax(np.linalg.norm(e, axis=-1))) for _, _, e in fields)
    spacing = min(min(np.ptp(a) / (a.shape[0] - 1), np.ptp(b) / (b.shape[1] - 1)) for a, b, _ in fields)
    factor = scale or _round_down(0.9 * spacing / largest)
    for panel, pair, (a, b, e) in zip(panels[0], pairs, fields, strict=True):
        length = 1e3 * np.linalg.norm(e, axis=-1)
        colours = panel.contourf(a, b, length, levels=np.linspace(0.0, 1e3 * largest, 13), cmap="YlOrRd", alpha=0.75)
        moved = (a + factor * e[..., "XYZ".index(pair[0])], b + factor * e[..., "XYZ".index(pair[1])])
        for grid, style in (((a, b), {"color": "0.55", "lw": 0.7}), (moved, {"color": "#12355b", "lw": 1.3})):
            panel.plot(*grid, **style)
            panel.plot(grid[0].T, grid[1].T, **style)
        panel.set_xlabel(f"{pair[0]} / mm")
        panel.set_ylabel(f"{pair[1]} / mm")
        panel.set_aspect("equal")
        middle = next(m for m in letters if m not in pair) if len(letters) > 2 else ""
        panel.set_title(f"{middle} at mid-travel" if middle else "", fontsize=9, loc="left", color="0.35")
    figure.colorbar(colours, ax=panels[0], label="3-D deviation / µm", format="%.0f", shrink=0.85)
    figure.suptitle(f"{solution.machine.name}: deviations in the plane × {factor:,.0f}")
    return figure


def _round_down(x: float) -> float:
    """Largest of 1, 2, 5 times a power of ten that does not exceed x."""
    power = 10.0 ** np.floor(np.log10(x))
    return float(power * max(f for f in (1.0, 2.0, 5.0) if f <= x / power + 1e-9))


def _section(solution: Solution, tool: tuple[float, float, float], pair: tuple[str, str]) -> Any:
    machine = solution.machine
    middle: dict[str, Any] = {axis.letter: 0.5 * sum(axis.travel) for axis in machine.axes}
    a, b = np.meshgrid(*(np.linspace(*machine.axis(p).travel, 9) for p in pair), indexing="ij")
    positions = machine.order(**{**middle, pair[0]: a, pair[1]: b})
    values = solution.evaluate(positions.reshape(-1, len(machine.axes)), np.asarray(tool)).values
    return a, b, values[:, :3].reshape(*a.shape, 3)


def residual_plot(solution: Solution) -> Figure:
    """Normalised residuals in the order of the readings, and their distribution against the standard normal."""
    figure, (left, right) = _subplots(1, 2, figsize=(11, 3.6), width_ratios=(3, 1), sharey=True)
    start = 0
    for k, s in enumerate(solution.campaign.sets):
        values, out = solution.readings.normalised[k], solution.readings.outliers[k]
        number = start + np.arange(values.size)
        left.plot(number, values.ravel(), ".", ms=3, color=COLUMNS[k % 3], label=s.name)
        if out.any():
            left.plot(number[out.ravel()], values.ravel()[out.ravel()], "x", color="black", label="outlier, set aside")
        start += values.size
    kept = np.concatenate(
        [n[~o] for n, o in zip(solution.readings.normalised, solution.readings.outliers, strict=True)]
    )
    right.hist(kept, bins=41, orientation="horizontal", density=True, color=COLUMNS[0], alpha=0.4)
    z = np.linspace(-4.0, 4.0, 201)
    right.plot(np.exp(-0.5 * z**2) / np.sqrt(2.0 * np.pi), z, color="black", lw=1.0)
    left.set_ylim(-6.0, 6.0)
    left.set_xlabel("reading")
    left.set_ylabel("residual / u")
    right.set_xlabel("density")
    left.legend(fontsize=8, frameon=False, loc="upper right")
    left.set_title(solution.adequacy.verdict, fontsize=9, loc="left")
    return figure
