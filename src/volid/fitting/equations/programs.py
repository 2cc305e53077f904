"""The programs of the compiled engine: residuals, gradient and normal equations of a system, chunk by chunk, in JAX.

Each reading depends on few error values and nuisance values; their partial derivatives come from one reverse pass per scalar
reading, the chain to coefficients is a product with the constant basis.
"""

from __future__ import annotations

from functools import partial
from typing import Any, NamedTuple

from volid.backend.elementary import in_rows
from volid.backend.lazy import jax, jit, jnp
from volid.effects.prediction import Form, predict_readings
from volid.fitting.equations.system import Block, Normal, System
from volid.fitting.equations.tiles import Tiles, assemble_tiles
from volid.model.error_model import ROWS
from volid.model.error_values import coefficient_rows, error_rows, evaluate_bases, summed_rows
from volid.model.machine import Machine


class _Linear(NamedTuple):
    """One chunk at some z: whitened residuals (k, m); for each of the k whitened readings the partial derivatives with respect to
    error values (rows, m) and nuisance values (slots, m); and the bases."""

    residual: Any
    d_errors: list[Any]
    d_slots: list[Any]
    bases: list[Any]


def _chain(system: System, form: Form, chunk: Block, z: Any) -> tuple[Any, Any, list[Any]]:
    """Prediction (k, m) of one chunk, its reverse pass (k, m) -> partials to error and nuisance values, and the bases."""
    n, m = system.layout.n_coefficients, chunk.q.shape[1]
    bases = evaluate_bases(system.layout, chunk.q, chunk.direction)
    errors = error_rows(system.layout, z[:n], bases, m)
    prediction, pull = jax.vjp(partial(_predict_chunk, system, form, chunk), errors, list(z[n + chunk.slots]))

    def pull_back(cotangent: Any) -> tuple[Any, Any]:
        d_errors, d_slots = pull(cotangent)
        return in_rows(d_errors, (m,)), in_rows(d_slots, (m,))

    return prediction, pull_back, bases


def _linearised(system: System, form: Form, chunk: Block, z: Any) -> _Linear:
    prediction, pull_back, bases = _chain(system, form, chunk, z)
    parts = []
    for k in range(form.n_readings):
        one = (jnp.arange(form.n_readings) == k)[:, None]
        parts.append(pull_back(jnp.where(one, chunk.weight, 0.0)))
    return _Linear((prediction - chunk.reading) * chunk.weight, [e for e, _ in parts], [s for _, s in parts], bases)


def _nuisance_rows(system: System, chunk: Block, d_slots: Any) -> Any:
    """Partial derivatives with respect to all nuisance parameters, (n_nuisance, m), from those to the slots."""
    number = jnp.arange(system.n_nuisance, dtype=chunk.slots.dtype)[:, None]
    rows = [jnp.where(number == slot, d, 0.0) for slot, d in zip(chunk.slots, d_slots, strict=True)]
    return sum(rows) if rows else jnp.zeros((system.n_nuisance, chunk.q.shape[1]), dtype=d_slots.dtype)


def _nuisance_sums(system: System, chunk: Block, d_slots: Any) -> Any:
    """`_nuisance_rows` summed over the readings."""
    return jnp.zeros(system.n_nuisance).at[chunk.slots.reshape(-1)].add(d_slots.reshape(-1))


def _rows(system: System, chunk: Block, linear: _Linear, kind: Any) -> Any:
    """Whitened Jacobian (size, k·m) of one chunk in numbers of type `kind`."""
    bases = [b.astype(kind) for b in linear.bases]
    blocks = [
        jnp.concatenate(
            [coefficient_rows(system.layout, e.astype(kind), bases), _nuisance_rows(system, chunk, s.astype(kind))]
        )
        for e, s in zip(linear.d_errors, linear.d_slots, strict=True)
    ]
    return jax.lax.optimization_barrier(jnp.concatenate(blocks, axis=1))


def residual_rows(system: System, form: Form, chunk: Block, z: Any) -> tuple[Any, Any]:
    """Whitened residuals (prediction - reading)/u of one chunk, shape (k·m,), and their Jacobian, (size, k·m)."""
    linear = _linearised(system, form, chunk, z)
    return linear.residual.reshape(-1), _rows(system, chunk, linear, jnp.float64)


def predicted(system: System, form: Form, chunk: Block, z: Any) -> Any:
    """Predicted readings of one chunk, shape (k, m)."""
    n, m = system.layout.n_coefficients, chunk.q.shape[1]
    errors = error_rows(system.layout, z[:n], evaluate_bases(system.layout, chunk.q, chunk.direction), m)
    return _predict_chunk(system, form, chunk, errors, list(z[n + chunk.slots]))


def _predict_chunk(system: System, form: Form, chunk: Block, errors: Any, slots: Any) -> Any:
    return predict_readings(system.machine, form, chunk.q, tuple(chunk.tool), errors, slots, chunk.constants)


def _normal_of_chunk(system: System, form: Form, chunk: Block, z: Any, rough: bool) -> Normal:
    """Normal equations of one chunk; when `rough`, JᵀJ in single precision (cost and gradient never are)."""
    linear = _linearised(system, form, chunk, z)
    cost = 0.5 * jnp.sum(linear.residual**2)
    if not rough:
        rows = _rows(system, chunk, linear, jnp.float64)
        return Normal(cost, rows @ linear.residual.reshape(-1), rows @ rows.T)
    rows = _rows(system, chunk, linear, jnp.float32)
    gradient = sum(
        _summed(system, chunk, e * r, s * r, linear.bases)
        for e, s, r in zip(linear.d_errors, linear.d_slots, linear.residual, strict=True)
    )
    return Normal(cost, gradient, (rows @ rows.T).astype(jnp.float64))


def _summed(system: System, chunk: Block, d_errors: Any, d_slots: Any, bases: list[Any]) -> Any:
    curves = summed_rows(system.layout, d_errors, bases)
    return jnp.concatenate([curves, _nuisance_sums(system, chunk, d_slots)])


def assemble(system: System, tiles: tuple[Tiles | None, ...], z: Any, rough: bool = False) -> Normal:
    """Cost, gradient and Gauss-Newton matrix in z, summed over chunks, or over tiles where a block has them; priors included.

    When `rough`, products of JᵀJ are formed in single precision: good enough for steps, not for a covariance.
    """
    root = system.prior_root
    offset = system.prior_residual(z)
    total = Normal(0.5 * jnp.sum(offset**2), root.T @ offset, root.T @ root)
    for block, own in zip(system.blocks, tiles, strict=True):
        if own is not None:
            parts = assemble_tiles(system, own, z, partial(_predict_chunk, system, block.form), rough)
            total = Normal(*(a + b for a, b in zip(total, parts, strict=True)))
            continue

        def add(total: Normal, chunk: Block, form: Form = block.form) -> tuple[Normal, None]:
            added = _normal_of_chunk(system, form, chunk, z, rough)
            return Normal(*(a + b for a, b in zip(total, added, strict=True))), None

        total, _ = jax.lax.scan(add, total, block)
    return total


def slope_of_chunk(system: System, form: Form, chunk: Block, z: Any) -> tuple[Any, Any]:
    """|r|²/2 and Jᵀr of one chunk, by one reverse pass for the sum of its readings."""
    prediction, pull_back, bases = _chain(system, form, chunk, z)
    residual = (prediction - chunk.reading) * chunk.weight
    d_errors, d_slots = pull_back(residual * chunk.weight)
    return 0.5 * jnp.sum(residual**2), _summed(system, chunk, d_errors, d_slots, bases)


def _nuisance_of_chunk(system: System, form: Form, chunk: Block, z: Any) -> Normal:
    """Normal equations of one chunk in the nuisance parameters alone."""
    n, m = system.layout.n_coefficients, chunk.q.shape[1]
    errors = error_rows(system.layout, z[:n], evaluate_bases(system.layout, chunk.q, chunk.direction), m)
    predict = partial(_predict_chunk, system, form, chunk, errors)
    prediction, pull = jax.vjp(predict, list(z[n + chunk.slots]))
    residual = (prediction - chunk.reading) * chunk.weight
    rows = []
    for k in range(form.n_readings):
        one = (jnp.arange(form.n_readings) == k)[:, None]
        rows.append(_nuisance_rows(system, chunk, in_rows(pull(jnp.where(one, chunk.weight, 0.0))[0], (m,))))
    whole = jnp.concatenate(rows, axis=1)
    return Normal(0.5 * jnp.sum(residual**2), whole @ residual.reshape(-1), whole @ whole.T)


@jit
def nuisance_equations(system: System, z: Any) -> Normal:
    """Cost, gradient and Gauss-Newton matrix in the nuisance parameters alone, all others held: a small part of the work."""
    n = system.layout.n_coefficients
    offset, root = system.prior_residual(z), system.prior_root[:, n:]
    total = Normal(0.5 * jnp.sum(offset**2), root.T @ offset, root.T @ root)
    for block in system.blocks:

        def add(total: Normal, chunk: Block, form: Form = block.form) -> tuple[Normal, None]:
            added = _nuisance_of_chunk(system, form, chunk, z)
            return Normal(*(a + b for a, b in zip(total, added, strict=True))), None

        total, _ = jax.lax.scan(add, total, block)
    return total


@partial(jit, static_argnames=("rough",))
def normal_equations(system: System, tiles: tuple[Tiles | None, ...], z: Any, rough: bool) -> Normal:
    """`assemble`, compiled."""
    return assemble(system, tiles, z, rough)


@jit
def slope(system: System, z: Any) -> tuple[Any, Any]:
    """Cost and gradient in z alone: a sixth of the work of `normal_equations` or less."""
    root = system.prior_root
    offset = system.prior_residual(z)
    total = 0.5 * jnp.sum(offset**2), root.T @ offset
    for block in system.blocks:

        def add(total: Any, chunk: Block, form: Form = block.form) -> tuple[Any, None]:
            cost, gradient = slope_of_chunk(system, form, chunk, z)
            return (total[0] + cost, total[1] + gradient), None

        total, _ = jax.lax.scan(add, total, block)
    return total


@jit
def predictions(system: System, z: Any) -> list[Any]:
    """Predicted readings of every block, each (n_chunks, k, chunk)."""
    return [
        jax.lax.map(lambda chunk, form=block.form: predicted(system, form, chunk, z), block) for block in system.blocks
    ]


@jit
def quadratic_forms(system: System, z: Any, factor: Any) -> list[Any]:
    """|F J_i|² for every whitened reading i, with `factor` F of shape (r, size); blocks as in `predictions`."""

    def of_chunk(form: Form, chunk: Block) -> Any:
        _, rows = residual_rows(system, form, chunk, z)
        return jnp.sum((factor @ rows) ** 2, axis=0).reshape(form.n_readings, -1)

    return [jax.lax.map(partial(of_chunk, block.form), block) for block in system.blocks]


@jit
def projected(system: System, z: Any, factor: Any) -> list[Any]:
    """F Jᵀ of every block, each (n_chunks, r, k·chunk), with `factor` F of shape (r, size)."""

    def of_chunk(form: Form, chunk: Block) -> Any:
        return factor @ residual_rows(system, form, chunk, z)[1]

    return [jax.lax.map(partial(of_chunk, block.form), block) for block in system.blocks]


@jit
def jacobian(system: System, z: Any) -> list[Any]:
    """Whitened Jacobian rows of every block, each (n_chunks, size, k·chunk)."""
    return [
        jax.lax.map(lambda chunk, form=block.form: residual_rows(system, form, chunk, z)[1], block)
        for block in system.blocks
    ]


@partial(jit, static_argnames=("form",))
def readings(machine: Machine, form: Form, q: Any, tool: Any, errors: Any, slots: Any, constants: Any) -> Any:
    """Predicted readings (k, m) of one group."""
    return predict_readings(machine, form, q, tuple(tool), errors, slots, constants)


@partial(jit, static_argnames=("form",))
def sensitivities(machine: Machine, form: Form, q: Any, tool: Any, slots: Any, constants: Any) -> tuple[Any, Any]:
    """∂reading/∂q (ends·n_axes, k, m) and ∂reading/∂tool (ends·3, k, m) at the nominal machine."""
    errors = jnp.zeros((ROWS * (len(machine.axes) + 1) * (q.shape[0] // len(machine.axes)), q.shape[1]))

    def along(i: int, n: int) -> Any:
        return jnp.ones_like(q[0]) * (jnp.arange(n) == i)[:, None]

    def of(q: Any, tool: Any) -> Any:
        return predict_readings(machine, form, q, tuple(tool), errors, slots, constants)

    axes = [jax.jvp(lambda x: of(x, tool), (q,), (along(i, len(q)),))[1] for i in range(len(q))]
    tools = [jax.jvp(lambda x: of(q, x), (tool,), (along(i, len(tool)),))[1] for i in range(len(tool))]
    return jnp.stack(axes), jnp.stack(tools)
