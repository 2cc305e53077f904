"""Redundancy numbers, detectable errors and error ellipsoids against their definitions, written separately, and GNU Gama."""

import json

import numpy as np
import pytest
from scipy.stats import chi2, ncx2, norm
from support.places import LITERATURE

from volid.multilateration import adjust_network
from volid.multilateration.reliability import NON_CENTRALITY, confidence_scale

GAMA = json.loads((LITERATURE / "free_network_gama.json").read_text(encoding="utf-8"))
TEXTBOOK = json.loads((LITERATURE / "textbook_networks.json").read_text(encoding="utf-8"))
NAMES = [name for name in TEXTBOOK if "all" not in name]


def solve(case):
    points = list(case["approximate"])
    observations = [tuple(row) for row in case["observations"]]
    dimension = len(case["approximate"][points[0]])
    return adjust_network(points, case["fixed"], observations, case["sigma"], case["approximate"], dimension)


def design(solution):
    """Derivative of the distances by the unknown coordinates: direction cosines, row by row."""
    points, d = list(solution.points), solution.coordinates.shape[1]
    columns = {(name, k): c for c, (name, k) in enumerate((n, k) for n in solution.unknown for k in range(d))}
    matrix = np.zeros((len(solution.observations), len(columns)))
    for row, (a, b, _) in enumerate(solution.observations):
        beam = solution.coordinates[points.index(b)] - solution.coordinates[points.index(a)]
        for k in range(d):
            for name, sign in ((b, 1), (a, -1)):
                if (name, k) in columns:
                    matrix[row, columns[name, k]] = sign * beam[k] / np.sqrt(beam @ beam)
    return matrix


@pytest.mark.parametrize("name", NAMES)
def test_redundancy_numbers_are_the_diagonal_of_the_projector(name):
    solution = solve(TEXTBOOK[name])
    a = design(solution) / solution.u[:, None]
    projector = np.eye(len(a)) - a @ np.linalg.pinv(a, rcond=1e-9)
    np.testing.assert_allclose(solution.reliability.redundancy, np.diag(projector), atol=1e-9)
    assert solution.reliability.redundancy.sum() == pytest.approx(solution.degrees_of_freedom, abs=1e-9)


def test_non_centrality_gives_the_power_that_is_stated():
    critical = chi2.ppf(0.999, 1)
    assert ncx2.sf(critical, 1, NON_CENTRALITY) == pytest.approx(0.8, abs=1e-6)
    assert abs(NON_CENTRALITY - 17.07) < 0.006


@pytest.mark.parametrize("name", ["StrangBorre1997_2D_free", "Hoepke1980_2D_free"])
def test_detectable_error_is_found_four_times_of_five(name):
    """An error of that size moves the mean of the normalised residual to √17.07 = 4.13; and it moves points as stated.

    A thousandth of it is added, so that the network answers linearly.
    """
    case, solution = TEXTBOOK[name], solve(TEXTBOOK[name])
    for i in (0, 3):
        size = solution.reliability.detectable[i]
        rows = [list(row) for row in case["observations"]]
        rows[i][2] += size / 1000
        approximate = dict(zip(solution.points, solution.coordinates, strict=True))
        wrong = adjust_network(solution.points, case["fixed"], [tuple(r) for r in rows], case["sigma"], approximate, 2)
        mean = 1000 * (wrong.normalised_residuals - solution.normalised_residuals)[i]
        assert norm.sf(norm.ppf(0.9995) - mean) + norm.cdf(-norm.ppf(0.9995) - mean) == pytest.approx(0.8, abs=1e-3)
        shift = 1000 * np.linalg.norm(wrong.coordinates - solution.coordinates, axis=1)
        assert shift.max() == pytest.approx(solution.reliability.influence[i], rel=1e-3)
        assert shift.argmax() == solution.reliability.influenced[i]


def test_reading_that_nothing_checks_has_no_detectable_error():
    corners = {"A": (0, 0), "B": (6, 0), "P": (3, 3)}
    found = adjust_network("ABP", "AB", [("A", "P", 5.0), ("B", "P", 5.0)], 0.01, corners, 2).reliability
    assert found.redundancy.tolist() == [0.0, 0.0] and found.influenced.tolist() == [-1, -1]
    assert np.isnan(found.detectable).all() and np.isnan(found.influence).all()


def test_blunder_left_out_has_no_redundancy_number():
    case = TEXTBOOK["BlankenbachWillert2009_3D_all"]
    rows = [tuple(row) for row in case["observations"]]
    solution = adjust_network(
        list(case["approximate"]), case["fixed"], rows, case["sigma"], case["approximate"], robust=True
    )
    assert np.flatnonzero(np.isnan(solution.reliability.redundancy)).tolist() == list(solution.blunders)
    assert np.nansum(solution.reliability.redundancy) == pytest.approx(solution.degrees_of_freedom, abs=1e-9)


def test_ellipsoids_are_those_of_the_covariance_of_gnu_gama():
    solution = adjust_network(GAMA["names"], [], GAMA["observations"], GAMA["sigma_m"], GAMA["approximate"])
    size = len(GAMA["names"]) * 3
    upper = np.zeros((size, size))
    upper[np.triu_indices(size)] = GAMA["covariance_upper"]
    covariance = (upper + np.triu(upper, 1).T) * 1e-6  # mm² to m²
    for j in range(len(GAMA["names"])):
        block = covariance[3 * j : 3 * j + 3, 3 * j : 3 * j + 3]
        axes, directions = solution.ellipsoids.axes[j], solution.ellipsoids.directions[j]
        np.testing.assert_allclose(axes, np.sqrt(np.linalg.eigvalsh(block)[::-1]), rtol=3e-4)  # Gama prints 4 digits
        np.testing.assert_allclose(directions @ directions.T, np.eye(3), atol=1e-12)
        np.testing.assert_allclose((directions.T * axes**2) @ directions, block, atol=3e-4 * block.max())


def test_ellipse_of_two_distances_by_closed_form():
    """Lines from A and B meet in P at right angles: a circle of radius u; at 60°, semi-axes u/√(1 ± cos 60°)."""
    places = {"A": (-3.0, 0.0), "B": (0.0, -4.0), "P": (0.0, 0.0)}
    found = adjust_network("ABP", "AB", [("A", "P", 3.0), ("B", "P", 4.0)], 0.01, places, 2).ellipsoids
    np.testing.assert_allclose(found.axes[2], [0.01, 0.01], rtol=1e-9)
    angle = np.pi / 6
    places = {"A": (-np.cos(angle), -np.sin(angle)), "B": (np.cos(angle), -np.sin(angle)), "P": (0.0, 0.0)}
    places = {"A": places["A"], "B": (-places["A"][0], places["A"][1]), "P": (0.0, 0.0)}
    found = adjust_network("ABP", "AB", [("A", "P", 1.0), ("B", "P", 1.0)], 0.01, places, 2).ellipsoids
    # JᵀJ u² = Σ e eᵀ = diag(2 cos² 30°, 2 sin² 30°)
    np.testing.assert_allclose(found.axes[2], [0.01 / np.sqrt(0.5), 0.01 / np.sqrt(1.5)], rtol=1e-9)
    np.testing.assert_allclose(np.abs(found.directions[2]), [[0, 1], [1, 0]], atol=1e-9)
    assert found.axes[0].tolist() == [0, 0]


def test_scale_holds_95_percent():
    rng = np.random.default_rng(1)
    for d, printed in ((2, 2.4477), (3, 2.7955)):
        assert confidence_scale(d) == pytest.approx(printed, abs=5e-5)
        inside = np.linalg.norm(rng.normal(size=(100_000, d)), axis=1) < confidence_scale(d)
        assert inside.mean() == pytest.approx(0.95, abs=0.003)  # 4 standard deviations


def test_direction_that_is_not_determined_is_the_blank_axis():
    """Q hangs on one distance, obliquely: along the circle nothing is known, towards A everything."""
    places = {"A": (0, 0), "B": (4, 0), "P": (2, 3), "Q": (3.0, 4.0)}
    rows = [("A", "P", 3.6056), ("B", "P", 3.6056), ("A", "Q", 5.0)]
    found = adjust_network("ABPQ", "AB", rows, 0.001, places, 2).ellipsoids
    assert np.isnan(found.axes[3, 0]) and found.axes[3, 1] == pytest.approx(0.001, rel=1e-9)
    np.testing.assert_allclose(np.abs(found.directions[3]), [[0.8, 0.6], [0.6, 0.8]], atol=1e-9)
