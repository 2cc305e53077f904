"""Slips in units on the bundled campaign: refused with one message that names file, column or key, what was found and what to do.

The legitimate campaigns that look a little like them (one corner, one axis, tools on the spindle axis, rough stations) pass.
"""

import csv
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.places import BUNDLED
from support.plain_distances import VOLUME, distances, moved

from volid.campaign import Campaign
from volid.cli import main
from volid.exceptions import InputError
from volid.fitting.stages import breakdown_named
from volid.io import parse_machine, read_manifest
from volid.plausibility.checks import check_campaign

DATASET = BUNDLED.parent
AXES, TOOL = ("X", "Y", "Z"), ("tool_x", "tool_y", "tool_z")
FILES = ("campaign.toml", "machine.toml", "volume.csv")


@pytest.fixture(scope="module")
def bundled() -> Campaign:
    return read_manifest(DATASET / "campaign.toml")


def in_metres(match: re.Match) -> str:
    return f"{float(match[0]) / 1000:.10g}"


def in_other_unit(folder: Path, columns: tuple[str, ...] = (), keys: tuple[str, ...] = (), text=()) -> Path:
    """The bundled campaign with CSV columns, and all numbers of the TOML lines that begin with a key, divided by 1000.

    `text`: old and new parts of the manifest.
    """
    for name in FILES:
        content = (DATASET / name).read_text(encoding="utf-8")
        if name.endswith(".csv"):
            head, *lines = [line for line in content.splitlines() if not line.startswith("#")]
            rows = [[str(float(v) / 1000) if c in columns else v for c, v in zip(head.split(","), r, strict=True)]
                    for r in csv.reader(lines)]  # fmt: skip
            content = "\n".join([head, *map(",".join, rows)]) + "\n"
        else:
            for old, new in text:
                content = content.replace(old, new)
            for key in keys:
                content = re.sub(rf"(?m)^{key} = \[[^\]]*\]", lambda m: re.sub(r"-?\d+\.\d+", in_metres, m[0]), content)
        (folder / name).write_text(content, encoding="utf-8")
    return folder / "campaign.toml"


CASES = {
    "positions": (
        {"columns": AXES},
        r"volume\.csv, set 'volume': axis positions seem to be in metres: X = 0 … 1, Y = 0 … 0\.6, Z = -0\.5 … 0, where the "
        r"travels are 0 … 1000, 0 … 600, -500 … 0 mm; expected mm\. Multiply these columns by 1000",
    ),
    "positions, tools and distances": (
        {"columns": (*AXES, *TOOL, "distance")},
        r"volume\.csv, set 'volume': axis positions seem to be in metres: X = 0 … 1, .*see whether tool vectors and readings",
    ),
    "tools": (
        {"columns": TOOL},
        r"volume\.csv, set 'volume': tool vectors seem to be in metres: the longest is 0\.26\d* mm, .*Multiply tool_x",
    ),
    "distances": (
        {"columns": ("distance",)},
        r"volume\.csv, set 'volume': distances seem to be in metres, 1000 times too small for the positions; expected mm",
    ),
    "travels": (
        {"keys": ("travel",)},
        r"volume\.csv, set 'volume': positions Y = 0 … 600 mm lie many times its travel away from it; \[axis\.Y\] of the "
        r"machine file has travel = \[0, 0\.6\]\. Expected both in mm: check that the travel is in millimetres",
    ),
    "stations": (
        {"keys": ("position",)},
        r"campaign\.toml: \[\[station\]\] positions seem to be in metres: the distances put S1 at \(-423\.\d, .*"
        r"position of S1 is \[-0\.42, -0\.24, -0\.87\]; expected mm\. Multiply by 1000",
    ),
    "constant u": (
        {"text": [("constant = 0.0003", "constant = 3.0e-7")]},
        r"campaign\.toml, set 'volume': the constant part of u is 3e-07 mm, less than 1 nm; .*Expected mm, such as 0\.0003",
    ),
    "u": (
        {"text": [("u = { constant = 0.0003, proportional = 3e-07 }", "u = 3.0e-7")]},
        r"campaign\.toml, set 'volume': the constant part of u is 3e-07 mm",
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_a_campaign_in_metres_is_refused(name, tmp_path, capsys):
    changes, message = CASES[name]
    manifest = in_other_unit(tmp_path, **changes)
    status = main(["fit", str(manifest), "-o", str(tmp_path / "s.h5")])
    out, err = capsys.readouterr()
    assert (status, out) == (2, "")
    (line,) = [line for line in err.splitlines() if not line.startswith("volid: ")]  # progress
    assert line.startswith("volid fit: ") and re.search(message, line), line
    assert not (tmp_path / "s.h5").exists()


def changed(campaign: Campaign, rows=slice(None), **fields) -> Campaign:
    """Some rows of the only set, and other values of its fields."""
    one = campaign.sets[0]
    arrays = {n: getattr(one, n)[rows] for n in ("positions", "directions", "tool", "readings", "u", "time", "rows")}
    arrays["labels"] = {name: column[rows] for name, column in one.labels.items()}
    return replace(campaign, sets=(replace(one, **(arrays | fields)),))


def stations(campaign: Campaign, scale: float | None) -> Campaign:
    """Approximate positions in another unit, or none."""
    places = [None if scale is None else tuple(scale * np.array(s.position)) for s in campaign.stations]
    both = zip(campaign.stations, places, strict=True)
    return replace(campaign, stations=tuple(replace(s, position=p) for s, p in both))


def test_the_bundled_campaign_passes(bundled):
    assert check_campaign(bundled) == ()
    assert check_campaign(stations(bundled, None)) == ()


def test_slips_are_found_without_approximate_stations(bundled):
    lost, one = stations(bundled, None), bundled.sets[0]
    for fields, message in (
        ({"positions": one.positions / 1000}, "axis positions seem to be in metres: X = 0 … 1"),
        ({"tool": one.tool / 1000}, "tool vectors seem to be in metres"),
    ):
        with pytest.raises(InputError, match=message):
            check_campaign(changed(lost, **fields))


def test_one_tool_vector_in_metres_is_seen_by_where_the_stations_are(bundled):
    rows = (bundled.sets[0].tool == [0.0, 0.0, -150.0]).all(axis=1)
    single = changed(bundled, rows)
    assert check_campaign(single) == ()
    small = changed(single, tool=single.sets[0].tool / 1000)
    with pytest.raises(InputError, match=r"tool vectors seem to be in metres: the longest is 0\.15 mm"):
        check_campaign(small)
    (warning,) = check_campaign(stations(small, None))  # nothing contradicts it: a warning
    assert warning.endswith("set 'volume': all tool vectors are shorter than 2 mm, the longest 0.15; are they in mm?")


def test_inches(bundled):
    one = bundled.sets[0]
    inches = {"positions": one.positions / 25.4, "tool": one.tool / 25.4, "readings": one.readings / 25.4}
    with pytest.raises(
        InputError, match=r"set 'volume': axis positions, tool vectors and distances seem to be in inches"
    ):
        check_campaign(changed(bundled, **inches))
    with pytest.raises(InputError, match=r"\[\[station\]\] positions seem to be in inches"):
        check_campaign(stations(bundled, 1 / 25.4))
    with pytest.raises(InputError, match=r"axis positions seem to be in inches, 25\.4 times too small"):
        check_campaign(changed(bundled, positions=inches["positions"]))


def test_positions_in_micrometres(bundled):
    with pytest.raises(
        InputError, match=r"positions Y = 0 … 600000 mm lie many times its travel away .*not micrometres"
    ):
        check_campaign(changed(bundled, positions=bundled.sets[0].positions * 1000))


def test_u_below_the_rounding_of_the_readings(bundled):
    u = bundled.sets[0].u
    with pytest.raises(
        InputError, match=r"u is at most 3e-07, but the readings are rounded to 1e-05, which .* of 2\.9e-06"
    ):
        check_campaign(changed(bundled, u=np.full_like(u, 3e-7)))
    assert check_campaign(changed(bundled, u=np.full_like(u, 1e-6))) == ()  # bold, but nearer than any unit


# ---------------------------------------------------------------------------------------- what looks like it, and is not


def test_one_corner_is_legal(bundled):
    order = bundled.machine.letters
    for corner in ({"X": 300, "Y": 200, "Z": -300}, {"X": 100, "Y": 60, "Z": -440}):
        rows = (bundled.sets[0].positions <= [corner[a] for a in order]).all(axis=1)
        assert rows.sum() > 50
        assert check_campaign(changed(bundled, rows)) == ()


def test_a_small_box_at_the_origin_is_legal_down_to_a_thousandth():
    """20, 5 and 2 mm of a metre; 1 mm in every axis can only be metres, whatever the distances say."""
    for size in (0.02, 0.005, 0.002):
        check_campaign(distances(size * VOLUME))
    with pytest.raises(InputError, match="axis positions seem to be in metres: X = "):
        check_campaign(distances(0.001 * VOLUME))


def test_one_axis_moved_by_a_millimetre_is_a_warning():
    (warning,) = check_campaign(distances(VOLUME * [1e-3, 0, 0]))
    assert "all positions lie within 2 % of the travels around zero" in warning


def test_linear_axes_that_follow_a_rotary_axis_by_tenths_of_a_millimetre_are_legal():
    text = """format = "volid-machine/1"
name = "table"
structure = "w C' b X Y Z t"
[axis.C]
travel = [0.0, 360.0]
point = [0.0, 0.0, 0.0]
[axis.X]
travel = [-500.0, 500.0]
[axis.Y]
travel = [-300.0, 300.0]
[axis.Z]
travel = [-500.0, 0.0]
"""
    campaign = distances(0.001 * VOLUME)
    q = np.hstack([np.linspace(0.0, 350.0, len(VOLUME))[:, None], campaign.sets[0].positions - [0.5, 0.3, 0.0]])
    campaign = replace(campaign, machine=parse_machine(text, "machine.toml"))
    readings = replace(campaign.sets[0], positions=q, directions=0 * q)
    check_campaign(replace(campaign, sets=(readings,)))


def test_one_wild_position_is_a_warning():
    q = VOLUME.copy()
    q[7, 0] = 99999.0
    (warning,) = [w for w in check_campaign(distances(q)) if "travel" in w]
    assert "X = 99999 mm lies outside the travel 0 … 1000" in warning


def test_rough_or_equal_approximate_stations_pass(bundled):
    for place in ((0.0, 0.0, 0.0), (500.0, 300.0, -250.0), (5000.0, -3000.0, 900.0)):
        rough = tuple(replace(s, position=place) for s in bundled.stations)
        assert check_campaign(replace(bundled, stations=rough)) == ()


def test_inch_positions_of_a_distance_set_with_no_station():
    with pytest.raises(InputError, match="axis positions seem to be in inches"):
        check_campaign(moved(distances(VOLUME, approximate=None), 1 / 25.4))


def test_a_factorisation_that_fails_is_bad_input():
    @breakdown_named()
    def factorise() -> None:
        np.linalg.cholesky(np.array([[1.0, 2.0], [2.0, 1.0]]))

    with pytest.raises(
        InputError, match=r"the fit broke down: its equations have no solution .* Readings, positions and travels"
    ):
        factorise()
