"""Lines over time through surveys, of which some may leave a function or the field undetermined.

A combination with a survey that leaves a value undetermined tells nothing of that value, however well the others know it. So a
line goes through those surveys only that determine all of a function; where these are fewer than two, through all, and what all
of them determine together is tested.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.linalg import null_space

from volid.validation.solutions.function_changes import Combination, is_open
from volid.validation.solutions.shared import Shared
from volid.validation.solutions.volume_change import NOTHING, Volume, VolumeChange, change_in, largest_u, volume_of

LEAST = 2  # surveys that make a line


@dataclass(frozen=True, eq=False)
class Lines:
    """What the combinations of a series are made of. `times` (k,), from the first; `w` (k,): weights of the surveys on a line."""

    shared: Shared
    times: np.ndarray
    w: np.ndarray
    made: dict[bytes, Combination] = field(
        default_factory=dict
    )  # covariances are dear, and functions ask for the same ones

    @classmethod
    def of(cls, shared: Shared, times: np.ndarray) -> Lines:
        """With the inverse of the mean variance of their fields as weights."""
        rows = volume_of(shared.of).rows
        flat = rows.reshape(-1, rows.shape[2])
        return cls(
            shared, times, np.array([1.0 / max(_mean_variance(flat, s.covariance), 1e-300) for s in shared.of.states])
        )

    def determine(self, rows: np.ndarray) -> tuple[int, ...]:
        """Numbers of the surveys that determine all values `rows` (m, n')."""
        return tuple(i for i, c in enumerate(self._alone) if not is_open(c, rows).any())

    @cached_property
    def _alone(self) -> list[Combination]:
        return [Combination(self.shared, a, a) for a in np.eye(len(self.times))]

    def _of(self, weights: np.ndarray, seen: np.ndarray) -> Combination:
        return self.made.setdefault(weights.tobytes() + seen.tobytes(), Combination(self.shared, weights, seen))

    def through(self, rows: np.ndarray) -> tuple[int, ...]:
        """Numbers of the surveys that the line of values `rows` (m, n') goes through."""
        found = self.determine(rows)
        return found if len(found) >= LEAST else tuple(range(len(self.times)))

    def slope(self, who: tuple[int, ...], whole: bool = False) -> Combination:
        """The change along a line through surveys `who`, from the first of them to the last, or over the `whole` span."""
        part = np.zeros(len(self.times))
        part[list(who)] = 1.0
        w, first = part * self.w, 0.0 if whole else self.times[who[0]]
        span = self.times[-1] if whole else self.times[who[-1]] - first
        away = self.times - np.sum(w * self.times) / np.sum(w)
        return self._of(span * w * away / np.sum(w * away**2), (self.times - first) / span)

    def between(self, i: int, j: int) -> Combination:
        """The change from survey i to survey j."""
        weights = np.zeros(len(self.times))
        weights[i], weights[j] = -1.0, 1.0
        return self._of(weights, (np.arange(len(weights)) >= j).astype(float))

    def rests(self, who: tuple[int, ...]) -> list[Combination]:
        """Combinations of surveys `who` that are 0 for every line, two fewer than these."""
        times = self.times[list(who)]
        found = np.zeros((max(len(who) - 2, 0), len(self.times)))
        found[:, list(who)] = null_space(np.stack([np.ones_like(times), times / self.times[-1]])).T
        return [self._of(a, np.abs(a)) for a in found]


def _mean_variance(flat: np.ndarray, covariance: np.ndarray) -> float:
    return float(np.mean(np.sum((flat @ covariance) * flat, axis=1)))


class Fields(NamedTuple):
    """The deviation field over time. `surveys`: those that determine it; `changes`: from the first survey to each other;
    `drift`: along the line, over the whole span; `volume`: where it is looked at."""

    surveys: tuple[int, ...]
    changes: tuple[VolumeChange, ...]
    drift: VolumeChange
    volume: Volume
    line: Lines

    def limit(self, k: float) -> float:
        """k times the largest u of the field of the first survey [mm]; NaN where it does not determine the field."""
        first = self.line.shared.of.states[0].covariance
        return k * largest_u(self.volume, first) if 0 in self.surveys else np.nan


def fields_of(line: Lines) -> Fields:
    """The field of those surveys that determine it, at the tools of these, without what these cannot see."""
    volume = volume_of(line.shared.of)
    who = _seeing(line, volume)
    if LEAST <= len(who) < len(line.times):
        volume = volume_of(line.shared.of.only(who))
        who = _seeing(line, volume)
    drift = change_in(volume, line.slope(who, whole=True)) if len(who) >= LEAST else NOTHING
    changes = tuple(change_in(volume, line.between(0, i)) for i in range(1, len(line.times)))
    return Fields(who, changes, drift, volume, line)


def _seeing(line: Lines, volume: Volume) -> tuple[int, ...]:
    flat = volume.rows.reshape(-1, volume.rows.shape[2])
    return line.determine(flat[np.linalg.norm(flat, axis=1) > 0.0])
