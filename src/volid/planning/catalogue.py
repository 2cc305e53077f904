"""The plans that can be asked for by name: one entry each, with the parameters that it takes.

A new plan is a function of a machine in this package, and one entry in `PLANS`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from volid.campaign import Campaign
from volid.exceptions import InputError
from volid.model.machine import Machine
from volid.planning.ball_bar import cone_frustum
from volid.planning.circles import circles
from volid.planning.direct import direct_plan
from volid.planning.rtest import iso10791_path, rtest_static_grid
from volid.planning.standard import standard_plan
from volid.planning.step_gauge import step_gauge

GRID, CONE, STANDARD, CIRCLES, GAUGE, DIRECT = (
    "static-grid",
    "cone-frustum",
    "standard",
    "circles",
    "step-gauge",
    "direct",
)
ISO = ("K1", "K2", "K4")
LAYOUTS = ("A", "B", "C")  # two rotary axes in the head, two in the table, one on each side

Named = Sequence[tuple[str, Sequence[float]]]


@dataclass(frozen=True)
class Plan:
    """A plan by name.

    Args:
        name: What it is called.
        words: What is measured, in words.
        make: Gives the plan of a machine, with the parameters that are stated.
        parameters: Those that it takes, by name, and the default in words ("" where it is in `words` or chosen to fit).
    """

    name: str
    words: str
    make: Callable[..., Campaign]
    parameters: Mapping[str, str]

    def __call__(self, machine: Machine, **given: Any) -> Campaign:
        """The plan for a machine. Raises `InputError` for a parameter that it does not take."""
        for name in given:
            if name not in self.parameters:
                fits = ", ".join(p.name for p in distinct_plans() if name in p.parameters)
                raise InputError(f"`{name}` is not for the test {self.name}, but for {fits}; leave it out")
        return self.make(machine, **given)


def _one(values: Sequence[Any], name: str, test: str) -> Any:
    """The only one of several. Raises `InputError` for more."""
    if len(values) > 1:
        raise InputError(f"`{name}` stands {len(values)} times; the test {test} takes one")
    return values[0]


def one_count(given: dict[str, Any], name: str, test: str) -> dict[str, Any]:
    """The parameters with `points` under its own name. Raises `InputError` for more than one number."""
    points = given.pop("points", None)
    if points is not None and len(points) > 1:
        shown = ",".join(map(str, points))
        raise InputError(f"`points={shown}`: the test {test} takes one number")
    return given if points is None else {**given, name: points[0]}


def _static_grid(machine: Machine, **given: Any) -> Campaign:
    named: Named | None = given.pop("sphere", None)
    spheres = dict(named) if named else None
    if spheres is not None and named is not None and len(spheres) < len(named):
        raise InputError("`sphere`: two spheres have one name; give every sphere its own")
    points = given.pop("points", (37, 13))
    return rtest_static_grid(machine, spheres, given.pop("tool", None), points[0], points[-1], **given)


def _standard(machine: Machine, **given: Any) -> Campaign:
    given = one_count(given, "n_per_station", STANDARD)
    if "tool" in given:
        given["tools"] = given.pop("tool")
    return standard_plan(machine, **given)


def _cone(machine: Machine, **given: Any) -> Campaign:
    given = one_count(given, "n", CONE)
    if "tool" in given:
        given["tool"] = _one(given["tool"], "tool", CONE)
    return cone_frustum(machine, **given)


def _direct(machine: Machine, **given: Any) -> Campaign:
    given = one_count(given, "points", DIRECT)
    if "tool" in given:
        given["tool"] = _one(given["tool"], "tool", DIRECT)
    return direct_plan(machine, **given)


def _circles(machine: Machine, **given: Any) -> Campaign:
    given = one_count(given, "n", CIRCLES)
    if "tool" in given:
        given["tool"] = _one(given["tool"], "tool", CIRCLES)
    return circles(machine, **given)


def _gauge(machine: Machine, **given: Any) -> Campaign:
    given = one_count(given, "n", GAUGE)
    if "tool" in given:
        given["tools"] = given.pop("tool")
    return step_gauge(machine, **given)


def _iso(test: str, machine: Machine, **given: Any) -> Campaign:
    given = one_count(given, "n", test)
    if "tool" in given:
        given["tool"] = _one(given["tool"], "tool", test)
    if "sphere" in given:
        given["sphere"] = _one(given["sphere"], "sphere", test)[1]
    return iso10791_path(machine, test, **given)


_ISO_WORDS = """paths of ISO 10791-6 with the sphere in the nest, there and back; K1: the second rotary
axis turns, K2: the first, K4: both; A two rotary axes in the head, B in the table, C one on
each side"""
_ISO_PARAMETERS = {"points": "73 each way", "sphere": "", "sensor_on": "tool", "tool": "", "u": "0.0005"}
_ENTRIES = (
    Plan(
        GRID,
        "R-test at all pairs of positions of the rotary axes; points N1,N2 of the first rotary axis\n"
        "(workpiece to tool) and the second",
        _static_grid,
        {"points": "37,13", "sphere": "", "sensor_on": "tool", "tool": "", "u": "0.0005"},
    ),
    Plan(
        CONE,
        "ball bar at a cone frustum, all axes at once",
        _cone,
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
    Plan(
        STANDARD,
        "tracker distances from six stations for multilateration, three or more tool vectors",
        _standard,
        {"points": "400 per station", "tool": "three", "u": "0.0003 and 3e-7 of the distance", "seed": "0"},
    ),
    Plan(
        DIRECT,
        "direct measurement of X, Y and Z: laser, levels, straightedges, squares, the roll of the vertical axis by\n"
        "a square in two places; vertical is needed, levels see no turn about it",
        _direct,
        {"vertical": "", "points": "11 per travel", "form_u": "0.0005", "tool": "0,0,-150", "u": "0.0005"},
    ),
    Plan(
        CIRCLES,
        "ball bar on circles and arcs in the planes of the linear axes, each in both senses",
        _circles,
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
    Plan(
        GAUGE,
        "lengths of a step gauge along seven lines, each axis and four body diagonals",
        _gauge,
        {
            "points": "5 lengths a line",
            "length": "the longest, 0.9 of the line",
            "calibrated_u": "0.0002",
            "scale_u": "5e-7",
            "tool": "0,0,-150",
            "u": "0.0005",
        },
    ),
    *(
        Plan(name, _ISO_WORDS, partial(_iso, name), _ISO_PARAMETERS)
        for name in (*(layout + test for layout in LAYOUTS for test in ISO), *ISO)
    ),
)
PLANS: dict[str, Plan] = {plan.name: plan for plan in _ENTRIES}


def distinct_plans() -> tuple[Plan, ...]:
    """The plans, of those that only the letters of their names tell apart the first."""
    found: dict[str, Plan] = {}
    for plan in PLANS.values():
        found.setdefault(plan.words, plan)
    return tuple(found.values())


def find_plan(machine: Machine, name: str | None) -> Plan:
    """The plan called `name` in any case; None: the usual one of the machine. Raises `InputError` for one that is unknown."""
    if name is None:
        return PLANS[STANDARD if all(axis.is_linear for axis in machine.axes) else GRID]
    found = {known.casefold(): plan for known, plan in PLANS.items()}.get(name.casefold())
    if found is None:
        raise InputError(f"`test={name}` is unknown; expected one of {', '.join(PLANS)}")
    return found


def plans_in_words() -> str:
    """What every plan measures and takes, for people."""
    lines = []
    for plan in distinct_plans():
        names = "AK1 … CK4, K1, K2, K4" if plan.words is _ISO_WORDS else plan.name
        told = [f"{name} {default}".strip() for name, default in plan.parameters.items()]
        takes = f"takes {', '.join(told)}"
        lines += [f"  {names}", *(f"      {line}" for line in plan.words.splitlines()), *_wrapped(takes)]
    return "\n".join(lines)


def _wrapped(text: str) -> list[str]:
    import textwrap

    return textwrap.wrap(text, 96, initial_indent=" " * 6, subsequent_indent=" " * 8)
