"""The command line: light help, right exit status, one clear message, outputs whole or not at all."""

import ast
import contextlib
import csv
import importlib
import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import h5py
import numpy as np
import pytest
from support.hdf5_files import changed
from support.places import DATASETS, SOURCE
from support.small_campaign import SINGLE_TOOL, make_campaign

import volid
from volid.cli import VERBS, _parser, main
from volid.cli.common import in_options, input_files
from volid.cli.environment import cache_folder
from volid.cli.interrupts import Interrupts
from volid.io import load_campaign
from volid.io.basics.provenance import sha256
from volid.io.functions_csv import read_functions
from volid.io.grid_reader import read_grid
from volid.io.solutions import read_solution, write_solution
from volid.model.machine import Datum

MINE = sorted(set(VERBS) - {"simulate", "multilaterate"})


@pytest.fixture
def interruptible():
    """Interrupts as at a terminal, even where whoever runs the tests ignores them."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def python(code, **options):
    """Runs Python code in a fresh process."""
    environment = os.environ | {"PYTHONPATH": str(SOURCE)}
    return subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=environment, timeout=300, **options
    )


def table(text):
    return list(csv.DictReader(line for line in text.splitlines() if not line.startswith("#")))


# ------------------------------------------------------------------------------------------------------------- help


@pytest.mark.parametrize("arguments", [["--help"], ["--version"], [], *([verb, "--help"] for verb in MINE)])
def test_help_needs_no_numerical_library(arguments):
    code = f"import sys, volid.cli; status = volid.cli.main({arguments!r}); print(status, file=sys.stderr)\n"
    code += "sys.exit(bool({'jax', 'numpy', 'scipy', 'h5py'} & set(sys.modules)))"
    done = python(code)
    assert done.returncode == 0, "a numerical library was imported"
    assert done.stderr.splitlines()[-1] == ("2" if not arguments else "0")


def test_importing_volid_is_light():
    assert python("import sys, volid; dir(volid); sys.exit('numpy' in sys.modules)").returncode == 0


def test_python_m_volid():
    environment = os.environ | {"PYTHONPATH": str(SOURCE)}
    done = subprocess.run([sys.executable, "-m", "volid", "--help"], capture_output=True, text=True, env=environment)
    assert done.returncode == 0
    assert all(f"    {verb}" in done.stdout for verb in VERBS)


@pytest.mark.parametrize("verb", list(VERBS))
def test_every_verb_explains_itself(verb, capsys):
    assert main([verb, "--help"]) == 0
    text = capsys.readouterr().out
    assert text.startswith(f"usage: volid {verb}")
    assert f"\n  volid {verb} " in text, "an example"
    for option in ("--output", "--json", "--force", "exit status:"):
        assert option in text


@pytest.mark.parametrize("verb", list(VERBS))
def test_the_list_of_verbs_says_what_the_verb_says(verb):
    module, text = VERBS[verb]
    assert text == importlib.import_module(f"volid.cli.{module}").HELP


def test_version(run):
    status, out, _ = run("--version")
    assert status == 0
    assert out.startswith("volid ")


@pytest.mark.parametrize(
    "arguments", [["nonsense"], ["fit"], ["fit", "a.toml"], ["grid", "s.h5", "--tool", "1,2"], ["fit", "--tol", "1"]]
)
def test_wrong_arguments_have_status_2(arguments, run):
    status, _, err = run(*arguments)
    assert status == 2
    assert "error:" in err


# -------------------------------------------------------------------------------------------------------------- fit


def test_from_text_to_solution(virtual, solution, run, tmp_path):
    campaign, out = tmp_path / "c.h5", tmp_path / "s.h5"
    status, text, _ = run("import", virtual.manifest, "-o", campaign)
    assert status == 0
    assert "360 readings from 6 stations on 'Testmaschine Ω'" in text
    status, text, _ = run("fit", campaign, "-o", out, "--tool", "-10,0,-150")
    assert status == 0
    assert text.startswith("Model accepted by the data.")
    assert "tool (-10, 0, -150) mm" in text
    assert text.endswith(f"written: {out}\n")
    found = read_solution(out)
    np.testing.assert_allclose(found.parameters, np.asarray(solution.parameters), rtol=0, atol=1e-10)
    assert found.provenance[f"sha256 {campaign}"] == sha256(campaign)
    assert found.provenance["command"].startswith("volid fit ")


def test_fit_as_json_with_robust_and_datum(outlier_solution, run, tmp_path):
    manifest, out = outlier_solution.campaign.source, tmp_path / "s.h5"
    status, text, _ = run("fit", manifest, "--robust", "--datum", "primary=Z,secondary=X", "-o", out, "--json")
    assert status == 0
    found = json.loads(text)
    assert found["output"] == str(out)
    assert found["attention"] == []
    assert len(found["outliers"]) == len(outlier_solution.readings.outlier_readings)
    assert found["datum"].startswith("primary axis Z, secondary axis X")
    solution = read_solution(out)
    assert solution.datum == Datum("Z", "X")
    for path in input_files([manifest]):
        assert solution.provenance[f"sha256 {path}"] == sha256(path)
    assert {path.name for path in input_files([manifest])} == {"manifest.toml", "machine.toml", "volume.csv"}


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("rejected_solution", "attention: the model is REJECTED by the data"),
        ("single_tool_solution", "attention: the data do not determine 14 combination(s)"),
    ],
)
def test_what_needs_attention_is_named_and_written(name, message, request, run, tmp_path):
    campaign = request.getfixturevalue(name).campaign.source
    status, text, err = run("fit", campaign, "-o", tmp_path / "s.h5")
    assert status == 1
    assert message in err
    assert f"written: {tmp_path / 's.h5'}" in text
    assert read_solution(tmp_path / "s.h5").adequacy.rejected == (name == "rejected_solution")


def test_several_campaigns_are_fitted_together(run, tmp_path):
    """The same stations and beams; every second reading is in one campaign, the others in another."""
    one, other = (make_campaign(tmp_path / name, n_per_station=120).manifest for name in ("one", "other"))
    for k, manifest in enumerate((one, other)):
        file = manifest.parent / "volume.csv"
        header, *rows = file.read_text(encoding="utf-8").splitlines()
        file.write_text("\n".join([header, *rows[k::2]]) + "\n", encoding="utf-8")
    other.write_text(other.read_text(encoding="utf-8").replace('"volume"', '"again"'), encoding="utf-8")
    assert run("fit", one, other, "-o", tmp_path / "s.h5")[0] == 0
    found = read_solution(tmp_path / "s.h5")
    assert [s.name for s in found.campaign.sets] == ["volume", "again"]
    assert found.statistics.n_readings == 720


def test_a_wrong_prior_is_refused(virtual, solution_file, run, tmp_path):
    status, text, err = run("fit", virtual.manifest, "--prior", tmp_path / "s0.h5", "-o", tmp_path / "s.h5")
    assert (status, text) == (2, "")
    assert "s0.h5: there is no such file" in err
    status, _, err = run("fit", virtual.manifest, "--prior", solution_file, "-o", solution_file, "--force")
    assert status == 2
    assert "is an input of this command" in err


# ------------------------------------------------------------------------------------------------------- wrong places


def test_output_is_refused_before_the_work(virtual, run, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("volid.io.load_campaign", lambda *paths: pytest.fail("the campaign is read already"))
    existing, missing = tmp_path / "s.h5", tmp_path / "no" / "s.h5"
    existing.write_text("mine")
    for arguments, message in (
        (["-o", existing], "s.h5 exists; choose another name or pass --force"),
        (["-o", missing], "does not exist; create it or choose another"),
        (["-o", tmp_path], "is a folder; name a file"),
        (["-o", virtual.manifest, "--force"], "manifest.toml is an input of this command"),
    ):
        status, text, err = run("fit", virtual.manifest, *arguments)
        assert status == 2
        assert message in err
        assert "Traceback" not in err
        assert text == ""
        assert "solving" not in err
    assert existing.read_text() == "mine"
    assert list(tmp_path.iterdir()) == [existing]


@pytest.mark.skipif(not Path("/proc/self").is_dir(), reason="needs a folder in which nobody can write")
@pytest.mark.parametrize("verb", ["fit", "import"])
def test_a_folder_in_which_nobody_can_write_is_named_before_the_work(verb, virtual, run):
    """Not even root: /proc takes no new files."""
    status, text, err = run(verb, virtual.manifest, "-o", "/proc/s.h5")
    assert (status, text) == (2, "")
    assert err.startswith(f"volid {verb}: /proc/s.h5 cannot be written: ") and err.count("\n") == 1
    assert "no file can be made in the folder /proc; choose another place" in err


@pytest.mark.parametrize("name", ["file/s.h5", "a" * 300 + ".h5"])
def test_a_path_that_cannot_be_is_named(name, virtual, run, tmp_path):
    """A file where a folder should be, a name longer than file systems take: for every user alike."""
    (tmp_path / "file").write_text("mine")
    status, text, err = run("fit", virtual.manifest, "-o", tmp_path / name)
    assert (status, text) == (2, "")
    assert err.startswith(f"volid fit: {tmp_path / name}"[:60]) and "Traceback" not in err
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


@pytest.mark.skipif(os.name == "nt" or os.geteuid() == 0, reason="needs a folder that this user cannot write")
def test_a_closed_folder_is_named(virtual, run, tmp_path):
    tmp_path.chmod(0o500)
    status, _, err = run("fit", virtual.manifest, "-o", tmp_path / "s.h5")
    tmp_path.chmod(0o700)
    assert status == 2
    assert "cannot be written: Permission denied" in err


def test_an_interrupted_fit_leaves_nothing(tmp_path):
    manifest = make_campaign(tmp_path / "c", model="", n_per_station=3000).manifest
    environment = os.environ | {"PYTHONPATH": str(SOURCE), "PYTHONUNBUFFERED": "1"}
    script = (  # whoever runs the tests may ignore interrupts, which programs inherit
        "import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler); from volid.cli import main; "
        "sys.exit(main(sys.argv[1:]))"
    )
    command = [sys.executable, "-c", script, "fit", str(manifest), "-o", str(tmp_path / "s.h5")]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=environment)
    assert process.stderr is not None
    assert process.stderr.readline().startswith("volid: ")  # after a second: at work
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=120)
    assert process.returncode == 130
    assert "interrupted" in err
    assert "Traceback" not in err
    assert [path.name for path in tmp_path.iterdir()] == ["c"]


def test_an_interrupt_that_python_drops_comes_again(interruptible, capsys):
    class Finalised:
        def __del__(self):  # an exception here is printed and dropped, as in a callback of the garbage collector
            signal.raise_signal(signal.SIGINT)

    with pytest.raises(KeyboardInterrupt), Interrupts():
        Finalised()
        for _ in range(1000):
            time.sleep(0.01)
    assert capsys.readouterr().err == ""
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_an_interrupt_that_went_missing_is_raised_once(interruptible):
    with Interrupts() as interrupts:
        with contextlib.suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        with pytest.raises(KeyboardInterrupt):
            interrupts.check()
        interrupts.check()
    dropped = contextlib.suppress(KeyboardInterrupt)
    with pytest.raises(KeyboardInterrupt), Interrupts(), dropped:  # at the end at the latest
        signal.raise_signal(signal.SIGINT)


def test_a_stage_begins_only_when_no_interrupt_was_dropped(interruptible, monkeypatch, run, virtual, tmp_path):
    def load(*paths, **options):
        with contextlib.suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        return load_campaign(*paths, **options)

    monkeypatch.setattr("volid.io.load_campaign", load)
    status, text, err = run("fit", virtual.manifest, "-o", tmp_path / "s.h5")
    assert (status, text) == (130, "")
    assert err.endswith("volid fit: interrupted\n")
    assert not list(tmp_path.iterdir())


def test_a_closed_pipe_is_no_error(solution_file):
    command = f"{sys.executable} -m volid grid {solution_file} --points 30 | head -1"
    environment = os.environ | {"PYTHONPATH": str(SOURCE)}
    done = subprocess.run(command, shell=True, capture_output=True, text=True, env=environment)
    assert done.stdout == "# format: volid-grid/1\n"
    assert "Traceback" not in done.stderr
    assert "BrokenPipe" not in done.stderr


# -------------------------------------------------------------------------------------------------------- wrong files


@pytest.mark.parametrize("verb", ["summary", "functions", "grid", "datum", "errors"])
@pytest.mark.parametrize("damage", ["truncated", "version", "campaign", "missing"])
def test_wrong_solutions_are_named(verb, damage, solution, solution_file, run, tmp_path):
    path = tmp_path / "bad.h5"
    if damage == "truncated":
        path.write_bytes(solution_file.read_bytes()[:20000])
    elif damage == "version":
        path.write_bytes(solution_file.read_bytes())
        with changed(path) as file:
            file.attrs["format"] = "volid-solution/9"
    elif damage == "campaign":
        volid.save_campaign(solution.campaign, path)
    points = tmp_path / "points.csv"
    points.write_text("X,Y,Z,tool_x,tool_y,tool_z\n1,1,-1,0,0,0\n")
    extra = {"datum": ["--to", "primary=Z,secondary=X", "-o", tmp_path / "o.h5"], "errors": ["--at", points]}
    status, text, err = run(verb, path, *extra.get(verb, []))
    message = {
        "truncated": "the HDF5 file is truncated or damaged",
        "version": "format is 'volid-solution/9'; this volid reads 'volid-solution/1'",
        "campaign": "this is a campaign ('volid-campaign/1'); expected a solution, which volid fit makes of a campaign",
        "missing": "there is no such file",
    }[damage]
    assert status == 2
    assert text == ""
    assert f"volid {verb}: {path}" in err
    assert message in err
    assert "Traceback" not in err
    assert not (tmp_path / "o.h5").exists()


def test_files_of_another_type_are_named(virtual, solution_file, run, tmp_path):
    folder = virtual.manifest.parent
    table, machine, output = next(folder.glob("*.csv")), folder / "machine.toml", tmp_path / "o.h5"
    cases = {
        table: "is a table of readings; give the manifest (TOML) that names it",
        machine: "this is a machine file ('volid-machine/1'); expected a campaign, a manifest (TOML)",
        solution_file: "this is a solution ('volid-solution/1'); expected a campaign, a manifest (TOML)",
    }
    for path, message in cases.items():
        for verb in ("fit", "import"):
            status, _, err = run(verb, path, "-o", output)
            assert (status, err.count("\n")) == (2, 1)
            assert f"volid {verb}: {path}" in err and message in err
    err = run("summary", virtual.manifest)[2]
    assert "not an HDF5 file; expected a solution" in err and "which volid fit makes of a campaign" in err
    err = run("datum", solution_file, "--to", "primary=Q", "-o", output)[2]
    assert err.startswith("volid datum: primary")


def test_wrong_points_are_named(solution_file, run, tmp_path):
    points = tmp_path / "points.csv"
    points.write_text("X,Y,Z,tool_x,tool_y,tool_z\n1,1,-1,0,0,0\n1,1,none,0,0,0\n")
    status, text, err = run("errors", solution_file, "--at", points, "-o", tmp_path / "out.csv")
    assert (status, text) == (2, "")
    assert "points.csv, row 3: Z is 'none'; expected a finite number in mm" in err
    assert not (tmp_path / "out.csv").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--type", "R-POS"], "--type R-POS has no grid; it is a table of the axis itself: volid tables --type R-POS"),
        (["--type", "LVOL"], "--type LVOL is no compensation type of ISO/TR 16907; available: L-POS, L-STR"),
        (["--type", "R-VOL"], "has no rotary axis"),
        (["--type", "R-VOL", "--tool", "0,0,1"], "--tool is for L-VOL"),
        (["--reference-point", "0,0,1"], "--reference-point is for R-VOL"),
        (["--points", "1"], "expected a whole number from 2 to"),
        (["--step", "-5"], "expected a finite number > 0"),
    ],
)
def test_wrong_grids_are_named(solution_file, run, arguments, message):
    status, text, err = run("grid", solution_file, *arguments)
    assert (status, text) == (2, "")
    assert "grid: grid:" not in err
    assert message in err


def test_wrong_steps_and_datums_are_named(solution_file, run, tmp_path):
    for step in ("0", "-1", "inf", "nan"):
        status, _, err = run("functions", solution_file, "--step", step)
        assert status == 2
        assert "expected a finite number > 0" in err
    status, _, err = run("datum", solution_file, "--to", "primary=Z,secondary=Z", "-o", tmp_path / "o.h5")
    assert status == 2
    assert "primary and secondary axis are both Z" in err


# ------------------------------------------------------------------------------------------------------------ results


def test_errors(solution, solution_file, run, tmp_path):
    points = tmp_path / "points.csv"
    points.write_text("X,Y,Z,tool_x,tool_y,tool_z\n100,200,-300,0,0,-150\n900,500,-10,80,0,-250\n")
    status, text, _ = run("errors", solution_file, "--at", points)
    assert status == 0
    expected = solution.evaluate(np.array([[200.0, 100.0, -300.0]]), np.array([0.0, 0.0, -150.0]))
    row = table(text)[0]
    # one point or two: the last digit may differ
    found = [float(row[k]) for k in ("ex", "ey", "ez", "ea", "eb", "ec")]
    assert found == pytest.approx(expected.values[0].tolist(), rel=1e-12)
    assert float(row["u_ez"]) == pytest.approx(expected.u[0, 2], rel=1e-12)
    status, text, _ = run("errors", solution_file, "--at", points, "-o", tmp_path / "out.csv", "--json")
    found = json.loads(text)
    assert dict(zip(found["columns"], found["rows"][0], strict=True))["ex"] == float(row["ex"])
    assert table((tmp_path / "out.csv").read_text(encoding="utf-8"))[0] == row


def test_errors_outside_and_undetermined_need_attention(single_tool_solution, run, tmp_path):
    write_solution(single_tool_solution, tmp_path / "s.h5")
    points = tmp_path / "points.csv"
    points.write_text("X,Y,Z,tool_x,tool_y,tool_z\n1300,200,-300,0,0,-150\n300,200,-300,0,0,-150\n")
    status, text, err = run("errors", tmp_path / "s.h5", "--at", points)
    assert status == 1
    assert "1 of 2 points have components that the data do not determine, left blank" in err
    assert "1 of 2 points lie outside the measured positions (outside = 1), 1 of them left blank" in err
    out, inside = table(text)
    assert (out["ex"], out["ec"], out["outside"], inside["ec"], inside["outside"]) == ("", "", "1", "", "0")
    assert float(inside["ex"]) != 0.0
    assert json.loads(run("errors", tmp_path / "s.h5", "--at", points, "--json")[1])["rows"][0][-2] is None


def test_functions(solution, solution_file, single_tool_solution, run, tmp_path):
    status, text, _ = run("functions", solution_file, "--step", "250", "-o", tmp_path / "f.csv")
    assert status == 0
    assert text == f"24 functions and location errors written: {tmp_path / 'f.csv'}\n"
    rows = read_functions(tmp_path / "f.csv")
    np.testing.assert_array_equal([r[2:] for r in rows], [r[2:] for r in solution.functions(step=250.0)])
    write_solution(single_tool_solution, tmp_path / "s.h5")
    status, text, err = run("functions", tmp_path / "s.h5")
    assert status == 1
    assert "left blank: EYX, ECX" in err or "ECZ" in err
    assert table(text)[0]["function"] == "EXY"


def test_grid(solution, solution_file, run, tmp_path):
    status, text, err = run("grid", solution_file, "--points", "3", "--tool", "0,0,-150", "-o", tmp_path / "g.csv")
    assert (status, err) == (0, "") or "volid: " in err
    assert text == (
        f"3 × 3 × 3 nodes of compensation values for tool vector (0, 0, -150) mm written: {tmp_path / 'g.csv'}\n"
    )
    assert (
        run("grid", solution_file, "--step", "500", "--errors", "--tool", "0,0,-150", "-o", tmp_path / "g.h5")[0] == 0
    )
    one, other = read_grid(tmp_path / "g.csv"), read_grid(tmp_path / "g.h5")
    assert one.tool == other.tool == SINGLE_TOOL
    assert one.values[0, 0] == pytest.approx(solution.evaluate([[0, 0, -500]], SINGLE_TOOL).values[0, 0], abs=1e-9)
    assert [len(nodes) for nodes in other.nodes] == [3, 3, 2]
    status, text, _ = run("grid", solution_file, "--points", "2", "--json")
    found = json.loads(text)
    assert found["header"]["values"] == "compensation"
    assert len(found["rows"]) == 8
    assert "(0, 0, -150)" in run("grid", solution_file, "--points", "2", "-o", tmp_path / "default.csv")[1]
    with h5py.File(tmp_path / "g.h5") as file:
        assert file.attrs["values"] == "error"
        assert file.attrs["source_sha256"] == sha256(solution_file)


def test_grid_that_the_data_do_not_determine_is_not_written(single_tool_solution, run, tmp_path):
    write_solution(single_tool_solution, tmp_path / "s.h5")
    status, text, err = run("grid", tmp_path / "s.h5", "--tool", "200,0,0", "-o", tmp_path / "g.csv")
    assert (status, text) == (1, "")
    assert "the data do not determine" in err
    assert not (tmp_path / "g.csv").exists()


def test_grid_of_a_model_without_most_functions_says_so(run, tmp_path):
    """Only EXX and EZZ were measured: the grid compensates no straightness, angle or squareness, and must not look as if."""
    campaign, solution, grid = (
        DATASETS / "published_positioning" / "campaign.toml",
        tmp_path / "s.h5",
        tmp_path / "g.csv",
    )
    assert run("fit", campaign, "-o", solution)[0] == 0
    status, text, err = run("grid", solution, "--points", "2", "--extrapolate", "-o", grid)
    assert status == 1 and text.endswith(f"written: {grid}\n")
    missing = (
        "not in the model: EYX, EZX, EAX, EBX, ECX, EXY, EYY, EZY, EAY, EBY, ECY, EXZ, EYZ, EAZ, EBZ, ECZ; their effect"
    )
    assert f"volid grid: attention: {missing} is not in this grid" in err
    assert f"# note 1: {missing} is not in this grid\n" in grid.read_text(encoding="utf-8")


def test_grid_outside_what_was_measured_needs_consent(run, tmp_path):
    """The machine file allows 300 mm more in X than was measured."""
    virtual = make_campaign(tmp_path / "c")
    machine = virtual.manifest.parent / "machine.toml"
    text = machine.read_text(encoding="utf-8")
    assert "travel = [0.0, 1000.0]" in text
    machine.write_text(text.replace("travel = [0.0, 1000.0]", "travel = [0.0, 1300.0]"), encoding="utf-8")
    assert run("fit", virtual.manifest, "-o", tmp_path / "s.h5")[0] in (0, 1)
    grid = ("grid", tmp_path / "s.h5", "--points", "3")
    status, text, err = run(*grid, "--range", "X=0:1300", "-o", tmp_path / "g.csv")
    assert (status, text, (tmp_path / "g.csv").exists()) == (2, "", False)
    assert "axis X over 0 … 1300 mm leaves the measured 0 … 1000 mm; give --range X=0:1000. Measure there" in err
    assert "--extrapolate" in err and "Traceback" not in err
    cut = "X 0 … 1000 mm of the travel 0 … 1300: measured 0 … 1000 mm; a control holds the end values outside"
    status, text, _ = run(*grid, "-o", tmp_path / "g.csv")  # by itself the grid stays inside, and says so
    assert (status, f"note: {cut}\n" in text) == (0, True)
    assert cut in (tmp_path / "g.csv").read_text(encoding="utf-8")
    inside = read_grid(tmp_path / "g.csv")
    assert (inside.nodes[0].tolist(), inside.outside.any()) == ([0.0, 500.0, 1000.0], False)
    assert cut in run(*grid)[2]  # not among the rows on standard output
    status, _, _ = run(*grid, "--extrapolate", "-o", tmp_path / "g2.csv")
    flagged = read_grid(tmp_path / "g2.csv")
    assert (status, flagged.nodes[0][-1], flagged.outside.sum()) == (0, 1300.0, 9)
    assert "9 of 27 nodes lie outside the measured positions: extrapolated" in (tmp_path / "g2.csv").read_text("utf-8")
    assert "(measured 0 … 1000)" in run("summary", tmp_path / "s.h5")[1]


def test_datum(solution, solution_file, run, tmp_path):
    status, text, _ = run("datum", solution_file, "--to", "primary=Z,secondary=X", "-o", tmp_path / "z.h5")
    assert status == 0
    assert "to:   primary axis Z, secondary axis X" in text
    found = read_solution(tmp_path / "z.h5")
    expected = solution.in_datum(Datum("Z", "X"))
    q = np.array([[100.0, 200.0, -300.0]])
    np.testing.assert_allclose(
        found.evaluate(q, SINGLE_TOOL).values, expected.evaluate(q, SINGLE_TOOL).values, atol=1e-12
    )
    assert found.provenance[f"sha256 {solution_file}"] == sha256(solution_file)
    assert found.provenance["command"] == solution.provenance["command"]


def test_summary(solution, solution_file, rejected_solution, run, tmp_path):
    status, text, _ = run("summary", solution_file)
    assert status == 0
    assert text == volid.summary(solution) + "\n"
    assert run("summary", solution_file, "-o", tmp_path / "s.txt")[1] == f"written: {tmp_path / 's.txt'}\n"
    assert (tmp_path / "s.txt").read_text(encoding="utf-8") == text
    write_solution(rejected_solution, tmp_path / "r.h5")
    status, text, err = run("summary", tmp_path / "r.h5", "--json")
    assert status == 1
    assert json.loads(text)["rejected"]
    assert "REJECTED" in err


def test_import_names_odd_readings_and_json(virtual, run, tmp_path):
    status, text, _ = run("import", virtual.manifest, "-o", tmp_path / "c.h5", "--json")
    found = json.loads(text)
    assert status == 0
    assert found["sets"] == [{"set": "volume", "kind": "distance", "n_readings": 360}]
    assert found["stations"] == 6
    machine = virtual.manifest.parent / "machine.toml"
    short = tmp_path / "short"
    short.mkdir()
    for path in virtual.manifest.parent.iterdir():
        (short / path.name).write_bytes(path.read_bytes())
    text = machine.read_text(encoding="utf-8").replace("1000.0]", "900.0]")
    (short / "machine.toml").write_text(text, encoding="utf-8")
    status, _, err = run("import", short / "manifest.toml", "-o", tmp_path / "d.h5")
    assert status == 0
    assert "lies outside the travel 0 … 900" in err


# -------------------------------------------------------------------------------------------------------- environment


def test_cache_folder_follows_the_platform(monkeypatch, tmp_path):
    if os.name == "nt":
        monkeypatch.setenv("LOCALAPPDATA", str(tmp_path))
    else:
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache_folder() == tmp_path / "volid" / "jax"


def test_compiled_programs_are_kept(solution_file, tmp_path):
    variable = "LOCALAPPDATA" if os.name == "nt" else "XDG_CACHE_HOME"
    environment = {k: v for k, v in os.environ.items() if not k.startswith("JAX_")}
    environment |= {"PYTHONPATH": str(SOURCE), variable: str(tmp_path), "JAX_PLATFORMS": "cpu"}
    many = ["--points", "28"]  # fewer points are interpreted
    command = [sys.executable, "-m", "volid", "grid", str(solution_file), *many]
    done = subprocess.run(command, capture_output=True, text=True, env=environment)
    assert done.returncode == 0
    assert list((tmp_path / "volid" / "jax").glob("*")) != []
    assert "jax" not in done.stderr.lower()


def test_parameters_of_the_library_are_shown_as_options():
    args = _parser("study").parse_args(["study", "s.toml", "-o", "r.h5"])
    text = "`workers=0`: expected 1; go on with `resume=True`, or `overwrite=True`; `time` and `max_points=3` are no options"
    shown = "--workers 0: expected 1; go on with --resume, or --force; `time` and `max_points=3` are no options"
    assert in_options(text, args) == shown
    args = _parser("compare").parse_args(["compare", "a.h5", "b.h5"])
    assert in_options("say so with `independent=laser scale`", args) == 'say so with --independent "laser scale"'


def test_the_library_does_not_speak_of_options():
    package = Path(volid.__file__).parent
    found = []
    for path in package.rglob("*.py"):
        if path.relative_to(package).parts[0] in ("cli",):
            continue
        tree = ast.parse(path.read_text(encoding="utf-8"))
        docstrings = {node.value for node in ast.walk(tree) if isinstance(node, ast.Expr)}
        for node in ast.walk(tree):
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and node not in docstrings:
                found += re.findall(r"^--[a-z].*|[\s('\"]--[a-z].*", node.value.replace("--xla_cpu", ""))
    assert not found


# ------------------------------------------------------------------------------------------------------------- Python


def test_public_names(solution, solution_file, tmp_path):
    for name in volid.__all__:
        assert getattr(volid, name) is not None
    assert set(volid.__all__) <= set(dir(volid))
    with pytest.raises(AttributeError, match="module 'volid' has no attribute 'fitt'"):
        _ = volid.fitt
    loaded = volid.load_solution(solution_file)
    loaded.save(tmp_path / "again.h5")
    assert repr(volid.load_solution(tmp_path / "again.h5").statistics) == repr(solution.statistics)  # NaN too
    assert loaded.grid(points=2).values.shape == (8, 6)


def test_type_checkers_read_the_same_public_names():
    stub = ast.parse((Path(volid.__file__).with_suffix(".pyi")).read_text(encoding="utf-8"))
    found = {
        alias.asname or alias.name: f"{node.module}:{alias.name}"
        for node in stub.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert found == volid._PUBLIC
    names = next(node.value for node in stub.body if isinstance(node, ast.Assign))
    assert ast.literal_eval(names) == volid.__all__


def test_no_public_name_is_the_name_of_a_module():
    folder = Path(volid.__file__).parent
    assert not {path.stem for path in folder.iterdir()} & set(volid.__all__)


def test_simulate_is_the_function_whatever_was_imported_before():
    code = "from volid.virtual.simulate import STATION_ERROR; import volid; assert callable(volid.simulate), volid.simulate"
    done = python(code)
    assert done.returncode == 0, done.stderr
