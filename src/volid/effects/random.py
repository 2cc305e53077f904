"""Effects drawn anew for every reading (`per` = "point", repeatability): what they add to its variance, and how they scatter.

Not modelled: correlation between the components of one reading, or between readings taken at one stop, that such an effect makes.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from volid.campaign import Effect, ObservationSet
from volid.effects import TYPES
from volid.effects.base import Sensitivity
from volid.effects.distributions import NORMAL
from volid.effects.prediction import is_random
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
    for effect, variances in parts:
        name = str(effect.options.get("distribution", NORMAL))
        if name == NORMAL:
            variance = variance + variances
        else:
            others.append(Scatter(name, tuple(effect.options.get("samples", ())), np.sqrt(variances)))
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
    sensitivity = Sensitivity(*sensitivities())
    return [(e, TYPES[e.type].variance(e, observations, machine, sensitivity)) for e in random]
