"""The least-squares problem of a campaign and an error model: readings as padded blocks, start values, free directions, priors.

Unknowns are z = z0 + P y with y the free ones; see `system` and `equations`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import block_diag

from volid.campaign import Campaign, Effect
from volid.effects.prediction import Extended, groups_of
from volid.effects.random import random_parts
from volid.fitting.equations.choice import engine_for_fit
from volid.fitting.equations.engine import Engine, Equations
from volid.fitting.equations.sensitivities import sensitivities_of
from volid.fitting.equations.system import Block, System
from volid.model.error_model import ErrorModel
from volid.model.kinematics import chain_of
from volid.observations.base import Nuisance, NuisanceTable

CHUNK = 2048


class Problem(NamedTuple):
    """The equations of a campaign with what links them to campaign and model.

    `places`: for every block (set number, rows). `start`: z at which to begin. `free`: P, shape (size, n_free).
    """

    equations: Equations
    model: ErrorModel
    nuisance: tuple[Nuisance, ...]
    places: tuple[tuple[int, np.ndarray], ...]
    start: np.ndarray
    free: np.ndarray

    @property
    def system(self) -> System:
        """The unknowns and readings."""
        return self.equations.system

    @property
    def engine(self) -> Engine:
        """What computes."""
        return self.equations.engine


def chunk_shape(m: int) -> tuple[int, int]:
    """(number of chunks, chunk length) for m rows, rounded up to a few sizes so that similar campaigns share a program."""
    if m <= CHUNK:  # quarters of powers of two
        step = max(16, int(2 ** np.floor(np.log2(max(m, 1)))) // 4)
        return 1, max(64, int(np.ceil(m / step)) * step)
    chunks = int(np.ceil(m / CHUNK))
    step = max(1, int(2 ** np.floor(np.log2(chunks))) // 4)
    return int(np.ceil(chunks / step)) * step, CHUNK


def _pad(values: np.ndarray, chunks: int, length: int, edge: bool) -> np.ndarray:
    """(width, m) -> (chunks, width, length); filled with the first column (harmless) or zeros (weights)."""
    width, m = values.shape
    fill = np.repeat(values[:, :1], chunks * length - m, axis=1) if edge else np.zeros((width, chunks * length - m))
    full = np.concatenate([values, fill.astype(values.dtype)], axis=1)
    return np.ascontiguousarray(full.reshape(width, chunks, length).transpose(1, 0, 2))


def _block(campaign: Campaign, number: int, group: Extended, weights: np.ndarray) -> Block:
    observations = campaign.sets[number]
    rows = group.rows
    seen = observations.side_by_side.rows_of(rows)
    chunks, length = chunk_shape(len(rows))

    def pad(values: np.ndarray, edge: bool = True) -> Any:
        return _pad(values, chunks, length, edge)

    return Block(
        form=group.form,
        q=pad(seen.positions.T),
        direction=pad(seen.directions.T.astype(float)),
        tool=pad(seen.tool.T),
        reading=pad(observations.readings[rows].T),
        weight=pad(weights[rows].T, edge=False),
        slots=pad(group.slots),
        constants=pad(group.constants),
    )


def with_random_effects(
    campaign: Campaign, starts: dict[Any, float] | None = None, engine: Engine | None = None
) -> Campaign:
    """The campaign with u² of every reading enlarged by effects that are drawn anew for each (`per` = "point")."""
    sets = tuple(
        replace(s, u=np.sqrt(s.u**2 + sum(variance for _, variance in parts))) if parts else s
        for s, parts in zip(campaign.sets, random_effects(campaign, starts, engine), strict=True)
    )
    return replace(campaign, sets=sets)


def random_effects(
    campaign: Campaign, starts: dict[Any, float] | None = None, engine: Engine | None = None
) -> list[list[tuple[Effect, np.ndarray]]]:
    """Per set: every effect that is drawn anew for each reading, with the variance (m, k) it adds."""
    if not any(s.effects for s in campaign.sets):
        return [[] for _ in campaign.sets]
    table = NuisanceTable(starts)
    groups = [groups_of(s, campaign, table) for s in campaign.sets]
    values = np.array([e.start for e in table.entries])
    engine = engine or engine_for_fit(campaign)
    return [
        random_parts(s, campaign.machine, partial(sensitivities_of, engine, s, campaign.machine, own, values))
        for s, own in zip(campaign.sets, groups, strict=True)
    ]


class Prior(NamedTuple):
    """What is known of θ beforehand: pseudo-readings W θ = t with unit variance; `root` W (r, n_parameters), `value` t (r,)."""

    value: np.ndarray
    root: np.ndarray

    def and_smooth(self, root: np.ndarray) -> Prior:
        """With further pseudo-readings, of value 0."""
        return Prior(np.concatenate([self.value, np.zeros(len(root))]), np.vstack([self.root, root]))


def nothing_known(model: ErrorModel) -> Prior:
    """No pseudo-readings."""
    return Prior(np.zeros(0), np.zeros((0, model.n_parameters)))


def _prior_knowledge(
    model: ErrorModel, nuisance: Sequence[Nuisance], prior: Prior | None
) -> tuple[np.ndarray, np.ndarray]:
    """Values t (r,) and root W (r, size) over z, from calibrated nuisance parameters and a prior on θ."""
    n = model.layout.n_coefficients
    start, u = np.array([e.start for e in nuisance]), np.array([e.prior_u for e in nuisance])
    places = np.flatnonzero(np.isfinite(u) & (u > 0))
    root = np.zeros((len(places), n + len(nuisance)))
    root[np.arange(len(places)), n + places] = 1.0 / u[places]
    value = start[places] / u[places]
    if prior is not None and len(prior.root):
        rows = np.pad(prior.root @ model.projection, ((0, 0), (0, len(nuisance))))
        root, value = np.vstack([root, rows]), np.concatenate([value, prior.value])
    return value, root


def build_problem(
    campaign: Campaign,
    model: ErrorModel,
    starts: dict[Any, float] | None = None,
    prior: Prior | None = None,
    table: NuisanceTable | None = None,
    engine: Engine | None = None,
) -> Problem:
    """Problem of a campaign and an error model; `starts`: start values of nuisance parameters by key.

    `table`: nuisance parameters that are there already, of a campaign that this one is a part of. `engine`: by default the one
    that suits a fit of this campaign.
    """
    table = NuisanceTable(starts) if table is None else table
    blocks, places = [], []
    for number, observations in enumerate(campaign.sets):
        for group in groups_of(observations, campaign, table):
            blocks.append(_block(campaign, number, group, 1.0 / observations.u))
            places.append((number, group.rows))
    n = model.layout.n_coefficients
    value, root = _prior_knowledge(model, table.entries, prior)
    system = System(chain_of(campaign.machine), model.layout, len(table.entries), tuple(blocks), value, root)
    equations = (engine or engine_for_fit(campaign)).equations(system)
    start = np.concatenate([np.zeros(n), [e.start for e in table.entries]])
    return Problem(equations, model, tuple(table.entries), tuple(places), start, _free(model, table.entries))


def _free(model: ErrorModel, nuisance: Sequence[Nuisance]) -> np.ndarray:
    """P: columns span what may move, (size, n_free)."""
    unknown = np.array([e.prior_u for e in nuisance]) > 0
    return np.asarray(block_diag(model.parametrisation, np.eye(len(unknown))[:, unknown]))


def with_prior(problem: Problem, prior: Prior) -> Problem:
    """The problem with other prior knowledge of θ, of the same readings."""
    value, root = _prior_knowledge(problem.model, problem.nuisance, prior)
    system = replace(problem.system, prior_value=value, prior_root=root)
    return problem._replace(equations=problem.equations.changed(system))


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
    blocks = []
    for block, (number, rows) in zip(problem.system.blocks, problem.places, strict=True):
        weights = (factors[number] / campaign.sets[number].u)[rows].T
        padded = _pad(weights, block.weight.shape[0], block.weight.shape[2], edge=False)
        blocks.append(replace(block, weight=padded))
    return problem._replace(equations=problem.equations.changed(replace(problem.system, blocks=tuple(blocks))))
