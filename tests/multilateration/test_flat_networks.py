"""Flat, nearly flat, symmetric, unconnected networks: the lowest minimum, what is determined of it, and both sides by name."""

import numpy as np
import pytest

from benchmarks.networks import KINDS, verdict
from volid.multilateration import adjust_network, network_trials, starting_coordinates

NETWORKS = 120


@pytest.mark.slow
@pytest.mark.parametrize("kind", range(len(KINDS)), ids=[kind.__name__ for kind in KINDS])
def test_lowest_minimum_is_that_of_scipy_from_many_starts(kind):
    """A share of those that `python -m benchmarks.networks` tries."""
    seeds = range(5000 + kind, 5000 + kind + NETWORKS, len(KINDS))
    said = {seed: verdict(KINDS[kind](np.random.default_rng(seed)), seed) for seed in seeds}
    assert {seed: words for seed, words in said.items() if words != "right"} == {}


@pytest.mark.parametrize("kind", range(len(KINDS)), ids=[kind.__name__ for kind in KINDS])
def test_lowest_minimum_of_one_network_of_each_kind(kind):
    assert verdict(KINDS[kind](np.random.default_rng(9000 + kind)), 9000) == "right"


def distances(x, names, pairs, u=0.0, seed=0):
    rng = np.random.default_rng(seed)
    return [(names[a], names[b], float(np.linalg.norm(x[a] - x[b]) + u * rng.normal())) for a, b in pairs]


def everything(count):
    return [(a, b) for a in range(count) for b in range(a + 1, count)]


def turned(x, seed):
    """A rotation and shift of the places."""
    rng = np.random.default_rng(seed)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return x @ turn + rng.normal(size=3) * 100, turn


FLAT = np.array([[0, 0, 0], [900, 0, 0], [950, 700, 0], [0, 800, 0], [420, 350, 0], [200, 610, 0.0]])


@pytest.mark.parametrize("start", ["given", "from the distances"])
def test_flat_free_network_is_solved_with_what_is_determined(start):
    rows = distances(FLAT, "ABCDEF", everything(6))
    approximate = FLAT if start == "given" else starting_coordinates("ABCDEF", rows, 0.01)
    solution = adjust_network("ABCDEF", "", rows, 0.01, approximate)
    plane = adjust_network("ABCDEF", "", rows, 0.01, FLAT[:, :2], 2)
    gaps = [np.linalg.norm(s.coordinates[:, None] - s.coordinates, axis=2) for s in (solution, plane)]
    assert np.abs(gaps[0] - gaps[1]).max() < 1e-5  # a thousandth of u
    assert solution.undetermined == tuple("ABCDEF") == solution.second_order
    assert solution.datum_defect == 6
    if start == "given":
        assert solution.not_determined.tolist() == [[False, False, True]] * 6


def test_only_the_direction_across_the_plane_is_lost_when_it_is_turned():
    """Station plane at an angle: x, y and z all contain the height, the ellipsoid has it alone."""
    x, turn = turned(FLAT, 5)
    rows = distances(x, "ABCDEF", [(a, 5) for a in range(5)])
    start = x.copy()
    start[5] += turn[2] * 3.0
    solution = adjust_network("ABCDEF", "ABCDE", rows, 0.01, start)
    np.testing.assert_allclose(solution.coordinates[5], x[5], atol=1e-6)
    assert solution.not_determined[5].all() and solution.second_order == ("F",)
    axes, directions = solution.ellipsoids.axes[5], solution.ellipsoids.directions[5]
    assert np.isnan(axes[0]) and (axes[1:] > 0.003).all() and (axes[1:] < 0.02).all()
    assert abs(directions[0] @ turn[2]) == pytest.approx(1.0, abs=1e-9)


def test_height_below_its_own_u_is_not_determined_and_above_twice_it_is():
    """First order: u = u_d ρ/(h √n), all ρ equal: 4 stations at 1000 mm, u_d 0.02: u of h = 3.16 is 3.16."""
    corners = {"A": (1000, 0, 0), "B": (-1000, 0, 0), "C": (0, 1000, 0), "D": (0, -1000, 0)}
    for height, lost in ((2.5, True), (6.5, False)):
        rows = [(name, "P", float(np.hypot(1000, height))) for name in corners]
        solution = adjust_network("ABCDP", "ABCD", rows, 0.02, corners | {"P": (0, 0, height)})
        np.testing.assert_allclose(solution.position("P"), [0, 0, height], atol=1e-6)
        assert solution.not_determined[4].tolist() == [False, False, lost]
        if not lost:
            assert solution.standard_uncertainty[4, 2] == pytest.approx(
                0.02 * np.hypot(1000, height) / height / 2, rel=1e-9
            )


def test_start_off_the_plane_decides_and_the_other_side_is_named():
    rows = distances(np.vstack([FLAT[:4], [[300, 400, -250]]]), "ABCDP", [(a, 4) for a in range(4)])
    places = dict(zip("ABCD", FLAT[:4], strict=True))
    for start, decided in ((-200.0, True), (-2.0, False)):
        solution = adjust_network("ABCDP", "ABCD", rows, 0.01, places | {"P": (310, 390, start)})
        np.testing.assert_allclose(solution.position("P"), [300, 400, -250], atol=1e-9)
        (other,) = solution.alternatives
        assert other.points == ("P",) and other.decided == decided
        np.testing.assert_allclose(other.coordinates, [[300, 400, 250]], atol=1e-9)
        assert other.worse == pytest.approx(0.0, abs=1e-9)


def test_points_that_hang_together_have_their_second_solution_together():
    x = np.vstack([FLAT[:4], [[300, 400, 250], [600, 300, 180], [500, 600, 320]]])
    rows = distances(x, "ABCDPQR", [(a, b) for a in range(4) for b in range(4, 7)] + [(4, 5), (5, 6)])
    solution = adjust_network("ABCDPQR", "ABCD", rows, 0.01, x)
    together = [one for one in solution.alternatives if len(one.points) == 3]
    np.testing.assert_allclose(together[0].coordinates, x[4:] * [1, 1, -1], atol=1e-6)


def test_without_approximate_coordinates_neither_side_is_refused():
    rows = distances(np.vstack([FLAT[:4], [[300, 400, 250]]]), "ABCDP", [(a, 4) for a in range(4)])
    known = dict(zip("ABCD", FLAT[:4], strict=True))
    found = starting_coordinates("ABCDP", rows, 0.01, known, either_side=True)["P"]
    np.testing.assert_allclose(np.abs(found), [300, 400, 250], atol=1e-6)
    solution = adjust_network("ABCDP", "ABCD", rows, 0.01, known | {"P": found}, guessed=("P",))
    assert [one.decided for one in solution.alternatives] == [False]


def test_parts_without_a_common_point_are_named():
    x = np.vstack([FLAT[:4, :2], FLAT[:3, :2] + 5000])
    rows = distances(x, "ABCDEFG", [*everything(4), (4, 5), (5, 6), (4, 6)])
    assert adjust_network("ABCDEFG", "", rows, 0.01, x, 2).parts == (tuple("ABCD"), tuple("EFG"))
    floating = adjust_network("ABCDEFG", "AB", rows, 0.01, x, 2)
    assert floating.parts == (tuple("ABCD"), tuple("EFG"))
    assert floating.undetermined == tuple("EFG") and not floating.not_determined[:4].any()
    assert adjust_network("ABCDEFG", "ABEF", rows[:-3] + rows[-3:], 0.01, x, 2).parts == ()


def test_hinge_is_not_a_part_of_its_own():
    x = np.vstack([FLAT[:4, :2], [[1500, 300], [1500, 900]]])
    rows = distances(x, "ABCDEF", [*everything(4), (2, 4), (2, 5), (4, 5)])
    solution = adjust_network("ABCDEF", "AB", rows, 0.01, x, 2)
    assert solution.parts == () and solution.undetermined == ("E", "F")
    assert solution.defect - solution.datum_defect == 1


def test_well_determined_points_of_a_free_network_keep_their_u():
    """T in a free network hangs on two distances in space: only its coordinates are blank."""
    rng = np.random.default_rng(4)
    x = rng.uniform(0, 1000, (9, 3))
    rows = distances(x, "ABCDEFGHT", [*everything(8), (0, 8), (1, 8)], 0.01)
    solution = adjust_network("ABCDEFGHT", "", rows, 0.01, x)
    assert solution.undetermined == ("T",) and solution.second_order == ()
    assert not solution.not_determined[:8].any() and solution.not_determined[8].all()


def test_trials_of_a_point_in_the_plane_have_both_signs_and_half_of_them_zero():
    corners = {"A": (1000, 0, 0), "B": (-1000, 0, 0), "C": (0, 1000, 0), "D": (0, -1000, 0)}
    rows = [(name, "P", 1000.0) for name in corners]
    solution = adjust_network("ABCDP", "ABCD", rows, 0.02, corners | {"P": (0, 0, 0.5)})
    height = network_trials(solution, 4000, seed=2).coordinates[:, 4, 2]
    # all ρ equal: h² = mean of ρ² - 1000² up to terms of u², its standard deviation 2 · 1000 · 0.02/√4
    noise = 20.0 * np.random.default_rng(0).normal(size=400_000)
    expected = np.sqrt(np.maximum(noise, 0)) * np.sign(np.random.default_rng(1).normal(size=noise.size))
    assert (np.abs(height) < 0.3).mean() == pytest.approx((np.abs(expected) < 0.3).mean(), abs=0.03)
    for p in (0.025, 0.1, 0.9, 0.975):
        assert np.quantile(height, p) == pytest.approx(np.quantile(expected, p), abs=0.3)  # 4 standard deviations


def test_coordinates_that_only_the_frame_holds_have_no_u():
    """Two points and their distance: along it half of its u each, across it nothing."""
    solution = adjust_network("AB", "", [("A", "B", 3.0)], 0.01, {"A": (0, 0, 0), "B": (2, 0, 0)})
    np.testing.assert_allclose(solution.coordinates, [[-0.5, 0, 0], [2.5, 0, 0]], atol=1e-12)
    assert solution.not_determined.tolist() == [[False, True, True]] * 2
    np.testing.assert_allclose(solution.standard_uncertainty[:, 0], 0.005, rtol=1e-9)
    assert solution.second_order == () and solution.alternatives == ()


def test_all_points_in_one_place_is_a_start_too():
    corners = {"A": (0, 0), "B": (6, 0), "C": (0, 6), "P": (0, 0)}
    rows = [("A", "P", 5.0), ("B", "P", 5.0), ("C", "P", float(np.hypot(3, 2)))]
    solution = adjust_network("ABCP", "ABC", rows, 0.01, corners, 2)
    np.testing.assert_allclose(solution.position("P"), [3, 4], atol=1e-9)
    single = adjust_network("AP", "A", [("A", "P", 5.0), ("A", "P", 5.0)], 0.01, {"A": (0, 0), "P": (0, 0)}, 2)
    assert np.linalg.norm(single.position("P")) == pytest.approx(5.0, abs=1e-9)
