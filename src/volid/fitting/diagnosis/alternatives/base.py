"""What an alternative declares, and how it is tested: further unknowns with the sensitivities of the readings to them.

The gain of an alternative is the fall of -2 log likelihood when its unknowns are added and u is wrong by a common factor κ ≥ 1
besides. With chi-square χ² of ν degrees of freedom, and χ² - g with the alternative,

    D(χ²) = min over κ ≥ 1 of ν log κ² + χ²/κ²,    gain = D(χ²) - D(χ² - g),

so that an alternative has to explain what a larger u does not. Without it, gain is chi-square distributed with as many degrees of
freedom as there are unknowns. Alternatives compete by the Bayesian information criterion, gain - k log n (Schwarz 1978).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.special import chdtrc, gammaln

from volid.fitting.diagnosis.around import Around

OPEN = 1e-5  # share of a column that the model does not take up: below, the alternative is in the model already
SEEN = 3.0  # standard deviations of an independent part of an estimate from which on it counts for what it does to the outcome
NUMBERS = 20_000_000  # of the sensitivities that are tested at once, 160 MB


@dataclass(frozen=True, eq=False)
class Alternative:
    """Something that may be wrong, with its unknowns.

    `cause`: its sort, such as "drift of a station". `what`: itself, "drift of station S2". `cure`: what to write into which file,
    or what to do. `columns` (n, k): sensitivities of the readings over their u. `outcome` (q, k): what one unit of its unknowns
    does to the numbers of the outcome directly, over their u; None: nothing. `tried`: how many places it was chosen from.
    `readings`: the numbers of those that it concerns, where that helps to cure it. `is_rival`: it explains what another one
    explains already, nearly as well.
    """

    cause: str
    what: str
    cure: str
    columns: np.ndarray
    outcome: np.ndarray | None = None
    tried: float = 1.0
    readings: tuple[int, ...] = ()
    is_rival: bool = False


class Judged(NamedTuple):
    """A tested alternative: `drop` of chi-square, `gain` beyond a larger u, unknowns `k`, `log_probability` (natural) of such a
    gain by chance, estimates `values`, what it does to the outcome in units of u, `change` (q,), and `score`."""

    alternative: Alternative
    drop: float
    gain: float
    k: int
    log_probability: float
    values: np.ndarray
    change: np.ndarray

    @property
    def score(self) -> float:
        """Gain less what its unknowns, and the places it was chosen from, cost."""
        return self.gain - self.cost

    @property
    def cost(self) -> float:
        """k log n, with the number of places that it was chosen from."""
        return self.k * self._log_n + 2.0 * float(np.log(self.alternative.tried))

    @property
    def _log_n(self) -> float:
        return float(np.log(max(len(self.alternative.columns), 2)))


def profile(chi_square: float, freedom: int) -> float:
    """D: -2 log likelihood, best over a common factor κ ≥ 1 of all u."""
    nu = max(freedom, 1)
    square = max(chi_square / nu, 1.0)
    return nu * float(np.log(square)) + chi_square / square


def log_chance(gain: float, k: int) -> float:
    """Natural logarithm of the probability that a chi-square with k degrees of freedom exceeds `gain`."""
    value = float(chdtrc(k, gain))
    if value > 1e-290:
        return float(np.log(value))
    half = 0.5 * gain  # leading term of the expansion for large arguments, DLMF 8.11.2
    return -half + (0.5 * k - 1.0) * float(np.log(half)) - float(gammaln(0.5 * k))


def judged(around: Around, alternatives: Iterable[Alternative]) -> Iterator[Judged]:
    """The alternatives, tested in groups that fit into memory; those that the model holds already are left out."""
    group: list[Alternative] = []
    for alternative in alternatives:
        group.append(alternative)
        if sum(a.columns.shape[1] for a in group) * len(around.v) >= NUMBERS:
            yield from _group(around, group)
            group = []
    if group:
        yield from _group(around, group)


def _group(around: Around, group: list[Alternative]) -> Iterator[Judged]:
    whole = np.concatenate([a.columns for a in group], axis=1)
    reach, pull = whole.T @ around.rows, whole.T @ around.v
    before, place = profile(around.share * around.chi_square, int(around.share * around.freedom)), 0
    for alternative in group:
        own = slice(place, place + alternative.columns.shape[1])
        place = own.stop
        found = _one(around, alternative, reach[own], pull[own], before)
        if found is not None:
            yield found


class _Free(NamedTuple):
    """What the model leaves of an alternative's columns A: `turn` T with TᵀAᵀ(1 - H)A T = diag(`values`), (k, r) and (r,)."""

    turn: np.ndarray
    values: np.ndarray


def _free(columns: np.ndarray, reach: np.ndarray) -> _Free | None:
    """None where the model holds all of it. `reach` (k, r): Aᵀ J L."""
    square = columns.T @ columns
    size = np.sqrt(np.diagonal(square))
    scale = np.where(size > 0.0, 1.0 / np.where(size > 0.0, size, 1.0), 0.0)
    values, vectors = np.linalg.eigh((square - reach @ reach.T) * scale[:, None] * scale)
    kept = values > OPEN
    return _Free(scale[:, None] * vectors[:, kept], values[kept]) if kept.any() else None


def with_unknowns(around: Around, found: Judged) -> Around:
    """The fit around its optimum with the unknowns of an alternative in it: for what explains the rest of a misfit."""
    columns = found.alternative.columns
    reach = columns.T @ around.rows
    free = _free(columns, reach)
    if free is None:
        return around
    more = (columns - around.rows @ reach.T) @ free.turn / np.sqrt(free.values)
    pulled = free.turn.T @ (columns.T @ around.v) / np.sqrt(free.values)
    outcome = replace(around.outcome, rows=np.pad(around.outcome.rows, ((0, 0), (0, more.shape[1]))))
    return replace(
        around,
        rows=np.hstack([around.rows, more]),
        v=around.v - more @ pulled,  # not moreᵀv: with prior knowledge 1 - H is no projection
        outcome=outcome,
        chi_square=around.chi_square - found.drop / around.share,
        freedom=around.freedom - found.k,
    )


def _change(around: Around, alternative: Alternative, reach: np.ndarray, values: np.ndarray) -> np.ndarray:
    """What the outcome would be otherwise, in units of its u (q,)."""
    change = -around.outcome.rows @ (reach.T @ values)
    return np.asarray(change if alternative.outcome is None else change + alternative.outcome @ values)


def _one(around: Around, alternative: Alternative, reach: np.ndarray, pull: np.ndarray, before: float) -> Judged | None:
    free = _free(alternative.columns, reach)
    if free is None:
        return None
    turned = free.turn.T @ pull
    drop = float(np.sum(turned**2 / free.values))
    estimates = free.turn @ (turned / free.values)
    chi, nu, k = around.share * around.chi_square, int(around.share * around.freedom), len(free.values)
    gain = max(before - profile(max(chi - drop, 0.0), nu), 0.0)
    chance = min(log_chance(gain, k) + float(np.log(alternative.tried)), 0.0)
    seen = free.turn @ np.where(turned**2 > SEEN**2 * free.values, turned / free.values, 0.0)
    return Judged(alternative, drop, gain, k, chance, estimates, _change(around, alternative, reach, seen))
