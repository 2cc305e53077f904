"""Boxes and cylinders in oblique projection, drawn into one panel of matplotlib.

X points to the right, Z upwards and Y away from the reader, up to the right at half its length: (x, y, z) is drawn at
(x + k y, z + k y) with k = 0.5 cos 45°. The front, the top and the right side of a box are seen.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from volid.report.plot.palette import BLACK

DEPTH = 0.5 * np.cos(np.pi / 4.0)
TO_VIEWER = np.array([DEPTH, -1.0, DEPTH])  # points along it are drawn at one place
_SHADES = {"front": 0.35, "top": 0.18, "right": 0.5}  # share of the colour, the rest white
_TURN = np.linspace(0.0, 2.0 * np.pi, 61)


class Look(NamedTuple):
    """How a solid is drawn: colour of its faces, style of its edges, what lies in front of what."""

    colour: str
    order: int
    edge: str = "-"


def project(points: Any) -> np.ndarray:
    """Places in the drawing, shape (..., 2), of points (..., 3) in units of the drawing."""
    x, y, z = np.moveaxis(np.asarray(points, dtype=float), -1, 0)
    return np.stack([x + DEPTH * y, z + DEPTH * y], axis=-1)


def tint(colour: str, share: float) -> tuple[float, float, float]:
    """A colour mixed with white; `share`: 1 for the colour itself."""
    from matplotlib.colors import to_rgb

    r, g, b = (1.0 - share * (1.0 - c) for c in to_rgb(colour))
    return r, g, b


def box(panel: Any, centre: Any, size: Any, look: Look) -> None:
    """A box with edges along X, Y, Z.

    Args:
        panel: Axes of matplotlib.
        centre: Its centre, shape (3,).
        size: Lengths of its edges, shape (3,).
        look: How it is drawn.
    """
    half = 0.5 * np.asarray(size, dtype=float)
    faces = {"right": (0, 1), "top": (2, 1), "front": (1, -1)}
    for name, (normal, sign) in faces.items():
        u, v = (k for k in range(3) if k != normal)
        corners = np.zeros((4, 3))
        corners[:, normal] = sign * half[normal]
        corners[:, u] = half[u] * np.array([-1, 1, 1, -1])
        corners[:, v] = half[v] * np.array([-1, -1, 1, 1])
        _face(panel, corners + np.asarray(centre), look, _SHADES[name])


def cylinder(panel: Any, centre: Any, along: Any, size: tuple[float, float], look: Look) -> None:
    """A cylinder.

    Args:
        panel: Axes of matplotlib.
        centre: Its centre, shape (3,).
        along: Direction of its line, unit vector, shape (3,).
        size: Length and radius.
        look: How it is drawn.
    """
    from scipy.spatial import ConvexHull

    length, radius = size
    middle, axis = np.asarray(centre, dtype=float), np.asarray(along, dtype=float)
    axis = axis if axis @ TO_VIEWER > 0.0 else -axis
    circle = radius * circle_about(axis, _TURN)
    near, far = middle + 0.5 * length * axis + circle, middle - 0.5 * length * axis + circle
    outline = np.vstack([near, far])
    _face(panel, outline[ConvexHull(project(outline)).vertices], look, _SHADES["front"])
    _face(panel, near, look, _SHADES["top"])


def circle_about(axis: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Points of the unit circle about a direction, right-handed with the angles [rad], shape (m, 3)."""
    start = np.eye(3)[int(np.argmin(np.abs(axis)))]
    u = start - (start @ axis) * axis
    u /= np.linalg.norm(u)
    v = np.cross(axis, u)
    return np.cos(angles)[:, None] * u + np.sin(angles)[:, None] * v


def _face(panel: Any, corners: np.ndarray, look: Look, share: float) -> None:
    from matplotlib.patches import Polygon

    style: dict[str, Any] = {"lw": 0.7, "ls": look.edge, "joinstyle": "round", "zorder": look.order}
    panel.add_patch(Polygon(project(corners), facecolor=tint(look.colour, share), edgecolor=BLACK, **style))
