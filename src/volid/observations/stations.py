"""What the kinds with an instrument on a station have in common: the station's place as unknowns, and what it sees nominally."""

from __future__ import annotations

import numpy as np

from volid.campaign import Campaign, ObservationSet, Station
from volid.model.geometry import skew
from volid.model.kinematics import nominal_rotation
from volid.model.machine import TOOL, Machine
from volid.observations.base import NuisanceTable
from volid.observations.response import (
    SEVERAL_TOOLS,
    Key,
    PlaceOf,
    Remainder,
    Rows,
    as_rows,
    remainder,
)


def station_keys(name: str) -> tuple[Key, ...]:
    """Keys of the three coordinates of a station."""
    return tuple(("station", name, c) for c in "XYZ")


def station_slots(
    station: Station, seen: Seen, table: NuisanceTable, start: tuple[float, ...], prior_u: float
) -> list[int]:
    """Numbers of a station's three coordinates in the frame of its body, which they move with."""
    keys = station_keys(station.name)
    return [
        table.index(
            keys[i],
            f"station {station.name} {c}",
            start=start[i],
            prior_u=prior_u,
            response=PlaceOf(station.body, seen.not_followed, keys, i, tool=seen.tool, u=seen.u),
        )
        for i, c in enumerate("XYZ")
    ]


class Seen:
    """How readings from a body answer a constant rotation h of the tool vectors: whether one shift R (h × tool) follows it.

    `tool`: shape (3, 3), what is subtracted from a place on that body. `not_followed`: the part that no place can follow, because
    tool vectors or rotary axes between the two bodies change. `u`: median of the readings' u.
    """

    def __init__(
        self, observations: ObservationSet, campaign: Campaign, rows: np.ndarray, body: str, seen: str
    ) -> None:
        self.tool: Rows = ((0.0,) * 3,) * 3
        self.not_followed: Remainder | None = None
        self.u = float(np.median(observations.u[rows, 0])) if len(rows) else 1.0
        if seen == TOOL and len(rows):
            self._turn(observations, campaign.machine, rows, body)

    def _turn(self, observations: ObservationSet, machine: Machine, rows: np.ndarray, body: str) -> None:
        tools, start, stop = observations.tool[rows], len(machine.axes), machine.body_index(body)
        middle = tools.mean(axis=0)
        if not rotary_motion(machine, observations.positions[rows], start, stop):
            turn = nominal_rotation(machine, observations.positions[rows[:1]], start, stop)[0]
            self.tool = as_rows(turn @ skew(middle))
            tools = tools - middle
        self.not_followed = tool_remainder(tools, self.u)


def rotary_motion(machine: Machine, positions: np.ndarray, start: int, stop: int) -> bool:
    """Whether a rotary axis between two bodies moves over positions (m, n_axes)."""
    between = range(min(start, stop), max(start, stop))
    return any(np.ptp(positions[:, i]) > 0.0 for i in between if not machine.axes[i].is_linear)


def tool_remainder(tools: np.ndarray, u: float) -> Remainder | None:
    """What remains of h × tool for the rows of T (m, 3) [mm]: its mean square is hᵀ (tr M - M) h, M = TᵀT/m."""
    moments = tools.T @ tools / len(tools)
    if np.abs(moments).max() < 1e-12:
        return None
    values, vectors = np.linalg.eigh(np.trace(moments) * np.eye(3) - moments)
    rows = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T
    return remainder(np.pad(rows, ((0, 0), (6, 0))), u / np.sqrt(3.0), SEVERAL_TOOLS)
