"""`offset`: a constant that all readings of a scope share, for every component of a reading on its own.

reading += ξ,   u of ξ in the reading's unit
"""

from __future__ import annotations

import numpy as np

from volid.campaign import Campaign, Effect, ObservationSet
from volid.effects.base import EffectType, Sensitivity, Term, columns_of, slots_of
from volid.model.machine import Machine
from volid.observations.base import NuisanceTable


class Offset(EffectType):
    """A common constant."""

    name = "offset"

    def terms(
        self, effect: Effect, observations: ObservationSet, campaign: Campaign, table: NuisanceTable
    ) -> list[Term]:
        """1 for every component."""
        return [
            Term(column, slots_of(observations, effect, table, unit, what))
            for column, what, unit in columns_of(observations)
        ]

    def variance(
        self, effect: Effect, observations: ObservationSet, machine: Machine, sensitivity: Sensitivity
    ) -> np.ndarray:
        """u²."""
        return np.full(observations.readings.shape, effect.u**2)


OFFSET = Offset()
