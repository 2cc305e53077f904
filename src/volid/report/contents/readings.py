"""All readings of a solution one after another, with what figures and tables of their residuals ask of each.

A residual is judged against u sqrt(1 - h), where 1 - h is the share of the reading that the others check: a reading which
none checks has a residual of 0 whatever it says.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from volid.campaign import Campaign, ObservationSet
from volid.fitting.diagnosis.robust import critical_value
from volid.fitting.solution import Solution
from volid.fitting.streamed import STREAMED
from volid.observations import KINDS
from volid.report.contents.names import reading_words
from volid.report.language import ENGLISH, Texts

CHECKED = 1e-3  # 1 - h from which on others check a reading
MOST_STRIPS = 30  # sets with their stations, beside each other
MOST_VALUES = 12  # of a label, such as stations, by which a set is divided
WORST = 5  # readings that are named


class Strip(NamedTuple):
    """Readings that belong together: of one set and station (or line, sphere); their name and their numbers (k,)."""

    name: str
    numbers: np.ndarray


@dataclass(frozen=True, eq=False)
class Readings:
    """The n scalar readings of a campaign, set by set, row by row, column by column.

    Args:
        campaign: The campaign.
        set_number: Of every reading, shape (n,).
        row: In its set, from 0, shape (n,).
        column: In its row, shape (n,).
        normalised: residual / (u sqrt(1 - h)), shape (n,).
        redundancy: 1 - h, shape (n,).
        outlier: Whether it was set aside, shape (n,).
        time: Shape (n,) [s]; NaN where it is not recorded.
        positions: Commanded positions of the first functional point, shape (n, n_axes) [mm or degrees].
        all_readings: How many readings the fit used; more than n where they were read part by part and a sample was kept.
        estimated: Names of the sets whose u was estimated from these residuals, so that their RMS is no check of it.

    >>> import volid
    >>> readings = readings_of(volid.fit(volid.load_campaign("datasets/vertical_multilateration/campaign.toml")))
    >>> [strip.name for strip in readings.strips]
    ['S1', 'S2', 'S3', 'S4', 'S5', 'S6']
    """

    campaign: Campaign
    set_number: np.ndarray
    row: np.ndarray
    column: np.ndarray
    normalised: np.ndarray
    redundancy: np.ndarray
    outlier: np.ndarray
    time: np.ndarray
    positions: np.ndarray
    all_readings: int = 0
    estimated: tuple[str, ...] = ()

    @property
    def checked(self) -> np.ndarray:
        """Which readings are checked by others, shape (n,)."""
        return self.redundancy > CHECKED

    @property
    def used(self) -> np.ndarray:
        """Which readings were used in the fit and are checked by others, shape (n,)."""
        return ~self.outlier & self.checked

    @cached_property
    def critical(self) -> float:
        """Critical value of the largest of all normalised residuals."""
        return critical_value(max(self.all_readings, len(self.row)) - int(self.outlier.sum()))

    @cached_property
    def worst(self) -> np.ndarray:
        """Numbers of the readings beyond the critical value or set aside, the largest first, at most `WORST`."""
        return self.beyond[:WORST]

    @cached_property
    def beyond(self) -> np.ndarray:
        """The same, all of them."""
        found = np.flatnonzero(self.checked & (self.outlier | (np.abs(self.normalised) > self.critical)))
        return found[np.argsort(-np.abs(self.normalised[found]), kind="stable")]

    @cached_property
    def strips(self) -> tuple[Strip, ...]:
        """The readings by set, and by station, sphere or line within a set that has several."""
        divided = [strip for i in range(len(self.campaign.sets)) for strip in self._divided(i)]
        if len(divided) <= MOST_STRIPS:
            return tuple(divided)
        return tuple(Strip(s.name, np.flatnonzero(self.set_number == i)) for i, s in enumerate(self.campaign.sets))

    def _divided(self, i: int) -> list[Strip]:
        readings, numbers = self.campaign.sets[i], np.flatnonzero(self.set_number == i)
        label = _dividing(readings)
        if not label:
            return [Strip(readings.name, numbers)]
        values = readings.labels[label][self.row[numbers]]
        prefix = f"{readings.name}, " if len(self.campaign.sets) > 1 else ""
        return [Strip(f"{prefix}{v}", numbers[values == v]) for v in dict.fromkeys(values.tolist())]

    def unit_weight(self, numbers: np.ndarray) -> float:
        """RMS of the residuals over what it is expected to be, sqrt(Σ (residual/u)² / Σ (1 - h)); NaN where none is checked."""
        kept = numbers[~self.outlier[numbers]]
        dof = float(self.redundancy[kept].sum())
        if dof < CHECKED * max(len(kept), 1):
            return float("nan")
        return float(np.sqrt(np.sum(self.normalised[kept] ** 2 * self.redundancy[kept]) / dof))

    def where(self, number: int) -> str:
        """File and row of a reading: "volume.csv, row 412"."""
        return self.campaign.sets[self.set_number[number]].where(int(self.row[number]))

    def label(self, number: int, texts: Texts = ENGLISH) -> str:
        """What a reading belongs to, in words: "station S1"."""
        own = self.campaign.sets[self.set_number[number]]
        return reading_words(own, int(self.row[number]), int(self.column[number]), texts)


def _dividing(readings: ObservationSet) -> str:
    """The label by whose values a set is divided; "" where there is none with several."""
    for label in KINDS[readings.kind].tested_by:
        if 1 < len(set(readings.labels[label].tolist())) <= MOST_VALUES:
            return label
    return ""


def readings_of(solution: Solution) -> Readings:
    """The readings of a solution, with their residuals."""
    sets, found = solution.campaign.sets, solution.readings
    shapes = [s.readings.shape for s in sets]
    where = [np.indices(shape).reshape(2, -1) for shape in shapes]
    u = np.concatenate([s.u.ravel() for s in sets])
    whitened = np.concatenate([r.ravel() for r in found.residuals]) / u
    normalised = np.concatenate([r.ravel() for r in found.normalised])
    share = np.divide(whitened, normalised, out=np.zeros_like(whitened), where=normalised != 0.0)
    return Readings(
        campaign=solution.campaign,
        set_number=np.repeat(np.arange(len(sets)), [m * k for m, k in shapes]),
        row=np.concatenate([w[0] for w in where]),
        column=np.concatenate([w[1] for w in where]),
        normalised=normalised,
        redundancy=share**2,
        outlier=np.concatenate([o.ravel() for o in found.outliers]),
        time=np.concatenate([_times(s) for s in sets]),
        positions=np.concatenate([np.repeat(s.positions, s.readings.shape[1], axis=0) for s in sets]),
        all_readings=int(solution.options.get(STREAMED, solution.campaign.n_readings)),
        estimated=tuple(dict.fromkeys(c.set for c in solution.variance_components if c.is_estimated)),
    )


def _times(readings: ObservationSet) -> np.ndarray:
    time = np.full(len(readings), np.nan) if readings.time is None else readings.time
    return np.repeat(time, readings.readings.shape[1])
