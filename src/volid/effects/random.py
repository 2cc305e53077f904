"""Effects drawn anew for every reading (`per` = "point", repeatability): what they add to its variance, and how they scatter.

Not modelled: correlation between the components of one reading, or between readings taken at one stop, that such an effect makes.
"""

from __future__ import annotations

from functools import partial
from typing import Any, NamedTuple

import numpy as np

from volid.backend.lazy import jax, jit, jnp
from volid.campaign import Effect, ObservationSet
from volid.effects import TYPES
from volid.effects.base import Sensitivity
from volid.effects.distributions import NORMAL
from volid.effects.prediction import Extended, Form, is_random, predict_readings
from volid.model.machine import Machine


@partial(jit, static_argnames=("form",))
def _sensitivities(machine: Machine, form: Form, q: Any, tool: Any, slots: Any, constants: Any) -> tuple[Any, Any]:
    """∂reading/∂q (n_axes, k, m) and ∂reading/∂tool (3, k, m) at the nominal machine."""
    errors = jnp.zeros((6 * (len(machine.axes) + 1), q.shape[1]))

    def readings(q: Any, tool: Any) -> Any:
        return predict_readings(machine, form, q, tuple(tool), errors, slots, constants)

    def along(i: int, n: int) -> Any:
        return jnp.ones_like(q[0]) * (jnp.arange(n) == i)[:, None]

    axes = [jax.jvp(lambda x: readings(x, tool), (q,), (along(i, len(q)),))[1] for i in range(len(q))]
    tools = [jax.jvp(lambda x: readings(q, x), (tool,), (along(i, 3),))[1] for i in range(3)]
    return jnp.stack(axes), jnp.stack(tools)


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
    observations: ObservationSet, machine: Machine, groups: list[Extended], values: np.ndarray
) -> list[tuple[Effect, np.ndarray]]:
    """Every effect of a set that is drawn anew for every reading, with the variance (m, k) it adds."""
    random = [e for e in observations.effects if is_random(e)]
    if not random:
        return []
    sensitivity = Sensitivity(*_all_sensitivities(observations, machine, groups, values))
    return [(e, TYPES[e.type].variance(e, observations, machine, sensitivity)) for e in random]


def _all_sensitivities(
    observations: ObservationSet, machine: Machine, groups: list[Extended], values: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Sensitivities of every row, (n_axes, m, k) and (3, m, k)."""
    k = observations.readings.shape[1]
    by_axis = np.zeros((len(machine.axes), len(observations), k))
    by_tool = np.zeros((3, len(observations), k))
    for group in groups:
        arrays = (observations.positions[group.rows].T, observations.tool[group.rows].T, values[group.slots])
        numbers = [jnp.asarray(a, dtype=float) for a in (*arrays, group.constants)]
        chain = Machine(name="", structure="", axes=machine.axes)
        axes, tools = (np.asarray(s).transpose(0, 2, 1) for s in _sensitivities(chain, group.form, *numbers))
        by_axis[:, group.rows], by_tool[:, group.rows] = axes, tools
    return by_axis, by_tool
