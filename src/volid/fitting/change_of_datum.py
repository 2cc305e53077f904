"""A solution in another datum, by an S-transformation of all its unknowns (CONVENTIONS 4)."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from volid.exceptions import InputError
from volid.fitting.datum import s_transformation
from volid.fitting.diagnosis.identifiability import parameter_units
from volid.fitting.diagnosis.statements import NAMED
from volid.fitting.frames import check_exact, frames, unknown_rows
from volid.fitting.results import read_only
from volid.model.error_model import ErrorModel, build_model
from volid.model.machine import Datum, Machine

EXTRAPOLATED = "extrapolated"  # option of a solution: how far by axis

if TYPE_CHECKING:
    from jaxtyping import Float

    from volid.fitting.solution import Solution


def held_constants(model: ErrorModel, directions: Float[np.ndarray, "s r"]) -> tuple[str, ...]:
    """Names of tool-frame constants that cannot be stated because part of them is held at 0 along `directions`."""
    rows = zip(model.tool_frame, directions, strict=False)
    return tuple(f.name for f, row in rows if np.any(row**2 > NAMED))


def in_datum(solution: Solution, datum: Datum) -> Solution:
    """`Solution.in_datum`, which describes it."""
    machine = solution.machine
    if EXTRAPOLATED in solution.options:
        raise InputError("datum: this solution is extrapolated; change the datum first, then extrapolate")
    datum, moved = _within(machine, datum)
    model = build_model(machine, solution.model.segments, carrier=solution.model.carrier, datum=datum)
    s, motion = s_transformation(solution.model, model, hold_tool_rotation(solution, model))
    moved_frames = frames(solution.model, model, s, motion)
    check_exact(
        machine, solution.nuisance_table, moved_frames, np.asarray(solution.parameters), solution.parameter_covariance
    )
    answer = -unknown_rows(machine, solution.nuisance_table, np.asarray(solution.nuisance), moved_frames)
    found = mapped(solution, model, s, answer, np.linalg.pinv(s))
    return replace(found, notes=(*found.notes, *moved))


def _within(machine: Machine, datum: Datum) -> tuple[Datum, list[str]]:
    """The datum with references within the measured ranges, and a note for each that was moved."""
    reference, notes = [], []
    for letter, value in datum.reference:
        low, high = machine.axis(letter).travel
        inside = float(np.clip(value, low, high))
        reference.append((letter, inside))
        if inside != value:
            notes.append(
                f"datum: the reference of {letter} at {value:g} lies outside the measured range {low:g} … {high:g}; functions "
                f"are zero at {inside:g}"
            )
    return replace(datum, reference=tuple(reference)), notes


def mapped(
    solution: Solution,
    model: ErrorModel,
    mapping: Float[np.ndarray, "m n"],
    answer: Float[np.ndarray, "k n"] | None,
    inverse: Float[np.ndarray, "n m"] | None,
) -> Solution:
    """`Solution.mapped`, which describes it."""
    m, n, k = len(mapping), solution.model.n_parameters, len(solution.nuisance_table)
    theta, nuisance = np.asarray(solution.parameters), np.asarray(solution.nuisance)
    full = np.zeros((m + k, n + k))
    full[:m, :n], full[m:, n:] = mapping, np.eye(k)
    full[m:, :n] = 0.0 if answer is None else answer
    earlier, smooth = solution.prior_root, solution.smooth
    return replace(
        solution,
        parameters=read_only(mapping @ theta),
        nuisance=read_only(nuisance if answer is None else nuisance + answer @ theta),
        covariance=read_only(full @ np.asarray(solution.covariance) @ full.T),
        null_space=read_only(mapping @ np.asarray(solution.null_space)),
        model=model,
        samples=None if solution.samples is None else solution.samples.mapped(full),
        prior_root=None if inverse is None or earlier is None else read_only(earlier @ inverse),
        smooth=None if smooth is None else smooth.mapped(inverse, full, m),
    )


def hold_tool_rotation(solution: Solution, model: ErrorModel) -> np.ndarray:
    """Projector that keeps at 0, in the new datum too, what is not determined of the constant tool rotation."""
    places = [f.parameters.start for f in model.tool_frame]
    units = parameter_units(model)[places]
    projector = np.eye(model.n_parameters)
    fixed = np.asarray(solution.held_directions @ solution.held_directions.T) * units[:, None] / units
    projector[np.ix_(places, places)] -= fixed
    return projector
