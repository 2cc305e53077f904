"""A broken beam: found, named with its row and time, and cured by a new segment in a robust fit; outliers beside it too."""

from dataclasses import replace

import numpy as np
import pytest
from support.mistakes import broken, sound

from volid.fitting.fit import fit

FEW = {"n": 150}


def _with_time(campaign):
    (s,) = campaign.sets
    return replace(campaign, sets=(replace(s, time=10.0 * np.arange(len(s))),))


@pytest.mark.parametrize("step", [0.006, 0.5])
def test_a_break_is_cured_by_a_new_segment(step):
    made = broken("vertical", 0, step, **FEW)
    campaign = _with_time(made.campaign)
    (s,) = campaign.sets
    exact = sound("vertical", 0, 0.0, **FEW).campaign.sets[0]
    first = int(np.flatnonzero(s.readings[:, 0] != exact.readings[:, 0])[0])
    plain = fit(campaign).adequacy
    assert plain.causes[0].cause == "beam break" and plain.rejected
    where = int(plain.causes[0].what.split("row ")[1].split()[0])
    assert abs(where - (first + 1)) <= (2 if step < 0.1 else 0)  # 6 µm on 0.4 µm; a row at the edge may go either way
    assert f"time {10.0 * (where - 1):g} s" in plain.causes[0].what
    cured = fit(campaign, robust=True)
    assert cured.adequacy.grade == "accepted"
    (note,) = [n for n in cured.notes if "was broken" in n]
    assert "a new segment begins there" in note
    assert float(note.split("(by ")[1].split(" µm")[0]) == pytest.approx(1e3 * step, abs=1.5)
    labels = cured.campaign.sets[0].labels["segment"]
    assert len(set(labels[s.labels["station"] == "S1"].tolist())) == 4, "three segments, one of them cut"
    assert not cured.readings.outlier_readings


def test_a_break_beside_outliers():
    """Ten gross readings do not hide the break, and the break hides none of them."""
    made = broken("gantry", 1, 0.05, **FEW)
    (s,) = made.campaign.sets
    rng = np.random.default_rng(3)
    gross = rng.choice(len(s), 10, replace=False)
    readings = s.readings.copy()
    readings[gross, 0] += rng.choice([-1.0, 1.0], 10) * rng.uniform(0.05, 0.5, 10)
    found = fit(replace(made.campaign, sets=(replace(s, readings=readings),)), robust=True)
    assert any("was broken" in n for n in found.notes)
    assert set(np.flatnonzero(found.readings.outliers[0][:, 0])) == set(gross.tolist())
    assert found.adequacy.grade == "accepted" and found.factor == 1.0, "the robust fit reports its own verdict"


@pytest.mark.parametrize("layout", ["vertical", "horizontal"])
def test_a_sound_campaign_is_not_cut(layout):
    found = fit(sound(layout, 2, 0.0, **FEW).campaign, robust=True)
    assert not any("was broken" in n for n in found.notes)
