"""Quantities of ISO 230-2: closed forms, a plain loop over lists, a real test, and what is absent where it is not determined."""

import csv
import statistics
from dataclasses import replace
from math import sqrt

import numpy as np
import pytest
from support.places import DATASETS, reference_file

from volid.exceptions import InputError
from volid.io.evaluations.positioning import read_positioning
from volid.standards.positioning.evaluation import evaluate_positioning, mixed_ranges, quantities_of
from volid.standards.positioning.runs import Approaches, PositioningRuns, arranged, from_means, statistics_of

SYNTHETIC = DATASETS / "iso230_2_synthetic"
S = sqrt(2.5)  # standard deviation of -2, -1, 0, 1, 2
ROUNDING = 1e-12  # mm or degrees


def values(runs):
    return {q.symbol: q.value for q in evaluate_positioning(runs).quantities}


def some_runs(seed=0, t=7, n=5, size=1.0):
    rng = np.random.default_rng(seed)
    targets = np.cumsum(rng.uniform(40.0, 160.0, t))
    means = size * 5e-3 * rng.standard_normal((t, 2, 1))
    return PositioningRuns("X", targets, means + size * 2e-3 * rng.standard_normal((t, 2, n)))


def by_hand(runs):
    """The quantities in plain Python, straight from their definitions."""
    up, down = ([[float(x) for x in row if not np.isnan(x)] for row in runs.deviations[:, way]] for way in (0, 1))
    m_up, m_down = ([statistics.fmean(row) for row in rows] for rows in (up, down))
    s_up, s_down = ([statistics.stdev(row) for row in rows] for rows in (up, down))
    reversal = [a - b for a, b in zip(m_up, m_down, strict=True)]
    both = [(a + b) / 2 for a, b in zip(m_up, m_down, strict=True)]
    high_up, low_up = ([m + k * s for m, s in zip(m_up, s_up, strict=True)] for k in (2, -2))
    high_down, low_down = ([m + k * s for m, s in zip(m_down, s_down, strict=True)] for k in (2, -2))
    repeat = [max(2 * a + 2 * b + abs(c), 4 * a, 4 * b) for a, b, c in zip(s_up, s_down, reversal, strict=True)]
    return {
        "E": max(m_up + m_down) - min(m_up + m_down), "E_up": max(m_up) - min(m_up), "E_down": max(m_down) - min(m_down),
        "A": max(high_up + high_down) - min(low_up + low_down), "A_up": max(high_up) - min(low_up),
        "A_down": max(high_down) - min(low_down), "R": max(repeat), "R_up": 4 * max(s_up), "R_down": 4 * max(s_down),
        "M": max(both) - min(both), "B": max(map(abs, reversal)), "B_mean": statistics.fmean(reversal),
    }  # fmt: skip


@pytest.mark.parametrize("seed", range(5))
def test_quantities_are_those_of_their_definitions(seed):
    """Also where the numbers of approaches differ: some are taken out, two at least are left."""
    runs = some_runs(seed)
    gaps = runs.deviations.copy()
    gaps[seed % 7, seed % 2, :3] = np.nan
    for found in (runs, replace(runs, deviations=gaps)):
        assert values(found) == pytest.approx(by_hand(found), abs=ROUNDING)


def test_the_synthetic_linear_test_has_the_figures_that_follow_from_its_closed_form():
    """Means 0 … 11.0 up and -2.1 … 8.4 µm down, s = a sqrt(2.5), see datasets/iso230_2_synthetic/make.py."""
    expected = {
        "E": 11.0 + 2.1, "E_up": 11.0, "E_down": 8.4 + 2.1,
        "A": (11.0 + 2 * 0.5 * S) + (2.1 + 2 * 0.3 * S), "A_up": (11.0 + 2 * 0.5 * S) + 2 * 0.4 * S,
        "A_down": (8.4 + 2 * 0.4 * S) + (2.1 + 2 * 0.3 * S),
        "R_up": 4 * 0.6 * S, "R_down": 4 * 0.6 * S, "R": 2 * (0.6 + 0.4) * S + 2.7,  # at 602.5
        "B": 3.2, "B_mean": 27.2 / 11, "M": (11.0 + 8.4) / 2 + 2.1 / 2,
    }  # fmt: skip
    for name in ("X.csv", "X_wide.csv", "campaign.toml"):
        [found] = read_positioning(SYNTHETIC / name, axis="X")
        assert {k: 1e3 * v for k, v in values(found.runs).items()} == pytest.approx(expected, abs=1e-7), name


def test_the_synthetic_rotary_test_is_in_degrees():
    [found] = read_positioning(SYNTHETIC / "C_wide.csv", axis="C")
    evaluation = evaluate_positioning(found.runs)
    assert {q.unit for q in evaluation.quantities} == {"°"}
    assert 3600 * evaluation["E"].value == pytest.approx(4.1 + 5.2)
    assert 3600 * evaluation["B"].value == pytest.approx(1.6)  # at 181.3°: 1.0 + 0.6
    assert 3600 * evaluation["E_up"].value == pytest.approx(4.1 + 3.7)


def test_a_real_axis_has_the_published_figures_and_the_published_wrong_range_is_named():
    """Figures of the source's README; its own report printed 0.06514 for E, the largest mean down to the smallest mean up."""
    path = reference_file("real/iso230_2_runs.csv")
    [found] = read_positioning(path, axis="X")
    evaluation = evaluate_positioning(found.runs)
    expected = {"E": 0.074772, "A": 0.204759, "R": 0.204759, "B": 0.043459}
    assert {k: evaluation[k].value for k in expected} == pytest.approx(expected, abs=5e-7)
    assert max(mixed_ranges(evaluation.details.statistics)) == pytest.approx(0.06514, abs=5e-6)
    assert any("65.14 µm, which is not E" in remark for remark in evaluation.remarks)
    assert any("target 15 approached in +: approach 1 lies +114.5 µm" in remark for remark in evaluation.remarks)
    rows = list(csv.DictReader(path.open()))
    assert found.runs.deviations[0, 0, 0] == pytest.approx(float(rows[0]["actual"]) - 15.0, abs=1e-9)


def test_the_mixed_range_is_not_named_where_it_is_e():
    runs = from_means("X", np.array([0.0, 70.0]), {1: np.array([0.0, 5e-3]), -1: np.array([-1e-3, 4e-3])})
    assert values(runs)["E"] == pytest.approx(6e-3)
    assert not any("not E" in remark for remark in evaluate_positioning(runs).remarks)


@pytest.mark.parametrize(("way", "kept"), [(0, "up"), (1, "down")])
def test_a_test_in_one_direction_has_no_quantities_of_both(way, kept):
    runs = some_runs(3)
    alone = runs.deviations.copy()
    alone[:, 1 - way] = np.nan
    found, whole = values(replace(runs, deviations=alone)), values(runs)
    assert set(found) == {f"E_{kept}", f"A_{kept}", f"R_{kept}"}
    assert all(found[name] == pytest.approx(whole[name], abs=ROUNDING) for name in found)


def test_of_means_alone_the_scatter_is_not_determined():
    found = values(from_means("X", np.array([0.0, 50.0]), {1: np.array([0.0, 2e-3]), -1: np.array([1e-3, 4e-3])}))
    assert set(found) == {"E", "E_up", "E_down", "M", "B", "B_mean"}
    assert found["B_mean"] == pytest.approx(-1.5e-3)  # up less down


def test_one_target_with_a_single_approach_leaves_a_and_r_of_its_direction_open():
    runs = some_runs(4)
    gaps = runs.deviations.copy()
    gaps[2, 0, 1:] = np.nan
    found = values(replace(runs, deviations=gaps))
    assert {"A", "A_up", "R", "R_up"} & set(found) == set()
    assert {"E", "A_down", "R_down", "B"} < set(found)


def test_a_target_approached_in_one_direction_only_still_counts_for_e_and_r():
    runs = some_runs(5)
    gaps = runs.deviations.copy()
    gaps[1, 1], gaps[1, 0] = np.nan, [0.1, 0.1, 0.1, 0.1, 0.14]
    found = values(replace(runs, deviations=gaps))
    assert found["R"] == pytest.approx(4 * 0.04 / sqrt(5))
    assert found["E"] == pytest.approx(0.108 - np.nanmin(np.nanmean(np.delete(gaps, 1, axis=0), axis=2)))
    assert found["B"] < 0.05  # of the others


@pytest.mark.parametrize("seed", range(20))
def test_quantities_change_by_no_more_than_the_quantity_of_the_change(seed):
    """Each but B_mean is a seminorm of the deviations: |Q(x + n) - Q(x)| <= Q(n), Q(c x) = |c| Q(x), Q(x + constant) = Q(x)."""
    x, n = some_runs(seed).deviations, some_runs(seed + 100, size=0.3).deviations
    of = [quantities_of(statistics_of(d)) for d in (x, x + n, n, -2.0 * x, x + 0.7)]
    for name in of[0]:
        if name != "B_mean":
            before, after, change, scaled, shifted = (float(q[name]) for q in of)
            assert abs(after - before) <= change + ROUNDING, name
            assert scaled == pytest.approx(2.0 * before, abs=ROUNDING), name
            assert shifted == pytest.approx(before, abs=ROUNDING), name


def test_approaches_in_any_order_give_the_same_runs():
    runs = some_runs(6)
    i, way, j = (k.ravel() for k in np.indices(runs.deviations.shape))
    order = np.random.default_rng(1).permutation(len(i))
    i, way, j = i[order], way[order], j[order]
    given = Approaches(
        runs.targets[i], np.where(way == 0, 1, -1), [f"r{k}" for k in j], runs.deviations[i, way, j], [""] * len(i)
    )
    assert values(arranged("X", given)) == pytest.approx(values(runs), abs=ROUNDING)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"targets": np.array([0.0, 0.0, 10.0])}, "rising"),
        ({"targets": np.array([0.0])}, "shape"),
        ({"deviations": np.full((3, 2, 5), np.nan)}, "target 0 was never approached"),
    ],
)
def test_runs_that_cannot_be_evaluated_are_refused(changes, message):
    with pytest.raises(InputError, match=message):
        PositioningRuns(
            **{"axis": "X", "targets": np.array([0.0, 5.0, 10.0]), "deviations": np.zeros((3, 2, 5)), **changes}
        )


def test_an_approach_that_stands_twice_or_has_no_direction_is_refused():
    given = Approaches(np.array([0.0, 0.0]), np.array([1.0, 1.0]), ["1", "1"], np.zeros(2), ["f, row 2", "f, row 3"])
    with pytest.raises(
        InputError, match="f, row 3: target 0 approached in \\+1 stands a second time in run 1, after f, row 2"
    ):
        arranged("X", given)
    with pytest.raises(InputError, match="f, row 2: the direction of approach is 0"):
        arranged("X", given._replace(direction=np.zeros(2)))
