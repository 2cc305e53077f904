"""Changes of a machine or a tool that readings of another campaign are asked about, with what one unit of each does to them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from volid.campaign import SAME_TOOL
from volid.fitting.diagnosis.alternatives.shapes import low_order
from volid.model.error_model import LOCATION, ROWS
from volid.model.iso230 import DIRECTIONS, SPINDLE, describe, parse
from volid.model.machine import Axis
from volid.validation.readings.equations import Linear

SCALE, PLACE, TOOL = "scale of an axis", "location error", "tool length"
ORDER = 4  # of the shapes that a function is asked about
BUMP, PLACES = 0.1, (0.1, 0.3, 0.5, 0.7, 0.9)  # width (standard deviation) and places of a bump, in measured ranges
TOOLS = 8  # at most


@dataclass(frozen=True, eq=False)
class Change:
    """One number that may be another than the solution says: `sort`, `name`, its `unit` ("mm", "rad", "mm/mm"), what one unit of
    it does to the readings over their u, `column` (n,), and over which length [mm] it acts, `lever`; 1 where it is a length."""

    sort: str
    name: str
    unit: str
    column: np.ndarray
    lever: float = 1.0


def simple_changes(linear: Linear) -> list[Change]:
    """Scale of every linear axis, every location error (squareness, rotary axes, spindle), length of every tool."""
    return [*sorted(_scales(linear), key=lambda c: c.name), *_locations(linear), *_tools(linear)]


def _scales(linear: Linear) -> Iterator[Change]:
    machine = linear.model.machine
    for i, axis in enumerate(machine.axes):
        if axis.is_linear and axis.length > 0.0:
            shape = linear.seen.positions[:, i] - axis.reference
            column = _of_error(linear, i, DIRECTIONS.index(axis.letter), shape)
            yield Change(SCALE, f"scale of {axis.letter}", "mm/mm", column, axis.length)


def _locations(linear: Linear) -> Iterator[Change]:
    model = linear.model
    for name, part in model.by_name:
        if part == LOCATION:
            step = np.zeros((model.n_parameters, 1))
            step[model.by_name[name, part].parameters] = 1.0
            is_rotation = parse(name).is_rotation
            lever = _lever(linear, parse(name).axis) if is_rotation else 1.0
            column = linear.of_parameters(step)[:, 0]
            yield Change(PLACE, f"{name} ({describe(name)})", "rad" if is_rotation else "mm", column, lever)


def _lever(linear: Linear, letter: str) -> float:
    """Length over which a constant rotation acts [mm]: the tool, the range of a linear axis, for a rotary axis that of any."""
    if letter == SPINDLE:
        return max(float(np.linalg.norm(s.tool, axis=1).max()) for s in linear.campaign.sets)
    machine = linear.model.machine
    axis = machine.axis(letter)
    return axis.length if axis.is_linear else max((a.length for a in machine.linear), default=0.0)


def _tools(linear: Linear) -> Iterator[Change]:
    vectors = np.concatenate([np.repeat(s.tool, s.readings.shape[1], axis=0) for s in linear.campaign.sets])
    rounded = np.round(vectors, SAME_TOOL)
    for tool in np.unique(rounded, axis=0)[:TOOLS]:
        length = float(np.linalg.norm(tool))
        if length > 0.0:
            own = linear.seen.of_each(np.all(rounded == tool, axis=1))
            column = linear.seen.summed((own * (tool / length @ linear.seen.tool))[:, None])[:, 0]
            said = ", ".join(f"{c:g}" for c in tool)
            yield Change(TOOL, f"length of tool ({said}) mm", "mm", column)


def shapes(linear: Linear) -> np.ndarray:
    """Every error function of every axis with a shape of low order, and with a constant reversal, (n, k)."""
    found = []
    for i, axis in enumerate(linear.model.machine.axes):
        q, way = linear.seen.positions[:, i], linear.seen.directions[:, i]
        forms = [*low_order(axis, q, ORDER)] if np.ptp(q) > 0.0 else []
        if np.any(way > 0.0) and np.any(way < 0.0):
            forms.append(0.5 * way)
        found += [_of_error(linear, i, c, form) for c in range(ROWS) for form in forms]
    return np.stack(found, axis=1) if found else np.zeros((len(linear.r), 0))


def bumps(linear: Linear) -> Iterator[tuple[str, np.ndarray]]:
    """For every linear axis, what a bump of 1 mm in its positioning does to the readings at several places, (n, places)."""
    axes = sorted(enumerate(linear.model.machine.axes), key=lambda pair: pair[1].letter)
    for i, axis in axes:
        if axis.is_linear and axis.length > 0.0:
            own = DIRECTIONS.index(axis.letter)
            yield (
                axis.letter,
                np.stack([_of_error(linear, i, own, _bump(axis, linear, i, p)) for p in PLACES], axis=1),
            )


def _bump(axis: Axis, linear: Linear, i: int, place: float) -> np.ndarray:
    where = axis.travel[0] + place * axis.length
    return np.asarray(np.exp(-0.5 * ((linear.seen.positions[:, i] - where) / (BUMP * axis.length)) ** 2))


def function_columns(linear: Linear, parameters: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
    """For every function of the model, what all of it does to the readings, (n,): its share of the prediction."""
    model = linear.model
    for name in model.names:
        columns = np.zeros(model.layout.n_coefficients)
        whole = model.parametrisation @ parameters
        for f in model.functions:
            if f.name == name:
                columns[f.coefficients] = whole[f.coefficients]
        steps = np.pad(columns[:, None], ((0, linear.problem.system.n_nuisance), (0, 0)))
        yield name, linear.along(steps)[:, 0]


def _of_error(linear: Linear, axis: int, component: int, shape: np.ndarray) -> np.ndarray:
    """What an error of an axis with this shape does to the readings, (n,)."""
    return linear.seen.summed((linear.seen.errors[ROWS * axis + component] * shape)[:, None])[:, 0]
