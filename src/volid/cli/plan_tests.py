"""What the tests of `volid plan` measure, and which options they take: words alone, without what makes the plans.

Help texts are made of it, so nothing here imports a numerical library.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

ISO = ("K1", "K2", "K4")
LAYOUTS = ("A", "B", "C")  # two rotary axes in the head, two in the table, one on each side


@dataclass(frozen=True)
class Description:
    """A plan by its name, in words.

    Args:
        name: What it is called.
        words: What is measured.
        parameters: The parameters that it takes, by name, and the default in words ("" where it is in `words` or chosen to fit).
    """

    name: str
    words: str
    parameters: Mapping[str, str]


ISO_WORDS = """paths of ISO 10791-6 with the sphere in the nest, there and back; K1: the second rotary
axis turns, K2: the first, K4: both; A two rotary axes in the head, B in the table, C one on
each side"""
_ISO_PARAMETERS = {"points": "73 each way", "sphere": "", "sensor_on": "tool", "tool": "", "u": "0.0005"}
_BEAM = {"tool": "0,0,-150", "u": "0.0005"}
DESCRIBED = (
    Description(
        "static-grid",
        "R-test at all pairs of positions of the rotary axes; points N1,N2 of the first rotary axis\n"
        "(workpiece to tool) and the second",
        {"points": "37,13", "sphere": "", "sensor_on": "tool", "tool": "", "u": "0.0005"},
    ),
    Description(
        "cone-frustum",
        "ball bar at a cone frustum, all axes at once",
        {
            "points": "73",
            "centre": "",
            "length": "100",
            "half_angle": "15",
            "inclination": "10",
            "calibrated_u": "0.0005",
            "tool": "0,0,-150",
            "u": "0.0005",
        },
    ),
    Description(
        "standard",
        "tracker distances from six stations for multilateration, three or more tool vectors",
        {"points": "400 per station", "tool": "three", "u": "0.0003 and 3e-7 of the distance", "seed": "0"},
    ),
    Description(
        "body-diagonals",
        "laser displacements along the four body diagonals of ISO 230-6, there and back, retro-reflector",
        {"points": "11 of a line", "runs": "1", **_BEAM},
    ),
    Description(
        "diagonals",
        "the same with two diagonals of each of three planes in the middle of the volume",
        {"points": "11 of a line", "runs": "1", **_BEAM},
    ),
    Description(
        "step-diagonals",
        "sequential step diagonals: along the body diagonals by steps of X, then Y, then Z, there and\n"
        "back, flat mirror of unknown tilt; points: steps of each axis",
        {"points": "10", "runs": "1", **_BEAM},
    ),
    Description(
        "parallel-lines",
        "laser displacements along every linear axis, on four parallel lines, there and back",
        {"points": "11 of a line", "runs": "1", **_BEAM},
    ),
    Description(
        "circles",
        "ball bar on circles and arcs in the planes of the linear axes, each in both senses",
        {
            "points": "73 a run",
            "planes": "XY,YZ,ZX",
            "arc": "220, in planes that hold the tool's axis",
            "centre": "",
            "length": "150",
            "calibrated_u": "0.0005; inf where the length is unknown",
            "tool": "0,0,-150",
            "u": "0.0005",
        },
    ),
    Description(
        "step-gauge",
        "lengths of a step gauge along seven lines, each axis and four body diagonals",
        {
            "points": "5 lengths a line",
            "length": "the longest, 0.9 of the line",
            "calibrated_u": "0.0002",
            "scale_u": "5e-7",
            "tool": "0,0,-150",
            "u": "0.0005",
        },
    ),
    Description(
        "direct",
        "direct measurement of X, Y and Z: laser, levels, straightedges, squares, the roll of the vertical axis by\n"
        "a square in two places; vertical is needed, levels see no turn about it",
        {"vertical": "", "points": "11 per travel", "form_u": "0.0005", "tool": "0,0,-150", "u": "0.0005"},
    ),
    Description(
        "ball-plate",
        "centres of a ball plate in four places, flat at two heights, upright along X and along Y;\n"
        "points N1,N2 along its sides",
        {
            "points": "5,5",
            "length": "the longer side, 0.8 of the smallest travel",
            "calibrated_u": "0.0003",
            "scale_u": "5e-7",
            "tool": "0,0,-150",
            "u": "0.0005",
        },
    ),
    Description(
        "validate",
        "another set-up that tests a solution: other stations or spheres, other tool vectors, positions\n"
        "between those of the fit; R-test, circles or distances, as the fit's readings were",
        {"solution": "", "points": "60 a station or circle", "tool": "", "u": "0.0005", "seed": "0"},
    ),
    *(
        Description(name, ISO_WORDS, _ISO_PARAMETERS)
        for name in (*(layout + test for layout in LAYOUTS for test in ISO), *ISO)
    ),
)
BY_NAME: dict[str, Description] = {described.name: described for described in DESCRIBED}


def check_options(test: str, given: Iterable[str]) -> None:
    """Raises `InputError` for a parameter that a test does not take."""
    from volid.exceptions import InputError

    for name in given:
        if name not in BY_NAME[test].parameters:
            fits = ", ".join(d.name for d in distinct() if name in d.parameters)
            raise InputError(f"`{name}` is not for the test {test}, but for {fits}; leave it out")


def distinct() -> tuple[Description, ...]:
    """The descriptions, of those that only the letters of their names tell apart the first."""
    found: dict[str, Description] = {}
    for described in DESCRIBED:
        found.setdefault(described.words, described)
    return tuple(found.values())


def plans_in_words() -> str:
    """What every plan measures and takes, for people."""
    lines = []
    for plan in distinct():
        names = "AK1 … CK4, K1, K2, K4" if plan.words is ISO_WORDS else plan.name
        told = [f"{name} {default}".strip() for name, default in plan.parameters.items()]
        takes = f"takes {', '.join(told)}"
        lines += [f"  {names}", *(f"      {line}" for line in plan.words.splitlines()), *_wrapped(takes)]
    return "\n".join(lines)


def _wrapped(text: str) -> list[str]:
    return textwrap.wrap(text, 96, initial_indent=" " * 6, subsequent_indent=" " * 8)
