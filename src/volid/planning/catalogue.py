"""The plans that can be asked for by name: what makes each, with its parameters in one form.

A new plan is a function of a machine in this package, one entry in `MAKERS`, and its words in the command line.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

from volid.campaign import Campaign
from volid.exceptions import InputError
from volid.model.machine import Machine
from volid.planning.ball_bar import cone_frustum
from volid.planning.ball_plate import ball_plate
from volid.planning.circles import circles
from volid.planning.diagonals import diagonals, parallel_lines, step_diagonals
from volid.planning.direct import direct_plan
from volid.planning.rtest import iso10791_path, rtest_static_grid
from volid.planning.standard import standard_plan
from volid.planning.step_gauge import step_gauge
from volid.planning.validation import validation_plan

GRID, CONE, STANDARD, CIRCLES, GAUGE = "static-grid", "cone-frustum", "standard", "circles", "step-gauge"
DIRECT, PLATE, VALIDATE = "direct", "ball-plate", "validate"
BODY_DIAGONALS, DIAGONALS, STEP_DIAGONALS, PARALLEL = "body-diagonals", "diagonals", "step-diagonals", "parallel-lines"
ISO = ("K1", "K2", "K4")
LAYOUTS = ("A", "B", "C")  # two rotary axes in the head, two in the table, one on each side

Named = Sequence[tuple[str, Sequence[float]]]


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


def _direct(machine: Machine, **given: Any) -> Campaign:
    given = one_count(given, "points", DIRECT)
    if "tool" in given:
        given["tool"] = _one(given["tool"], "tool", DIRECT)
    return direct_plan(machine, **given)


def _plate(machine: Machine, **given: Any) -> Campaign:
    if "points" in given:
        given["points"] = (given["points"][0], given["points"][-1])
    if "tool" in given:
        given["tools"] = given.pop("tool")
    return ball_plate(machine, **given)


def _validate(machine: Machine, **given: Any) -> Campaign:
    if "solution" not in given:
        raise InputError(f"the test {VALIDATE} needs the solution that is to be tested; name it with `solution`")
    given = one_count(given, "n", VALIDATE)
    if "tool" in given:
        given["tools"] = given.pop("tool")
    return validation_plan(machine, given.pop("solution"), **given)


def _one_tool(name: str, make: Callable[..., Campaign], machine: Machine, **given: Any) -> Campaign:
    """A plan of `n` points with one tool vector."""
    given = one_count(given, "n", name)
    if "tool" in given:
        given["tool"] = _one(given["tool"], "tool", name)
    return make(machine, **given)


def _tools(name: str, make: Callable[..., Campaign], machine: Machine, **given: Any) -> Campaign:
    """A plan of `n` points with any number of tool vectors."""
    given = one_count(given, "n", name)
    if "tool" in given:
        given["tools"] = given.pop("tool")
    return make(machine, **given)


def _iso(test: str, machine: Machine, **given: Any) -> Campaign:
    given = one_count(given, "n", test)
    if "tool" in given:
        given["tool"] = _one(given["tool"], "tool", test)
    if "sphere" in given:
        given["sphere"] = _one(given["sphere"], "sphere", test)[1]
    return iso10791_path(machine, test, **given)


MAKERS: Mapping[str, Callable[..., Campaign]] = {
    GRID: _static_grid,
    CONE: partial(_one_tool, CONE, cone_frustum),
    STANDARD: _standard,
    BODY_DIAGONALS: partial(_one_tool, BODY_DIAGONALS, partial(diagonals, faces=False)),
    DIAGONALS: partial(_one_tool, DIAGONALS, diagonals),
    STEP_DIAGONALS: partial(_one_tool, STEP_DIAGONALS, step_diagonals),
    PARALLEL: partial(_tools, PARALLEL, parallel_lines),
    CIRCLES: partial(_one_tool, CIRCLES, circles),
    GAUGE: partial(_tools, GAUGE, step_gauge),
    DIRECT: _direct,
    PLATE: _plate,
    VALIDATE: _validate,
    **{name: partial(_iso, name) for name in (*(layout + test for layout in LAYOUTS for test in ISO), *ISO)},
}


def find_plan(machine: Machine, name: str | None) -> str:
    """The name in its one spelling, from any case; None: the usual plan. Raises `InputError` for an unknown one."""
    if name is None:
        return STANDARD if all(axis.is_linear for axis in machine.axes) else GRID
    found = {known.casefold(): known for known in MAKERS}.get(name.casefold())
    if found is None:
        raise InputError(f"`test={name}` is unknown; expected one of {', '.join(MAKERS)}")
    return found
