"""Grids that LinuxCNC applies: does what remains equal what was predicted, over many machines and steps of the grid?

python -m benchmarks.volumetric 40             # machines, 2 minutes of one processor

Truth, distances and places come from code apart from the package (`tests/exact_chain`); volid fits them and writes the file of
linuxcnc-hal, which is read and interpolated here apart from volid too (`tests/support/volumetric.py`). That LinuxCNC does so to
1e-6 mm is shown by `tests/linuxcnc/test_volumetric.py`, on the first of these machines.
"""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

import numpy as np
from support.volumetric import TOOL, VirtualMachine, corrections, measured, places, predicted, rms

import volid
from volid.compensation.base import base_of
from volid.compensation.tables.sampling import Sampling

STEPS, POINTS = (12.5, 25.0, 50.0), 30  # mm; places, the same as in the test


def remains(machine: VirtualMachine, step: float) -> tuple[float, ...]:
    """RMS before, after, predicted, its two parts [µm], and where the square of what remains lies among its predicted draws."""
    made = volid.export(
        machine.solution, "linuxcnc-hal", ["L-VOL"], base=base_of(machine.solution, TOOL), sampling=Sampling(step=step)
    )
    grid = next(f.content for f in made.written.files if f.name == "l_vol.grid")
    asked = places(POINTS)
    added = corrections(str(grid))(asked)
    before, after = (rms(machine.without_motion(machine.off(asked, asked + d), asked)) for d in (0.0, added))
    left = predicted(machine, asked, added)
    within = float((left.draws < after).mean())
    return (*(1e3 * v for v in (before, after, left.both, left.interpolation, left.fit)), within)


def row(step: float, found: np.ndarray) -> str:
    """One line of the table, `found` (machines, 6)."""
    before, after, both, interpolation, fit, within = found.T
    ratio = after / both
    means = " | ".join(f"{v.mean():.2f}" for v in (before, after, both, interpolation, fit))
    covered = 100 * ((within > 0.025) & (within < 0.975)).mean()
    square = np.sqrt((after**2).sum() / (both**2).sum())
    near = 100 * (np.abs(ratio - 1.0) < 0.2).mean()
    return f"| {step:g} mm | {means} | {square:.3f} | {ratio.min():.2f} to {ratio.max():.2f} | {near:.0f} % | {covered:.0f} % |"


def main(machines: int) -> None:
    """The table."""
    found: dict[float, list[tuple[float, ...]]] = {step: [] for step in STEPS}
    for seed in range(machines):
        with tempfile.TemporaryDirectory() as folder:
            machine = measured(Path(folder), seed)
        for step in STEPS:
            found[step].append(remains(machine, step))
    print(
        "| step | before | after | predicted | interpolation | fit | all together | each | within 20 % | in its 95 % |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|")
    for step in STEPS:
        print(row(step, np.array(found[step])))


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 40)
