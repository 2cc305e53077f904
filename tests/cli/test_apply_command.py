"""`volid apply` on the command line: files in, files out, statuses, messages in the words of its options."""

import json

import numpy as np
import pytest

import volid

PROGRAM = "%\r\n(part)\r\nG21 G90 G17\r\nG0 X0 Y0 Z50\r\nG1 X200 F100 ; \xb5m\r\nM30\r\n%\r\n"
GRID = """\
# format: volid-grid/1
# type: L-VOL
# values: error
# frame: machine
# datum: X
# tool vector: 0, 0, -150 mm
X,dX,dY,dZ,dA,dB,dC,u_dX,u_dY,u_dZ,u_dA,u_dB,u_dC,outside
0,0,0,0,0,0,0,0,0,0,0,0,0,0
1000,0.1,0,0,0,0,0,0,0,0,0,0,0,0
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    (tmp_path / "grid.csv").write_text(GRID)
    (tmp_path / "part.nc").write_bytes(PROGRAM.encode("cp1252"))
    monkeypatch.chdir(tmp_path)
    return tmp_path


OPTIONS = ("--offset", "G54=100,100,-200", "--tool", "0,0,-150", "-o", "out.nc")


def test_a_program_is_corrected_and_says_by_what(run, folder):
    status, output, _ = run("apply", "grid.csv", "part.nc", *OPTIONS)
    text = (folder / "out.nc").read_bytes().decode("cp1252")
    assert status == 0
    rows = text.split("\r\n")
    assert rows[0] == "%" and rows[1] == "(CORRECTED BY VOLID)" and rows[-2:] == ["%", ""]
    assert rows[-6:-2] == ["G21 G90 G17", "G0 X-0.01 Y0. Z50.", "G1 X199.97 F100 ; \xb5m", "M30"]
    assert any("original part.nc" in r for r in rows) and any("tool all 0, 0, -150 mm" in r for r in rows)
    assert any("L-VOL: grid over X for the tool vector 0, 0, -150 mm" in r for r in rows)
    assert all(len(r) < 250 and r.isascii() for r in rows if r.startswith("("))
    assert "largest correction: X 30.00, Y 0.00, Z 0.00 µm" in output
    assert "2.00 min without accelerations" in output


def test_numbers_for_machines(run, folder):
    status, output, _ = run("apply", "grid.csv", "part.nc", *OPTIONS, "--json")
    found = json.loads(output)
    assert status == 0 and found["blocks"]["before"] == 7 and found["largest"]["X"] == pytest.approx(0.03)
    assert found["chord"] < 0.001 and found["outside"] == [] and found["minutes"] == pytest.approx(2.0)


def test_points_outside_the_grid_need_a_word(run, folder):
    beyond = ("--offset", "G54=900,0,0", *OPTIONS[2:])
    status, _, errors = run("apply", "grid.csv", "part.nc", *beyond)
    assert status == 1 and "attention: line 5: outside the nodes, where the end values are held" in errors
    assert (folder / "out.nc").exists()
    status, output, errors = run("apply", "grid.csv", "part.nc", *beyond, "--force", "--allow-beyond")
    assert status == 0 and "note: line 5: outside the nodes" in output and not errors


def test_refusals_leave_nothing_and_speak_of_options(run, folder):
    (folder / "part.nc").write_text("G21 G90\nG0 X0 Y0 Z0\nG83 Z-5 R2 Q1\n")
    status, _, errors = run("apply", "grid.csv", "part.nc", *OPTIONS)
    assert status == 2 and errors.startswith("volid apply: part.nc, line 3: G83 is a canned cycle")
    status, _, errors = run("apply", "grid.csv", "part.nc", "-o", "out.nc")
    assert status == 2 and "line 2: work offset G54 is active" in errors and "state it as --offset, such as" in errors
    assert not (folder / "out.nc").exists()
    status, _, errors = run("apply", "grid.csv", "out.nc", *OPTIONS)
    assert status == 2 and "there is no such file" in errors


def test_a_corrected_program_is_not_corrected_again(run, folder):
    assert run("apply", "grid.csv", "part.nc", *OPTIONS)[0] == 0
    status, _, errors = run("apply", "grid.csv", "out.nc", *OPTIONS[:-1], "twice.nc")
    assert status == 2 and "out.nc, line 2: the program is corrected already; correct the original instead" in errors


def test_tables_of_a_folder_act_on_the_machine_that_is_named(run, folder, request):
    machine = request.config.rootpath / "models" / "wYXbZt_vertical.toml"
    (folder / "tables").mkdir()
    (folder / "tables" / "EXX.csv").write_text("# values: error\nX,EXX(+),EXX(-)\n0,0,0\n1000,0.1,0.1\n")
    status, _, errors = run("apply", "tables", "part.nc", *OPTIONS)
    assert status == 2 and "state --machine" in errors
    status, _, _ = run("apply", "tables", "part.nc", *OPTIONS, "--machine", machine)
    assert status == 0 and "G1 X199.97 F100" in (folder / "out.nc").read_bytes().decode("cp1252")


@pytest.mark.parametrize(
    ("option", "value", "message"),
    [
        ("--offset", "G60=1,2,3", "is no work offset; expected such as G54=400,200,-300"),
        ("--offset", "G54=1,2", "is no origin; expected x,y,z in mm"),
        ("--tool", "T1=1,2", "is no tool vector"),
        ("--length", "H1=long", "is no tool length; expected such as H1=150"),
        ("--passing", "M1x", "are no M codes"),
        ("--chord", "0", "expected a finite number > 0"),
    ],
)  # fmt: skip
def test_options_are_checked_as_they_are_read(run, folder, option, value, message):
    status, _, errors = run("apply", "grid.csv", "part.nc", *OPTIONS, option, value)
    assert status == 2 and message in errors


def test_a_grid_that_is_blank_is_named_with_the_line(run, folder):
    (folder / "grid.csv").write_text(GRID.replace("1000,0.1,0,0", "1000,,,"))
    status, _, errors = run("apply", "grid.csv", "part.nc", *OPTIONS)
    assert status == 2 and "part.nc, line 4: " in errors


@pytest.mark.parametrize("language", ["en", "de"])
def test_a_figure_of_the_path(run, folder, language):
    status, _, _ = run("apply", "grid.csv", "part.nc", *OPTIONS, "--figure", "path.svg", "--lang", language)
    assert status == 0 and (folder / "path.svg").stat().st_size > 5000


def test_gaps_between_motions_are_drawn_as_gaps():
    x = np.array([0.0, 1000.0])
    values = np.zeros((2, 6))
    grid = volid.Grid("L-VOL", ("X",), (x,), x[:, None], values, values, x > 1e9, (0.0, 0.0, 0.0), "machine", "")
    text = "G21 G90 G0 X0 Y0 Z5\nG1 X10 F9\nG0 X20\nG1 X30 Y9 Z7\n"
    made = volid.apply_to_program(grid, text, volid.ProgramSetting(offsets={"G54": (0, 0, 0)}, tool=(0, 0, 0)))
    figure = volid.plot.program_figure(made, "part.nc")
    way = figure.axes[1].lines[0].get_xdata()
    assert way[:2].tolist() == [0.0, 0.0] and np.isnan(way[3]) and way[4] == pytest.approx(10.0)
    with pytest.raises(volid.InputError, match="no motion in feed"):
        empty = volid.apply_to_program(grid, "G21", volid.ProgramSetting())
        volid.plot.program_figure(empty, "part.nc")


def test_files_of_a_control_are_applied_as_it_would(run, folder):
    """X stands 20 µm too far at 200 mm in both directions: it is sent to 199.98, from 100, where it is 10 µm too far."""
    (folder / "x.comp").write_text("0 0 0\n1000 1000.1 1000.1\n")
    status, output, _ = run("apply", "x.comp", "part.nc", *OPTIONS[:1], "G54=0,0,0", *OPTIONS[2:])
    assert status == 0 and "largest correction: X 20.00, Y 0.00, Z 0.00 µm" in output
    assert "G1 X199.98 F100" in (folder / "out.nc").read_bytes().decode("cp1252")


def test_the_sign_of_files_is_an_option(run, folder):
    (folder / "cec.ini").write_text("$AN_CEC[0,0]=0\n")
    status, _, errors = run("apply", "cec.ini", "part.nc", *OPTIONS)
    assert status == 2 and "state --sign error" in errors


def test_a_grid_without_rotations_is_for_its_tool(run, folder):
    """The grid of GRID has none and is for (0, 0, -150)."""
    words = [w if w != "0,0,-150" else "0,0,-200" for w in OPTIONS]
    status, _, errors = run("apply", "grid.csv", "part.nc", *words)
    assert status == 1 and "holds for the tool vector 0, 0, -150 mm alone" in errors and "with 0, 0, -200 mm" in errors


def test_what_a_folder_holds_besides_is_named_and_not_hashed(run, folder):
    """A damaged table of LinuxCNC beside a good one is not applied; nor is a table of LinuxCNC beside a grid of volid."""
    for name, files in (("control", ("x.comp", "y.comp", "RECORD.md")), ("own", ("x.comp", "grid.csv"))):
        (folder / name).mkdir()
        for file in files:
            text = {"grid.csv": GRID, "y.comp": "; y\n0 0 0\n"}.get(file, "0 0 0\n1000 1000.1 1000.1\n")
            (folder / name / file).write_text(text)
    words = (*OPTIONS, "--force")
    status, output, _ = run("apply", "control", "part.nc", *words)
    text = (folder / "out.nc").read_bytes().decode("cp1252")
    assert status == 0 and "note: control: left out, because linuxcnc does not know them: y.comp\n" in output
    assert "Y.COMP" not in text.upper().split("G21")[0]
    status, output, _ = run("apply", "own", "part.nc", *words)
    assert status == 0 and "note: own: left out, beside volid's own tables and grids: x.comp\n" in output
    assert "left out" not in run("apply", "grid.csv", "part.nc", *words)[1]


@pytest.mark.parametrize("text", ["", "\r\n \r\n"])
def test_an_empty_program_is_refused(run, folder, text):
    (folder / "part.nc").write_bytes(text.encode())
    status, _, err = run("apply", "grid.csv", "part.nc", *OPTIONS)
    assert status == 2 and "part.nc: the file is empty; expected a program of G-code" in err
    assert not (folder / "out.nc").exists()
