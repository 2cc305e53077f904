"""Harja and Candra: systematic deviations E of X and Z come back from the fit of their published tables.

Expected values are the published ones (µm, printed to 0.1), see datasets/published_positioning/README.md.
"""

import runpy

import numpy as np
import pytest
from support.places import DATASETS

from volid.fitting.fit import fit
from volid.io import load_campaign

FOLDER = DATASETS / "published_positioning"
MAKE = runpy.run_path(str(FOLDER / "make.py"))  # the tables as printed, and the deviations from them
TABLES, deviations = MAKE["TABLES"], MAKE["deviations"]
STEP = 25.0  # mm
PUBLISHED = {"EXX": {"E": 31.8, "R": 4.2}, "EZZ": {"E": 33.3, "R": 6.3}}  # µm, bidirectional
U_OF_MEAN = {("EXX", 1): 4.2, ("EXX", -1): 2.6, ("EZZ", 1): 3.9, ("EZZ", -1): 4.0}  # R = 4 s, one direction, µm


@pytest.fixture(scope="module")
def solution():
    return fit(load_campaign(FOLDER / "campaign.toml"))


def rows(solution, name):
    return [row for row in solution.functions(step=STEP) if row.name == name]


@pytest.mark.parametrize("name", PUBLISHED)
def test_systematic_deviation_is_the_published_one(solution, name):
    values = np.array([row.value for row in rows(solution, name)])
    assert np.ptp(values) * 1e3 == pytest.approx(PUBLISHED[name]["E"], abs=0.05)  # half of the last printed digit


@pytest.mark.parametrize("name", PUBLISHED)
def test_reversal_is_smaller_than_the_published_repeatability(solution, name):
    """R is the largest of 2 s(+) + 2 s(-) + |B|, ISO 230-2."""
    value = {(row.position, row.direction): row.value for row in rows(solution, name)}
    reversal = [value[q, 1] - value[q, -1] for q, direction in value if direction == 1]
    assert 0.5 < np.abs(reversal).max() * 1e3 < PUBLISHED[name]["R"]


def test_uncertainty_is_that_of_a_mean_of_five(solution):
    """Far from the reference: u of the mean there, and of the zero at the reference, where both directions agree in u."""
    for name, axis in (("EXX", "X"), ("EZZ", "Z")):
        s = {way: U_OF_MEAN[name, way] / 4 / np.sqrt(5) * 1e-3 for way in (1, -1)}
        reference = solution.machine.axis(axis).reference
        at_zero = 1.0 if reference % STEP == 0 else 0.5  # midway between two positions: the mean of two values
        for row in rows(solution, name):
            if abs(row.position - reference) > STEP:
                zero = at_zero * (s[1] ** 2 + s[-1] ** 2) / 4
                assert row.u == pytest.approx(np.sqrt(s[row.direction] ** 2 + zero), rel=2e-3)  # u has three digits


def test_without_redundancy_the_fit_says_so_and_fits_exactly(solution):
    assert solution.adequacy.degrees_of_freedom == 0
    assert solution.adequacy.verdict.startswith("not testable")
    assert not solution.adequacy.rejected
    assert np.isnan(solution.adequacy.unit_weight)
    assert solution.fully_determined
    assert max(solution.statistics.residual_rms.values()) < 1e-9


def test_only_positioning_is_in_the_model(solution):
    assert solution.model.names == ("EXX", "EZZ")


# --------------------------------------------------------------------- from the tables to the corrected machine (L-POS)


@pytest.fixture(scope="module")
def folder(solution, tmp_path_factory):
    """L-POS tables every 25 mm with both directions, zero at the lower end, increments as published."""
    from volid.compensation.base import base_of
    from volid.compensation.package import compensate
    from volid.compensation.tables.sampling import Sampling
    from volid.io.compensations import save_compensation
    from volid.io.tables import TableForm

    made = compensate(solution, ["L-POS"], base_of(solution, (0.0, 0.0, 0.0)), tables=Sampling(step=STEP))
    place = tmp_path_factory.mktemp("tables") / "out"
    save_compensation(made, solution, place, form=TableForm(incremental=True))
    return place


@pytest.mark.parametrize("name", PUBLISHED)
def test_the_published_incremental_table_comes_back(folder, name):
    """Increments from row to row are the published ones, µm printed to 0.001; the first row differs by the choice of zero."""
    lines = [line for line in (folder / f"{name}.csv").read_text().splitlines() if not line.startswith("#")]
    assert lines[0].split(",")[:3] == [name[2], f"{name}(+)", f"{name}(-)"]
    rows = np.array([[float(c) for c in line.split(",")[:3]] for line in lines[1:]])
    published = np.array([[float(v) for v in TABLES[name[2]][way].split()] for way in (1, -1)]).T
    np.testing.assert_allclose(1e3 * rows[1:, 1:], published[1:], atol=0.0006)
    np.testing.assert_allclose(1e3 * (rows[0, 2] - rows[0, 1]), published[0, 1] - published[0, 0], atol=0.0006)
    summed = np.cumsum(rows[:, 1:], axis=0)
    assert np.ptp(summed) * 1e3 == pytest.approx(PUBLISHED[name]["E"], abs=0.05)


def test_the_corrected_machine_is_below_one_micrometre(solution, folder):
    """The machine of the published mean deviations (straight lines between them), by exact matrices: before E = 31.8 and 33.3 µm,
    after L-POS with reversal less than 1 µm at and between the points, in both directions; with one reversal value, not."""
    from exact_chain import ExactMachine, Truth

    from volid.compensation.tables.error_table import with_one_reversal
    from volid.io.compensations import load_control

    exact = ExactMachine("w X' Y' b Z (C) t", {"X": (0, 500), "Y": (0, 200), "Z": (0, 325)})
    mean, reversal = {}, {}
    for axis in "XZ":
        up, down = (np.array([float(v) for v in deviations(axis, way)]) for way in (1, -1))
        x = STEP * np.arange(len(up))
        mean[f"E{axis}{axis}"] = lambda q, x=x, v=0.5 * (up + down): np.interp(q, x, v)
        reversal[f"E{axis}{axis}"] = lambda q, x=x, v=up - down: np.interp(q, x, v)
    truth = Truth(functions=mean, reversal=reversal)
    control = load_control(solution.machine, [folder])
    lumped = load_control(solution.machine, [folder])
    lumped = type(lumped)(solution.machine, tuple(with_one_reversal(t) for t in lumped.tables))
    for axis, name in (("X", "EXX"), ("Z", "EZZ")):
        x = np.linspace(*exact.travel[axis], 201)
        found, left, one = [], [], []
        for way in (1.0, -1.0):
            q = np.tile([250.0, 100.0, 162.5], (201, 1))
            k = exact.column(axis)
            q[:, k] = x
            ways = np.zeros_like(q)
            ways[:, k] = way
            nominal = exact.functional_point(q, np.zeros(3))
            for kept, command in (
                (found, q),
                (left, control.command(q, None, ways)),
                (one, lumped.command(q, None, ways)),
            ):
                kept.append((exact.functional_point(command, np.zeros(3), truth, ways) - nominal)[:, "XYZ".index(axis)])
        assert np.ptp(found) * 1e3 == pytest.approx(PUBLISHED[name]["E"], abs=0.05)
        assert np.ptp(left) * 1e3 < 0.02  # both directions together, to the last digit of the campaign: far below 1 µm
        assert np.ptp(one) * 1e3 > 0.2  # reversal changes along the axis
