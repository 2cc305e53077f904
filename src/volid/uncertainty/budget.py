"""Uncertainty budget: which source contributes how much to an output.

With H = Σ_s J_sᵀ J_s over the sources s (whitened readings of a set, pseudo-readings of an effect, a calibrated length, an
earlier solution), the estimate is x = C Σ_s J_sᵀ l_s, C = H⁻¹, so that C = Σ_s C J_sᵀ J_s C: the contributions of independent
sources to u² of any output add up to u². GUM 5.1.2, written for a least-squares adjustment.

A source may have several members with the same u, such as the scales of all stations. The sensitivity of an output to it is then
c = contribution / u, the root sum of squares of the sensitivities to its members.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from volid.backend.rms import rms
from volid.fitting.prediction.deviations import gradient_matrix
from volid.fitting.prediction.spread import linear_uncertainty
from volid.fitting.solution import Solution
from volid.fitting.streamed import check_refittable
from volid.observations import KINDS
from volid.uncertainty.outputs import FIELD, Outputs
from volid.uncertainty.trials.centre import Centre

SMOOTHNESS = "between the positions (smoothness of the functions)"
LACK = "lack of fit (residuals larger than u)"
SCATTER = "independent from position to position (short waves)"
COMPONENTS = ("ex", "ey", "ez", "ea", "eb", "ec")


@dataclass(frozen=True, eq=False)
class Budget:
    """`sources`: names. `covariances`: (s, p, p), share of each source in the covariance of x = (θ, ν).

    `u`, `units`: of each source as stated, where all its members have the same one; NaN and "" otherwise. `factor`: what every u
    of the solution is multiplied by; what that adds is a source of its own.
    """

    sources: tuple[str, ...]
    covariances: np.ndarray
    u: np.ndarray
    units: tuple[str, ...]
    factor: float = 1.0

    def contributions(self, rows: np.ndarray) -> np.ndarray:
        """Standard uncertainty that each source brings to linear outputs `rows` (q, p): (s, q), in the outputs' units."""
        return linear_uncertainty(rows, self.covariances)

    def root_mean_square(self, rows: np.ndarray) -> list[tuple[str, float, float]]:
        """(source, RMS contribution over the outputs `rows`, its share of the variance), largest first."""
        values = rms(self.contributions(rows), axis=1)
        total = max(float(np.sum(values**2)), 1e-300)
        table = [(s, float(v), float(v**2) / total) for s, v in zip(self.sources, values, strict=True)]
        return sorted(table, key=lambda row: -row[1])


class Line(NamedTuple):
    """One source of one output: its contribution to u [mm or rad], and the share of the variance.

    `position`: NaN for what has none. `u_source` in `u_source_unit`: as stated; `sensitivity`: contribution / u_source [unit of
    the output per u_source_unit]; NaN where the source has members of several u.
    """

    output: str
    position: float
    unit: str
    u: float
    source: str
    u_source: float
    u_source_unit: str
    sensitivity: float
    contribution: float
    share: float


class Rows(NamedTuple):
    """Linear outputs of x = (θ, ν): `names`, `positions`, `units` (mm or rad) and `matrix` (q, p).

    `scatter`: (q,), what is independent from position to position and no part of x.
    """

    names: tuple[str, ...]
    positions: np.ndarray
    units: tuple[str, ...]
    matrix: np.ndarray
    scatter: np.ndarray


def headline_rows(solution: Solution, outputs: Outputs) -> Rows:
    """Functions, location errors and the numbers of the deviation field, these linearised at the solution.

    The largest length |e| at its place has the gradient eᵀG/|e|, the RMS over P even points Σ eᵀG/(P·RMS), a range G_max - G_min.
    A component on which no error motion of the model acts is left out: 0 ± 0 would be a claim.
    """
    x = np.concatenate([np.asarray(solution.parameters), np.asarray(solution.nuisance)])
    matrix, scatter = outputs.rows, outputs.scatter
    if len(outputs.field):
        gradient = outputs.field.reshape(-1, 3, len(x))
        e = (outputs.offset + outputs.field @ x).reshape(-1, 3)
        size = np.linalg.norm(e, axis=1)
        along = np.einsum("pk,pkn->pn", e, gradient)
        worst = int(np.argmax(size))
        ends = [gradient[np.argmax(e[:, k]), k] - gradient[np.argmin(e[:, k]), k] for k in range(3)]
        even = slice(outputs.n_even)
        total = outputs.n_even * rms(size[even])
        matrix = np.vstack([matrix, along[worst] / size[worst], along[even].sum(axis=0) / total, *ends])
        own = np.linalg.norm(e * outputs.directions, axis=1)
        mean = float(np.linalg.norm(own[even])) / total
        scatter = np.concatenate([scatter, [own[worst] / size[worst], mean], np.sqrt(2.0) * outputs.directions])
    kept = [i for i, name in enumerate(outputs.names) if name not in FIELD or matrix[i].any() or scatter[i] > 0.0]
    names, units = ([of[i] for i in kept] for of in (outputs.names, outputs.units))
    return Rows(tuple(names), outputs.positions[kept], tuple(units), matrix[kept], scatter[kept])


def point_rows(solution: Solution, positions: np.ndarray, tool: np.ndarray, direction: np.ndarray) -> Rows:
    """The six components of the deviation at m points, named "ex point 1", …; those not determined are left out."""
    theta = np.asarray(solution.parameters)
    gradient = gradient_matrix(solution.model, theta, positions, tool, direction).reshape(6 * len(positions), -1)
    known = solution.evaluate(positions, tool, direction).determined.ravel()
    names = np.array([f"{c} point {i + 1}" for i in range(len(positions)) for c in COMPONENTS])
    units = np.tile(["mm"] * 3 + ["rad"] * 3, len(positions))
    matrix = np.pad(gradient, ((0, 0), (0, len(solution.nuisance_table))))[known]
    scatter = np.tile(solution.scatter_u(), len(positions))[known]
    nowhere = np.full(int(known.sum()), np.nan)
    return Rows(tuple(names[known].tolist()), nowhere, tuple(units[known].tolist()), matrix, scatter)


def budget_lines(found: Budget, rows: Rows) -> Iterator[Line]:
    """Every source of every output, the largest contribution of each output first."""
    values = found.contributions(rows.matrix)
    sources, stated_u, stated_units = list(found.sources), found.u, list(found.units)
    lack = np.sqrt(1.0 - 1.0 / found.factor**2)
    if np.any(rows.scatter > 0.0):
        if lack > 0.0:
            values[sources.index(LACK)] = np.hypot(values[sources.index(LACK)], lack * rows.scatter)
        values = np.vstack([values, rows.scatter / found.factor])
        sources, stated_u, stated_units = [*sources, SCATTER], np.append(stated_u, np.nan), [*stated_units, ""]
    total = np.sqrt(np.sum(values**2, axis=0))
    for q, (name, position, unit) in enumerate(zip(rows.names, rows.positions.tolist(), rows.units, strict=True)):
        for s in np.argsort(-values[:, q], kind="stable").tolist():
            contribution, stated = float(values[s, q]), float(stated_u[s])
            share = float((contribution / total[q]) ** 2) if total[q] > 0.0 else 0.0
            sensitivity = contribution / stated if stated > 0.0 else np.nan
            source, source_unit = sources[s], stated_units[s]
            yield Line(
                name, position, unit, float(total[q]), source, stated, source_unit, sensitivity, contribution, share
            )


def budget(solution: Solution) -> Budget:
    """The budget of a solution: one source per set, per effect, per calibrated length, the earlier solution, the smoothness."""
    check_refittable(solution, "the budget")
    centre = Centre(solution)
    basis, covariance = centre.basis, np.asarray(solution.bare_covariance)
    sources, parts, stated = [], [], []
    system_of_all = centre.problem.system
    bare = replace(system_of_all, prior_root=np.zeros((0, system_of_all.size)), prior_value=np.zeros(0))
    for i, s in enumerate(centre.campaign.sets):
        own = [number == i for number, _ in centre.problem.places]
        system = replace(bare, blocks=tuple(b for b, of_set in zip(system_of_all.blocks, own, strict=True) if of_set))
        normal = centre.engine.equations(system).normal(centre.z)
        matrix = basis.T @ normal.matrix @ basis
        sources.append(f"readings of set '{s.name}'")
        stated.append(_one_u(s.u.ravel(), [part.unit for part in KINDS[s.kind].parts(s)]))
        parts.append(covariance @ matrix @ covariance)
    for name, rows, u in _prior_sources(solution, centre):
        reach = rows @ covariance
        sources.append(name)
        stated.append(u)
        parts.append(
            reach.T @ reach + (solution.smooth_spread @ solution.smooth_spread.T if name == SMOOTHNESS else 0.0)
        )
    if solution.factor > 1.0:
        sources.append(LACK)
        stated.append((float("nan"), ""))
        parts.append((1.0 - 1.0 / solution.factor**2) * np.asarray(solution.covariance))
    numbers, units = np.array([u for u, _ in stated]), tuple(unit for _, unit in stated)
    return Budget(tuple(sources), np.array(parts), numbers, units, solution.factor)


def _one_u(u: np.ndarray, units: list[str]) -> tuple[float, str]:
    """The u that all members of a source share, and its unit; NaN and "" when they differ."""
    same = len(set(units)) == 1 and np.ptp(u) <= 1e-9 * np.max(u)
    return (float(u[0]), units[0]) if same else (float("nan"), "")


def _prior_sources(solution: Solution, centre: Centre) -> list[tuple[str, np.ndarray, tuple[float, str]]]:
    """Name, pseudo-reading rows (r, p) and stated u of every source of prior knowledge."""
    entries = [solution.nuisance_table[j] for j in centre.known]
    names = [f"effect '{e.effect}'" if e.effect else e.name for e in entries]
    rows = centre.prior
    result = []
    for name in dict.fromkeys(names):
        rows_of_kind = [i for i, m in enumerate(names) if m == name]
        u = _one_u(np.array([entries[i].prior_u for i in rows_of_kind]), [entries[i].unit for i in rows_of_kind])
        result.append((name, rows[rows_of_kind], u))
    smooth = len(rows) - len(solution.smooth_rows)
    if smooth > len(names):
        result.append(("earlier solution", rows[len(names) : smooth], (float("nan"), "")))
    if smooth < len(rows):
        result.append((SMOOTHNESS, rows[smooth:], (float("nan"), "")))
    return result
