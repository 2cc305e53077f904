"""A solution in another datum, by an S-transformation of all its unknowns (CONVENTIONS 4)."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from volid.fitting.datum import s_transformation
from volid.fitting.diagnosis.identifiability import NAMED, parameter_units
from volid.fitting.frames import check_exact, frames, unknown_rows
from volid.fitting.results import read_only
from volid.model.error_model import ErrorModel, Function, build_model
from volid.model.iso230 import SPINDLE, parse
from volid.model.machine import Datum

if TYPE_CHECKING:
    from jaxtyping import Float

    from volid.fitting.solution import Solution


def tool_frame(model: ErrorModel) -> list[Function]:
    """The constants of the tool frame among the functions of a model, in its order."""
    return [f for f in model.functions if parse(f.name).axis == SPINDLE]


def held_constants(model: ErrorModel, directions: Float[np.ndarray, "s r"]) -> tuple[str, ...]:
    """Names of tool-frame constants that cannot be stated because part of them is held at 0 along `directions`."""
    rows = zip(tool_frame(model), directions, strict=False)
    return tuple(f.name for f, row in rows if np.any(row**2 > NAMED))


def in_datum(solution: Solution, datum: Datum) -> Solution:
    """`Solution.in_datum`, which describes it."""
    machine = solution.machine
    model = build_model(machine, solution.model.segments, carrier=solution.model.carrier, datum=datum)
    s, motion = s_transformation(solution.model, model, _hold_tool_rotation(solution, model))
    n, k = solution.model.n_parameters, len(solution.nuisance_table)
    moved_frames = frames(solution.model, model, s, motion)
    check_exact(
        machine, solution.nuisance_table, moved_frames, np.asarray(solution.parameters), solution.parameter_covariance
    )
    full = np.zeros((model.n_parameters + k, n + k))
    full[: model.n_parameters, :n] = s
    full[model.n_parameters :, n:] = np.eye(k)
    full[model.n_parameters :, :n] = -unknown_rows(
        machine, solution.nuisance_table, np.asarray(solution.nuisance), moved_frames
    )
    start = np.concatenate([np.zeros(n), np.asarray(solution.nuisance)])
    moved = full @ np.concatenate([np.asarray(solution.parameters), np.zeros(k)]) + np.pad(
        start[n:], (model.n_parameters, 0)
    )
    return replace(
        solution,
        parameters=read_only(moved[: model.n_parameters]),
        nuisance=read_only(moved[model.n_parameters :]),
        covariance=read_only(full @ np.asarray(solution.covariance) @ full.T),
        null_space=read_only(s @ np.asarray(solution.null_space)),
        model=model,
        samples=None if solution.samples is None else solution.samples.mapped(full),
        prior_root=None if solution.prior_root is None else read_only(solution.prior_rows @ np.linalg.pinv(s)),
    )


def _hold_tool_rotation(solution: Solution, model: ErrorModel) -> np.ndarray:
    """Projector that keeps at 0, in the new datum too, what is not determined of the constant tool rotation."""
    places = [f.parameters.start for f in tool_frame(model)]
    units = parameter_units(model)[places]
    projector = np.eye(model.n_parameters)
    fixed = np.asarray(solution.held_directions @ solution.held_directions.T) * units[:, None] / units
    projector[np.ix_(places, places)] -= fixed
    return projector
