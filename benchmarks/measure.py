"""Timing: repeats of all contestants in turn, so that whatever else the machine does hits all alike; limits; memory."""

from __future__ import annotations

import os
import resource
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

REPEATS = 5
TURN = 0.3  # seconds of every contestant per round, at least
PATIENCE = 15.0  # seconds that one run of a contestant may take to be repeated in every round; slower ones run twice


@dataclass
class Row:
    """One line of the table: seconds of volid and of every peer (median), ratios to volid with their spread, the limit."""

    case: str
    volid: float
    peers: dict[str, float] = field(default_factory=dict)
    ratios: dict[str, tuple[float, float, float]] = field(default_factory=dict)
    limit: float | None = None
    limit_of: str = ""
    memory_mb: float | None = None
    start_up: dict[str, float] = field(default_factory=dict)
    accuracy: dict[str, float] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    def as_json(self) -> dict[str, Any]:
        """Plain numbers."""
        return asdict(self) | {"share_of_limit": None if self.limit is None else self.limit / self.volid}


def interleaved(
    contestants: dict[str, Callable[[], Any]], repeats: int = REPEATS, patience: float = PATIENCE
) -> dict[str, np.ndarray]:
    """Seconds per run of every contestant in every round, after one round that warms up; very slow ones in the first alone."""
    times: dict[str, list[float]] = {name: [] for name in contestants}
    slow: set[str] = set()
    for number in range(repeats + 1):
        for name, run in contestants.items():
            if name in slow and number > 1:
                continue
            spent = _turn(run)
            if number:  # the first round compiles
                times[name].append(spent)
                if spent > patience:
                    slow.add(name)
    return {name: np.array(t) for name, t in times.items()}


def _turn(run: Callable[[], Any]) -> float:
    """Seconds per run: one that takes long, or as many as fill `TURN`, since the first ones after another contestant find a
    processor whose caches hold something else."""
    began, runs = time.perf_counter(), 0
    while not runs or time.perf_counter() - began < TURN:
        run()
        runs += 1
    return (time.perf_counter() - began) / runs


def row(case: str, times: dict[str, np.ndarray], limit: str | None = None, **more: Any) -> Row:
    """A line from rounds: ratio of every peer to volid round by round, its median and its range."""
    own = times["volid"]
    others = {n: t for n, t in times.items() if n not in ("volid", limit)}
    ratios = {}
    for name, t in others.items():
        r = t / own[: len(t)]  # round by round
        ratios[name] = (float(np.median(r)), float(r.min()), float(r.max()))
    bound = float(np.median(times[limit])) if limit else None
    return Row(
        case, float(np.median(own)), {n: float(np.median(t)) for n, t in others.items()}, ratios, bound, limit or "",
        peak_memory(), **more,
    )  # fmt: skip


def peak_memory() -> float:
    """Largest resident memory of this process so far [MB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def load() -> list[float]:
    """Load averages of the machine: what else was running."""
    return [round(v, 2) for v in os.getloadavg()]
