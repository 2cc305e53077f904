"""What one or two stations, or tools on the spindle axis alone, leave open: exit status, blanks and refusals of the commands."""

import csv

import numpy as np
import pytest
from exact_chain import ExactMachine, default_stations, gauge_free
from support.small_campaign import TRAVEL, make_campaign

from volid.io.grid_reader import read_grid
from volid.io.solutions import read_solution

STATIONS = default_stations(ExactMachine("w Y' X' b Z (C) t", TRAVEL))
ON_AXIS = [(0.0, 0.0, -150.0), (0.0, 0.0, -250.0), (0.0, 0.0, -80.0)]
# name: what was measured, functions that cannot be known (a subset), and the reason in words
CASES = {
    "one station": (
        {"stations": {"S1": STATIONS["S1"]}, "n_per_station": 200},
        {"EXY", "EYY", "EZY"},
        "distances from one station only; at least three are needed",
    ),
    "two stations": (
        {"stations": {name: STATIONS[name] for name in ("S1", "S2")}, "n_per_station": 150},
        {"EXY", "EYY", "EZY"},
        "distances from two stations only; at least three are needed",
    ),
    "spindle axis": (
        {"tools": ON_AXIS},
        {"ECZ"},
        "every tool vector lies on the spindle axis; add one with a lateral offset",
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_what_is_not_determined_is_named_blank_and_status_1(name, run, tmp_path):
    options, lost, reason = CASES[name]
    virtual = make_campaign(tmp_path / "c", **options)
    path, table = tmp_path / "s.h5", tmp_path / "f.csv"
    status, text, err = run("fit", virtual.manifest, "-o", path)
    assert status == 1
    assert text.startswith("Model accepted by the data, but not everything is determined (n.d.); see below.")
    assert reason in " ".join(text.split())
    assert "attention: the data do not determine" in err
    solution = read_solution(path)
    assert lost <= set(solution.undetermined)

    status, _, err = run("functions", path, "-o", table)
    assert status == 1 and "left blank" in err
    with table.open(encoding="utf-8") as stream:
        rows = list(csv.DictReader(line for line in stream if not line.startswith("#")))
    blank = {row["function"] for row in rows if row["value"] == ""}
    assert lost <= blank and blank != {row["function"] for row in rows}
    assert all((row["value"] == "") == (row["u"] == "") for row in rows), "no value without u, no u without value"

    status, text, err = run("grid", path, "--points", "4", "--tool", "0,0,-150", "-o", tmp_path / "g.csv")
    assert status == 1
    if name == "spindle axis":
        _grid_is_right_within_its_u(virtual, read_grid(tmp_path / "g.csv"))
        return
    assert (text, (tmp_path / "g.csv").exists()) == ("", False)
    assert "do not determine dX, dY, dZ for tool vector (0, 0, -150) mm" in err
    assert reason in err and err.endswith("Measure what is missing.\n"), err


def _grid_is_right_within_its_u(virtual, grid):
    """Translations at the measured tool against the exact chain, rigid motion removed: at most 4.5 u at 64 nodes."""
    order = [grid.axes.index(a) for a in virtual.machine.axes]
    q, tool = grid.positions[:, order], np.broadcast_to(grid.tool, (len(grid.positions), 3))
    difference = grid.values[:, :3] - virtual.machine.deviation(q, tool, virtual.truth)[:, :3]
    difference, _ = gauge_free(difference, q, tool, machine=virtual.machine)
    assert np.abs(difference / grid.u[:, :3]).max() < 4.5
    assert 0.3 < np.sqrt(np.mean((difference / grid.u[:, :3]) ** 2)) < 1.5
