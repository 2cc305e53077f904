"""`scale`: the reading times an unknown factor, such as an error of the refractive index.

    reading += ξ · length,   u of ξ as a ratio, such as 2e-7

With `components` each of them has a factor of its own, such as the scales of a sensor's axes. A length includes its dead path.
Angles have no scale.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from volid.campaign import Campaign, Effect, ObservationSet
from volid.effects.base import EffectType, FileKey, Letters, Sensitivity, Term, lengths_of, slots_of
from volid.exceptions import InputError
from volid.model.machine import Machine
from volid.observations import KINDS
from volid.observations.base import NuisanceTable


class Scale(EffectType):
    """A common factor of lengths."""

    name = "scale"
    keys: Mapping[str, FileKey] = {"components": Letters()}

    def terms(
        self, effect: Effect, observations: ObservationSet, campaign: Campaign, table: NuisanceTable
    ) -> list[Term]:
        """One factor for the entire reading, or one for each of its `components`."""
        lengths, names = lengths_of(observations), KINDS[observations.kind].readings
        if "components" not in effect.options:
            return [Term(lengths, slots_of(observations, effect, table, "1"))]
        result = []
        for letter in str(effect.options["components"]):
            scaled = np.array([name.upper() == letter for name in names])
            result.append(Term(np.where(scaled, lengths, 0.0), slots_of(observations, effect, table, "1", letter)))
        return result

    def variance(
        self, effect: Effect, observations: ObservationSet, machine: Machine, sensitivity: Sensitivity
    ) -> np.ndarray:
        """(u · length)²."""
        return np.asarray((effect.u * lengths_of(observations)) ** 2)

    def check(self, effect: Effect, observations: ObservationSet) -> None:
        """Raises `InputError` for components that the readings do not have."""
        names = {name.upper() for name in KINDS[observations.kind].readings}
        if not set(str(effect.options.get("components", ""))) <= names:
            raise InputError(
                f"set '{observations.name}', effect '{effect.name}': components = \"{effect.options['components']}\", but a "
                f"'{observations.kind}' reading has {', '.join(sorted(names))}; leave components out to scale the entire reading"
            )


SCALE = Scale()
