"""One tool vector, or all on the spindle axis: what the grid says for a measured tool vector is right within its u."""

import numpy as np
import pytest
from exact_chain import ExactMachine, machine_toml, random_truth, tracker_campaign, write_campaign
from support.judging import judge

from volid.compensation.grids.linear import linear_grid
from volid.exceptions import NotDeterminedError
from volid.fitting.fit import fit
from volid.fitting.prediction.deviations import gradient_matrix
from volid.io import load_campaign
from volid.uncertainty.trials.centre import Centre
from volid.uncertainty.trials.monte_carlo import monte_carlo

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
        # values are those with the open combinations at 0; their u has the frame in it, which the comparison takes out of both
        np.testing.assert_allclose(grid.values[:, :3], np.asarray(solution.deviation(q, tool_rows))[:, :3], atol=1e-12)
        found = judge(solution, machine, truth, q, tool_rows)
        assert 0.6 < found.normalised_rms < 1.5
        assert np.all(found.u < 1.01 * grid.u[:, :3]) and grid.u[:, :3].max() < 1e-3
        assert np.isnan(grid.values[:, 5]).all(), "roll of the tool about its own axis stays open"
    with pytest.raises(NotDeterminedError, match=r"do not determine dX, dY.* for tool vector"):
        linear_grid(solution, points=4, tool=LATERAL)


def test_the_frame_that_is_open_is_chosen_without_changing_any_reading(tmp_path):
    """Stations follow the workpiece frame: predictions of the solution are those of the fit, and refits scatter as u says."""
    rng = np.random.default_rng(8)
    machine = ExactMachine("w Y' X' b Z t", TRAVEL)
    truth = random_truth(machine, rng, waviness=0.4, cross={})
    campaign = tracker_campaign(machine, truth, rng, tools=np.array(ONE), n_per_station=120)
    text = machine_toml(machine, extra="[model]\nsegments = 4\n")
    solution = fit(load_campaign(write_campaign(tmp_path / "c", campaign, text, "one tool")))
    centre = Centre(solution)
    expected = np.concatenate(
        [(s.readings - r).ravel() for s, r in zip(solution.campaign.sets, solution.readings.residuals, strict=True)]
    )
    assert np.abs(centre.flat_predictions() - expected).max() < 1e-5  # products of two errors
    found = monte_carlo(solution, 400, seed=3)
    q = np.random.default_rng(1).uniform(*np.array([TRAVEL[a] for a in machine.axes]).T, (20, 3))
    rows = gradient_matrix(solution.model, np.asarray(solution.parameters), q, np.tile(ONE, (20, 1)), np.zeros_like(q))[
        :, :3
    ]
    rows = rows.reshape(60, -1)
    x = found.samples.outputs(lambda v: v[:, : rows.shape[1]] @ rows.T)
    ratio = x.std(axis=0, ddof=1) / solution.evaluate(q, ONE[0]).u[:, :3].ravel()
    assert 0.9 < np.median(ratio) < 1.1
