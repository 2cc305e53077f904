"""`repeatability`: axis positions that scatter anew at every reading; u in mm for linear axes, or of the axes named.

u² += Σ (u_axis ∂reading/∂position)²,   `axes` = { X = 0.001, … }, else every linear axis with u
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from volid.campaign import Effect, ObservationSet
from volid.effects.base import EffectType, FileKey, PerAxis, Sensitivity
from volid.model.machine import Machine


class Repeatability(EffectType):
    """Scatter of positioning."""

    name = "repeatability"
    keys: Mapping[str, FileKey] = {"axes": PerAxis()}
    always_random = True

    def variance(
        self, effect: Effect, observations: ObservationSet, machine: Machine, sensitivity: Sensitivity
    ) -> np.ndarray:
        """Σ (u_axis ∂reading/∂position)²."""
        given = effect.options.get("axes")
        scatter = given if isinstance(given, Mapping) else {a.letter: effect.u for a in machine.axes if a.is_linear}
        own = [(float(u) * sensitivity.by_axis[machine.index(letter)]) ** 2 for letter, u in scatter.items()]
        return np.asarray(sum(own, np.zeros(observations.readings.shape)))


REPEATABILITY = Repeatability()
