"""`temperature`: a length that expands with an unknown temperature, and by an expansion that is not quite known.

    reading += expansion · length · ξ,  u of ξ in K;   reading += (temperature - 20 °C) · length · η,  u of η: `u_expansion` [1/K]

`temperature` [°C] from the column of the set, else from the key. The length that expands is the reading less its dead path;
η has a normal distribution. Drawn anew for every reading, only ξ counts. ISO 1 (reference temperature).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from volid.campaign import Campaign, Effect, ObservationSet
from volid.effects.base import EffectType, FileKey, Number, Sensitivity, Term, lengths_of, slots_of, unknown_of
from volid.effects.distributions import NORMAL
from volid.model.machine import Machine
from volid.observations import KINDS
from volid.observations.base import NuisanceTable

REFERENCE_TEMPERATURE = 20.0  # °C, ISO 1
ABSOLUTE_ZERO = -273.15  # °C
EXPANSION = "expansion"


class Temperature(EffectType):
    """Thermal expansion of lengths."""

    name = "temperature"
    keys: Mapping[str, FileKey] = {
        EXPANSION: Number(above=0.0, required=True),
        "u_expansion": Number(least=0.0),
        "temperature": Number(least=ABSOLUTE_ZERO),
    }

    def terms(
        self, effect: Effect, observations: ObservationSet, campaign: Campaign, table: NuisanceTable
    ) -> list[Term]:
        """One for the temperature of every scope, and one for the expansion, which all scopes share."""
        lengths = lengths_of(observations) - KINDS[observations.kind].dead_paths(observations, table.starts)
        factor = float(effect.options[EXPANSION]) * lengths
        terms = [Term(factor, slots_of(observations, effect, table, "K"))]
        u = float(effect.options.get("u_expansion", 0.0))
        if u > 0.0:
            number = unknown_of(table, effect, "", EXPANSION, "1/K", u, NORMAL)
            factor = _above_reference(observations, effect)[:, None] * lengths
            terms.append(Term(factor, np.full(len(observations), number)))
        return terms

    def variance(
        self, effect: Effect, observations: ObservationSet, machine: Machine, sensitivity: Sensitivity
    ) -> np.ndarray:
        """(u · expansion · length)²."""
        return np.asarray((effect.u * float(effect.options[EXPANSION]) * lengths_of(observations)) ** 2)


def _above_reference(observations: ObservationSet, effect: Effect) -> np.ndarray:
    """Temperature minus 20 °C for every row, from the column, else from the key `temperature`."""
    given = float(effect.options.get("temperature", REFERENCE_TEMPERATURE))
    if observations.temperature is None:
        return np.full(len(observations), given - REFERENCE_TEMPERATURE)
    return np.where(np.isnan(observations.temperature), given, observations.temperature) - REFERENCE_TEMPERATURE


TEMPERATURE = Temperature()
