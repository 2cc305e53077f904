"""A control that smooths its tables and grids, against numerical integrals and closed forms (ISO/TR 16907 9.2.2)."""

import numpy as np
import pytest
from support.drives import write_table
from support.machines import VERTICAL, volid_machine

from volid.compensation.control import Control
from volid.compensation.grids.grid import Grid, RotaryGrid
from volid.compensation.grids.interpolation import grid_positions
from volid.compensation.smoothing import smoothed, weights
from volid.exceptions import InputError
from volid.io.table_reader import read_table

MACHINE = volid_machine(VERTICAL)  # X', Y', Z
NODES = np.array([0.0, 10.0, 25.0, 40.0, 100.0])


@pytest.mark.parametrize("length", [7.0, 33.0, 260.0])
@pytest.mark.parametrize("period", [0.0, 100.0])
def test_a_smoothed_table_is_the_mean_of_its_lines_over_the_length(length, period):
    rng = np.random.default_rng(2)
    values, x = rng.normal(size=5), rng.uniform(-130.0, 230.0, 40)
    if period:
        values[-1] = values[0]
    fine = (np.arange(20_000) + 0.5) / 20_000 - 0.5  # midpoints: good to 1e-7 where a kink lies within
    at = x[:, None] + length * fine
    lines = np.interp(np.mod(at, period) if period else at, NODES, values)  # end values outside
    share = weights(NODES, x, length, period)
    np.testing.assert_allclose(share @ values, lines.mean(axis=1), rtol=0, atol=1e-6)
    np.testing.assert_allclose(share.sum(axis=1), 1.0, rtol=0, atol=1e-12)


def test_a_peak_loses_a_quarter_of_length_over_half_width():
    """A triangle of height h and half width w, averaged over L < 2 w about its peak: h (1 - L / 4 w). A straight part stays."""
    nodes, values = np.array([0.0, 50.0, 100.0, 200.0]), np.array([0.0, 0.008, 0.0, 0.0])
    found = weights(nodes, np.array([50.0, 25.0, 150.0]), 20.0) @ values
    np.testing.assert_allclose(found, [0.008 * (1 - 20 / 200), 0.004, 0.0], rtol=0, atol=1e-15)


def test_a_grid_is_averaged_over_each_of_its_axes():
    rng = np.random.default_rng(5)
    nodes = (np.array([0.0, 30.0, 100.0]), np.array([-50.0, 0.0, 20.0, 60.0]))
    table = rng.normal(size=(3, 4, 2))
    q, lengths = rng.uniform([-20.0, -80.0], [120.0, 90.0], (30, 2)), (25.0, 0.0)
    fine = (np.arange(2000) + 0.5) / 2000 - 0.5
    for lengths in ((25.0, 0.0), (25.0, 40.0)):
        expected = np.zeros((30, 2))
        for m, (x, y) in enumerate(q):
            along = np.array([np.interp(x + lengths[0] * fine, nodes[0], np.eye(3)[i]).mean() for i in range(3)])
            across = np.array([np.interp(y + lengths[1] * fine, nodes[1], np.eye(4)[j]).mean() for j in range(4)])
            expected[m] = np.einsum("i,j,ijc->c", along, across, table)
        found = smoothed(nodes, table, q, lengths, (0.0, 0.0))
        np.testing.assert_allclose(found, expected, rtol=0, atol=2e-6)


def test_a_control_drives_to_smoothed_positions(tmp_path):
    x = np.array([0.0, 380.0, 760.0])
    table = read_table(write_table(tmp_path, "EXX", x, [0.0, 0.010, 0.0]))
    q = np.array([[380.0, 100.0, -100.0], [100.0, 100.0, -100.0]])
    plain, smooth = (Control(MACHINE, (table,), smoothing=s).command(q, np.zeros(3)) - q for s in ({}, {"X": 76.0}))
    np.testing.assert_allclose(plain[:, 0], [-0.010, -0.010 * 100 / 380], rtol=0, atol=1e-12)
    np.testing.assert_allclose(smooth[:, 0], [-0.010 * (1 - 76 / (4 * 380)), -0.010 * 100 / 380], rtol=0, atol=1e-12)


def test_a_control_smooths_grids_over_the_axes_that_are_named():
    nodes = tuple(np.linspace(*VERTICAL.travel[a], n) for a, n in (("X", 3), ("Y", 3), ("Z", 2)))
    positions = grid_positions(nodes)
    values = np.zeros((18, 6))
    values[:, 0] = 0.010 * (positions[:, 0] == 380.0)  # a ridge along Y and Z
    values[:, 1] = 0.006 * (positions[:, 1] == 215.0)
    grid = Grid(
        "L-VOL", ("X", "Y", "Z"), nodes, positions, values, values, values[:, 0] > 1, (0.0, 0.0, 0.0), "machine", ""
    )
    q = np.array([[380.0, 215.0, -100.0]])
    found = Control(MACHINE, grids=(grid,), smoothing={"X": 76.0}).command(q, np.zeros(3)) - q
    np.testing.assert_allclose(found, [[-0.010 * (1 - 76 / 1520), -0.006, 0.0]], rtol=0, atol=1e-12)


def test_a_rotary_grid_that_closes_the_circle_is_smoothed_across_its_ends():
    c = np.array([0.0, 90.0, 180.0, 270.0, 360.0])
    values = np.zeros((5, 6))
    values[[0, -1], 0] = 0.012
    known = np.ones((5, 6), dtype=bool)
    grid = RotaryGrid(
        type="R-VOL", axes=("C",), nodes=(c,), positions=c[:, None], values=values, u=values, outside=~known[:, 0],
        side="table", determined=known, reference_point=(0.0, 0.0, 0.0), period=(360.0,), frame="machine", datum="",
    )  # fmt: skip
    found = grid.clamped(np.array([[0.0], [360.0], [720.0], [45.0]]), (36.0,))[:, 0]
    np.testing.assert_allclose(found, [0.012 * (1 - 36 / 360)] * 3 + [0.006], rtol=0, atol=1e-12)


def test_blank_nodes_stop_a_control_where_they_count_and_nowhere_else():
    x = np.array([0.0, 380.0, 760.0])
    values = np.zeros((3, 6))
    values[2, :3] = np.nan
    grid = Grid("L-VOL", ("X",), (x,), x[:, None], values, values, x > 1e4, (0.0, 0.0, 0.0), "machine", "")
    for smoothing in ({}, {"X": 20.0}):
        control = Control(MACHINE, grids=(grid,), smoothing=smoothing)
        assert np.isfinite(control.command(np.array([[300.0, 0.0, 0.0]]), np.zeros(3))).all()
        with pytest.raises(InputError, match="the L-VOL grid is blank at X = 500, so that it does not say where to go"):
            control.command(np.array([[500.0, 0.0, 0.0]]), np.zeros(3))


def test_wrong_lengths_are_named():
    for smoothing, message in (({"X": -5.0}, "smoothing=X"), ({"Q": 5.0}, "has no axis Q")):
        with pytest.raises(InputError, match=message):
            Control(MACHINE, smoothing=smoothing)
