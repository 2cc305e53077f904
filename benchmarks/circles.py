"""Is the u of a circular test true? Simulated ball-bar tests by the exact chain of the tests, judged by the same chain.

python -m benchmarks.circles --seeds 100          # the table, 3 minutes of one processor

The truth is all errors of a good machine (`exact_chain.random_truth`), with reversal of positioning, spikes of 6 to 20 µm,
lags, a socket that is off by 30 µm; one run of each sense, u = 0.3 µm. Squareness and scale are judged by second harmonics
of the noise-free path over full circles, whatever the arc: what waves do to them on an arc is error.
"""

from __future__ import annotations

import argparse
import os
import sys
from dataclasses import replace
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

import numpy as np
from exact_chain import ExactMachine, random_truth
from exact_chain.ball_bar import BallBar, Drives
from support.circles import TRAVEL, bar, bar_test

from volid.standards.circular.evaluation import evaluate_circular

DRIVES = Drives(
    lag={"X": 0.008, "Y": 0.0082, "Z": 0.0079}, spike={"X": (0.02, 0.012), "Y": (-0.006, 0.02), "Z": (0.02, -0.02)}
)
U = 3e-4  # mm
CASES = (  # plane, arc, step of the angle [degrees], waviness of the truth
    ("XY", 360.0, 5.0, 1.0),
    ("XY", 360.0, 2.0, 1.0),
    ("YZ", 220.0, 2.0, 1.0),
    ("ZX", 220.0, 2.0, 1.0),
    ("YZ", 220.0, 5.0, 0.5),
    ("ZX", 220.0, 2.0, 0.5),
    ("ZX", 150.0, 2.0, 0.5),
    ("ZX", 100.0, 2.0, 0.5),
)
TERMS = ("squareness", "scale", "reversal", "lag")


def virtual(seed: int, waviness: float) -> BallBar:
    """A machine with all errors, and a bar whose socket and length are off."""
    rng = np.random.default_rng(seed)
    machine = ExactMachine("w Y' X' b Z (C) t", TRAVEL)
    truth = random_truth(machine, rng, reversal=True, waviness=waviness)
    return replace(bar(truth, machine.structure), off=tuple(rng.uniform(-0.03, 0.03, 3)), length=4e-4)


def differences(case: tuple[str, float, float, float], seed: int) -> np.ndarray:
    """Found less true value, and u, of the terms: (4, 2) [rad, 1, mm, mm]."""
    plane, arc, step, waviness = case
    machine = virtual(seed, waviness)
    test = bar_test(machine, plane, arc, step=step, drives=DRIVES, noise=U, seed=seed)
    found = evaluate_circular(test)
    squareness, scale = machine.harmonics(plane)
    a, b = plane
    true = {
        f"squareness_{plane}": squareness,
        f"scale_{plane}": scale,
        f"B_E{a}{a}": machine.reversal(a),
        f"lag_{plane}": DRIVES.feed / 120.0 * (DRIVES.lag[a] - DRIVES.lag[b]),
    }
    return np.array([(found[s].value - v, 0.5 * found[s].U) for s, v in true.items()])


def line(case: tuple[str, float, float, float], seeds: int) -> str:
    """A row of the table."""
    found = np.array([differences(case, seed) for seed in range(seeds)])
    z, micro = found[:, :, 0] / found[:, :, 1], 1e6
    inside = " | ".join(f"{share:.2f}" for share in np.mean(np.abs(z) < 1.96, axis=0))
    error, u = (micro * np.sqrt(np.mean(found[:, :2, k] ** 2, axis=0)) for k in (0, 1))
    sizes = " | ".join(f"{e:.2f} / {v:.2f}" for e, v in zip(error, u, strict=True))
    return f"| {case[0]}, {case[1]:g}°, {case[2]:g}° | {case[3]:g} | {sizes} | {inside} | {seeds} |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description="Is the u of a circular test true?")
    parser.add_argument("--seeds", type=int, default=100)
    seeds = parser.parse_args().seeds
    print("| plane, arc, step | waviness | squareness: error / u [µrad] | scale: error / u [µm/m] |", end="")
    print(" ".join(f" {term} |" for term in TERMS) + " n |")
    print("|---" * 9 + "|")
    for case in CASES:
        print(line(case, seeds), flush=True)


if __name__ == "__main__":
    main()
