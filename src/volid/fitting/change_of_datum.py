"""A solution in another datum, by an S-transformation of all its unknowns (CONVENTIONS 4)."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from volid.fitting.datum import s_transformation
from volid.fitting.diagnosis.identifiability import parameter_units
from volid.fitting.diagnosis.statements import NAMED
from volid.fitting.frames import check_exact, frames, unknown_rows
from volid.fitting.results import read_only
from volid.model.error_model import ErrorModel, build_model
from volid.model.machine import Datum

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
    model = build_model(machine, solution.model.segments, carrier=solution.model.carrier, datum=datum)
    s, motion = s_transformation(solution.model, model, _hold_tool_rotation(solution, model))
    moved_frames = frames(solution.model, model, s, motion)
    check_exact(
        machine, solution.nuisance_table, moved_frames, np.asarray(solution.parameters), solution.parameter_covariance
    )
    answer = -unknown_rows(machine, solution.nuisance_table, np.asarray(solution.nuisance), moved_frames)
    prior_root = None if solution.prior_root is None else solution.prior_rows @ np.linalg.pinv(s)
    return mapped(solution, model, s, answer, prior_root)


def mapped(
    solution: Solution,
    model: ErrorModel,
    mapping: Float[np.ndarray, "m n"],
    answer: Float[np.ndarray, "k n"] | None,
    prior_root: Float[np.ndarray, "r m"] | None,
) -> Solution:
    """`Solution.mapped`, which describes it."""
    m, n, k = len(mapping), solution.model.n_parameters, len(solution.nuisance_table)
    theta, nuisance = np.asarray(solution.parameters), np.asarray(solution.nuisance)
    full = np.zeros((m + k, n + k))
    full[:m, :n], full[m:, n:] = mapping, np.eye(k)
    full[m:, :n] = 0.0 if answer is None else answer
    return replace(
        solution,
        parameters=read_only(mapping @ theta),
        nuisance=read_only(nuisance if answer is None else nuisance + answer @ theta),
        covariance=read_only(full @ np.asarray(solution.covariance) @ full.T),
        null_space=read_only(mapping @ np.asarray(solution.null_space)),
        model=model,
        samples=None if solution.samples is None else solution.samples.mapped(full),
        prior_root=None if prior_root is None else read_only(prior_root),
    )


def _hold_tool_rotation(solution: Solution, model: ErrorModel) -> np.ndarray:
    """Projector that keeps at 0, in the new datum too, what is not determined of the constant tool rotation."""
    places = [f.parameters.start for f in model.tool_frame]
    units = parameter_units(model)[places]
    projector = np.eye(model.n_parameters)
    fixed = np.asarray(solution.held_directions @ solution.held_directions.T) * units[:, None] / units
    projector[np.ix_(places, places)] -= fixed
    return projector
