"""The search for what has changed, among suspects that compete to explain readings that disagree with a solution."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import chdtrc

from volid.fitting.diagnosis.alternatives.ranking import WORTH
from volid.validation.readings.whitened import Whitened
from volid.validation.solutions.function_changes import noncentrality
from volid.validation.suspects import VISIBLE, Suspect

LEVEL = 0.05  # false alarms, of the test of everything and the suspects together
RIVAL = 6.0  # difference of scores up to which two suspects are not told apart: 20 to 1 (Kass and Raftery 1995)
MOST = 4  # changes that are looked for


class Picked(NamedTuple):
    """A suspect with its drop of chi-square beside those picked before, `probability` with all tried counted, and its
    rivals, the nearest first, with their odds against it."""

    suspect: Suspect
    probability: float
    near: tuple[Suspect, ...]
    odds: tuple[float, ...]

    @property
    def rivals(self) -> tuple[str, ...]:
        """Their names."""
        return tuple(s.name for s in self.near)


class _Tried(NamedTuple):
    suspect: Suspect
    probability: float
    score: float


def _rivals(tried: Sequence[_Tried], best: _Tried) -> list[_Tried]:
    """Those that explain it nearly as well as the best, one of every name, the nearest first."""
    near = sorted((t for t in tried if t.score > best.score - RIVAL), key=lambda t: t.score)
    by_name = {t.suspect.name: t for t in near if t.suspect.name != best.suspect.name}
    return sorted(by_name.values(), key=lambda t: -t.score)


class Search:
    """The search for what explains |v|²."""

    def __init__(self, whitened: Whitened, suspects: tuple[Suspect, ...]) -> None:
        self.whitened = whitened
        self.seen = tuple(s for s in suspects if s.columns.shape[1])
        self.suspects = suspects

    @property
    def level(self) -> float:
        """Of one suspect."""
        return 0.5 * LEVEL / max(len(self.seen), 1)

    def span(self, columns: np.ndarray, beside: np.ndarray) -> np.ndarray:
        """Orthonormal basis of what columns (n, k) do to v and the readings see, across `beside` (n, l)."""
        left = self.whitened.free(columns)
        vectors, sizes, _ = np.linalg.svd(left - beside @ (beside.T @ left), full_matrices=False)
        return np.asarray(vectors[:, sizes >= VISIBLE])

    def picked(self, everything: float) -> list[Picked]:
        """Suspects that explain the disagreement, the best first; `everything`: probability of the test of all readings.

        Where that is small the first one need only be better than chance among suspects; else it has to pay for itself.
        """
        found: list[Picked] = []
        beside, worth = np.zeros((len(self.whitened.v), 0)), 0.0
        while len(found) < MOST:
            tried = self._tried(beside, found)
            certain = [t for t in tried if t.probability <= 0.5 * LEVEL and (t.score > 0.0 or not found)]
            if not certain:
                break
            best = max(certain, key=lambda t: t.score)
            if found and best.score < WORTH * worth:
                break
            worth = max(worth, best.score)
            rivals = _rivals(tried, best)
            odds = tuple(float(np.exp(0.5 * min(t.score - best.score, 0.0))) for t in rivals)
            found.append(Picked(best.suspect, best.probability, tuple(t.suspect for t in rivals), odds))
            beside = np.hstack([beside, self.span(best.suspect.columns, beside)])
            if everything > 0.5 * LEVEL:  # one suspect was seen among readings that agree as a whole
                break
        return found

    def _tried(self, beside: np.ndarray, found: Sequence[Picked]) -> list[_Tried]:
        picked = {p.suspect.name for p in found}
        result, log_n = [], float(np.log(max(len(self.whitened.v), 2)))
        for suspect in self.seen:
            basis = self.span(suspect.columns, beside)
            k = basis.shape[1]
            if not k or suspect.name in picked:
                continue
            drop = float(np.sum((basis.T @ self.whitened.v) ** 2))
            chance = min(1.0, float(chdtrc(k, drop)) * len(self.seen))
            result.append(_Tried(suspect, chance, drop - k * log_n))
        return result

    def rest(self, picked: Sequence[Picked]) -> float:
        """Probability of what is left of chi-square."""
        beside = np.zeros((len(self.whitened.v), 0))
        for p in picked:
            beside = np.hstack([beside, self.span(p.suspect.columns, beside)])
        v, freedom = self.whitened.v - beside @ (beside.T @ self.whitened.v), self.whitened.freedom - beside.shape[1]
        return float(chdtrc(freedom, float(v @ v))) if freedom > 0 else np.nan

    def smallest(self) -> dict[str, float]:
        """The size found with a power of 90 %, by name of suspects of the machine that have one number."""
        needed = float(np.sqrt(noncentrality(1, self.level)))
        found: dict[str, float] = {}
        for suspect in (s for s in self.suspects if s.is_one_number):
            found[suspect.name] = np.inf
            if suspect.columns.shape[1]:
                left = float(np.linalg.norm(self.whitened.free(suspect.columns)))
                one, _, _ = suspect.size(np.ones(1), np.zeros((1, 1)))
                found[suspect.name] = abs(one) * needed / left
        return found
