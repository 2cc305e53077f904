"""Effects drawn anew for every reading (`per` = "point", repeatability): what they add to its variance, and how they scatter.

Not modelled: correlation between the components of one reading, or between readings taken at one stop, that such an effect makes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from volid.campaign import Effect, ObservationSet
from volid.effects.base import COMPONENTS, is_random, lengths_of
from volid.effects.distributions import NORMAL
from volid.model.machine import Machine


class Scatter(NamedTuple):
    """What effects of other than normal distribution add to readings: distribution, its samples, standard deviation (m, k)."""

    distribution: str
    samples: tuple[float, ...]
    deviation: np.ndarray


def split_normal(parts: list[tuple[Effect, np.ndarray]]) -> tuple[Any, list[Scatter]]:
    """Variance (m, k) of all normal parts together (0 for none), and the others one by one."""
    variance: Any = 0.0
    others = []
    for effect, own in parts:
        name = str(effect.options.get("distribution", NORMAL))
        if name == NORMAL:
            variance = variance + own
        else:
            others.append(Scatter(name, tuple(effect.options.get("samples", ())), np.sqrt(own)))
    return variance, others


def random_parts(
    observations: ObservationSet, machine: Machine, sensitivities: Callable[[], tuple[np.ndarray, np.ndarray]]
) -> list[tuple[Effect, np.ndarray]]:
    """Every effect of a set that is drawn anew for every reading, with the variance (m, k) it adds.

    `sensitivities`: gives those of the readings to axis positions (n_axes, m, k) and to the tool vector (3, m, k) when there is
    such an effect.
    """
    random = [e for e in observations.effects if is_random(e)]
    if not random:
        return []
    by_axis, by_tool = sensitivities()
    return [(e, _variance(e, observations, machine, by_axis, by_tool)) for e in random]


def _variance(
    effect: Effect, observations: ObservationSet, machine: Machine, by_axis: np.ndarray, by_tool: np.ndarray
) -> np.ndarray:
    """Variance (m, k) that one effect adds, from the sensitivities to axis positions and tool vector."""
    if effect.type == "repeatability":
        given = effect.options.get("axes")
        scatter = given if isinstance(given, Mapping) else {a.letter: effect.u for a in machine.axes if a.is_linear}
        return np.asarray(sum((float(u) * by_axis[machine.index(letter)]) ** 2 for letter, u in scatter.items()))
    if effect.type == "tool_length":
        letters = str(effect.options.get("components", "Z"))
        return np.asarray(sum((effect.u * by_tool[COMPONENTS.index(letter)]) ** 2 for letter in letters))
    if effect.type == "offset":
        return np.full(observations.readings.shape, effect.u**2)
    expansion = float(effect.options["expansion"]) if effect.type == "temperature" else 1.0
    return np.asarray((effect.u * expansion * lengths_of(observations)) ** 2)
