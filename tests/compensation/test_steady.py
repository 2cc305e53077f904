"""Steady values: within the tube, at multiples, with as few turns as any; axes that only help."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

import volid
from volid.compensation.helping_axes import helping_axes, helping_words
from volid.compensation.steady import steadied, turns_of
from volid.compensation.tables.axis_table import AxisTable, Factor

MACHINE = volid.load_machine("models/wYXbZt_vertical.toml")
TOOL = np.array([0.0, 0.0, -150.0])


def best_by_trying_all(values, most):
    """The smallest loss over all sequences of whole numbers with at most so many turns."""
    levels = range(int(np.floor(values.min())), int(np.ceil(values.max())) + 1)
    sequences = (np.array(s, dtype=float) for s in itertools.product(levels, repeat=len(values)))
    return min(np.abs(s - values).max() for s in sequences if turns_of(s) <= most)


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("most", [0, 1, 2])
def test_no_other_sequence_is_nearer(seed, most):
    values = np.random.default_rng(seed).uniform(-2.0, 2.0, 6)
    found = steadied(values, 1.0, most)
    assert found.turns == turns_of(found.values) <= most
    np.testing.assert_array_equal(found.values, np.round(found.values))
    assert found.loss == pytest.approx(np.abs(found.values - values).max())
    assert found.loss <= best_by_trying_all(values, most) + 1e-6


def test_steady_multiples_stay_what_they_are():
    values = 0.001 * np.array([0, 1, 3, 3, 7, 8])
    found = steadied(values, 0.001, 0)
    np.testing.assert_allclose(found.values, values, atol=1e-15)


def test_a_helping_axis_turns_as_often_as_its_table():
    """X follows Y up, down, up; the shortest run is the last one, 0.3 µm, which whole micrometres do not show."""
    y = np.array([0.0, 150.0, 300.0, 450.0, 600.0])
    e = np.array([0.0, 0.004, 0.001, 0.003, 0.0027])
    control = volid.Control(MACHINE, axis_tables=(AxisTable("X", "Y", y, e, e),))
    (one,) = helping_axes(control, TOOL, increment={"X": 0.001}, reversal={"X": 0.003})
    assert (one.moving, one.helping, one.turns, one.reversal) == ("Y", "X", 2, 0.003)  # in whole µm: 0 4 1 3 3
    assert one.largest == pytest.approx(0.004) and one.smallest == pytest.approx(0.0003) and one.too_small
    assert "turns 2 times; each turn loses its own reversal of 3.00 µm" in helping_words(MACHINE, one)
    (exact,) = helping_axes(control, TOOL)
    assert exact.turns == 3 and not exact.too_small


def test_a_product_is_looked_at_in_the_corners():
    """Y moves Z by 20 µrad times the lever arm of Z: 10 µm at the far corner, where Z = -500 mm."""
    y, z = np.array([0.0, 600.0]), np.array([-500.0, 0.0])
    table = AxisTable("X", "Y", y, np.array([0.0, 20e-6]), np.array([0.0, 20e-6]), Factor("Z", z, z))
    found = helping_axes(volid.Control(MACHINE, axis_tables=(table,)), TOOL)
    assert {(h.moving, h.helping): round(1e3 * h.largest, 6) for h in found} == {("Y", "X"): 10.0, ("Z", "X"): 10.0}


def test_a_grid_that_bends_between_middle_and_corners_is_seen():
    """Y goes ±4 µm from node to node of X along Y = 150 alone, which is neither in the middle nor at a corner: 19 turns."""
    x, y, z = np.linspace(0.0, 1000.0, 21), np.linspace(0.0, 600.0, 9), np.array([-500.0, 0.0])
    places = np.array([(a, b, c) for c in z for b in y for a in x])
    values = np.zeros((len(places), 6))
    along = places[:, 1] == 150.0
    values[along, 1] = 0.004 * np.cos(np.pi * places[along, 0] / 50.0)
    given = ("L-VOL", ("X", "Y", "Z"), (x, y, z), places, values, values, along, tuple(TOOL), "machine", "")
    found = {(h.moving, h.helping): h for h in helping_axes(volid.Control(MACHINE, grids=(volid.Grid(*given),)), TOOL)}
    assert found["X", "Y"].turns == 19
    assert found["X", "Y"].largest == pytest.approx(0.008)


def test_a_table_over_a_turn_is_seen_in_every_turn():
    """X goes ±3 µm from one to the next of 180 positions of a turn: 4 turns of C have 720 runs of 6 µm, and 719 turns of X."""
    trunnion = volid.load_machine("models/wCAYXbZt_trunnion.toml")
    axes = tuple(replace(a, travel=(-720.0, 720.0)) if a.letter == "C" else a for a in trunnion.axes)
    c = np.arange(0.0, 361.0, 2.0)
    e = 0.003 * np.cos(np.pi * c / 2.0)
    control = volid.Control(replace(trunnion, axes=axes), axis_tables=(AxisTable("X", "C", c, e, e, period=360.0),))
    (found,) = helping_axes(control, TOOL)
    assert (found.moving, found.helping, found.turns) == ("C", "X", 719)
    assert found.smallest == pytest.approx(0.006)
