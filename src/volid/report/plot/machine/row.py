"""The kinematic chain as a row of boxes, from workpiece to tool."""

from __future__ import annotations

from typing import Any

from volid.model.machine import Machine
from volid.report.plot.machine.layout import PRIME, tokens_of
from volid.report.plot.machine.solids import tint
from volid.report.plot.palette import BLACK, GREEN, NEUTRAL, SKY, YELLOW

STEP, WIDTH, HEIGHT = 1.0, 0.66, 0.62
SIDE = 0.52  # of one box with its surroundings [inch]


def chain_panel(panel: Any, machine: Machine) -> None:
    """Draw the structural code as boxes in its own order: axes with their letters, primed where they carry the workpiece.

    Args:
        panel: Axes of matplotlib.
        machine: The machine.
    """
    tokens = tokens_of(machine)
    bed = tokens.index("b")
    panel.set_axis_off()
    panel.set_aspect("equal")
    panel.set_xlim(-0.5, len(tokens) - 0.5)
    panel.set_ylim(-0.5, 0.5)
    panel.plot([0.0, STEP * (len(tokens) - 1)], [0.0, 0.0], color=BLACK, lw=1.2, zorder=1)
    for i, token in enumerate(tokens):
        _element(panel, STEP * i, token, i < bed)


def _element(panel: Any, x: float, token: str, carries_workpiece: bool) -> None:
    from matplotlib.patches import FancyBboxPatch

    colour = {"w": GREEN, "t": GREEN, "b": NEUTRAL}.get(token, SKY if carries_workpiece else YELLOW)
    spindle = token.startswith("(")
    style = "round,pad=0,rounding_size=0.3" if token.rstrip("'") in "ABC" else "round,pad=0,rounding_size=0.05"
    face = "white" if spindle else tint(colour, 0.2 if token in "wt" else 0.35)
    corner = (x - 0.5 * WIDTH, -0.5 * HEIGHT)
    panel.add_patch(
        FancyBboxPatch(corner, WIDTH, HEIGHT, style, fc=face, ec=BLACK, lw=0.8, ls="--" if spindle else "-", zorder=2)
    )
    words = token.replace("'", PRIME)
    panel.text(x, 0.0, words, ha="center", va="center", fontsize=10, fontweight="bold", zorder=3)
