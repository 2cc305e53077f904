"""What may have changed since a solution was made, one thing at a time, with what it does to new readings.

A crash, a transport or a repair changes little, but by much: a squareness, the scale of an axis, one error motion. So each of
these is a suspect of its own, with few numbers γ:

    δθ = S γ,   readings change by J S γ.

A constant has one number, a scale one, an error motion the coefficients of Legendre polynomials (of a full turn: harmonics) up to
a low and up to a higher degree, as far as the datum leaves them to it and the readings see them. Beside them stands what is no
change of the machine, and might be taken for one: a tool of another length, another scale of the instrument.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from volid.fitting.diagnosis.alternatives.readings import scales
from volid.fitting.diagnosis.alternatives.shapes import low_order
from volid.fitting.diagnosis.identifiability import ROTATION_UNIT, UNIT
from volid.fitting.prediction.spread import linear_uncertainty
from volid.model.error_model import LOCATION, MEAN, ErrorModel
from volid.model.iso230 import describe, motion, parse
from volid.validation.readings.causes import around_of
from volid.validation.readings.changes import TOOL, simple_changes
from volid.validation.readings.whitened import Whitened
from volid.validation.solutions.function_changes import nearest_changes
from volid.validation.solutions.outputs import NOWHERE, POINTS, Outputs, constant_outputs, outputs_of

SCALE = "scale of"
RATIO = 1e-4  # of an instrument's scale: as UNIT and ROTATION_UNIT of lengths and angles
ORDERS = (3, 8)  # degrees up to which an error motion may have changed: most changes are simple, a few are not
VISIBLE = 10.0  # standard deviations that a change of 0.1 mm or 0.1 mrad must make, else the readings do not see it
LEFT = 1e-3  # of a shape: less is nothing that the function itself may do, as the datum has it


@dataclass(frozen=True, eq=False)
class Suspect:
    """Something that may have changed.

    `name`: symbol, or words for what is not the machine; an error motion has several suspects. `words`: what it is. `columns`
    (n, k): what a change by 0.1 mm or 0.1 mrad of its numbers does to the readings over their u. `steps` (n_parameters, k): its
    change of θ; None where it is not the machine. `rows` (m, n_parameters) at `positions` (m,): the values that it changes, in
    `unit`. `one`: size of one unit of the number of a tool or an instrument.
    """

    name: str
    words: str
    columns: np.ndarray
    unit: str
    steps: np.ndarray | None = None
    rows: np.ndarray | None = None
    positions: np.ndarray | None = None
    one: float = np.nan

    @property
    def is_machine(self) -> bool:
        """False for a tool or an instrument."""
        return self.steps is not None

    @property
    def is_one_number(self) -> bool:
        """Whether it is a constant or the scale of an axis."""
        return self.is_machine and (self.name.startswith(SCALE) or self.positions is NOWHERE)

    def size(self, numbers: np.ndarray, covariance: np.ndarray) -> tuple[float, float, float]:
        """Size of a change γ (k,) with `covariance` (k, k), its u, and where: of a constant itself, of a scale over its range, of
        an error motion the largest value at its position; NaN of what is not the machine and has several numbers."""
        if self.steps is None or self.rows is None or self.positions is None:
            one = self.one if len(numbers) == 1 else np.nan
            return one * float(numbers[0]), one * float(np.sqrt(covariance[0, 0])), np.nan
        rows, positions = self.rows @ self.steps, self.positions
        if self.name.startswith(SCALE):
            rows, positions = rows[[POINTS - 1]] - rows[[0]], NOWHERE
        values, u = rows @ numbers, linear_uncertainty(rows, covariance)
        worst = int(np.argmax(np.abs(values)))
        return float(values[worst]), float(u[worst]), float(positions[worst])


def suspects_of(whitened: Whitened) -> list[Suspect]:
    """Constants, scales, error motions, tools, instruments, as far as the readings see them (else without columns)."""
    model = whitened.linear.model
    found = [*_constants(model), *_motions(model), *_others(whitened)]
    return [_visible(whitened, s) for s in found]


def _visible(whitened: Whitened, suspect: Suspect) -> Suspect:
    """What of a suspect the readings see, in combinations of its numbers that are across each other."""
    columns = suspect.columns if suspect.steps is None else whitened.linear.of_parameters(suspect.steps)
    _, sizes, vt = np.linalg.svd(whitened.free(columns), full_matrices=False)
    turn = vt[sizes >= VISIBLE].T
    steps = None if suspect.steps is None else suspect.steps @ turn
    return replace(suspect, columns=columns @ turn, steps=steps)


def _of_the_machine(outputs: Outputs, words: str, steps: np.ndarray, name: str = "") -> Suspect:
    none = np.zeros((0, steps.shape[1]))
    return Suspect(name or outputs.name, words, none, outputs.unit, steps, outputs.rows, outputs.positions)


def _constants(model: ErrorModel) -> Iterator[Suspect]:
    for name, part in model.by_name:
        if part == LOCATION:
            row = np.zeros((1, model.n_parameters))
            row[0, model.by_name[name, part].parameters] = 1.0
            step = _unit(name) * row.T
            yield _of_the_machine(constant_outputs(model, name), describe(name), step)


def _motions(model: ErrorModel) -> Iterator[Suspect]:
    for outputs in outputs_of(model):
        axis = model.machine.axis(parse(outputs.name).axis) if (outputs.name, MEAN) in model.by_name else None
        if axis is None:
            continue
        if axis.is_linear and outputs.name == motion(axis.letter, axis.letter):
            away = (outputs.positions - axis.reference) / axis.length
            name = f"{SCALE} {axis.letter}"
            yield _of_the_machine(outputs, "change over its range", _steps(model, outputs, away[None]), name)
        for order in ORDERS:
            steps = _steps(model, outputs, low_order(axis, outputs.positions, order))
            if steps.shape[1]:
                yield _of_the_machine(outputs, describe(outputs.name), steps)


def _unit(name: str) -> float:
    return ROTATION_UNIT if parse(name).is_rotation else UNIT


def _steps(model: ErrorModel, outputs: Outputs, shapes: np.ndarray) -> np.ndarray:
    """Changes of the function's own θ, (n_parameters, k), of 0.1 mm or 0.1 mrad RMS each and across each other, that span what
    the datum leaves to it of shapes (k, m)."""
    own = model.by_name[outputs.name, MEAN].parameters
    rows, one = outputs.rows[:, own], _unit(outputs.name) * np.sqrt(len(outputs.rows))
    values = outputs.rows @ nearest_changes(model, outputs, shapes)
    left, sizes, _ = np.linalg.svd(values, full_matrices=False)
    kept = sizes > LEFT * np.sqrt(len(rows))
    steps = np.zeros((model.n_parameters, int(kept.sum())))
    steps[own] = np.linalg.lstsq(rows, one * left[:, kept], rcond=1e-9)[0]
    return steps


def _others(whitened: Whitened) -> Iterator[Suspect]:
    """What is no change of the machine."""
    for change in simple_changes(whitened.linear):
        if change.sort == TOOL:
            words = "the tool of the new readings, not the machine"
            yield Suspect(change.name, words, UNIT * change.column[:, None], "mm", one=UNIT)
    for alternative in scales(around_of(whitened)):
        words = "the instrument of the new readings, not the machine"
        yield Suspect(alternative.what, words, RATIO * alternative.columns, "mm/mm", one=RATIO)
