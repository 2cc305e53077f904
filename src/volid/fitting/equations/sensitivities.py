"""How readings answer to axis positions and tool vectors: what effects drawn anew for every reading act through."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from volid.campaign import ObservationSet
from volid.effects.prediction import Extended
from volid.fitting.equations.engine import Engine
from volid.model.jacobian import axis_rows
from volid.model.kinematics import chain_of
from volid.model.machine import Machine
from volid.observations import KINDS


class Sensitivities(NamedTuple):
    """∂reading/∂q (ends·n_axes, m, k) and ∂reading/∂tool (ends·3, m, k) of a set at the nominal machine, end by end."""

    by_axis: np.ndarray
    by_tool: np.ndarray


def sensitivities_of(
    engine: Engine, observations: ObservationSet, machine: Machine, groups: list[Extended], values: np.ndarray
) -> Sensitivities:
    """Sensitivities of every row; `values`: of the nuisance parameters that the groups' slots number."""
    k, seen = observations.readings.shape[1], observations.side_by_side
    by_axis = np.zeros((seen.positions.shape[1], len(observations), k))
    by_tool = np.zeros((seen.tool.shape[1], len(observations), k))
    chain = chain_of(machine)
    for group in groups:
        rows = group.rows
        arrays = (seen.positions[rows].T, seen.tool[rows].T, values[group.slots], group.constants)
        axes, tools = engine.sensitivities(chain, group.form, *arrays)
        by_axis[:, rows], by_tool[:, rows] = axes.transpose(0, 2, 1), tools.transpose(0, 2, 1)
    component = KINDS[observations.kind].components(observations)
    if (
        component is not None
    ):  # a deviation is actual less commanded: what an axis does more than commanded is all in it
        moved = axis_rows(machine, observations.positions, observations.tool)
        by_axis[:, :, 0] = moved[np.arange(len(observations)), component].T
    return Sensitivities(by_axis, by_tool)
