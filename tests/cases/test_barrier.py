"""Cases in which a mistake was accepted, or rejected without its name: what is said of each now, and what is made of it."""

import json
from pathlib import Path

import numpy as np
import pytest

import volid

HERE = Path(__file__).parent


@pytest.mark.parametrize(
    ("case", "said"),
    [
        ("20_tracker_points_in_metres/campaign.toml", "tracker.csv.*coordinates seem to be in metres; expected mm"),
        ("21_left_handed_tracker_frame/campaign.toml", "of the other hand.*What to do: campaign: negate column y"),
        ("22_axes_x_and_z_swapped/c.toml", "positions of (X and Z|Z and X).*|columns (X and Z|Z and X) are exchanged"),
        ("28_negated_distances/c.toml", "have the other sign.*negate column distance"),
    ],
)
def test_a_mistake_is_named_before_the_fit(case, said):
    with pytest.raises(volid.InputError, match=said):
        volid.fit(volid.load_campaign(HERE / case))


@pytest.mark.slow
def test_a_mistake_is_named_first_after_a_fit_that_was_asked_to_take_it_and_no_numbers_follow(run, tmp_path):
    solution = tmp_path / "s.h5"
    case = str(HERE / "21_left_handed_tracker_frame/campaign.toml")
    status, out, err = run("fit", case, "--accept-large-errors", "-o", str(solution))
    assert status == 1 and "REJECTED" in err
    assert "of the other hand" in out.split("likely causes of the misfit")[1].split("What to do")[0]
    assert "No squareness, volume and functions are shown" in out
    assert "EC0Y" not in out.split("No squareness")[1] and "EXX" not in out.split("No squareness")[1]
    for verb, more in (("grid", ["--type", "L-VOL"]), ("functions", []), ("tables", ["--type", "L-POS"])):
        target = tmp_path / verb
        status, out, err = run(verb, str(solution), *more, "-o", str(target))
        assert status == 2 and "no table or grid is made of this solution" in err and "of the other hand" in err
        assert not target.exists()


def test_u_in_micrometres_is_asked_about(run, tmp_path):
    status, out, err = run("fit", str(HERE / "29_u_in_micrometres/c.toml"), "--json", "-o", str(tmp_path / "s.h5"))
    data = json.loads(out)
    assert status == 1 and data["grade"] == "questioned" and not data["accepted"]
    assert "is it in µm, where mm is expected?" in data["verdict"] and "before a question is answered" in err


def test_large_component_readings_are_taken_where_the_alignment_is_free():
    """Legs 1.6° off the axes: readings of 2 … 5 mm, of which the free slopes leave hundredths."""
    found = volid.fit(volid.load_campaign(HERE / "09_component_over_1_mm_refused/campaign.toml"))
    assert found.statistics.residual_rms["square"] < 0.02


@pytest.mark.parametrize("way", ["key", "option"])
def test_large_component_readings_are_asked_about_and_taken_when_that_is_answered(tmp_path, way):
    """11 mm in EYY over 5 m, as on a published gantry."""
    x = np.linspace(0.0, 5000.0, 51)
    error = 11.0 * (x / 5000.0) ** 2
    rows = "\n".join(
        f"0,{y:.1f},Y,{e:.4f}"
        for y, e in zip(np.tile(x, 2), np.tile(error, 2) + np.repeat([0.0, 3e-3], 51), strict=True)
    )
    (tmp_path / "y.csv").write_text(f"X,Y,component,value\n{rows}\n")
    (tmp_path / "machine.toml").write_text(
        'format = "volid-machine/1"\nname = "gantry"\nstructure = "w b X Y t"\n[axis.X]\ntravel = [0.0, 2000.0]\n'
        '[axis.Y]\ntravel = [0.0, 5000.0]\n[model.functions]\n"*" = false\nEYY = true\n'
    )
    text = (
        'format = "volid-campaign/1"\nmachine = "machine.toml"\n[[set]]\nname = "laser"\nkind = "component"\nfile = "y.csv"\n'
        "tool = [0.0, 0.0, 0.0]\nu = 0.003\n"
    )
    manifest = tmp_path / "campaign.toml"
    manifest.write_text(text)
    with pytest.raises(
        volid.InputError, match=r"y.csv, row \d+: value .* more than 1 mm .*is it in µm\? .*large_errors = true"
    ):
        volid.fit(volid.load_campaign(manifest))
    if way == "key":
        manifest.write_text(text + "large_errors = true\n")
    found = volid.fit(volid.load_campaign(manifest), accept_large_errors=way == "option")
    assert found.adequacy.grade in ("accepted", "accepted, u enlarged")
    at = np.array([1000.0, 4000.0])
    rows = found.motion("EYY", at)
    expected = 11.0 * ((at / 5000.0) ** 2 - 0.25)  # 0 at mid-travel, the reference
    assert [r.value for r in rows] == pytest.approx(expected.tolist(), abs=4 * max(r.u for r in rows))
    assert max(r.u for r in rows) < 0.005
