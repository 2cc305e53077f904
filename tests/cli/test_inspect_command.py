"""`volid inspect`, and files of a control under `simulate` and `load_control`: values by hand from the lines of a COMP_FILE."""

import json

import numpy as np
import pytest
from support.control_cases import crossed, levered, written

import volid
from volid.cli import main

MACHINE = "models/wYXbZt_vertical.toml"  # X 0..1000, Y 0..600, Z -500..0 mm
X = "0 0.000 0.002\n500 500.010 500.013\n1000 999.996 999.999\n"
# one digit wrong at 300 in +, and the table ends 50 mm before the travel
Y = "0 0.000 0.001\n100 100.002 100.003\n200 200.004 200.005\n300 300.046 300.007\n400 400.008 400.009\n500 500.009 500.01\n"
Y += "550 550.01 550.012\n"


@pytest.fixture
def files(tmp_path):
    (tmp_path / "old").mkdir()
    for name, text in (("x.comp", X), ("y.comp", Y)):
        (tmp_path / "old" / name).write_text(text)
    return tmp_path / "old"


def run(capsys, *words):
    status = main([str(w) for w in words])
    out, err = capsys.readouterr()
    return status, out, err


def test_it_says_what_the_files_hold_and_what_is_odd(files, capsys):
    status, out, err = run(capsys, "inspect", files / "x.comp", files / "y.comp", "--machine", MACHINE)
    assert status == 1
    lines = [" ".join(line.split()) for line in out.splitlines()]
    assert "X over X (x.comp) 3 0 1000 500 13.00 500 -2.67 3.00 µm" in lines
    assert "assumed recognised as files of linuxcnc (LinuxCNC, screw compensation (COMP_FILE))" in lines
    assert "- Y over Y: Y travels from 0 to 600; above 550 the end value is held" in lines
    # 46 µm between 4 and 8 µm: 40 µm off their line
    assert "Y over Y: the value at 300 in + stands +40.0 µm off the line of its neighbours" in err


def test_a_good_file_is_good(files, capsys):
    status, _, err = run(capsys, "inspect", files / "x.comp", "--cnc", "linuxcnc", "--machine", MACHINE)
    assert (status, err) == (0, "")


def test_values_in_micrometres_are_no_deviations(tmp_path, capsys):
    """Corrections of type 1 in µm where mm are expected: 12 µm become 12 mm."""
    (tmp_path / "x.comp").write_text("0 0.0 2.0\n500 -10.0 -12.0\n1000 4.0 1.0\n")
    command = ("inspect", tmp_path / "x.comp", "--cnc", "linuxcnc", "--option", "comp_file_type=1")
    status, _, err = run(capsys, *command)
    assert status == 1
    assert (
        "X over X: values up to 12 mm are no deviations of a machine; the file is meant in another unit or sense" in err
    )


def test_values_at_positions_and_directions(files, tmp_path, capsys):
    (tmp_path / "points.csv").write_text("X,X_dir\n500,1\n500,-1\n250,0\n2000,1\n")
    _, out, err = run(capsys, "inspect", files / "x.comp", "--cnc", "linuxcnc", "--at", tmp_path / "points.csv")
    assert "1 of 4 points lie beyond X over X (0 … 1000): the end value is held" in err
    names, *rows = [line for line in out.splitlines() if not line.startswith("#")]
    assert names == "X,X_dir,ex,ey,ez,correction_X"
    found = np.array([[float(v) for v in row.split(",")] for row in rows])
    np.testing.assert_allclose(
        found[:, 2], [0.010, 0.013, 0.00625, -0.004], atol=1e-12
    )  # 250: mean of 5 and 7.5; end held
    np.testing.assert_allclose(found[:, 5], -found[:, 2], atol=1e-12)


def test_json_has_the_numbers_of_the_tables(files, capsys):
    _, out, _ = run(capsys, "inspect", files / "x.comp", "--cnc", "linuxcnc", "--json")
    found = json.loads(out)
    assert (found["cnc"], found["types"], found["tables"][0]["unit"]) == ("linuxcnc", ["L-POS"], "mm")
    np.testing.assert_allclose(found["tables"][0]["reverse"], [0.002, 0.013, -0.001], atol=1e-12)


def test_files_are_written_for_another_control(files, tmp_path, capsys):
    command = ("inspect", files / "x.comp", "--cnc", "linuxcnc", "--to", "linuxcnc", "--to-option", "comp_file_type=1")
    status, out, _ = run(capsys, *command, "-o", tmp_path / "new")
    assert status == 0 and "read back and found to move the axes alike" in out
    rows = np.loadtxt(tmp_path / "new" / "x.comp")
    np.testing.assert_allclose(rows, [[0, 0, -0.002], [500, -0.01, -0.013], [1000, 0.004, 0.001]], atol=1e-9)
    assert "COMMISSIONING.md" in {p.name for p in (tmp_path / "new").iterdir()}


def test_a_folder_of_an_export_is_read_without_its_sheets(files, tmp_path, capsys):
    run(capsys, "inspect", files / "x.comp", "--cnc", "linuxcnc", "--to", "linuxcnc", "-o", tmp_path / "new")
    status, out, _ = run(capsys, "inspect", tmp_path / "new", "--machine", MACHINE)
    assert status == 0 and "COMMISSIONING" not in out and "X over X" in out


def test_own_tables_are_inspected_and_converted(tmp_path, capsys):
    keys = ["format: volid-table/1", "type: L-POS", "function: EXX", "values: compensation", "rows: absolute"]
    keys += ["applied: kinematic model", "zero: X = 0 mm", "period: none", "datum: primary axis X"]
    text = "\n".join([*(f"# {key}" for key in keys), "X,EXX(+),EXX(-)", "0,0,-0.002", "1000,0.004,0.001", ""])
    (tmp_path / "EXX.csv").write_text(text)
    command = ("inspect", tmp_path / "EXX.csv", "--machine", MACHINE, "--to", "linuxcnc", "-o", tmp_path / "out")
    status, out, _ = run(capsys, *command)
    assert status == 0 and "tables and grids of volid" in out
    np.testing.assert_allclose(
        np.loadtxt(tmp_path / "out" / "x.comp"), [[0, 0, 0.002], [1000, 999.996, 999.999]], atol=1e-9
    )


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["nowhere.comp"], "nowhere.comp: there is no such file"),
        (["{x}", "--cnc", "linuxcnc", "--option", "comp_file_type=1"], "if the files need one, name it with --machine"),
        (["pyproject.toml"], "pyproject.toml: looks like a file of no control that volid knows"),
        (["{x}", "--cnc", "linuxnc"], "is no control that volid knows; did you mean linuxcnc"),
        (
            ["{x}", "--to", "sinumerik-cec", "-o", "out"],
            "state --to-sign error (actual - nominal) or --to-sign compensation",
        ),
        (
            ["{x}", "--to", "heidenhain", "-o", "out"],
            "--to heidenhain is no control that volid knows; did you mean heidenhain-",
        ),
        (["{x}", "--to", "linuxcnc"], "--to linuxcnc writes files; name a folder for them with -o"),
        (["{x}", "-o", "out"], "nothing is written without --at POINTS.csv or --to NAME"),
        (["{x}", "--mean"], "--mean says how files of another control are made; name it with --to"),
        (["{x}", "--at", "p.csv", "--to", "linuxcnc"], "--at and --to have one output each"),
        (["{x}", "--option", "comp_file_type"], "'comp_file_type' is no option of a control; expected KEY=VALUE"),
        (["{x}", "--cnc", "linuxcnc", "--sign", "error"], "--sign error, but its values are actual position"),
    ],
)
def test_what_is_wrong_is_said(files, capsys, words, message):
    try:
        status = main(["inspect", *(w.format(x=files / "x.comp") for w in words)])
    except SystemExit as error:
        status = error.code
    assert status == 2
    assert message in capsys.readouterr().err.replace("\n", " ")


def test_a_simulated_machine_has_the_files_of_a_control_loaded(files, tmp_path, capsys):
    """A machine without errors, corrected by the file: a laser, zeroed at X 0, reads minus what the file takes for errors."""
    machine = volid.load_machine(MACHINE)
    (tmp_path / "plan.toml").write_text(
        'format = "volid-campaign/1"\nmachine = "machine.toml"\n[[set]]\nname = "X"\nkind = "component"\nfile = "X.csv"\n'
        "tool = [0.0, 0.0, 0.0]\nu = 1e-6\n"
    )
    (tmp_path / "machine.toml").write_text(machine.text)
    (tmp_path / "X.csv").write_text("X,Y,Z,X_dir,component\n0,300,-250,1,X\n500,300,-250,1,X\n500,300,-250,-1,X\n")
    plan = volid.load_campaign(tmp_path / "plan.toml", plan=True)
    nothing = volid.Truth(machine, {}, {}, {}, {})
    control = volid.load_control(machine, [files / "x.comp"], cnc="linuxcnc")
    campaign, _ = volid.simulate(plan, nothing, noise=False, control=control)
    readings = campaign.sets[0].readings[:, 0]
    np.testing.assert_allclose(readings - readings[0], [0.0, -0.010, -0.013], atol=1e-9)


def test_simulate_records_the_files_and_keeps_them(files, tmp_path, capsys):
    plan = tmp_path / "plan.toml"
    run(capsys, "plan", MACHINE, "-o", plan)
    command = ("simulate", MACHINE, "--plan", plan, "--allow-outside", "--compensation", files / "x.comp")
    status, out, err = run(capsys, *command, "--compensation-cnc", "linuxcnc", "-o", tmp_path / "c.h5")
    assert status in (0, 1), err
    assert "active compensation: L-POS: x.comp for linuxcnc, sha256" in out
    campaign = volid.load_campaign(tmp_path / "c.h5")
    assert campaign.active_files[0].files == {"x.comp": X.encode()}
    (found,) = volid.recorded_compensations(campaign)
    assert found.words in campaign.conditions["active_compensations"]


def test_points_with_axes_that_no_file_names_ask_for_the_machine(files, tmp_path, capsys):
    (tmp_path / "points.csv").write_text("X,Y,Z\n0,0,0\n")
    status, _, err = run(capsys, "inspect", files / "x.comp", "--at", tmp_path / "points.csv")
    assert status == 2 and "unknown column 'Y'" in err and "the files name X alone; name it with --machine" in err


def test_what_a_folder_holds_besides_is_named(files, capsys):
    """A damaged table beside two good ones, and a table of another control: neither is read, both are named."""
    (files / "z.comp").write_text("; z\n0 0 0\n")
    (files / "old.ini").write_text("$AN_CEC[0,0]=0\n")
    (files / "letter.txt").write_text("hello\n")
    err = run(capsys, "inspect", files, "--machine", MACHINE)[2]
    assert "left out, because linuxcnc does not know them: old.ini, z.comp\n" in err


def test_positions_without_a_machine_are_said_to_be_made_up(tmp_path, capsys):
    """Z is moved over X: where Z stands then is in no file."""
    values = "".join(f"$AN_CEC[0,{i}]={v}\n" for i, v in enumerate((0.0, 0.010, 0.020)))
    settings = {"INPUT_AXIS": "(X1)", "OUTPUT_AXIS": "(Z1)", "STEP": 100, "MIN": 0, "MAX": 200, "DIRECTION": 0}
    lines = "".join(f"$AN_CEC_{k}[0]={v}\n" for k, v in {**settings, "MULT_BY_TABLE": 0, "IS_MODULO": 0}.items())
    (tmp_path / "cec.ini").write_text(values + lines)
    command = ("inspect", tmp_path / "cec.ini", "--sign", "error", "--to", "heidenhain-com")
    _, out, _ = run(capsys, *command, "-o", tmp_path / "a")
    assert "no table is over Z: positions of it in the commissioning sheet are made up" in out
    assert "are made up" in (tmp_path / "a" / "COMMISSIONING.md").read_text(encoding="utf-8")
    assert "made up" not in run(capsys, *command, "-o", tmp_path / "b", "--machine", MACHINE)[1]


def test_a_grid_without_a_tool_vector_is_not_said_to_be_for_one(tmp_path, capsys):
    """A grid of ISG holds three translations alone, whatever tool it was made for."""
    rows = "".join(f"{x} {y} {z} 0.01 0 0\n" for z in (-500, 0) for y in (0, 600) for x in (0, 1000))
    (tmp_path / "vol.csv").write_text(f"X Y Z EXX EYY EZZ\n{rows}")
    _, out, _ = run(capsys, "inspect", tmp_path / "vol.csv", "--cnc", "isg-volcomp", "--machine", MACHINE)
    words = " ".join(out.split())
    assert "without a tool vector: the same values with every tool" in words and "0, 0, 0" not in words


@pytest.mark.parametrize(
    ("multiplied", "said"),
    [
        ("also", "plain tables and tables of products were combined as the control adds them"),
        ("not", "were read as one"),
    ],
)
def test_products_are_said_to_differ_from_the_list_of_the_file(tmp_path, capsys, multiplied, said):
    text = written("sinumerik-cec", levered(), "error", multiplied=multiplied)["nc_cec.ini"]
    words = ("--cnc", "sinumerik-cec", "--sign", "error", "--option", f"multiplied={multiplied}", "--machine", MACHINE)
    (tmp_path / "p.ini").write_text(text)
    notes = " ".join(run(capsys, "inspect", tmp_path / "p.ini", *words)[1].partition("notes")[2].split())
    assert said in notes and notes.count("differ from the list in the file") == 1
    assert said in json.loads(run(capsys, "inspect", tmp_path / "p.ini", *words, "--json")[1])["notes"][0]
    (tmp_path / "p.ini").write_text(written("sinumerik-cec", crossed(), "error", multiplied=multiplied)["nc_cec.ini"])
    assert "differ from the list" not in " ".join(run(capsys, "inspect", tmp_path / "p.ini", *words)[1].split())
