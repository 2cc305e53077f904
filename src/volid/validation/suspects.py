"""What may have changed since a solution was made, one thing at a time, with what it does to new readings.

A crash, a transport or a repair changes little, but by much: a squareness, the scale of an axis, one error motion. So each of
these is a suspect of its own, with few numbers γ:

    δθ = S γ,   readings change by J S γ.

A constant has one number, a scale one, an error motion the coefficients of Legendre polynomials of degree 1 … 4 (of a full turn:
harmonics), as far as the datum leaves them to it. Beside them stands what is no change of the machine, and might be taken for
one: a tool of another length, another scale of the instrument.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from volid.fitting.diagnosis.alternatives.readings import scales
from volid.fitting.diagnosis.alternatives.shapes import low_order
from volid.fitting.diagnosis.identifiability import parameter_units
from volid.fitting.solution import Solution
from volid.model.error_model import LOCATION, MEAN, ErrorModel
from volid.model.iso230 import describe, motion, parse
from volid.validation.causes import around_of
from volid.validation.changes import ORDER, TOOL, simple_changes
from volid.validation.function_changes import Outputs, outputs_of
from volid.validation.whitened import Whitened

DEPENDENT = 1e-6  # singular value over the largest, below which a shape is what the datum leaves of another
LEFT = 1e-3  # of a shape of its own size: less is nothing that the function itself may do


@dataclass(frozen=True, eq=False)
class Suspect:
    """Something that may have changed.

    `name`: symbol, or words for what is not the machine. `words`: what it is. `columns` (n, k): what one unit of its numbers
    does to the readings over their u. `steps` (n_parameters, k): its change of θ; None where it is not the machine. `rows` (m,
    n_parameters) at `positions` (m,): the values that it changes, for its size; `unit`: of these.
    """

    name: str
    words: str
    columns: np.ndarray
    unit: str = "mm"
    steps: np.ndarray | None = None
    rows: np.ndarray | None = None
    positions: np.ndarray | None = None


def suspects_of(solution: Solution, whitened: Whitened) -> list[Suspect]:
    """Constants, scales, error motions, tools, instruments; those that the readings cannot see are among them."""
    own = [*_constants(solution.model), *_motions(solution.model)]
    found = [_with_columns(whitened, s) for s in own]
    return [*found, *_others(whitened)]


def _with_columns(whitened: Whitened, suspect: Suspect) -> Suspect:
    assert suspect.steps is not None
    columns = whitened.linear.of_parameters(suspect.steps)
    return Suspect(suspect.name, suspect.words, columns, suspect.unit, suspect.steps, suspect.rows, suspect.positions)


def _constants(model: ErrorModel) -> Iterator[Suspect]:
    for name, part in model.by_name:
        if part != LOCATION:
            continue
        step = np.zeros((model.n_parameters, 1))
        step[model.by_name[name, part].parameters] = 1.0
        unit = "rad" if parse(name).is_rotation else "mm"
        yield Suspect(name, describe(name), np.zeros((0, 1)), unit, step, step.T, np.array([np.nan]))


def _motions(model: ErrorModel) -> Iterator[Suspect]:
    for outputs in outputs_of(model):
        function = model.by_name.get((outputs.name, MEAN))
        axis = parse(outputs.name).axis
        if function is None:
            continue
        if outputs.name == motion(axis, axis) and model.machine.axis(axis).is_linear:
            away = outputs.positions - model.machine.axis(axis).reference
            step = _steps(model, outputs, (away / model.machine.axis(axis).length)[None])
            words = f"scale of {axis}: change over its range"
            yield Suspect(f"scale of {axis}", words, np.zeros((0, 1)), "mm", step, outputs.rows, outputs.positions)
        shapes = low_order(model.machine.axis(axis), outputs.positions, ORDER)
        step = _steps(model, outputs, shapes)
        if step.shape[1]:
            words, unit = describe(outputs.name), outputs.unit
            yield Suspect(outputs.name, words, np.zeros((0, 1)), unit, step, outputs.rows, outputs.positions)


def _steps(model: ErrorModel, outputs: Outputs, shapes: np.ndarray) -> np.ndarray:
    """Changes of the function's own θ, (n_parameters, k), that come nearest to shapes (k, m), without those that depend."""
    own = model.by_name[outputs.name, MEAN].parameters
    found = np.linalg.lstsq(outputs.rows[:, own], shapes.T, rcond=1e-9)[0]
    units = parameter_units(model)[own, None]
    left, sizes, _ = np.linalg.svd(found / units, full_matrices=False)
    values = np.max(np.abs(outputs.rows[:, own] @ (units * left)), axis=0, initial=0.0)
    kept = (sizes > DEPENDENT * sizes[0]) & (values > LEFT * np.max(values, initial=0.0))
    steps = np.zeros((model.n_parameters, int(kept.sum())))
    steps[own] = (units * left)[:, kept]
    return steps


def _others(whitened: Whitened) -> Iterator[Suspect]:
    """What is no change of the machine."""
    for change in simple_changes(whitened.linear):
        if change.sort == TOOL:
            words = "the tool of the new readings, not the machine"
            yield Suspect(change.name, words, change.column[:, None])
    for alternative in scales(around_of(whitened)):
        yield Suspect(alternative.what, "the instrument of the new readings, not the machine", alternative.columns)
