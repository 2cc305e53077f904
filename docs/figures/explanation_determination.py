"""How many of 72 coefficients readings determine."""

from _design import ON_AXIS, ONE, THREE, of_diagonals, of_positions
from matplotlib.figure import Figure

from volid.report.plot.palette import BLUE, FAINT, NEUTRAL
from volid.report.plot.panels import figure_with_panels


def counts() -> dict[str, int]:
    """What is measured, and how many combinations of the 72 coefficients it determines."""
    return {
        "four body diagonals, one tool": of_diagonals(),
        "the whole volume, one tool vector": of_positions(ONE),
        "two tool vectors on the spindle axis": of_positions(ON_AXIS),
        "three tool vectors, not on one line": of_positions(THREE),
    }


def draw() -> Figure:
    """Bars of what is determined, up to 72."""
    found = counts()
    figure, panel = figure_with_panels(figsize=(7.2, 2.7))
    places = range(len(found))
    panel.barh(places, [72] * len(found), color=FAINT, height=0.6)
    panel.barh(places, list(found.values()), color=BLUE, height=0.6)
    for k, value in enumerate(found.values()):
        panel.text(value - 1.0, k, str(value), color="white", ha="right", va="center", fontweight="bold")
    panel.axvline(69.0, color=NEUTRAL, lw=1.0, ls="--")
    panel.set_yticks(places, list(found))
    panel.invert_yaxis()
    panel.set_xlim(0.0, 72.0)
    panel.set_xticks([0, 18, 36, 54, 72])
    panel.text(69.0, -0.45, "69", ha="center", va="bottom", fontsize=8, color=NEUTRAL)
    figure.supxlabel(
        "determined combinations, of 72 coefficients; the last three are the frame of the workpiece", fontsize=8
    )
    for side in ("top", "right", "left"):
        panel.spines[side].set_visible(False)
    return figure
