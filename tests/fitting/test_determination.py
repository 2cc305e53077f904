"""One tool vector, or all on the spindle axis: what the grid says for a measured tool vector is right within its u."""

import numpy as np
import pytest
from exact_chain import ExactMachine, gauge_free, machine_toml, random_truth, tracker_campaign, write_campaign

from volid.compensation.grids.linear import linear_grid
from volid.exceptions import NotDeterminedError
from volid.fitting.fit import fit
from volid.io import load_campaign

TRAVEL = {"X": (0.0, 1000.0), "Y": (0.0, 600.0), "Z": (-500.0, 0.0)}
LATERAL = (50.0, 0.0, -150.0)
ONE = [(0.0, 0.0, -150.0)]
ON_AXIS = [(0.0, 0.0, -150.0), (0.0, 0.0, -250.0)]


@pytest.mark.parametrize("tools", [ONE, ON_AXIS], ids=["one tool vector", "on the spindle axis"])
def test_grid_for_a_measured_tool_is_right_within_its_u(tools, tmp_path):
    rng = np.random.default_rng(8)
    machine = ExactMachine("w Y' X' b Z t", TRAVEL)
    truth = random_truth(machine, rng, waviness=0.4, cross={})
    campaign = tracker_campaign(
        machine, truth, rng, tools=np.array(tools), n_per_station=120, every_station_sees_every_tool=True
    )
    text = machine_toml(machine, extra="[model]\nsegments = 4\n")
    solution = fit(load_campaign(write_campaign(tmp_path / "c", campaign, text, "one tool")))
    assert not solution.fully_determined and not solution.adequacy.rejected
    assert any("ECZ (all" in s for s in solution.statements)
    for tool in tools:
        grid = linear_grid(solution, points=4, tool=tool)
        q = grid.positions[:, [grid.axes.index(a) for a in machine.axes]]
        tool_rows = np.tile(tool, (len(q), 1))
        exact = machine.deviation(q, tool_rows, truth)[:, :3]
        difference = gauge_free(grid.values[:, :3] - exact, q, tool_rows, machine=machine)[0]
        # u is that of the field in its own frame, 4 nodes a side: the projection by these 64 nodes changes it little
        assert 0.6 < np.sqrt(np.mean((difference / grid.u[:, :3]) ** 2)) < 1.5
        assert grid.u[:, :3].max() < 3e-3
        assert np.isnan(grid.values[:, 5]).all(), "roll of the tool about its own axis stays open"
    with pytest.raises(NotDeterminedError, match=r"do not determine dX, dY.* for tool vector"):
        linear_grid(solution, points=4, tool=LATERAL)
