"""Repeatability of the machine, from readings that come back to one commanded position from the same direction with the same
tool.

Of a reading y of one place g at visit k, with the sensitivity a of the reading to what scatters and the instrument's u,

    y / a = place_g + drift_k + s ε + (u / a) η,     ε, η independent with unit variance,

and with M the projection that takes out places (and drift), E[|M y / a|²] = Σ M_ii (s² + u_i² / a_i²). This gives s² without
bias,
the stated u taken out (a variance component; equal to restricted maximum likelihood where a and u do not vary); what several sets
say is combined by their degrees of freedom at that s. A drift between visits that all places of a line (a station, a segment)
share is a part of `long_term` and not of `s`; one place alone does not show it. ISO 230-2:2014 3.11, 3.12: its s_i of a position
contains instrument and drift, and the RMS of all s_i is `observed`. ISO/TR 16907:2015 8.4.

Attribution: readings of a line along which one axis moves are that axis's, by direction of approach: those of one component under
its symbol ("EXX", "EYX"), lengths along the axis as positioning. All others are the scatter of the functional point, alike in
X, Y
and Z, all axes together. Not modelled: correlation between readings of one visit; repeatability that differs from place to place;
drift within a visit; rotations other than those that are read directly.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from volid.campaign import Campaign, ObservationSet
from volid.effects.prediction import groups_of
from volid.effects.random import random_parts
from volid.effects.repeatability import REPEATABILITY
from volid.fitting.equations.choice import engine_for_readings
from volid.fitting.equations.sensitivities import Sensitivities, sensitivities_of
from volid.fitting.starts import find_starts
from volid.model.iso230 import DIRECTIONS, motion, parse
from volid.observations import KINDS
from volid.observations.base import NuisanceTable
from volid.plausibility.repeats import SAME_POSITION, centres_as_readings, combine, place_labels, visits

FUNCTIONAL_POINT = "functional point"
ALONG = 0.9  # share of a length's squared sensitivity that the moving axis must have
LEAST = 0.05  # sensitivity below which a reading says nothing
COMMON = 0.95  # one-sided, for the upper limit
ROUNDS = 20


@dataclass(frozen=True)
class Repeatability:
    """How well one thing repeats, as a standard deviation of the machine; lengths [mm], rotations [rad].

    Args:
        what: ISO 230-1 symbol of the error motion whose values scatter, or "functional point".
        direction: Approach direction of the axis, +1 (up) or -1 (down); 0: unknown, or of all axes together.
        s: Standard deviation of the machine, the instrument's u and drift between visits taken out; 0 where nothing is seen
            above u.
        u: Standard uncertainty of s.
        lower, upper: One-sided 95 % limits of s, by chi-square, the stated u taken as right; where the readings scatter by
            less than
            that u, so that it is no scatter of theirs, `upper` is that of all that they show.
        degrees_of_freedom: Readings less places less drift.
        long_term: The same with the drift between visits in it.
        observed: What the readings show, instrument and drift included: RMS of ISO 230-2's s_i over the positions.
        instrument: RMS of the readings' stated u, over the same sensitivity.
        drift_apart: Whether drift between visits is out of `s`: not where each line came back to one place only.
        sets: Names of the sets that say so.

    >>> found = Repeatability("EXX", 1, 4e-4, 1e-4, 2e-4, 6e-4, 12.0, 5e-4, 6e-4, 3e-4, True, ("laser",))
    >>> found.label, found.unit
    ('X up', 'mm')
    """

    what: str
    direction: int
    s: float
    u: float
    lower: float
    upper: float
    degrees_of_freedom: float
    long_term: float
    observed: float
    instrument: float
    drift_apart: bool
    sets: tuple[str, ...] = ()

    @property
    def unit(self) -> str:
        """mm, or rad for a rotation."""
        return "mm" if self.what == FUNCTIONAL_POINT else parse(self.what).unit

    @property
    def seen(self) -> bool:
        """Whether the readings scatter by more than the instrument's u explains."""
        return self.lower > 0.0

    @property
    def label(self) -> str:
        """In words: "X up", "EYX down", "functional point"."""
        way = {1: " up", -1: " down", 0: ""}[self.direction]
        if self.what == FUNCTIONAL_POINT:
            return self.what + way
        error = parse(self.what)
        return (error.axis if error.direction == error.axis else self.what) + way


class _Block(NamedTuple):
    """Repeated readings of one line and column, scaled by their sensitivity: y (n,), u² (n,), places and visits (n,), the set."""

    y: np.ndarray
    variance: np.ndarray
    place: np.ndarray
    visit: np.ndarray
    set: str


class _Moments(NamedTuple):
    """Sum of squares of a block and its expectation, f·s² + instrument; without drift first, with it then. `shared`: whether
    drift could be taken out."""

    squares: float
    freedom: float
    instrument: float
    squares_all: float
    freedom_all: float
    instrument_all: float
    shared: bool


def repeatability(campaign: Campaign, outliers: Sequence[np.ndarray] = ()) -> tuple[Repeatability, ...]:
    """Repeatability by axis, component and direction, and that of the functional point, as far as readings come back to a place.

    Args:
        campaign: A campaign with readings.
        outliers: Readings set aside by set, each of shape (m, k), as `Solution.readings` has them; none by default.

    Source: ISO 230-2:2014 3.11; ISO/TR 16907:2015 8.4.

    >>> import volid
    >>> campaign = volid.load_campaign("datasets/vertical_multilateration/campaign.toml")
    >>> [found] = repeatability(campaign)
    >>> found.label, found.degrees_of_freedom > 3, found.s < found.upper < 0.002
    ('functional point', True, True)
    """
    found: dict[tuple[str, int], list[_Block]] = {}
    for key, block in _blocks(campaign if not outliers else _without(campaign, outliers)):
        found.setdefault(key, []).append(block)
    order = sorted(found, key=lambda k: (k[0] == FUNCTIONAL_POINT, k[0][2:], k[0], -k[1]))
    results = (_estimated(what, way, found[what, way]) for what, way in order)
    return tuple(r for r in results if r is not None)


def stated_repeatability(campaign: Campaign) -> dict[str, float]:
    """What the campaign itself states by effects of type "repeatability": the largest by axis letter [mm or degrees]."""
    stated: dict[str, float] = {}
    for effect in (e for s in campaign.sets for e in s.effects if e.type == REPEATABILITY.name):
        for letter, value in REPEATABILITY.by_axis(effect, campaign.machine).items():
            stated[letter] = max(stated.get(letter, 0.0), value)
    return stated


def _without(campaign: Campaign, outliers: Sequence[np.ndarray]) -> Campaign:
    """The campaign without rows that hold a reading set aside."""
    kept = [np.flatnonzero(~o.any(axis=1)) for o in outliers]
    sets = zip(campaign.sets, kept, strict=True)
    return replace(campaign, sets=tuple(s if len(rows) == len(s) else s.rows_of(rows) for s, rows in sets))


# --------------------------------------------------------------------------------------------- which readings, and whose


def _blocks(campaign: Campaign) -> Iterator[tuple[tuple[str, int], _Block]]:
    """Every line's repeated readings, with what scatters in them and the direction of approach."""
    repeated = [(s, *visits(centres_as_readings(s, campaign.machine), campaign.machine)) for s in campaign.sets]
    if all(np.array_equal(place, np.arange(len(s))) for s, place, _ in repeated):
        return
    table = NuisanceTable(find_starts(campaign))
    groups = [groups_of(s, campaign, table) for s in campaign.sets]
    values = np.array([e.start for e in table.entries])
    engine = engine_for_readings(campaign)
    for (observations, place, visit), own in zip(repeated, groups, strict=True):
        counts = np.bincount(place, minlength=len(observations))[place]
        if not (counts > 1).any():
            continue
        ask = partial(sensitivities_of, engine, observations, campaign.machine, own, values)
        yield from _Lines(campaign, observations, ask()).blocks(place, visit, counts > 1)


class _Lines:
    """The lines of one set: rows with the same labels, and what of them scatters."""

    def __init__(self, campaign: Campaign, observations: ObservationSet, sensitivity: Sensitivities) -> None:
        self.machine, self.set = campaign.machine, observations
        self.sensitivity = sensitivity
        self.readings = centres_as_readings(observations, self.machine)
        self.component = KINDS[observations.kind].components(observations)
        self.variance = observations.u**2
        for effect, variance in random_parts(
            observations, self.machine, lambda: (sensitivity.by_axis, sensitivity.by_tool)
        ):
            if effect.type != REPEATABILITY.name:
                self.variance = self.variance + variance

    def blocks(
        self, place: np.ndarray, visit: np.ndarray, repeated: np.ndarray
    ) -> Iterator[tuple[tuple[str, int], _Block]]:
        """Blocks by line, column of the readings, and direction of approach."""
        line = combine([np.zeros(len(self.set)), *place_labels(self.readings).values()])
        for number in np.unique(line[repeated]):
            of_line = np.flatnonzero(line == number)
            axis = self._moving(of_line)
            rows = of_line[repeated[of_line]]
            for column in range(self.readings.readings.shape[1]):
                what, a = self._scatters(rows, column, axis)
                if not what:
                    continue
                ways = np.zeros(len(rows)) if axis is None else self.set.directions[rows, axis]
                for way in np.unique(ways):
                    kept = np.flatnonzero((ways == way) & (a > LEAST))
                    if len(kept):
                        yield (what, int(way)), self._block(rows[kept], column, a[kept], place, visit)

    def _block(self, rows: np.ndarray, column: int, a: np.ndarray, place: np.ndarray, visit: np.ndarray) -> _Block:
        y, variance = self.readings.readings[rows, column] / a, self.variance[rows, column] / a**2
        return _Block(y, variance, place[rows], visit[rows], self.set.name)

    def _moving(self, rows: np.ndarray) -> int | None:
        """The only axis that moves along a line; None where none or several do."""
        positions = np.concatenate([end.positions[rows] for end in self.set.ends])
        limits = np.array([10.0 * SAME_POSITION[axis.is_linear] for axis in self.machine.axes])
        moving = np.flatnonzero(np.ptp(positions, axis=0) > limits)
        return int(moving[0]) if len(moving) == 1 else None

    def _scatters(self, rows: np.ndarray, column: int, axis: int | None) -> tuple[str, np.ndarray]:
        """What scatters in one column of some rows ("" for nothing that is known), and the sensitivity to it (n,)."""
        one = np.ones(len(rows))
        if self.component is not None:
            component = int(self.component[rows[0]])
            if axis is not None:
                return motion(DIRECTIONS[component], self.machine.axes[axis].letter), one
            return (FUNCTIONAL_POINT, one) if component < 3 else ("", one)
        if self.readings is not self.set:  # places themselves
            return FUNCTIONAL_POINT, one
        n = len(self.machine.axes)
        squares = np.array([(self.sensitivity.by_axis[i::n, rows, column] ** 2).sum(axis=0) for i in range(n)])
        linear = np.array([a.is_linear for a in self.machine.axes])
        total = squares[linear].sum(axis=0)
        if axis is not None and linear[axis] and (squares[axis] >= ALONG * total).all():
            letter = self.machine.axes[axis].letter
            return motion(letter, letter), np.sqrt(squares[axis])
        return FUNCTIONAL_POINT, np.sqrt(total)


# ------------------------------------------------------------------------------------------------------------- how much


def _moments(block: _Block) -> _Moments | None:
    """Sums of squares about places, and about places and visits; None where no place of the block was seen twice."""
    place = np.unique(block.place, return_inverse=True)[1]
    counts = np.bincount(place)
    twice = counts[place] > 1
    if not twice.any():
        return None
    y, variance = block.y[twice], block.variance[twice]
    place, visit = (np.unique(v[twice], return_inverse=True)[1] for v in (block.place, block.visit))
    counts = np.bincount(place)

    def centred(values: np.ndarray) -> np.ndarray:
        return np.asarray(values - (np.bincount(place, values) / counts)[place])

    residual, diagonal = centred(y), 1.0 - 1.0 / counts[place]
    columns = np.stack([centred((visit == k).astype(float)) for k in range(1, visit.max() + 1)], axis=1)
    basis = np.zeros((len(y), 0))
    if len(counts) > 1:
        vectors, sizes, _ = np.linalg.svd(columns, full_matrices=False)
        basis = vectors[:, sizes > 1e-9 * max(sizes.max(), 1e-300)]
    if len(y) - len(counts) - basis.shape[1] <= 0:
        basis = np.zeros((len(y), 0))
    along, lost = basis.T @ residual, (basis**2).sum(axis=1)
    return _Moments(
        float(residual @ residual - along @ along),
        float(len(y) - len(counts) - basis.shape[1]),
        float(variance @ (diagonal - lost)),
        float(residual @ residual),
        float(len(y) - len(counts)),
        float(variance @ diagonal),
        basis.shape[1] > 0,
    )


def _estimated(what: str, way: int, blocks: Sequence[_Block]) -> Repeatability | None:
    known = [(m, b) for m, b in ((_moments(b), b) for b in blocks) if m is not None]
    if not known:
        return None
    apart = [(m, b) for m, b in known if m.shared] or known
    table = np.array([m[:6] for m, _ in apart])
    pooled = _pooled(*table[:, :3].T)
    s = float(np.sqrt(max(pooled.s2, 0.0)))
    every = np.array([m[:6] for m, _ in known])
    longer = _pooled(*every[:, 3:].T).s2
    total, counted, instrument = every[:, 3:].sum(axis=0)
    return Repeatability(
        what, way, s, _u_of_root(s, pooled.variance), *pooled.limits(), float(table[:, 1].sum()),
        max(s, float(np.sqrt(max(longer, 0.0)))), float(np.sqrt(total / counted)), float(np.sqrt(instrument / counted)),
        apart[0][0].shared, tuple(dict.fromkeys(b.set for _, b in known)),
    )  # fmt: skip


class _Pooled(NamedTuple):
    """s² of the machine, its variance, and the mean variance of the instrument."""

    s2: float
    variance: float
    instrument: float

    def limits(self) -> tuple[float, float]:
        """One-sided 95 % limits of s: the total s² + instrument is distributed as chi-square over its degrees of freedom."""
        from scipy.special import chdtri  # of the upper tail

        total = max(self.s2 + self.instrument, 0.0)
        if not total > 0.0:
            return 0.0, 0.0
        nu = 2.0 * (max(self.s2, 0.0) + self.instrument) ** 2 / self.variance
        low, high = (nu * total / float(chdtri(nu, p)) for p in (1.0 - COMMON, COMMON))
        most = high - self.instrument if high > self.instrument else high
        return float(np.sqrt(max(low - self.instrument, 0.0))), float(np.sqrt(most))


def _pooled(squares: np.ndarray, freedom: np.ndarray, instrument: np.ndarray) -> _Pooled:
    """s² from blocks weighted by their own variance at that s².

    A block says s² = (squares - instrument) / freedom, with variance 2 (s² + instrument / freedom)² / freedom.
    """
    own, mean = (squares - instrument) / freedom, instrument / freedom
    s2, weight = 0.0, freedom / freedom.sum()
    for _ in range(ROUNDS):
        last, s2 = s2, float(weight @ own)
        variance = np.maximum(2.0 * (max(s2, 0.0) + mean) ** 2 / freedom, 1e-300)
        weight = 1.0 / variance / (1.0 / variance).sum()
        if abs(s2 - last) <= 1e-12 * abs(s2):
            break
    return _Pooled(s2, float(weight**2 @ variance), float(weight @ mean))


def _u_of_root(s: float, variance: float) -> float:
    """u of s from the variance of s²: half of its spread between s² ± u(s²), which holds near 0 too."""
    u2 = np.sqrt(variance)
    return float(0.5 * (np.sqrt(s**2 + u2) - np.sqrt(max(s**2 - u2, 0.0))))
