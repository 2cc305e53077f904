"""Deviations from coefficients, with gradients, uncertainties and the test whether the data determine them."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from volid.error_model import ErrorModel, Layout, coefficient_rows, error_values, evaluate_bases
from volid.fitting.problem import pad_rows
from volid.kinematics import deviation
from volid.machine import Machine

CHUNK = 1024
SMALL = 64
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


@eqx.filter_jit
def _values(machine: Machine, layout: Layout, coefficients: Any, chunk: _Points) -> Any:
    errors = error_values(layout, coefficients, evaluate_bases(layout, chunk.q, chunk.direction))
    return deviation(machine, chunk.q, tuple(chunk.tool), errors)


@eqx.filter_jit
def _squares(machine: Machine, layout: Layout, coefficients: Any, chunk: _Points, factor: Any) -> Any:
    """|factor · gradient|² per component and point, (6, chunk); `factor` (r, n_coefficients)."""
    rows = gradient_rows(machine, layout, coefficients, *chunk)
    return jnp.stack([jnp.sum((factor @ rows[k]) ** 2, axis=0) for k in range(6)])


@eqx.filter_jit
def _gradients(machine: Machine, layout: Layout, coefficients: Any, chunk: _Points) -> Any:
    return gradient_rows(machine, layout, coefficients, *chunk)


def _by_chunks(
    function: Callable[[_Points], Any], positions: np.ndarray, tool: np.ndarray, direction: np.ndarray
) -> np.ndarray:
    """`function` over all points in chunks of a few fixed lengths, so that few programs are compiled; points last."""
    m = len(positions)
    length = CHUNK if m > SMALL else SMALL
    results = []
    for start in range(0, m, length):
        rows = np.minimum(np.arange(start, start + length), m - 1)  # the last chunk repeats its last point
        chunk = _Points(*(jnp.asarray(v[rows].T, dtype=float) for v in (positions, tool, direction)))
        results.append(np.asarray(function(chunk))[..., : m - start])
    return np.concatenate(results, axis=-1)


def deviation_values(
    model: ErrorModel, theta: np.ndarray, positions: np.ndarray, tool: np.ndarray, direction: np.ndarray
) -> np.ndarray:
    """Deviation at m points, shape (m, 6) [mm, rad]."""
    coefficients = jnp.asarray(model.parametrisation @ theta)
    function = partial(_values, chain_of(model.machine), model.layout, coefficients)
    return _by_chunks(function, positions, tool, direction).T


def gradient_matrix(
    model: ErrorModel, theta: np.ndarray, positions: np.ndarray, tool: np.ndarray, direction: np.ndarray
) -> np.ndarray:
    """∂(deviation)/∂θ at m points, shape (m, 6, n_parameters). For a few thousand points."""
    coefficients = jnp.asarray(model.parametrisation @ theta)
    function = partial(_gradients, chain_of(model.machine), model.layout, coefficients)
    rows = _by_chunks(function, positions, tool, direction)
    return rows.transpose(2, 0, 1) @ model.parametrisation


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
    factor = pad_rows((model.parametrisation @ root).T)
    coefficients = jnp.asarray(model.parametrisation @ theta)
    function = partial(_squares, chain_of(model.machine), model.layout, coefficients, factor=factor)
    return np.sqrt(_by_chunks(function, positions, tool, direction)).T


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
    zero = jnp.zeros(model.layout.n_coefficients)
    squares = partial(_squares, chain_of(model.machine), model.layout, zero)
    null, _ = np.linalg.qr(null_space / units[:, None])
    n = len(units)  # both factors get the same shape, hence one program
    factors = [pad_rows(np.pad(f, ((0, n - len(f)), (0, 0)))) for f in _factors(model, null, units)]
    along, whole = (_by_chunks(partial(squares, factor=f), positions, tool, direction).T for f in factors)
    return np.asarray(along <= ESTIMABLE**2 * np.maximum(whole, 1e-300))


def _factors(model: ErrorModel, null: np.ndarray, units: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    scaled = model.parametrisation * units
    return (scaled @ null).T, scaled.T
