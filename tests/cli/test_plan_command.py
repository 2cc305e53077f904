"""`volid plan`: plans from the command line, chosen spheres and tools, the way through simulate and fit."""

import json

import numpy as np
import pytest
from support.machines import exact_of
from support.places import MODELS

from volid.cli.plan_tests import DESCRIBED
from volid.exceptions import InputError, OutputError
from volid.fitting.location_errors import location_parameter
from volid.io import load_campaign, read_machine, write_manifest
from volid.io.solutions import read_solution
from volid.io.truths import load_truth
from volid.planning import iso10791_path, rtest_static_grid
from volid.planning.catalogue import MAKERS

TRUNNION = MODELS / "wCAYXbZt_trunnion.toml"
ROTARY = [f for f in sorted(MODELS.glob("*.toml")) if set("ABC") & set(f.stem.split("_")[0])]
ROUNDED = 1e-6  # mm: planned positions are rounded to 1e-6, half of it on each of three axes
SHORT_TRAVEL = "wCbZXYBt_mill_turn"  # may not follow at every pair of angles
LOCATIONS_ONLY = '\n[model.functions]\n"E??" = false\n"E?0[XYZS]" = false\n'


def sphere_of(readings):
    return np.array([readings.options["sphere"][s] for s in readings.labels["sphere"]])


@pytest.mark.parametrize("file", ROTARY, ids=lambda f: f.stem)
def test_chosen_places_lie_within_the_travels_and_in_the_nest_of_the_exact_chain(file):
    machine = read_machine(file)
    plan = rtest_static_grid(machine, n1=9, n2=7)
    readings = plan.sets[0]
    point = exact_of(machine).functional_point(readings.positions, readings.tool)
    np.testing.assert_allclose(point, sphere_of(readings), rtol=0, atol=ROUNDED)
    assert not plan.warnings or file.stem == SHORT_TRAVEL
    rotary = [a for a in machine.axes if not a.is_linear]
    spheres = np.array(list(readings.options["sphere"].values()))
    tools = np.unique(readings.tool, axis=0)
    if any(a.primed for a in rotary):  # around the axis of the table, on no line, off the axis
        table = rotary[0]
        beside = np.linalg.norm(np.cross(spheres - table.point, table.unit_vector), axis=1)
        assert len(spheres) == 3 and beside.min() > (9.0 if file.stem == SHORT_TRAVEL else 19.0)
        assert np.linalg.matrix_rank(spheres - spheres.mean(axis=0), tol=5.0) == 2
    else:
        assert len(spheres) == 1
    several = np.linalg.matrix_rank(tools - tools.mean(axis=0), tol=5.0)
    assert several == (0 if all(a.primed for a in rotary) else 2)


def test_on_a_table_alone_the_chosen_circle_is_the_widest_that_the_travels_allow(tmp_path):
    """C on a cross table: a sphere at radius r needs X and Y = ±r, so a travel of ±50 mm allows 49 mm (1 mm for rounding)."""
    text = """format = "volid-machine/1"\nname = "table"\nstructure = "w C' Y' X' b Z t"
[axis.X]\ntravel = [-50.0, 50.0]\n[axis.Y]\ntravel = [-60.0, 60.0]\n[axis.Z]\ntravel = [0.0, 500.0]
[axis.C]\ntravel = [0.0, 360.0]\npoint = [0.0, 0.0, 0.0]\n"""
    (tmp_path / "m.toml").write_text(text)
    plan = rtest_static_grid(read_machine(tmp_path / "m.toml"), n1=361)
    radius = np.linalg.norm(np.array(list(plan.sets[0].options["sphere"].values()))[:, :2], axis=1)
    np.testing.assert_allclose(radius, 49.0, atol=0.75)
    assert plan.warnings == ()


def test_given_spheres_and_tools_are_kept_and_completed():
    machine = read_machine(MODELS / "wCXbYZBt_swivel_head.toml")
    plan = rtest_static_grid(machine, {"Q": (30, 20, 300)}, None, 3, 3).sets[0]
    assert plan.options["sphere"] == {"Q": [30.0, 20.0, 300.0]} and len(np.unique(plan.tool, axis=0)) == 3
    plan = rtest_static_grid(machine, None, [(0, 0, -70), (9, 0, -70)], 3, 3).sets[0]
    assert len(plan.options["sphere"]) == 2
    assert {tuple(t) for t in plan.tool.tolist()} == {(0.0, 0.0, -70.0), (9.0, 0.0, -70.0)}
    plan = iso10791_path(machine, "CK4", tool=(0, 0, -70), n=5).sets[0]
    assert list(plan.options["sphere"]) == ["P1"] and (plan.tool == (0, 0, -70)).all()


def test_from_plan_to_fit(run, tmp_path):
    """All eight location errors of the trunnion come back as they stand in the truth beside the campaign."""
    machine, plan = tmp_path / "m.toml", tmp_path / "my plan.toml"
    machine.write_text(TRUNNION.read_text() + LOCATIONS_ONLY)
    status, out, err = run("plan", machine, "--test", "static-grid", "--points", "9,4", "-o", plan)
    assert (status, err) == (0, "")
    assert "set 'static grid': 108 rows of kind displacement" in out and f"written: {plan}" in out
    assert sorted(f.name for f in tmp_path.iterdir()) == [
        "m.toml", "my plan.machine.toml", "my plan.static_grid.csv", "my plan.toml",
    ]  # fmt: skip
    header = (tmp_path / "my plan.static_grid.csv").read_text().splitlines()[0]
    assert header == "C,A,Y,X,Z,tool_x,tool_y,tool_z,sphere"  # no readings, u is a key
    status, _, err = run("simulate", machine, "--plan", plan, "--seed", 3, "-o", tmp_path / "c.h5")
    assert status == 0, err  # progress is shown when it takes long
    assert run("fit", tmp_path / "c.h5", "-o", tmp_path / "s.h5")[0] == 0
    solution, truth = read_solution(tmp_path / "s.h5"), load_truth(tmp_path / "c.truth.h5")
    for name in ("EX0C", "EY0C", "EA0C", "EB0C", "EY0A", "EZ0A", "EB0A", "EC0A"):
        found = location_parameter(solution, name)
        assert abs(found.value - truth.constants[name]) < 4.0 * found.u < 0.2 * abs(truth.constants[name]), name


@pytest.mark.parametrize(
    ("arguments", "kind", "rows"),
    [
        (["--test", "bk1", "--points", "5", "--u", "0.001"], "displacement", 10),
        (["--test", "K4", "--points", "5", "--sphere", "Q=10,0,60", "--sensor-on", "workpiece"], "displacement", 10),
        (["--test", "cone-frustum", "--points", "9", "--length", "80", "--inclination", "30"], "distance", 9),
        (["--test", "standard", "--points", "5"], "distance", 30),
        (["circles", "--planes", "xy", "--length", "20", "--calibrated-u", "inf", "--points", "9"], "distance", 18),
        (["step-gauge", "--points", "3", "--tool", "0,0,-120"], "length", 21),
    ],
)  # fmt: skip
def test_every_test_is_written_and_read_back(arguments, kind, rows, run, tmp_path):
    status, out, err = run("plan", TRUNNION, *arguments, "-o", tmp_path / "p.toml", "--json")
    assert (status, err) == (0, "")
    assert [(s["kind"], s["rows"]) for s in json.loads(out)["sets"]] == [(kind, rows)]
    plan = load_campaign(tmp_path / "p.toml", plan=True)
    readings = plan.sets[0]
    assert len(readings) == rows and np.isnan(readings.readings).all()
    if "--u" in arguments:
        assert (readings.u == 0.001).all()
    if kind == "displacement":
        point = exact_of(plan.machine).functional_point(readings.positions, readings.tool)
        np.testing.assert_allclose(point, sphere_of(readings), rtol=0, atol=ROUNDED)
    if "80" in arguments:
        bar = exact_of(plan.machine).functional_point(readings.positions, readings.tool)
        np.testing.assert_allclose(np.linalg.norm(bar - plan.stations[0].position, axis=1), 80.0, atol=ROUNDED)


def test_the_test_may_stand_behind_the_machine(run, tmp_path):
    vertical, one, other = MODELS / "wXYbZt_vertical.toml", tmp_path / "one.toml", tmp_path / "other.toml"
    assert run("plan", vertical, "standard", "-o", one)[0] == 0
    assert run("plan", vertical, "--test", "standard", "-o", other)[0] == 0
    assert (tmp_path / "one.volume.csv").read_text() == (tmp_path / "other.volume.csv").read_text()
    status, text, err = run("plan", vertical, "standard", "--test", "K1", "-o", tmp_path / "p.toml")
    assert (status, text) == (2, "")
    assert "two tests are named, standard and --test K1; keep one" in err
    assert (
        "--test tandard is unknown; expected one of" in run("plan", vertical, "tandard", "-o", tmp_path / "p.toml")[2]
    )


def test_what_is_too_much_is_named_with_the_usage_of_the_verb(run, tmp_path):
    status, _, err = run("plan", TRUNNION, "-o", tmp_path / "p.toml", "K1", "surplus")
    assert status == 2
    assert err.startswith("usage: volid plan ")
    assert "volid plan: error: unrecognized arguments: " in err and err.endswith("surplus\n")


def test_positions_left_out_are_named_kept_and_make_status_1(run, tmp_path):
    arguments = ("--sphere", "P1=290,0,30", "--tool", "0,0,-120", "--points", "5,13")
    status, out, err = run("plan", TRUNNION, *arguments, "-o", tmp_path / "p.toml")
    assert status == 1
    assert "positions left out: " in err and "Z would need" in err
    plan = load_campaign(tmp_path / "p.toml", plan=True)
    (warning,) = plan.warnings
    assert warning in err
    left = int(warning.split(": ")[1].split()[0])
    assert len(plan.sets[0]) == 65 - left
    assert f"{65 - left} rows" in out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--test", "BK7"], "--test BK7 is unknown; expected one of static-grid, cone-frustum"),
        (["--test", "AK1"], "test 'AK1' is not for machine .* expected BK1, BK2, BK4"),
        (["--test", "BK1", "--points", "3,4"], "--points 3,4: the test BK1 takes one number"),
        (
            ["--test", "BK1", "--length", "100"],
            "--length is not for the test BK1, but for cone-frustum, .*leave it out",
        ),
        (["--sensor-on", "tool", "--test", "standard"], "--sensor-on is not for the test standard"),
        (["--u", "0"], "--u: '0': expected a finite number > 0 in mm"),
        (["--sphere", "P=1,2,3", "--sphere", "P=1,2,4"], "two spheres have one name"),
        (["--test", "K1", "--tool", "0,0,1", "--tool", "0,0,2"], "--tool stands 2 times; the test K1 takes one"),
        (["--sphere", "1,2,3"], "'1,2,3' is no sphere; expected NAME=x,y,z in mm"),
        (["--points", "1"], "'1' are no numbers of positions"),
    ],
)
def test_what_is_wrong_is_said(arguments, message, run, tmp_path):
    status, _, err = run("plan", TRUNNION, *arguments, "-o", tmp_path / "p.toml")
    assert status == 2
    with pytest.raises(AssertionError, match=message):
        raise AssertionError(err)
    assert list(tmp_path.iterdir()) == []


def test_outputs_are_manifests_and_nothing_is_overwritten(run, tmp_path):
    status, _, err = run("plan", TRUNNION, "-o", tmp_path / "plan.h5")
    assert status == 2 and "a plan is a manifest; choose a name that ends in .toml" in err
    (tmp_path / "p.static_grid.csv").write_text("mine\n")
    arguments = ("plan", TRUNNION, "--points", "3", "-o", tmp_path / "p.toml")
    status, _, err = run(*arguments)
    assert status == 2 and "p.static_grid.csv exists; choose another name or pass --force" in err
    assert [f.name for f in tmp_path.iterdir()] == ["p.static_grid.csv"]
    assert run(*arguments, "--force")[0] == 0
    assert (tmp_path / "p.static_grid.csv").read_text().startswith("C,A,")


def test_a_manifest_by_name_and_its_warnings(tmp_path):
    plan = rtest_static_grid(read_machine(TRUNNION), {"P1": (290, 0, 30)}, (0, 0, -120), 5, 13)
    path = write_manifest(plan, tmp_path / "b.toml")
    assert path == tmp_path / "b.toml"
    again = load_campaign(path, plan=True)
    assert again.warnings == plan.warnings and again.machine == plan.machine
    path.write_text(path.read_text().replace("warnings = [", "warnings = [1, "))
    with pytest.raises(InputError, match=r"warnings is .*; expected a list of texts"):
        load_campaign(path, plan=True)
    with pytest.raises(OutputError, match=r"b\.machine\.toml exists"):
        write_manifest(plan, path)


def test_every_plan_is_described_and_every_description_is_a_plan():
    assert [d.name for d in DESCRIBED] == list(MAKERS)
