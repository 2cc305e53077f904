"""Campaigns as text: what a good one gives, and what each bad one is told."""

from dataclasses import asdict

import numpy as np
import pytest
from support.campaign_files import (
    MACHINE,
    MANIFEST,
    STATIONS,
    csv_text,
    edited,
    grid,
    level_rows,
    volume_rows,
    write_files,
)
from support.work import calls

from volid.campaign import Station
from volid.exceptions import InputError, OutputError
from volid.io import read_manifest, write_manifest

VOLUME = csv_text(volume_rows())


def without(name: str) -> str:
    """volume.csv without one column."""
    return csv_text({key: cells for key, cells in volume_rows().items() if key != name})


def with_cell(name: str, cell: str) -> str:
    """volume.csv with one cell of line 4 (third row) changed."""
    rows = volume_rows()
    rows[name][2] = cell
    return csv_text(rows)


def with_column(name: str, cells: list) -> str:
    """volume.csv with one more column."""
    return csv_text(volume_rows() | {name: cells})


# ----------------------------------------------------------------------------------------------- good campaigns


def test_everything_is_read(tmp_path):
    path = write_files(tmp_path)
    campaign = read_manifest(path)
    assert (campaign.title, campaign.source, campaign.machine.text) == ("Acceptance", str(path), MACHINE)
    assert campaign.conditions["component_temperatures_C"] == {"bed": 20.3, "column": 20.9}
    assert campaign.stations == (
        Station("S1", position=STATIONS["S1"]),
        Station("S2", position=STATIONS["S2"], known=True, frame="machine"),
    )
    volume, levels = campaign.sets
    np.testing.assert_array_equal(volume.positions, np.vstack([grid(), grid()]))
    np.testing.assert_array_equal(volume.readings[:, 0], volume_rows()["distance"])
    np.testing.assert_array_equal(volume.tool, np.tile([0.0, 0.0, -150.0], (54, 1)))
    np.testing.assert_allclose(volume.u, np.hypot(0.0003, 3e-7 * np.abs(volume.readings)), rtol=1e-15)
    assert volume.labels["station"].tolist() == volume_rows()["station"]
    assert volume.options["relative"] is True
    assert [asdict(e) for e in volume.effects] == [
        {"name": "refraction", "type": "scale", "u": 2e-7, "per": "station", "options": {"distribution": "rectangular"}}
    ]
    assert not volume.directions.any() and volume.time is None
    np.testing.assert_array_equal(volume.rows, np.arange(2, 56))
    np.testing.assert_array_equal(levels.directions[:, 0], level_rows()["X_dir"])
    np.testing.assert_array_equal(levels.time, level_rows()["time"])
    assert set(levels.labels["component"]) == {"A"} and set(levels.labels["line"]) == {"1"}
    assert (levels.u == 2e-6).all() and levels.options == {"slope": False}


def test_columns_are_found_by_name_in_the_order_of_the_machine(tmp_path):
    machine = edited(MACHINE, "w b X Y Z t", "w Y' b Z X t")
    rows = volume_rows()
    reordered = {name: rows[name] for name in reversed(rows)}
    volume = read_manifest(write_files(tmp_path, machine=machine, volume=csv_text(reordered))).sets[0]
    np.testing.assert_array_equal(volume.positions, np.array([rows["Y"], rows["Z"], rows["X"]]).T)


def test_byte_order_mark_windows_line_ends_comments_and_blank_lines(tmp_path):
    path = write_files(tmp_path)
    lines = VOLUME.split("\n")
    text = "\r\n".join(["# tracker 4711", "", lines[0], "# S1 first", *lines[1:]])
    (tmp_path / "volume.csv").write_bytes(b"\xef\xbb\xbf" + text.encode())
    (tmp_path / "campaign.toml").write_bytes(b"\xef\xbb\xbf" + MANIFEST.replace("\n", "\r\n").encode())
    volume = read_manifest(path).sets[0]
    np.testing.assert_array_equal(volume.readings[:, 0], volume_rows()["distance"])
    assert volume.where(0).endswith("volume.csv, row 5")


def test_u_as_number_and_as_column_which_wins(tmp_path):
    manifest = edited(MANIFEST, "{ constant = 0.0003, proportional = 3.0e-7 }", "0.002")
    assert (read_manifest(write_files(tmp_path / "a", manifest=manifest)).sets[0].u == 0.002).all()
    u = [0.001 * (i + 1) for i in range(54)]
    column = read_manifest(write_files(tmp_path / "b", manifest=manifest, volume=with_column("u", u))).sets[0].u
    np.testing.assert_array_equal(column[:, 0], u)


def test_tool_columns_and_temperature_with_gaps(tmp_path):
    manifest = edited(MANIFEST, "tool = [0.0, 0.0, -150.0]\n", "")
    extra = {"tool_x": [0.0] * 54, "tool_y": [25.0] * 54, "tool_z": list(range(54)), "temperature": ["", *[20.5] * 53]}
    volume = read_manifest(write_files(tmp_path, manifest=manifest, volume=csv_text(volume_rows() | extra))).sets[0]
    np.testing.assert_array_equal(volume.tool, np.array([extra["tool_x"], extra["tool_y"], extra["tool_z"]]).T)
    assert np.isnan(volume.temperature[0]) and (volume.temperature[1:] == 20.5).all()


def test_a_plan_lacks_readings(tmp_path):
    path = write_files(tmp_path, volume=without("distance"))
    with pytest.raises(InputError, match="column 'distance' is missing"):
        read_manifest(path)
    volume, levels = read_manifest(path, plan=True).sets
    assert np.isnan(volume.readings).all() and np.isnan(volume.u).all()
    assert volume.options["u"] == {"constant": 0.0003, "proportional": 3e-7}
    assert np.isfinite(levels.readings).all() and "u" not in levels.options


def test_a_hundred_thousand_rows_are_not_read_number_by_number(tmp_path):
    positions = np.random.default_rng(1).uniform((0, 0, -500), (1000, 600, 0), (50_000, 3))
    path = write_files(tmp_path, volume=csv_text(volume_rows(positions)))
    assert len(read_manifest(path).sets[0]) == 100_000
    assert calls(lambda: read_manifest(path)) < 500_000  # less than five a row of ten columns


def test_written_campaign_reads_back_with_all_digits(tmp_path):
    campaign = read_manifest(write_files(tmp_path / "a", volume=with_column("temperature", ["", *[20.1] * 53])))
    again = read_manifest(write_manifest(campaign, tmp_path / "b"))
    assert (again.stations, again.title, again.conditions) == (campaign.stations, campaign.title, campaign.conditions)
    assert again.machine == campaign.machine
    for a, b in zip(again.sets, campaign.sets, strict=True):
        assert (a.name, a.kind, a.options) == (b.name, b.kind, b.options)
        assert [asdict(e) for e in a.effects] == [asdict(e) for e in b.effects]
        for name in ("positions", "directions", "tool", "readings", "u"):
            np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
        assert {k: v.tolist() for k, v in a.labels.items()} == {k: v.tolist() for k, v in b.labels.items()}
    np.testing.assert_array_equal(again.sets[0].temperature, campaign.sets[0].temperature)


def test_a_plan_written_is_a_plan(tmp_path):
    plan = read_manifest(write_files(tmp_path / "a", volume=without("distance")), plan=True)
    path = write_manifest(plan, tmp_path / "b")
    assert "distance" not in (tmp_path / "b" / "volume.csv").read_text().split("\n")[0].split(",")
    assert read_manifest(path, plan=True).sets[0].options == plan.sets[0].options


def test_existing_folder_is_not_overwritten(tmp_path):
    path = write_files(tmp_path)
    with pytest.raises(OutputError, match="exists; choose another name or pass `overwrite=True`"):
        write_manifest(read_manifest(path), tmp_path)
    assert path.read_text() == MANIFEST


# ------------------------------------------------------------------------------------------------ bad manifests


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "volid-campaign/1",
            "volid-campaign/9",
            r"campaign\.toml: format is 'volid-campaign/9'; this volid reads 'volid-cam",
        ),
        ('machine = "machine.toml"\n', "", r"campaign\.toml: key 'machine' is missing"),
        ('machine = "machine.toml"', 'machine = "m.toml"', r"m\.toml: there is no such file"),
        ("title =", "titel =", r"unknown key 'titel'; did you mean 'title'\?"),
        ("title =", "= ", r"campaign\.toml, line 3: not valid TOML"),
        ("[conditions]", "[conditons]", r"unknown key 'conditons'; did you mean 'conditions'\?"),
        ('title = "Acceptance"', "title = 3", r"title is 3; expected a text"),
        ("known = true", "knwon = true", r"station 'S2': unknown key 'knwon'; did you mean 'known'\?"),
        ("known = true", 'known = "yes"', r"station 'S2': known is \"yes\"; expected true or false"),
        ('frame = "machine"', 'frame = "table"', r"station 'S2': frame is \"table\"; expected one of"),
        ("position = [1200.0, 650.0, -650.0]\n", "", r"station 'S2': known = true but there is no position"),
        ("[1200.0, 650.0, -650.0]", "[1200.0, 650.0]", r"position is .*; expected a list of 3 finite numbers"),
        ("[1200.0, 650.0, -650.0]", "[1200.0, nan, 0.0]", r"position is .*; expected a list of 3 finite numbers"),
        ('name = "S2"', 'name = "S1"', r"two stations are called 'S1'; give every station its own name"),
        (
            'name = "S2"',
            'name = "S2"\nbody = "C"',
            r"station 'S2': body is 'C'; expected one of workpiece, bed, tool, X, Y",
        ),
        ('name = "S2"', 'name = "S2"\nbody = "tol"', r"body is 'tol'; did you mean 'tool'\?"),
        ('name = "levels"', 'name = "volume"', r"two sets are called 'volume'; give every set its own name"),
        ('name = "levels"\n', "", r"set 2: key 'name' is missing"),
        (
            '"component"',
            '"komponent"',
            r"set 'levels': unknown kind 'komponent'; did you mean 'component'\?.*displacement",
        ),
        (
            '"component"',
            '"artefakt"',
            r"set 'levels': unknown kind 'artefakt'; did you mean 'artefact'\?.* expected one of distance",
        ),
        (
            'file = "volume.csv"',
            'fil = "volume.csv"',
            r"set 'volume': key 'file' is missing; found 'fil', which looks like it",
        ),
        ('file = "volume.csv"', "", r"set 'volume': key 'file' is missing"),
        ('file = "volume.csv"', 'file = "vol.csv"', r"vol\.csv: there is no such file"),
        (
            'file = "volume.csv"',
            'file = "volume.csv"\nrelativ = true',
            r"unknown key 'relativ'; did you mean 'relative'\?",
        ),
        (
            'file = "volume.csv"',
            'file = "volume.csv"\nrelative = 1',
            r"set 'volume': relative is 1; expected true or false",
        ),
        (
            'file = "volume.csv"',
            'file = "volume.csv"\ncalibrated_u = -1',
            r"calibrated_u is -1; expected a finite number >= 0",
        ),
        ("u = 2.0e-6", "u = 0", r"set 'levels': u is 0; expected a finite number > 0"),
        ("u = 2.0e-6", "u = -2.0e-6", r"set 'levels': u is -2e-06; expected a finite number > 0"),
        ("u = 2.0e-6", "u = nan", r"set 'levels': u is nan; expected a finite number > 0"),
        ("u = 2.0e-6", 'u = "2e-6"', r"u is \"2e-6\"; expected a number > 0 or \{ constant"),
        ("u = 2.0e-6", "", r"set 'levels': there is no standard uncertainty; add u = … \(mm or rad\)"),
        (
            "constant = 0.0003",
            "constant = -0.0003",
            r"set 'volume', u: constant is -0.0003; expected a finite number >= 0",
        ),
        ("constant = 0.0003", "const = 0.0003", r"set 'volume', u: unknown key 'const'; did you mean 'constant'\?"),
        (
            "{ constant = 0.0003, proportional = 3.0e-7 }",
            "{ constant = 0 }",
            r"expected a constant or proportional part > 0",
        ),
        ("tool = [0.0, 0.0, -150.0]\n", "", r"set 'volume': there is no tool vector; add tool = \[x, y, z\]"),
        ("tool = [0.0, 0.0, -150.0]", "tool = -150", r"set 'volume': tool is -150; expected a list of 3"),
        ('type = "scale"', 'type = "skale"', r"effect 'refraction': type is \"skale\"; .*did you mean 'scale'\?"),
        ('per = "station"', 'per = "stations"', r"per is \"stations\"; expected one of .*did you mean 'station'\?"),
        ("u = 2.0e-7", "u = 0.0", r"effect 'refraction': u is 0.0; expected a finite number > 0"),
        ('per = "station"', "", r"effect 'refraction': key 'per' is missing"),
    ],
)
def test_bad_manifest(tmp_path, old, new, message):
    with pytest.raises(InputError, match=message):
        read_manifest(write_files(tmp_path, manifest=edited(MANIFEST, old, new)))


def test_manifest_without_sets_or_of_another_type(tmp_path):
    with pytest.raises(InputError, match=r"there is no \[\[set\]\]"):
        read_manifest(write_files(tmp_path / "a", manifest=MANIFEST[: MANIFEST.index("[[set]]")]))
    with pytest.raises(InputError, match=r"this is a machine file \('volid-machine/1'\); expected a campaign"):
        read_manifest(write_files(tmp_path / "b", manifest=MACHINE))
    with pytest.raises(InputError, match=r"campaign\.toml: key 'format' is missing"):
        read_manifest(write_files(tmp_path / "c", manifest=""))


def test_two_effects_of_one_name(tmp_path):
    effect = MANIFEST[MANIFEST.index("[[set.effect]]") : MANIFEST.index('[[set]]\nname = "levels"')]
    with pytest.raises(InputError, match=r"set 'volume': two effects are called 'refraction'"):
        read_manifest(write_files(tmp_path, manifest=edited(MANIFEST, effect, effect + effect)))


# ------------------------------------------------------------------------------------------------ bad CSV files


@pytest.mark.parametrize(
    ("volume", "message"),
    [
        (
            without("distance"),
            r"volume\.csv, header: column 'distance' is missing; every row of a 'distance' set needs one",
        ),
        (edited(VOLUME, "distance", "distnce"), r"column 'distance' is missing; found 'distnce', which looks like it"),
        (without("station"), r"column 'station' is missing"),
        (without("Y"), r"column 'Y' is missing"),
        (edited(VOLUME, "segment", "segmnt"), r"header: unknown column 'segmnt'; did you mean 'segment'\?"),
        (with_column("X_dri", [1] * 54), r"unknown column 'X_dri'; did you mean 'X_dir'\?"),
        (with_column("distance ", [1] * 54), r"row 1: column 'distance' stands twice"),
        (with_cell("distance", "abc"), r"volume\.csv, row 4: distance is 'abc'; expected a finite number in mm"),
        (with_cell("distance", ""), r"volume\.csv, row 4: distance is empty; expected a finite number in mm"),
        (with_cell("distance", "nan"), r"volume\.csv, row 4: distance is 'nan'; expected a finite number"),
        (with_cell("distance", "-inf"), r"volume\.csv, row 4: distance is '-inf'; expected a finite number"),
        (
            with_cell("distance", '"812,5"'),
            r"row 4: distance is '812,5'; expected a finite number with a decimal point",
        ),
        (with_cell("distance", "1,2"), r"volume\.csv, row 4: 7 cells; expected 6, as in the header"),
        (with_cell("Y", "1e999"), r"volume\.csv, row 4: Y is '1e999'; expected a finite number in mm"),
        (with_cell("station", ""), r"volume\.csv, row 4: station is empty"),
        (
            with_column("u", [0.001, 0.0] + [0.001] * 52),
            r"volume\.csv, row 3: u is 0; expected a standard uncertainty > 0",
        ),
        (
            with_column("u", [0.001, -1] + [0.001] * 52),
            r"volume\.csv, row 3: u is -1; expected a standard uncertainty > 0",
        ),
        (with_column("u", [0.001, ""] + [0.001] * 52), r"volume\.csv, row 3: u is empty"),
        (with_column("X_dir", [1, 2] + [0] * 52), r"volume\.csv, row 3: X_dir is 2; expected \+1, -1, or 0"),
        (
            with_column("time", [1, "noon"] + [0] * 52),
            r"volume\.csv, row 3: time is 'noon'; expected a finite number in s",
        ),
        (with_column("time", [1, "inf"] + [0] * 52), r"volume\.csv, row 3: time is 'inf'; .*leave the cell empty"),
        (with_column("tool_x", [1] * 54), r"set 'volume': tool stands here and in .*volume\.csv; keep the key or"),
        ("", r"volume\.csv: the file is empty; expected a header row"),
        ("# nothing\n\n", r"volume\.csv: the file is empty"),
        ("X,Y,Z,station,segment,distance\n", r"volume\.csv: there is a header but no row"),
        (with_column("", [1] * 54), r"volume\.csv, header: column 7 has no name; name it, or leave it out"),
        (with_cell("station", '"S\n1"'), r"volume\.csv, row 4: a cell in quotes runs over several lines"),
    ],
)
def test_bad_csv(tmp_path, volume, message):
    with pytest.raises(InputError, match=message):
        read_manifest(write_files(tmp_path, volume=volume))


def test_incomplete_tool_columns(tmp_path):
    manifest = edited(MANIFEST, "tool = [0.0, 0.0, -150.0]\n", "")
    with pytest.raises(InputError, match=r"volume\.csv, header: column 'tool_y' is missing; a tool vector has three"):
        read_manifest(write_files(tmp_path, manifest=manifest, volume=with_column("tool_x", [1] * 54)))


def test_proportional_u_of_a_zero_reading(tmp_path):
    manifest = edited(MANIFEST, "constant = 0.0003, ", "")
    with pytest.raises(
        InputError, match=r"volume\.csv, row 4: u from the set's proportional part is 0; expected .* > 0"
    ):
        read_manifest(write_files(tmp_path, manifest=manifest, volume=with_cell("distance", "0.0")))
