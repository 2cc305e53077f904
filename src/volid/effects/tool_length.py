"""`tool_length`: the tool vector has an unknown error in one or more of its `components` ("Z" by default, "XYZ" for all).

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
    """A tool vector with an uncertain length or position."""

    name = "tool_length"
    keys: Mapping[str, FileKey] = {"components": Letters()}

    def tool_shifts(self, effect: Effect, observations: ObservationSet, table: NuisanceTable) -> list[ToolShift]:
        """One shift for every component of the tool vector that the effect names."""
        return [
            ToolShift(COMPONENTS.index(letter), slots_of(observations, effect, table, "mm", letter))
            for letter in _letters(effect)
        ]

    def variance(
        self, effect: Effect, observations: ObservationSet, machine: Machine, sensitivity: Sensitivity
    ) -> np.ndarray:
        """Σ (u ∂reading/∂tool)²."""
        by_tool = [sensitivity.by_tool[COMPONENTS.index(letter)] for letter in _letters(effect)]
        return np.asarray(sum((effect.u * s) ** 2 for s in by_tool))


def _letters(effect: Effect) -> str:
    return str(effect.options.get("components", "Z"))


TOOL_LENGTH = ToolLength()
