"""Relative distances: one unknown offset per point and segment, against an adjustment written separately."""

import re

import numpy as np
import pytest
from scipy.optimize import least_squares

from volid.cli import main
from volid.exceptions import InputError
from volid.multilateration import adjust_network, network_trials, starting_coordinates

U = 0.002
RNG = np.random.default_rng(7)
STATIONS = RNG.uniform(-1500, 2500, (4, 3))
TARGETS = RNG.uniform(0, 1000, (14, 3))
PLACES = np.vstack([STATIONS, TARGETS])
NAMES = tuple(f"S{i}" for i in range(4)) + tuple(f"T{j}" for j in range(14))
PATHS = {("S0", 1): 120.0, ("S1", 1): -850.0, ("S1", 2): 33.0, ("S2", 1): 4000.0, ("S3", 1): 0.0}


def readings(u=U, seed=1):
    """Distances plus the dead path of station and segment; S1 lost its beam half way."""
    rng, rows, groups = np.random.default_rng(seed), [], []
    for i in range(4):
        for j in range(14):
            group = (f"S{i}", 2 if i == 1 and j > 6 else 1)
            length = np.linalg.norm(PLACES[i] - PLACES[4 + j]) + PATHS[group] + u * rng.normal()
            rows.append((f"S{i}", f"T{j}", float(length)))
            groups.append(group)
    return rows, groups


def solve(fixed, rows, groups, **options):
    return adjust_network(NAMES, fixed, rows, U, PLACES + RNG.normal(size=PLACES.shape), groups=groups, **options)


def test_offsets_and_stations_are_those_of_an_adjustment_with_offsets_as_unknowns():
    rows, groups = readings()
    fixed = NAMES[4:]
    solution = adjust_network(NAMES, fixed, rows, U, PLACES, groups=groups)
    labels = list(PATHS)
    ends = [(NAMES.index(a), NAMES.index(b)) for a, b, _ in rows]

    def residuals(y):
        x = np.vstack([y[:12].reshape(4, 3), TARGETS])
        predicted = [
            np.linalg.norm(x[a] - x[b]) + y[12 + labels.index(g)] for (a, b), g in zip(ends, groups, strict=True)
        ]
        return (np.array([row[2] for row in rows]) - predicted) / U

    start = np.concatenate([STATIONS.ravel(), np.zeros(5)])
    found = least_squares(residuals, start, jac="3-point", ftol=1e-15, xtol=1e-15, gtol=1e-15)
    covariance = np.linalg.inv(found.jac.T @ found.jac)  # 17 unknowns of one size, well determined
    u = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(solution.coordinates[:4].ravel(), found.x[:12], atol=1e-5)
    np.testing.assert_allclose(solution.standard_uncertainty[:4].ravel(), u[:12], rtol=1e-5)
    np.testing.assert_allclose([solution.offsets[label].value for label in labels], found.x[12:], atol=1e-5)
    np.testing.assert_allclose([solution.offsets[label].u for label in labels], u[12:], rtol=1e-5)
    assert solution.degrees_of_freedom == 56 - 17
    assert solution.unit_weight**2 * 39 == pytest.approx(2 * found.cost, rel=1e-9)
    leverage = 1 - np.einsum("ik,kl,il->i", found.jac, covariance, found.jac)
    np.testing.assert_allclose(solution.reliability.redundancy, leverage, atol=1e-5)
    np.testing.assert_allclose(solution.normalised_residuals, found.fun / np.sqrt(leverage), atol=1e-4)
    assert [solution.offsets[label].readings for label in labels] == [14, 7, 7, 14, 14]


def test_free_network_of_relative_distances():
    rows, groups = readings(0.0)
    solution = solve((), rows, groups)
    gaps = [np.linalg.norm(x[:, None] - x, axis=2) for x in (solution.coordinates, PLACES)]
    # 56 readings, 54 coordinates less 6 of the datum, 5 offsets
    assert (solution.rank, solution.datum_defect, solution.degrees_of_freedom) == (48, 6, 3)
    np.testing.assert_allclose(gaps[0], gaps[1], atol=1e-6)
    for label, path in PATHS.items():
        assert solution.offsets[label].value == pytest.approx(path, abs=1e-6)


def test_a_constant_added_to_a_segment_changes_its_offset_alone():
    rows, groups = readings()
    shifted = [(a, b, d - 5000.0 * (group == ("S1", 2))) for (a, b, d), group in zip(rows, groups, strict=True)]
    one, other = (adjust_network(NAMES, NAMES[4:], r, U, PLACES, groups=groups) for r in (rows, shifted))
    np.testing.assert_allclose(one.coordinates, other.coordinates, atol=1e-8)
    assert other.offsets["S1", 2].value == pytest.approx(one.offsets["S1", 2].value - 5000.0, abs=1e-8)


def test_u_of_offsets_is_the_spread_of_repeated_fits():
    found = {label: [] for label in PATHS}
    for seed in range(150):
        rows, groups = readings(U, 100 + seed)
        solution = adjust_network(NAMES, NAMES[4:], rows, U, PLACES, groups=groups)
        for label, offset in solution.offsets.items():
            found[label].append((offset.value - PATHS[label]) / offset.u)
    spread = np.sqrt(np.mean(np.square(list(found.values())), axis=1))
    assert spread.min() > 0.79 and spread.max() < 1.21  # 1 ± 3.7/√(2 · 150)


def test_offset_of_a_point_that_is_not_determined_has_no_u():
    """A station with three relative readings: four unknowns."""
    rows = [("S0", f"T{j}", float(np.linalg.norm(PLACES[0] - PLACES[4 + j]))) for j in range(3)]
    places = {"S0": PLACES[0], **{f"T{j}": TARGETS[j] for j in range(3)}}
    solution = adjust_network(tuple(places), tuple(places)[1:], rows, U, places, groups=["a", "a", "a"])
    assert solution.undetermined == ("S0",) and np.isnan(solution.offsets["a"].u)


def test_single_reading_of_a_segment_tells_only_its_offset():
    rows, groups = readings()
    alone = [*groups[:-1], ("S3", 2)]
    solution = adjust_network(NAMES, NAMES[4:], rows, U, PLACES, groups=alone)
    assert solution.reliability.redundancy[-1] == 0.0 and np.isnan(solution.normalised_residuals[-1])
    assert solution.offsets["S3", 2].readings == 1 and solution.offsets["S3", 2].u > U


def test_blunder_among_relative_distances_is_found():
    rows, groups = readings()
    rows[20] = (*rows[20][:2], rows[20][2] + 0.05)
    solution = adjust_network(NAMES, NAMES[4:], rows, U, PLACES, groups=groups, robust=True)
    assert solution.blunders == (20,) and 0.7 < solution.unit_weight < 1.4
    assert solution.offsets["S1", 1].readings == 6


def test_trials_have_the_offsets_anew_each_time():
    rows, groups = readings()
    solution = adjust_network(NAMES, NAMES[4:], rows, U, PLACES, groups=groups)
    trials = network_trials(solution, 2000, seed=3)
    ratio = trials.coordinates.std(axis=0)[:4] / solution.standard_uncertainty[:4]
    np.testing.assert_allclose(ratio, 1.0, atol=0.07)  # 4.4/√(2 · 2000)


def test_station_is_found_from_relative_distances_to_known_points():
    rows, groups = readings()
    known = dict(zip(NAMES[4:], TARGETS, strict=True))
    found = starting_coordinates(NAMES, rows, U, known, groups=groups)
    np.testing.assert_allclose([found[f"S{i}"] for i in range(4)], STATIONS, atol=0.1)
    with pytest.raises(InputError, match="relative distances need some approximate coordinates"):
        starting_coordinates(NAMES, rows, U, groups=groups)


@pytest.mark.parametrize("column", [True, False])
def test_on_the_command_line(tmp_path, capsys, column):
    rows, groups = readings()
    lines = [f"{a},{b},{d!r},{U},{1 if column else ''},{g[1]}\n" for (a, b, d), g in zip(rows, groups, strict=True)]
    header = "from,to,distance,u,relative,segment\n" if column else "from,to,distance,u,segment\n"
    lines = lines if column else [line.replace(",,", ",") for line in lines]
    (tmp_path / "d.csv").write_text(header + "".join(lines))
    points = "".join(f"{n},{x!r},{y!r},{z!r},1\n" for n, (x, y, z) in zip(NAMES[4:], TARGETS.tolist(), strict=True))
    (tmp_path / "p.csv").write_text("point,x,y,z,fixed\n" + points)
    files = [str(tmp_path / "d.csv"), "--approximate", str(tmp_path / "p.csv"), "--offsets", str(tmp_path / "o.csv")]
    status = main(["multilaterate", *files, *([] if column else ["--relative"])])
    printed = capsys.readouterr()
    assert status == 0, printed.err
    assert "56 distances, 5 offsets" in printed.err
    header, *offsets = [line.split(",") for line in (tmp_path / "o.csv").read_text().splitlines()]
    assert header == ["station", "segment", "offset", "u", "readings"]
    for station, segment, value, u, _ in offsets:
        assert abs(float(value) - PATHS[station, int(segment)]) < 4 * float(u)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "from,to,distance,u\nA,B,-1,0.1\n",
            "distance is -1; expected a number above 0 .* marked by 1 in a column relative",
        ),
        ("from,to,distance,u,relative\nA,B,1,0.1,maybe\n", "row 2: relative is 'maybe'; expected 1 or 0"),
        ("from,to,distance,u,segment\nA,B,1,0.1,2\n", "a column segment, but no distance is relative; .*--relative"),
        ("from,to,distance,u,relative\nA,B,-5,0.1,1\n", "relative distances need some approximate coordinates"),
    ],
)
def test_wrong_files_are_named(tmp_path, capsys, text, message):
    (tmp_path / "d.csv").write_text(text)
    assert main(["multilaterate", str(tmp_path / "d.csv")]) == 2
    said = capsys.readouterr().err
    assert re.search(message, said), said
