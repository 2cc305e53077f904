"""A travel of which half was measured: functions, lines and squareness are those of that half, and said to be."""

import json
from pathlib import Path

import h5py
import numpy as np
import pytest
from exact_chain.measured_range import truth_of_range
from exact_chain.truth import Truth
from scipy.interpolate import CubicSpline

import volid
from volid.cli import main

CASE = Path(__file__).parent / "30_half_of_a_travel"
RANGES = {"X": (0.0, 1000.0), "Y": (0.0, 300.0), "Z": (-500.0, 0.0)}
REFERENCE = {"X": 500.0, "Y": 300.0, "Z": -250.0}  # mid-travel; that of Y is the end of what was measured
FAR = 4.5  # u: of some 130 values, one in a thousand such sets of numbers has a larger one by chance


def stored_truth() -> Truth:
    """The truth beside the campaign, by its tables, read without the package."""
    with h5py.File(CASE / "truth.h5") as file:
        tables = {n: (t["positions"][:], t["values"][:]) for n, t in file["functions"].items()}
        names = [n.decode() for n in file["constants/name"][:]]
        constants = dict(zip(names, file["constants/value"][:].tolist(), strict=True))
    return Truth({name: CubicSpline(*table) for name, table in tables.items()}, constants)


@pytest.fixture(scope="module")
def solution():
    return volid.fit(volid.load_campaign(CASE / "campaign.h5"))


@pytest.fixture(scope="module")
def solution_file(solution, tmp_path_factory):
    path = tmp_path_factory.mktemp("half") / "s.h5"
    solution.save(path)
    return path


def test_functions_and_squareness_are_those_of_the_half(solution):
    functions, squareness = truth_of_range(stored_truth(), RANGES, REFERENCE)
    off = []
    for name, true in functions.items():
        rows = solution.motion(name, np.linspace(*RANGES[name[2]], 7))
        off += [(row.value - true(row.position)) / row.u for row in rows if row.u > 1e-9]  # u = 0 at the reference
    for name, true in squareness.items():
        found = solution.location(name)
        off.append((found.value - true) / found.u)
    assert len(off) > 100
    assert np.abs(off).max() < FAR
    assert 0.5 < np.sqrt(np.mean(np.square(off))) < 1.4  # neither wrong nor far too large a u


def test_the_truth_over_the_whole_travel_is_another_one():
    """What the half says is not what the whole travel says, so that the test above can tell them apart: 49 µrad in EA0Z."""
    _, half = truth_of_range(stored_truth(), RANGES, REFERENCE)
    _, whole = truth_of_range(stored_truth(), RANGES | {"Y": (0.0, 600.0)}, REFERENCE)
    assert abs(half["EA0Z"] - whole["EA0Z"]) > 5e-6


def test_it_is_said_to_be_of_the_half(solution, solution_file, capsys):
    assert main(["summary", str(solution_file)]) == 0
    text = " ".join(capsys.readouterr().out.split())
    assert "Y 0 … 600 mm (measured 0 … 300)" in text
    assert "refer to the measured part of the travel, and compare only with such: Y 0 … 300 of 0 … 600 mm" in text


def test_the_table_of_functions_ends_with_the_half(solution_file, capsys):
    assert main(["functions", str(solution_file), "--step", "50", "--json"]) == 0
    table = json.loads(capsys.readouterr().out)
    at = [row[table["columns"].index("position")] for row in table["rows"] if row[0] == "EYY"]
    assert at == [0.0, 50.0, 100.0, 150.0, 200.0, 250.0, 300.0]
    assert "Y 0 … 300 mm" in table["header"]["measured"]


def test_beyond_the_half_nothing_is_stated(solution):
    found = solution.evaluate([[450.0, 500.0, -250.0], [150.0, 500.0, -250.0]], [0.0, 0.0, -150.0])  # Y, X, Z
    assert np.isnan(found.values[0]).all()
    assert np.isfinite(found.values[1]).all()
