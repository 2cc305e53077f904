"""Dots of many values: none of the largest is lost, those beyond the frame are marked, the worst are numbered."""

import numpy as np
import pytest

from volid.report.plot.dots import LEAST, Marked, draw_dots, frame_of, near_each_other, thinned
from volid.report.plot.panels import figure_with_panels


@pytest.mark.parametrize("n", [10, 5000, 100_000])
@pytest.mark.parametrize("most", [400, 2000])
def test_thinning_keeps_the_largest_and_samples_the_others_evenly(n, most):
    values = np.random.default_rng(n).standard_t(3, n)
    kept = thinned(values, most)
    assert len(kept) == min(n, most) and np.all(np.diff(kept) > 0)
    largest = np.argsort(-np.abs(values))[: most // 4]
    assert set(largest[: len(values)]) <= set(kept.tolist())
    if n > most:  # no stretch of the readings is without dots
        assert np.diff(np.concatenate([[0], kept, [n - 1]])).max() <= 2 * n / (0.75 * most) + 1


def test_one_gross_error_does_not_press_the_others_flat():
    values = np.random.default_rng(1).standard_normal(1000)
    quiet = frame_of(values)
    assert LEAST <= quiet < 5.0
    assert frame_of(np.append(values, 1e4)) < 10.0  # eight robust standard deviations of 1
    assert frame_of(60.0 * values) > 60.0 * 4.0  # where all are large, the frame follows


def test_every_value_is_drawn_inside_or_at_the_edge_and_none_twice():
    values = np.array([0.0, 1.0, -2.0, 9.0, -9.0, 3.0, 0.5])
    struck, idle = np.arange(7) == 5, np.arange(7) == 0
    _, panel = figure_with_panels()
    draw_dots(panel, Marked(np.arange(7.0), values, struck, idle, np.array([3, 4])), 4.0)
    drawn = {}
    for line in panel.get_lines():
        drawn.setdefault(line.get_gid(), []).extend(line.get_xydata().tolist())
    assert drawn["readings"] == [[1.0, 1.0], [2.0, -2.0], [6.0, 0.5]]
    assert drawn["set aside"] == [[5.0, 3.0]]
    assert drawn["idle"] == [[0.0, 0.0]]
    assert [(x, np.sign(y)) for x, y in drawn["beyond"]] == [(3.0, 1.0), (4.0, -1.0)]
    assert [t.get_text() for t in panel.texts] == ["1", "2"]


def test_numbers_near_to_each_other_share_one_text():
    assert near_each_other(np.array([[0.0, 0.0], [0.5, 0.5], [0.01, 0.0]]), near=0.05) == [[0, 2], [1]]
