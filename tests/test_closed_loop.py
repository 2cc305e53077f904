"""Closed loop: identify, write the grid, read it back without volid, apply it to the exact machine, and look what is left."""

import csv

import numpy as np
from exact_chain import ExactMachine, gauge_free, machine_toml, random_truth, tracker_campaign, write_campaign
from scipy.interpolate import RegularGridInterpolator

from volid.compensation.grids import linear_grid
from volid.compensation.volume import predict_residual
from volid.fitting.fit import fit
from volid.io import load_campaign
from volid.io.grid_files import save_grid

TOOL = (0.0, 0.0, -150.0)


def read_grid(path):
    """A control's view of the file: comments skipped, compensation values dX, dY, dZ on a regular grid, mm."""
    rows = list(csv.DictReader(line for line in path.read_text().splitlines() if not line.startswith("#")))
    columns = {k: np.array([float(r[k]) for r in rows]) for k in ("X", "Y", "Z", "dX", "dY", "dZ")}
    nodes = [np.unique(columns[a]) for a in "XYZ"]
    table = np.zeros([len(n) for n in nodes] + [3])
    index = tuple(np.searchsorted(n, columns[a]) for n, a in zip(nodes, "XYZ", strict=True))
    table[index] = np.stack([columns["dX"], columns["dY"], columns["dZ"]], axis=1)
    return RegularGridInterpolator(nodes, table)


def remaining(machine, truth, compensation, q, tool):
    """Deviation of the exact machine from the commanded point when the control adds the interpolated values, (m, 3)."""
    order = [machine.axes.index(a) for a in "XYZ"]
    command = q.copy()
    command[:, order] += compensation(q[:, order])
    return machine.functional_point(command, tool, truth) - machine.functional_point(q, tool)


def test_grid_removes_the_deviation_as_predicted(tmp_path):
    rng = np.random.default_rng(11)
    machine = ExactMachine("w Y' X' b Z (C) t", {"X": (0.0, 1000.0), "Y": (0.0, 600.0), "Z": (-500.0, 0.0)})
    truth = random_truth(machine, rng)
    campaign = tracker_campaign(machine, truth, rng, n_per_station=400)
    manifest = write_campaign(tmp_path / "campaign", campaign, machine_toml(machine), "closed loop", 5.0, rng)
    solution = fit(load_campaign(manifest))
    assert not solution.adequacy.rejected
    grid = linear_grid(solution, points=25, tool=TOOL)
    save_grid(grid, solution, tmp_path / "grid.csv")
    compensation = read_grid(tmp_path / "grid.csv")

    low, high = np.array([machine.travel[a] for a in machine.axes]).T
    q = low + rng.random((1000, 3)) * (high - low)
    tool = np.tile(TOOL, (1000, 1))

    def size(deviation):
        """3-D length with the gauge (a rigid motion of the workpiece frame) removed."""
        return np.linalg.norm(gauge_free(deviation, q, tool, machine=machine)[0], axis=1)

    before = size(machine.deviation(q, tool, truth)[:, :3])
    after = size(remaining(machine, truth, compensation, q, tool))
    assert after.max() < 0.1 * before.max()
    # the prediction's largest value is one over 512 points, this one over 1000: allow its 95 % interval a third more
    expected = predict_residual(solution, grid)
    assert expected.interval[0] / 1.33 < after.max() < 1.33 * expected.interval[1]
    assert expected.rms / 1.5 < np.sqrt(np.mean(after**2)) < 1.5 * expected.rms
    # the other sign doubles the deviation: that it goes away is not a matter of luck
    wrong = size(remaining(machine, truth, lambda x: -compensation(x), q, tool))
    assert wrong.max() > 1.8 * before.max()
