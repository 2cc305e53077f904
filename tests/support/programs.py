"""Programs of G-code with the path that they mean, written out in closed form."""

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

OFFSETS = {"G54": (400.0, 200.0, -420.0), "G55": (600.0, 300.0, -400.0)}
LENGTHS = {1: 150.0}
TOOL = (0.0, 0.0, -150.0)
HEAD = "G21 G90 G17 G54\nG0 X0 Y0\nG43 H1 Z50\n"
FINE = 6_001


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


CAM = """\
%
(BRACKET, OP 10)
N10 G21 G90 G17 G40 G49 G80 G94
N20 T1 M6
N30 S8000 M3
N40 G54 G0 X-60. Y-40.
N50 G43 H1 Z25. M8
N60 Z2.
N70 G1 Z-4. F300.
n80x60.f900.
N90 G3 X80. Y-20. I0. J20. (corner)
N100 G1 Y40.
N110 G2 X60. Y60. R20.
N120 G1 X-60. Y60. ; back
N130 X-80. Y-20.
N140 G3 X-60. Y-40. R20.
N150 G0 Z5.
N160 G4 P0.5
N170 G55 X-30. Y0.
N180 G1 Z-1. F200.
N190 G3 I30. Z-8. P3 F600.
N200 G53 G0 Z0. M9
N210 M5
N220 G91 G28 Z0.
N230 G90
N240 G54 G0 X0. Y0.
N250 G0 Z10.
N260 G20 G1 X1. Z.2 F20.
N270 G91 G19 G2 Y.5 Z.5 J.5
N280 M30
%
"""


def random_program(rng: np.random.Generator, blocks: int = 25) -> str:
    """Lines and arcs in every mode, changed at random; all positions stay within half a metre of the work offsets."""
    rows, place, unit, absolute, centres, plane = (
        ["G54 G21 G90 G17 F500", "G0 X0 Y0 Z0"],
        np.zeros(3),
        1.0,
        True,
        False,
        17,
    )
    base = np.array(OFFSETS["G54"])
    machine = base.copy()
    for _ in range(blocks):
        words = []
        if rng.random() < 0.3:
            unit = [1.0, 25.4][rng.integers(2)]
            words.append("G21" if unit == 1.0 else "G20")
        if rng.random() < 0.3:
            absolute = bool(rng.integers(2))
            words.append("G90" if absolute else "G91")
        if rng.random() < 0.2:
            centres = bool(rng.integers(2))
            words.append("G90.1" if centres else "G91.1")
        if rng.random() < 0.3:
            plane = int(rng.integers(17, 20))
            words.append(f"G{plane}")
        if rng.random() < 0.15:
            name = ["G54", "G55"][rng.integers(2)]
            base = np.array(OFFSETS[name])
            words.append(name)
        place = machine - base
        axes = {17: (0, 1, 2), 18: (2, 0, 1), 19: (1, 2, 0)}[plane]
        target = rng.uniform(-80, 80, 3)
        zero = np.zeros(3) if absolute else place
        to = np.round((target - zero) / unit, 5)
        target = zero + to * unit
        shape = rng.integers(4)
        words.append(["G0", "G1", "G2", "G3"][shape])
        words += [f"{a}{v:.5f}" for a, v in zip("XYZ", to, strict=True)]
        if shape > 1:
            words += _arc_words(rng, (place, target), axes, (unit, centres))
        machine = target + base
        rows.append(" ".join(words))
    return "\n".join([*rows, "M2", ""])


def _arc_words(rng, ends, axes, modes) -> list[str]:
    """R of either sign, or a centre anywhere on the bisector of the chord."""
    place, target = ends
    unit, centres = modes
    p, q = place[list(axes[:2])], target[list(axes[:2])]
    chord = q - p
    if rng.random() < 0.4:
        radius = np.linalg.norm(chord) * rng.uniform(0.6, 1.5) * rng.choice([-1, 1])
        return [f"R{radius / unit:.6f}"]
    middle = 0.5 * (p + q) + rng.uniform(-1, 1) * np.array([-chord[1], chord[0]])
    offset = (middle if centres else middle - p) / unit
    return [f"{'IJK'[a]}{v:.6f}" for a, v in zip(axes[:2], offset, strict=True)]
