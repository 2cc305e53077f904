"""ISO/TR 16907 Tables 1 to 3: out of the command line as printed there, and read back, also as others wrote them.

The numbers of Tables 1 and 2 are those of the Technical Report as the project's description of it has them.
"""

import csv
import io

import numpy as np
import pytest

import volid
from volid.compensation.grids.grid import Grid, RotaryGrid
from volid.exceptions import InputError
from volid.io.functions_csv import write_csv
from volid.io.grid_reader import read_grid
from volid.io.grids import grid_sheet
from volid.io.table_reader import read_table

X = (0, 50, 100)
TABLE_1 = ((0.0, 0.0008), (0.0015, 0.0022), (0.0019, 0.0025))  # EXX(+), EXX(-), mm
TABLE_2 = (
    (0, 0, 0, 0, 0, 0),
    (0.001, 0.001, 0, 0, 0.001, 0.002),
    (0.002, -0.002, -0.001, -0.003, -0.003, -0.002),
)  # ΔX … ΔC at X = 0, 50, 100; mm and degrees

MACHINE = """\
format = "volid-machine/1"
name = "Machine of Table 1"
structure = "w X' Y' b Z t"
[axis.X]
travel = [0.0, 100.0]
[axis.Y]
travel = [0.0, 100.0]
[axis.Z]
travel = [0.0, 100.0]
[model]
degree = 1
[model.functions]
"E*" = false
EXX = { segments = 2, reversal = true }
"""
MANIFEST = """\
format = "volid-campaign/1"
machine = "machine.toml"
[[set]]
name = "X"
kind = "component"
file = "x.csv"
tool = [0.0, 0.0, 0.0]
u = 0.0001
"""


def records(path):
    lines = [line for line in path.read_text(encoding="utf-8").splitlines() if not line.startswith("#")]
    return list(csv.reader(lines))


@pytest.fixture(scope="module")
def solution(tmp_path_factory):
    """A fit to the values of Table 1, measured three times from an arbitrary zero."""
    folder = tmp_path_factory.mktemp("table1")
    rows = ["X,Y,Z,X_dir,component,value"]
    for k in (-1, 0, 1):  # runs 0.01 µm apart
        for x, (up, down) in zip(X, TABLE_1, strict=True):
            rows += [f"{x},50,50,1,X,{0.0123 + up + 1e-5 * k:.5f}", f"{x},50,50,-1,X,{0.0123 + down + 1e-5 * k:.5f}"]
    for name, text in (("machine.toml", MACHINE), ("campaign.toml", MANIFEST), ("x.csv", "\n".join(rows) + "\n")):
        (folder / name).write_text(text, encoding="utf-8")
    volid.save_solution(volid.fit(volid.load_campaign(folder / "campaign.toml")), folder / "s.h5")
    return folder / "s.h5"


@pytest.mark.parametrize(
    ("reversal", "columns", "second"),
    [("columns", "EXX(-)", ["0.0008", "0.0022", "0.0025"]), ("difference", "EXX(-)-EXX(+)", ["0.0008", "0.0007", "0.0006"])],
)  # fmt: skip
def test_table_1_as_printed(solution, run, tmp_path, reversal, columns, second):
    options = [
        "--type",
        "L-POS",
        "--errors",
        "--step",
        50,
        "--layout",
        "iso",
        "--reversal",
        reversal,
        "--increment",
        0.0001,
    ]
    status, _, err = run("tables", solution, *options, "-o", tmp_path / "t")
    assert status in (0, 1) and "error" not in err  # 1: positions too few to tell what lies between
    assert records(tmp_path / "t" / "EXX.csv") == [
        ["X", "EXX(+)", columns],
        *([str(x), up, s] for x, up, s in zip(X, ["0", "0.0015", "0.0019"], second, strict=True)),
    ]
    found = read_table(tmp_path / "t" / "EXX.csv")
    np.testing.assert_allclose(np.stack([found.forward, found.reverse], axis=1), TABLE_1, atol=1e-12)
    assert found.zero == "X = 0 mm, approached in +"


def test_zero_is_where_it_is_asked_for(solution, run, tmp_path):
    for approach, expected in (("+", TABLE_1[1][0]), ("-", TABLE_1[1][1]), ("mean", np.mean(TABLE_1[1]))):
        place = tmp_path / approach
        run(
            "tables",
            solution,
            "--type",
            "L-POS",
            "--errors",
            "--step",
            50,
            "--zero",
            "X=50",
            "--approach",
            approach,
            "-o",
            place,
        )
        found = read_table(place / "EXX.csv")
        np.testing.assert_allclose(
            np.stack([found.forward, found.reverse], axis=1), np.array(TABLE_1) - expected, atol=1e-9
        )


PUBLISHED_1 = "X;EXX(+);EXX(-)\n0;0;0,0008\n50;0,0015;0,0022\n100;0,0019;0,0025\n"


@pytest.mark.parametrize(
    "text",
    [
        PUBLISHED_1,
        PUBLISHED_1.replace("EXX(-)", "EXX(-)-EXX(+)").replace("0,0022", "0,0007").replace("0,0025", "0,0006"),
        PUBLISHED_1.replace(",", ".").replace(";", ","),
        PUBLISHED_1.replace("X;EXX(+);EXX(-)", "X [mm];EXX(+) [mm];EXX(-) [mm]"),
        "X;EXX(+);EXX(-)\nmm;µm;µm\n0;0;0,8\n50;1,5;2,2\n100;1,9;2,5\n",
    ],
    ids=["columns", "difference", "points", "units in brackets", "units below"],
)
def test_table_1_as_others_write_it(tmp_path, text):
    path = tmp_path / "EXX.csv"
    path.write_text(f"# values: error\n{text}", encoding="utf-8")
    found = read_table(path)
    assert (found.function, found.type, found.positions.tolist()) == ("EXX", "L-POS", [0.0, 50.0, 100.0])
    np.testing.assert_allclose(np.stack([found.forward, found.reverse], axis=1), TABLE_1, atol=1e-15)
    path.write_text(f"# values: compensation\n{text}", encoding="utf-8")
    np.testing.assert_allclose(read_table(path).forward, -np.array(TABLE_1)[:, 0], atol=1e-15)
    path.write_text(text, encoding="utf-8")
    with pytest.raises(
        InputError, match=r"EXX\.csv: header 'values' is missing; expected .* lines '# key: value' that say it"
    ):
        read_table(path)


def printed(grid, values="error"):
    stream = io.StringIO()
    write_csv(stream, grid_sheet(grid, {"format": "volid-grid/1", "type": grid.type, "values": values}, "iso"))
    return [line for line in stream.getvalue().splitlines() if not line.startswith("#")]


def test_table_2_as_printed():
    values = np.array(TABLE_2) * np.array([1, 1, 1, *[np.pi / 180] * 3])
    nodes = (np.array(X, dtype=float), np.zeros(1), np.zeros(1))
    places, inside = np.array([(x, 0.0, 0.0) for x in X]), np.zeros(3, dtype=bool)
    grid = Grid("L-VOL", tuple("XYZ"), nodes, places, values, values, inside, (0.0, 0.0, 0.0), "machine", "X")
    assert printed(grid) == [
        "n,X,Y,Z,ΔX,ΔY,ΔZ,ΔA,ΔB,ΔC",
        "1,0,0,0,0,0,0,0,0,0",
        "2,50,0,0,0.001,0.001,0,0,0.001,0.002",
        "3,100,0,0,0.002,-0.002,-0.001,-0.003,-0.003,-0.002",
    ]
    assert printed(grid, "compensation")[2] == "2,50,0,0,-0.001,-0.001,0,0,-0.001,-0.002"


def test_table_3_has_c_running_fastest():
    nodes = (np.array([0.0, 10.0]), np.array([0.0, 5.0, 10.0]))
    positions = np.array([(a, c) for c in nodes[1] for a in nodes[0]])  # in memory the first axis runs fastest
    values = np.zeros((6, 6))
    values[:, 0] = 1e-3 * (10 * positions[:, 0] + positions[:, 1])
    inside, known, origin = np.zeros(6, dtype=bool), np.isfinite(values), (0.0, 0.0, 0.0)
    both = (nodes, positions, values, values, inside)
    grid = RotaryGrid("R-VOL", ("A", "C"), *both, "table", known, origin, (0.0, 0.0), "machine", "X")
    assert grid.table_3()[1][:, :3].tolist() == [[1, 0, 0], [2, 0, 5], [3, 0, 10], [4, 10, 0], [5, 10, 5], [6, 10, 10]]
    assert [line.split(",")[:4] for line in printed(grid)] == [
        ["n", "A", "C", "ΔX"],
        ["1", "0", "0", "0"],
        ["2", "0", "5", "0.005"],
        ["3", "0", "10", "0.01"],
        ["4", "10", "0", "0.1"],
        ["5", "10", "5", "0.105"],
        ["6", "10", "10", "0.11"],
    ]


PUBLISHED_2 = (
    "n;X;Y;Z;ΔX;ΔY;ΔZ;ΔA;ΔB;ΔC\n1;0;0;0;0;0;0;0;0;0\n2;50;0;0;0,001;0,001;0;0;0,001;0,002\n"
    "3;100;0;0;0,002;-0,002;-0,001;-0,003;-0,003;-0,002\n"
)
STATED_2 = "# values: error\n# tool vector: 0, 0, -150 mm\n"


@pytest.mark.parametrize(
    "text",
    [
        PUBLISHED_2,
        PUBLISHED_2.replace(",", ".").replace(";", "\t"),
        PUBLISHED_2.replace("Δ", "d"),
        PUBLISHED_2.replace("Δ", "∆").replace("n;", "No.;", 1),
        PUBLISHED_2.replace("ΔX", "ΔX [mm]").replace("ΔC", "ΔC [°]"),
    ],
)
def test_table_2_as_others_write_it(tmp_path, text):
    path = tmp_path / "grid.csv"
    path.write_text(STATED_2 + text, encoding="utf-8")
    found = read_grid(path)
    assert (found.type, found.axes, found.tool) == ("L-VOL", ("X", "Y", "Z"), (0.0, 0.0, -150.0))
    np.testing.assert_allclose(found.values[:, :3], np.array(TABLE_2)[:, :3], atol=1e-15)
    np.testing.assert_allclose(np.degrees(found.values[:, 3:]), np.array(TABLE_2)[:, 3:], atol=1e-15)
    assert np.isnan(found.u).all() and not found.outside.any()
    for missing, message in (
        ("values", "header 'values' is missing"),
        ("tool vector", "header 'tool vector' is missing"),
    ):
        path.write_text("".join(s for s in STATED_2.splitlines(True) if missing not in s) + text, encoding="utf-8")
        with pytest.raises(InputError, match=message):
            read_grid(path)


def test_table_3_as_others_write_it(tmp_path):
    path = tmp_path / "grid.csv"
    rows = [f"{n};{a};{c};{0.001 * c:g};0;0;0;0;{0.01 * a:g}".replace(".", ",") for n, (a, c) in enumerate(
        [(a, c) for a in (0, 10) for c in (0, 5, 10)], start=1)]  # fmt: skip
    stated = "# values: error\n# side: table\n# reference point: 0, 0, 100 mm\n"
    path.write_text(stated + "\n".join(["n;A;C;ΔX;ΔY;ΔZ;ΔA;ΔB;ΔC", *rows]) + "\n", encoding="utf-8")
    found = read_grid(path)
    assert (found.type, found.axes, found.reference_point) == ("R-VOL", ("A", "C"), (0.0, 0.0, 100.0))
    np.testing.assert_allclose(found.values[:, 0], 0.001 * found.positions[:, 1], atol=1e-15)
    np.testing.assert_allclose(np.degrees(found.values[:, 5]), 0.01 * found.positions[:, 0], atol=1e-15)


def test_a_control_reads_published_tables_and_grids(tmp_path):
    (tmp_path / "c").mkdir()
    (tmp_path / "c" / "EXX.csv").write_text(f"# values: error\n{PUBLISHED_1}", encoding="utf-8")
    (tmp_path / "c" / "grid.csv").write_text(STATED_2 + PUBLISHED_2, encoding="utf-8")
    (tmp_path / "machine.toml").write_text(MACHINE, encoding="utf-8")
    control = volid.load_control(volid.load_machine(tmp_path / "machine.toml"), [tmp_path / "c"])
    assert [t.function for t in control.tables] == ["EXX"] and [g.type for g in control.grids] == ["L-VOL"]
    (tmp_path / "c" / "notes.csv").write_text("a,b\n1,2\n", encoding="utf-8")
    with pytest.raises(
        InputError, match=r"notes\.csv: format is 'missing'; expected 'volid-table/1' or 'volid-grid/1'"
    ):
        volid.load_control(volid.load_machine(tmp_path / "machine.toml"), [tmp_path / "c"])


def test_grids_of_the_command_line_in_the_published_layout(solution, run, tmp_path):
    """The same numbers as in the layout of volid, n before them and nothing behind."""
    for layout in ("volid", "iso"):
        run(
            "grid",
            solution,
            "--type",
            "L-POS",
            "--points",
            3,
            "--extrapolate",
            "--layout",
            layout,
            "-o",
            tmp_path / f"{layout}.csv",
        )
    one, other = records(tmp_path / "volid.csv"), records(tmp_path / "iso.csv")
    assert other[0] == ["n", "X", "Y", "Z", "ΔX", "ΔY", "ΔZ", "ΔA", "ΔB", "ΔC"]
    assert [row[0] for row in other[1:]] == [str(i) for i in range(1, len(one))]
    for a, b in zip(one[1:], other[1:], strict=True):
        np.testing.assert_allclose([float(c or "nan") for c in a[:9]], [float(c or "nan") for c in b[1:]], atol=1e-12)
    read = [read_grid(tmp_path / f"{layout}.csv") for layout in ("volid", "iso")]
    np.testing.assert_array_equal(read[0].values, read[1].values)


@pytest.mark.parametrize(
    ("command", "message"),
    [
        (
            ("tables", "--type", "L-POS", "--approach", "+", "-o", "t"),
            "--approach + says how the position of --zero is approached",
        ),
        (("grid", "--layout", "iso", "-o", "g.h5"), "--layout iso is a table of positions and values in CSV"),
        (("grid", "--layout", "iso", "--intervals", "-o", "g.csv"), "which --intervals is not; leave one out"),
    ],
)
def test_options_that_do_not_go_together(solution, run, tmp_path, monkeypatch, command, message):
    monkeypatch.chdir(tmp_path)
    status, _, err = run(command[0], solution, *command[1:])
    assert status == 2 and message in err and list(tmp_path.iterdir()) == []


def test_a_record_that_a_spreadsheet_wrote_again(solution, run, tmp_path):
    run("tables", solution, "--type", "L-POS", "--step", 50, "-o", tmp_path / "t")
    path = tmp_path / "t" / "EXX.csv"
    before = read_table(path)
    lines = path.read_text(encoding="utf-8").splitlines()
    german = [
        ('"' + line.replace('"', '""') + '"' if "," in line else line) + ";" * 5
        if line.startswith("#")
        else line.replace(",", ";").replace(".", ",")
        for line in lines
    ]
    path.write_bytes("\r\n".join(german).encode("cp1252"))
    after = read_table(path)
    assert (after.type, after.function, after.zero, after.datum) == (
        before.type,
        before.function,
        before.zero,
        before.datum,
    )
    np.testing.assert_array_equal(after.forward, before.forward)
    np.testing.assert_array_equal(after.u, before.u)
