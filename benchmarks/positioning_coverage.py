"""How often U of ISO 230-2's quantities covers what is true of the runs: python -m benchmarks.positioning_coverage [TESTS].

Machines with known means and scatter, five approaches each way of eleven targets over a metre. The instrument's errors are drawn
here, by their own formulas and not by volid's. Also a perfect machine, at which every U is hardest to get right, because each
quantity is 0 and what is shown is the instrument alone.
"""

from __future__ import annotations

import sys

import numpy as np

from volid.standards.positioning import uncertainty
from volid.standards.positioning.conditions import Conditions, contributions_of
from volid.standards.positioning.evaluation import quantities_of
from volid.standards.positioning.runs import PositioningRuns, statistics_of

TARGETS = np.array([0.0, 103.0, 198.0, 305.0, 401.0, 496.0, 603.0, 699.0, 802.0, 897.0, 1000.0])  # mm
SHAPE = (len(TARGETS), 2, 5)
MACHINES = {"scatter 1 µm": (1.0, 1e-3), "scatter 0.2 µm": (1.0, 2e-4), "no scatter": (1.0, 0.0), "perfect": (0.0, 0.0)}
INSTRUMENTS = {
    "noise 0.5 µm": {"noise": 5e-4},
    "scale 1 µm/m, even drift of 1 µm, noise 0.2 µm": {
        "noise": 2e-4,
        "device_scale": 1e-6,
        "drift": 1e-3,
        "drift_form": "linear",
    },
}
SHOWN = ("E", "A", "R", "M", "B", "B_mean")


def machine(size: float, scatter: float, rng: np.random.Generator) -> np.ndarray:
    """True deviations (t, 2, n) [mm]: slope, wave, reversal that grows along the axis, scatter."""
    x = TARGETS[:, None] / 1000.0
    means = 8e-3 * x + 3e-3 * np.sin(5.0 * x) + np.array([0.0, -2e-3]) * (1.0 + 0.5 * x)
    return size * means[:, :, None] + scatter * rng.standard_normal(SHAPE)


def shown(true: np.ndarray, of: dict[str, float], rng: np.random.Generator) -> np.ndarray:
    """What the instrument shows."""
    there = np.arange(len(TARGETS))
    order = np.stack([there, 2 * len(TARGETS) - 1 - there], axis=1)[:, :, None] + 2 * len(TARGETS) * np.arange(5)
    drift = of.get("drift", 0.0) * rng.uniform(-1.0, 1.0) * order / order.max()
    scale = of.get("device_scale", 0.0) * rng.standard_normal() * TARGETS[:, None, None]
    return true + of["noise"] * rng.standard_normal(SHAPE) + scale + drift


def coverage(which: str, instrument: str, tests: int) -> tuple[dict[str, float], dict[str, float]]:
    """Share of tests in which U covers, and mean U [µm], by symbol."""
    rng, of = np.random.default_rng(230), INSTRUMENTS[instrument]
    inside, size = dict.fromkeys(SHOWN, 0), dict.fromkeys(SHOWN, 0.0)
    for test in range(tests):
        true = machine(*MACHINES[which], rng)
        runs = PositioningRuns("X", TARGETS, shown(true, of, rng))
        U = uncertainty.expanded(runs, contributions_of(Conditions(**of), runs), quantities_of, test).U
        right, seen = (quantities_of(statistics_of(d)) for d in (true, runs.deviations))
        for name in SHOWN:
            inside[name] += bool(abs(float(seen[name] - right[name])) <= U[name])
            size[name] += 1e3 * U[name] / tests
    return {name: count / tests for name, count in inside.items()}, size


def main(tests: int = 1000) -> None:
    """Print the table of benchmarks/README.md."""
    uncertainty.TRIALS = 1000
    print("| machine | instrument |", " | ".join(SHOWN), "|")
    print("|---" * (2 + len(SHOWN)) + "|")
    for which in MACHINES:
        for instrument in INSTRUMENTS:
            share, size = coverage(which, instrument, tests)
            cells = " | ".join(f"{100.0 * share[name]:.1f} % ({size[name]:.2f})" for name in SHOWN)
            print(f"| {which} | {instrument} | {cells} |", flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 1000)
