"""Equal steps for tables with any positions, and sums of tables."""

import numpy as np
import pytest

from volid.compensation.on_top import summed
from volid.compensation.tables.axis_table import AxisTable, Factor
from volid.controllers.tables.equal_steps import Lattice, lattice_of, loss, on, widened


def table(x, up, down=None, **more) -> AxisTable:
    up = np.array(up, dtype=float)
    return AxisTable(
        "X", "X", np.array(x, dtype=float), up, up if down is None else np.array(down, dtype=float), **more
    )


@pytest.mark.parametrize("seed", range(8))
def test_positions_on_a_common_step_stay_and_their_values_with_them(seed):
    rng = np.random.default_rng(seed)
    step = round(rng.uniform(0.5, 60.0), 3)
    x = round(rng.uniform(-900, 900), 2) + step * np.sort(rng.choice(60, 12, replace=False))
    one = table(x, rng.normal(scale=0.01, size=len(x)))
    lattice = lattice_of(x)
    assert all(np.abs(lattice.positions - v).min() < 1e-6 for v in x)
    assert loss(one, lattice) < 1e-9
    assert np.allclose(np.diff(lattice.positions), lattice.step)


def test_positions_without_a_common_step_keep_their_range_and_say_what_is_lost():
    x = [0.0, 1.0, np.pi, 10.0]
    lattice = lattice_of(np.array(x))
    assert (lattice.low, lattice.high, lattice.count) == (0.0, 10.0, 16)
    assert 0.0 < loss(table(x, [0.0, 0.01, -0.01, 0.0]), lattice) < 0.01


def test_a_limit_makes_steps_longer_but_never_fewer_than_the_points_given():
    x = np.array([0.0, 1.0, 1000.0])
    assert lattice_of(x).count == 1001 and lattice_of(x, 100).count == 12
    assert lattice_of(np.arange(300.0), 200).count == 300


def test_one_position_becomes_two_with_the_same_value():
    one = on(table([5.0], [0.002]), lattice_of(np.array([5.0])))
    assert one.positions.tolist() == [5.0, 6.0] and one.forward.tolist() == [0.002, 0.002]


def test_a_widened_lattice_covers_the_travel_in_the_same_steps():
    found = widened(Lattice(10.0, 90.0, 9), (-5.0, 100.0))
    assert (found.low, found.high, found.count) == (-10.0, 100.0, 12)
    assert widened(Lattice(0.0, 90.0, 10), (0.0, 90.0)) == Lattice(0.0, 90.0, 10)


def test_the_sum_of_tables_is_the_sum_of_what_they_say_beyond_their_ends_too():
    a, b = table([0, 10], [0.0, 0.01], [0.002, 0.012]), table([5, 20], [0.001, -0.004])
    (found,) = summed([a, b], say=False)
    x, up, down = np.linspace(-3, 25, 57), np.ones(57), -np.ones(57)
    for way in (up, down):
        np.testing.assert_allclose(found.of_argument(x, way), a.of_argument(x, way) + b.of_argument(x, way), atol=1e-15)


def test_tables_of_other_pairs_and_other_factors_are_not_added():
    lever = Factor("Z", np.array([0.0, 1.0]), np.array([0.0, 1.0]))
    again = Factor("Z", np.array([0.0, 1.0]), np.array([0.0, 1.0]))
    other = Factor("Z", np.array([0.0, 1.0]), np.array([1.0, 2.0]))
    tables = [table([0, 1], [1e-5, 2e-5], factor=f) for f in (None, lever, again, other)]
    found = summed(tables, say=False)
    assert [t.forward[0] for t in found] == [1e-5, 2e-5, 1e-5]
