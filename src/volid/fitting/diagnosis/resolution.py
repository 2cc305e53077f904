"""Spline resolution by held-out prediction: how many segments each error function needs and the data can support.

All candidate resolutions of a function are subspaces of one fine spline (knot insertion). Therefore the normal equations of the
fine model, one set per fold, contain all that is needed: for each candidate the fold's readings are predicted from the other
folds by small dense algebra, without another pass over the readings. All readings of one machine position are in the same fold,
so that a held-out point was not seen from any station. K-fold cross-validation: Hastie, Tibshirani and Friedman, 7.10.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag, cho_factor, cho_solve

from volid.campaign import Campaign
from volid.exceptions import InputError
from volid.fitting.diagnosis.hold_out_equations import Part, Projected, Reduced, held_out_chi_square
from volid.fitting.diagnosis.identifiability import ROTATION_UNIT, UNIT, WEAKEST, parameter_units
from volid.fitting.equations.problem import Problem, reweight
from volid.model.error_functions import motion_groups, motion_names, settings_for, spline_axes
from volid.model.error_model import LOCATION, motion_blocks
from volid.model.iso230 import parse
from volid.model.machine import Machine

FINEST = (24, 16, 12, 10, 8, 6, 5, 4, 3, 2, 1)
FULL_TURN = 360.0  # degrees
N_FOLDS = 5
SWEEPS = 3
FIRST = 8  # segments at which the search starts, and that a function keeps without evidence for fewer
NEAR = 3.0  # standard errors of the paired difference that count as evidence

Segments = dict[str, tuple[int, ...]]
_OTHERS = "rest"  # the part of what is no error motion


@dataclass(frozen=True)
class Resolution:
    """Chosen segments per function, the carrier they refine to, and what the choice rests on.

    `score`: held-out chi-square per reading. `weight`: its square root over that of its expectation, 1 for a model that is true;
    NaN when nothing was chosen. `at_limit`: functions that took the finest resolution on offer.
    """

    segments: Segments
    carrier: Segments
    score: float = float("nan")
    weight: float = float("nan")
    at_limit: tuple[str, ...] = ()


def _finest(machine: Machine, name: str, letter: str, n_positions: int) -> int:
    """Finest resolution that the positions support: no more coefficients than positions.

    Along a rotary axis of partial travel it is two fewer. Such an axis is often indexed at a few positions, which the spline
    would otherwise interpolate, and readings held out at the same positions do not show the waves between them.
    """
    degree, axis = settings_for(machine, name).degree or 3, machine.axis(letter)
    spare = 0 if axis.is_linear or axis.length >= FULL_TURN else 2
    return next((n for n in FINEST if n + degree + spare <= n_positions), 1)


def _requested(machine: Machine, name: str) -> tuple[int, ...] | None:
    """Segments stated in the machine file; None for "auto"."""
    settings = settings_for(machine, name)
    letters = spline_axes(machine, name)
    if settings.segments == "auto":
        return None
    stated = (
        settings.segments if isinstance(settings.segments, tuple) else (int(settings.segments or 1),) * len(letters)
    )
    if len(stated) != len(letters):
        raise InputError(f"[model.functions] {name}: segments = {list(stated)} needs one number for each of {letters}")
    return tuple(stated)


def limits(campaign: Campaign, given: Segments | None = None) -> tuple[Segments, set[str]]:
    """Finest resolution of every function (stated, or what the positions carry), and which functions are "auto".

    `given`: resolutions fixed by a prior; they are not chosen again.
    """
    given = given or {}
    machine, counts = campaign.machine, campaign.distinct_positions()
    carrier: Segments = {}
    automatic = set()
    for name in motion_names(machine):
        stated = given.get(name) or _requested(machine, name)
        if stated is not None:
            carrier[name] = stated
            continue
        automatic.add(name)
        letters = spline_axes(machine, name)
        finest = [_finest(machine, name, a, counts[a]) for a in letters]
        carrier[name] = tuple(finest) if len(letters) == 1 else tuple(min(n, 8) if n != 5 else 4 for n in finest)
    return carrier, automatic


def candidates(carrier: tuple[int, ...]) -> list[tuple[int, ...]]:
    """Resolutions that refine to `carrier`, coarsest first."""
    divisors = [[d for d in range(1, n + 1) if n % d == 0] for n in carrier]
    grids = np.meshgrid(*divisors, indexing="ij")
    pairs = {tuple(int(v) for v in row) for row in np.stack([g.ravel() for g in grids], axis=1)}
    return sorted(pairs, key=lambda p: (int(np.prod(p)), p))


def first_guess(carrier: Segments, automatic: set[str]) -> Segments:
    """A middle resolution for the preliminary fit."""
    return {
        name: max((c for c in candidates(fine) if max(c) <= FIRST), key=np.prod) if name in automatic else fine
        for name, fine in carrier.items()
    }


def _folds(campaign: Campaign, rng: np.random.Generator) -> list[np.ndarray]:
    """Fold number (m,) of every row of every set; rows at one machine position share their fold."""
    positions = campaign.positions
    lengths = np.array([axis.length for axis in campaign.machine.axes])
    _, point = np.unique(np.round(positions / (1e-4 * lengths)), axis=0, return_inverse=True)
    point = np.asarray(point).ravel()
    fold = rng.permutation(point.max() + 1) % N_FOLDS
    edges = np.cumsum([len(s) for s in campaign.sets])[:-1]
    return np.split(fold[point], edges)


class _Linear(NamedTuple):
    """Quadratic model of a fold: |y - A z|² = square - 2 vectorᵀz + zᵀ matrix z, z the full unknowns."""

    matrix: np.ndarray
    vector: np.ndarray
    square: float
    n_readings: int


def _fold_equations(problem: Problem, campaign: Campaign, z: np.ndarray, factors: list[np.ndarray]) -> list[_Linear]:
    folds = _folds(campaign, np.random.default_rng(0))
    n = problem.model.layout.n_coefficients
    machine_part = np.concatenate([z[:n], np.zeros(len(z) - n)])
    result = []
    for k in range(N_FOLDS):
        masks = [np.where((f == k)[:, None], w, 0.0) for f, w in zip(folds, factors, strict=True)]
        normal = reweight(problem, campaign, masks).equations.normal(z)
        root = np.asarray(problem.system.prior_root)
        prior = root.T @ root
        offset = z - np.asarray(problem.system.prior_mean)
        matrix = np.asarray(normal.matrix) - prior
        gradient = np.asarray(normal.gradient) - prior @ offset
        square = 2.0 * float(normal.cost) - float(offset @ prior @ offset)
        vector = matrix @ machine_part - gradient
        square += float(machine_part @ matrix @ machine_part - 2.0 * machine_part @ gradient)
        result.append(_Linear(matrix, vector, square, sum(int(np.count_nonzero(m)) for m in masks)))
    return result


class _Search:
    """Coordinate search over the functions' resolutions on the folds' normal equations.

    For one function, all other unknowns are eliminated once per fold (Schur complement); every candidate then costs only
    a solve of its own few coefficients. Unknowns are scaled to their physical units, with a ridge of 1 mm or 1 mrad that
    keeps those that are not determined from disturbing the others.
    """

    def __init__(
        self, problem: Problem, folds: list[_Linear], carrier: Segments, chosen: Segments, automatic: set[str]
    ) -> None:
        self.machine, self.datum = problem.model.machine, problem.model.datum
        self.folds, self.carrier, self.chosen = folds, carrier, dict(chosen)
        self.groups = {g[0]: g for g in motion_groups(self.machine)}
        self.names = [n for n in self.groups if n in automatic and len(candidates(carrier[n])) > 1]
        self.columns = {n: self._columns(problem, group) for n, group in self.groups.items()}
        root = np.asarray(problem.system.prior_root)
        mean = np.asarray(problem.system.prior_mean) * (np.arange(root.shape[1]) < problem.model.layout.n_coefficients)
        prior = root.T @ root
        self.blocks: dict[tuple[str, tuple[int, ...]], np.ndarray] = {}
        self.unchanged = 0  # functions in a row that kept their resolution
        self.equations = Projected(
            np.stack([*(f.matrix for f in folds), prior]), np.stack([*(f.vector for f in folds), prior @ mean])
        )
        self.equations.put(_OTHERS, Part(slice(None), self._others(problem)))
        for name in self.groups:
            self.equations.put(name, self._part(name))

    def _others(self, problem: Problem) -> np.ndarray:
        """Free columns of what is no error motion: location errors and nuisance parameters, scaled."""
        model = problem.model
        places = [f.parameters.start for f in model.functions if f.part == LOCATION]
        scale = parameter_units(model)[places]
        nuisance = problem.free[:, model.n_parameters :]
        size = np.sqrt(np.maximum(np.diagonal(nuisance.T @ sum(f.matrix for f in self.folds) @ nuisance), 1e-300))
        return np.hstack([problem.free[:, places] * scale, nuisance / size])

    def _columns(self, problem: Problem, group: tuple[str, ...]) -> np.ndarray:
        """Coefficients of a group's mean and reversal parts, in the order of its blocks."""
        return np.concatenate(
            [np.arange(f.coefficients.start, f.coefficients.stop) for f in problem.model.functions if f.name in group]
        )

    def block(self, name: str, option: tuple[int, ...]) -> np.ndarray:
        """Scaled free directions of one group of error motions in its own coefficients."""
        if (name, option) not in self.blocks:
            unit = ROTATION_UNIT if parse(name).is_rotation else UNIT
            group = self.groups[name]
            parts = motion_blocks(self.machine, self.datum, group, dict.fromkeys(group, option), self.carrier)
            self.blocks[name, option] = unit * block_diag(*(b.free for b in parts))
        return self.blocks[name, option]

    def _part(self, name: str) -> Part:
        return Part(self.columns[name], self.block(name, self.chosen[name]))

    def sweep(self) -> bool:
        """One pass over the automatic functions, up to where nothing can change any more; True when something changed."""
        changed = False
        for name in self.names:
            if self.unchanged == len(self.names):
                break
            best = self.best(name)
            self.unchanged += 1
            if best != self.chosen[name]:
                changed, self.unchanged = True, 1
                self.chosen.update(dict.fromkeys(self.groups[name], best))
                self.equations.put(name, self._part(name))
        return changed

    def best(self, name: str) -> tuple[int, ...]:
        """Resolution of one function, those of all others kept: the one that predicts best, or a finer one of up to `FIRST`
        intervals that does not predict clearly worse.

        Too coarse a spline is worse than too fine a one, because its bias is not part of the stated uncertainty. With the best
        alone the deviations of three machines were 1.1 to 1.2 standard uncertainties off, with this rule 1.03 to 1.05.
        """
        options = candidates(self.carrier[name])
        scores = self.scores(name, options)
        lowest = int(np.argmin(scores.sum(axis=1)))
        excess = scores - scores[lowest]
        tolerance = NEAR * excess.std(axis=1, ddof=1) * np.sqrt(N_FOLDS)
        near = [int(i) for i in np.flatnonzero(excess.sum(axis=1) <= tolerance) if np.prod(options[i]) <= FIRST]
        return options[max([lowest, *near])]

    def expected(self) -> float:
        """Expectation of the held-out chi-square when the model is true: Σ_k (n_k + tr(H_k C_k)), C_k from the other folds."""
        *matrices, known = self.equations.both
        known = known + WEAKEST**2 * np.eye(len(known))
        total = 0.0
        for fold, matrix in zip(self.folds, matrices, strict=True):
            training = cho_factor(sum(matrices) - matrix + known)
            total += fold.n_readings + float(np.trace(cho_solve(training, matrix)))
        return total

    def scores(self, name: str, options: list[tuple[int, ...]]) -> np.ndarray:
        """Held-out chi-square, shape (options, folds), with `name` at each resolution in turn."""
        equations, columns = self.equations, self.columns[name]
        left, both, right = equations.without(name, columns)
        corner = equations.matrices[:, columns[:, None], columns]
        *reduced, prior = map(Reduced, both, left, corner, right, equations.vectors[:, columns])
        total = Reduced(*(prior[i] + sum(r[i] for r in reduced) for i in range(5)))
        total.oo.flat[:: len(total.oo) + 1] += WEAKEST**2
        blocks = [self.block(name, option) for option in options]
        result = np.empty((len(options), len(self.folds)))
        for k, (fold, held_out) in enumerate(zip(self.folds, reduced, strict=True)):
            training = Reduced(*(t - h for t, h in zip(total, held_out, strict=True)))
            result[:, k] = held_out_chi_square(training, held_out, fold.square, blocks)
        return result


def choose(
    problem: Problem,
    campaign: Campaign,
    z: np.ndarray,
    factors: list[np.ndarray],
    carrier: Segments,
    chosen: Mapping[str, tuple[int, ...]],
    automatic: set[str],
) -> Resolution:
    """Segments per function from a preliminary solution `z` of `problem`, with square-root weights `factors` per set."""
    folds = _fold_equations(problem, campaign, z, factors)
    search = _Search(problem, folds, carrier, dict(chosen), automatic)
    for _ in range(SWEEPS):
        if not search.sweep():
            break
    at_limit = tuple(n for n in search.names if search.chosen[n] == carrier[n])
    count = sum(f.n_readings for f in folds)
    after = search.scores(search.names[0], [search.chosen[search.names[0]]]).sum() / count if search.names else np.nan
    weight = np.sqrt(after * count / search.expected()) if search.names else np.nan
    return Resolution(search.chosen, carrier, float(after), float(weight), at_limit)
