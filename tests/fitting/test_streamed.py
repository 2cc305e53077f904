"""Campaigns read part by part: the answer of the fit in memory, whatever the parts, in bounded memory."""

from dataclasses import replace

import numpy as np
import pytest
from exact_chain import ExactMachine
from support.machines import fixed
from support.trackers import simulated

from volid.campaign import Effect
from volid.exceptions import InputError
from volid.fitting.fit import fit
from volid.fitting.streamed import fit_streamed
from volid.io.campaign.hdf5 import write_campaign
from volid.io.campaign.stream import CampaignStream
from volid.io.solutions import read_solution, write_solution
from volid.uncertainty.budget import budget
from volid.uncertainty.trials.monte_carlo import monte_carlo

EXACT = ExactMachine("w X' b Y Z t", {"X": (0, 700), "Y": (0, 400), "Z": (-400, 0)})


@pytest.fixture(scope="module")
def campaign():
    """Two sets of distances with a calibrated scale, both with time stamps; the last rows have a segment of their own."""
    found, _, _ = simulated(
        EXACT, 3, extra=fixed(2), waviness=0.2, n_per_station=500, every_station_sees_every_tool=True
    )
    (readings,) = found.sets
    m = len(readings)
    segment = np.where(np.arange(m) >= m - 30, "late", readings.labels["segment"])
    whole = replace(readings, labels={**readings.labels, "segment": segment}, time=np.arange(m) * 0.5)
    whole = replace(
        whole, effects=(Effect("index", "scale", 1e-7, "campaign"),), rows=np.arange(2, m + 2), source="volume.csv"
    )
    half = m // 2
    one, two = whole.rows_of(np.arange(half)), whole.rows_of(np.arange(half, m))
    return replace(found, sets=(one, replace(two, name="more")))


class Parts(CampaignStream):
    """Parts so small that there are many, the last ones of odd lengths."""

    def parts(self, rows=700):
        return super().parts(rows)


@pytest.fixture(scope="module")
def both(campaign, tmp_path_factory):
    path = tmp_path_factory.mktemp("stream") / "campaign.h5"
    write_campaign(campaign, path)
    return fit(campaign), fit_streamed(Parts(path), sample=900), path


def test_the_answer_of_the_fit_in_memory(both):
    whole, streamed, _ = both
    u = np.sqrt(np.diagonal(np.asarray(whole.covariance)))
    assert [e.name for e in whole.nuisance_table] == [e.name for e in streamed.nuisance_table]
    for name in ("parameters", "nuisance"):
        own = u[: len(whole.parameters)] if name == "parameters" else u[len(whole.parameters) :]
        away = np.abs(np.asarray(getattr(streamed, name)) - np.asarray(getattr(whole, name)))
        assert np.max(away / own) < 1e-5
    scale = np.outer(u, u)
    assert np.max(np.abs(np.asarray(streamed.covariance) - np.asarray(whole.covariance)) / scale) < 1e-7
    assert streamed.statistics.converged
    assert streamed.statistics.n_readings == whole.statistics.n_readings


def test_the_verdict_is_that_of_all_readings(both):
    whole, streamed, _ = both
    assert streamed.adequacy.chi_square == pytest.approx(whole.adequacy.chi_square, rel=1e-9)
    assert streamed.adequacy.degrees_of_freedom == whole.adequacy.degrees_of_freedom
    assert streamed.statistics.residual_rms == pytest.approx(whole.statistics.residual_rms, rel=1e-9)
    expected = {g.what: g for g in whole.adequacy.groups if not g.what.startswith("time")}
    found = {g.what: g for g in streamed.adequacy.groups if not g.what.startswith("time")}
    assert found.keys() == expected.keys() and len(found) > 20
    for what, group in expected.items():
        assert found[what].n == group.n
        assert found[what].unit_weight == pytest.approx(group.unit_weight, rel=1e-8)
    times = [g for g in streamed.adequacy.groups if g.what.startswith("time")]
    assert sum(g.n for g in times) == whole.statistics.n_readings, "every reading lies in one interval of time"


def test_suspect_readings_are_named_by_their_row(campaign, tmp_path):
    more = campaign.sets[1]
    readings = more.readings.copy()
    readings[123] += 0.05
    write_campaign(replace(campaign, sets=(campaign.sets[0], replace(more, readings=readings))), tmp_path / "c.h5")
    found = fit_streamed(Parts(tmp_path / "c.h5"), sample=900)
    assert found.adequacy.suspects[0].where == more.where(123)
    assert found.adequacy.rejected


def test_what_repeats_the_fit_is_refused_also_from_file(both, tmp_path):
    streamed = both[1]
    write_solution(streamed, tmp_path / "s.h5")
    again = read_solution(tmp_path / "s.h5")
    assert any("part by part" in note for note in again.notes)
    for solution in (streamed, again):
        with pytest.raises(InputError, match=r"Monte Carlo repeats the fit, but this solution holds .* of its"):
            monte_carlo(solution, 100)
        with pytest.raises(InputError, match="the budget repeats the fit"):
            budget(solution)


def test_a_sample_has_some_of_every_label(both, campaign):
    sample = CampaignStream(both[2]).sample(100)
    late = sample.sets[1].labels["segment"] == "late"
    assert late.sum() == 25
    assert sum(len(s) for s in sample.sets) <= 25 * 19, "six stations with three segments each, and the late one"
    assert {s.name for s in sample.sets} == {s.name for s in campaign.sets}


def test_bad_input_is_named(campaign, tmp_path):
    (tmp_path / "c.toml").write_text("format = 'volid-campaign/1'")
    with pytest.raises(InputError, match=r"c\.toml: not an HDF5 file; only those can be read part by part"):
        CampaignStream(tmp_path / "c.toml")
    readings = campaign.sets[0].readings.copy()
    readings[5] = np.nan
    write_campaign(replace(campaign, sets=(replace(campaign.sets[0], readings=readings),)), tmp_path / "c.h5")
    with pytest.raises(InputError, match=r"volume\.csv, row 7: readings holds no number"):
        fit_streamed(CampaignStream(tmp_path / "c.h5"))
    drift = Effect("warming", "drift", 1e-3, "campaign", {"form": "linear"})
    write_campaign(replace(campaign, sets=(replace(campaign.sets[0], effects=(drift,)),)), tmp_path / "d.h5")
    with pytest.raises(InputError, match="effect 'warming': drift spans all parts"):
        fit_streamed(CampaignStream(tmp_path / "d.h5"))
