"""Programs of G-code with the path that they mean, written out in closed form."""

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

OFFSETS = {"G54": (400.0, 200.0, -420.0), "G55": (600.0, 300.0, -400.0)}
LENGTHS = {1: 150.0}
TOOL = (0.0, 0.0, -150.0)
HEAD = "G21 G90 G17 G54\nG0 X0 Y0\nG43 H1 Z50\n"
FINE = 20_001


def line(*corners) -> np.ndarray:
    """A polyline in the coordinates of the program, finely."""
    corners = np.array(corners, float)
    parts = [a + np.linspace(0, 1, FINE)[:, None] * (b - a) for a, b in pairwise(corners)]
    return np.concatenate(parts)


def arc(axes: str, centre, radius: float, degrees, along=(0.0, 0.0)) -> np.ndarray:
    """About `centre` in the plane of two axes, from one angle to another, counted from the first axis to the second; the third
    axis goes evenly from one place to another."""
    k = ["XYZ".index(a) for a in axes]
    phi, points = np.deg2rad(np.linspace(*degrees, FINE)), np.zeros((FINE, 3))
    points[:, k[0]] = centre[0] + radius * np.cos(phi)
    points[:, k[1]] = centre[1] + radius * np.sin(phi)
    points[:, 3 - sum(k)] = np.linspace(*along, FINE)
    return points


@dataclass
class Case:
    """What a program does in feed: `paths` in the coordinates of its work offset, each with that offset's name."""

    body: str
    paths: list
    systems: list = field(default_factory=lambda: ["G54"])

    @property
    def text(self) -> str:
        return f"{HEAD}{self.body}\nM2\n"

    def ideal(self) -> np.ndarray:
        """Machine positions, with the tool length of G43, (m, 3) [mm]."""
        length = np.array([0.0, 0.0, LENGTHS[1]])
        pairs = zip(self.paths, self.systems * (len(self.paths) if len(self.systems) == 1 else 1), strict=True)
        return np.concatenate([p + np.array(OFFSETS[s]) + length for p, s in pairs])


CASES = {
    "lines": Case("G1 X500 Y300 Z-50 F800\nX-300", [line((0, 0, 50), (500, 300, -50), (-300, 300, -50))]),
    "quarter, clockwise": Case(
        "G0 X0 Y100 Z0\nG2 X100 Y0 I0 J-100 F500", [arc("XY", (0, 0), 100, (90, 0))]
    ),
    "full circle": Case("G0 X80 Y0 Z0\nG3 I-80 F500", [arc("XY", (0, 0), 80, (0, 360))]),
    "G18, from Z to X": Case("G0 X0 Y0 Z60\nG18 G3 X60 Z0 K-60 F500", [arc("ZX", (0, 0), 60, (0, 90))]),
    "G18, clockwise, by R": Case("G0 X60 Y0 Z0\nG18 G2 X0 Z60 R60 F500", [arc("ZX", (0, 0), 60, (90, 0))]),
    "G19 with a helix": Case(
        "G0 X-50 Y70 Z0\nG19 G2 X50 Y0 Z-70 J-70 F500", [arc("YZ", (0, 0), 70, (0, -90), (-50, 50))]
    ),
    "helix of three turns": Case(
        "G0 X90 Y0 Z0\nG3 X90 Y0 Z-45 I-90 P3 F500", [arc("XY", (0, 0), 90, (0, 1080), (0, -45))]
    ),
    "R and R negative": Case(
        "G0 X100 Y0 Z0\nG3 X0 Y100 R100 F500\nG2 X100 Y0 R-100",
        [arc("XY", (0, 0), 100, (0, 90)), arc("XY", (100, 100), 100, (180, -90))],
    ),
    "incremental": Case(
        "G0 Z0\nG91 G1 X100 F500\nY50 Z-10\nG2 X50 Y-50 I0 J-50\nG90 G1 X0",
        [
            line((0, 0, 0), (100, 0, 0), (100, 50, -10)),
            arc("XY", (100, 0), 50, (90, 0), (-10, -10)),
            line((150, 0, -10), (0, 0, -10)),
        ],
    ),
    "inches": Case(
        "G20 G0 X2 Y0 Z0\nG1 X6 F20\nG3 X6 Y4 J2\nG21 G1 X0",
        [
            line((50.8, 0, 0), (152.4, 0, 0)),
            arc("XY", (152.4, 50.8), 50.8, (-90, 90)),
            line((152.4, 101.6, 0), (0, 101.6, 0)),
        ],
    ),
    "two work offsets": Case(
        "G0 Z0\nG1 X200 F500\nG55 G0 X0 Y0 Z0\nG1 X-150 Y100",
        [line((0, 0, 0), (200, 0, 0)), line((0, 0, 0), (-150, 100, 0))],
        ["G54", "G55"],
    ),
    "absolute centres": Case("G0 X0 Y100 Z0\nG90.1 G2 X100 Y0 I0 J0 F500", [arc("XY", (0, 0), 100, (90, 0))]),
    "inverse time": Case("G0 X0 Y100 Z0\nG93 G2 X100 Y0 J-100 F2\nG1 X300 F3",
        [arc("XY", (0, 0), 100, (90, 0)), line((100, 0, 0), (300, 0, 0))]),
}  # fmt: skip
