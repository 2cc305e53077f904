"""Held-out residuals: the closed formula against fits that really leave a rotary position out."""

from dataclasses import replace

import numpy as np
import pytest
from exact_chain import random_truth
from support.machines import STRUCTURES, exact_machine, resolved
from support.rtests import r_test, r_test_campaign, rotary_only

from volid.fitting.diagnosis.hold_out import by_angle, total
from volid.fitting.equations.problem import build_problem, scatter
from volid.fitting.fit import fit
from volid.report.text.summary import summary_data
from volid.report.text.summary_lines import format_summary

CONSTANTS = '"E??" = false\n"E?0[XYZ]" = false\n"E?0S" = false\n'


@pytest.fixture(scope="module")
def case():
    """Location errors fitted to a machine that has error motions too: residuals of some 10 µm, no noise."""
    exact = exact_machine(STRUCTURES["tilting table C'A'"])
    truth = rotary_only(random_truth(exact, np.random.default_rng(4), scale=0.3))
    data = r_test(exact, truth, np.random.default_rng(0), counts={"A": 4, "C": 5}, noise=0.0)
    campaign = r_test_campaign(resolved(exact, CONSTANTS, segments=4), data)
    return campaign, fit(campaign)


def kept(campaign, rows):
    """The campaign with some rows of its set."""
    (s,) = campaign.sets
    part = replace(
        s, positions=s.positions[rows], directions=s.directions[rows], tool=s.tool[rows], readings=s.readings[rows],
        u=s.u[rows], labels={k: v[rows] for k, v in s.labels.items()},
    )  # fmt: skip
    return replace(campaign, sets=(part,))


def test_equals_a_refit_without_the_rotary_position(case):
    campaign, solution = case
    (poses,) = campaign.rotary_poses()
    assert poses.max() + 1 == 20 and np.bincount(poses).tolist() == [3] * 20
    (held,) = solution.readings.held_out
    for pose in (0, 7):
        rows = poses == pose
        other = fit(kept(campaign, ~rows))
        problem = build_problem(campaign, other.model)
        z = np.concatenate([other.model.parametrisation @ np.asarray(other.parameters), np.asarray(other.nuisance)])
        (predicted,) = scatter(problem, campaign, problem.equations.predictions(z))
        expected = (campaign.sets[0].readings - predicted)[rows]
        # the model is linear but for second order, 50 µrad of 20 µm
        np.testing.assert_allclose(held[rows], expected, atol=2e-6)
        assert np.abs(expected - solution.readings.residuals[0][rows]).max() > 1e-4  # it does make a difference


def test_bins_by_angle_hold_every_row_once(case):
    campaign, solution = case
    (poses,), (held,), (residual,) = campaign.rotary_poses(), solution.readings.held_out, solution.readings.residuals
    used = np.ones(len(poses), dtype=bool)
    bins = by_angle(campaign.machine, campaign.sets[0], poses, residual, held, used)
    ends = np.array([(b.low, b.high) for b in bins if b.axis == "A"])
    np.testing.assert_allclose(ends, np.linspace(-100.0, 100.0, 4)[:, None] * [1.0, 1.0], atol=1e-3)
    whole = total("R-test", poses, residual, held, used)
    for axis in "CA":
        assert sum(b.n for b in bins if b.axis == axis) == whole.n == 60
        squares = sum(b.n * b.held_out**2 for b in bins if b.axis == axis)
        assert squares == pytest.approx(60 * whole.held_out**2)
    first = residual[campaign.sets[0].positions[:, campaign.machine.index("A")] < -99.0]
    (lowest,) = [b for b in bins if b.axis == "A" and b.low < -99.0]
    assert lowest.residual == pytest.approx(np.sqrt(np.mean(np.sum(first**2, axis=1))))
    assert lowest.mean == pytest.approx(first.mean(axis=0))


def test_summary_prints_them(case):
    data = summary_data(case[1])
    assert len(data["held_out"]) == 1 + 4 + 5
    text = format_summary(data)
    assert "residuals of R-test by angle" in text and "predicted from the others" in text
    assert max(map(len, text.splitlines())) <= 100


def test_none_without_rotary_axes(solution):
    assert solution.readings.held_out == ()
    assert summary_data(solution)["held_out"] == []
