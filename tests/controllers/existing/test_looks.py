"""What looks odd in existing tables: a wrong digit is found, and what tables usually are is not called odd."""

from dataclasses import replace

import numpy as np
import pytest
from support.control_cases import MACHINE, spatial

from volid.compensation.package import Compensation
from volid.compensation.tables.axis_table import AxisTable
from volid.controllers.existing.looks import beyond, oddities
from volid.controllers.existing.reading import ExistingCompensation

X = np.linspace(0.0, 1000.0, 21)


def existing(up, down=None, x=X, argument="X"):
    up = np.asarray(up, dtype=float)
    table = AxisTable("X", argument, np.asarray(x, dtype=float), up, up if down is None else np.asarray(down))
    return ExistingCompensation("linuxcnc", MACHINE, Compensation((), (), (), (table,)), {"x.comp": b""})


def smooth(rng):
    """A curve of 20 µm with waves, its points read with 0.5 µm of noise."""
    phase = rng.uniform(0, 2 * np.pi, 3)
    waves = [
        a * np.sin(k * np.pi * X / 1000 + p) for a, k, p in zip((0.02, 0.004, 0.002), (1, 3, 5), phase, strict=True)
    ]
    return sum(waves) + rng.normal(0.0, 0.0005, len(X))


def test_usual_tables_are_not_odd():
    rng = np.random.default_rng(0)
    said = [oddities(existing(smooth(rng), smooth(rng))) for _ in range(300)]
    assert sum(map(bool, said)) <= 3  # 1 %


def test_a_wrong_digit_is_found():
    """±100 µm at a random place that is no end: 04 for 14 in the second decimal place."""
    rng = np.random.default_rng(1)
    found = 0
    for _ in range(100):
        values, i = smooth(rng), int(rng.integers(1, len(X) - 1))
        values[i] += rng.choice([-0.1, 0.1])
        said = [t for t in oddities(existing(values)) if f"the value at {X[i]:g} stands" in t]
        found += bool(said)
    assert found == 100


def test_a_bend_is_no_wrong_digit():
    """A table by hand: flat to mid-travel, then 40 µm/m."""
    assert oddities(existing(np.maximum(0.0, 4e-5 * (X - 500.0)))) == []


def test_positions_out_of_step_do_not_matter():
    x = np.array([0.0, 100.0, 130.0, 400.0, 420.0, 800.0, 1000.0])
    assert oddities(existing(2e-5 * x, x=x)) == []
    (said,) = oddities(existing(2e-5 * x + [0, 0, 0, 0.02, 0, 0, 0], x=x))
    assert "the value at 400 stands +20.0 µm off" in said


def test_steep_and_empty_tables_are_named():
    (said,) = oddities(existing([0.0, 0.0, 0.9], x=[0.0, 500.0, 1000.0]))
    assert "between 500 and 1000 the value changes by 1800 µm/m" in said
    (said,) = oddities(existing([0.0, 0.0, 0.0], x=[0.0, 500.0, 1000.0]))
    assert said == "X over X: all values are 0, the table does nothing"


def test_what_is_beyond_tables_and_grids_is_said():
    assert beyond(existing([0.0, 0.01], x=[100.0, 900.0])) == [
        "X over X: X travels from 0 to 1000; below 100 and above 900 the end value is held"
    ]
    assert beyond(ExistingCompensation("linuxcnc", MACHINE, spatial(), {})) == []


@pytest.mark.parametrize("size", [1.5, -1.5])
def test_values_of_millimetres_are_no_deviations(size):
    found = replace(existing([0.0, size], x=[0.0, 1000.0]))
    (said,) = oddities(found)
    assert "values up to 1.5 mm are no deviations of a machine" in said
