"""Runs of a line: one offset for all of them, or one each where the instrument was zeroed anew."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.hdf5_files import changed
from support.kinds import machine_of, plan_set

from volid.campaign import Alignment, Campaign, ObservationSet
from volid.exceptions import InputError
from volid.fitting.fit import fit
from volid.io import load_campaign, write_campaign, write_manifest
from volid.observations.component import COMPONENT

MACHINE = """format = "volid-machine/1"
name = "laser on X"
structure = "w b X Y Z t"
[axis.X]
travel = [0.0, 400.0]
[axis.Y]
travel = [0.0, 300.0]
[axis.Z]
travel = [-200.0, 0.0]
[model]
segments = 1
degree = 1
[model.functions]
"*" = false
EXX = { segments = 1, reversal = true }
"""
STRAIGHT = MACHINE.replace("EXX = { segments = 1, reversal = true }", "EYX = { segments = 4 }").replace(
    "degree = 1", ""
)
X = np.linspace(0.0, 400.0, 9)
SLOPE, REVERSAL, ZEROS = 25e-6, 0.003, (0.4, -0.7, 0.1)
U = 5e-4


def laser(zeros, **options) -> ObservationSet:
    """Three runs forward and back: E(x, ±) = 25 µm/m · (x - 200) ± 1.5 µm, and the zero of the run."""
    machine, m = machine_of(MACHINE), 2 * len(X)
    q = np.zeros((3 * m, 3))
    q[:, machine.index("X")] = np.tile(np.concatenate([X, X[::-1]]), 3)
    way = np.zeros_like(q)
    way[:, machine.index("X")] = np.tile(np.repeat([1.0, -1.0], len(X)), 3)
    values = SLOPE * (q[:, 0] - 200.0) + 0.5 * REVERSAL * way[:, 0] + np.repeat(zeros, m)
    labels = {"component": "X", "run": np.repeat(["1", "2", "3"], m)}
    own = plan_set("laser", "component", q, (0.0, 0.0, -100.0), labels, u=U, **options)
    return replace(own, directions=way, readings=values[:, None])


def test_runs_with_zeros_of_their_own_give_scale_and_reversal():
    machine = machine_of(MACHINE)
    solution = fit(Campaign(machine, (), (laser(ZEROS, offset_per="run"),)))
    ends = {(f.position, f.direction): f.value for f in solution.functions(points=2)}
    assert ends[400.0, 1] - ends[0.0, 1] == pytest.approx(SLOPE * 400.0, abs=1e-9)
    assert ends[0.0, 1] - ends[0.0, -1] == pytest.approx(REVERSAL, abs=1e-9)
    zeros = {e.key[-1]: float(v) for e, v in zip(solution.nuisance_table, solution.nuisance, strict=True)}
    assert set(zeros) == {"1", "2", "3"}
    assert np.diff([zeros[run] for run in "123"]) == pytest.approx(np.diff(ZEROS), abs=1e-9)
    # 27 readings each way; both ways of a run share its zero, so that reversal is the difference of two means
    u = solution.motion_rows("EXX", np.array([200.0]), 1) - solution.motion_rows("EXX", np.array([200.0]), -1)
    variance = (u @ np.asarray(solution.covariance)[: u.shape[1], : u.shape[1]] @ u.T)[0, 0]
    assert np.sqrt(variance) == pytest.approx(U * np.sqrt(2.0 / 27.0), rel=0.05)


def test_runs_share_the_offset_of_their_line_unless_it_is_said():
    machine = machine_of(MACHINE)
    one = fit(Campaign(machine, (), (laser((0.2,) * 3),)))
    assert [e.name for e in one.nuisance_table] == ["offset laser line 1 X"]
    assert not one.adequacy.rejected
    moved = laser((0.2, 0.21, 0.2))
    assert fit(Campaign(machine, (), (moved,))).adequacy.rejected
    assert not fit(
        Campaign(machine, (), (replace(moved, options=moved.options | {"offset_per": "run"}),))
    ).adequacy.rejected


def test_runs_stand_in_files_and_files_of_earlier_versions_have_one(tmp_path):
    machine, own = machine_of(MACHINE), laser(ZEROS, offset_per="run")
    campaign = Campaign(machine, (), (own,))
    write_campaign(campaign, tmp_path / "c.h5")
    for again in (load_campaign(tmp_path / "c.h5"), load_campaign(write_manifest(campaign, tmp_path / "text"))):
        assert again.sets[0].labels["run"].tolist() == own.labels["run"].tolist()
        assert again.sets[0].options["offset_per"] == "run"
    with changed(tmp_path / "c.h5") as file:
        del file["sets/1/labels/run"]
    assert set(load_campaign(tmp_path / "c.h5").sets[0].labels["run"]) == {"1"}


def test_a_gauge_on_a_straightedge_that_is_zeroed_before_every_run():
    """y = 2 µm · (x/200 - 1)² and the slope of the edge; two runs 0.3 mm apart share the slope and not the offset."""
    machine = machine_of(STRAIGHT)
    q = np.zeros((2 * len(X), 3))
    q[:, machine.index("X")] = np.tile(X, 2)
    bow = 0.002 * (q[:, 0] / 200.0 - 1.0) ** 2
    labels = {"component": "Y", "line": "edge", "run": np.repeat(["1", "2"], len(X))}
    own = plan_set("edge", "component", q, (0.0, 0.0, -100.0), labels, u=U)
    lines = {"edge": {"along": [1.0, 0.0, 0.0], "normal": [0.0, 1.0, 0.0]}}
    stated = {"slope": False, "alignment": "edge", "lines": lines, "offset_per": "run"}
    values = bow + 1e-4 * q[:, 0] + np.repeat([0.1, 0.4], len(X))
    own = replace(own, readings=values[:, None], options=stated)
    solution = fit(Campaign(machine, (), (own,), alignments=(Alignment("edge"),)))
    found = {f.position: f.value for f in solution.functions(points=9)}
    # the least-squares line over the travel of a symmetric bow is level
    for x in X:
        assert found[x] - found[200.0] == pytest.approx(0.002 * (x / 200.0 - 1.0) ** 2, abs=1e-7)
    offsets = {
        e.key[-1]: float(v)
        for e, v in zip(solution.nuisance_table, solution.nuisance, strict=True)
        if e.key[0] == "offset"
    }
    assert offsets["2"] - offsets["1"] == pytest.approx(0.3, abs=1e-7)


def test_an_offset_of_anything_else_is_named():
    with pytest.raises(InputError, match="set 'laser': offset_per is 'day'; expected \"line\""):
        COMPONENT.check(laser(ZEROS, offset_per="day"))
