"""The least-squares problem: readings as padded blocks, residuals, and the structured Jacobian.

Unknowns z = [c, ν]: coefficients of the error functions, then nuisance parameters (stations, dead paths, offsets); z =
z0 + P y with y the free ones. Each reading depends on few error values and nuisance values; their partial derivatives come
from one reverse pass per scalar reading, the chain to coefficients is a product with the constant basis.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from scipy.linalg import block_diag

from volid.campaign import Campaign, Effect
from volid.error_model import ErrorModel, Layout, coefficient_rows, error_values, evaluate_bases, summed_rows
from volid.fitting import interpreted
from volid.fitting.tiles import Tiles, assemble_tiles, reweighted, tiles_of
from volid.machine import Machine
from volid.observations.base import Nuisance, NuisanceTable
from volid.observations.effects import Extended, Form, groups_of, predict_readings
from volid.observations.random_effects import random_parts

CHUNK = 2048


class Block(eqx.Module):
    """Readings of one form, padded with zero weight to whole chunks: every array is (n_chunks, width, chunk).

    `weight`: 1/u, times the square root of a robust weight, 0 for padding.
    """

    form: Form = eqx.field(static=True)
    q: Any
    direction: Any
    tool: Any
    reading: Any
    weight: Any
    slots: Any
    constants: Any


class System(eqx.Module):
    """Everything a residual needs: kinematic chain, coefficient layout, blocks, and prior knowledge of z.

    `prior_root` W, shape (r, size), and `prior_mean`: pseudo-readings W (z - mean) with unit variance, from calibrated
    artefacts and from an earlier solution. `tiles`: the readings of large blocks again, by cells of the working volume.
    """

    machine: Machine = eqx.field(static=True)
    layout: Layout = eqx.field(static=True)
    n_nuisance: int = eqx.field(static=True)
    blocks: tuple[Block, ...]
    tiles: tuple[Tiles | None, ...]
    prior_mean: Any
    prior_root: Any

    @property
    def size(self) -> int:
        """Length of z."""
        return self.layout.n_coefficients + self.n_nuisance


class Normal(NamedTuple):
    """cost = |r|²/2, gradient Jᵀr and Gauss-Newton matrix JᵀJ, in z."""

    cost: Any
    gradient: Any
    matrix: Any


def residual_rows(system: System, form: Form, chunk: Block, z: Any) -> tuple[Any, Any]:
    """Whitened residuals (prediction - reading)/u of one chunk, shape (k·m,), and their Jacobian, (size, k·m)."""
    n = system.layout.n_coefficients
    # XLA would otherwise evaluate the splines anew inside every row of the Jacobian
    bases = jax.lax.optimization_barrier(evaluate_bases(system.layout, chunk.q, chunk.direction))
    errors = jax.lax.optimization_barrier(error_values(system.layout, z[:n], bases))
    slots = z[n + chunk.slots]
    predict = partial(predict_readings, system.machine, form, chunk.q, tuple(chunk.tool))
    prediction, pull_back = jax.vjp(lambda e, s: predict(e, s, chunk.constants), errors, slots)
    ones = jnp.ones_like(prediction)
    blocks = []
    for k in range(form.n_readings):
        cotangent = ones * (jnp.arange(form.n_readings) == k)[:, None]
        d_errors, d_slots = jax.lax.optimization_barrier(pull_back(cotangent))
        rows = coefficient_rows(system.layout, d_errors, bases)
        number = jnp.arange(system.n_nuisance, dtype=chunk.slots.dtype)[:, None]
        extra = sum(jnp.where(number == chunk.slots[r], d_slots[r], 0.0) for r in range(chunk.slots.shape[0]))
        blocks.append(jnp.concatenate([rows, extra]) * chunk.weight[k])
    residual = ((prediction - chunk.reading) * chunk.weight).reshape(-1)
    return residual, jax.lax.optimization_barrier(jnp.concatenate(blocks, axis=1))


def predicted(system: System, form: Form, chunk: Block, z: Any) -> Any:
    """Predicted readings of one chunk, shape (k, m)."""
    n = system.layout.n_coefficients
    errors = error_values(system.layout, z[:n], evaluate_bases(system.layout, chunk.q, chunk.direction))
    return predict_readings(
        system.machine, form, chunk.q, tuple(chunk.tool), errors, z[n + chunk.slots], chunk.constants
    )


def _predict_chunk(system: System, form: Form, chunk: Block, errors: Any, slots: Any) -> Any:
    return predict_readings(system.machine, form, chunk.q, tuple(chunk.tool), errors, slots, chunk.constants)


def assemble(system: System, z: Any) -> Normal:
    """Cost, gradient and Gauss-Newton matrix in z, streamed over the chunks; priors included."""
    root = system.prior_root
    offset = root @ (z - system.prior_mean)
    total = Normal(0.5 * jnp.sum(offset**2), root.T @ offset, root.T @ root)
    for block, tiles in zip(system.blocks, system.tiles, strict=True):
        if tiles is not None:
            parts = assemble_tiles(system, tiles, z, partial(_predict_chunk, system, block.form))
            total = Normal(*(a + b for a, b in zip(total, parts, strict=True)))
            continue

        def add(total: Normal, chunk: Block, form: Form = block.form) -> tuple[Normal, None]:
            residual, rows = residual_rows(system, form, chunk, z)
            added = Normal(0.5 * jnp.sum(residual**2), rows @ residual, rows @ rows.T)
            return Normal(*(a + b for a, b in zip(total, added, strict=True))), None

        total, _ = jax.lax.scan(add, total, block)
    return total


def slope_of_chunk(system: System, form: Form, chunk: Block, z: Any) -> tuple[Any, Any]:
    """|r|²/2 and Jᵀr of one chunk, by one reverse pass for the sum of its readings."""
    n = system.layout.n_coefficients
    bases = jax.lax.optimization_barrier(evaluate_bases(system.layout, chunk.q, chunk.direction))
    errors = jax.lax.optimization_barrier(error_values(system.layout, z[:n], bases))
    predict = partial(predict_readings, system.machine, form, chunk.q, tuple(chunk.tool))
    prediction, pull_back = jax.vjp(lambda e, s: predict(e, s, chunk.constants), errors, z[n + chunk.slots])
    residual = (prediction - chunk.reading) * chunk.weight
    d_errors, d_slots = jax.lax.optimization_barrier(pull_back(residual * chunk.weight))
    curves = summed_rows(system.layout, d_errors, bases)
    extra = jnp.zeros(system.n_nuisance).at[chunk.slots.reshape(-1)].add(d_slots.reshape(-1))
    return 0.5 * jnp.sum(residual**2), jnp.concatenate([curves, extra])


@eqx.filter_jit
def _normal_equations(system: System, z: Any) -> Normal:
    return assemble(system, z)


@eqx.filter_jit
def _reduced_equations(system: System, z: Any, free: Any) -> Normal:
    full = assemble(system, z)
    return Normal(full.cost, free.T @ full.gradient, free.T @ (full.matrix @ free))


def reduced_equations(system: System, z: Any, free: Any) -> Normal:
    """Normal equations in y with z = … + free · y, `free` (size, n)."""
    if interpreted.interpreting():
        cost, gradient, matrix = interpreted.assemble(system, np.asarray(z))
        return Normal(cost, free.T @ gradient, free.T @ (matrix @ free))
    return _reduced_equations(system, z, free)


@eqx.filter_jit
def _slope(system: System, z: Any) -> tuple[Any, Any]:
    root = system.prior_root
    offset = root @ (z - system.prior_mean)
    total = 0.5 * jnp.sum(offset**2), root.T @ offset
    for block in system.blocks:

        def add(total: Any, chunk: Block, form: Form = block.form) -> tuple[Any, None]:
            cost, gradient = slope_of_chunk(system, form, chunk, z)
            return (total[0] + cost, total[1] + gradient), None

        total, _ = jax.lax.scan(add, total, block)
    return total


@eqx.filter_jit
def _predict_all(system: System, z: Any) -> list[Any]:
    return [
        jax.lax.map(lambda chunk, form=block.form: predicted(system, form, chunk, z), block) for block in system.blocks
    ]


@eqx.filter_jit
def _quadratic_forms(system: System, z: Any, factor: Any) -> list[Any]:
    def of_chunk(form: Form, chunk: Block) -> Any:
        _, rows = residual_rows(system, form, chunk, z)
        return jnp.sum((factor @ rows) ** 2, axis=0).reshape(form.n_readings, -1)

    return [jax.lax.map(partial(of_chunk, block.form), block) for block in system.blocks]


@eqx.filter_jit
def _jacobian(system: System, z: Any) -> list[Any]:
    return [
        jax.lax.map(lambda chunk, form=block.form: residual_rows(system, form, chunk, z)[1], block)
        for block in system.blocks
    ]


def normal_equations(system: System, z: Any) -> Normal:
    """Cost, gradient and Gauss-Newton matrix in z, priors included; compiled, or interpreted (`interpreted`)."""
    if interpreted.interpreting():
        return Normal(*interpreted.assemble(system, np.asarray(z)))
    return _normal_equations(system, z)


def slope(system: System, z: Any) -> tuple[Any, Any]:
    """Cost and gradient in z alone: a sixth of the work of `normal_equations` or less."""
    if interpreted.interpreting():
        return interpreted.slope(system, np.asarray(z))
    return _slope(system, z)


def predict_all(system: System, z: Any) -> list[Any]:
    """Predicted readings of every block, each (n_chunks, k, chunk)."""
    if interpreted.interpreting():
        return interpreted.predict_all(system, np.asarray(z))
    return _predict_all(system, z)


def quadratic_forms(system: System, z: Any, factor: Any) -> list[Any]:
    """|F J_i|² for every whitened reading i, with `factor` F of shape (r, size); blocks as in `predict_all`.

    With F Fᵀ-covariance of z these are the leverages h_ii.
    """
    if not interpreted.interpreting():
        return _quadratic_forms(system, z, factor)
    f = np.asarray(factor)
    return interpreted.over_rows(
        system, z, lambda rows, form: np.sum((f @ rows) ** 2, axis=0).reshape(form.n_readings, -1)
    )


def jacobian(system: System, z: Any) -> list[Any]:
    """Whitened Jacobian rows of every block, each (n_chunks, size, k·chunk). For rank decisions only: it is large."""
    if interpreted.interpreting():
        return interpreted.over_rows(system, z, lambda rows, form: rows)
    return _jacobian(system, z)


class Problem(NamedTuple):
    """A system with what links it to campaign and model.

    `places`: for every block (set number, rows). `start`: z at which to begin. `free`: P, shape (size, n_free).
    """

    system: System
    model: ErrorModel
    nuisance: tuple[Nuisance, ...]
    places: tuple[tuple[int, np.ndarray], ...]
    start: np.ndarray
    free: np.ndarray


def chunk_shape(m: int) -> tuple[int, int]:
    """(number of chunks, chunk length) for m rows, rounded up to a few sizes so that similar campaigns share a program."""
    if m <= CHUNK:  # quarters of powers of two
        step = max(16, int(2 ** np.floor(np.log2(max(m, 1)))) // 4)
        return 1, max(64, int(np.ceil(m / step)) * step)
    chunks = int(np.ceil(m / CHUNK))
    step = max(1, int(2 ** np.floor(np.log2(chunks))) // 4)
    return int(np.ceil(chunks / step)) * step, CHUNK


def pad_rows(factor: np.ndarray, step: int = 32) -> Any:
    """Zero rows added up to a multiple of `step`, so that models of similar size share one compiled program."""
    return np.pad(factor, ((0, -len(factor) % step), (0, 0)))


def _pad(values: np.ndarray, chunks: int, length: int, edge: bool) -> np.ndarray:
    """(width, m) -> (chunks, width, length); filled with the first column (harmless) or zeros (weights)."""
    width, m = values.shape
    fill = np.repeat(values[:, :1], chunks * length - m, axis=1) if edge else np.zeros((width, chunks * length - m))
    full = np.concatenate([values, fill.astype(values.dtype)], axis=1)
    return np.ascontiguousarray(full.reshape(width, chunks, length).transpose(1, 0, 2))


def _block(campaign: Campaign, number: int, group: Extended, weights: np.ndarray) -> Block:
    observations = campaign.sets[number]
    rows = group.rows
    chunks, length = chunk_shape(len(rows))

    def pad(values: np.ndarray, edge: bool = True) -> Any:
        return _pad(values, chunks, length, edge)

    return Block(
        form=group.form,
        q=pad(observations.positions[rows].T),
        direction=pad(observations.directions[rows].T.astype(float)),
        tool=pad(observations.tool[rows].T),
        reading=pad(observations.readings[rows].T),
        weight=pad(weights[rows].T, edge=False),
        slots=pad(group.slots),
        constants=pad(group.constants),
    )


def with_random_effects(campaign: Campaign, starts: dict[Any, float] | None = None) -> Campaign:
    """The campaign with u² of every reading enlarged by effects that are drawn anew for each (`per` = "point")."""
    sets = tuple(
        replace(s, u=np.sqrt(s.u**2 + sum(variance for _, variance in parts))) if parts else s
        for s, parts in zip(campaign.sets, random_effects(campaign, starts), strict=True)
    )
    return replace(campaign, sets=sets)


def random_effects(campaign: Campaign, starts: dict[Any, float] | None = None) -> list[list[tuple[Effect, np.ndarray]]]:
    """Per set: every effect that is drawn anew for each reading, with the variance (m, k) it adds."""
    if not any(s.effects for s in campaign.sets):
        return [[] for _ in campaign.sets]
    table = NuisanceTable(starts)
    groups = [groups_of(s, campaign, table) for s in campaign.sets]
    values = np.array([e.start for e in table.entries])
    return [random_parts(s, campaign.machine, own, values) for s, own in zip(campaign.sets, groups, strict=True)]


class Prior(NamedTuple):
    """What is known of θ beforehand: pseudo-readings W (θ - mean) with unit variance; `root` W (r, n_parameters)."""

    mean: np.ndarray
    root: np.ndarray


def _prior_knowledge(model: ErrorModel, nuisance: list[Nuisance], prior: Prior | None) -> tuple[np.ndarray, np.ndarray]:
    """Mean (size,) and root W (r, size) over z, from calibrated nuisance parameters and a prior on θ."""
    n = model.layout.n_coefficients
    start, u = np.array([e.start for e in nuisance]), np.array([e.prior_u for e in nuisance])
    places = np.flatnonzero(np.isfinite(u) & (u > 0))
    root = np.zeros((len(places), n + len(nuisance)))
    root[np.arange(len(places)), n + places] = 1.0 / u[places]
    mean = np.concatenate([np.zeros(n), np.where(np.isfinite(u), start, 0.0)])
    if prior is not None:
        p = model.parametrisation  # c = P θ, so θ = (PᵀP)⁻¹ Pᵀ c
        rows = np.pad(prior.root @ np.linalg.solve(p.T @ p, p.T), ((0, 0), (0, len(nuisance))))
        root = np.vstack([root, rows])
        mean[:n] = p @ prior.mean
    return mean, root


def build_problem(
    campaign: Campaign, model: ErrorModel, starts: dict[Any, float] | None = None, prior: Prior | None = None
) -> Problem:
    """Problem of a campaign and an error model; `starts`: start values of nuisance parameters by key."""
    table = NuisanceTable(starts)
    blocks, places = [], []
    for number, observations in enumerate(campaign.sets):
        for group in groups_of(observations, campaign, table):
            blocks.append(_block(campaign, number, group, 1.0 / observations.u))
            places.append((number, group.rows))
    n = model.layout.n_coefficients
    start = np.concatenate([np.zeros(n), [e.start for e in table.entries]])
    unknown = np.array([e.prior_u for e in table.entries]) > 0
    mean, root = _prior_knowledge(model, table.entries, prior)
    chain = Machine(name="", structure="", axes=campaign.machine.axes)
    system = System(
        machine=chain,
        layout=model.layout,
        n_nuisance=len(table.entries),
        blocks=tuple(blocks),
        tiles=tuple(
            tiles_of(model.layout, len(table.entries), block, len(rows))
            for block, (_, rows) in zip(blocks, places, strict=True)
        ),
        prior_mean=mean,
        prior_root=root,
    )
    free = block_diag(model.parametrisation, np.eye(len(unknown))[:, unknown])
    return Problem(system, model, tuple(table.entries), tuple(places), start, free)


def scatter(problem: Problem, campaign: Campaign, blocks: list[Any]) -> list[np.ndarray]:
    """Block results (n_chunks, k, chunk) back to one array (m, k) per set, in the order of its rows."""
    result = [np.full(s.readings.shape, np.nan) for s in campaign.sets]
    for (number, rows), values in zip(problem.places, blocks, strict=True):
        values = np.asarray(values)
        flat = values.transpose(1, 0, 2).reshape(values.shape[1], -1)[:, : len(rows)]
        result[number][rows] = flat.T
    return result


def reweight(problem: Problem, campaign: Campaign, factors: list[np.ndarray]) -> Problem:
    """The problem with weights factor/u, factors (m, k) per set (square roots of robust weights)."""
    blocks, tiles = [], []
    for block, old, (number, rows) in zip(problem.system.blocks, problem.system.tiles, problem.places, strict=True):
        weights = (factors[number] / campaign.sets[number].u)[rows].T
        padded = _pad(weights, block.weight.shape[0], block.weight.shape[2], edge=False)
        blocks.append(eqx.tree_at(lambda b: b.weight, block, padded))
        tiles.append(reweighted(old, weights))
    system = replace(problem.system, blocks=tuple(blocks), tiles=tuple(tiles))
    return problem._replace(system=system)
