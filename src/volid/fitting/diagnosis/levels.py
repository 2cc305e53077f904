"""Whether the positions of a campaign stand close enough to see what the functions do between them.

The smoothness of a function is estimated from the same readings. A function that waves faster than its positions follow one
another looks like one that does not, and its length comes out too long. Where the length that was found is not well above the
distance of neighbouring positions, that may have happened: u between the positions then rests on an assumption that nothing has
tested.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from volid.campaign import Campaign
from volid.model.error_model import MEAN, ErrorModel
from volid.model.iso230 import LINEAR_AXES
from volid.model.machine import Machine

LEAST = 1.5  # lengths per distance of neighbouring positions: below, waves between them may be missed
PHASES = 8  # of a pitch, of which half must be seen
FEWEST = 6  # positions of an axis below which no smoothness can be told from them


class SeenLength(NamedTuple):
    """How closely the positions of `axis` follow one another, against the length over which a function's values stay alike.

    `function`: its symbol. `length`, `gap`: that length and the largest distance of neighbouring positions [mm or degrees].
    `levels`: number of distinct positions. `segment`: of the spline that holds the function [mm or degrees].
    """

    function: str
    axis: str
    length: float
    gap: float
    levels: int
    segment: float

    @property
    def ratio(self) -> float:
        """Lengths per gap."""
        return self.length / self.gap


def seen_lengths(
    levels: Mapping[str, tuple[float, int]], model: ErrorModel, names: Sequence[str], logarithms: Sequence[float]
) -> Iterator[SeenLength]:
    """One entry per function and axis that it depends on; `names` and `logarithms` of the smoothness as a solution has them."""
    for name, value in zip(names, logarithms, strict=True):
        across = name.endswith(" length of change")
        label = name.removesuffix(" length of change").removesuffix(" length")
        if label == name or " " in label:  # sizes; reversal, waves
            continue
        for symbol in label.split("+"):
            splines = model.by_name[symbol, MEAN].splines
            if across and len(splines) < 2:
                continue
            spline = splines[1 if across else 0]
            axis = model.machine.axes[spline.axis]
            gap, count = levels[axis.letter]
            if count > 1:
                segment = (spline.high - spline.low) / spline.segments
                yield SeenLength(symbol, axis.letter, float(np.exp(value)) * axis.length, gap, count, segment)


def levels_of(
    campaign: Campaign, machine: Machine, earlier: Mapping[str, Sequence[float]]
) -> dict[str, tuple[float, int]]:
    """By axis letter, the largest distance of neighbouring positions and their number, of an `earlier` solution where it has
    more.
    """
    found = {a.letter: _levels(campaign, machine, i) for i, a in enumerate(machine.axes)}
    for letter, (gap, count) in earlier.items():
        if letter in found and count > found[letter][1]:
            found[letter] = (float(gap), int(count))
    return found


def _levels(campaign: Campaign, machine: Machine, i: int) -> tuple[float, int]:
    """Largest distance of neighbouring positions of an axis, and the number of these."""
    axis = machine.axes[i]
    positions = campaign.positions[:, i]
    step = 1e-4 * max(axis.length, 1e-300)
    distinct = np.unique(np.round((np.mod(positions, 360.0) if axis.is_full_turn else positions) / step)) * step
    gaps = np.diff(distinct)
    if axis.is_full_turn:
        gaps = np.append(gaps, distinct[0] + 360.0 - distinct[-1])
    return (float(gaps.max()) if len(gaps) else 0.0), len(distinct)


def unseen(lengths: Sequence[SeenLength]) -> tuple[str, ...]:
    """One sentence per axis whose positions are too few or too far apart for the functions found, or whose splines are too
    coarse.
    """
    sentences = []
    for letter in dict.fromkeys(e.axis for e in lengths):
        own = [e for e in lengths if e.axis == letter]
        unit = "mm" if letter in LINEAR_AXES else "°"
        short = [e.function for e in own if e.ratio < LEAST]
        if own[0].levels < FEWEST or short:
            named = f" for {', '.join(short)}" if short and len(short) < len(own) else ""
            sentences.append(
                f"axis {letter} was measured at {own[0].levels} positions, up to {own[0].gap:.4g} {unit} apart: too far to tell "
                f"how smooth its functions are{named}. Between these positions u rests on that and may be too small; "
                "measure closer ones"
            )
        coarse = [e.function for e in own if e.length < LEAST * e.segment and e.function not in short]
        if coarse:
            sentences.append(
                f"{', '.join(coarse)} changes within {min(e.length for e in own):.3g} {unit} of {letter}, which the splines of "
                f"{own[0].segment:.3g} {unit} hardly follow: u does not hold there. State more `segments` for it"
            )
    return tuple(sentences)


def unseen_phases(campaign: Campaign, machine: Machine) -> tuple[str, ...]:
    """One sentence per axis whose positions stand at too few phases of its pitch to tell its waves."""
    sentences = []
    for i, axis in enumerate(machine.axes):
        positions = campaign.positions[:, i]
        if not axis.pitch or np.ptp(positions) < axis.pitch:
            continue
        turned = np.exp(2j * np.pi * positions / axis.pitch)
        phases = len(np.unique(np.round(np.mod(np.angle(turned) / (2.0 * np.pi), 1.0) * PHASES) % PHASES))
        if phases < PHASES // 2:
            sentences.append(
                f"axis {axis.letter} was measured at {phases} of {PHASES} phases of its pitch of {axis.pitch:g} mm: too few "
                "to tell its waves. Measure at other fractions of the pitch, or take `pitch` out"
            )
    return tuple(sentences)
