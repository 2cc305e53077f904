"""Tracker campaigns of the exact chain as campaigns of the package, in memory."""

from __future__ import annotations

import numpy as np
from exact_chain import ExactMachine, TrackerCampaign, Truth, random_truth, tracker_campaign

from support.machines import volid_machine
from volid.campaign import Campaign, ObservationSet, Station
from volid.model.machine import Machine


def distance_set(tracker: TrackerCampaign, rows=slice(None), name: str = "volume", **changes) -> ObservationSet:
    """The readings of a virtual tracking interferometer as a set."""
    q = tracker.q[rows]
    direction = np.zeros_like(q) if tracker.direction is None else tracker.direction[rows].astype(float)
    fields = dict(
        name=name,
        kind="distance",
        positions=q,
        directions=direction,
        tool=tracker.tool[rows],
        readings=tracker.distance[rows, None],
        u=tracker.u[rows, None],
        labels={"station": tracker.station[rows], "segment": tracker.segment[rows].astype(str)},
        options={"relative": True, "calibrated_u": 0.0},
        source=f"{name}.csv",
    )
    return ObservationSet(**(fields | changes))


def distance_campaign(
    machine: Machine, tracker: TrackerCampaign, off_by: float | None = 5.0, seed: int = 0
) -> Campaign:
    """Campaign with approximate stations wrong by `off_by` mm per coordinate (None: no approximate stations)."""
    rng = np.random.default_rng(seed)
    stations = []
    for name, position in tracker.station_positions.items():
        wrong = None if off_by is None else tuple((position + off_by * rng.standard_normal(3)).tolist())
        stations.append(Station(name, position=wrong))
    return Campaign(machine, tuple(stations), (distance_set(tracker),), title="virtual")


def simulated(
    exact: ExactMachine,
    seed: int,
    *,
    extra: str = "",
    truth: Truth | None = None,
    waviness: float = 1.0,
    off_by: float | None = 5.0,
    **plan,
) -> tuple[Campaign, Truth, TrackerCampaign]:
    """A campaign of `tracker_campaign(**plan)` on a machine with random errors, and its truth."""
    rng = np.random.default_rng(seed)
    truth = random_truth(exact, rng, waviness=waviness) if truth is None else truth
    tracker = tracker_campaign(exact, truth, rng, **plan)
    return distance_campaign(volid_machine(exact, extra), tracker, off_by, seed), truth, tracker
