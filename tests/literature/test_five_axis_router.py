"""Touch-probe centres of a real five-axis router: the rigid model is rejected, and the summary says where it fails.

101 centres of one sphere at 76 rotary positions, the control's tool-centre-point function on. Source: repository
alj333/linuxcnc, campaign of 2026-08-27 (not part of this project). Figures from its description: spread 219.6 µm RMS and 709.9 µm
at most, one weight per rotary position; repeatability 11 to 15 µm; rigid models of 13 to 19 parameters leave 153 to 182 µm.
"""

import json

import numpy as np
import pytest
from reference_data import reference_file

from volid.checks import closures
from volid.cli import main
from volid.fitting.holdout import rotary_poses
from volid.io import load_campaign
from volid.io.solution_hdf5 import read_solution
from volid.kinematics import nominal_point

MACHINE = """\
format = "volid-machine/1"
name = "Five-axis router with fork head (C, B)"
structure = "w b X Y Z C B (S) t"
[axis.X]
travel = [0.0, 1500.0]
[axis.Y]
travel = [0.0, 1500.0]
[axis.Z]
travel = [-600.0, 400.0]
[axis.C]
travel = [-5.0, 360.0]
point = [0.0, 0.0, 180.373]
[axis.B]
travel = [-95.0, 95.0]
point = [-0.693, -26.721, 180.373]
[model.functions]
"E??" = false
EB0B = true
"""
MANIFEST = """\
format = "volid-campaign/1"
machine = "machine.toml"
title = "One sphere, 76 rotary positions"
[[set]]
name = "probe"
kind = "displacement"
file = {file}
centres = true
columns = {{ B = "B_deg", C = "C_deg", x = "x_mm", y = "y_mm", z = "z_mm" }}
ignore = ["seq"]
tool = [0.0, 0.0, -229.407]
u = 0.013                          # repeatability of the machine
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("router")
    file = reference_file("five_axis_sphere_centres.csv")
    (path / "machine.toml").write_text(MACHINE)
    (path / "campaign.toml").write_text(MANIFEST.format(file=json.dumps(str(file))))
    return path


def test_centres_spread_and_repeat_as_published(folder):
    campaign = load_campaign(folder / "campaign.toml")
    (readings,) = campaign.sets
    centres = nominal_point(campaign.machine, readings.positions, readings.tool)
    (pose,) = rotary_poses(campaign)
    assert len(readings) == 101 and pose.max() + 1 == 76
    means = np.array([centres[pose == k].mean(axis=0) for k in range(76)])
    spread = np.linalg.norm(means - means.mean(axis=0), axis=1)
    assert np.sqrt(np.mean(spread**2)) == pytest.approx(0.2196, abs=1e-4)
    assert spread.max() == pytest.approx(0.7099, abs=1e-4)
    repeats = closures(campaign)
    assert [c.n for c in repeats] == [25, 25, 25]
    assert 0.009 < np.sqrt(sum(c.rms**2 for c in repeats) / 2) < 0.017  # of one centre, in space


def test_rigid_model_is_rejected_with_where_and_how(folder, capsys):
    assert main(["fit", str(folder / "campaign.toml"), "-o", str(folder / "S.h5")]) == 1
    text = capsys.readouterr().out
    solution = read_solution(folder / "S.h5")
    assert solution.adequacy.rejected and solution.adequacy.unit_weight > 5.0
    assert "MODEL REJECTED BY THE DATA" in text
    worst = solution.adequacy.verdict.split("worst: ")[1]
    assert "region " in worst and "B -95 … -63.3333 °" in worst and "direction " in worst  # region, angle, direction
    residual = np.sqrt(np.mean(np.sum(solution.readings.residuals[0] ** 2, axis=1)))
    assert 0.150 < residual < 0.185  # published: 153 to 182 µm for models of this kind
    held = np.sqrt(np.mean(np.sum(solution.readings.held_out[0] ** 2, axis=1)))
    assert residual < held < 0.2196  # predicts better than no model at all, worse than it retells
    assert "residuals of probe by angle" in text and "held out" in text
    assert text.count("\nB ") >= 6 and text.count("\nC ") >= 8  # a line for every angle


def test_best_location_errors_have_u_and_the_others_are_named(folder):
    solution = read_solution(folder / "S.h5")
    found = {name: solution.location(name) for name in solution.model.names}
    for name in ("EA0B", "EC0B", "EB0B", "EX0B", "EA0C", "EB0C"):
        u = found[name].u * (1.0 if name == "EX0B" else 410.0)  # lever arm pivot to probe [mm]
        assert 0.0005 < u < 0.013, name  # 101 centres of 13 µm: better than one of them
        assert abs(found[name].value) < (1.0 if name == "EX0B" else 2e-3), name  # a machine, not a mistake
    lost = {name for name, row in found.items() if np.isnan(row.value)}
    assert {"EX0C", "EY0C", "EZ0B"} <= lost
    said = " ".join((*solution.statements, *solution.notes))
    assert all(name in said for name in lost)
