"""What commands say of what they were asked: options repeated by axis, references outside the measured range."""

import json

import numpy as np
import pytest

from volid.io.grid_reader import read_grid
from volid.io.solutions import read_solution

GRID = ("--points", "3", "--tool", "0,0,-150")


def test_a_repeated_range_adds_to_the_first(solution_file, run, tmp_path):
    def axes(name, *ranges):
        status, _, err = run("grid", solution_file, *GRID, *ranges, "-o", tmp_path / name)
        assert status == 0, err
        grid = read_grid(tmp_path / name)
        return {a: nodes.tolist() for a, nodes in zip(grid.axes, grid.nodes, strict=True)}

    listed = axes("one.csv", "--range", "X=100:500,Y=0:300")
    assert axes("two.csv", "--range", "X=100:500", "--range", "Y=0:300") == listed
    assert listed["X"] == [100.0, 300.0, 500.0] and listed["Y"] == [0.0, 150.0, 300.0]


@pytest.mark.parametrize(
    ("options", "option"),
    [
        (["--range", "X=0:500", "--range", "X=0:400"], "--range"),
        (["--range", "X=0:500,X=0:400"], "--range"),
        (["--at", "X=1", "--at", "Y=2,X=3"], "--at"),
        (["--zero", "X=1,X=3"], "--zero"),
    ],
)
def test_an_axis_given_twice_is_refused(solution_file, run, tmp_path, options, option):
    status, _, err = run("grid", solution_file, *GRID, *options, "-o", tmp_path / "g.csv")
    assert status == 2 and f"argument {option}: X is given twice; expected every axis once" in err
    assert not (tmp_path / "g.csv").exists()


def test_a_reference_outside_the_measured_range_is_moved_and_said(solution, solution_file, run, tmp_path):
    said = "the reference of X at 5000 lies outside the measured range 0 … 1000; functions are zero at 1000"
    status, text, err = run("datum", solution_file, "--to", "reference_X=5000", "-o", tmp_path / "far.h5")
    assert status == 0, err
    assert f"note: datum: {said}" in text
    status, text, _ = run("datum", solution_file, "--to", "reference_X=1000", "-o", tmp_path / "end.h5")
    assert status == 0 and "note" not in text
    far, end = read_solution(tmp_path / "far.h5"), read_solution(tmp_path / "end.h5")
    np.testing.assert_array_equal(far.parameters, end.parameters)
    exx = [r.value for r in far.motion("EXX", np.array([1000.0, 500.0]))]
    assert abs(exx[0]) < 1e-12 < abs(exx[1])
    assert any(said in note for note in far.notes)
    status, text, _ = run("datum", solution_file, "--to", "reference_Y=-1", "-o", tmp_path / "y.h5", "--json")
    assert "the reference of Y at -1 lies outside" in json.loads(text)["notes"][0]


def test_compensation_in_another_datum_says_it_too(solution_file, run, tmp_path):
    words = ("grid", solution_file, *GRID, "-o", tmp_path / "g.csv")
    status, text, err = run(*words, "--datum", "reference_X=5000")
    assert status == 0, err
    assert "note: datum: the reference of X at 5000 lies outside the measured range" in text
    assert "the reference of X at 5000 lies outside the measured range" in (tmp_path / "g.csv").read_text()
    assert "reference of X" not in run(*words, "--datum", "reference_X=200", "--force")[1]
