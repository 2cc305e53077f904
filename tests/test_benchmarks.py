"""What the benchmarks say of their numbers: ratios, regressions, table. No time is asserted."""

import inspect
import re
from importlib import import_module

import numpy as np
import pytest
from support.places import ROOT

from benchmarks import measure
from benchmarks.__main__ import NAMES, compare, table
from benchmarks.measure import interleaved, row
from volid.backend.even_points import even_points, radical_inverse
from volid.compensation.grids.interpolation import interpolate


def line(ratio=6.0, share=0.5):
    times = {
        "volid": np.array([1.0, 2.0, 3.0]),
        "peer": ratio * np.array([1.0, 2.0, 3.0]),
        "bound": share * np.array([1.0, 2.0, 3.0]),
    }
    return row("case", times, "bound").as_json() | {"name": "fit-S", "load": {"before": [0.0], "after": [0.0]}}


def test_ratios_are_taken_round_by_round():
    found = line()
    assert found["ratios"] == {"peer": (6.0, 6.0, 6.0)}
    assert found["share_of_limit"] == 0.5 and found["volid"] == 2.0


def test_contestants_take_turns(monkeypatch):
    monkeypatch.setattr(measure, "TURN", 0.0)
    order = []
    times = interleaved({"a": lambda: order.append("a"), "b": lambda: order.append("b")}, 3)
    assert order == ["a", "b"] * 4 and all(len(t) == 3 for t in times.values())


def test_quick_contestants_run_several_times_in_a_turn(monkeypatch):
    clock, order = [0.0], []
    monkeypatch.setattr(measure, "TURN", 0.1)
    monkeypatch.setattr(measure.time, "perf_counter", lambda: clock[0])

    def contestant(name, seconds):
        def run():
            order.append(name)
            clock[0] += seconds

        return run

    times = interleaved({"a": contestant("a", 0.03), "b": contestant("b", 0.2)}, 1)
    assert order == ["a", "a", "a", "a", "b"] * 2
    assert times["a"][0] == pytest.approx(0.03) and times["b"][0] == pytest.approx(0.2)


def test_a_regression_is_named_and_a_difference_within_the_noise_is_not():
    assert compare([line()], [line()]) == []
    assert compare([line(5.0)], [line(6.0)]) == []
    (slower,) = compare([line(3.0)], [line(6.0)])
    assert slower == "case: 3.00 x peer, 6.00 x in the baseline"
    (further,) = compare([line(share=0.2)], [line(share=0.5)])
    assert further == "case: 20 % of the limit, 50 % in the baseline"
    (failed,) = compare([{"case": "case", "failed": "no memory"}], [line()])
    assert failed == "case: failed, no memory"


def test_the_table_names_every_peer_and_failure():
    text = table([line(), {"case": "L", "failed": "no memory"}])
    assert "peer" in text and "6.00 x (6.00 … 6.00)" in text and "50 % reached" in text
    assert "L: FAILED, no memory" in text
    assert len(set(NAMES)) == len(NAMES)


def test_linear_interpolation_is_exact_for_a_multilinear_function():
    rng = np.random.default_rng(0)
    nodes = (np.array([0.0, 1.0, 3.0]), np.array([-1.0, 0.5]), np.array([2.0, 2.5, 4.0, 8.0]))
    x, y, z = np.meshgrid(*nodes, indexing="ij")
    table_of = np.stack([1 + x * y * z - y, x + z], axis=-1)
    at = np.stack([rng.uniform(n[0], n[-1], 200) for n in nodes], axis=1)
    at[0] = [3.0, 0.5, 8.0]
    # multilinear within a cell, and this function is so in every cell
    expected = np.stack([1 + at.prod(axis=1) - at[:, 1], at[:, 0] + at[:, 2]], axis=1)
    np.testing.assert_allclose(interpolate(nodes, table_of, at), expected, rtol=1e-12, atol=1e-12)


def test_even_points_fill_the_cube_more_evenly_than_chance():
    np.testing.assert_array_equal(radical_inverse(np.array([1, 2, 3, 6]), 2), [0.5, 0.25, 0.75, 0.375])
    points = even_points(512, 3, seed=3)
    assert points.min() >= 0.0 and points.max() < 1.0
    counts = np.histogramdd(points, bins=4, range=[(0, 1)] * 3)[0]
    assert np.abs(counts - 8).max() <= 4  # chance: standard deviation 2.8, largest of 64 about 8
    assert not np.array_equal(points, even_points(512, 3, seed=4))


def documented():
    """Modules that `python -m` runs on the pages: figures nobody can repeat are none."""
    pages = [ROOT / "docs" / "validation.md", ROOT / "benchmarks" / "README.md", ROOT / "CONTRIBUTING.md"]
    texts = "".join(p.read_text(encoding="utf-8") for p in pages)
    return sorted(set(re.findall(r"python -m (benchmarks\.\w+)", texts)))


@pytest.mark.parametrize("name", documented())
def test_what_the_pages_run_can_be_run(name):
    assert '__name__ == "__main__"' in inspect.getsource(import_module(name))
