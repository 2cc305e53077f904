"""Alternatives in what the campaign says: slips that make most readings contradict the positions, fitted with the whole model."""

from __future__ import annotations

from collections.abc import Iterator

from volid.campaign import Campaign
from volid.fitting.diagnosis.adequacy import HOPELESS
from volid.fitting.diagnosis.alternatives.refits import Other
from volid.fitting.nominal import ROWS, few, nominal_misfit
from volid.plausibility.slips import (
    COLUMNS,
    HAND,
    PATHS,
    READINGS,
    SENSE,
    STATIONS,
    TOOL,
    UNITS,
    slips,
)
from volid.plausibility.slips import (
    ROWS as SHIFTED,
)

GROSS = 5.0  # unit weight from which on a few slips are tried; from `HOPELESS` on all of them
EXPLAINS = 0.2  # unit weight without the slip over that with it, at most
ORDINARY = (SENSE, COLUMNS, TOOL, PATHS, HAND)
SLIPS = (SENSE, COLUMNS, TOOL, PATHS, UNITS, HAND, READINGS, STATIONS, SHIFTED)
_FITTED = 12  # of all slips, those that leave the least of the nominal misfit
_NO_WORSE = 1.5  # nominal misfit of a slip that is worth a fit, over that of the campaign as it stands


def possible_slips(campaign: Campaign, unit_weight: float) -> Iterator[Other]:
    """The campaign without each slip that is worth a fit, the most promising first.

    Below `HOPELESS` those that are ordinary; above it all, after they were tried on the nominal chain.
    """
    if unit_weight < GROSS:
        return
    if unit_weight < HOPELESS:
        for s in slips(campaign):
            if s.cause in ORDINARY:
                yield Other(s.cause, s.what, s.cure, s.campaign, True)
        return
    limit = _NO_WORSE * nominal_misfit(few(campaign, ROWS))
    tried = [(nominal_misfit(few(s.campaign, ROWS), s.scales), i, s) for i, s in enumerate(slips(campaign))]
    promising = sorted(t for t in tried if t[0] <= limit)
    for _, _, s in promising[:_FITTED]:
        yield Other(s.cause, s.what, s.cure, s.campaign, True)
