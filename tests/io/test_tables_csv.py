"""Tables and grids: what they say, that they can be read back, and that their signs are right on the virtual machine."""

import csv
import io
from dataclasses import replace

import h5py
import numpy as np
import pytest
from exact_chain import gauge_free
from support.small_campaign import SINGLE_TOOL

from volid.compensation.grids.linear import linear_grid
from volid.exceptions import InputError, OutputError
from volid.io.basics.provenance import sha256
from volid.io.functions_csv import (
    deviations_sheet,
    functions_sheet,
    read_deviations,
    read_functions,
    read_points,
    text_output,
    write_csv,
)
from volid.io.grid_reader import read_grid
from volid.io.grids import grid_header, grid_sheet, save_grid

TOOLS = np.array([[0.0, 0.0, -150.0], [80.0, 0.0, -250.0], [0.0, 90.0, -200.0]])
POINTS = """\
# three points, columns in another order than the machine's axes
tool_x,tool_y,tool_z,X,Y,Z,X_dir
0,0,-150,0,600,-500,1
80,0,-250, 500.5 ,300,-250,-1
0,90,-200,1000,0,0,0
"""


def points_file(tmp_path, text=POINTS):
    path = tmp_path / "points.csv"
    path.write_text(text, encoding="utf-8")
    return path


def text_of(sheet):
    stream = io.StringIO()
    write_csv(stream, sheet)
    return stream.getvalue()


def saved(sheet, path):
    with text_output(path) as stream:
        write_csv(stream, sheet)
    return path


# --------------------------------------------------------------------------------------------------------- points


def test_points_come_in_machine_order(solution, tmp_path):
    points = read_points(points_file(tmp_path), solution.machine)
    assert solution.machine.letters == ("Y", "X", "Z")
    np.testing.assert_array_equal(points.positions[1], [300.0, 500.5, -250.0])
    np.testing.assert_array_equal(points.tool, TOOLS)
    np.testing.assert_array_equal(points.directions[:, 1], [1.0, -1.0, 0.0])
    assert not points.directions[:, [0, 2]].any()


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("X,Y,Z,X_dir", "X,Y,Q,X_dir", "header: unknown column 'Q'"),
        ("tool_z,X", "toolz,X", "header: unknown column 'toolz'; did you mean 'tool_z'"),
        (
            "tool_x,tool_y,tool_z,X",
            "Y_dir,tool_y,tool_z,X",
            "column 'tool_x' is missing; a point needs its tool vector",
        ),
        ("X,Y,Z,X_dir", "X,Y,Z_dir,X_dir", "column 'Z' is missing.*a point needs a position of every axis"),
        ("0,90,-200,1000,0,0,0", "0,90,-200,1000,,0,0", "row 5: Y is empty; expected a finite number in mm"),
        ("0,90,-200,1000,0,0,0", "0,90,-200,1000,nan,0,0", "row 5: Y is 'nan'; expected a finite number"),
        ("1000,0,0,0", "1000,0,0,2", "row 5: X_dir is 2; expected"),
        ("1000,0,0,0", "1000,0,0", "row 5: 6 cells; expected 7"),
        (POINTS, "X,Y,Z,tool_x,tool_y,tool_z\n", "there is a header but no row"),
        (POINTS, "", "the file is empty"),
    ],
)
def test_wrong_points_are_named(solution, tmp_path, old, new, message):
    with pytest.raises(InputError, match=rf"points\.csv.*{message}"):
        read_points(points_file(tmp_path, POINTS.replace(old, new)), solution.machine)


# ----------------------------------------------------------------------------------------------------- deviations


def test_deviations_repeat_the_points_and_can_be_read_back(solution, solution_file, tmp_path):
    points = read_points(points_file(tmp_path), solution.machine)
    found = solution.evaluate(points.positions, points.tool, points.directions)
    path = saved(deviations_sheet(points, found, solution, solution_file), tmp_path / "out.csv")
    lines = [line for line in path.read_text(encoding="utf-8").splitlines() if not line.startswith("#")]
    header = "tool_x,tool_y,tool_z,X,Y,Z,X_dir,ex,ey,ez,ea,eb,ec,u_ex,u_ey,u_ez,u_ea,u_eb,u_ec,outside"
    assert lines[0] == header
    assert lines[2].startswith("80,0,-250,500.5,300,-250,-1,")
    again, values = read_deviations(path, solution.machine)
    np.testing.assert_array_equal(again.positions, points.positions)
    np.testing.assert_array_equal(values.values, found.values)
    np.testing.assert_array_equal(values.u, found.u)
    np.testing.assert_array_equal(values.outside, found.outside)
    assert values.determined.all()


def test_a_table_says_where_it_comes_from(solution, solution_file, tmp_path):
    points = read_points(points_file(tmp_path), solution.machine)
    found = solution.evaluate(points.positions, points.tool)
    text = text_of(deviations_sheet(points, found, solution, solution_file))
    for line in (
        "# values: deviation of the functional point, actual - nominal, machine frame",
        "# datum: primary axis X, secondary axis Y; zero at X = 500, Y = 300, Z = -250 mm",
        "# machine: Testmaschine Ω [w Y' X' b Z (C) t]",
        "# campaign: Abnahme 2026",
        '# conditions: {"ambient_temperature_C": 20.0}',
        "# measured: X 0 … 1000 mm, Y 0 … 600 mm, Z -500 … 0 mm",
        f"# source: {solution_file}",
        f"# source sha256: {sha256(solution_file)}",
    ):
        assert line in text
    assert "REJECTED" not in text


def test_a_rejected_model_is_named_before_the_numbers(rejected_solution, tmp_path):
    points = read_points(points_file(tmp_path), rejected_solution.machine)
    found = rejected_solution.evaluate(points.positions, points.tool)
    text = text_of(deviations_sheet(points, found, rejected_solution))
    assert text.index("# MODEL REJECTED: model rejected by the data") < text.index("\ntool_x,")


def test_what_is_not_determined_stays_blank_and_outside_is_flagged(single_tool_solution, tmp_path):
    text = POINTS.replace("1000,0,0,0", "1000,0,50,0").replace("300,-250,-1", "300,-100,-1")
    points = read_points(points_file(tmp_path, text), single_tool_solution.machine)
    found = single_tool_solution.evaluate(points.positions, points.tool)
    path = saved(deviations_sheet(points, found, single_tool_solution), tmp_path / "out.csv")
    rows = list(csv.DictReader(line for line in path.read_text().splitlines() if not line.startswith("#")))
    assert rows[1]["ec"] == ""  # the roll ECZ needs a lateral tool offset; at its reference, Z = -250, it is zero
    assert rows[1]["u_ec"] == ""
    assert float(rows[0]["ez"]) == found.values[0, 2]
    assert [row["outside"] for row in rows] == ["0", "0", "1"]
    _, again = read_deviations(path, single_tool_solution.machine)
    np.testing.assert_array_equal(again.determined, found.determined)


def test_deviations_are_those_of_the_virtual_machine(virtual, solution, tmp_path):
    rng = np.random.default_rng(2)
    q = np.stack([rng.uniform(*axis.travel, 60) for axis in solution.machine.axes], axis=1)
    tool = TOOLS[rng.integers(3, size=60)]
    columns = [*q[:, [1, 0, 2]].T, *tool.T]
    lines = ["X,Y,Z,tool_x,tool_y,tool_z", *(",".join(map(repr, row)) for row in np.transpose(columns).tolist())]
    points = read_points(points_file(tmp_path, "\n".join(lines)), solution.machine)
    sheet = deviations_sheet(points, solution.evaluate(points.positions, points.tool), solution)
    _, found = read_deviations(saved(sheet, tmp_path / "out.csv"), solution.machine)
    truth = virtual.machine.deviation(q, tool, virtual.truth)[:, :3]
    xyz = q[:, [1, 0, 2]]
    before, _ = gauge_free(truth, xyz, tool)
    left, _ = gauge_free(found.values[:, :3] - truth, xyz, tool)
    assert np.abs(before).max() > 0.006  # mm: there is something to find
    assert np.abs(left).max() < 5 * found.u[:, :3].max()
    assert np.abs(left).max() < 0.25 * np.abs(before).max()


def test_a_table_is_not_overwritten(tmp_path):
    (tmp_path / "out.csv").write_text("mine")
    with pytest.raises(OutputError, match=r"out\.csv exists"), text_output(tmp_path / "out.csv") as stream:
        stream.write("theirs")
    assert (tmp_path / "out.csv").read_text() == "mine"


# ------------------------------------------------------------------------------------------------------ functions


@pytest.mark.parametrize("name", ["solution", "single_tool_solution", "rich_solution", "rotary_solution"])
def test_functions_can_be_read_back(name, request, tmp_path):
    solution = request.getfixturevalue(name)
    rows = solution.functions(step=250.0)
    again = read_functions(saved(functions_sheet(rows, solution), tmp_path / "functions.csv"))
    assert [r[:2] for r in again] == [r[:2] for r in rows]
    np.testing.assert_array_equal([r[2:] for r in again], [r[2:] for r in rows])


def test_functions_table(rich_solution, single_tool_solution):
    text = text_of(functions_sheet(rich_solution.functions(step=500.0), rich_solution))
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    assert lines[0] == "function,axis,position,direction,value,u"
    rows = list(csv.DictReader(lines))
    assert [(r["position"], r["direction"]) for r in rows if r["function"] == "EXX"] == [
        (p, d) for d in ("1", "-1") for p in ("0.0", "500.0", "1000.0")
    ]
    squareness = next(r for r in rows if r["function"] == "EC0Y")
    assert squareness["position"] == ""
    assert float(squareness["value"]) == rich_solution.location("EC0Y").value
    text = text_of(functions_sheet(single_tool_solution.functions(step=500.0), single_tool_solution))
    assert "\nECZ,Z,-500.0,0,,\n" in text
    assert "\nEC0S,S,,0,,\n" in text


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("EXQ,X,0,0,1,1", "row 2: 'EXQ' is not an ISO 230-1 error symbol"),
        ("EXX,X,zero,0,1,1", "row 2: position is 'zero'"),
        ("EXX,X,0,,1,1", "row 2: direction is empty"),
    ],
)
def test_wrong_function_tables_are_named(tmp_path, line, message):
    (tmp_path / "f.csv").write_text(f"function,axis,position,direction,value,u\n{line}\n")
    with pytest.raises(InputError, match=message):
        read_functions(tmp_path / "f.csv")


# ----------------------------------------------------------------------------------------------------------- grids


@pytest.fixture(scope="module")
def grid(solution):
    return linear_grid(solution, points=4, tool=SINGLE_TOOL)


def rows_of(path):
    lines = [line for line in path.read_text(encoding="utf-8").splitlines() if not line.startswith("#")]
    return list(csv.DictReader(lines))


def test_grid_file_holds_compensation_values_in_mm_and_degrees(grid, solution, tmp_path):
    save_grid(grid, solution, tmp_path / "grid.csv")
    rows = rows_of(tmp_path / "grid.csv")
    columns = "X,Y,Z,dX,dY,dZ,dA,dB,dC,u_dX,u_dY,u_dZ,u_dA,u_dB,u_dC,outside"
    assert list(rows[0]) == columns.split(",")
    assert len(rows) == 64
    assert [float(row["X"]) for row in rows[:5]] == pytest.approx([0.0, 1000 / 3, 2000 / 3, 1000.0, 0.0])
    e = solution.evaluate(np.array([[0.0, 1000.0, -500.0]]), np.array(SINGLE_TOOL))  # Y, X, Z
    assert float(rows[3]["dX"]) == pytest.approx(-e.values[0, 0], abs=6e-10)
    assert float(rows[3]["dB"]) == pytest.approx(-np.rad2deg(e.values[0, 4]), abs=6e-13)
    assert float(rows[3]["u_dB"]) == pytest.approx(np.rad2deg(e.u[0, 4]), abs=6e-13)
    assert "e-" not in "".join(value for row in rows for value in row.values())  # controls read no exponents


def test_errors_are_minus_the_compensation(grid, solution, tmp_path):
    save_grid(grid, solution, tmp_path / "c.csv")
    save_grid(grid, solution, tmp_path / "e.csv", errors=True)
    for c, e in zip(rows_of(tmp_path / "c.csv"), rows_of(tmp_path / "e.csv"), strict=True):
        for name in ("dX", "dY", "dZ", "dA", "dB", "dC"):
            assert float(c[name]) == -float(e[name])
        assert c["u_dX"] == e["u_dX"]
    assert "# values: compensation\n" in (tmp_path / "c.csv").read_text(encoding="utf-8")
    assert "# values: error\n" in (tmp_path / "e.csv").read_text(encoding="utf-8")


def test_grid_file_states_all_conventions(grid, solution, solution_file, tmp_path):
    save_grid(grid, solution, tmp_path / "grid.csv", source=solution_file)
    text = (tmp_path / "grid.csv").read_text(encoding="utf-8")
    for line in (
        "# format: volid-grid/1\n",
        "# type: L-VOL\n",
        "# sign: compensation value = -(actual - nominal)",
        "# absolute: absolute values, not increments\n",
        "# units: X, Y, Z, dX, dY, dZ mm; dA, dB, dC degrees",
        "# tool vector: 0, 0, -150 mm;",
        "# frame: machine\n",
        "# datum: primary axis X",
        f"# source sha256: {sha256(solution_file)}\n",
        "# machine: Testmaschine Ω",
        "# conditions: {",
        "# date: 20",
    ):
        assert line in text, line


@pytest.mark.parametrize("name", ["grid.csv", "grid.h5"])
@pytest.mark.parametrize("errors", [False, True])
def test_grids_can_be_read_back_as_error_values(grid, solution, tmp_path, name, errors):
    values = grid.values.copy()
    values[5, 3:] = np.nan
    outside = np.arange(len(values)) % 7 == 0
    given = replace(grid, values=values, outside=outside, notes=("dA is blank: not determined", "mind the gap"))
    save_grid(given, solution, tmp_path / name, errors=errors)
    found = read_grid(tmp_path / name)
    np.testing.assert_allclose(found.values[:, :3], given.values[:, :3], rtol=0, atol=6e-10)  # mm: nine places
    np.testing.assert_allclose(found.values[:, 3:], given.values[:, 3:], rtol=0, atol=1e-14)  # rad: twelve of a degree
    np.testing.assert_allclose(found.u, given.u, rtol=0, atol=6e-10)
    np.testing.assert_array_equal(found.positions, given.positions)
    np.testing.assert_array_equal(found.outside, outside)
    for a, b in zip(found.nodes, given.nodes, strict=True):
        np.testing.assert_array_equal(a, b)
    for key in ("type", "axes", "tool", "frame", "datum", "notes"):
        assert getattr(found, key) == getattr(given, key)


def test_hdf5_grid_for_plain_h5py(grid, solution, tmp_path):
    save_grid(grid, solution, tmp_path / "grid.h5")
    with h5py.File(tmp_path / "grid.h5") as file:
        assert file.attrs["values"] == "compensation"
        assert file.attrs["tool_vector"].startswith("0, 0, -150 mm")
        assert file["values"].attrs["columns"].tolist() == ["dX", "dY", "dZ", "dA", "dB", "dC"]
        np.testing.assert_array_equal(file["values"][:, :3], -grid.values[:, :3])
        np.testing.assert_allclose(file["values"][:, 3:], -np.rad2deg(grid.values[:, 3:]), rtol=1e-15)


def test_compensation_read_from_the_file_removes_the_deviation(virtual, solution, tmp_path):
    """Closed loop on the independent machine: command + value from the file, and the functional point is where it should be."""
    save_grid(linear_grid(solution, points=9, tool=SINGLE_TOOL), solution, tmp_path / "grid.csv")
    rows = rows_of(tmp_path / "grid.csv")
    xyz = np.array([[float(row[a]) for a in "XYZ"] for row in rows])
    correction = np.array([[float(row[f"d{a}"]) for a in "XYZ"] for row in rows])
    nominal = virtual.machine.functional_point(xyz[:, [1, 0, 2]], SINGLE_TOOL)
    off = virtual.machine.functional_point(xyz[:, [1, 0, 2]], SINGLE_TOOL, virtual.truth) - nominal
    corrected = (xyz + correction)[:, [1, 0, 2]]
    left = virtual.machine.functional_point(corrected, SINGLE_TOOL, virtual.truth) - nominal
    before, after = (gauge_free(field, xyz, SINGLE_TOOL)[0] for field in (off, left))
    assert np.linalg.norm(before, axis=1).max() > 0.010  # mm
    assert np.linalg.norm(after, axis=1).max() < 0.15 * np.linalg.norm(before, axis=1).max()


def text_grid(grid, solution):
    return text_of(grid_sheet(grid, grid_header(grid, "error", solution)))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("# values: error\n", "", "header 'values' is missing"),
        ("# values: error\n", "# values: both\n", "values are 'both'; expected error or compensation"),
        ("volid-grid/1", "volid-grid/7", "format is 'volid-grid/7'; this volid reads 'volid-grid/1'"),
        ("dX, dY, dZ mm", "dX, dY, dZ µm", "units name 'µm'; a grid is read in mm and degrees"),
        ("tool vector: 0, 0", "tool vector: 0", "tool vector is '0, -150 mm.*expected three numbers"),
        ("\n1000.0,0.0,-500.0,", "\n999.0,0.0,-500.0,", "no regular grid; expected every combination"),
        ("X,Y,Z,dX", "X,Y,Z,dx", "unknown column 'dx'; did you mean 'dX'"),
        (",0\n", ",2\n", "outside is 2; expected 0 or 1"),
    ],
)
def test_wrong_grids_are_named(grid, solution, tmp_path, old, new, message):
    path = tmp_path / "grid.csv"
    path.write_text(text_grid(grid, solution).replace(old, new), encoding="utf-8")
    with pytest.raises(InputError, match=message):
        read_grid(path)
