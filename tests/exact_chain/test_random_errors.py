"""Random errors obey the datum of CONVENTIONS 4 and have the size of those of good machines."""

import numpy as np
import pytest

from exact_chain import (
    COMPONENTS,
    LINEAR,
    ROTARY,
    ExactMachine,
    random_truth,
)
from exact_chain.checks import TRAVEL


@pytest.mark.parametrize("seed", range(5))
def test_random_truth_of_linear_axes_is_in_the_datum(seed):
    machine = ExactMachine("w Y' X' b Z t", TRAVEL, reference={"Z": -100.0})
    truth = random_truth(machine, np.random.default_rng(seed), reversal=True)
    assert set(truth.functions) == {c + a for c in COMPONENTS for a in LINEAR}
    assert set(truth.constants) == {"EC0Y", "EB0Z", "EA0Z", "EA0S", "EB0S", "EC0S"}
    assert set(truth.reversal) == {"EXX", "EYY", "EZZ"}
    for name, f in truth.functions.items():
        axis = name[2]
        low, high = machine.travel[axis]
        q = low + (high - low) * (np.arange(20000) + 0.5) / 20000  # midpoints: the mean is the integral to 1 / 20000^2
        assert abs(f(machine.reference[axis])) < 1e-15
        slope, largest = np.polyfit(q, f(q), 1)[0], np.abs(f(q)).max()
        if name[1] in ROTARY:
            assert 9.9e-6 < largest < 30.1e-6
        elif name[1] == axis:
            assert 1e-7 < abs(slope) < 31e-6
        else:
            assert abs(slope) * (high - low) < 1e-9  # mm
            assert 2.9e-3 < largest < 15.1e-3


def test_random_truth_amplitude_and_waviness():
    machine = ExactMachine("w b X t", {"X": (0.0, 1000.0)})
    plain, double, wavy = (
        random_truth(machine, np.random.default_rng(3), **options)
        for options in ({}, {"scale": 2.0}, {"waviness": 3.0})
    )
    q = np.linspace(0, 1000, 301)
    for name, f in plain.functions.items():
        np.testing.assert_allclose(double.functions[name](q), 2 * f(q), rtol=1e-12, atol=1e-18)
        assert f.frequency.max() * 1000 <= 1 / 0.45
        np.testing.assert_allclose(wavy.functions[name].frequency, 3 * f.frequency)
    assert double.constants["EA0S"] == pytest.approx(2 * plain.constants["EA0S"])


def test_random_truth_of_another_datum():
    machine = ExactMachine("w Y' X' b Z t", TRAVEL)
    truth = random_truth(machine, np.random.default_rng(0), primary="Z", secondary="X", tool_rotation=False)
    assert set(truth.constants) == {"EB0X", "EA0Y", "EC0Y"}
    assert all(20e-6 <= abs(v) <= 40e-6 for v in truth.constants.values())


def test_random_cross_effect_is_zero_at_both_references():
    machine = ExactMachine("w Y' X' b Z t", TRAVEL)
    truth = random_truth(machine, np.random.default_rng(0), cross={"EAZ": "X"})
    other, f = truth.cross["EAZ"]
    z, x = np.linspace(-500, 0, 11), np.linspace(0, 1000, 11)
    assert other == "X"
    np.testing.assert_allclose(f(np.full(11, -250.0), x), 0, atol=1e-18)
    np.testing.assert_allclose(f(z, np.full(11, 500.0)), 0, atol=1e-18)
    assert np.abs(f(z[:, None], x[None, :])).max() > 1e-6


@pytest.mark.parametrize(("structure", "turn"), [("w C' A' b t", -1), ("w b C A t", +1)])
def test_random_truth_of_rotary_axes_is_in_the_datum(structure, turn):
    machine = ExactMachine(structure, TRAVEL, direction={"C": (0, 0, -1)})
    truth = random_truth(machine, np.random.default_rng(4))
    assert {n for n in truth.constants if n[3] in "AC"} == {
        "EX0C", "EY0C", "EA0C", "EB0C", "EY0A", "EZ0A", "EB0A", "EC0A",
    }  # fmt: skip
    for axis, way, (first, second) in (("C", -1, "XY"), ("A", 1, "YZ")):
        q = np.linspace(*machine.travel[axis], 20001)
        angle = way * turn * np.deg2rad(q)
        for pair in (first + second, "".join(ROTARY[LINEAR.index(a)] for a in first + second)):
            f, g = (truth.functions[f"E{letter}{axis}"](q) for letter in pair)
            size = np.abs(np.concatenate([f, g])).max()
            low, high = (0.002, 0.008) if pair[0] in LINEAR else (10e-6, 30e-6)
            assert 0.99 * low < size < 1.01 * high
            co_rotating = [f * np.cos(angle) + g * np.sin(angle), -f * np.sin(angle) + g * np.cos(angle)]
            for moment in (f, g, *co_rotating):
                assert abs(np.trapezoid(moment, q)) / np.ptp(q) < 1e-4 * size
            counter = np.hypot(
                np.mean(f * np.cos(angle) - g * np.sin(angle)), np.mean(f * np.sin(angle) + g * np.cos(angle))
            )
            assert counter > 1e-2 * size  # these stay
        assert abs(truth.functions["E" + axis + axis](0.0)) < 1e-15
