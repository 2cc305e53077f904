"""Distance networks against solutions by others (tests/literature/README.md), and against their own laws."""

import json

import numpy as np
import pytest
from support.places import LITERATURE

from volid.exceptions import InputError
from volid.multilateration import adjust_network, starting_coordinates

GAMA = json.loads((LITERATURE / "free_network_gama.json").read_text(encoding="utf-8"))
TEXTBOOK = json.loads((LITERATURE / "textbook_networks.json").read_text(encoding="utf-8"))
BLUNDERS = "BlankenbachWillert2009_3D_all"


def solve(case, **options):
    """Adjust one of the textbook networks."""
    points = list(case["approximate"])
    dimension = len(case["approximate"][points[0]])
    observations = [tuple(row) for row in case["observations"]]
    return adjust_network(points, case["fixed"], observations, case["sigma"], case["approximate"], dimension, **options)


def solve_gama(approximate=GAMA["approximate"], fixed=(), observations=GAMA["observations"], **options):
    """Adjust the network that GNU Gama solved."""
    return adjust_network(GAMA["names"], fixed, observations, GAMA["sigma_m"], approximate, **options)


def test_free_network_is_that_of_gnu_gama():
    solution = solve_gama()
    # Gama prints nanometres and 4 digits of the covariance; an independent solution differed by 1.8 nm and 7.7e-5
    np.testing.assert_allclose(solution.coordinates, GAMA["adjusted"], rtol=0, atol=5e-9)
    size = len(GAMA["names"]) * 3
    upper = np.zeros((size, size))
    upper[np.triu_indices(size)] = GAMA["covariance_upper"]
    covariance = (upper + np.triu(upper, 1).T) * 1e-6  # mm² to m²
    assert np.abs(solution.covariance - covariance).max() < 2e-4 * covariance.max()
    np.testing.assert_allclose(np.diag(solution.covariance), np.diag(covariance), rtol=2e-4)
    assert (solution.rank, solution.defect, solution.datum_defect, solution.degrees_of_freedom) == (114, 6, 6, 30)
    assert solution.undetermined == ()


@pytest.mark.parametrize("name", TEXTBOOK)
def test_textbook_network(name):
    case, solution = TEXTBOOK[name], solve(TEXTBOOK[name])
    published = case["solution"]
    # solved by another program to all its digits; 0.9 nm is found. Standard deviations are a posteriori: u times unit weight.
    u = solution.standard_uncertainty * solution.unit_weight
    for point, coordinates in published["coords"].items():
        np.testing.assert_allclose(solution.position(point), coordinates, rtol=0, atol=5e-9)
        np.testing.assert_allclose(u[solution.points.index(point)], published["std"][point], rtol=1e-6)
    assert list(solution.unknown) == published["order"]
    covariance = solution.covariance * solution.unit_weight**2
    np.testing.assert_allclose(covariance, published["cov"], rtol=0, atol=1e-6 * np.max(published["cov"]))
    np.testing.assert_allclose(solution.residuals, published["residuals"], rtol=0, atol=1e-6)
    found = solution.rank, solution.defect, solution.degrees_of_freedom
    assert found == (published["rank"], published["defect"], published["dof"])
    assert solution.unit_weight * case["sigma"] == pytest.approx(published["sigma0_post"], rel=1e-6)


def test_robust_fit_names_exactly_the_two_blunders():
    solution = solve(TEXTBOOK[BLUNDERS], robust=True)
    assert [solution.observations[i][1] for i in solution.blunders] == ["51", "103"]
    # published to 0.1 mm
    np.testing.assert_allclose(solution.position("MS"), [-2.5078, 24.3202, 9.7753], rtol=0, atol=1e-4)
    without = TEXTBOOK["BlankenbachWillert2009_3D_blunders_removed"]["solution"]
    np.testing.assert_allclose(solution.position("MS"), without["coords"]["MS"], rtol=0, atol=1e-9)
    assert solution.degrees_of_freedom == without["dof"]
    assert solution.suspects == ()


def test_plain_fit_suspects_the_blunders():
    solution = solve(TEXTBOOK[BLUNDERS])
    assert solution.blunders == ()
    assert solution.suspects == (0,)  # the larger masks the smaller
    assert solution.chi_square_probability < 1e-9


@pytest.mark.parametrize("name", [name for name in TEXTBOOK if name != BLUNDERS])
def test_robust_fit_leaves_good_readings_alone(name):
    # Höpcke's stated u is five times too small: that is no blunder
    plain, robust = solve(TEXTBOOK[name]), solve(TEXTBOOK[name], robust=True)
    assert robust.blunders == ()
    np.testing.assert_allclose(
        robust.coordinates, plain.coordinates, rtol=0, atol=1e-12 * np.abs(plain.coordinates).max()
    )


def simulated(stations, targets, seed, u=5e-4):
    """Stations around a cubic metre of targets, all distances, mm; true coordinates."""
    rng = np.random.default_rng(seed)
    x = np.vstack([rng.uniform(-1000, 2000, (stations, 3)), rng.uniform(0, 1000, (targets, 3))])
    names = [f"S{i}" for i in range(stations)] + [f"T{j}" for j in range(targets)]
    observations = [
        (names[i], names[j], float(np.linalg.norm(x[i] - x[j]) + u * rng.normal()))
        for i in range(stations)
        for j in range(stations, stations + targets)
    ]
    return names, x, observations


@pytest.mark.parametrize("seed", [0, *(pytest.param(s, marks=pytest.mark.slow) for s in range(1, 5))])
def test_six_blunders_among_160_distances_are_found(seed):
    names, x, observations = simulated(8, 20, seed)
    rng = np.random.default_rng(100 + seed)
    bad = sorted(rng.choice(len(observations), 6, replace=False).tolist())
    for i in bad:
        start, end, distance = observations[i]
        observations[i] = (start, end, distance + rng.choice([-1, 1]) * 10 ** rng.uniform(-1.5, 1))  # 60 u and more
    solution = adjust_network(names, [], observations, 5e-4, x + rng.normal(size=x.shape), robust=True)
    assert list(solution.blunders) == bad
    assert 0.7 < solution.unit_weight < 1.3  # 76 degrees of freedom: 1 +- 0.08, at 3.5 standard deviations


def test_blunder_that_cannot_be_told_apart_is_named_with_its_doubles():
    """With four stations each target has one redundant distance: a blunder in any of its four looks nearly the same."""
    observations = [list(row) for row in GAMA["observations"]]
    observations[29][2] += 1e-4
    solution = solve_gama(observations=observations, robust=True)
    (found,) = solution.blunders
    assert 29 in {found, *solution.inseparable[found]}
    assert {observations[i][1] for i in (found, *solution.inseparable[found])} == {observations[29][1]}


def test_coordinates_stay_as_near_to_the_approximate_ones_as_the_distances_allow():
    rng = np.random.default_rng(1)
    approximate = np.array(GAMA["approximate"]) + 0.02 * rng.normal(size=(40, 3))
    solution = solve_gama(approximate)
    # inner constraints say: no shift and no rotation against the approximate coordinates
    correction = solution.coordinates - approximate
    centred = solution.coordinates - solution.coordinates.mean(axis=0)
    assert np.abs(correction.sum(axis=0)).max() < 1e-12
    assert np.abs(np.cross(centred, correction).sum(axis=0)).max() < 1e-12
    # and the shape is that of any other datum
    np.testing.assert_allclose(gaps(solution.coordinates), gaps(np.array(GAMA["adjusted"])), rtol=0, atol=5e-9)


def gaps(x):
    """All distances between points."""
    return np.linalg.norm(x[:, None] - x, axis=2)


def test_unit_of_length_does_not_matter():
    in_m = solve_gama()
    observations = [(a, b, 1000 * d) for a, b, d in GAMA["observations"]]
    in_mm = adjust_network(
        GAMA["names"], [], observations, 1000 * GAMA["sigma_m"], 1000 * np.array(GAMA["approximate"])
    )
    np.testing.assert_allclose(in_mm.coordinates, 1000 * in_m.coordinates, rtol=0, atol=1e-9)
    np.testing.assert_allclose(in_mm.covariance, 1e6 * in_m.covariance, rtol=0, atol=1e-9 * in_mm.covariance.max())


def test_covariance_is_the_spread_of_repeated_fits():
    names, x, observations = simulated(5, 8, 0, u=0.0)
    rng = np.random.default_rng(2)
    trials = []
    for _ in range(300):
        noisy = [(a, b, d + 0.01 * rng.normal()) for a, b, d in observations]
        trials.append((adjust_network(names, [], noisy, 0.01, x).coordinates - x).ravel())
    stated = np.sqrt(np.diag(adjust_network(names, [], observations, 0.01, x).covariance))
    ratio = np.sqrt((np.array(trials) ** 2).mean(axis=0)) / stated
    assert ratio.min() > 0.84 and ratio.max() < 1.16  # standard deviation of one: 1 / sqrt(600) = 0.041; 3.9 of 39


@pytest.mark.parametrize(("fixed", "defect"), [(["S1"], 3), (["S1", "S2"], 1), (["S1", "S2", "S3"], 0)])
def test_fixed_points_take_the_datum_defect_away(fixed, defect):
    solution = solve_gama(GAMA["adjusted"], fixed)
    assert (solution.defect, solution.datum_defect, solution.undetermined) == (defect, defect, ())
    for name in fixed:
        assert solution.position(name).tolist() == GAMA["adjusted"][GAMA["names"].index(name)]
        assert (solution.standard_uncertainty[solution.points.index(name)] == 0).all()


def test_point_seen_by_two_stations_only_is_named():
    observations = [row for row in GAMA["observations"] if row[1] != "T05" or row[0] in ("S1", "S2")]
    solution = solve_gama(observations=observations)
    assert (solution.defect, solution.datum_defect, solution.undetermined) == (7, 6, ("T05",))


def test_single_readings_have_no_normalised_residual():
    observations = [("A", "P", 5.0), ("B", "P", 5.0)]
    solution = adjust_network("ABP", "AB", observations, 0.01, {"A": (0, 0), "B": (6, 0), "P": (3, 3)}, 2)
    np.testing.assert_allclose(solution.position("P"), [3, 4], atol=1e-12)
    assert np.isnan(solution.normalised_residuals).all()
    assert solution.degrees_of_freedom == 0
    assert np.isnan(solution.unit_weight)


def test_starts_come_from_the_distances_alone():
    known = {name: GAMA["adjusted"][i] for i, name in enumerate(GAMA["names"][:4])}
    chained = starting_coordinates(GAMA["names"], GAMA["observations"], GAMA["sigma_m"], known)
    np.testing.assert_allclose(list(chained.values()), GAMA["adjusted"], rtol=0, atol=1e-6)
    unfolded = starting_coordinates(GAMA["names"], GAMA["observations"], GAMA["sigma_m"])
    solution = solve_gama(unfolded)
    assert solution.unit_weight == pytest.approx(solve_gama().unit_weight, rel=1e-6)
    np.testing.assert_allclose(gaps(solution.coordinates), gaps(np.array(GAMA["adjusted"])), rtol=0, atol=5e-9)


def test_starts_of_a_plane_network_without_stations():
    case = TEXTBOOK["StrangBorre1997_2D_free"]
    start = starting_coordinates(list(case["approximate"]), case["observations"], case["sigma"], None, 2)
    solution = adjust_network(list(start), [], case["observations"], case["sigma"], start, 2)
    assert solution.unit_weight * case["sigma"] == pytest.approx(case["solution"]["sigma0_post"], rel=1e-4)


def test_start_on_either_side_of_a_plane_is_refused():
    case = TEXTBOOK["Wolf1979_3D_fix"]
    known = {name: case["approximate"][name] for name in case["fixed"]}
    with pytest.raises(InputError, match=r"point P has two possible positions.*lie in one plane"):
        starting_coordinates(list(case["approximate"]), case["observations"], case["sigma"], known)


def test_impossible_input_is_named():
    corners = {"A": (0, 0), "B": (6, 0), "P": (3, 3)}
    with pytest.raises(InputError, match=r"observation 1 \(A to C, 5\): expected two different names"):
        adjust_network("ABP", "AB", [("A", "C", 5.0)], 0.1, corners, 2)
    with pytest.raises(InputError, match=r"distance -5, u 0\.1; expected both finite and above 0"):
        adjust_network("ABP", "AB", [("A", "P", -5.0)], 0.1, corners, 2)
    with pytest.raises(InputError, match="no approximate coordinates for C; expected 2 numbers"):
        adjust_network("ABPC", "AB", [("A", "P", 5.0)], 0.1, corners, 2)
    with pytest.raises(InputError, match="all points are fixed"):
        adjust_network("AB", "AB", [("A", "B", 5.0)], 0.1, corners, 2)
