"""`volid tables`, `grid` and `residual` on a solution file: output, exit status, one clear message for bad input."""

import csv
import json
import shlex
from dataclasses import replace

import numpy as np
import pytest
from support.compensated import MACHINES, TOOL, machine_and_solution

from volid.fitting.results import Residuals, Statistics
from volid.io.compensations import load_control
from volid.io.grid_reader import read_grid
from volid.io.solutions import write_solution
from volid.io.table_reader import read_table, tables_in

ORIGIN = "0,0,-150"


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Solution files of the three machines."""
    folder = tmp_path_factory.mktemp("solutions")
    found = {}
    for layout in MACHINES:
        _, solution = machine_and_solution(layout, seed=3)
        z = np.zeros((2, 3))
        solution = replace(
            solution, statistics=Statistics(6, 0, {"ends": 0.0}, 1, True), readings=Residuals((z,), (z,), (z > 1,))
        )
        path = folder / f"{layout.split()[0]}.h5"
        write_solution(solution, path)
        found[layout] = (path, solution)
    return found


def test_tables_command(files, run, tmp_path):
    path, solution = files["three-axis"]
    out = tmp_path / "tables"
    lines = ("--at", "X=200,Y=0,Z=100", "--max-error", "0.0005", "--increment", "0.0001")
    status, text, _ = run("tables", path, "--type", "L-POS", "--type", "L-STR", *lines, "-o", out)
    assert status == 0
    assert "9 tables written" in text
    table = read_table(out / "EYX.csv")
    assert (table.type, table.zero) == ("L-STR", "X = 200 mm")
    assert abs(float(table.at(np.array([200.0]), np.zeros(1))[0])) < 6e-4  # the bound and the rounding
    header = (out / "EXX.csv").read_text(encoding="utf-8")
    assert (
        "# line: Y = 0 mm, Z = 100 mm" in header
        and "# command: volid tables" in header
        and "# source sha256: " in header
    )
    assert len(load_control(solution.machine, [out]).tables) == 9
    status, _, err = run("tables", path, "--type", "L-POS", "-o", out)
    assert (status, "exists" in err) == (2, True)
    status, _, err = run("tables", path, "--type", "L-POS", "-o", out, "--force")
    assert (status, "holds other tables (EXY.csv" in err) == (2, True)


def test_tables_on_top_of_existing_ones(files, run, tmp_path):
    path, _ = files["three-axis"]
    assert run("tables", path, "--type", "L-POS", "--step", "200", "-o", tmp_path / "old")[0] == 0
    command = ("tables", path, "--type", "L-POS", "--step", "100", "--add-to", tmp_path / "old", "-o", tmp_path / "sum")
    (tmp_path / "old" / "x.comp").write_text("0 0 0\n1000 1000.01 1000.01\n")  # of another control: named, and no part
    status, text, _ = run(*command)
    assert status == 0 and "old: left out, beside volid's own tables and grids: x.comp\n" in text
    old, new = ({t.function: t for t in tables_in(tmp_path / f)} for f in ("old", "sum"))
    at = np.array([-400.0, -200.0, 0.0, 200.0])  # nodes of both
    np.testing.assert_allclose(new["EXX"].at(at, 0 * at), 2.0 * old["EXX"].at(at, 0 * at), atol=2e-9)
    assert new["EXX"].type == "L-POS on top of L-POS"


def test_a_control_that_smooths_moves_its_axes_less(files, run):
    """L-POS over 5 nodes of 200 mm: averaging over 100 mm takes off the peaks (`test_smoothing` says how much)."""
    found = {}
    for smoothing in ((), ("--smoothing", "X=100,Y=90")):
        arguments = ("--type", "L-POS", "--points", "5", "--tool", ORIGIN, "--json", *smoothing)
        _, text, _ = run("residual", files["three-axis"][0], *arguments)
        found[bool(smoothing)] = json.loads(text)["columns"][1]["largest_correction"]
    assert all(found[True][a] < found[False][a] for a in "XY")
    assert found[True]["Z"] == found[False]["Z"]


def test_values_of_a_machine_that_was_measured_compensated_come_on_top(files, run, tmp_path):
    """ISO/TR 16907 10.5, for the type that was active alone."""
    _, solution = files["three-axis"]
    conditions = {"active_compensations": ["L-POS: tables of EXX, EYY", "thermal"]}
    path = tmp_path / "compensated.h5"
    write_solution(replace(solution, campaign=replace(solution.campaign, conditions=conditions)), path)
    said = "L-POS was active while the campaign was measured ([conditions] active_compensations)"
    assert run("tables", files["three-axis"][0], "--type", "L-POS", "-o", tmp_path / "old")[0] == 0
    for command in (("tables", "-o", tmp_path / "t"), ("grid", "--points", "3", "-o", tmp_path / "g.csv")):
        _, text, _ = run(command[0], path, "--type", "L-POS", "--tool", ORIGIN, *command[1:])
        assert said in text and "come on top of it; --add-to writes the sum" in text
    _, text, _ = run("tables", path, "--type", "L-POS", "--add-to", tmp_path / "old", "-o", tmp_path / "sum")
    assert said not in text
    _, text, _ = run("grid", path, "--type", "L-STR", "--points", "3", "--tool", ORIGIN, "-o", tmp_path / "s.csv")
    assert said not in text
    _, text, _ = run("residual", path, "--type", "L-POS", "--points", "3", "--tool", ORIGIN)
    assert f"{said}: the values are what remains, and come on top of it\n" in text


@pytest.mark.parametrize(
    ("layout", "arguments", "message"),
    [
        ("three-axis", ["--type", "FOR"], "cannot turn its tool into every direction"),
        ("three-axis", ["--type", "L-ANG"], "--type L-ANG needs the tool vector"),
        ("three-axis", ["--type", "L-VOL"], "--type L-VOL needs the tool vector"),
        ("three-axis", ["--type", "L-POS", "--max-error", "1e-5", "--max-points", "4"], "EXX: "),
        ("three-axis", ["--type", "L-POS", "--at", "X=5000"], "--at X=5000 lies outside the travel"),
        ("three-axis", ["--type", "L-POS", "--at", "C=1"], "has no axis C"),
        ("three-axis", ["--type", "L-POS", "--type", "L-VOL"], "both correct positioning"),
        ("tilting table", ["--type", "R-POS", "--type", "R-VOL"], "both correct angular positioning"),
        ("three-axis", ["--type", "L-POS", "--add-to", "nowhere.csv"], "nowhere.csv: there is no such file"),
        ("three-axis", ["--type", "L-POS", "--datum", "primary=C"], "datum: primary = 'C'"),
    ],
)
def test_wrong_tables_are_refused(files, run, tmp_path, layout, arguments, message):
    status, text, err = run("tables", files[layout][0], *arguments, "-o", tmp_path / "out")
    assert (status, text) == (2, "")
    assert message in err and "Traceback" not in err
    assert not (tmp_path / "out").exists()


def test_grids_of_several_types(files, run, tmp_path):
    path, solution = files["tilting table"]
    out = tmp_path / "grid.csv"
    status, _, _ = run(
        "grid",
        path,
        "--type",
        "L-POS",
        "--type",
        "R-RAX",
        "--type",
        "FOR",
        "--points",
        "3",
        "--tool",
        ORIGIN,
        "-o",
        out,
    )
    assert status == 0
    names = sorted(p.name for p in tmp_path.iterdir())
    assert names == ["grid.linear.FOR.csv", "grid.linear.L-POS.csv", "grid.table.FOR.csv", "grid.table.R-RAX.csv"]
    grid = read_grid(tmp_path / "grid.table.FOR.csv")
    assert (grid.type, grid.side) == ("FOR", "table") and not grid.values[:, :3].any() and grid.values[:, 3:].any()
    control = load_control(solution.machine, [tmp_path])
    q = np.full((1, 5), 10.0)
    assert np.abs(control.command(q, np.array(TOOL)) - q)[0, [solution.machine.index(a) for a in "AC"]].min() > 0


def test_rule_and_functions_on_the_command_line(files, run, tmp_path):
    path, _ = files["three-axis"]
    rule = tmp_path / "rule.py"
    rule.write_text("import numpy as np\ndef ramp(solution, q, tool):\n    return np.outer(q[:, 0], [1e-5, 0, 0, 0, 0, 0])\n"
                    "def bad(solution, q, tool):\n    return q\n")  # fmt: skip
    base = ("grid", path, "--type", "L-SPEC", "--points", "3", "--tool", ORIGIN)
    assert run(*base, "--rule", f"{rule}:ramp", "-o", tmp_path / "r.csv")[0] == 0
    grid = read_grid(tmp_path / "r.csv")
    np.testing.assert_allclose(grid.values[:, 0], 1e-5 * grid.positions[:, 0], atol=1e-9)
    assert run(*base, "--functions", "EXX", "-o", tmp_path / "f.csv")[0] == 0
    assert not read_grid(tmp_path / "f.csv").values[:, 1:].any()
    for option, message in (
        (["--rule", f"{rule}:bad"], "returned shape (27, 3); expected finite error values (27, 6)"),
        (["--rule", f"{rule}:none"], "has no function 'none'"),
        (["--rule", "no.such.module:f"], "cannot be imported"),
        (["--functions", "EQQ"], "--functions EQQ: not in the model"),
        ([], "L-SPEC needs what it corrects"),
    ):
        status, _, err = run(*base, *option, "-o", tmp_path / "x.csv")
        assert (status, message in err, "Traceback" in err) == (2, True, False), err


def test_residual_command(files, run, tmp_path):
    path, _ = files["tilting table"]
    out = tmp_path / "r.csv"
    types = ("--type", "L-POS", "--type", "L-VOL,R-VOL", "--type", "L-VOL+,R-VOL+")
    tools = ("--tool", ORIGIN, "--tools", "0,0,-250", "--points", "7")
    status, text, _ = run("residual", path, *types, *tools, "--figure", tmp_path / "f.png", "-o", out)
    assert status == 0
    for words in ("tool (0, 0, -150) mm", "tool (0, 0, -250) mm", "none", "L-VOL+ + R-VOL+", "95 % coverage intervals",
                  "kinematic pole at A = 0°: C is parallel", "corrected by X, Y, Z", "C °/min"):  # fmt: skip
        assert words in text, words
    assert (tmp_path / "f.png").read_bytes().startswith(b"\x89PNG")
    rows = list(
        csv.DictReader(line for line in out.read_text(encoding="utf-8").splitlines() if not line.startswith("#"))
    )
    assert len(rows) == 4 * 2 * 10
    largest = {r["type"]: float(r["value"]) for r in rows if r["quantity"] == "largest" and r["tool_z"] == "-150.0"}
    assert largest["L-VOL + R-VOL"] < 0.25 * largest["none"]


def test_residual_as_json_and_limits(files, run):
    path, _ = files["tilting table"]
    base = ("residual", path, "--type", "FOR", "--tool", ORIGIN, "--points", "5")
    status, text, _ = run(*base, "--json")
    found = json.loads(text)
    assert (status, [c["type"] for c in found["columns"]]) == (0, ["none", "FOR"])
    asked = found["columns"][1]["largest_correction"]["C"]
    for option, words in ((["--limit", f"C={asked / 2}"], "moves"), (["--speed-limit", "C=0.001"], "speed")):
        status, text, err = run(*base, *option)
        assert (status, text) == (2, "")
        assert f"FOR: the compensation asks axis C for {words}" in err and "more than the limit" in err
    status, text, err = run(*base, "--poles", "keep out", "--pole-margin", "20", "--json")
    assert json.loads(text)["columns"][1]["largest_correction"]["C"] < asked


def test_residual_of_a_type_that_cannot_be(files, run):
    status, text, err = run("residual", files["three-axis"][0], "--type", "L-POS", "--type", "L-VOL+")
    assert (status, text) == (2, "")
    assert "--type L-VOL+" in err and "Traceback" not in err


def measured_over(solution, **ranges):
    """The solution as if its campaign had ended at the given positions of some axes."""
    (ends,) = solution.campaign.sets
    positions = ends.positions.copy()
    for letter, ends_of in ranges.items():
        positions[:, solution.machine.index(letter)] = ends_of
    return replace(solution, campaign=replace(solution.campaign, sets=(replace(ends, positions=positions),)))


@pytest.mark.parametrize(
    ("measured", "arguments", "message"),
    [
        ({"X": (-200, 400)}, "tables --type L-POS --range X=-400:400", "axis X over -400 … 400 mm leaves the "
         "measured -200 … 400 mm; give --range X=-200:400. "),
        ({"Y": (0, 0)}, "tables --type L-POS --at Y=100", "the specific lines cross at Y = 100 mm, outside the measured 0 mm "
         "alone; give another --at"),
        ({"Y": (0, 0)}, "grid --type L-VOL --points 3", "axis Y over -350 … 350 mm leaves the measured 0 mm alone. Measure"),
        ({"C": (0, 180)}, "grid --type R-VOL --points 3", "axis C over -180 … 180 ° leaves the measured 0 … 180 °; "
         "give --range C=0:180. "),
        ({"Y": (0, 20)}, "grid --type L-POS --points 3 --at Y=100", "the specific lines cross at Y = 100 mm"),
        ({}, "grid --range X=-500:0", "--range X=-500:0; expected a range that rises within the travel -400 … 400 mm"),
        ({}, "tables --type L-POS --range X=0", "argument --range: 'X=0' is no list of ranges; expected such as X=0:500"),
        ({}, "grid --range Q=0:1", "has no axis Q"),
    ],
)  # fmt: skip
def test_what_was_not_measured_is_refused_unless_extrapolation_is_asked_for(
    files, run, tmp_path, measured, arguments, message
):
    _, solution = files["tilting table"]
    write_solution(measured_over(solution, **measured), tmp_path / "s.h5")
    verb, *options = arguments.split()
    out = tmp_path / ("out" if verb == "tables" else "out.csv")
    tool = () if "R-VOL" in options else ("--tool", ORIGIN)
    command = (verb, tmp_path / "s.h5", *options, *tool, "-o", out)
    status, text, err = run(*command)
    assert (status, text, out.exists()) == (2, "", False)
    assert message in err and "Traceback" not in err
    if measured:
        status, _, _ = run(*command, "--extrapolate")
        written = sorted(out.glob("*.csv")) if out.is_dir() else [out]
        flags = [bool((read_table if verb == "tables" else read_grid)(p).outside.any()) for p in written]
        assert status in (0, 1) and any(flags)


def test_tables_stay_where_was_measured(files, run, tmp_path):
    """By default within what was measured, said in output and header; a whole turn of C makes it measured everywhere."""
    _, solution = files["tilting table"]
    write_solution(measured_over(solution, X=(-200, 399), C=(-180, 180)), tmp_path / "s.h5")
    status, text, _ = run("tables", tmp_path / "s.h5", "--type", "L-POS", "--type", "R-POS", "-o", tmp_path / "t")
    assert status == 0
    cut = "X -200 … 400 mm of the travel -400 … 400: measured -200 … 399 mm"
    assert cut in text and cut in (tmp_path / "t" / "EXX.csv").read_text(encoding="utf-8")
    table = read_table(tmp_path / "t" / "EXX.csv")
    assert (table.positions[0], table.positions[-1], table.outside.any()) == (-200.0, 400.0, False)
    assert read_table(tmp_path / "t" / "ECC.csv").period == 360.0
    status, _, _ = run("tables", tmp_path / "s.h5", "--type", "R-POS", "--range", "C=0:90", "-o", tmp_path / "part")
    part = read_table(tmp_path / "part" / "ECC.csv")
    assert (status, part.period, part.positions[-1]) == (0, 0.0, 90.0)  # an arc does not close: end value held at 100°
    assert part.at(np.array([100.0]), np.zeros(1)) == part.at(np.array([90.0]), np.zeros(1))


def test_an_axis_measured_over_one_turn_is_measured_everywhere(files):
    """C travels two turns; its functions have period 360°, so one turn says all, and half of one does not."""
    _, solution = files["tilting table"]
    c = solution.machine.index("C")
    axes = tuple(replace(a, travel=(-360.0, 360.0)) if a.letter == "C" else a for a in solution.machine.axes)
    turning = replace(solution.machine, axes=axes)
    model = replace(solution.model, machine=turning)
    wide = replace(solution, campaign=replace(solution.campaign, machine=turning), model=model)
    q = np.zeros((3, len(axes)))
    q[:, c] = [-360.0, 0.0, 270.0]
    assert measured_over(wide, C=(-180, 180)).outside(q).tolist() == [False, False, False]
    assert measured_over(wide, C=(-90, 90)).outside(q).tolist() == [True, False, True]


RECREATED = (
    (
        "three-axis",
        "tables --type L-POS --type L-SQU --incremental --reversal value --increment 0.0001 --zero X=100,Y=-50",
    ),
    ("three-axis", "tables --type L-SQU --max-error 0.0002 --align spindle --at Y=70 --tool 0,0,-150"),
    ("tilting table", "tables --type R-RAX --type R-ANG --elevation 80 --max-points 7 --angle-increment 0.0001"),
    (
        "tilting table",
        "grid --type R-VOL --max-error 0.004 --offset 50 --reference-point 1,2,3 --align spindle --errors",
    ),
    ("fork head", "grid --type L-ANG --type R-POR --points 3 --datum primary=Z,secondary=X --tool 0,10,-99"),
)


@pytest.mark.parametrize(("layout", "words"), RECREATED)
def test_the_record_is_enough_to_make_a_file_again(files, run, tmp_path, layout, words):
    """Clause 12: the command in the header, run again, writes the same file but for its date and its own name."""
    folder = tmp_path / "a folder"  # blanks in names are quoted
    folder.mkdir()
    out, path = folder / ("t" if words.startswith("tables") else "g.csv"), files[layout][0]
    verb, *options = words.split()
    assert run(verb, path, *options, "-o", out)[0] == 0
    first = {p.relative_to(folder): p.read_text(encoding="utf-8") for p in sorted(folder.rglob("*.csv"))}
    assert first
    command = next(x for x in next(iter(first.values())).splitlines() if x.startswith("# command: "))
    for name in first:
        (folder / name).unlink()
    assert run(*shlex.split(command.removeprefix("# command: volid ")), "--force")[0] == 0
    for name, text in first.items():
        again = (folder / name).read_text(encoding="utf-8")
        same = [x for x in again.splitlines() if not x.startswith(("# date: ", "# command: "))]
        assert same == [x for x in text.splitlines() if not x.startswith(("# date: ", "# command: "))]
        assert ("aligned to the spindle" in text) == ("--align" in words)


def test_tables_are_zero_where_asked(files, run, tmp_path):
    """--zero X=100: the mean of both directions is 0 there, whatever the line; both styles of rows read back alike."""
    path, _ = files["three-axis"]
    base = ("tables", path, "--type", "L-POS", "--zero", "X=100", "--step", "50")
    for name, options in (("a", ()), ("i", ("--incremental", "--increment", "0.0001")), ("v", ("--reversal", "value"))):
        assert run(*base, *options, "-o", tmp_path / name)[0] == 0
    found = {n: read_table(tmp_path / n / "EXX.csv") for n in "aiv"}
    assert {t.zero for t in found.values()} == {"X = 100 mm"}
    x = np.arange(-400.0, 401.0, 50.0)
    for table in found.values():
        assert abs(float(table.at(np.array([100.0]), np.zeros(1))[0])) < 1e-9
        np.testing.assert_allclose(table.at(x, 0 * x), found["a"].at(x, 0 * x), atol=0.5e-4 + 1e-9)
    assert np.abs(found["a"].at(x, 0 * x)).max() > 0.002


def test_grids_are_zero_where_asked_and_rounded(files, run, tmp_path):
    """--zero takes the translations there out of all nodes and leaves rotations; least increments as control and note say."""
    path, _ = files["three-axis"]
    base = ("grid", path, "--type", "L-VOL", "--points", "5", "--tool", ORIGIN)
    assert run(*base, "-o", tmp_path / "plain.csv")[0] == 0
    assert run(*base, "--zero", "X=-200,Y=350", "-o", tmp_path / "zero.csv")[0] == 0
    plain, zero = (read_grid(tmp_path / f"{n}.csv") for n in ("plain", "zero"))
    node = np.flatnonzero((plain.positions == [-200.0, 350.0, 150.0]).all(axis=1))  # Z at the lines' crossing
    np.testing.assert_allclose(zero.values[:, :3], plain.values[:, :3] - plain.values[node, :3], atol=1e-6)  # products
    np.testing.assert_allclose(zero.values[:, 3:], plain.values[:, 3:], atol=1e-8)  # (60 µrad)² and the like
    assert np.abs(plain.values[node, :3]).min() > 1e-4
    assert np.all(zero.u[node, :3] < 1e-9) and zero.u[:, :3].max() > 1e-4  # what is zero by choice is known
    assert any("zero at X = -200, Y = 350, Z = 150 mm" in n for n in zero.notes)

    rounding = ("--increment", "0.0005", "--angle-increment", "0.0002")
    assert run(*base, *rounding, "-o", tmp_path / "coarse.csv")[0] == 0
    coarse = read_grid(tmp_path / "coarse.csv")
    for own, least, scale in ((slice(0, 3), 0.0005, 1.0), (slice(3, 6), 0.0002, 180.0 / np.pi)):
        steps = scale * coarse.values[:, own] / least
        np.testing.assert_allclose(steps, np.round(steps), atol=1e-5)
        off = np.abs(coarse.values - plain.values)[:, own].max() * scale
        assert 0.4 * least < off <= 0.5 * least + 1e-9
    assert any(n.startswith("least increment 0.0005 mm; largest change by rounding 0.0002") for n in coarse.notes)
    for verb, option, message in (
        (
            "grid",
            ("--type", "L-VOL", "--zero", "X=9000"),
            "--zero X=9000; expected positions of X, Y, Z within their travels",
        ),
        ("grid", ("--type", "L-VOL", "--increment", "0"), "--increment: '0': expected a finite number > 0 in mm"),
        ("grid", ("--zero", "X=0", "--intervals"), "--intervals and --zero exclude each other"),
    ):
        status, _, err = run(verb, path, *option, "--points", "2", "-o", tmp_path / "no.csv")
        assert (status, message in err, (tmp_path / "no.csv").exists()) == (2, True, False), err
    status, _, err = run("grid", files["tilting table"][0], "--type", "R-VOL", "--zero", "C=0")
    assert (status, "would displace its axis" in err) == (2, True)


def test_prediction_is_of_what_would_be_written(files, run, tmp_path):
    """X measured to 0 only: the grid ends there and holds its end value, which leaves more than a grid that extrapolates."""
    _, solution = files["three-axis"]
    write_solution(measured_over(solution, X=(-400, 0)), tmp_path / "s.h5")
    left = {}
    for option in ((), ("--extrapolate",), ("--range", "X=-400:0")):
        command = (
            "residual",
            tmp_path / "s.h5",
            "--type",
            "L-VOL",
            "--tool",
            ORIGIN,
            "--points",
            "9",
            "--json",
            *option,
        )
        status, text, err = run(*command)
        assert (status, "the travel of X was not measured to its ends" in err) == (1, True)
        left[option] = json.loads(text)["columns"][1]["predictions"][0]["exact"]["RMS"]
    assert left[()] == left["--range", "X=-400:0"]
    assert left[()] > 2.0 * left["--extrapolate",]


def test_a_figure_that_cannot_be_drawn_is_refused_before_the_work(files, run, tmp_path, monkeypatch):
    path, _ = files["tilting table"]
    asked = ("residual", path, "--type", "L-VOL", "-o", tmp_path / "r.csv", "--figure")
    status, _, err = run(*asked, tmp_path / "f.docx")
    assert (status, "a figure ends in .png, .svg, .pdf" in err) == (2, True), err
    monkeypatch.setattr("volid.cli.common.find_spec", lambda name: None)  # as on a machine without matplotlib
    status, _, err = run(*asked, tmp_path / "f.png")
    assert (status, "figures need matplotlib, which is not installed" in err) == (2, True), err
    assert not (tmp_path / "r.csv").exists()
