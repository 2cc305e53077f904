"""Campaigns on a machine with waves too short for any smooth function."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from exact_chain import Truth

from support.machines import VERTICAL
from support.trackers import simulated
from volid.campaign import Campaign


def with_waves(
    size: float, period: float, seed: int = 5, pitch: float | None = None, n: int = 400, **plan
) -> tuple[Campaign, Truth]:
    """Waves of a period in EXX [mm]; `pitch`: stated in the machine file."""
    campaign, truth, tracker = simulated(VERTICAL, seed, n_per_station=n, **plan)
    (s,) = campaign.sets
    x = s.positions[:, campaign.machine.index("X")]
    places = np.array([tracker.station_positions[n] for n in tracker.station])
    ray = VERTICAL.functional_point(tracker.q, tracker.tool, truth) - places
    along = (ray / np.linalg.norm(ray, axis=1)[:, None])[:, 0]
    waves = size * np.sin(2.0 * np.pi * x / period + 0.7)
    machine = campaign.machine
    if pitch:
        axes = tuple(replace(a, pitch=pitch) if a.letter == "X" else a for a in machine.axes)
        machine = replace(machine, axes=axes)
    return replace(campaign, machine=machine, sets=(replace(s, readings=s.readings + (waves * along)[:, None]),)), truth
