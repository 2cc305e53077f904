"""Deviations from coefficients, with gradients, uncertainties and the test whether the data determine them."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, NamedTuple

import numpy as np

from volid.backend.elementary import in_rows
from volid.fitting.diagnosis.identifiability import undetermined_directions
from volid.fitting.equations.choice import engine_for_points
from volid.fitting.equations.engine import Calls, PointFunction
from volid.fitting.prediction import spread
from volid.model.error_model import ErrorModel, Layout
from volid.model.error_values import coefficient_rows, error_rows, evaluate_bases
from volid.model.jacobian import deviation_partials
from volid.model.kinematics import chain_of, deviation
from volid.model.machine import Machine

THREADS = 2  # that share a long computation, here and where others import it
NOTICED = 1e-3  # 0.1 µm for a rotation of 0.1 mrad that is not determined; see `statements.NAMED`


def determined(along: np.ndarray, possible: np.ndarray | float) -> np.ndarray:
    """Whether the data determine outputs: combinations of 0.1 mm and 0.1 mrad that are not determined change them too little.

    `along`: by how much these change them; `possible`: what all parameters, of that size, can; of shapes that broadcast.
    """
    return np.asarray(along <= NOTICED * np.maximum(possible, 1e-150))


def partial_rows(machine: Machine, errors: Any, q: Any, tool: Any) -> list[Any]:
    """∂(deviation)/∂(error values): for each of six components an array (error values, m)."""
    rows = deviation_partials(machine, q, tuple(tool), errors)
    return [in_rows(row, q.shape[1:]) for row in rows]


def gradient_rows(machine: Machine, layout: Layout, coefficients: Any, q: Any, tool: Any, direction: Any) -> Any:
    """∂(deviation)/∂(coefficients), shape (6, n_coefficients, m)."""
    bases = evaluate_bases(layout, q, direction)
    partials = partial_rows(machine, error_rows(layout, coefficients, bases, q.shape[1]), q, tool)
    return in_rows([coefficient_rows(layout, p, bases) for p in partials], (layout.n_coefficients, q.shape[1]))


class _Points(NamedTuple):
    """Points (m, …), and by `number` (m, groups of axes) the distinct position of each, where that is asked for."""

    q: Any
    tool: Any
    direction: Any
    number: Any = None


def _errors(layout: Layout, coefficients: Any, chunk: _Points) -> list[Any]:
    return error_rows(layout, coefficients, evaluate_bases(layout, chunk.q, chunk.direction), chunk.q.shape[1])


def _values(machine: Machine, layout: Layout, coefficients: Any, chunk: _Points) -> Any:
    return deviation(machine, chunk.q, tuple(chunk.tool), _errors(layout, coefficients, chunk))


def _partials(machine: Machine, layout: Layout, coefficients: Any, chunk: _Points) -> Any:
    """∂(deviation)/∂(error values), shape (6, error values, m)."""
    errors = _errors(layout, coefficients, chunk)
    return in_rows(partial_rows(machine, errors, chunk.q, chunk.tool), (len(errors), chunk.q.shape[1]))


def _gradients(machine: Machine, layout: Layout, coefficients: Any, chunk: _Points) -> Any:
    return gradient_rows(machine, layout, coefficients, chunk.q, chunk.tool, chunk.direction)


def _variances(machine: Machine, layout: Layout, coefficients: Any, chunk: _Points, products: list[Any]) -> Any:
    """Variances of the deviation from covariances of the error values (`spread.products`), (6, m)."""
    partials = deviation_partials(machine, chunk.q, tuple(chunk.tool), _errors(layout, coefficients, chunk))
    own = [
        in_rows([in_rows([p[r] for r in rows], chunk.q.shape[1:]) for p in partials], (len(rows), chunk.q.shape[1]))
        for rows in map(spread.rows_of, spread.groups_of(layout).values())
    ]
    return spread.quadratic_forms(own, products, chunk.number)


def _calls(function: PointFunction, model: ErrorModel, coefficients: np.ndarray, points: _Points, *extra: Any) -> Calls:
    """Slices of the points (m, …), and what carries `function` out on one of them; its result has points last."""
    engine = engine_for_points(len(points.q))
    return engine.by_points(function, chain_of(model.machine), model.layout, (coefficients, *extra), points)


def _each(carry_out: Callable[[slice], Any], slices: list[slice]) -> Iterator[Any]:
    """Results slice by slice, in order; `THREADS` at a time, and few of them waiting to be used."""
    if len(slices) < 2:  # starting threads takes longer than many a question
        yield from map(carry_out, slices)
        return
    with ThreadPoolExecutor(THREADS) as pool:  # XLA and NumPy let other threads work meanwhile
        waiting: deque[Future[Any]] = deque()
        for part in slices:
            waiting.append(pool.submit(carry_out, part))
            if len(waiting) > 2 * THREADS:
                yield waiting.popleft().result()
        yield from (f.result() for f in waiting)


def _over_points(
    function: PointFunction, model: ErrorModel, coefficients: np.ndarray, points: _Points, *extra: Any
) -> np.ndarray:
    """`function` over all points, points last."""
    slices, call = _calls(function, model, coefficients, points, *extra)
    return np.concatenate(list(_each(call, slices)), axis=-1)


def _squares(model: ErrorModel, coefficients: np.ndarray, factor: np.ndarray, points: _Points) -> np.ndarray:
    """|factor · gradient|² per component and point, (6, m); `factor` (r, n_coefficients)."""
    tables = spread.tables_of(model.layout, factor, points.q, points.direction)
    if not tables:
        return np.zeros((6, len(points.q)))
    if spread.worth_products(tables, len(points.q)):
        numbered = points._replace(number=np.stack([t.number for t in tables], axis=1))
        return _over_points(_variances, model, coefficients, numbered, spread.products(tables))
    slices, call = _calls(_partials, model, coefficients, points)
    squares = _each(lambda part: spread.squares(tables, part, call(part)), slices)
    return np.concatenate(list(squares), axis=-1)


def deviation_values(
    model: ErrorModel, theta: np.ndarray, positions: np.ndarray, tool: np.ndarray, direction: np.ndarray
) -> np.ndarray:
    """Deviation at m points, shape (m, 6) [mm, rad]."""
    coefficients = model.parametrisation @ theta
    return _over_points(_values, model, coefficients, _Points(positions, tool, direction)).T


def gradient_matrix(
    model: ErrorModel, theta: np.ndarray, positions: np.ndarray, tool: np.ndarray, direction: np.ndarray
) -> np.ndarray:
    """∂(deviation)/∂θ at m points, shape (m, 6, n_parameters). For a few thousand points."""
    coefficients = model.parametrisation @ theta
    rows = _over_points(_gradients, model, coefficients, _Points(positions, tool, direction))
    by_parameter = np.ascontiguousarray(rows.transpose(2, 0, 1)).reshape(-1, rows.shape[1]) @ model.parametrisation
    return np.asarray(by_parameter.reshape(-1, rows.shape[0], by_parameter.shape[1]))


def error_gradients(model: ErrorModel, theta: np.ndarray, positions: np.ndarray, tool: np.ndarray) -> np.ndarray:
    """∂(deviation)/∂(error values) at m points, mean of both directions, (m, 6, 6 · (n_axes + 1))."""
    still = np.zeros_like(positions)
    rows = _over_points(_partials, model, model.parametrisation @ theta, _Points(positions, tool, still))
    return np.ascontiguousarray(rows.transpose(2, 0, 1))


def standard_uncertainties(
    model: ErrorModel,
    theta: np.ndarray,
    covariance: np.ndarray,
    positions: np.ndarray,
    tool: np.ndarray,
    direction: np.ndarray,
) -> np.ndarray:
    """u of the deviation at m points, shape (m, 6) [mm, rad]: sqrt(g C gᵀ) with the gradient g with respect to θ."""
    factor = (model.parametrisation @ spread.covariance_root(covariance)).T
    coefficients = model.parametrisation @ theta
    found = _squares(model, coefficients, factor, _Points(positions, tool, direction))
    return np.sqrt(np.maximum(found, 0.0)).T


def is_determined(
    model: ErrorModel,
    null_space: np.ndarray,
    units: np.ndarray,
    positions: np.ndarray,
    tool: np.ndarray,
    direction: np.ndarray,
) -> np.ndarray:
    """Whether the data determine each component of the deviation, bool (m, 6).

    A component is determined when combinations of 0.1 mm and 0.1 mrad that are not determined change it by less than a
    thousandth of what its parameters can, all of that size; judged at the nominal machine.
    """
    if null_space.shape[1] == 0:
        return np.ones((len(positions), 6), dtype=bool)
    zero, points = np.zeros(model.layout.n_coefficients), _Points(positions, tool, direction)
    null = undetermined_directions(null_space, units)
    squares = (_squares(model, zero, f, points).T for f in _factors(model, null, units))
    along, possible = (np.sqrt(np.maximum(s, 0.0)) for s in squares)
    return determined(along, possible)


def _factors(model: ErrorModel, null: np.ndarray, units: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    scaled = model.parametrisation * units
    return (scaled @ null).T, scaled.T
