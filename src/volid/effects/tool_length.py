"""`tool_length`: the tool vector has an unknown error in one or more of its `components` ("Z" by default, "XYZ" for all).

reading = prediction(tool + Σ ξ e_c, …),   u of ξ in mm

Both ends of a reading that has two share ξ, unless `per` = "tool" and their tool vectors differ.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

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
        """One shift for every component of the tool vector that the effect names, at every end."""
        at_ends = (replace(observations, tool=end.tool) for end in observations.ends)
        return [
            ToolShift(3 * i + COMPONENTS.index(letter), slots_of(seen, effect, table, "mm", letter))
            for i, seen in enumerate(at_ends)
            for letter in _letters(effect)
        ]

    def variance(
        self, effect: Effect, observations: ObservationSet, machine: Machine, sensitivity: Sensitivity
    ) -> np.ndarray:
        """Σ (u ∂reading/∂tool)²."""
        by_tool = [sensitivity.by_tool[COMPONENTS.index(letter) :: 3].sum(axis=0) for letter in _letters(effect)]
        return np.asarray(sum((effect.u * s) ** 2 for s in by_tool))


def _letters(effect: Effect) -> str:
    return str(effect.options.get("components", "Z"))


TOOL_LENGTH = ToolLength()
