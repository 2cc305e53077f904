"""Figures of a solution, for reports and notebooks: error functions with bands, deviations in the volume, residuals.

Needs matplotlib (`pip install 'volid[plots]'`). Lengths in µm, rotations in µrad, positions in mm.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from volid.compensation.grids.grid import RotaryGrid
from volid.fitting.results import FunctionValue
from volid.fitting.solution import Solution
from volid.model.iso230 import DIRECTIONS, ROTARY_AXES, describe, motion, parse

if TYPE_CHECKING:
    from matplotlib.figure import Figure

K = 2.0
COLUMNS = ("#0b5fa5", "#d1495b", "#2e8b57")


def _subplots(*args: Any, **kwargs: Any) -> Any:
    import matplotlib.pyplot as plt

    return plt.subplots(*args, layout="constrained", **kwargs)


def error_functions(
    solution: Solution, truth: Mapping[str, Callable[[np.ndarray], np.ndarray]] | None = None, axes: str = "XYZ"
) -> Figure:
    """All error motions of `axes` over their positions with bands of ± U (k = 2).

    `truth` adds known functions, position [mm or degrees] -> mm or rad. `axes`: letters; those the machine lacks do not count.
    """
    shown = sorted((a for a in solution.machine.axes if a.letter in axes), key=lambda a: DIRECTIONS.index(a.letter))
    figure, panels = _subplots(len(DIRECTIONS), len(shown), figsize=(4.2 * len(shown), 11), squeeze=False, sharex="col")
    for column, axis in enumerate(shown):
        for row, direction in enumerate(DIRECTIONS):
            _function_panel(panels[row][column], solution, motion(direction, axis.letter), truth or {})
        panels[-1][column].set_xlabel(f"{axis.letter} position / {axis.unit}")
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
    rows, scale = solution.motion(name, x), 1e6 if error.is_rotation else 1e3
    for direction, colour in zip((0, 1, -1), COLUMNS, strict=True):
        in_direction = [r for r in rows if r.direction == direction]
        if in_direction:
            value, u = (scale * np.array([getattr(r, key) for r in in_direction]) for key in ("value", "u"))
            label = {0: None, 1: "approached in +", -1: "approached in -"}[direction]
            panel.fill_between(x, value - K * u, value + K * u, color=colour, alpha=0.25, lw=0)
            panel.plot(x, value, color=colour, lw=1.4, label=label)
    if not np.isfinite([r.value for r in rows]).any():
        panel.text(0.5, 0.5, "not determined", transform=panel.transAxes, ha="center", color="#d1495b", fontsize=8)
    if name in truth:
        panel.plot(x, scale * truth[name](x), color="black", lw=0.9, ls="--", label="truth")
    if panel.get_legend_handles_labels()[0]:
        panel.legend(fontsize=7, frameon=False)


def location_errors(solution: Solution, truth: Mapping[str, float] | None = None) -> Figure:
    """Location errors of the rotary axes with bars of ± U (k = 2), positions and orientations in separate panels.

    They are those of the axis average lines in the machine frame, as `Solution.location` has them.

    `truth`: true values by symbol, likewise (`volid.model.axis_lines.line_values`). With it, panels below show the identified
    value minus `truth`, at a scale that shows the bars.
    """
    rows = [solution.location(n) for n in solution.model.names if parse(n).location and parse(n).axis in ROTARY_AXES]
    figure, panels = _subplots(2 if truth else 1, 2, figsize=(10, 5.6 if truth else 3.2), squeeze=False)
    for column, rotation in zip(panels.T, (False, True), strict=True):
        shown = [r for r in rows if parse(r.name).is_rotation == rotation and np.isfinite(r.value)]
        _location_column(column, shown, truth, (1e6, "µrad") if rotation else (1e3, "µm"))
        column[0].set_title("orientations" if rotation else "positions", fontsize=9, loc="left", color="0.35")
    figure.suptitle(f"{solution.machine.name}: location errors with U (k = 2)")
    return figure


def _location_column(
    panels: Any, shown: list[FunctionValue], truth: Mapping[str, float] | None, unit: tuple[float, str]
) -> None:
    """Bars of location errors of one unit; with `truth`, below them identified minus true values."""
    x, (scale, name) = np.arange(len(shown)), unit
    value, u = (scale * np.array([getattr(r, key) for r in shown]) for key in ("value", "u"))
    panels[0].bar(x, value, yerr=K * u, color=COLUMNS[0], alpha=0.55, capsize=4, width=0.5, label="identified")
    panels[0].set_ylabel(name)
    if truth:
        true = scale * np.array([truth.get(r.name, np.nan) for r in shown])
        panels[0].plot(x, true, "_", color="black", ms=26, mew=1.6, label="truth")
        panels[0].legend(fontsize=8, frameon=False, markerscale=0.6)
        panels[1].errorbar(x, value - true, yerr=K * u, fmt="o", color=COLUMNS[0], capsize=4)
        panels[1].set_ylabel(f"identified − truth / {name}")
    for panel in panels:
        panel.axhline(0.0, color="0.6", lw=0.8)
        panel.set_xticks(x, [r.name for r in shown])
        panel.set_xlim(-0.6, len(shown) - 0.4)


def angle_map(solution: Solution, number: int = 0, held_out: bool = True) -> Figure:
    """Residuals of a set over the angles of its two rotary axes: length of the residual vector, RMS over the readings there.

    `number`: of the set. `held_out`: predicted from all other rotary positions, else within the fit.
    """
    readings = solution.campaign.sets[number]
    source = solution.readings.held_out if held_out else solution.readings.residuals
    rotary = [i for i, axis in enumerate(solution.machine.axes) if not axis.is_linear][:2]
    angles, index = np.unique(np.round(readings.positions[:, rotary], 3), axis=0, return_inverse=True)
    square = np.sum(np.asarray(source[number]) ** 2, axis=1)
    count = np.bincount(index.ravel())
    size = 1e3 * np.sqrt(np.bincount(index.ravel(), weights=square) / count)
    figure, panel = _subplots(1, 1, figsize=(9, 3.8))
    first, second = (solution.machine.axes[i] for i in rotary)
    spots = panel.scatter(*angles.T, c=size, s=90, marker="s", cmap="viridis", vmin=0.0)
    panel.set_xlabel(f"{first.letter} / °")
    panel.set_ylabel(f"{second.letter} / °")
    what = "residuals, each position predicted from the others" if held_out else "residuals of the fit"
    panel.set_title(f"set '{readings.name}': {what}", fontsize=9, loc="left")
    figure.colorbar(spots, ax=panel, label="RMS length / µm")
    return figure


def rotary_grid(grid: RotaryGrid) -> Figure:
    """The six components of a rotary spatial grid over its two axes, ERROR values, µm and µrad."""
    from matplotlib.ticker import MaxNLocator

    shape = tuple(len(n) for n in reversed(grid.nodes))
    figure, panels = _subplots(2, 3, figsize=(13, 6.2), sharex=True, sharey=True)
    for k, panel in enumerate(panels.ravel()):
        scale, what, unit = (1e6, "rotation about", "µrad") if k >= 3 else (1e3, "translation in", "µm")
        values = scale * grid.values[:, k].reshape(shape)
        largest = float(np.nanmax(np.abs(values)))
        levels = MaxNLocator(nbins=20, symmetric=True).tick_values(-largest, largest)
        colours = panel.contourf(grid.nodes[1], grid.nodes[0], values.T, levels=levels, cmap="RdBu_r")
        figure.colorbar(colours, ax=panel, ticks=MaxNLocator(nbins=8, symmetric=True))
        panel.set_title(f"{what} {'XYZ'[k % 3]} / {unit}", fontsize=9, loc="left")
    for panel in panels[-1]:
        panel.set_xlabel(f"{grid.axes[1]} / °")
    for panel in panels[:, 0]:
        panel.set_ylabel(f"{grid.axes[0]} / °")
    point = ", ".join(f"{c:g}" for c in grid.reference_point)
    figure.suptitle(f"{grid.type}, {grid.side}: error of the point ({point}) mm in the {grid.frame} frame")
    return figure


def volume_sections(solution: Solution, tool: tuple[float, float, float], scale: float | None = None) -> Figure:
    """Deviation of the functional point on three sections through the middle of the volume.

    The commanded grid is grey. The actual one is dark, with the deviations in the plane enlarged `scale` times (default: the
    largest spans most of a mesh). The colour is the 3-D length of the deviation [µm].
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
