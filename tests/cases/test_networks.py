"""Networks of distances on which the program was wrong: each with what is right, as its folder's README says."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2

from volid.cli import main

CASES = Path(__file__).parent


def adjust(capsys, case, network="network", points="points", *options):
    """Exit status, coordinates by point (with u as text), and what is said."""
    folder = CASES / case
    files = [str(folder / f"{network}.csv"), "--approximate", str(folder / f"{points}.csv")]
    status = main(["multilaterate", *files, *options])
    printed = capsys.readouterr()
    rows = csv.DictReader(line for line in printed.out.splitlines() if not line.startswith("#"))
    return status, {row["point"]: row for row in rows}, printed.err


def place(row, axes="xyz"):
    return np.array([float(row[axis]) for axis in axes])


def test_reflector_in_the_plane_of_its_stations_stays_there(capsys):
    status, found, said = adjust(capsys, "01_plane_runaway")
    np.testing.assert_allclose(place(found["T"]), [3759.021, 6388.000, 0.0], atol=6e-4)  # printed to 1 µm
    assert status == 1 and found["T"]["u_z"] == "" and 0.005 < float(found["T"]["u_x"]) < 0.05
    assert "do not determine z of T to first order" in said and "contradict" not in said
    assert "2 degrees of freedom" in said
    assert "unit weight 0.926;" in said  # √(1.71/2)


def test_trials_cover_both_sides_of_the_plane(capsys):
    _, found, _ = adjust(capsys, "01_plane_runaway", "network", "points", "--trials", "4000")
    row = {name: float(cell) for name, cell in found["T"].items() if cell and name != "point"}
    assert row["u_mc_z"] == pytest.approx(6.0, abs=1.0)  # "about ±6 mm"
    assert row["low_z"] < -10 and row["high_z"] > 10


@pytest.mark.parametrize(
    ("which", "x", "y", "heights", "atol"),
    [
        ("a", 0.0, 0.0, (0.0, 2.0), 1e-9),
        ("b", 2.25, 4.80, (2.998, -2.998), 1e-3),
        ("c", 2000.002, 5000.000, (1199.996, -1199.996), 1e-3),
    ],
)
def test_start_in_the_plane_is_left_and_both_sides_are_named(capsys, which, x, y, heights, atol):
    status, found, said = adjust(capsys, "03_start_in_the_plane", f"network_{which}", f"points_{which}")
    height = float(found["T"]["z"])
    np.testing.assert_allclose(place(found["T"], "xy"), [x, y], atol=atol)
    assert min(abs(height - h) for h in heights) < atol
    other = max(heights, key=lambda h: abs(height - h))
    assert status == 1 and "fit as well with T at (" in said
    named = said.split("fit as well with T at (")[1].split(")")[0].split(",")
    np.testing.assert_allclose([float(v) for v in named], [x, y, other], atol=1e-3)
    assert "contradict" not in said and float(found["T"]["u_z"]) > 0


def test_point_seen_by_one_distance_has_blank_cells(capsys):
    status, found, said = adjust(capsys, "05_undetermined_but_small_u")
    assert status == 1 and (found["Q"]["u_x"], found["Q"]["u_y"]) == ("", "")
    assert "u is blank for x and y of Q" in said
    assert float(found["P"]["u_x"]) == pytest.approx(8.7e-4, rel=0.01)
    np.testing.assert_allclose(np.linalg.norm(place(found["Q"], "xy")), 7.01, atol=1e-9)  # on the circle about A


def test_plane_network_with_a_column_of_zeros_has_blank_heights(capsys):
    status, found, said = adjust(capsys, "05_undetermined_but_small_u", "network_flat", "points_flat")
    _, plane, _ = adjust(capsys, "14_u_far_too_large_not_said")  # the same network without the column
    assert status == 1 and "do not determine z of 4, 5, 6, 7, 9" in said
    for name in "45679":
        assert found[name]["u_z"] == "" and float(found[name]["z"]) == 0.0
        np.testing.assert_allclose(place(found[name], "xy"), place(plane[name], "xy"), atol=1e-8)
        assert float(found[name]["u_x"]) == pytest.approx(float(plane[name]["u_x"]), rel=1e-5)


def test_not_determined_is_null_in_json(capsys):
    folder = CASES / "05_undetermined_but_small_u"
    main(["multilaterate", str(folder / "network.csv"), "--approximate", str(folder / "points.csv"), "--json"])
    points = {point["point"]: point for point in json.loads(capsys.readouterr().out)["points"]}
    assert points["Q"]["u"] == [None, None] and points["A"]["u"] == [0.0, 0.0]


@pytest.mark.parametrize("options", [(), ("--robust",)])
@pytest.mark.parametrize(
    ("which", "right", "u"), [("", (5, 5), None), ("6", (4999.57, 5000.54), (0.55, 0.64))], ids=["three", "six"]
)
def test_rough_start_on_the_wrong_side_is_left(capsys, options, which, right, u):
    names = (f"network{which}", f"points{which}")
    status, found, said = adjust(capsys, "06_local_minimum_from_given_start", *names, *options)
    np.testing.assert_allclose(place(found["T"], "xy"), right, atol=0.006)
    assert status == 0 and "approximate coordinates alone lead to a worse minimum" in said
    if u:
        np.testing.assert_allclose([float(found["T"]["u_x"]), float(found["T"]["u_y"])], u, atol=0.005)
        assert "unit weight 0.351" in said


@pytest.mark.parametrize("start", [None, "1,1,0"])
def test_touching_spheres_are_named(capsys, tmp_path, start):
    folder = CASES / "11_undetermined_without_redundancy_silent"
    points = (folder / "points.csv").read_text()
    (tmp_path / "points.csv").write_text(points.rstrip() + (f"\nT,{start},0\n" if start else "\n"))
    status = main(["multilaterate", str(folder / "network.csv"), "--approximate", str(tmp_path / "points.csv")])
    printed = capsys.readouterr()
    row = printed.out.splitlines()[-1].split(",")
    assert status == 1 and "z of T to first order" in printed.err
    np.testing.assert_allclose([float(cell) for cell in row[1:4]], 0.0, atol=1e-9)
    assert row[6] == "" and float(row[4]) > 0


def test_touching_spheres_have_an_interval_by_monte_carlo(capsys):
    _, found, _ = adjust(capsys, "11_undetermined_without_redundancy_silent", "network", "points", "--trials", "4000")
    # closed form: x, y and z² of the intersection of three spheres; where z² is negative the nearest point lies in the plane
    rng = np.random.default_rng(0)
    d1, d2, d3 = (np.array([[69.0], [50.0], [80.0]]) + 0.01 * rng.normal(size=(3, 200_000))) ** 2
    y = (d2 - d3 + 80.0**2 - 50.0**2) / 60.0
    x = (d2 - d1 + 69.0**2 - 50.0**2 + 100.0 * y) / 138.0
    square = d1 - (x - 69.0) ** 2 - y**2
    height = np.sqrt(np.maximum(square, 0.0)) * rng.choice([-1.0, 1.0], square.size)
    low, high = np.quantile(height, [0.025, 0.975])
    assert float(found["T"]["low_z"]) == pytest.approx(low, abs=0.12)  # 3 of its standard deviations with 4000 trials
    assert float(found["T"]["high_z"]) == pytest.approx(high, abs=0.12)


def test_u_far_too_large_is_said(capsys):
    status, _, said = adjust(capsys, "14_u_far_too_large_not_said")
    assert status == 1 and "agree far better than the stated u (unit weight 0.0137" in said
    assert "in another unit" in said
    probability = float(said.split("unit weight 0.0137, probability ")[1].split(")")[0])
    assert probability == pytest.approx(chi2.cdf(0.0026, 14), rel=0.5)  # chi-square 0.0026, two digits
