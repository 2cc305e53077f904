"""Where the line of a rotary axis or of the spindle stands: its place and its leaning, to scale, seen against its direction.

With u, v the two directions across the line and w along it (right-handed, u is drawn to the right and v upwards), the line is
displaced by (Eu0, Ev0), and its end towards +w leans by ω × w, that is by the rotation about v towards u, and by minus the
rotation about u towards v: of C towards X by EB0C and towards Y by -EA0C. A rotation of 1 µrad is a leaning of 1 µm per m.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from volid.fitting.solution import Solution
from volid.model.iso230 import DIRECTIONS, ROTARY_AXES, SPINDLE, TRANSLATIONS
from volid.model.machine import Axis
from volid.report.language import Texts
from volid.report.plot.constants import Constant, constants_of, with_u
from volid.report.plot.palette import BLUE, FAINT, NEUTRAL
from volid.report.plot.panels import in_language

MARGIN = 1.35
_MINUS = "\N{MINUS SIGN}"


class LinePlace(NamedTuple):
    """What one sketch of a line shows.

    Args:
        axis: Letter of the axis, S for the spindle.
        leans: True for its leaning, False for its place.
        directions: Letters of the directions drawn to the right and upwards.
        constants: The constant shown along each of them; None where the model leaves it out.
        signs: The sign with which each is shown.
    """

    axis: str
    leans: bool
    directions: tuple[str, str]
    constants: tuple[Constant | None, Constant | None]
    signs: tuple[float, float]

    @property
    def unit(self) -> str:
        """Unit of what is drawn."""
        return "µm/m" if self.leans else "µm"

    @property
    def values(self) -> np.ndarray:
        """What is drawn to the right and upwards, NaN where it is not known; shape (2,) [µm or µm/m]."""
        return np.array(
            [
                s * c.scale * c.value if c is not None and c.is_known else np.nan
                for s, c in zip(self.signs, self.constants, strict=True)
            ]
        )

    @property
    def expanded(self) -> np.ndarray:
        """Their expanded uncertainties, likewise."""
        return np.array([c.scale * c.expanded if c is not None and c.is_known else np.nan for c in self.constants])


def line_places(solution: Solution) -> Iterator[LinePlace]:
    """The sketches of all lines of a solution: place and leaning of each rotary axis, leaning of the spindle."""
    found = {c.name: c for c in constants_of(solution)}
    for axis in solution.machine.axes:
        if not axis.is_linear and stands_in_its_frame(axis):
            yield from places_of(axis.letter, ROTARY_AXES.index(axis.letter), found)
    yield from (place for place in places_of(SPINDLE, 2, found) if place.leans)


def stands_in_its_frame(axis: Axis) -> bool:
    """Whether an axis's line is along its letter's direction in the frame of its errors, so that two constants place it."""
    along = axis.frame[:, ROTARY_AXES.index(axis.letter)] @ np.asarray(axis.unit_vector)
    return bool(abs(abs(along) - 1.0) < 1e-9)


def places_of(letter: str, along: int, found: Mapping[str, Constant]) -> Iterator[LinePlace]:
    """Place and leaning of one line, where the model has any of their constants.

    Args:
        letter: Of the axis.
        along: Number of the direction along the line, 0 to 2.
        found: Constants by name.
    """
    u, v = (along + 1) % 3, (along + 2) % 3
    across = (TRANSLATIONS[u], TRANSLATIONS[v])
    for leans, components, signs in ((False, (u, v), (1.0, 1.0)), (True, (3 + v, 3 + u), (1.0, -1.0))):
        first, second = (found.get(f"E{DIRECTIONS[k]}0{letter}") for k in components)
        if first is not None or second is not None:
            yield LinePlace(letter, leans, across, (first, second), signs)


def line_panel(panel: Any, place: LinePlace, texts: Texts) -> None:
    """The sketch of one line: the nominal line in the middle, the average line where it is, with U."""
    key = "leans" if place.leans else "place"
    name = texts("constants.spindle") if place.axis == SPINDLE else texts("constants.axis", axis=place.axis)
    known = [c for c in place.constants if c is not None and c.is_known]
    stated = [f"{c.name} {with_u(c, texts)}" for c in sorted(known)]
    panel.set_title("\n".join([texts(f"constants.{key}", line=name), *stated]), fontsize=8)
    for label, direction, constant, sign in zip(
        (panel.set_xlabel, panel.set_ylabel), place.directions, place.constants, place.signs, strict=True
    ):
        symbol = "–" if constant is None else f"{_MINUS if sign < 0.0 else ''}{constant.name}"
        label(texts("constants.towards", direction=direction, symbol=symbol, unit=place.unit), fontsize=7)
    _frame(panel, place, texts)
    values, expanded = place.values, place.expanded
    if np.isfinite(values).all():
        panel.annotate("", values, (0.0, 0.0), arrowprops={"arrowstyle": "->", "color": BLUE, "lw": 1.4, "shrinkB": 0})
        panel.errorbar(*values, xerr=expanded[0], yerr=expanded[1], fmt="o", ms=4, color=BLUE, capsize=3, lw=1.0)
    else:
        panel.text(0.5, 0.72, texts("constants.unknown"), transform=panel.transAxes, ha="center", fontsize=8)
        panel.set_xticks([])
        panel.set_yticks([])


def _frame(panel: Any, place: LinePlace, texts: Texts) -> None:
    """Equal scales about the nominal line, which is a cross."""
    from matplotlib.ticker import MaxNLocator

    reach = np.nan_to_num(np.abs(place.values) + place.expanded, nan=0.0).max()
    limit = MARGIN * reach if reach > 0.0 else 1.0
    panel.set_aspect("equal")
    panel.set_xlim(-limit, limit)
    panel.set_ylim(-limit, limit)
    panel.axhline(0.0, color=FAINT, lw=0.8, zorder=0)
    panel.axvline(0.0, color=FAINT, lw=0.8, zorder=0)
    panel.plot([0.0], [0.0], "+", color=NEUTRAL, ms=9, mew=1.4)
    panel.tick_params(labelsize=7, length=2)
    for line in (panel.xaxis, panel.yaxis):
        line.set_major_locator(MaxNLocator(4, symmetric=True))
        in_language(line, texts)
