"""Increments: their running sum never leaves the curve by more than half a quantum."""

import numpy as np
import pytest

from volid.controllers.tables.increments import increments
from volid.exceptions import InputError


def curves():
    """Tables of many lengths: smooth, rough, steep, exactly between two quanta, negative, of one sign."""
    rng = np.random.default_rng(7)
    for n in (2, 3, 20, 127, 1500):
        x = np.linspace(0.0, 1.0, n)
        yield 3.0 * np.sin(9.0 * x) + rng.normal(scale=0.2, size=n)
        yield np.cumsum(rng.normal(scale=2.0, size=n))
        yield np.cumsum(np.full(n, 0.5))
        yield -np.cumsum(np.full(n, 1.5))
        yield np.cumsum(np.full(n, 0.49))
        yield np.cumsum(rng.integers(-3, 4, size=n) / 2.0)


@pytest.mark.parametrize("quantum", [1.0, 0.001, 0.0001, 2.5e-5, np.deg2rad(0.001)])
def test_the_sum_stays_within_half_a_quantum(quantum):
    for wanted in curves():
        values = quantum * wanted
        found = increments(values, quantum)
        steps = found.steps
        assert steps.dtype == np.int64
        running = quantum * (round(values[0] / quantum) + np.concatenate([[0], np.cumsum(steps)]))
        assert np.abs(running - values).max() <= 0.5 * quantum * (1 + 1e-9)
        assert found.loss == pytest.approx(np.abs(running - values).max(), abs=1e-9 * quantum)


def test_rounding_each_increment_would_add_up():
    """What this is for: 0.49 quanta per interval are lost one by one, and kept on the running sum."""
    values = 0.49 * np.arange(1501)
    assert np.rint(np.diff(values)).sum() == 0
    assert increments(values, 1.0).steps.sum() == 735


def test_what_is_more_than_the_limit_is_carried_and_named():
    found = increments(np.array([0.0, 10.0, 10.0, 10.0]), 1.0, limit=7)
    assert found.steps.tolist() == [7, 3, 0]
    assert (found.loss, found.carried) == (3.0, (0,))


def test_it_is_carried_outwards_from_the_reference():
    values = np.array([-10.0, -10.0, 0.0, 10.0, 10.0])
    found = increments(values, 1.0, reference=2, limit=7)
    assert found.held.tolist() == [-10, -7, 0, 7, 10]


def test_the_limit_holds_in_any_table():
    rng = np.random.default_rng(3)
    for _ in range(50):
        values = np.concatenate([np.cumsum(rng.normal(scale=4.0, size=60)), np.zeros(60)])
        reference = int(rng.integers(0, 40))
        try:
            found = increments(values, 1.0, reference=reference, limit=7)
        except InputError as error:
            assert "are left at its first position" in str(error)
            continue
        assert np.abs(found.steps).max() <= 7
        if not found.carried:
            assert found.loss <= 0.5


def test_what_does_not_fit_is_refused():
    with pytest.raises(
        InputError, match=r"table of X: 13 steps of the control are left at its last position.*at most 7"
    ):
        increments(np.array([0.0, 10.0, 20.0, 34.0]), 1.0, limit=7, what="table of X")


def test_a_turn_adds_up_to_nothing():
    angle = np.linspace(0.0, 2.0 * np.pi, 73)
    for phase in np.linspace(0.0, 6.0, 25):
        values = 3.3 * (np.sin(angle + phase) - np.sin(phase))
        values[-1] += 1e-9  # as a computation closes it
        assert increments(values, 0.7, closed=True).steps.sum() == 0


def test_a_turn_that_does_not_close_is_refused():
    with pytest.raises(InputError, match=r"table of C: .*differ by 3 steps of the control.*must add up to 0"):
        increments(np.array([0.0, 1.0, 3.0]), 1.0, closed=True, what="table of C")
