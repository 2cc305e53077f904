"""Positioning runs out of a campaign's sets, and what these say of their uncertainty: u of every reading, and effects."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from volid.campaign import Campaign, Effect, ObservationSet
from volid.effects import TYPES
from volid.effects.base import Sensitivity
from volid.effects.distributions import NORMAL, standardised
from volid.effects.environment.reduction import reduced
from volid.effects.prediction import is_random
from volid.exceptions import InputError
from volid.observations import KINDS
from volid.observations.base import NuisanceTable, Positioning
from volid.standards.positioning.runs import Approaches, PositioningRuns, arranged, run_numbers
from volid.standards.positioning.uncertainty import Contribution, Draw
from volid.standards.shared_errors import corrections


class Found(NamedTuple):
    """Runs of one axis with what makes them uncertain."""

    runs: PositioningRuns
    contributions: tuple[Contribution, ...] = ()


def positioning_of(campaign: Campaign, sets: Sequence[str] = ()) -> list[Found]:
    """The runs of every line along, or about, which one axis moves and reads its own positioning.

    Args:
        campaign: A campaign with readings; its environment's corrections are applied.
        sets: Names of sets; none: all.

    Raises:
        InputError: a set of that name is not there, or there is no such line.

    >>> import volid
    >>> found = positioning_of(volid.load_campaign("datasets/published_positioning/campaign.toml"))
    >>> [(f.runs.axis, len(f.runs.targets)) for f in found]
    [('X', 21), ('Z', 14)]
    """
    campaign = reduced(campaign)
    names = [s.name for s in campaign.sets]
    for name in sets:
        if name not in names:
            raise InputError(f"{campaign.source}: there is no set '{name}'; expected one of {', '.join(names)}")
    found = [f for s in campaign.sets if s.name in (sets or names) for f in _of_set(s, campaign)]
    if not found:
        raise InputError(
            f"{campaign.source}, {', '.join(sets) or 'all sets'}: no line is positioning of one axis; expected component X along "
            "X, C about C and the like, or a beam along the one axis that moves"
        )
    return found


def _of_set(observations: ObservationSet, campaign: Campaign) -> Iterator[Found]:
    for line in KINDS[observations.kind].positioning(observations, campaign):
        axis = campaign.machine.axes[line.axis]
        runs = arranged(
            axis.letter,
            approaches := _approaches(observations, line, axis.unit),
            axis.unit,
            source=f"{observations.file_and_set}, line {line.line}",
            travel=axis.travel,
            notes=(
                *_notes(line),
                *corrections(observations, line.rows),
                *_scales(observations, line),
                *campaign.warnings,
            ),
        )
        numbered = approaches._replace(deviation=np.arange(len(line.rows), dtype=float))
        place = arranged(axis.letter, numbered, axis.unit).deviations
        yield Found(runs, tuple(contributions_of_line(observations, campaign, line, place)))


def _approaches(observations: ObservationSet, line: Positioning, unit: str) -> Approaches:
    rows = line.rows
    target, direction = observations.positions[rows, line.axis], observations.directions[rows, line.axis]
    run = observations.labels["run"][rows].astype(str).tolist()
    if len(set(run)) == 1:  # as where nobody numbered them
        run = run_numbers(target, direction, unit)
    return Approaches(target, direction, run, line.deviations, [observations.where(int(i)) for i in rows])


def _notes(line: Positioning) -> tuple[str, ...]:
    if line.zeros == 1:
        return ()
    return (
        f"the instrument was zeroed {line.zeros} times within the runs; every zero is taken as it was read, so that reversal and "
        "repeatability hold for what happened after it",
    )


def _scales(observations: ObservationSet, line: Positioning) -> tuple[str, ...]:
    """That a scale acts on deviations alone, where the set does not say that the travel was counted."""
    scales = [e.name for e in observations.effects if e.type == "scale"]
    counted = KINDS[observations.kind].lengths(observations)[line.rows, 0]
    if (
        not scales
        or abs(line.factor) != 1.0
        or np.ptp(counted) > 0.5 * np.ptp(observations.positions[line.rows, line.axis])
    ):
        return ()
    return (
        f"effect '{scales[0]}' scales the deviations alone, which makes next to no U; say interferometer = true in set "
        f"'{observations.name}' where it is the scale of a travel that was counted",
    )


# ------------------------------------------------------------------------------------------------- what makes it uncertain


def contributions_of_line(
    observations: ObservationSet, campaign: Campaign, line: Positioning, place: np.ndarray
) -> Iterator[Contribution]:
    """What makes the runs of a line uncertain: u of its readings, and effects; not how well the machine repeats.

    `place` (t, 2, n): number of the row in the line, NaN where there is none.
    """
    spread = _Spread(line, np.isfinite(place), np.nan_to_num(place).astype(int))
    u = observations.u[line.rows, 0]
    if np.isfinite(u).all() and u.any():
        yield Contribution("u of the readings", spread.independent(u))
    for effect in observations.effects:
        if (draw := _drawn(effect, observations, campaign, spread)) is not None:
            yield Contribution(f"effect '{effect.name}'", draw)


class _Spread(NamedTuple):
    """Where the rows of a line stand among the runs."""

    line: Positioning
    there: np.ndarray
    row: np.ndarray

    def over(self, values: np.ndarray) -> np.ndarray:
        """Changes of the readings of the line (trials, m) as changes of the deviations (trials, t, 2, n)."""
        return np.asarray(np.where(self.there, self.line.factor * values[:, self.row], 0.0))

    def independent(self, u: np.ndarray, distribution: str = NORMAL, samples: tuple[float, ...] = ()) -> Draw:
        """Each reading by itself, u (m,)."""

        def draw(rng: np.random.Generator, trials: int) -> np.ndarray:
            drawn = standardised(distribution, rng, trials * len(u), samples)
            return self.over(u * drawn.reshape(trials, len(u)))

        return draw


def _drawn(effect: Effect, observations: ObservationSet, campaign: Campaign, spread: _Spread) -> Draw | None:
    """What draws an effect; None for one that does not act on the deviations."""
    samples = tuple(effect.options.get("samples", ()))
    if is_random(effect):
        still = np.zeros(
            (1, *observations.readings.shape)
        )  # axes and tool as they stand: their scatter is the machine's
        n = len(campaign.machine.axes)
        none = Sensitivity(np.repeat(still, n, axis=0), np.repeat(still, 3, axis=0))
        variance = TYPES[effect.type].variance(effect, observations, campaign.machine, none)[spread.line.rows, 0]
        distribution = str(effect.options.get("distribution", NORMAL))
        return spread.independent(np.sqrt(variance), distribution, samples) if variance.any() else None
    table = NuisanceTable()
    terms = TYPES[effect.type].terms(effect, observations, campaign, table)
    rows = spread.line.rows
    parts = [(term.factor[rows, 0], term.slot[rows]) for term in terms if term.factor[rows, 0].any()]
    return partial(_shared, parts, table, samples, spread) if parts else None


def _shared(
    parts: list[tuple[np.ndarray, np.ndarray]],
    table: NuisanceTable,
    samples: tuple[float, ...],
    spread: _Spread,
    rng: np.random.Generator,
    trials: int,
) -> np.ndarray:
    unknowns = np.stack([e.prior_u * standardised(e.distribution, rng, trials, samples) for e in table.entries], axis=1)
    return spread.over(sum((factor * unknowns[:, slot] for factor, slot in parts), np.zeros((trials, 1))))
