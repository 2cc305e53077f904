"""The two published cases of sequential step diagonals on machines that are compensated by them: what remains?

python -m benchmarks.step_diagonals 50         # seeds of every row, 2 minutes of one processor

Truth, rays, planes and places come from code apart from the package (`tests/exact_chain/step_cases.py`); volid reads the table of
readings, separates the nine functions, writes compensation tables, and its simulated control reads them back.
"""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

import numpy as np
from exact_chain.step_cases import CASES, Case, largest_diagonal, truth_of
from support.step_diagonals import compensated, largest_in_volume

ROWS = {  # what the machine has, noise of readings, standard deviation of each mirror's two angles [rad]
    "no rotations, no noise": ({"rotations": False}, False, 0.0),
    "no rotations": ({"rotations": False}, True, 0.0),
    "rotations": ({"rotations": True}, True, 0.0),
    "rotations, mirrors tilted by 10 µrad": ({"rotations": True}, True, 1e-5),
    "rotations, mirrors tilted by 50 µrad": ({"rotations": True}, True, 5e-5),
    "rotations, reversal, mirrors tilted by 10 µrad": ({"rotations": True, "reversal": True}, True, 1e-5),
}


def remains(case: Case, seed: int, row: str) -> tuple[float, ...]:
    """Largest diagonal before and after, longest deviation in the volume before and after [µm]."""
    has, noise, tilt = ROWS[row]
    truth = truth_of(case, seed, **has)
    rng = np.random.default_rng(1000 + seed) if noise or tilt else None
    with tempfile.TemporaryDirectory() as folder:
        control = compensated(Path(folder), case, truth, rng, tilt)
    found = largest_diagonal(case, truth), largest_diagonal(case, truth, control.command)
    return tuple(1e3 * v for v in (*found, largest_in_volume(case, truth), largest_in_volume(case, truth, control)))


def main(seeds: int) -> None:
    """Mean and range over the seeds, as rows of a table in Markdown."""
    print(
        "| box, mm | machine | E_d before | E_d after (published) | volume before | volume after |\n|---|---|---|---|---|---|"
    )
    for case in CASES.values():
        for row in ROWS:
            found = np.array([remains(case, seed, row) for seed in range(seeds)])
            cells = [
                f"{m:.1f} ({a:.1f} … {b:.1f})"
                for m, a, b in zip(found.mean(0), found.min(0), found.max(0), strict=True)
            ]
            before, after, *volume = cells
            print(
                f"| {case.name} | {row} | {before} | {after} ({1e3 * case.after:.1f}) | {' | '.join(volume)} |",
                flush=True,
            )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 50)
