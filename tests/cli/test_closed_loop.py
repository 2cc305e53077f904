"""Closed loop by the real commands: `volid fit`, `volid grid`, the file read back and applied without volid, and what is left."""

import subprocess
import sys

import numpy as np
from exact_chain import ExactMachine, gauge_free, machine_toml, random_truth, tracker_campaign, write_campaign
from support.places import TESTS

from volid.cli import main
from volid.compensation.residual.volume import predict_residual
from volid.io.grid_reader import read_grid
from volid.io.solutions import read_solution

APPLY = TESTS / "support" / "apply_grid.py"
TOOL = (0.0, 0.0, -150.0)


def driven(grid, q, folder):
    """Positions (m, 3), X, Y, Z, that a control with this grid file drives to: by a program that knows nothing of volid."""
    points, out = folder / "points.csv", folder / "driven.csv"
    np.savetxt(points, q, delimiter=",", header="X,Y,Z", comments="", fmt="%.9f")
    command = [sys.executable, "-I", str(APPLY), str(grid), str(points), str(out)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert (done.returncode, done.stderr) == (0, "")
    return np.loadtxt(out, delimiter=",", skiprows=1)


def test_grid_removes_the_deviation_as_predicted(tmp_path, capsys):
    rng = np.random.default_rng(11)
    machine = ExactMachine("w Y' X' b Z (C) t", {"X": (0.0, 1000.0), "Y": (0.0, 600.0), "Z": (-500.0, 0.0)})
    truth = random_truth(machine, rng)
    campaign = tracker_campaign(machine, truth, rng, n_per_station=400)
    manifest = write_campaign(tmp_path / "campaign", campaign, machine_toml(machine), "closed loop", 5.0, rng)
    solution, grid = str(tmp_path / "solution.h5"), str(tmp_path / "grid.csv")
    assert main(["fit", str(manifest), "-o", solution]) == 0
    assert main(["grid", solution, "--type", "L-VOL", "--points", "25", "--tool", "0,0,-150", "-o", grid]) == 0
    assert "REJECTED" not in capsys.readouterr().out

    order = [machine.axes.index(a) for a in "XYZ"]
    low, high = np.array([machine.travel[a] for a in machine.axes]).T
    q = low + rng.random((1000, 3)) * (high - low)
    tool = np.tile(TOOL, (1000, 1))
    command = np.empty_like(q)
    command[:, order] = driven(grid, q[:, order], tmp_path)

    def size(deviation):
        """3-D length with the gauge (a rigid motion of the workpiece frame) removed."""
        return np.linalg.norm(gauge_free(deviation, q, tool, machine=machine)[0], axis=1)

    def remaining(command):
        """Deviation of the exact machine from where it should be when the control drives to `command`, (1000, 3) [mm]."""
        return machine.functional_point(command, tool, truth) - machine.functional_point(q, tool)

    before = size(machine.deviation(q, tool, truth)[:, :3])
    after = size(remaining(command))
    assert after.max() < 0.1 * before.max()
    # the prediction's largest value is one over 512 points, this one over 1000: allow its 95 % interval a third more
    expected = predict_residual(read_solution(solution), read_grid(grid))
    assert expected.interval[0] / 1.33 < after.max() < 1.33 * expected.interval[1]
    assert expected.rms / 1.5 < np.sqrt(np.mean(after**2)) < 1.5 * expected.rms
    # the other sign doubles the deviation: that it goes away is not a matter of luck
    wrong = size(remaining(2 * q - command))
    assert wrong.max() > 1.8 * before.max()


def test_the_program_that_applies_grids_refuses_error_values(tmp_path):
    head = "# type: L-VOL\n# values: error\n# units: X, Y, Z, dX, dY, dZ mm\nX,Y,Z,dX,dY,dZ\n0,0,0,0,0,0\n"
    (tmp_path / "g.csv").write_text(head, encoding="utf-8")
    command = [sys.executable, "-I", str(APPLY), str(tmp_path / "g.csv"), "p.csv", "o.csv"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode == 1
    assert "values error; expected compensation values" in done.stderr
