"""Delimited text by a declared map of its columns: the map is stated once, remembered, and reads the next file."""

import re

import numpy as np
import pytest
from exact_chain import Truth, machine_toml
from support.machines import STRUCTURES, VERTICAL, exact_machine
from support.places import DATASETS, reference_file
from support.probe_centres import ONLY_LOCATIONS, TRUE
from support.touch_files import ORIGIN, save, tip
from support.touch_probe import touch

import volid
from volid.exceptions import InputError
from volid.io.campaign.imported import import_files
from volid.model.kinematics import nominal_point

ROUTER = """\
kind = "displacement"
centres = true
columns = { B = "B_deg", C = "C_deg", x = "x_mm", y = "y_mm", z = "z_mm" }
ignore = ["seq"]
tool = [0.0, 0.0, -229.407]
u = 0.013
"""


def table_of_touches(exact, data):
    """German spreadsheet: semicolons, decimal commas, own titles, Windows-1252."""
    places = tip(exact, data)
    lines = ["Weg;Drehung B °;Drehung C °;x µm;y µm;z µm;Größe"]
    for i, q in enumerate(data.q):
        numbers = [q[exact.column("B")], q[exact.column("C")], *(1e3 * places[i])]
        lines.append(";".join([f"W{data.group[i]}", *(f"{v:.4f}".replace(".", ",") for v in numbers), "1"]))
    return "\r\n".join(lines).encode("cp1252")


MAP = f"""\
machine = "machine.toml"
kind = "displacement"
touches = true
columns = {{ path = "Weg", B = "Drehung B °", C = "Drehung C °", x = "x µm", y = "y µm", z = "z µm" }}
ignore = ["Größe"]
tool = [0.0, 0.0, -230.0]
origin = {ORIGIN.tolist()}
csv = {{ delimiter = ";", decimal = ",", encoding = "cp1252", units = {{ x = "µm", y = "µm", z = "µm" }} }}
"""


@pytest.fixture
def touched(tmp_path):
    """Two files of one program, a map, and the machine."""
    exact = exact_machine(STRUCTURES["fork head CB"])
    (tmp_path / "machine.toml").write_text(machine_toml(exact, extra=ONLY_LOCATIONS))
    (tmp_path / "map.toml").write_text(MAP, encoding="utf-8")
    for seed, name in enumerate(("first.csv", "next.csv")):
        data = touch(exact, Truth({}, TRUE), np.random.default_rng(seed), {"B": 3, "C": 4})
        (tmp_path / name).write_bytes(table_of_touches(exact, data))
    return tmp_path


@pytest.mark.parametrize("output", ["first.h5", "made.toml"])
def test_a_map_is_remembered_by_the_campaign_that_it_made(touched, output, run):
    status, _, err = run("import", touched / "first.csv", "--map", touched / "map.toml", "-o", touched / output)
    assert status == 0, err
    keys = ["--machine", touched / "machine.toml"] if output.endswith("h5") else []
    status, _, err = run("import", touched / "next.csv", "--map", touched / output, *keys, "-o", touched / "next.h5")
    assert status == 0, err
    first, second = (volid.load_campaign(touched / name) for name in (output, "next.h5"))
    assert len(first.sets[0]) == len(second.sets[0]) == 24
    shift = np.abs(second.sets[0].positions - first.sets[0].positions).max()
    assert 1e-4 < shift < 0.01  # other touches of the same spheres
    remembered = second.conditions["imported"]["next"]
    assert remembered["as"] == "text" and remembered["columns"]["path"] == "Weg"
    assert remembered["csv"]["units"] == {"x": "µm", "y": "µm", "z": "µm"}
    assert np.shape(remembered["touches_fitted"]["residuals"]) == (24, 8)
    assert np.sqrt(np.mean(np.square(remembered["touches_fitted"]["residuals"]))) == pytest.approx(
        0.001, abs=2e-4
    )  # √(f/n) u
    assert remembered["touches_fitted"]["radius"] == pytest.approx([15.7] * 24, abs=0.01)


def test_a_set_of_a_manifest_is_a_map_and_may_be_text_itself(touched, run):
    manifest = (
        'format = "volid-campaign/1"\nmachine = "machine.toml"\n[[set]]\nname = "a"\nfile = "first.csv"\nas = "text"\n'
    )
    (touched / "campaign.toml").write_text(manifest + MAP.partition("\n")[2], encoding="utf-8")
    stated = volid.load_campaign(touched / "campaign.toml")
    assert run("import", touched / "next.csv", "--map", touched / "campaign.toml", "-o", touched / "n.h5")[0] == 0
    found = volid.load_campaign(touched / "n.h5")
    assert len(found.sets[0]) == len(stated.sets[0]) == 24


def test_the_keys_of_a_map_as_options(run, tmp_path):
    (tmp_path / "machine.toml").write_text(machine_toml(VERTICAL))
    save(tmp_path / "t.csv", ["Xpos,Ypos,Zpos,who,what", "10,20,-30,S1,500.1", "20,30,-40,S1,510.2"])
    keys = ["kind=distance", 'columns={X="Xpos",Y="Ypos",Z="Zpos",station="who",distance="what"}']
    options = ["--as", "text", "--machine", tmp_path / "machine.toml", "--tool", "0,0,-150", "--u", "0.001"]
    for key in keys:
        options += ["--key", key]
    status, _text, err = run("import", tmp_path / "t.csv", *options, "-o", tmp_path / "c.h5")
    assert status == 0, err
    (readings,) = volid.load_campaign(tmp_path / "c.h5").sets
    assert readings.readings.ravel().tolist() == [500.1, 510.2] and readings.kind == "distance"


def test_points_by_name_with_positions_from_another_file(tmp_path):
    """A tracker's own export: name, x, y, z in metres; the commanded positions stand in a CSV of the plan."""
    (tmp_path / "machine.toml").write_text(machine_toml(VERTICAL))
    q = np.random.default_rng(0).uniform([0, 0, -400], [700, 400, 0], (12, 3))  # X, Y, Z in machine order
    points = VERTICAL.functional_point(q, (0.0, 0.0, -150.0))
    rows = [f"P{i};{p[0] / 1e3:.7f};{p[1] / 1e3:.7f};{p[2] / 1e3:.7f}".replace(".", ",") for i, p in enumerate(points)]
    save(tmp_path / "t.txt", ["name;E;N;H", *reversed(rows), "P99;1,0;2,0;3,0"])
    save(
        tmp_path / "plan.csv",
        [
            "name,X,Y,Z,tool_x,tool_y,tool_z,station",
            *(f"P{i},{x!r},{y!r},{z!r},0,0,-150,T" for i, (x, y, z) in enumerate(q.tolist())),
        ],
    )
    keys = {
        "as": "text",
        "kind": "point",
        "columns": {"x": "E", "y": "N", "z": "H"},
        "csv": {"units": {"x": "m", "y": "m", "z": "m"}},
        "positions": str(tmp_path / "plan.csv"),
        "match": "name",
        "u": 0.01,
    }
    campaign = import_files([tmp_path / "t.txt"], tmp_path / "machine.toml", keys)
    (readings,) = campaign.sets
    np.testing.assert_allclose(readings.positions, q[::-1], atol=1e-12)
    np.testing.assert_allclose(readings.readings, points[::-1], atol=1e-4)
    assert any("1 without a position left out: P99" in w for w in campaign.warnings)
    with pytest.raises(InputError, match="12 positions for 13 rows; expected as many, in the same order"):
        import_files([tmp_path / "t.txt"], tmp_path / "machine.toml", {k: v for k, v in keys.items() if k != "match"})
    with pytest.raises(InputError, match="match without positions"):
        import_files(
            [tmp_path / "t.txt"], tmp_path / "machine.toml", {k: v for k, v in keys.items() if k != "positions"}
        )
    with pytest.raises(InputError, match=r"(?s)t.txt.*'nam'.*by"):
        import_files([tmp_path / "t.txt"], tmp_path / "machine.toml", keys | {"match": "nam"})


def test_a_real_file_of_sphere_centres_as_it_is(run, tmp_path):
    """101 centres of a router; source: alj333/linuxcnc. As in datasets/five_axis_router, without touching the file."""
    (tmp_path / "map.toml").write_text(ROUTER)
    machine = DATASETS / "five_axis_router/machine.toml"
    file = reference_file("five_axis_sphere_centres.csv")
    status, _text, err = run(
        "import", file, "--map", tmp_path / "map.toml", "--machine", machine, "-o", tmp_path / "c.h5"
    )
    assert status == 0, err
    (readings,) = volid.load_campaign(tmp_path / "c.h5").sets
    assert len(readings) == 101 and readings.kind == "displacement"
    rows = np.loadtxt(file, delimiter=",", skiprows=1)
    machine = volid.load_machine(machine)
    np.testing.assert_array_equal(readings.positions[:, machine.index("B")], rows[:, 1])
    np.testing.assert_allclose(nominal_point(machine, readings.positions, readings.tool), rows[:, 3:], atol=1e-9)


WRONG_MAPS = {
    "nothing": (
        'format = "volid-campaign/1"\nmachine = "m.toml"\n',
        r"no set of it states columns or was imported as text",
    ),
    "machine file": (
        'format = "volid-machine/1"\n',
        r'format is "volid-machine/1"; expected a map, or a campaign that holds one',
    ),
    "two": (
        'format = "volid-campaign/1"\nmachine = "m.toml"\n'
        '[[set]]\nname = "a"\ncolumns = { x = "1" }\n[[set]]\nname = "b"\ncolumns = { x = "2" }\n',
        r"sets a, b have maps of their own; expected one map",
    ),
    "unknown column": (MAP.replace('"Weg"', '"Wge"'), r"columns names 'Wge', which is no column of .*first.csv"),
    "unknown key": (MAP + "colour = 3\n", r"unknown key 'colour'"),
    "encoding twice": (MAP + 'encoding = "utf-8"\n', r"encoding stands in the set and in its csv; keep one of them"),
}


@pytest.mark.parametrize("what", WRONG_MAPS)
def test_wrong_maps_are_named(touched, what, run):
    text, message = WRONG_MAPS[what]
    (touched / "wrong.toml").write_text(text, encoding="utf-8")
    options = ["--machine", touched / "machine.toml", "-o", touched / "c.h5"]
    status, _, err = run("import", touched / "first.csv", "--map", touched / "wrong.toml", *options)
    assert status == 2
    assert re.search(message, " ".join(err.split())), err
    assert not (touched / "c.h5").exists()


def test_a_table_without_a_map_says_what_is_missing(touched, run):
    err = run("import", touched / "first.csv", "--machine", touched / "machine.toml", "-o", touched / "c.h5")[2]
    assert "this seems to be a table of delimited columns" in err and "a map of its columns (text)" in err
    status, text, _ = run("import", "--formats")
    assert status == 0 and "text: delimited text by a declared map" in text
