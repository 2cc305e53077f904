"""Error values as linear maps of the parameters θ, in NumPy: what a control, an uncertainty and a change of datum are made of."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from volid.model.error_model import ErrorModel
from volid.model.iso230 import ErrorName, parse
from volid.model.kinematics import ROWS
from volid.model.splines import Basis, evaluate

if TYPE_CHECKING:
    from jaxtyping import Float


def function_rows(
    model: ErrorModel, name: str, q: Float[np.ndarray, "axes m"], direction: Float[np.ndarray, "axes m"]
) -> Float[np.ndarray, "m n"]:
    """One function, all its parts together: rows a with E(q, direction) = a·θ [mm or rad per parameter].

    `q` [mm, °]; `direction`: approach, +1, -1, or 0 for the mean of both.
    """
    rows = np.zeros((q.shape[1], model.n_parameters))
    for f, term in zip(model.functions, model.layout.terms, strict=True):
        if f.name == name:
            values = evaluate(term.basis, q, direction).T
            rows[:, f.parameters] = values @ model.parametrisation[f.coefficients, f.parameters]
    return rows


def error_value_rows(
    model: ErrorModel,
    q: Float[np.ndarray, "axes m"],
    direction: Float[np.ndarray, "axes m"],
    keep: Callable[[ErrorName], bool] = lambda _: True,
) -> Float[np.ndarray, "m errors n"]:
    """All 6·(n_axes + 1) error values as linear map of θ, of the functions that `keep` accepts; arguments as `function_rows`."""
    values: dict[Basis, np.ndarray] = {}
    rows = np.zeros((q.shape[1], ROWS * (len(model.machine.axes) + 1), model.n_parameters))
    for f, term in zip(model.functions, model.layout.terms, strict=True):
        if keep(parse(f.name)):
            if term.basis not in values:
                values[term.basis] = evaluate(term.basis, q, direction).T
            block = model.parametrisation[f.coefficients, f.parameters]
            rows[:, term.row, f.parameters] += term.sign * values[term.basis] @ block
    return rows
