"""`volid locations` and `volid grid --type R-VOL`: files that agree with the exact chain's lines and deviations."""

import json
from dataclasses import replace

import numpy as np
import pytest
from exact_chain import apply
from support.machines import STRUCTURES, exact_machine, resolved
from support.made_up import made_up, truth_of

import volid
from volid.cli import main
from volid.fitting.results import Residuals, Statistics
from volid.io.basics.csv_table import read_csv

TILTING, SPLIT = STRUCTURES["tilting table C'A'"], STRUCTURES["table and head"]


def saved(structure, path, functions=""):
    """A made-up solution in a file, and its exact machine."""
    exact = exact_machine(structure)
    solution = made_up(resolved(exact, functions, segments=4), seed=6)
    still = tuple(np.zeros_like(s.readings) for s in solution.campaign.sets)
    solution = replace(
        solution,
        readings=Residuals(still, still, tuple(s != 0 for s in still)),
        statistics=Statistics(6, 0, {"ends": 0.0}, 1, True),
    )
    volid.save_solution(solution, path)
    return exact, solution


@pytest.fixture(scope="module")
def tilting(tmp_path_factory):
    path = tmp_path_factory.mktemp("locations") / "S.h5"
    return path, *saved(TILTING, path)


def rows_of(path):
    table = read_csv(path)
    return [dict(zip(table.columns, cells, strict=True)) for cells in zip(*table.columns.values(), strict=True)]


def test_parameter_and_axis_line_with_u_in_the_machine_frame(tilting, tmp_path, capsys):
    path, _exact, solution = tilting
    assert main(["locations", str(path), "-o", str(tmp_path / "L.csv")]) == 0
    assert "8 location errors written" in capsys.readouterr().out
    rows = {r["location_error"]: r for r in rows_of(tmp_path / "L.csv")}
    assert set(rows) == {"EX0C", "EY0C", "EA0C", "EB0C", "EY0A", "EZ0A", "EB0A", "EC0A"}
    for name, row in rows.items():
        assert float(row["axis_line"]) == -float(row["parameter"])  # a table: the line moves the other way
        assert row["relative_to"] == "machine" and float(row["u"]) > 0
        if name[3] == "A":  # next to the bed: its own parameter
            assert float(row["parameter"]) == pytest.approx(volid.location_parameter(solution, name).value, rel=1e-12)
            assert float(row["u"]) == pytest.approx(solution.location(name).u, rel=1e-9)
    # EA0C in the machine frame: the parameter of C and the zero of A, which is 0 by the datum
    tilt = {n: volid.location_parameter(solution, n).value for n in ("EA0C", "EB0C", "EB0A")}
    assert float(rows["EB0C"]["parameter"]) == pytest.approx(tilt["EB0C"] + tilt["EB0A"], rel=1e-12)
    text = (tmp_path / "L.csv").read_text()
    assert text.startswith("# values: location errors") and "# datum: " in text


def test_relative_to_another_axis_and_as_json(tilting, capsys):
    path, _exact, solution = tilting
    assert main(["locations", str(path), "--relative-to", "A", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    rows = {row[0]: dict(zip(found["columns"], row, strict=True)) for row in found["rows"]}
    assert set(rows) == {"EX(0A)C", "EY(0A)C", "EA(0A)C", "EB(0A)C"}
    for symbol, row in rows.items():
        own = volid.location_parameter(solution, f"{symbol[:2]}0C")
        assert (row["parameter"], row["u"]) == pytest.approx((own.value, own.u), rel=1e-9)
        assert ("refers to its zero" in row["remark"]) == (symbol[1] in "XA")
    assert volid.location_errors(solution, "A")[0].symbol == "EX(0A)C"


def test_what_cannot_be_asked_is_named(tilting, tmp_path, capsys):
    path, *_ = tilting
    assert main(["locations", str(path), "--relative-to", "X"]) == 2
    assert "relative_to = 'X' is a linear axis" in capsys.readouterr().err
    saved(SPLIT, tmp_path / "split.h5")
    assert main(["locations", str(tmp_path / "split.h5"), "--relative-to", "C"]) == 2
    assert "stand on two sides" in capsys.readouterr().err
    saved("w Y' X' b Z t", tmp_path / "linear.h5")
    assert main(["locations", str(tmp_path / "linear.h5")]) == 2
    assert "has no rotary axis" in capsys.readouterr().err


# ------------------------------------------------------------------------------------------------------------ R-VOL


def exact_table(exact, truth, q, point) -> np.ndarray:
    """Error (m, 3) of a tool at `point` of the table, tool side and linear axes perfect, machine frame, by exact matrices."""
    actual = apply(exact.pose(q, truth), point)
    return np.einsum("mji,mj->mi", exact.table_rotation(q), actual - apply(exact.nominal_pose(q), point))


def test_a_rotary_grid_is_written_and_says_what_the_chain_does(tilting, tmp_path, capsys):
    path, exact, solution = tilting
    out = tmp_path / "rotary.csv"
    arguments = [
        "grid",
        str(path),
        "--type",
        "R-VOL",
        "--points",
        "5",
        "--reference-point",
        "10,-20,30",
        "-o",
        str(out),
    ]
    assert main([*arguments, "--errors"]) == 0
    assert str(out) in capsys.readouterr().out
    text = out.read_text()
    assert "# type: R-VOL" in text and "# reference point: 10, -20, 30" in text
    rows = rows_of(out)
    assert len(rows) == 25 and {"A", "C", "dX", "dY", "dZ", "dA", "dB", "dC", "u_dX", "u_dC"} <= set(rows[0])
    angles = {a: [float(r[a]) for r in rows] for a in "AC"}
    q = exact.in_axis_order(angles | {"X": 0.0, "Y": 0.0, "Z": 0.0})
    truth = truth_of(solution)
    rotary = type(truth)({n: f for n, f in truth.functions.items() if n[2] in "AC"},
                         {n: v for n, v in truth.constants.items() if n[3] in "AC"})  # fmt: skip
    written = np.array([[float(r[c]) for c in ("dX", "dY", "dZ")] for r in rows])
    true = exact_table(exact, rotary, q, np.array([10.0, -20.0, 30.0]))
    assert np.abs(written - true).max() < 1e-5 < 0.005 < np.abs(true).max()  # products of two errors
    assert main([*arguments, "--force"]) == 0  # compensation values unless asked for errors
    again = np.array([[float(r[c]) for c in ("dX", "dY", "dZ")] for r in rows_of(out)])
    np.testing.assert_allclose(again, -written, atol=1e-9)


def test_a_split_machine_gets_one_file_per_side_and_reads_back(tmp_path):
    _, solution = saved(SPLIT, tmp_path / "S.h5")
    assert (
        main(["grid", str(tmp_path / "S.h5"), "--type", "R-VOL", "--points", "4", "-o", str(tmp_path / "R.csv")]) == 0
    )
    assert not (tmp_path / "R.csv").exists()
    expected = {g.side: g for g in volid.rotary_grids(solution, points=4)}
    for side, axis in (("table", "C"), ("head", "B")):
        grid = volid.load_grid(tmp_path / f"R.{side}.csv")
        assert grid.side == side and grid.axes == (axis,)
        np.testing.assert_allclose(grid.values, expected[side].values, atol=2e-9)  # mm; degrees keep 1e-12
