"""Lack of fit beside the stated u: none in a true model, the unit weight where it exceeds chance."""

from dataclasses import replace

import numpy as np
import pytest
from support.machines import VERTICAL, fixed
from support.trackers import simulated

from volid.fitting.fit import fit
from volid.uncertainty.lack_of_fit import lack_of_fit


@pytest.fixture(scope="module")
def true_model():
    """Gentle functions."""
    campaign, _, _ = simulated(VERTICAL, 21, n_per_station=150, waviness=0.1, every_station_sees_every_tool=True)
    return fit(campaign)


def test_a_true_model_has_none(true_model):
    """The unit weight is 1 within chance: its relative standard deviation is 1/sqrt(2n)."""
    n = true_model.statistics.n_readings
    assert abs(true_model.adequacy.unit_weight - 1.0) < 3.0 / np.sqrt(2.0 * n) + 0.02
    found = lack_of_fit(true_model)
    assert found.factor == 1.0 and found.share == 0.0
    assert str(found).startswith("none found (unit weight ")


def test_too_few_segments_for_the_waves_show():
    """A function with 20 waves over the travel, and 12 segments stated for it: the residuals see it."""
    campaign, truth, tracker = simulated(
        VERTICAL, 22, n_per_station=150, waviness=0.1, every_station_sees_every_tool=True, extra=fixed(12)
    )
    (s,) = campaign.sets
    x = s.positions[:, campaign.machine.index("X")]
    wave = 2e-3 * np.sin(2 * np.pi * 20 * x / 760)
    places = np.array([tracker.station_positions[n] for n in tracker.station])
    target = VERTICAL.functional_point(tracker.q, tracker.tool, truth)
    along = ((target - places) / np.linalg.norm(target - places, axis=1)[:, None])[:, 0]
    found = fit(replace(campaign, sets=(replace(s, readings=s.readings + (wave * along)[:, None]),)))
    lack = lack_of_fit(found)
    assert lack.factor >= lack.unit_weight > 1.5, "hold-outs by block may see more than the residuals"
    assert "part of every u" in str(lack)
    # 2 µm waves (RMS 1.4 µm, over the directions to the stations about 0.8 µm) on noise of about 0.45 µm
    assert lack.share == pytest.approx(np.sqrt(lack.factor**2 - 1.0))
