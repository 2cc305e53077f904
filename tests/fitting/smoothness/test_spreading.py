"""Where readings are moved to before it is decided what they determine: between levels, on their diagonal, on their line."""

from dataclasses import replace

import numpy as np
import pytest
from exact_chain import ExactMachine
from support.kinds import plan_set
from support.machines import volid_machine

from volid.campaign import Campaign, End
from volid.fitting.smoothness.spreading import spread_out

MACHINE = volid_machine(ExactMachine("w b X Y Z t", {"X": (0.0, 1000.0), "Y": (0.0, 600.0), "Z": (-500.0, 0.0)}), "")
LOW, HIGH = np.array([[0.0, 0.0, -500.0], [1000.0, 600.0, 0.0]])
TOOL = (0.0, 0.0, -150.0)


def moved(q, kind="distance", labels=None, to=None, unknowns=10):
    s = plan_set("own", kind, np.asarray(q, dtype=float), TOOL, labels or {"station": "S1"})
    s = s if to is None else replace(s, to=End(to, np.zeros_like(to), s.tool))
    return spread_out(Campaign(MACHINE, sets=(s,)), unknowns).sets[0]


def diagonal(n=11, signs=(1, 1, 1)):
    t = np.linspace(0.0, 1.0, n)[:, None]
    low, high = np.where(np.array(signs) > 0, LOW, HIGH), np.where(np.array(signs) > 0, HIGH, LOW)
    return low + t * (high - low)


def off_line(q, low, high):
    """Distance from the line through two places."""
    along = (high - low) / np.linalg.norm(high - low)
    way = q - low
    return np.linalg.norm(way - np.outer(way @ along, along), axis=1)


@pytest.mark.parametrize("unknowns", [2, 10, 1000])
def test_a_diagonal_stays_on_its_line_and_fills_it(unknowns):
    found = moved(diagonal(), unknowns=unknowns).positions
    assert off_line(found, LOW, HIGH).max() < 1e-9
    if unknowns == 1000:  # repeated: every part of the line is met
        assert np.diff(np.sort(found[:, 0])).max() < 50.0


def test_four_diagonals_that_cross_stay_on_their_lines():
    signs = [(1, 1, 1), (-1, 1, 1), (1, -1, 1), (1, 1, -1)]
    q = np.concatenate([diagonal(12, s) for s in signs])  # an even number: none in the crossing
    found = moved(q).positions
    ends = [(np.where(np.array(s) > 0, LOW, HIGH), np.where(np.array(s) > 0, HIGH, LOW)) for s in signs]
    off = np.min([off_line(found, low, high) for low, high in ends], axis=0)
    assert off.max() < 1e-9


def test_a_grid_of_few_levels_spreads_between_them_in_every_axis():
    levels = [np.linspace(low, high, n) for low, high, n in zip(LOW, HIGH, (11, 3, 4), strict=True)]
    q = np.stack(np.meshgrid(*levels, indexing="ij"), axis=-1).reshape(-1, 3)
    found = moved(q, unknowns=200).positions
    for i, known in enumerate(levels):
        step = known[1] - known[0]
        share = np.sort(((found[:, i] - LOW[i]) / step) % 1.0)
        assert np.diff(share).max() < 0.2, "no part between levels is left out"
    assert (found >= LOW).all() and (found <= HIGH).all()


def test_lines_of_components_do_not_mix_and_axes_that_stand_still_do_so():
    q = np.tile([500.0, 300.0, -250.0], (22, 1))
    q[:11, 0], q[11:, 0], q[11:, 2] = np.linspace(0, 1000, 11), np.linspace(0, 1000, 11), -100.0
    found = moved(q, "component", {"component": "Y", "line": np.repeat(["a", "b"], 11)}, unknowns=100)
    own = found.labels["line"] == "a"
    for line in (own, ~own):
        assert np.ptp(found.positions[line, 1:], axis=0).max() == 0.0
    assert np.ptp(found.positions[:, 1]) == 0.0, "Y was nowhere else"
    assert len(np.unique(found.positions[own, 0])) > 100


def test_lengths_move_along_their_own_lines():
    first, second = diagonal(9)[:1].repeat(8, axis=0), diagonal(9)[1:]
    found = moved(first, "length", {"artefact": "gauge"}, to=second, unknowns=100)
    assert off_line(found.positions, LOW, HIGH).max() < 1e-9 and off_line(found.to.positions, LOW, HIGH).max() < 1e-9
    assert np.all(np.linalg.norm(found.to.positions - found.positions, axis=1) > 1.0)


def test_the_same_is_moved_to_the_same():
    q = diagonal() + np.random.default_rng(1).normal(size=(11, 3))
    np.testing.assert_array_equal(moved(q).positions, moved(q).positions)
