"""The machine in oblique projection, from its structural code: bodies, axes with travels, directions and lines of rotation.

It is a scheme: it shows what moves what and which way, not how large the machine is. Z, the direction of the spindle by ISO 841,
is drawn upright; which way gravity acts is not in a machine file.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from textwrap import fill
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from volid.exceptions import cut
from volid.fitting.solution import Solution
from volid.model.error_functions import reference_of
from volid.model.machine import Axis, Machine
from volid.report.language import ENGLISH, Texts
from volid.report.plot.asked import Asked
from volid.report.plot.machine.layout import BED, BELOW_ARM, GAP, Body, Layout, layout, upwards
from volid.report.plot.machine.row import chain_panel
from volid.report.plot.machine.solids import DEPTH, Look, box, circle_about, cylinder, project
from volid.report.plot.machine.words import words_of
from volid.report.plot.palette import BLACK, GREEN, NEUTRAL, SKY, YELLOW
from volid.report.plot.panels import figure_with_panels

if TYPE_CHECKING:
    from matplotlib.figure import Figure

INCH = 0.47  # of one unit of the drawing
LETTER = 0.134  # width of a letter of the texts, on average
ARROWS = 2.3  # where the arrows of the axes stand
COLUMN = (3.5, 4.1)  # of the bed
BASE = -1.35  # left end of the bed's base and arm
_BED_DEPTH = 1.5
_SMALL = 7.5  # points
_TOP = 100  # order of what lies in front of all bodies
_COLOURS = {"workpiece": GREEN, "tool": GREEN, "spindle": NEUTRAL}


def machine_figure(
    machine: Machine, tool: Sequence[float] | None = None, texts: Texts = ENGLISH, title: bool = True
) -> Figure:
    """The machine drawn from its structural code, and below it the chain as a row of boxes.

    Every body has the letter of the axis that moves it, primed where it carries the workpiece, its travel, and where its error
    motions are zero; a rotary axis also a point of its line. An arrow shows which way the axis moves its own body, seen from the
    bed, when the commanded position grows: a primed axis against the machine's coordinate (ISO 841), because positions are those
    of the tool relative to the workpiece. Sizes are not to scale.

    Args:
        machine: As `volid.load_machine` gives it.
        tool: Tool vector, shape (3,) [mm]; None: not stated.
        texts: The language.
        title: Whether the machine's name stands above.

    Source: ISO 10791-6 for the structural code, ISO 841 for primes and positive directions.

    >>> import volid
    >>> figure = machine_figure(volid.load_machine("models/wCAYXbZt_trunnion.toml"))
    >>> "C\N{PRIME}" in [text.get_text() for text in figure.axes[0].texts]
    True
    """
    scheme = scheme_of(machine, tool, texts)
    width, height = scheme.size
    figure, (upper, lower) = figure_with_panels(
        2, 1, figsize=(width, height + 0.6), height_ratios=(height, 0.55), squeeze=True
    )
    machine_panel(upper, scheme)
    chain_panel(lower, machine)
    if title:
        figure.suptitle(fill(cut(machine.name), int(11.0 * width)), fontsize=10, parse_math=False)
    return figure


class Scheme(NamedTuple):
    """What is drawn: the places of the bodies, the words beside them by token, the left end of the words, and the tool vector."""

    found: Layout
    words: dict[str, list[str]]
    left: float
    tool: Sequence[float] | None
    texts: Texts

    @property
    def limits(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Limits of the panel across and upright, in units of the drawing."""
        back = 0.5 * _BED_DEPTH * DEPTH
        return (self.left - 0.1, COLUMN[1] + back + 0.1), (-BED - back - 0.3, self.found.arm + BED + back + 0.1)

    @property
    def size(self) -> tuple[float, float]:
        """Width and height of the panel [inch]."""
        (left, right), (low, high) = self.limits
        return INCH * (right - left), INCH * (high - low)


def scheme_of(machine: Machine, tool: Sequence[float] | None = None, texts: Texts = ENGLISH) -> Scheme:
    """What `machine_panel` draws; arguments as those of `machine_figure`."""
    words = words_of(machine, tool, texts)
    longest = max(len(line) for lines in words.values() for line in lines)
    return Scheme(layout(machine), words, BASE - 0.4 - LETTER * longest, tool, texts)


def machine_panel(panel: Any, scheme: Scheme) -> None:
    """Draw the machine into one panel of matplotlib, whose size on paper is to be `scheme.size`."""
    across, upright = scheme.limits
    panel.set_axis_off()
    panel.set_aspect("equal")
    panel.set_xlim(*across)
    panel.set_ylim(*upright)
    _bed(panel, scheme.found, scheme.texts)
    for k, body in enumerate(upwards(scheme.found)):
        if body.role == "tool":
            _tool(panel, body, scheme.tool)
        else:
            _body(panel, body, 3 * k + 3)
        _words(panel, body, scheme)
        if body.axis is not None:
            _arrow(panel, body, body.axis)
    _coordinates(panel, scheme)


def _bed(panel: Any, found: Layout, texts: Texts) -> None:
    """Base, column and arm, with the ground below."""
    middle, width = 0.5 * (BASE + COLUMN[1]), COLUMN[1] - BASE
    thick = COLUMN[1] - COLUMN[0]
    box(panel, (middle, 0.0, -0.5 * BED), (width, _BED_DEPTH, BED), Look(NEUTRAL, 1))
    box(panel, (COLUMN[1] - 0.5 * thick, 0.0, 0.5 * found.arm), (thick, _BED_DEPTH, found.arm), Look(NEUTRAL, 2))
    box(panel, (middle, 0.0, found.arm + 0.5 * BED), (width, _BED_DEPTH, BED), Look(NEUTRAL, 90))
    front = 0.5 * _BED_DEPTH * DEPTH
    for x in np.linspace(BASE - front + 0.15, COLUMN[1] - front, 24):
        panel.plot([x, x - 0.15], [-BED - front, -BED - front - 0.18], color=BLACK, lw=0.6)
    at = project((middle, -0.5 * _BED_DEPTH, -0.5 * BED))
    panel.text(*at, texts("machine.bed"), ha="center", va="center", fontsize=9, zorder=_TOP)


def _body(panel: Any, body: Body, order: int) -> None:
    """One body, what joins it to the neighbour that is nearer to the bed, and its letter."""
    joint = 0.5 * body.row + (0.0 if body.carries_workpiece else BELOW_ARM)
    middle = body.height + (-0.5 if body.carries_workpiece else 0.5) * joint
    box(panel, (0.0, 0.0, middle), (0.3, 0.3, joint), Look(BLACK, order))
    centre, front = np.array([0.0, 0.0, body.height]), 0.0
    look = Look(_COLOURS.get(body.role, SKY if body.carries_workpiece else YELLOW), order + 1)
    if body.role == "rotary" and body.axis is not None:
        _rotary_body(panel, body.axis, centre, look)
    elif body.role == "spindle":
        cylinder(panel, centre, (0.0, 0.0, 1.0), (0.7, 0.3), look._replace(edge="--"))
    else:
        size = body.size if body.role == "linear" else (0.9, 0.9, 0.66)
        box(panel, centre, size, look)
        front = 0.5 * size[1]
    behind = {"boxstyle": "round,pad=0.12", "fc": "white", "ec": "none", "alpha": 0.8} if front == 0.0 else None
    style = {"fontsize": 10 if body.role != "spindle" else 8, "fontweight": "bold", "bbox": behind, "zorder": 100}
    panel.text(*project(centre - [0.0, front, 0.0]), body.label, ha="center", va="center", **style)


def _rotary_body(panel: Any, axis: Axis, centre: np.ndarray, look: Look) -> None:
    """A cylinder about the axis's line, and the line itself beyond both of its ends."""
    along = np.asarray(axis.unit_vector)
    upright = abs(along[2]) > 0.9
    length, radius = (0.66, 0.75) if upright else (1.3, 0.4)
    cylinder(panel, centre, along, (length, radius), look)
    ends = project([centre - s * (0.5 * length + 0.3) * along for s in (1.0, -1.0)])
    if not upright:  # an upright line would run through the neighbours
        panel.plot(*ends.T, color=BLACK, lw=0.9, ls="-.", zorder=look.order + 0.5)


def _tool(panel: Any, body: Body, tool: Sequence[float] | None) -> None:
    """A tool from the tool frame's origin to the functional point, along the tool vector where one is stated."""
    vector = np.array([0.0, 0.0, -1.0]) if tool is None else np.asarray(tool, dtype=float)
    origin = np.array([0.0, 0.0, body.height + 0.5 * body.row])
    ends = project([origin, origin + 0.95 * vector / (np.linalg.norm(vector) or 1.0)])
    panel.plot(*ends.T, color=BLACK, lw=3.0, solid_capstyle="butt", zorder=_TOP)
    panel.plot(*ends[1], "o", color=BLACK, ms=5, zorder=_TOP)


def _words(panel: Any, body: Body, scheme: Scheme) -> None:
    """Texts beside a body, with a line to it."""
    lines = scheme.words[body.token]
    start = scheme.left + LETTER * max(len(line) for line in lines) + 0.1
    panel.plot([start, BASE], [body.height] * 2, color=NEUTRAL, lw=0.6, ls=":", zorder=0)
    panel.text(scheme.left, body.height, "\n".join(lines), ha="left", va="center", fontsize=_SMALL, zorder=_TOP)


def _arrow(panel: Any, body: Body, axis: Axis) -> None:
    """Which way the axis moves its body when the commanded position grows, in perspective, with the axis's letter."""
    middle, along = np.array([ARROWS, 0.0, body.height]), body.motion
    if body.role == "linear":
        half = 0.36 * along / np.linalg.norm(project(along))
        start, end = project([middle - half, middle + half])
        away = (end - start) / np.linalg.norm(end - start)
        shift = np.array([0.36, -0.36 * away[1]]) if abs(away[1]) > 0.9 else np.array([0.28 * np.sign(away[0]), 0.0])
    else:
        curve = project(middle + 0.36 * circle_about(along, np.linspace(-0.25, 1.35, 60) * np.pi))
        panel.plot(*curve[:-2].T, color=BLACK, lw=1.3)
        line = project([middle - 0.5 * along, middle + 0.5 * along])
        panel.plot(*line.T, color=NEUTRAL, lw=0.8, ls="-.")
        start, end, shift = curve[-5], curve[-1], np.zeros(2)
    panel.annotate("", end, start, arrowprops=_HEAD, zorder=_TOP, gid=f"arrow-{axis.letter}")
    at = end + shift if body.role == "linear" else np.array([ARROWS + 0.68, body.height - 0.3])
    panel.text(*at, f"+{body.label}", ha="center", va="center", fontsize=8, zorder=_TOP)


_HEAD = {"arrowstyle": "-|>", "color": BLACK, "lw": 1.3, "shrinkA": 0, "shrinkB": 0, "mutation_scale": 9}


def _coordinates(panel: Any, scheme: Scheme) -> None:
    """The machine's directions, beside the gap between workpiece and tool."""
    workpiece = scheme.found.of_side(True)[0]
    origin = np.array([scheme.left + 0.35, 0.0, workpiece.height + 0.5 * workpiece.row + 0.5 * GAP - 0.3])
    for letter, unit in zip("XYZ", np.eye(3), strict=True):
        length = 0.6 if letter != "Y" else 0.8
        start, end = project([origin, origin + length * unit])
        panel.annotate("", end, start, arrowprops=_HEAD | {"color": NEUTRAL})
        panel.text(
            *(end + 0.18 * (end - start) / np.linalg.norm(end - start)), letter, ha="center", va="center", fontsize=8
        )
    words = scheme.texts("machine.coordinates")
    panel.text(origin[0] + 0.95, origin[2] + 0.35, words, ha="left", va="center", fontsize=_SMALL, color=NEUTRAL)


def of_solution(solution: Solution) -> Machine:
    """The machine as its campaign has it, with the references of the solution's datum."""
    datum, travels = solution.datum, solution.campaign.machine
    axes = (replace(a, reference=reference_of(solution.machine, datum, a.letter)) for a in travels.axes)
    return replace(travels, axes=tuple(axes))


def draw(asked: Asked) -> Figure:
    """For the collection of figures."""
    return machine_figure(of_solution(asked.solution), asked.tool, asked.texts)
