"""Values of a grid at its places, exact or linearised. Whether uncertainty is asked for does not change a value.

An exact value is the deviation of the kinematic model with the errors of the grid's axes alone. A linearised value is the sum of
the influences, at the nominal machine, of the errors that the effects of the type contain. `GridRequest.evaluation` says which
one is computed.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from volid.compensation.base import condensed, model_errors
from volid.compensation.effects import effect_errors
from volid.compensation.grids.parts import evaluate_part
from volid.compensation.grids.places import Place
from volid.compensation.grids.request import EXACT, GridRequest, Rule
from volid.compensation.types import ORIENTATION
from volid.exceptions import InputError
from volid.fitting.prediction.spread import linear_uncertainty
from volid.fitting.short_waves import carries
from volid.fitting.solution import Solution
from volid.model.error_model import MEAN
from volid.model.iso230 import SPINDLE
from volid.model.jacobian import influence
from volid.model.kinematics import ROWS

CHUNK = 256  # places at a time


class Evaluated(NamedTuple):
    """Values and u (m, 6) [mm, rad], NaN where not `determined` (m, 6); `rigid`: known up to a rigid motion of the workpiece."""

    values: np.ndarray
    u: np.ndarray
    determined: np.ndarray
    rigid: bool = False


def evaluate(solution: Solution, request: GridRequest, place: Place, zero: Place | None = None) -> Evaluated:
    """What is asked for, at the places; translations less those at the one place `zero`."""
    if request.rule is not None:
        return _from_rule(solution, request.rule, place, zero)
    if request.evaluation == EXACT:
        found = evaluate_part(
            solution, place.letters, place.full, place.tool, place.axes, uncertainty=request.uncertainty
        )
        rigid = found.rigid is not None and bool(found.rigid.any())
        return Evaluated(found.values, found.u, found.determined, rigid)
    return _linearised(solution, request, place, zero)


def _linearised(solution: Solution, request: GridRequest, place: Place, zero: Place | None) -> Evaluated:
    values = field_values(solution, request, place)
    u, known = np.full_like(values, np.nan), np.ones(values.shape, dtype=bool)
    origin: np.ndarray | float = 0.0
    if zero is not None:
        values[:, :3] -= field_values(solution, request, zero)[:, :3]
        origin = field_gradient(solution, request, zero)[:, :3]
    if solution.fully_determined and not request.uncertainty:
        return Evaluated(values, u, known)
    for start in range(0, len(values), CHUNK):
        rows = slice(start, start + CHUNK)
        gradient = field_gradient(solution, request, place.rows(rows))
        gradient[:, :3] -= origin
        flat = gradient.reshape(-1, gradient.shape[2])
        known[rows] = ~solution.is_not_determined(flat).reshape(gradient.shape[:2])
        if request.uncertainty:
            own = np.sqrt(1.0 if zero is None else 2.0) * _scatter(solution, gradient)
            u[rows] = np.hypot(linear_uncertainty(gradient, solution.parameter_covariance), own)
    return Evaluated(np.where(known, values, np.nan), np.where(known, u, np.nan), known)


def _scatter(solution: Solution, gradient: np.ndarray) -> np.ndarray:
    """What of the positions' independent part a type holds, (6,): of the functions that `gradient` (m, 6, n) depends on."""
    seen = np.any(gradient[:, :3] != 0.0, axis=(0, 1))
    u = np.zeros(6)
    for key, size in solution.scatter.items():
        own = [f for f in solution.model.functions if f.part == MEAN and carries(f.name, key)]
        if any(np.any(seen[f.parameters]) for f in own):
            k = "XYZ".index(own[0].name[1])
            u[k] = np.hypot(u[k], size)
    return solution.factor * u


def field_gradient(solution: Solution, request: GridRequest, place: Place) -> np.ndarray:
    """Deviation that the effects of the type cause, as linear map of θ, (m, 6, n)."""
    gradient = np.asarray(influence(solution.machine, place.full, place.tool) @ _errors(solution, request, place))
    if request.type.only_turns:
        gradient[:, :3] = 0.0
    return gradient


def field_values(solution: Solution, request: GridRequest, place: Place) -> np.ndarray:
    """Its values alone (m, 6) [mm, rad], linearised, without uncertainty."""
    small, base = condensed(solution, request.base)
    plain = replace(request, base=base)
    parts = [slice(s, s + 4 * CHUNK) for s in range(0, len(place.full), 4 * CHUNK)]
    return np.concatenate([field_gradient(small, plain, place.rows(rows)).sum(axis=2) for rows in parts])


def _errors(solution: Solution, request: GridRequest, place: Place) -> np.ndarray:
    """Error values of the type (m, 6·(n_axes + 1), n), of the axes that this grid holds; for FOR the entire model's."""
    q, t, base = place.full, request.type, request.base
    if t.only_turns:
        return model_errors(solution, q, np.zeros_like(q), lambda e: e.axis in place.letters, base.turn)
    effects = tuple(e for e in t.effects if e != ORIENTATION)
    errors = effect_errors(solution, effects, base, q, np.zeros_like(q))
    for i, letter in enumerate((*solution.machine.letters, SPINDLE)):
        if letter not in place.letters:
            errors[:, ROWS * i : ROWS * i + ROWS] = 0.0
    return errors


def _from_rule(solution: Solution, rule: Rule, place: Place, zero: Place | None) -> Evaluated:
    """Error values from a user's rule; no uncertainty. Raises `InputError` when it returns something else."""
    name = getattr(rule, "__name__", "rule")
    try:
        values = np.asarray(rule(solution, place.full, np.asarray(place.tool)), dtype=float)
    except Exception as error:  # whatever a user's code does wrong is input to be mended
        raise InputError(f"`rule` {name}: raised {type(error).__name__}: {error}") from error
    if values.shape != (len(place.full), 6) or not np.isfinite(values).all():
        raise InputError(
            f"`rule` {name}: returned shape {values.shape}; expected finite error values ({len(place.full)}, 6): mm, "
            f"mm, mm, rad, rad, rad"
        )
    if zero is not None:
        values = values - np.pad(_from_rule(solution, rule, zero, None).values[:, :3], ((0, 0), (0, 3)))
    return Evaluated(values, np.full_like(values, np.nan), np.ones(values.shape, dtype=bool))
