"""Tables and grids as files: layouts of ISO/TR 16907, sampling, rounding, reversal, superposition, record, wrong input."""

import csv
import hashlib
import re
from dataclasses import replace

import numpy as np
import pytest
from support.compensated import TOOL, machine_and_solution, only
from support.grids import effect_grids

from volid.compensation.base import base_of
from volid.compensation.grids.grid import Grid
from volid.compensation.grids.nodes import grid_interpolation
from volid.compensation.grids.request import GridRequest
from volid.compensation.package import compensate
from volid.compensation.rounding import round_to
from volid.compensation.superposition import add_grid, add_tables
from volid.compensation.tables.by_function import error_tables
from volid.compensation.tables.error_table import ErrorTable
from volid.compensation.tables.sampling import Sampling, choose_nodes, interpolation_error
from volid.compensation.types import TYPES, select
from volid.exceptions import InputError, NotDeterminedError
from volid.io.compensations import load_control, save_compensation
from volid.io.functions_csv import write_csv
from volid.io.grid_reader import read_grid
from volid.io.grids import save_grid
from volid.io.table_reader import read_table
from volid.io.tables import TableForm, increments, table_header, table_sheet, written_values


def table_of(positions, forward, reverse=None, function="EXX", **changes):
    """A table with given error values."""
    forward = np.asarray(forward, dtype=float)
    fields = dict(
        type="L-POS", function=function, positions=np.asarray(positions, dtype=float), forward=forward,
        reverse=forward if reverse is None else np.asarray(reverse, dtype=float), u=np.full((len(forward), 2), 1e-4),
        outside=np.zeros(len(forward), dtype=bool), applied="kinematic model", interpolation=0.0,
        basis={"line": "Y = 0 mm, Z = 0 mm"}, zero="X = 0 mm", datum="a datum",
    )  # fmt: skip
    return ErrorTable(**(fields | changes))


def written(table, solution, path, form=None, source=None):
    form = TableForm() if form is None else form
    with path.open("w", newline="", encoding="utf-8") as stream:
        write_csv(stream, table_sheet(table, form, table_header(table, form, solution, source)))
    return path


def rows_of(path):
    return list(csv.reader(line for line in path.read_text(encoding="utf-8").splitlines() if not line.startswith("#")))


RECORD = (
    "format",
    "type",
    "values",
    "sign",
    "units",
    "applied",
    "datum",
    "tool vector",
    "limits",
    "frame",
    "conditions",
)
RECORD += ("date", "source", "machine")


@pytest.fixture(scope="module")
def three_axis():
    return machine_and_solution("three-axis", seed=3)[1]


# ------------------------------------------------------------------------------------------- layouts of ISO/TR 16907


def test_table_1_of_the_technical_report(three_axis, tmp_path):
    """Table 1: EXX(+), EXX(-) at X = 0, 50, 100: (0; 0,0008), (0,0015; 0,0022), (0,0019; 0,0025) mm, as two columns, or the
    second column the reversal alone, which is added for motion in - (9.2.3)."""
    table = table_of([0, 50, 100], [0, 0.0015, 0.0019], [0.0008, 0.0022, 0.0025])
    columns, rows = table.table_1(errors=True)
    assert columns == ("X", "EXX(+)", "EXX(-)")
    np.testing.assert_allclose(rows, [[0, 0, 0.0008], [50, 0.0015, 0.0022], [100, 0.0019, 0.0025]])
    np.testing.assert_allclose(table.table_1("difference", errors=True)[1][:, 2], [0.0008, 0.0007, 0.0006], atol=1e-15)
    np.testing.assert_allclose(table.table_1()[1][:, 1:], -rows[:, 1:])
    assert table.reversal_value == pytest.approx(-0.0007)
    assert table.reversal_loss == pytest.approx(0.00005)
    for reversal in ("columns", "difference"):
        for errors in (True, False):
            found = read_table(written(table, three_axis, tmp_path / "t.csv", TableForm(errors, reversal=reversal)))
            np.testing.assert_allclose(found.forward, table.forward, atol=1e-12)
            np.testing.assert_allclose(found.reverse, table.reverse, atol=1e-12)
    one = read_table(written(table, three_axis, tmp_path / "t.csv", TableForm(reversal="value")))
    np.testing.assert_allclose(one.forward - one.reverse, -0.0007, atol=1e-12)
    np.testing.assert_allclose(one.forward + one.reverse, table.forward + table.reverse, atol=1e-12)


def test_table_2_of_the_technical_report():
    """Table 2: n, X, Y, Z, ΔX, ΔY, ΔZ, ΔA, ΔB, ΔC; point 2 at X = 50: 0,001 0,001 0 / 0 0,001 0,002, rotations in degrees."""
    nodes = (np.array([0.0, 50.0]), np.array([0.0, 50.0]), np.array([0.0, 50.0]))
    values = np.zeros((8, 6))
    values[1] = [0.001, 0.001, 0.0, 0.0, np.deg2rad(0.001), np.deg2rad(0.002)]
    positions = np.stack([g.ravel() for g in np.meshgrid(*nodes, indexing="ij")][::-1], axis=1)
    grid = Grid(
        "L-VOL", ("X", "Y", "Z"), nodes, positions, values, values, np.zeros(8, bool), TOOL, "machine", "a datum"
    )
    columns, rows = grid.table_2(errors=True)
    assert columns == ("n", "X", "Y", "Z", "ΔX", "ΔY", "ΔZ", "ΔA", "ΔB", "ΔC")
    np.testing.assert_allclose(rows[1], [2, 50, 0, 0, 0.001, 0.001, 0, 0, 0.001, 0.002], atol=1e-15)
    np.testing.assert_allclose(grid.table_2()[1][1, 4:], -rows[1, 4:])


def test_squareness_as_slope_of_a_straightness_table(three_axis):
    """50 µm/m over 0,3 m makes 15 µm: EXY gains -EC0Y (y - y_ref) (ISO/TR 16907, L-SQU)."""
    solution = only(three_axis, lambda e: str(e) == "EC0Y")
    k = solution.model.by_name["EC0Y", "location"].parameters.start
    theta = np.zeros(solution.model.n_parameters)
    theta[k] = 50e-6
    solution = replace(solution, parameters=theta)
    (table,) = error_tables(
        solution, select(["L-SQU"], solution.machine), base_of(solution, TOOL), Sampling(step=300.0)
    )
    assert table.function == "EXY"
    at = table.at(np.array([-150.0, 0.0, 150.0]), np.zeros(3))
    np.testing.assert_allclose(at, [0.0075, 0.0, -0.0075], atol=1e-12)
    assert np.ptp(at) == pytest.approx(0.015)


# ---------------------------------------------------------------------------------------------------------- sampling


def test_interpolation_error_falls_with_the_square_of_the_step():
    """f = a sin(2πx/λ): h² max|f''|/8 = a (π h/λ)²/2, to 1 % for h = λ/40."""
    x = np.linspace(0.0, 800.0, 16001)
    wave = 0.01 * np.sin(2 * np.pi * x / 400.0)[:, None]
    found = [interpolation_error(x, wave, np.linspace(0.0, 800.0, n))[0] for n in (81, 161)]
    assert found[0] == pytest.approx(0.01 * (np.pi * 10.0 / 400.0) ** 2 / 2, rel=0.01)
    assert found[0] / found[1] == pytest.approx(4.0, rel=0.01)


@pytest.mark.parametrize("spacing", ["equal", "free"])
def test_fewest_points_keep_the_bound_and_fewer_do_not(spacing):
    x = np.linspace(0.0, 1000.0, 1201)
    curve = np.where(x < 200.0, 0.02 * np.sin(2 * np.pi * x / 100.0), 1e-5 * (x - 200.0))[:, None]
    bound = 0.001
    nodes = choose_nodes("EXX", x, curve, Sampling(max_error=bound, spacing=spacing))
    assert interpolation_error(x, curve, nodes)[0] <= 1.001 * bound
    fewer = Sampling(max_error=bound, max_points=len(nodes) - 1, spacing=spacing)
    with pytest.raises(InputError, match=rf"EXX: {len(nodes)} points needed .* the limit of {len(nodes) - 1} leaves"):
        choose_nodes("EXX", x, curve, fewer)
    if spacing == "free":
        assert len(nodes) < 0.4 * len(choose_nodes("EXX", x, curve, Sampling(max_error=bound)))
        best = choose_nodes("EXX", x, curve, Sampling(max_points=len(nodes), spacing="free"))
        assert interpolation_error(x, curve, best)[0] <= 1.001 * interpolation_error(x, curve, nodes)[0]


def test_grid_interpolation_is_predicted_and_falls_with_the_square_of_the_step(three_axis):
    """Grids with 17 and 33 nodes per axis against the model itself at random points: within 20 % of the prediction at cell
    centres along the axes, and four times smaller for half the step."""
    base, found, predicted = base_of(three_axis, TOOL), [], []
    rng = np.random.default_rng(0)
    low, high = np.array([three_axis.machine.axis(a).travel for a in "XYZ"]).T
    order = [three_axis.machine.index(a) for a in "XYZ"]
    q = np.zeros((30000, 3))
    q[:, order] = low + rng.random((30000, 3)) * (high - low)
    exact = np.asarray(three_axis.deviation(q, np.array(TOOL)))[:, :3]
    for n in (17, 33):
        (grid,) = effect_grids(three_axis, TYPES["L-VOL"], base, points=n, uncertainty=False)
        off = np.abs(grid.interpolate(q[:, order])[:, :3] - exact)
        found.append(off.max())
        predicted.append(grid_interpolation(three_axis, GridRequest(TYPES["L-VOL"], base), grid))
    np.testing.assert_allclose(predicted, found, rtol=0.2)
    assert found[0] / found[1] == pytest.approx(4.0, rel=0.15)


def test_grid_sampling_by_error_and_tool_offset():
    """A bound on the interpolation: kept at random points; larger offsets of the tool need more nodes of the rotary axes."""
    _, solution = machine_and_solution("tilting table", seed=3)
    base = base_of(solution, TOOL)
    bound = 0.002
    linear = effect_grids(solution, TYPES["L-VOL"], base, Sampling(max_error=bound), uncertainty=False)[0]
    rng = np.random.default_rng(0)
    q = np.stack([rng.uniform(n[0], n[-1], 500) for n in linear.nodes], axis=1)
    full = np.zeros((500, len(solution.machine.axes)))
    full[:, [solution.machine.index(a) for a in linear.axes]] = q
    own = only(solution, lambda e: e.axis in "XYZS")
    exact = np.asarray(own.deviation(full, np.array(TOOL)))[:, :3]
    assert np.abs(linear.interpolate(q)[:, :3] - exact).max() < bound
    sizes = []
    for offset in (10.0, 1000.0):
        sampling = Sampling(max_error=bound, offset=offset)
        (grid,) = effect_grids(solution, TYPES["R-VOL"], base, sampling, uncertainty=False)
        sizes.append(len(grid.values))
    assert sizes[1] > 1.5 * sizes[0]


# ------------------------------------------------------------------------------------------------ rounding, increments


def test_incremental_rounding_does_not_add_up(three_axis, tmp_path):
    """A slope of 0.4 µm per row, least increment 1 µm: rounding each increment gives 0; on the running sum the end is right."""
    table = table_of(np.arange(101.0) * 10, -0.0004 * np.arange(101))
    form = TableForm(incremental=True, increment=0.001)
    _, values, loss = written_values(table, form)
    assert loss <= 0.0005 + 1e-12
    np.testing.assert_allclose(np.cumsum(values), 0.0004 * np.arange(101), atol=0.0005 + 1e-12)
    np.testing.assert_allclose(values / 0.001, np.round(values / 0.001), atol=1e-6)
    assert np.all(round_to(increments(0.0004 * np.arange(101)), 0.001) == 0.0)  # the naive way never moves
    path = written(table, three_axis, tmp_path / "t.csv", form)
    assert "# rows: incremental" in path.read_text(encoding="utf-8")
    np.testing.assert_allclose(read_table(path).forward, table.forward, atol=0.0005 + 1e-9)


# ------------------------------------------------------------------------------------------------------ superposition


def test_new_tables_on_top_of_old_ones_on_the_union_of_their_points():
    old = table_of([0, 100, 200], [0, 0.010, 0.004], [0.002, 0.012, 0.004])
    new = table_of([50, 150], [0.001, 0.003])
    (found, other) = add_tables([new], [old, table_of([0, 1], [0, 1], function="EYY")])
    assert other.function == "EYY"
    np.testing.assert_allclose(found.positions, [0, 50, 100, 150, 200])
    np.testing.assert_allclose(found.forward, [0.001, 0.006, 0.012, 0.010, 0.007])  # end values of the new one held
    np.testing.assert_allclose(found.reverse, [0.003, 0.008, 0.014, 0.011, 0.007])
    assert found.outside.tolist() == [True, False, False, False, True]
    assert any("sum of the existing compensation" in n for n in found.notes)
    with pytest.raises(InputError, match="two existing tables of EXX"):
        add_tables([new], [old, old])
    with pytest.raises(InputError, match="acts on the axis itself"):
        add_tables([new], [replace(old, applied="the axis itself")])


def test_compensated_machine_gets_the_sum(three_axis, tmp_path):
    """Old tables of half the errors are active; what remains is identified; the sum is the whole compensation again."""
    base = base_of(three_axis, TOOL)
    half = replace(three_axis, parameters=0.5 * np.asarray(three_axis.parameters))
    types = select(["L-POS", "L-STR", "L-SQU"], three_axis.machine)
    old = error_tables(half, types, base, Sampling(max_points=11))
    total = add_tables(error_tables(half, types, base, Sampling(max_points=9)), old)
    whole = {t.function: t for t in error_tables(three_axis, types, base, Sampling(max_points=801))}
    for table in total:
        low, high = table.positions[0], table.positions[-1]
        at = np.array([low, 0.5 * (low + high), high])  # nodes of both
        still = np.zeros(len(at))
        np.testing.assert_allclose(table.at(at, still), whole[table.function].at(at, still), atol=5e-6)


def test_grids_are_summed_at_the_new_tool_vector(three_axis):
    base = base_of(three_axis, TOOL)
    (old,) = effect_grids(three_axis, TYPES["L-VOL"], base, points=3, uncertainty=False)
    longer = base_of(three_axis, (0.0, 0.0, -250.0))
    (new,) = effect_grids(three_axis, TYPES["L-VOL"], longer, points=4, uncertainty=False)
    found = add_grid(new, old)
    assert [len(n) for n in found.nodes] == [5, 5, 5]  # 0, 1/3, 1/2, 2/3, 1
    moved = old.values.copy()
    moved[:, :3] += np.cross(moved[:, 3:], [0.0, 0.0, -100.0])
    expected = replace(old, values=moved).interpolate(found.positions) + new.interpolate(found.positions)
    np.testing.assert_allclose(found.values, expected, atol=1e-15)
    (turning,) = effect_grids(three_axis, TYPES["L-ANG"], base, points=3, uncertainty=False)
    with pytest.raises(InputError, match="applies a L-VOL grid otherwise"):
        add_grid(replace(turning, type="FOR"), old)


# ------------------------------------------------------------------------------------------------ record, wrong input


def test_every_file_carries_the_record(three_axis, tmp_path):
    """Clause 12: source, date, conditions, type, sign, units, datum, tool vector, limits, hash of the solution."""
    source = tmp_path / "solution.h5"
    source.write_bytes(b"a solution")
    made = compensate(three_axis, ["L-POS", "L-ANG"], base_of(three_axis, TOOL), points=3)
    save_compensation(made, three_axis, tmp_path / "out", source=source)
    files = sorted(p.name for p in (tmp_path / "out").iterdir())
    assert files == ["EXX.csv", "EYY.csv", "EZZ.csv", "grid.csv"]
    digest = hashlib.sha256(b"a solution").hexdigest()
    for name in files:
        text = (tmp_path / "out" / name).read_text(encoding="utf-8")
        for key in RECORD:
            assert f"# {key}: " in text, (name, key)
        assert f"# source sha256: {digest}" in text
    control = load_control(three_axis.machine, [tmp_path / "out"])
    assert (len(control.tables), len(control.grids)) == (3, 1)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("volid-table/1", "volid-table/9", "format is 'volid-table/9'; expected volid-table/1"),
        ("# values: compensation", "# values: both", "values is 'both'"),
        ("# rows: absolute", "# rows: sorted", "rows is 'sorted'"),
        ("# zero:", "# zzz:", "header 'zero' is missing"),
        ("\n50.0,", "\n-50.0,", "X is -50; expected positions that rise"),
        ("-0.001500000", "1,5", "cells; expected"),
        ("X,EXX(+)", "X,EXX(p)", "column 'EXX' is missing"),
    ],
)
def test_wrong_tables_are_named(three_axis, tmp_path, old, new, message):
    path = written(
        table_of([0, 50, 100], [0, 0.0015, 0.0019], [0.0008, 0.0022, 0.0025]), three_axis, tmp_path / "t.csv"
    )
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(InputError, match=re.escape(message)):
        read_table(path)


def test_a_grid_without_tool_vector_is_refused(three_axis, tmp_path):
    (grid,) = effect_grids(three_axis, TYPES["L-ANG"], base_of(three_axis, TOOL), points=3, uncertainty=False)
    save_grid(grid, three_axis, tmp_path / "g.csv")
    text = (tmp_path / "g.csv").read_text(encoding="utf-8")
    (tmp_path / "g.csv").write_text("\n".join(x for x in text.split("\n") if "tool vector:" not in x), encoding="utf-8")
    with pytest.raises(InputError, match="header 'tool vector' is missing"):
        read_grid(tmp_path / "g.csv")


def test_undetermined_functions_make_no_table(three_axis):
    column = np.zeros((three_axis.model.n_parameters, 1))
    column[three_axis.model.by_name["EYY", "mean"].parameters] = 1e-3
    lost = replace(three_axis, null_space=column, statements=("EYY: of a test.",))
    types = select(["L-POS"], lost.machine)
    with pytest.raises(NotDeterminedError, match=r"do not determine EYY on this line\. EYY: of a test"):
        error_tables(lost, types, base_of(lost, TOOL))


def test_bases_and_samplings_that_cannot_be(three_axis):
    with pytest.raises(InputError, match="`at=X=900` lies outside the travel; expected -400 … 400"):
        base_of(three_axis, TOOL, {"X": 900.0})
    with pytest.raises(InputError, match="`functions=EXQ`"):
        base_of(three_axis, TOOL, functions=["EXQ"])
    with pytest.raises(InputError, match="L-SPEC needs what it corrects"):
        compensate(three_axis, ["L-SPEC"], base_of(three_axis, TOOL))
    with pytest.raises(InputError, match="`step` stands alone"):
        Sampling(step=1.0, max_points=3)
    with pytest.raises(InputError, match="`incremental` goes with"):
        TableForm(incremental=True, reversal="difference")
    with pytest.raises(InputError, match="FOR has no tables"):
        error_tables(three_axis, [TYPES["FOR"]], base_of(three_axis, TOOL))
