"""The deviation field on plane sections of the working volume."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from volid.fitting.solution import Solution
from volid.report.plot.asked import Asked, NothingToDrawError
from volid.report.plot.palette import BLUE
from volid.report.plot.panels import figure_with_panels

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def volume_sections(solution: Solution, tool: tuple[float, float, float], scale: float | None = None) -> Figure:
    """Deviation of the functional point on three sections through the middle of the volume.

    The commanded grid is grey. The actual one is dark, with the deviations in the plane enlarged `scale` times (default: the
    largest spans most of a mesh). The colour is the 3-D length of the deviation [µm].
    """
    letters = [a for a in "XYZ" if a in solution.machine.letters]
    pairs = [(a, b) for i, a in enumerate(letters) for b in letters[i + 1 :]]
    fields = [_section(solution, tool, pair) for pair in pairs]
    widths = [np.ptp(a) for a, _, _ in fields]
    figure, panels = figure_with_panels(1, len(pairs), figsize=(15, 4.6), squeeze=False, width_ratios=widths)
    largest = max(float(np.nanmax(np.linalg.norm(e, axis=-1))) for _, _, e in fields)
    spacing = min(min(np.ptp(a) / (a.shape[0] - 1), np.ptp(b) / (b.shape[1] - 1)) for a, b, _ in fields)
    factor = scale or _round_down(0.9 * spacing / largest)
    for panel, pair, (a, b, e) in zip(panels[0], pairs, fields, strict=True):
        length = 1e3 * np.linalg.norm(e, axis=-1)
        colours = panel.contourf(a, b, length, levels=np.linspace(0.0, 1e3 * largest, 13), cmap="YlOrRd", alpha=0.75)
        moved = (a + factor * e[..., "XYZ".index(pair[0])], b + factor * e[..., "XYZ".index(pair[1])])
        for grid, style in (((a, b), {"color": "0.55", "lw": 0.7}), (moved, {"color": BLUE, "lw": 1.3})):
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


def draw(asked: Asked) -> Figure:
    """For the collection of figures."""
    if len([a for a in asked.solution.machine.letters if a in "XYZ"]) < 2:
        raise NothingToDrawError("the machine has fewer than two linear axes")
    return volume_sections(asked.solution, asked.tool)
