"""`tool_length`: the tool vector is off by an unknown, in some of its `components` ("Z" by default, "XYZ" for all).

reading = prediction(tool + Σ ξ e_c, …),   u of ξ in mm
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from volid.campaign import Effect, ObservationSet
from volid.effects.base import COMPONENTS, EffectType, FileKey, Letters, Sensitivity, ToolShift, slots_of
from volid.model.machine import Machine
from volid.observations.base import NuisanceTable


class ToolLength(EffectType):
    """A tool vector that is not quite known."""

    name = "tool_length"
    keys: Mapping[str, FileKey] = {"components": Letters()}

    def tool_shifts(self, effect: Effect, observations: ObservationSet, table: NuisanceTable) -> list[ToolShift]:
        """One for every component."""
        return [
            ToolShift(COMPONENTS.index(letter), slots_of(observations, effect, table, "mm", letter))
            for letter in _letters(effect)
        ]

    def variance(
        self, effect: Effect, observations: ObservationSet, machine: Machine, sensitivity: Sensitivity
    ) -> np.ndarray:
        """Σ (u ∂reading/∂tool)²."""
        own = [sensitivity.by_tool[COMPONENTS.index(letter)] for letter in _letters(effect)]
        return np.asarray(sum((effect.u * s) ** 2 for s in own))


def _letters(effect: Effect) -> str:
    return str(effect.options.get("components", "Z"))


TOOL_LENGTH = ToolLength()
