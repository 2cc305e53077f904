"""The values of every function of a model as rows on its parameters: what is compared between solutions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from volid.backend.even_points import evenly
from volid.model.axis_lines import line_row
from volid.model.error_functions import reference_of
from volid.model.error_model import LOCATION, MEAN, REVERSAL, ErrorModel
from volid.model.iso230 import parse
from volid.model.linear_maps import function_rows
from volid.model.machine import Axis

POINTS = 41  # positions of a function: more than its splines have coefficients
BESIDE = 7  # places of the second axis of a function of two
NOWHERE = np.array([np.nan])


@dataclass(frozen=True, eq=False)
class Outputs:
    """The values of one function as rows on θ': `positions` (m,) (NaN of a constant), `directions` (m,), `rows` (m, n').

    Of a function of two axes `beside` (m,) is where the other one stands, first at its reference; NaN of all others.
    """

    name: str
    positions: np.ndarray
    directions: np.ndarray
    rows: np.ndarray
    beside: np.ndarray

    @property
    def unit(self) -> str:
        """Of the values: mm or rad."""
        return "rad" if parse(self.name).is_rotation else "mm"


def outputs_of(model: ErrorModel) -> list[Outputs]:
    """Every function of a model at `POINTS` positions of its range, both directions where it has reversal; every constant."""
    return [constant_outputs(model, n) if (n, LOCATION) in model.by_name else _motion(model, n) for n in model.names]


def constant_outputs(model: ErrorModel, name: str) -> Outputs:
    """A constant, location errors as axis average line in the machine frame."""
    return Outputs(name, NOWHERE, np.zeros(1), line_row(model, name)[None], NOWHERE)


def _motion(model: ErrorModel, name: str) -> Outputs:
    x = evenly(*model.machine.axis(parse(name).axis).travel, POINTS)
    ways = (1, -1) if (name, REVERSAL) in model.by_name else (0,)
    parts = [(way, other) for other in _others(model, name) for way in ways]
    rows = [_motion_rows(model, name, x, way, other) for way, other in parts]
    directions, beside = (np.repeat(values, len(x)) for values in zip(*parts, strict=True))
    return Outputs(name, np.tile(x, len(parts)), directions, np.vstack(rows), beside)


def second_axis(model: ErrorModel, name: str) -> Axis | None:
    """The other axis that a function depends on."""
    splines = model.by_name[name, MEAN].splines if (name, MEAN) in model.by_name else ()
    return model.machine.axes[splines[1].axis] if len(splines) > 1 else None


def _others(model: ErrorModel, name: str) -> list[float]:
    """Where the other axis stands, first at its reference; NaN where there is none."""
    axis = second_axis(model, name)
    if axis is None:
        return [np.nan]
    reference = reference_of(model.machine, model.datum, axis.letter)
    return [reference, *(v for v in evenly(*axis.travel, BESIDE).tolist() if v != reference)]


def _motion_rows(model: ErrorModel, name: str, positions: np.ndarray, direction: int, other: float) -> np.ndarray:
    q = np.tile([[reference_of(model.machine, model.datum, a.letter)] for a in model.machine.axes], len(positions))
    second = second_axis(model, name)
    if second is not None:
        q[model.machine.index(second.letter)] = other
    q[model.machine.index(parse(name).axis)] = positions
    return function_rows(model, name, q, np.full_like(q, direction))
