"""Who determines what: counts against a separate linear model, u against fits without a set and of a set alone."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.mixed_sets import COARSE, CUBIC, FINE, SMOOTH, TWO, campaign_of, drawn, instruments, line_set

import volid
from volid.exceptions import InputError


@pytest.fixture(scope="module")
def three_axes():
    return volid.fit(instruments(1, {}))


def only(campaign, *names):
    return replace(campaign, sets=tuple(s for s in campaign.sets if s.name in names))


def largest_u(solution):
    rows = solution.functions(points=21)
    return {n: max(r.u for r in rows if r.name == n) for n in dict.fromkeys(r.name for r in rows)}


def test_counts_of_a_set_that_reads_one_function(three_axes):
    """A level on X sees EAX alone: a spline of two cubic pieces that is 0 at the reference has 2 + 3 - 1 coefficients."""
    rows = {row.set: row for row in volid.who_determines(three_axes).sets}
    assert (rows["level"].by_itself, rows["level"].only, rows["level"].functions) == (4, 0, ())
    assert all(row.together == row.parameters == three_axes.model.n_parameters for row in rows.values())


def test_the_only_set_on_a_function_is_named():
    rng = np.random.default_rng(1)
    across = replace(line_set("across", COARSE, 1e-3 * rng.standard_normal(24), 1e-3, "Y"), options={"slope": True})
    solution = volid.fit(campaign_of(TWO, drawn("laser", FINE, rng, (3e-4, 3e-4)), across))
    found = volid.who_determines(solution)
    laser, edge = found.sets
    # cubic functions that are 0 at the reference; of EYX the slope belongs to the datum
    assert (laser.by_itself, laser.only, laser.functions) == (3, 3, ("EXX",))
    assert (edge.by_itself, edge.only, edge.functions) == (2, 2, ("EYX",))
    share = found.share("EYX", "across")
    assert np.isnan(share.u_without) and share.u_alone == pytest.approx(share.u) and share.matters
    assert np.isnan(found.share("EYX", "laser").u_alone) and not found.share("EYX", "laser").matters


@pytest.mark.parametrize("text", [CUBIC, SMOOTH])
def test_u_without_a_set_is_that_of_the_readings_that_are_left(text):
    """Dense linear algebra of a cubic function where segments are stated; never smaller than with all sets."""
    rng = np.random.default_rng(2)
    sets = drawn("laser", FINE, rng, (3e-4, 3e-4)), drawn("gauge", COARSE, rng, (5e-4, 5e-4))
    solution = volid.fit(campaign_of(text, *sets))
    share = volid.who_determines(solution).share("EXX", "laser")
    assert share.u < share.u_alone < share.u_without and share.matters
    if text == CUBIC:
        t = (COARSE - 250.0) / 250.0
        columns = np.column_stack([t, t**2, t**3, np.ones_like(t)]) / 5e-4
        covariance = np.linalg.inv(columns.T @ columns)[:3, :3]
        ends = np.linspace(-1.0, 1.0, 21)
        rows = np.column_stack([ends, ends**2, ends**3])
        largest = np.sqrt(np.max(np.sum(rows @ covariance * rows, axis=1)))
        assert share.u_without == pytest.approx(solution.factor * largest, rel=1e-6)


@pytest.mark.slow
def test_u_without_a_set_is_that_of_a_fit_without_it(three_axes):
    """On three axes with all instruments, where the ranges of the others are the same; to what one noise changes of u."""
    found = volid.who_determines(three_axes)
    rest = volid.fit(only(three_axes.campaign, "volume", "again", "level", "bar", "piece"))
    factor = three_axes.factor / rest.factor
    for name, u in largest_u(rest).items():
        assert found.share(name, "tracker").u_without == pytest.approx(factor * u, rel=0.01), name
    assert all(found.share(n, "tracker").u == pytest.approx(u, rel=1e-9) for n, u in largest_u(three_axes).items())


def test_what_two_sets_determine_together_neither_need_determine_alone():
    """Two halves of X, which share the middle: each determines its readings' part, and without either nothing is whole."""
    rng = np.random.default_rng(3)
    left, right = np.tile([0.0, 250.0], 6), np.tile([250.0, 500.0], 6)
    sets = drawn("left", left, rng, (3e-4, 3e-4)), drawn("right", right, rng, (3e-4, 3e-4))
    solution = volid.fit(campaign_of(CUBIC, *sets))
    rows = volid.who_determines(solution).sets
    assert [(row.together, row.by_itself, row.only) for row in rows] == [(2, 1, 1), (2, 1, 1)]


def test_a_solution_without_all_its_readings_is_refused(three_axes):
    with pytest.raises(InputError, match="this solution is extrapolated"):
        volid.who_determines(three_axes.extrapolated({"X": (0.0, 620.0)}))


@pytest.mark.slow
def test_a_set_that_says_nothing_without_the_others(tmp_path):
    """A level on a square in two places: where nothing is read along the square in one of them, it tells nothing."""
    source = Path("datasets/direct_measurement")
    shutil.copytree(source, tmp_path / "direct")
    manifest, machine = tmp_path / "direct" / "campaign.toml", tmp_path / "direct" / "machine.toml"
    machine.write_text(machine.read_text().replace("[model.functions]", "[model]\nsegments = 2\n[model.functions]"))
    names = ("levels", "square left", "square right", "level on the square")
    solution = volid.fit(only(volid.load_campaign(manifest), *names))
    rows = {row.set: row for row in volid.who_determines(solution).sets}
    level = rows["level on the square"]
    assert (level.by_itself, level.only) == (0, 1)  # with the squares it ties the slope of the roll EBY
