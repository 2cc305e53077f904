"""Campaigns of several sets on the command line: estimated u, the verdict on each set, who determines what."""

import json

import pytest
from support.small_campaign import make_campaign

from volid.io import load_campaign
from volid.io.campaign.hdf5 import write_campaign


@pytest.fixture(scope="module")
def manifest(tmp_path_factory):
    return make_campaign(tmp_path_factory.mktemp("several"), levels=True).manifest


def test_u_is_estimated_and_kept_beside_what_was_stated(manifest, run, tmp_path):
    path = tmp_path / "s.h5"
    status, text, _ = run("fit", manifest, "-o", path, "--estimate-u", "levels")
    assert status == 0
    assert "set levels, component A: estimated, 1.07 ± 0.18 times the stated u" in text
    assert "levels  component A        22         0       1.00 µrad" in text  # as it was stated
    status, found, _ = run("summary", path, "--json")
    data = json.loads(found)
    (component,) = data["variance_components"]
    levels = next(s for s in data["sets"] if s["set"] == "levels")
    assert levels["u_rms"] == pytest.approx(component["factor"] * levels["stated_u_rms"])
    assert [test["verdict"] for test in data["set_tests"]] == ["agrees with its u and with the other sets"] * 2
    assert data["provenance"]["options"].count("levels") == 1


def test_who_determines_what(manifest, run, tmp_path):
    path = tmp_path / "s.h5"
    run("fit", manifest, "-o", path)
    status, text, _ = run("summary", path, "--sets")
    assert status == 0
    assert "levels               72 of 72        4 of 72             0" in text
    assert "without set 'volume': EXY, EYY" in text
    roll = next(line.split() for line in text.splitlines() if line.startswith("EAX") and line.endswith("µrad"))
    data = json.loads(run("summary", path, "--sets", "--json")[1])["who_determines"]
    assert next(row["only"] for row in data["sets"] if row["set"] == "volume") == 68
    shares = {(s["function"], s["set"]): s for s in data["functions"]}
    assert shares["EXX", "volume"]["u_without"] is None
    assert shares["EAX", "levels"]["u_without"] > 1.2 * shares["EAX", "levels"]["u"]
    assert len(roll) >= 4


def test_sets_that_are_not_there_and_streams_are_refused(manifest, run, tmp_path):
    status, _, err = run("fit", manifest, "-o", tmp_path / "s.h5", "--estimate-u", "level")
    assert status == 2
    assert "--estimate-u: the campaign has no set 'level'; expected 'all', or some of volume, levels" in err
    write_campaign(load_campaign(manifest), tmp_path / "c.h5")
    status, _, err = run("fit", tmp_path / "c.h5", "--stream", "-o", tmp_path / "s.h5", "--estimate-u")
    assert status == 2
    assert "--stream and --estimate-u exclude each other: that needs all readings at once" in err
    assert not (tmp_path / "s.h5").exists()
