"""Sketches of constants: the angle between two linear axes, and where the line of a rotary axis or the spindle stands.

In the sketch of a squareness error the angle between the positive directions is exaggerated; which side it leans to follows from
the value (CONVENTIONS 3: direction + rotation × direction). Where the value is within its U, the axis is drawn at 90°.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from volid.fitting.solution import Solution
from volid.fitting.squareness import squareness_symbol
from volid.model.error_functions import squareness_effect
from volid.model.iso230 import LINEAR_AXES, parse
from volid.report.language import ENGLISH, Texts
from volid.report.plot.asked import Asked, NothingToDrawError
from volid.report.plot.axis_lines import LinePlace, line_panel, line_places
from volid.report.plot.constants import Constant, constants_of, with_u
from volid.report.plot.palette import BLACK, BLUE, FAINT, NEUTRAL
from volid.report.plot.panels import figure_with_places

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

EXAGGERATED = math.radians(13.0)  # how far an axis leans in the sketch, whatever the value
SIZE = (2.3, 2.6)  # of a sketch [inch]
NOTE = 0.4  # room for the note below all [inch]
_MARGINS = (0.6, 0.45, 0.12, 0.55)  # left, below, right, above a sketch's square [inch]
_SEEN_FROM = {("X", "Y"): "+Z", ("Y", "Z"): "+X", ("X", "Z"): "\N{MINUS SIGN}Y"}


class Angle(NamedTuple):
    """A squareness error as it is drawn.

    Args:
        constant: Name, value and expanded uncertainty.
        letters: The two axes, the first drawn to the right, the second upwards.
        directions: Where their positive directions point in the sketch, shape (2, 2), unit vectors.
        sign: 1 where the angle is larger than 90°, -1 smaller, 0 where |value| is within U, NaN where it is not determined.
    """

    constant: Constant
    letters: tuple[str, str]
    directions: np.ndarray
    sign: float

    @property
    def leaning(self) -> int:
        """Which of the two has the error: 0 or 1; the other one is the datum."""
        return self.letters.index(parse(self.constant.name).axis)


def squareness_figure(solution: Solution, texts: Texts = ENGLISH) -> Figure:
    """Sketches of all squareness errors, of the lines of the rotary axes and of the spindle, side by side.

    A squareness error is drawn with an exaggerated angle between the positive directions of both axes, and says which one is the
    datum. Of a rotary axis the place of its average line against the nominal line [µm] and its leaning [µm per m] are drawn to
    scale with U (k = 2), seen against its positive direction; these are ISO's values, in the machine frame.

    Args:
        solution: A solution.
        texts: The language.

    Raises:
        NothingToDrawError: for a machine that has no such constants.

    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/direct_measurement/campaign.toml"))
    >>> len(squareness_figure(solution).axes)
    3
    """
    sketches: list[Angle | LinePlace] = [*angles_of(solution), *line_places(solution)]
    if not sketches:
        raise NothingToDrawError("the model has no squareness errors and no location errors")
    columns = min(4, len(sketches))
    rows = -(-len(sketches) // columns)
    figure, panels = sketch_panels(rows, columns, NOTE)
    for panel in panels[len(sketches) :]:
        panel.remove()
    for panel, sketch in zip(panels, sketches, strict=False):
        sketch_panel(panel, sketch, texts)
    kinds = {type(sketch) for sketch in sketches}
    notes = [texts(f"constants.note_{key}") for key, kind in (("angle", Angle), ("line", LinePlace)) if kind in kinds]
    figure.supxlabel("\n".join(notes), y=0.01, va="bottom", fontsize=7.5, color=NEUTRAL)
    return figure


def sketch_panels(rows: int = 1, columns: int = 1, below: float = 0.0) -> tuple[Figure, list[Axes]]:
    """A figure with places for sketches, of `SIZE` each, and `below` inches for a note; the panels row by row."""
    left, bottom, right, top = _MARGINS
    size = (SIZE[0] - left - right, SIZE[1] - bottom - top)
    places = [
        (SIZE[0] * column + left, SIZE[1] * row + below + bottom, *size)
        for row in reversed(range(rows))
        for column in range(columns)
    ]
    return figure_with_places((SIZE[0] * columns, SIZE[1] * rows + below), places)


def sketch_panel(panel: Axes, sketch: Angle | LinePlace, texts: Texts) -> None:
    """Draw one sketch into one panel of matplotlib, whose figure has `SIZE`."""
    if isinstance(sketch, Angle):
        angle_panel(panel, sketch, texts)
    else:
        line_panel(panel, sketch, texts)


def angles_of(solution: Solution) -> list[Angle]:
    """The squareness errors of a solution, in the order of its axes."""
    return [angle(found) for found in constants_of(solution) if parse(found.name).axis in LINEAR_AXES]


def angle(found: Constant) -> Angle:
    """How a squareness error is drawn.

    >>> angle(Constant("EC0Y", 20e-6, 2e-6)).sign  # the angle between +X and +Y is larger than 90°
    1.0
    """
    own, (effect, factor) = parse(found.name).axis, squareness_effect(found.name)
    other = effect[1]
    first, second = sorted((own, other))
    lean = _lean(found) * factor  # of the axis towards the positive direction of the other one
    directions = np.eye(2)
    k = (first, second).index(own)
    size = math.sin(EXAGGERATED) * (lean if math.isfinite(lean) else 0.0)
    directions[k, 1 - k], directions[k, k] = size, math.sqrt(1.0 - size**2)
    return Angle(found, (first, second), directions, -lean)


def _lean(found: Constant) -> float:
    if not found.is_known:
        return math.nan
    return math.copysign(1.0, found.value) if abs(found.value) > found.expanded else 0.0


def angle_panel(panel: Any, found: Angle, texts: Texts) -> None:
    """The sketch of one squareness error."""
    panel.set_axis_off()
    panel.set_aspect("equal")
    panel.set_xlim(-0.42, 1.32)
    panel.set_ylim(-0.34, 1.40)
    leaning = found.leaning
    nominal = np.eye(2)[leaning]
    panel.plot(*zip((0.0, 0.0), 1.05 * nominal, strict=True), color=NEUTRAL, lw=1.0, ls="--")
    for k, letter in enumerate(found.letters):
        own = k == leaning
        colour = (BLUE if math.isfinite(found.sign) else FAINT) if own else BLACK
        style = {"arrowstyle": "-|>", "color": colour, "lw": 2.2 if own else 1.4, "shrinkA": 0, "shrinkB": 0}
        panel.annotate("", found.directions[k], (0.0, 0.0), arrowprops=style, gid=f"axis-{letter}")
        panel.text(*(1.12 * found.directions[k]), f"+{letter}", ha="center", va="center", fontsize=9)
    _arc(panel, found, texts)
    at = {"x": 0.5, "y": -0.1} if leaning == 1 else {"x": -0.09, "y": 0.5}
    panel.text(**at, s=texts("constants.datum"), ha="center", va="center", fontsize=7.5, rotation=90 * (1 - leaning))
    panel.text(
        0.45, -0.29, texts("constants.seen", side=_SEEN_FROM[found.letters]), ha="center", fontsize=7, color=NEUTRAL
    )
    symbol = f"{found.constant.name}, {squareness_symbol(found.constant.name)}"
    panel.set_title(f"{symbol}\n{with_u(found.constant, texts)}", fontsize=8, loc="center")


def _arc(panel: Any, found: Angle, texts: Texts) -> None:
    """The angle between both positive directions, and whether it is larger or smaller than 90°."""
    from matplotlib.patches import Arc

    ends = np.degrees(np.arctan2(found.directions[:, 1], found.directions[:, 0]))
    panel.add_patch(Arc((0.0, 0.0), 0.62, 0.62, theta1=ends[0], theta2=ends[1], color=BLACK, lw=0.9))
    words = {1.0: "> 90°", -1.0: "< 90°", 0.0: "90°"}.get(found.sign, texts("page.not_determined_short"))
    panel.text(0.40, 0.40, words, ha="center", va="center", fontsize=10)


def draw(asked: Asked) -> Figure:
    """For the collection of figures."""
    return squareness_figure(asked.solution, asked.texts)
