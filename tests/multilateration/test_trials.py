"""Monte Carlo for distance networks: equal to propagation where linear, to the closed form of trilateration where not."""

import json

import numpy as np
import pytest

from volid.cli import main
from volid.exceptions import InputError
from volid.multilateration import adjust_network, network_trials

TRIALS = 8192
STATIONS = {"A": (0.0, 0.0, 0.0), "B": (3000.0, 0.0, 0.0), "C": (0.0, 2500.0, 0.0)}
U = 0.02


def trilateration(height: float):
    """A target above the plane of three fixed stations, distances without error."""
    target = np.array([1100.0, 900.0, height])
    points = STATIONS | {"P": target}
    distances = [(s, "P", float(np.linalg.norm(target - x))) for s, x in STATIONS.items()]
    return adjust_network(tuple(points), "ABC", distances, U, points), distances


def closed_form(distances: list[float]) -> np.ndarray:
    """Upper intersection of three spheres (n, 3); where they do not meet, the foot with height 0 is no minimum: NaN."""
    a, b, c = np.asarray(distances).T
    x = (a**2 - b**2 + 3000.0**2) / 6000.0
    y = (a**2 - c**2 + 2500.0**2) / 5000.0
    with np.errstate(invalid="ignore"):
        return np.stack([x, y, np.sqrt(a**2 - x**2 - y**2)], axis=1)


def test_equal_to_propagation_where_linear():
    """Seven stations around, five targets, free network: whitened coordinates scatter as the covariance says."""
    rng = np.random.default_rng(2)
    places = {f"S{i}": rng.uniform(-2000, 2000, 3) for i in range(7)} | {
        f"T{i}": rng.uniform(-800, 800, 3) for i in range(8)
    }
    distances = [(s, t, float(np.linalg.norm(places[s] - places[t]))) for s in places for t in places if s[0] < t[0]]
    solution = adjust_network(tuple(places), (), distances, 0.001, places)
    trials = network_trials(solution, TRIALS, seed=1)
    assert trials.converged.all()
    values, vectors = np.linalg.eigh(solution.covariance)
    seen = values > 1e-9 * values[-1]
    assert seen.sum() == 3 * 15 - 6
    difference = (trials.coordinates - solution.coordinates).reshape(TRIALS, -1)
    z = difference @ vectors[:, seen] / np.sqrt(values[seen])
    assert np.abs(z.mean(axis=0)).max() < 4.5 / np.sqrt(TRIALS)
    scatter = z.T @ z / TRIALS
    edge = np.sqrt(seen.sum() / TRIALS)  # of the eigenvalues of a sample covariance (Marchenko, Pastur)
    sizes = np.linalg.eigvalsh(scatter)
    assert (1 - edge) ** 2 - 0.05 < sizes[0] and sizes[-1] < (1 + edge) ** 2 + 0.05
    assert np.abs(difference @ vectors[:, ~seen]).max() < 1e-4 * np.sqrt(values[-1]), "a free network stays where it is"


def test_nearly_coplanar_stations_make_them_differ_and_the_closed_form_agrees_with_monte_carlo():
    """Height 8 mm over the plane of the stations: the interval of propagation reaches too high and not low enough."""
    high, _ = trilateration(2000.0)
    found = network_trials(high, TRIALS, seed=3).coordinates[:, 3]
    np.testing.assert_allclose(found.std(axis=0), high.standard_uncertainty[3], rtol=5.0 / np.sqrt(2 * TRIALS))
    low, distances = trilateration(8.0)
    trials = network_trials(low, TRIALS, seed=3)
    assert trials.converged.mean() > 0.999
    exact = np.array([d for _, _, d in distances])
    noise = [np.random.Generator(np.random.Philox(key=[3, i])).standard_normal(3) for i in range(TRIALS)]
    expected = closed_form(exact + U * np.array(noise))
    meet = np.isfinite(expected[:, 2])
    assert 0.8 < meet.mean() < 1.0, "some trials have no intersection: the plane is near"
    np.testing.assert_allclose(trials.coordinates[meet, 3], expected[meet], atol=2e-3)
    folded = np.abs(trials.coordinates[~meet, 3, 2])  # 1 mm changes the sum of squares by 1e-10
    assert np.quantile(folded, 0.95) < 0.1 and folded.max() < 1.0, "the nearest point lies in the plane"
    height = trials.coordinates[:, 3, 2]
    u = low.standard_uncertainty[3, 2]
    lower, upper = np.quantile(height, [0.025, 0.975])
    assert lower < 8.0 - 2.5 * u and upper < 8.0 + 1.7 * u
    assert (np.abs(height - 8.0) > 1.96 * u).mean() != pytest.approx(0.05, abs=0.01)


def test_trials_follow_from_seed_and_number():
    solution, _ = trilateration(500.0)
    many, few = network_trials(solution, 1030, seed=5), network_trials(solution, 515, seed=5)
    np.testing.assert_allclose(many.coordinates[:515], few.coordinates, atol=1e-9)
    assert np.abs(many.coordinates[0] - network_trials(solution, 2, seed=6).coordinates[0]).max() > 1e-6


def test_on_the_command_line(tmp_path, capsys):
    _, distances = trilateration(8.0)
    (tmp_path / "d.csv").write_text("from,to,distance,u\n" + "".join(f"{a},{b},{d!r},{U}\n" for a, b, d in distances))
    rows = "".join(f"{n},{x},{y},{z},1\n" for n, (x, y, z) in STATIONS.items()) + "P,1100,900,8,0\n"
    (tmp_path / "p.csv").write_text("point,x,y,z,fixed\n" + rows)
    arguments = ["multilaterate", str(tmp_path / "d.csv"), "--approximate", str(tmp_path / "p.csv")]
    assert main([*arguments, "--trials", "4000", "-o", str(tmp_path / "o.csv")]) == 0
    assert "propagation misleads (JCGM 101, 8) for z of P: take u_mc" in capsys.readouterr().out
    header, *lines = [line for line in (tmp_path / "o.csv").read_text().splitlines() if line[0] != "#"]
    assert header.endswith("fixed,u_mc_x,low_x,high_x,u_mc_y,low_y,high_y,u_mc_z,low_z,high_z")
    u_z, u_mc_z, low_z = (float(lines[3].split(",")[i]) for i in (6, 14, 15))
    assert u_mc_z != pytest.approx(u_z, rel=0.05) and low_z < 1.0
    assert main([*arguments, "--trials", "100", "--json"]) == 0
    assert np.shape(json.loads(capsys.readouterr().out)["monte_carlo"]["high"]) == (4, 3)
    assert main([*arguments, "--trials", "5"]) == 2
    assert "--trials 5: 5 samples; a 95% interval needs at least 20" in capsys.readouterr().err


def test_too_few_trials_are_named():
    with pytest.raises(InputError, match="1 trials; expected at least 2"):
        network_trials(trilateration(500.0)[0], 1)
