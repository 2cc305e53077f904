"""What a reader of any figure must not meet: texts that lie on each other, leave the paper, or cover what is drawn.

`faults(figure)` draws the figure and gives every such place in words; an empty list is a readable figure.
"""

from __future__ import annotations

from contextlib import contextmanager
from itertools import combinations

import numpy as np

TOUCH = 1.0  # pixels by which boxes may overlap: letters do not fill their boxes
SMALLEST = 6.0  # points: the smallest type that is read on paper


def faults(figure, smallest=SMALLEST):
    """What is wrong with the texts of a figure, in words.

    Args:
        figure: A figure of matplotlib.
        smallest: Smallest size of type that is allowed [points].
    """
    texts = drawn_texts(figure)
    boxes = [(text, corners(text, figure)) for text in texts]
    found = [f"'{a.get_text()}' lies on '{b.get_text()}'" for (a, p), (b, q) in combinations(boxes, 2) if overlap(p, q)]
    found += [f"'{text.get_text()}' leaves the figure" for text, box in boxes if leaves(box, figure)]
    found += [f"'{t.get_text()}' has {t.get_fontsize():g} points" for t in texts if t.get_fontsize() < smallest]
    return found + covered(figure)


def drawn_texts(figure):
    """The texts that drawing the figure really draws: not those of ticks beyond the axes' ends, nor the invisible ones."""
    with _recorded() as texts:
        figure.draw(renderer_of(figure))
    return texts


def renderer_of(figure):
    """The renderer of pixels that measures texts."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    return FigureCanvasAgg(figure).get_renderer()


@contextmanager
def _recorded():
    from matplotlib.text import Text

    texts, original = [], Text.draw

    def draw(self, renderer, *args, **kwargs):
        if self.get_visible() and self.get_text().strip():
            texts.append(self)
        return original(self, renderer, *args, **kwargs)

    Text.draw = draw
    try:
        yield texts
    finally:
        Text.draw = original


def corners(text, figure):
    """The four corners of a text as it stands, turned if it is turned, shape (4, 2) [pixels]."""
    renderer, angle = renderer_of(figure), text.get_rotation()
    turned = text.get_window_extent(renderer)
    text.set_rotation(0.0)
    flat = text.get_window_extent(renderer)
    text.set_rotation(angle)
    half = 0.5 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * (flat.width, flat.height)
    c, s = np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle))
    return half @ np.array([[c, s], [-s, c]]) + 0.5 * (turned.min + turned.max)  # turned about its own middle


def overlap(p, q):
    """Whether two rectangles, turned or not, share more than `TOUCH`: no side of either separates them."""
    for box in (p, q):
        for side in (box[1] - box[0], box[2] - box[1]):
            normal = np.array([-side[1], side[0]]) / max(float(np.hypot(*side)), 1e-9)
            a, b = p @ normal, q @ normal
            if a.max() - TOUCH <= b.min() or b.max() - TOUCH <= a.min():
                return False
    return True


def leaves(box, figure):
    """Whether a rectangle leaves the figure."""
    page = figure.bbox
    inside = (box >= (page.x0 - TOUCH, page.y0 - TOUCH)) & (box <= (page.x1 + TOUCH, page.y1 + TOUCH))
    return not inside.all()


def covered(figure):
    """Legends that lie on points of what they explain, in words."""
    found = []
    for panel in figure.axes:
        legend = panel.get_legend()
        if legend is None or not legend.get_visible():
            continue
        box = legend.get_window_extent(renderer_of(figure))
        if any(((points > box.min) & (points < box.max)).all(axis=1).any() for points in drawn_points(panel)):
            found.append(f"the legend of '{panel.get_title(loc='left') or panel.get_title()}' lies on what is drawn")
    return found


def drawn_points(panel):
    """Points of lines and scattered markers of a panel, each shape (n, 2) [pixels]."""
    for line in panel.get_lines():
        if len(line.get_xdata()) > 2:
            yield line.get_transform().transform(line.get_xydata())
    for spots in panel.collections:
        offsets = np.ma.filled(np.ma.asarray(spots.get_offsets(), dtype=float), np.nan)
        if len(offsets) > 1:
            yield spots.get_offset_transform().transform(offsets)
