"""`volid evaluate iso230-4`: from files to text, JSON, table and figure."""

import csv
import json

import pytest
from support.instrument_files import SAMPLES
from support.places import DATASETS

CAMPAIGN = DATASETS / "ball_bar_circles/campaign.toml"


def test_a_campaign_gives_every_plane(run, tmp_path):
    out, figure = tmp_path / "readings.csv", tmp_path / "circles.svg"
    status, text, err = run("evaluate", "iso230-4", CAMPAIGN, "-o", out, "--figure", figure)
    assert status == 0 and "attention" not in err
    for title in ("ISO 230-4, XY, circle XY", "ISO 230-4, YZ, arc YZ", "ISO 230-4, ZX, arc ZX"):
        assert title in text
    assert "EC0Y with X as primary" in text and "no full circle" in text
    rows = list(csv.DictReader(line for line in out.read_text().splitlines() if not line.startswith("#")))
    assert len(rows) == 1168 and {"angle_deg", "sense", "deviation_mm", "behind_quadrant"} <= rows[0].keys()
    assert "<svg" in figure.read_text()[:2000] and "per division" in figure.read_text()


def test_one_set_as_json_with_limits(run, tmp_path):
    limits = tmp_path / "limits.toml"
    limits.write_text("G_b_XY = 0.020\nF_max = 0.1\n")
    arguments = ("evaluate", "iso230-4", CAMPAIGN, "--set", "circle XY", "--limits", limits, "--json")
    status, text, err = run(*arguments)
    found = json.loads(text)
    assert status == 1 and "XY: G_b_XY = " in err and " exceeds 20 µm" in err
    assert found["subject"] == "XY" and found["G_b_XY"]["verdict"] == "fail" and found["F_max"]["verdict"] == "pass"
    assert found["G_b_XY"]["U"] > 0.0 and found["squareness_XY"]["unit"] == "rad"


def test_a_set_that_is_no_circle_says_why(run):
    status, _, err = run("evaluate", "iso230-4", DATASETS / "vertical_multilateration/campaign.toml")
    assert status == 2 and "no set is a circular test" in err and "expected two linear axes on a circle" in err
    status, _, err = run("evaluate", "iso230-4", CAMPAIGN, "--set", "circle")
    assert status == 2 and "set 'circle' is not there; expected one of circle XY, arc YZ, arc ZX" in err


def test_a_vendors_evaluation_is_shown_and_never_made_anew(run, tmp_path):
    path = tmp_path / "test.b5r"
    path.write_text(SAMPLES["b5r"].text, encoding="utf-8")
    status, text, _ = run("evaluate", "iso230-4", path)
    assert status == 0 and "no readings are in it" in text and "ISO" not in text and "AF_SQUARENESS" in text
    status, _, err = run("evaluate", "iso230-4", path, "--figure", tmp_path / "f.svg")
    assert status == 2 and "no readings to draw" in err


@pytest.mark.parametrize(
    "option, value, message", [("--spike-window", "60", "--spike-window"), ("--radius", "-1", "--radius")]
)
def test_options_are_named_as_they_are_given(run, tmp_path, option, value, message):
    path = tmp_path / "circle.csv"
    path.write_text(
        "\n".join(["# plane: XY", "# radius: 150", "angle,deviation", *(f"{a},0" for a in range(0, 361, 5))])
    )
    status, _, err = run("evaluate", "iso230-4", path, option, value)
    assert status == 2 and message in err
