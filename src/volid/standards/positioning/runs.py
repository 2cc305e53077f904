"""Approaches of targets along one axis: deviations by target, direction and run, and ISO 230-2's statistics of each target."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from volid.backend.consent import ask
from volid.exceptions import InputError

UP, DOWN = 0, 1  # places along the second axis of `PositioningRuns.deviations`
WAYS = {1: UP, -1: DOWN}
WAY_NAMES = ("up", "down")


@dataclass(frozen=True, eq=False)
class PositioningRuns:
    """What was measured along or about one axis.

    Args:
        axis: Letter of the axis, or another name of it.
        targets: Commanded positions, rising, shape (t,) [mm or degrees].
        deviations: X_ij = actual - target position, shape (t, 2, n) [as `unit`]: approached in + ("up") first, in - ("down")
            second; NaN where there was no such approach.
        unit: "mm", or "°" for a rotary axis.
        source: Where the readings come from, for messages.
        travel: Ends of the axis's travel [mm or degrees], where they are known.
        are_means: Whether each value is the mean of several approaches, so that nothing is known of their scatter.
        notes: How the readings were read, in whole sentences.

    Raises:
        InputError: shapes differ, fewer than two targets, targets that do not rise, or a target without any approach.

    >>> runs = PositioningRuns("X", np.array([0.0, 100.0]), np.array([[[0.001, 0.002], [0.003, 0.004]]] * 2))
    >>> runs.directions, runs.unit
    ((0, 1), 'mm')
    """

    axis: str
    targets: np.ndarray
    deviations: np.ndarray
    unit: str = "mm"
    source: str = ""
    travel: tuple[float, float] | None = None
    are_means: bool = False
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        where, shape = self.source or f"axis {self.axis}", self.deviations.shape
        if self.targets.ndim != 1 or len(shape) != 3 or shape[:2] != (len(self.targets), 2):
            raise InputError(
                f"{where}: targets of shape {self.targets.shape} and deviations of shape {shape}; expected (t,) and (t, 2, n)"
            )
        if len(self.targets) < 2 or not (np.diff(self.targets) > 0.0).all():
            raise InputError(
                f"{where}: {len(self.targets)} target(s); expected at least two, rising from one to the next"
            )
        empty = ~np.isfinite(self.deviations).any(axis=(1, 2))
        if empty.any():
            raise InputError(
                f"{where}: target {self.targets[int(np.argmax(empty))]:g} was never approached; leave it out"
            )

    @property
    def is_rotary(self) -> bool:
        """Whether positions are angles."""
        return self.unit == "°"

    @property
    def directions(self) -> tuple[int, ...]:
        """Directions in which any target was approached: 0 up, 1 down."""
        return tuple(way for way in (UP, DOWN) if np.isfinite(self.deviations[:, way]).any())

    @property
    def length(self) -> float:
        """From the first target to the last [mm or degrees]."""
        return float(self.targets[-1] - self.targets[0])


class Statistics(NamedTuple):
    """Of every target, leading axes kept: `mean`, `s` (…, t, 2), NaN where unknown; `n` (t, 2) approaches."""

    mean: np.ndarray
    s: np.ndarray
    n: np.ndarray

    @property
    def reversal(self) -> np.ndarray:
        """B_i = mean up - mean down, (…, t)."""
        return np.asarray(self.mean[..., UP] - self.mean[..., DOWN])

    @property
    def both(self) -> np.ndarray:
        """Mean bidirectional deviation (mean up + mean down) / 2, (…, t)."""
        return np.asarray(0.5 * (self.mean[..., UP] + self.mean[..., DOWN]))

    @property
    def repeatability(self) -> np.ndarray:
        """R_i = max(2 s_i up + 2 s_i down + |B_i|, 4 s_i up, 4 s_i down), (…, t)."""
        together = 2.0 * self.s.sum(axis=-1) + np.abs(self.reversal)
        return np.asarray(np.maximum(together, 4.0 * self.s.max(axis=-1)))


def statistics_of(deviations: np.ndarray) -> Statistics:
    """Mean and standard deviation (n - 1) over the approaches, (…, t, 2, n) -> (…, t, 2).

    NaN counts for nothing; s is NaN for fewer than two approaches. ISO 230-2:2014.
    """
    there = np.isfinite(deviations)
    count = there.sum(axis=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.where(there, deviations, 0.0).sum(axis=-1) / count
        apart = np.where(there, deviations - mean[..., None], 0.0)
        s = np.sqrt((apart**2).sum(axis=-1) / np.where(count > 1, count - 1, 0))
    return Statistics(mean, s, count)


class Approaches(NamedTuple):
    """Readings one by one, each (m,): target, direction ±1, run by any name, deviation, and its place in the file, in words."""

    target: np.ndarray
    direction: np.ndarray
    run: Sequence[str]
    deviation: np.ndarray
    where: Sequence[str]


LARGE = {"mm": 1.0, "°": 0.1}  # deviations farther from their median are asked about


def ask_size(runs: PositioningRuns) -> None:
    """Raises `InputError` for deviations that are no machine's, outside `accept_unusual`: of another unit, or another zero."""
    size = float(np.nanmax(np.abs(runs.deviations - np.nanmedian(runs.deviations))))
    if size > LARGE[runs.unit]:
        ask(
            f"{runs.source or runs.axis}: deviations reach {size:.4g} {runs.unit} from their median. Expected actual less target "
            f"position in {runs.unit}, from one zero: was a run set to zero at another place, or read in another unit?"
        )


SAME_TARGET = {"mm": 1e-3, "°": 1e-6}  # positions nearer than this are one target


def arranged(axis: str, found: Approaches, unit: str = "mm", **known: Any) -> PositioningRuns:
    """The runs of readings that stand in any order. `known`: further fields of `PositioningRuns`.

    Raises `InputError` for a direction other than +1 and -1, and for one approach of a target that stands twice.
    """
    targets, index = _targets(found.target, SAME_TARGET[unit])
    runs = {name: i for i, name in enumerate(dict.fromkeys(found.run))}
    deviations = np.full((len(targets), 2, len(runs)), np.nan)
    seen: dict[tuple[int, int, int], str] = {}
    for i, (target, direction, run) in enumerate(zip(index.tolist(), found.direction.tolist(), found.run, strict=True)):
        if direction not in WAYS:
            raise InputError(
                f"{found.where[i]}: the direction of approach is {direction:g}; expected +1 or -1, because ISO 230-2 "
                "evaluates both directions apart"
            )
        place = (target, WAYS[direction], runs[run])
        if place in seen:
            raise InputError(
                f"{found.where[i]}: target {targets[target]:g} approached in {direction:+g} stands a second time in run {run}, "
                f"after {seen[place]}; number the runs"
            )
        seen[place] = found.where[i]
        deviations[place] = found.deviation[i]
    return PositioningRuns(axis, targets, _closed_up(deviations), unit, **known)


def run_numbers(target: np.ndarray, direction: np.ndarray, unit: str) -> list[str]:
    """The run of every reading where none is stated: a target's first, second, … approach in its direction, from 1."""
    index = _targets(target, SAME_TARGET[unit])[1]
    counts: dict[tuple[int, float], int] = {}
    found = []
    for key in zip(index.tolist(), direction.tolist(), strict=True):
        counts[key] = counts.get(key, 0) + 1
        found.append(str(counts[key]))
    return found


def from_means(axis: str, targets: np.ndarray, means: Mapping[int, np.ndarray], **known: Any) -> PositioningRuns:
    """Mean deviations (t,) by direction ±1 as runs of which nothing but the mean is known: E, M and B, but neither R nor A.

    >>> runs = from_means("X", np.array([0.0, 50.0]), {1: np.array([0.0, 0.002]), -1: np.array([0.001, 0.004])})
    >>> runs.deviations.shape, runs.are_means
    ((2, 2, 1), True)
    """
    deviations = np.full((len(targets), 2, 1), np.nan)
    for direction, values in means.items():
        deviations[:, WAYS[direction], 0] = values
    return PositioningRuns(axis, np.asarray(targets, dtype=float), deviations, are_means=True, **known)


def _targets(positions: np.ndarray, tolerance: float) -> tuple[np.ndarray, np.ndarray]:
    """Distinct targets (t,), rising, and the number of each position's target (m,)."""
    order = np.argsort(positions, kind="stable")
    number = np.cumsum(np.diff(positions[order], prepend=positions[order][:1]) > tolerance)
    index = np.empty(len(positions), dtype=np.int64)
    index[order] = number
    first = np.flatnonzero(np.diff(number, prepend=-1))
    return positions[order][first], index


def _closed_up(deviations: np.ndarray) -> np.ndarray:
    """Runs without columns that no direction fills: directions whose runs have numbers of their own share columns.

    A file that numbers the passes there 1, 3, 5, … and back 2, 4, 6, … has five runs of each.
    """
    columns = [deviations[:, way][:, np.isfinite(deviations[:, way]).any(axis=0)] for way in (UP, DOWN)]
    n = max(c.shape[1] for c in columns)
    result = np.full((len(deviations), 2, n), np.nan)
    for way, values in enumerate(columns):
        result[:, way, : values.shape[1]] = values
    return result
