"""What the geometry of the readings says: the measured range, and what is determined whatever lies between the positions."""

from dataclasses import replace

import numpy as np
import pytest
from exact_chain import default_tools
from support.machines import STRUCTURES, VERTICAL, exact_machine
from support.rtests import NO_LINEAR, rotary_truth, rtest
from support.trackers import simulated

from volid.fitting.fit import fit
from volid.fitting.smoothness.geometry import measured_machine, range_notes
from volid.fitting.smoothness.spreading import spread_out


def at_positions(campaign, **columns):
    """The campaign with other positions of some axes, in turn from a list."""
    (s,) = campaign.sets
    q = s.positions.copy()
    for letter, values in columns.items():
        q[:, campaign.machine.index(letter)] = np.resize(values, len(q))
    return replace(campaign, sets=(replace(s, positions=q),))


@pytest.fixture(scope="module")
def campaign():
    return simulated(VERTICAL, 3, n_per_station=60)[0]


@pytest.mark.parametrize(
    ("positions", "travel"),
    [
        ([0.0, 400.0, 760.0], (0.0, 760.0)),
        ([5.0, 400.0, 755.0], (0.0, 760.0)),  # as near to its ends as that measures them
        ([100.0, 400.0, 600.0], (100.0, 600.0)),
        ([300.0], (0.0, 760.0)),  # an axis that stood still: nothing of it is determined
    ],
)
def test_travels_are_cut_to_what_was_measured(campaign, positions, travel):
    assert measured_machine(at_positions(campaign, X=positions)).axis("X").travel == travel


def test_a_reference_outside_moves_to_the_nearest_end_and_is_said(campaign):
    moved = measured_machine(at_positions(campaign, X=[500.0, 600.0, 760.0]))
    assert moved.axis("X").reference == 500.0
    part, note = range_notes(campaign.machine, moved)
    assert part.endswith("X 500 … 760 of 0 … 760 mm")
    assert "axis X at 380 mm lies outside the measured range 500 … 760 mm; functions are zero at 500 mm" in note


def test_the_range_of_an_earlier_solution_counts(campaign):
    earlier = {"X": (0.0, 300.0)}
    later = at_positions(campaign, X=[200.0, 500.0])
    assert measured_machine(later, earlier).axis("X").travel == (0.0, 500.0)


@pytest.mark.parametrize(
    ("angles", "travel"),
    [
        (np.arange(-180.0, 180.0, 30.0), (-180.0, 180.0)),  # all around: a turn
        (np.arange(0.0, 360.0, 90.0) - 180.0, (-180.0, 180.0)),
        (np.linspace(-90.0, 90.0, 13), (-90.0, 90.0)),  # half a turn has no period
    ],
)
def test_a_rotary_axis_keeps_its_turn_where_it_was_measured_around(angles, travel):
    exact = exact_machine(STRUCTURES["tilting table C'A'"])
    found = rtest(exact, rotary_truth(exact), n=(7, 5))
    assert measured_machine(at_positions(found, C=angles)).axis("C").travel == travel


def test_positions_move_between_their_neighbours_only(campaign):
    levels = at_positions(campaign, X=[0.0, 100.0, 760.0])
    found = spread_out(levels, 100)
    before, after = (c.sets[0].positions[:, c.machine.index("X")] for c in (levels, found))
    for level, (low, high) in {0.0: (0.0, 50.0), 100.0: (50.0, 430.0), 760.0: (430.0, 760.0)}.items():
        own = after[before == level]
        assert own.min() >= low and own.max() <= high and np.ptp(own) > 0.5 * (high - low)
    np.testing.assert_array_equal(found.sets[0].tool, levels.sets[0].tool)


def facts(solution):
    """What is said of what is determined."""
    return solution.statements, solution.undetermined.keys(), solution.held_tool_rotation


@pytest.mark.parametrize("tools", [default_tools(), default_tools()[:1]], ids=["three tools", "one tool"])
def test_what_is_determined_does_not_depend_on_how_large_u_is(tools):
    """u of every reading times 1, 10, 100, 1000: the same words, nothing blank that was given, u in proportion at most."""
    campaign = simulated(VERTICAL, 4, n_per_station=150, tools=tools)[0]
    q = np.array([[380.0, 215.0, -230.0], [700.0, 20.0, -30.0], [10.0, 400.0, -400.0]])
    found = []
    for factor in (1.0, 10.0, 100.0, 1000.0):
        sets = tuple(replace(s, u=factor * s.u) for s in campaign.sets)
        solution = fit(replace(campaign, sets=sets))
        found.append((facts(solution), solution.evaluate(q, tools[0]), solution))
    first = found[0]
    for factor, (said, values, solution) in zip((10.0, 100.0, 1000.0), found[1:], strict=True):
        assert said == first[0]
        np.testing.assert_array_equal(values.determined, first[1].determined)
        known = values.determined
        ratio = values.u[known] / first[1].u[known]
        assert np.all(ratio > 1.0) and np.all(ratio < 1.05 * factor)
        for name in ("EC0Y", "EA0Z", "EB0Z"):
            before, now = first[2].location(name).u, solution.location(name).u
            assert np.isnan(now) if np.isnan(before) else now < 1.05 * factor * before


def test_deviation_and_evaluate_are_one_field_for_all_tool_vectors():
    """A fork head, three tool vectors: what is open is held at 0 once, so that values agree wherever one is given."""
    exact = exact_machine(STRUCTURES["fork head CB"])
    solution = fit(rtest(exact, rotary_truth(exact), n=(7, 9), extra=NO_LINEAR))
    rng = np.random.default_rng(2)
    low, high = np.array([a.travel for a in solution.machine.axes]).T
    q = low + rng.random((60, 5)) * (high - low)
    tools = np.unique(solution.campaign.sets[0].tool, axis=0)[np.arange(60) % 3]
    found = solution.evaluate(q, tools)
    own = np.asarray(solution.deviation(q, tools))
    assert found.determined[:, :3].all()
    np.testing.assert_allclose(
        np.where(found.determined, own, 0.0), np.where(found.determined, found.values, 0.0), atol=1e-12
    )
