"""Deviations from coefficients, with gradients, uncertainties and the test whether the data determine them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from volid.elementary import in_rows
from volid.error_model import ErrorModel, Layout, coefficient_rows, error_rows, error_values, evaluate_bases
from volid.fitting import spread
from volid.kinematics import deviation, orientation_deviation, point_deviation
from volid.machine import Machine
from volid.reverse import Recorded, gradients

CHUNK = 1024
INTERPRETED = 20_000  # points: up to here NumPy is done before a program is traced
ESTIMABLE = 1e-3  # 0.1 µm for an undetermined rotation of 0.1 mrad; see `identifiability.NAMED`


def chain_of(machine: Machine) -> Machine:
    """The machine reduced to its kinematic chain: equal chains share compiled programs whatever their names."""
    return Machine(name="", structure="", axes=machine.axes)


def gradient_rows(machine: Machine, layout: Layout, coefficients: Any, q: Any, tool: Any, direction: Any) -> Any:
    """∂(deviation)/∂(coefficients), shape (6, n_coefficients, m), by one reverse pass per component."""
    bases = evaluate_bases(layout, q, direction)
    errors = error_values(layout, coefficients, bases)
    _, pull_back = jax.vjp(lambda e: deviation(machine, q, tuple(tool), e), errors)
    cotangents = jnp.broadcast_to(jnp.eye(6)[:, :, None], (6, 6, q.shape[1]))
    return jax.vmap(lambda w: coefficient_rows(layout, pull_back(w)[0], bases))(cotangents)


class _Points(NamedTuple):
    q: Any
    tool: Any
    direction: Any


@partial(jax.jit, static_argnames=("layout",))
def _values(machine: Machine, layout: Layout, coefficients: Any, chunk: _Points) -> Any:
    bases = evaluate_bases(layout, chunk.q, chunk.direction)
    errors = error_rows(layout, coefficients, bases, chunk.q.shape[1])
    return deviation(machine, chunk.q, tuple(chunk.tool), errors)


@partial(jax.jit, static_argnames=("layout",))
def _partials(machine: Machine, layout: Layout, coefficients: Any, chunk: _Points) -> Any:
    """∂(deviation)/∂(error values), shape (6, error values, chunk)."""
    m, tool = chunk.q.shape[1], tuple(chunk.tool)
    errors = error_rows(layout, coefficients, evaluate_bases(layout, chunk.q, chunk.direction), m)
    rows = []
    for part in (
        lambda e: point_deviation(machine, chunk.q, tool, e),
        lambda e: orientation_deviation(machine, chunk.q, e),
    ):
        _, pull_back = jax.vjp(part, errors)
        for k in range(3):
            one = tuple(jnp.full(m, float(i == k)) for i in range(3))
            rows.append(in_rows(pull_back(one)[0], (m,)))
    return in_rows(rows, rows[0].shape)


@partial(jax.jit, static_argnames=("layout",))
def _gradients(machine: Machine, layout: Layout, coefficients: Any, chunk: _Points) -> Any:
    return gradient_rows(machine, layout, coefficients, *chunk)


def _interpreted_values(machine: Machine, layout: Layout, coefficients: Any, chunk: _Points) -> np.ndarray:
    """`_values` without a compiled program."""
    errors = _errors(layout, coefficients, chunk)
    return np.asarray(deviation(machine, chunk.q, tuple(chunk.tool), errors))


def _errors(layout: Layout, coefficients: Any, chunk: _Points) -> np.ndarray:
    errors = error_values(layout, np.asarray(coefficients), evaluate_bases(layout, chunk.q, chunk.direction))
    return np.asarray(errors if layout.terms else np.zeros((len(errors), chunk.q.shape[1])))


def _interpreted_partials(machine: Machine, layout: Layout, coefficients: Any, chunk: _Points) -> np.ndarray:
    """`_partials` without a compiled program."""
    notes: list[Recorded] = []
    leaves = [Recorded(row, notes) for row in _errors(layout, coefficients, chunk)]
    found = deviation(machine, chunk.q, tuple(chunk.tool), leaves)
    return np.stack([gradients(f, leaves, chunk.q.shape[1]) for f in found])


def _interpreted_gradients(machine: Machine, layout: Layout, coefficients: Any, chunk: _Points) -> np.ndarray:
    """`_gradients` without a compiled program."""
    bases = evaluate_bases(layout, chunk.q, chunk.direction)
    partials = _interpreted_partials(machine, layout, coefficients, chunk)
    return np.stack([coefficient_rows(layout, p, bases) for p in partials])


_INTERPRETED: dict[Callable[..., Any], Callable[..., np.ndarray]] = {
    _values: _interpreted_values,
    _partials: _interpreted_partials,
    _gradients: _interpreted_gradients,
}


def _chunks(
    function: Callable[..., Any], model: ErrorModel, coefficients: np.ndarray, points: _Points
) -> Iterator[tuple[slice, np.ndarray]]:
    """`function` over all points (m, …), slice by slice; points last. Few points are interpreted; many in chunks of one length,
    so that one program is compiled."""
    m, chain = len(points.q), chain_of(model.machine)
    if m <= INTERPRETED:
        for part in _slices(m):
            chunk = _Points(*(np.ascontiguousarray(v[part].T, dtype=float) for v in points))
            yield part, _INTERPRETED[function](chain, model.layout, coefficients, chunk)
        return
    ahead: list[tuple[slice, Any]] = []
    for part in _slices(m):
        rows = np.minimum(np.arange(part.start, part.start + CHUNK), m - 1)  # the last chunk repeats its last point
        chunk = _Points(*(np.asarray(v[rows].T, dtype=float) for v in points))
        ahead.append((part, function(chain, model.layout, coefficients, chunk)))
        if len(ahead) > 1:  # computed while the one before is used
            yield _whole(*ahead.pop(0))
    yield from (_whole(*pending) for pending in ahead)


def _slices(m: int) -> Iterator[slice]:
    return (slice(start, min(start + CHUNK, m)) for start in range(0, m, CHUNK))


def _whole(part: slice, values: Any) -> tuple[slice, np.ndarray]:
    return part, np.asarray(values)[..., : part.stop - part.start]


def _by_chunks(
    function: Callable[..., Any], model: ErrorModel, coefficients: np.ndarray, points: _Points
) -> np.ndarray:
    parts = [values for _, values in _chunks(function, model, coefficients, points)]
    return np.concatenate(parts, axis=-1)


def _squares(model: ErrorModel, coefficients: np.ndarray, factor: np.ndarray, points: _Points) -> np.ndarray:
    """|factor · gradient|² per component and point, (6, m); `factor` (r, n_coefficients)."""
    tables = spread.tables_of(model.layout, factor, points.q, points.direction)
    partials = _chunks(_partials, model, coefficients, points)
    return spread.squares(tables, partials, model.layout.n_axes, len(points.q))


def deviation_values(
    model: ErrorModel, theta: np.ndarray, positions: np.ndarray, tool: np.ndarray, direction: np.ndarray
) -> np.ndarray:
    """Deviation at m points, shape (m, 6) [mm, rad]."""
    coefficients = model.parametrisation @ theta
    return _by_chunks(_values, model, coefficients, _Points(positions, tool, direction)).T


def gradient_matrix(
    model: ErrorModel, theta: np.ndarray, positions: np.ndarray, tool: np.ndarray, direction: np.ndarray
) -> np.ndarray:
    """∂(deviation)/∂θ at m points, shape (m, 6, n_parameters). For a few thousand points."""
    coefficients = model.parametrisation @ theta
    rows = _by_chunks(_gradients, model, coefficients, _Points(positions, tool, direction))
    whole = np.ascontiguousarray(rows.transpose(2, 0, 1)).reshape(-1, rows.shape[1]) @ model.parametrisation
    return np.asarray(whole.reshape(-1, rows.shape[0], whole.shape[1]))


def standard_uncertainties(
    model: ErrorModel,
    theta: np.ndarray,
    covariance: np.ndarray,
    positions: np.ndarray,
    tool: np.ndarray,
    direction: np.ndarray,
) -> np.ndarray:
    """u of the deviation at m points, shape (m, 6) [mm, rad]: sqrt(g C gᵀ) with the gradient g with respect to θ."""
    values, vectors = np.linalg.eigh(covariance)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    factor, coefficients = (model.parametrisation @ root).T, model.parametrisation @ theta
    found = _squares(model, coefficients, factor, _Points(positions, tool, direction))
    return np.sqrt(np.maximum(found, 0.0)).T


def estimable(
    model: ErrorModel,
    null_space: np.ndarray,
    units: np.ndarray,
    positions: np.ndarray,
    tool: np.ndarray,
    direction: np.ndarray,
) -> np.ndarray:
    """Whether the data determine each component of the deviation, bool (m, 6).

    A component is determined when undetermined combinations of 0.1 mm and 0.1 mrad change it by less than a thousandth of
    what its parameters can, all of that size; judged at the nominal machine.
    """
    if null_space.shape[1] == 0:
        return np.ones((len(positions), 6), dtype=bool)
    zero, points = np.zeros(model.layout.n_coefficients), _Points(positions, tool, direction)
    null, _ = np.linalg.qr(null_space / units[:, None])
    along, whole = (_squares(model, zero, f, points).T for f in _factors(model, null, units))
    return np.asarray(along <= ESTIMABLE**2 * np.maximum(whole, 1e-300))


def _factors(model: ErrorModel, null: np.ndarray, units: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    scaled = model.parametrisation * units
    return (scaled @ null).T, scaled.T
