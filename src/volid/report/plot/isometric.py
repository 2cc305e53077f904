"""A parallel projection of space for drawings on paper: X to the right, Y away, Z up, the same scale for all three.

Seen are the faces of a box at the largest X, the smallest Y and the largest Z. A length along an axis is drawn
shorter than it is, by the same share everywhere along that axis.
"""

from __future__ import annotations

from itertools import combinations, product
from typing import TYPE_CHECKING, Any

import numpy as np

from volid.report.language import ENGLISH, Texts
from volid.report.plot.palette import FAINT, NEUTRAL
from volid.report.plot.panels import signs

if TYPE_CHECKING:
    from jaxtyping import Float

AZIMUTH, ELEVATION = (
    np.deg2rad(-58.0),
    np.deg2rad(24.0),
)  # from where it is seen, about Z from X, and above the XY plane
TOWARDS = np.array(
    [np.cos(ELEVATION) * np.cos(AZIMUTH), np.cos(ELEVATION) * np.sin(AZIMUTH), np.sin(ELEVATION)]
)  # the eye
RIGHT = np.array([-np.sin(AZIMUTH), np.cos(AZIMUTH), 0.0])
UP = np.cross(TOWARDS, RIGHT)
SEEN = (1, 0, 1)  # ends of X, Y, Z at which a face is seen
AWAY = 0.045  # of the drawing's size: how far names stand from their edges


def projected(places: Float[np.ndarray, "*m 3"]) -> Float[np.ndarray, "*m 2"]:
    """Places (…, 3) [mm] in the drawing, (…, 2) [mm].

    >>> projected(np.array([[0.0, 0.0, 1.0]])).round(3).tolist()
    [[0.0, 0.914]]
    """
    return np.stack([places @ RIGHT, places @ UP], axis=-1)


def draw_box(panel: Any, low: np.ndarray, high: np.ndarray, texts: Texts | None = ENGLISH) -> None:
    """Edges of a box, those behind it dashed, with X, Y, Z along three of them.

    Args:
        panel: Axes of matplotlib, made ready by `prepare`.
        low, high: Two opposite corners, shape (3,) [mm].
        texts: The language of the ranges beside the names X, Y, Z; None: names alone.
    """
    corners = np.array(list(product((0, 1), repeat=3)))
    hidden = np.array([1 - end for end in SEEN])
    for a, b in combinations(corners, 2):
        if np.abs(a - b).sum() == 1:
            ends = projected(np.where(np.array([a, b]) == 1, high, low))
            behind = (a == hidden).all() or (b == hidden).all()
            panel.plot(*ends.T, color=FAINT if behind else NEUTRAL, lw=0.6, ls=(0, (4, 3)) if behind else "-", zorder=1)
    _draw_names(panel, low, high, texts)


def _draw_names(panel: Any, low: np.ndarray, high: np.ndarray, texts: Texts | None) -> None:
    """Each axis, and its range, at the middle of a lower or outer edge that is seen."""
    size = float(np.linalg.norm(high - low))
    edges = {"X": (0, (None, 0, 0), (-0.3, -1)), "Y": (1, (1, None, 0), (0.9, -0.9)), "Z": (2, (0, 0, None), (-1, 0))}
    for name, (k, ends, outwards) in edges.items():
        if high[k] - low[k] <= 0.0:
            continue
        middle = np.array(
            [0.5 * (low[i] + high[i]) if e is None else (high if e else low)[i] for i, e in enumerate(ends)]
        )
        x, y = projected(middle) + AWAY * size * np.array(outwards)
        text = range_words(name, low[k], high[k], texts) if texts else name
        turned = {"X": "right", "Y": "left", "Z": "right"}[name]
        text = text.replace(" ", "\n", 1).replace(" … ", " …\n") if name == "Z" else text
        ground = {"facecolor": panel.get_facecolor(), "edgecolor": "none", "alpha": 0.8, "pad": 1.0}
        panel.text(x, y, text, ha=turned, va="center", fontsize=8, bbox=ground, zorder=5)


def range_words(name: str, low: float, high: float, texts: Texts = ENGLISH) -> str:
    """An axis with its range in mm.

    >>> range_words("Z", -500.0, 0.0)
    'Z −500 … 0 mm'
    """
    shown = (signs(f"{round(float(end), 1) + 0.0:.7g}", texts) for end in (low, high))
    return f"{name} {' … '.join(shown)} mm"


def prepare(panel: Any, places: Float[np.ndarray, "m 3"], margin: float = 0.12) -> None:
    """Equal scales, no frame, and room for places (m, 3) [mm] and names beside them."""
    ends = projected(places)
    low, high = ends.min(axis=0), ends.max(axis=0)
    room = margin * float(np.max(high - low))
    panel.set_aspect("equal")
    panel.set_xlim(low[0] - 1.6 * room, high[0] + 1.6 * room)
    panel.set_ylim(low[1] - room, high[1] + room)
    panel.set_axis_off()
