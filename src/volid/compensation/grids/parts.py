"""The errors of one side's axes alone: the model restricted to them, its exact deviations, and what its grids leave out.

Up to second order, the deviation is the sum of the deviations that the errors of each body cause alone. A part is that sum
restricted to some axes. The columns of the other axes' parameters are set to zero in the model itself, so that values,
uncertainties and the test whether the data determine them all follow from one model.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from volid.compensation.grids.sides import turning_linear_axes
from volid.fitting.datum import split_null_space
from volid.fitting.diagnosis.identifiability import parameter_units
from volid.fitting.prediction.determination import known_deviations
from volid.fitting.prediction.deviations import deviation_values, is_determined, standard_uncertainties
from volid.fitting.results import Deviations
from volid.fitting.solution import Solution
from volid.model.error_functions import motion_names
from volid.model.error_model import MEAN, ErrorModel
from volid.model.iso230 import DIRECTIONS, parse
from volid.model.machine import Machine

LEFT_OUT = "not in the model"  # a note begins with it


def part_model(model: ErrorModel, letters: frozenset[str]) -> ErrorModel:
    """The model with the errors of the axes `letters` alone: columns of the others' parameters set to zero."""
    keep = np.zeros(model.n_parameters)
    for f in model.functions:
        if parse(f.name).axis in letters:
            keep[f.parameters] = 1.0
    return model if keep.all() else replace(model, parametrisation=model.parametrisation * keep)


def evaluate_part(
    solution: Solution,
    letters: frozenset[str],
    positions: np.ndarray,
    tool: np.ndarray,
    judged: tuple[str, ...],
    *,
    uncertainty: bool = True,
) -> Deviations:
    """Deviations caused by the errors of the axes `letters` alone, others perfect; `outside` by the axes `judged` only.

    Combinations that are not determined but only move the workpiece frame, or cancel between table and head, are a matter of
    datum (`split_null_space`): they keep the value 0 from the fit and count as determined. `positions` (m, n_axes), `tool` (m, 3)
    [mm]. `uncertainty`: False leaves out u.
    """
    model = solution.model
    part = part_model(model, letters)
    theta, still = np.asarray(solution.parameters), np.zeros_like(positions)
    null, covariance = np.asarray(solution.null_space), solution.parameter_covariance if uncertainty else None
    outside, held = solution.outside(positions, judged), model.holds(positions)[:, None]
    if part is model:
        values, u, found = known_deviations(model, theta, covariance, null, positions, tool, still)
        values, u = np.where(held, values, np.nan), np.where(held, np.hypot(u, solution.scatter_u()), np.nan)
        return Deviations(values, u, found.known & held, outside, found.rigid)
    # the parts of one machine share one frame, so none is moved into its own
    values = deviation_values(part, theta, positions, tool, still)
    u = np.full_like(values, np.nan)
    if covariance is not None:
        u = np.hypot(standard_uncertainties(part, theta, covariance, positions, tool, still), solution.scatter_u(part))
    _, open_rest = split_null_space(model, null)
    known = is_determined(part, open_rest, parameter_units(model), positions, tool, still) & held
    return Deviations(np.where(known, values, np.nan), np.where(known, u, np.nan), known, outside)


def left_out(machine: Machine, letters: Iterable[str]) -> list[str]:
    """Error motions of these axes that the machine file switches off, axis by axis."""
    used = motion_names(machine)
    return [f"E{d}{a}" for a in DIRECTIONS if a in letters for d in DIRECTIONS if f"E{d}{a}" not in used]


def part_notes(solution: Solution, letters: frozenset[str]) -> list[str]:
    """What a grid of these axes' errors leaves out, in words: functions switched off, cross effects, axes that turn."""
    machine, notes = solution.machine, []
    missing = left_out(machine, letters)
    if missing:
        notes.append(f"{LEFT_OUT}: {', '.join(missing)}; their effect is not in this grid")
    notes += _cross_effects(solution, letters)
    names = _held_together(solution, letters)
    if names:
        notes.append(
            f"{', '.join(names)}: the same as a place of the workpiece or of the other side, held together at 0"
        )
    turning = [a for a in turning_linear_axes(machine) if a in letters]
    if turning:
        notes.append(f"errors of {', '.join(turning)} turn with a rotary axis; the grid holds for the rotary axes at 0")
    return notes


def _cross_effects(solution: Solution, letters: frozenset[str]) -> list[str]:
    """A sentence for every function that depends on an axis whose errors belong to another grid."""
    machine, notes = solution.machine, []
    for f in solution.model.functions:
        foreign = [a for a in (machine.letters[s.axis] for s in f.splines) if a not in letters]
        if f.part == MEAN and parse(f.name).axis in letters and foreign:
            others = (machine.axis(a) for a in foreign)
            at = ", ".join(f"{a.letter} = {a.reference if a.is_linear else 0.0:g}" for a in others)
            notes.append(f"{f.name} depends on {', '.join(foreign)} too; the grid holds it at {at}")
    return notes


def _held_together(solution: Solution, letters: frozenset[str]) -> list[str]:
    """Functions that share a direction with the place of the workpiece or of the other side."""
    shared, _ = split_null_space(solution.model, np.asarray(solution.null_space))
    least = 1e-6 * np.abs(shared).max(initial=1e-9)
    names = [f.name for f in solution.model.functions if np.any(np.abs(shared[f.parameters]) > least)]
    return [n for n in dict.fromkeys(names) if parse(n).axis in letters]
