"""The bundled datasets: they load, their programs make them again, and a fit gives back what is known about them."""

import csv
import importlib.util
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
from exact_chain import gauge_free
from scipy.stats import chi2
from support.places import DATASETS

from volid.campaign import Campaign
from volid.fitting.fit import fit
from volid.fitting.prediction.deviations import gradient_matrix
from volid.io import load_campaign
from volid.plausibility.checks import check_campaign, closures
from volid.validation.check import check
from volid.validation.readings.validation import validate
from volid.validation.solutions.series import series

NAMES = sorted(path.parent.name for path in DATASETS.glob("*/campaign.toml"))
MADE = sorted(path.parent.name for path in DATASETS.glob("*/make.py"))
MULTILATERATION = DATASETS / "vertical_multilateration"
RTEST = DATASETS / "five_axis_rtest"
NUMBER = re.compile(r"-?\d+(?:\.\d+)?")
CHANCE = 1e-3  # of a correct result outside the bounds; the data are fixed


def read(path: Path) -> dict[str, np.ndarray]:
    """Columns of a truth file, as text."""
    lines = [line for line in path.read_text(encoding="utf-8").splitlines() if not line.startswith("#")]
    rows = list(csv.DictReader(lines))
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


@pytest.mark.parametrize("name", NAMES)
def test_dataset_loads_without_warning_and_is_in_the_table(name):
    campaign = load_campaign(DATASETS / name / "campaign.toml")
    assert check_campaign(campaign) == ()
    assert campaign.title
    assert campaign.conditions
    assert f"[`{name}`]" in (DATASETS / "README.md").read_text(encoding="utf-8")
    assert (DATASETS / name / "README.md").exists()
    assert sum(path.stat().st_size for path in (DATASETS / name).iterdir() if path.is_file()) < 1_000_000


def assert_same_but_last_digits(made: str, kept: str, file: str) -> None:
    """The same text but for one unit in the last digit of numbers: mathematical libraries differ in the last bit."""
    new, old = (NUMBER.sub("#", text) for text in (made, kept))
    assert new == old, file
    for a, b in zip(NUMBER.findall(made), NUMBER.findall(kept), strict=True):
        if a != b:
            digits = len(b.partition(".")[2])
            assert abs(float(a) - float(b)) < 1.5 * 10.0**-digits, (file, a, b)


@pytest.mark.parametrize("name", MADE)
def test_program_makes_the_dataset_again(name, tmp_path):
    spec = importlib.util.spec_from_file_location(f"make_{name}", DATASETS / name / "make.py")
    make = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(make)
    make.write(tmp_path)
    made = {path.name for path in tmp_path.iterdir()}
    assert {path.name for path in (DATASETS / name).glob("*.csv")} <= made
    for file in made:
        assert_same_but_last_digits((tmp_path / file).read_text(), (DATASETS / name / file).read_text(), file)


@pytest.fixture(scope="module")
def campaign() -> Campaign:
    return load_campaign(MULTILATERATION / "campaign.toml")


@pytest.fixture(scope="module")
def solution(campaign):
    return fit(campaign)


@pytest.fixture(scope="module")
def points(campaign):
    """Positions in machine axis order, tools, and true deviations of truth_points.csv."""
    columns = {name: values.astype(float) for name, values in read(MULTILATERATION / "truth_points.csv").items()}
    q = campaign.machine.order(**{a: columns[a] for a in "XYZ"})
    tool = np.stack([columns[f"tool_{c}"] for c in "xyz"], axis=1)
    return q, tool, np.stack([columns[f"e{c}"] for c in "xyzabc"], axis=1)


def test_the_campaign_is_what_its_readme_says(campaign):
    assert campaign.conditions["synthetic"] is True
    assert campaign.title.startswith("SYNTHETIC")
    model = tomllib.loads((DATASETS.parent / "models/wYXbZt_vertical.toml").read_text(encoding="utf-8"))
    assert campaign.machine.structure == model["structure"]
    assert {a.letter: list(a.travel) for a in campaign.machine.axes} == {
        a: t["travel"] for a, t in model["axis"].items()
    }
    readings = campaign.sets[0]
    assert len(readings) == 2400
    assert len(np.unique(readings.tool, axis=0)) == 3
    assert np.all(np.diff(readings.time) > 0)
    beams = [f"{s} {i}" for s, i in zip(readings.labels["station"], readings.labels["segment"], strict=True)]
    assert len(set(beams)) == 18
    for i, axis in enumerate(campaign.machine.axes):
        assert set(axis.travel) <= set(readings.positions[:, i])
    true = dict(zip(*(read(MULTILATERATION / "truth_instruments.csv")[k] for k in ("name", "value")), strict=True))
    for station in campaign.stations:
        exact = np.array([float(true[f"station {station.name} {c}"]) for c in "XYZ"])
        assert 0.1 < np.abs(exact - station.position).max() <= 5.0


def test_closures_show_the_noise_and_no_drift(campaign):
    (closure,) = closures(campaign)
    assert closure.n == 36
    # two differences share their first reading; 36 of them have no less freedom than 18
    low, high = np.sqrt(chi2.ppf([CHANCE / 2, 1 - CHANCE / 2], 18) / 18)
    assert low < closure.rms_ratio < high


def test_default_fit_is_accepted_and_complete(solution):
    adequacy = solution.adequacy
    assert not adequacy.rejected, adequacy.verdict
    assert solution.statistics.converged
    assert solution.fully_determined
    assert not solution.held_tool_rotation
    low, high = np.sqrt(
        chi2.ppf([CHANCE / 2, 1 - CHANCE / 2], adequacy.degrees_of_freedom) / adequacy.degrees_of_freedom
    )
    assert low < adequacy.unit_weight < high


def test_deviations_agree_with_the_truth_within_their_uncertainty(solution, points):
    """A rigid motion of the workpiece frame is removed from both; the tool rotation is determined and stays."""
    q, tool, true = (values[:400] for values in points)
    difference = np.asarray(solution.deviation(q, tool))[:, :3] - true[:, :3]
    rows = gradient_matrix(solution.model, np.asarray(solution.parameters), q, tool, np.zeros_like(q))[:, :3]
    rows = rows.reshape(-1, solution.model.n_parameters)
    xyz = q[:, [solution.machine.index(a) for a in "XYZ"]]
    covariance = rows @ solution.parameter_covariance @ rows.T
    free, projected = gauge_free(difference, xyz, tool, covariance, tool_rotation=False)
    u = np.sqrt(np.diagonal(projected))
    correlation = projected / np.outer(u, u)
    normalised = free.ravel() / u
    freedom = len(u) ** 2 / np.sum(correlation**2)  # Satterthwaite: the points share few parameters
    low, high = np.sqrt(chi2.ppf([CHANCE / 2, 1 - CHANCE / 2], freedom) / freedom)
    assert low < np.sqrt(np.mean(normalised**2)) < high
    assert np.sqrt(np.mean(np.sum(free**2, axis=1))) < 5e-4  # mm, about the u of one reading
    assert np.sqrt(np.mean(np.sum(true[:, :3] ** 2, axis=1))) > 0.02  # what there was to find


def test_the_second_campaign_confirms_the_solution_and_finds_the_knock(solution):
    """datasets/validation: the same truth from other stations, and after a squareness error of 12 µrad came to it."""
    found = validate(solution, load_campaign(DATASETS / "validation" / "campaign.toml"))
    assert found.confirmed and found.is_independent and 0.01 < found.e_n_above_1 < 0.10
    found = validate(solution, load_campaign(DATASETS / "validation" / "after_knock.toml"))
    assert not found.confirmed and [t.passed for t in found.tests] == [False, True, True]
    value, expanded = (float(x) for x in found.causes[0].what.split("by ")[1].split(" µrad")[0].split(" ± "))
    assert "EC0Y" in found.causes[0].what and abs(value - 12.0) < expanded < 2.0


@pytest.mark.slow
def test_surveys_tell_the_drift_and_the_collision():
    """datasets/surveys: squareness and the scale of X drift, and then a collision of 10 µm over 600 mm."""
    january, april, july = (
        fit(load_campaign(DATASETS / "surveys" / f"{month}.toml")) for month in ("january", "april", "july")
    )
    found = series([january, april, july], [0.0, 91.0, 182.0], limit=0.005)
    drifts = {f.drift.name: f.drift for f in found.functions if f.drift.significant}
    assert set(drifts) == {"EC0Y", "EXX"} and all(f.steady for f in found.functions)
    assert abs(drifts["EC0Y"].largest_change - 8e-6) < 3.3 * drifts["EC0Y"].u  # normal quantile of 1e-3
    scale = 6e-6 * (drifts["EXX"].at - 500.0)  # mm, zero at the reference
    assert abs(drifts["EXX"].largest_change - scale) < 3.3 * drifts["EXX"].u
    knocked = check(january, load_campaign(DATASETS / "surveys" / "monday.toml"))
    assert knocked.changed and [f.name for f in knocked.findings] == ["EC0Y"]
    assert abs(knocked.findings[0].size - 10.0 / 600.0 / 1000.0) < 3.3 * knocked.findings[0].u


def test_location_errors_agree_with_the_truth(solution):
    truth = read(MULTILATERATION / "truth_functions.csv")
    constants = {
        n: float(v) for n, p, v in zip(*(truth[k] for k in ("function", "position", "value")), strict=True) if not p
    }
    assert set(constants) == {"EC0Y", "EA0Z", "EB0Z", "EA0S", "EB0S", "EC0S"}
    found = [solution.location(name) for name in constants]
    normalised = [(f.value - true) / f.u for f, true in zip(found, constants.values(), strict=True)]
    assert np.max(np.abs(normalised)) < 3.8  # six of them: normal quantile of 1e-3


def test_enclosed_functions_and_points_tell_the_same_truth(points):
    """Chain of first order from the tables: within the second order of 100 µrad over 1 m, 0.02 µm, at any tool."""
    truth = read(MULTILATERATION / "truth_functions.csv")
    q, tool, true = points
    y, x, z = q.T
    position = {"X": x, "Y": y, "Z": z}

    def value(name):
        rows = (truth["function"] == name) & (truth["position"] != "")
        table = [truth[k][rows].astype(float) for k in ("position", "value")]
        return np.interp(position[name[2]], *table)

    def constant(name):
        return float(truth["value"][truth["function"] == name][0])

    rotation = {a: np.stack([value(f"E{d}{a}") for d in "ABC"], axis=1) for a in "XYZ"}
    shift = {a: np.stack([value(f"E{d}{a}") for d in "XYZ"], axis=1) for a in "XYZ"}
    shift["Y"][:, 0] -= constant("EC0Y") * (y - 300.0)
    shift["Z"][:, 0] += constant("EB0Z") * (z + 250.0)
    shift["Z"][:, 1] -= constant("EA0Z") * (z + 250.0)
    spindle = np.array([constant(f"E{d}0S") for d in "ABC"])
    # w Y' X' b Z t: lever arms in the tables contain the positions of all axes towards the tool
    arms = {"Z": tool, "X": tool + np.stack([x, 0 * x, z], axis=1), "Y": tool + np.stack([x, y, z], axis=1)}
    expected = np.cross(spindle, tool) + sum(shift[a] + np.cross(rotation[a], arms[a]) for a in "XYZ")
    # second order, and linear interpolation in the tables: (5 mm)²/8 · curvature, below 0.02 µm for these waves
    np.testing.assert_allclose(true[:, :3], expected, rtol=0, atol=5e-5)
    np.testing.assert_allclose(true[:, 3:], spindle + sum(rotation.values()), rtol=0, atol=1e-7)


# ------------------------------------------------------------------------------------------------------------- R-test


@pytest.fixture(scope="module")
def rtest():
    return fit(load_campaign(RTEST / "campaign.toml"))


def test_rtest_is_what_its_readme_says():
    campaign = load_campaign(RTEST / "campaign.toml")
    assert campaign.conditions["synthetic"] is True and campaign.title.startswith("SYNTHETIC")
    model = tomllib.loads((DATASETS.parent / "models/wCAYXbZt_trunnion.toml").read_text(encoding="utf-8"))
    assert campaign.machine.structure == model["structure"]
    for axis in campaign.machine.axes:
        assert list(axis.travel) == model["axis"][axis.letter]["travel"]
    (readings,) = campaign.sets
    c, a = (readings.positions[:, campaign.machine.index(letter)] for letter in "CA")
    assert len(readings) == 37 * 13 * 3 and len(np.unique(c)) == 37 and len(np.unique(a)) == 13
    assert np.abs(readings.readings).max() < 1.0  # mm: the approximate spheres are off by 0.5 mm


def test_rtest_gives_the_location_errors_within_the_required_uncertainty(rtest):
    """37 × 13 positions with 0.5 µm of noise: u below 0.2 µm and 1 µrad, and the truth within them."""
    assert not rtest.adequacy.rejected and rtest.fully_determined
    truth = read(RTEST / "truth_functions.csv")
    known = {n: float(v) for n, p, v in zip(truth["function"], truth["position"], truth["value"], strict=True) if not p}
    assert set(known) == {"EX0C", "EY0C", "EA0C", "EB0C", "EY0A", "EZ0A", "EB0A", "EC0A"}
    for name, true in known.items():
        found = rtest.location(name)
        assert found.u < (1e-6 if name[1] in "ABC" else 2e-4), name
        assert abs(found.value - true) < 3.8 * found.u, name  # eight of them: normal quantile of 1e-3


def test_rtest_deviations_agree_with_the_truth(rtest):
    """At any place and tool vector: what was given as workpiece frame and nest is exact, so nothing is removed."""
    columns = {name: values.astype(float) for name, values in read(RTEST / "truth_points.csv").items()}
    q = rtest.machine.order(**{a: columns[a] for a in "XYZAC"})
    tool = np.stack([columns[f"tool_{c}"] for c in "xyz"], axis=1)
    true = np.stack([columns[f"e{c}"] for c in "xyz"], axis=1)
    size = np.linalg.norm(np.asarray(rtest.deviation(q, tool))[:, :3] - true, axis=1)
    assert np.sqrt(np.mean(size**2)) < 8.7e-4  # mm: 0.5 µm in three directions, one reading
    assert np.sqrt(np.mean(np.sum(true**2, axis=1))) > 0.03  # what there was to find


# ------------------------------------------------------------------------------------------------- direct measurement

DIRECT = DATASETS / "direct_measurement"


@pytest.fixture(scope="module")
def direct():
    return fit(load_campaign(DIRECT / "campaign.toml"))


def test_direct_measurement_is_what_its_readme_says(direct):
    campaign = direct.campaign
    assert campaign.conditions["synthetic"] is True and campaign.title.startswith("SYNTHETIC")
    assert len(campaign.alignments) == 13 and len(campaign.sets) == 17
    assert {s.kind for s in campaign.sets} == {"component", "level"}
    model = tomllib.loads((DATASETS.parent / "models/wXZbYt_cross_bed.toml").read_text(encoding="utf-8"))
    assert campaign.machine.structure == model["structure"]
    assert not direct.adequacy.rejected and direct.fully_determined
    assert abs(direct.adequacy.unit_weight - 0.99) < 0.005 and 880 < direct.adequacy.degrees_of_freedom < 900


def test_direct_measurement_gives_all_functions_and_squareness(direct):
    """The truth within u: 18 functions in both directions where they differ, three squareness errors."""
    truth = read(DIRECT / "truth_functions.csv")
    squared: dict[str, list[float]] = {}
    for f in direct.functions(points=11):
        rows = (truth["function"] == f.name) & (truth["direction"].astype(int) == f.direction)
        value = truth["value"][rows].astype(float)
        if f.position is not None and np.isfinite(f.position):
            value = np.interp([f.position], truth["position"][rows].astype(float), value)
        if f.u > (1e-8 if f.name[1] in "ABC" else 2e-5):  # less is that of the zero at the reference
            squared.setdefault(f.name, []).append(float((f.value - value[0]) / f.u) ** 2)
    assert len(squared) == 18 + 3
    freedom = 18 * 3 + 3  # about: values of one function depend on each other
    low, high = np.array(chi2.ppf([CHANCE / 2, 1 - CHANCE / 2], freedom)) / freedom
    assert low < np.mean([np.mean(values) for values in squared.values()]) < high
    assert max(max(values) for values in squared.values()) < 4.2**2  # some 60 values: normal quantile of 1e-3
