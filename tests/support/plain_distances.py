"""Distances from one station with noise and nothing else, for checks of units and shapes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from support.campaign_files import MACHINE
from volid.campaign import Campaign, ObservationSet, Station
from volid.io.machines import parse_machine

VOLUME = np.random.default_rng(1).uniform((0, 0, -500), (1000, 600, 0), (120, 3))
STATION = (-150.0, 80.0, -700.0)


def distances(
    q: np.ndarray,
    station: tuple[float, float, float] = STATION,
    *,
    approximate: tuple[float, float, float] | None = STATION,
    scale: float = 1.0,
    relative: bool = True,
    extra: np.ndarray | float = 0.0,
) -> Campaign:
    """Distances from one station to positions (X, Y, Z) = q, tool 0; `scale` spoils the readings' unit."""
    machine = parse_machine(MACHINE, "machine.toml")
    noise = np.random.default_rng(2).normal(0.0, 0.02, len(q))
    d = np.linalg.norm(q - np.array(station), axis=1) + noise - (80.0 if relative else 0.0) + extra
    readings = ObservationSet(
        name="volume",
        kind="distance",
        positions=q,
        directions=np.zeros((len(q), 3)),
        tool=np.zeros((len(q), 3)),
        readings=scale * d[:, None],
        u=np.full((len(q), 1), 1e-3),
        labels={"station": np.full(len(q), "S"), "segment": np.full(len(q), "1")},
        options={"relative": relative, "calibrated_u": 0.0},
        source="volume.csv",
        rows=np.arange(len(q)) + 2,
    )
    return Campaign(machine, (Station("S", position=approximate),), (readings,))


def moved(campaign: Campaign, scale: float) -> Campaign:
    """The same campaign with axis positions in another unit."""
    readings = campaign.sets[0]
    return replace(campaign, sets=(replace(readings, positions=readings.positions * scale),))
