"""`repeatability`: axis positions that scatter anew at every reading.

u² += Σ (u_axis ∂reading/∂position)²

`axes` = { X = 0.001, … } gives u_axis by axis letter [mm or degrees]; without it every linear axis has the effect's u [mm].
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
        """Σ (u_axis ∂reading/∂position)²; positions of two ends scatter independently."""
        n, by_axis = len(machine.axes), sensitivity.by_axis
        scatter = self.by_axis(effect, machine)
        variances = [(u * by_axis[machine.index(letter) :: n]) ** 2 for letter, u in scatter.items()]
        return np.asarray(sum((v.sum(axis=0) for v in variances), np.zeros(observations.readings.shape)))

    def by_axis(self, effect: Effect, machine: Machine) -> dict[str, float]:
        """Standard deviation by axis letter [mm or degrees]."""
        given = effect.options.get("axes")
        scatter = given if isinstance(given, Mapping) else {a.letter: effect.u for a in machine.axes if a.is_linear}
        return {letter: float(u) for letter, u in scatter.items()}


REPEATABILITY = Repeatability()
