"""What a positioning test breaks of the standard's rules."""

import numpy as np
import pytest

from volid.standards.positioning.rules import attention, rules, wanted_targets
from volid.standards.positioning.runs import PositioningRuns


def runs(targets, n=5, unit="mm", **known):
    targets = np.array(targets, dtype=float)
    noise = 1e-3 * np.random.default_rng(0).standard_normal((len(targets), 2, n))
    return PositioningRuns("C" if unit == "°" else "X", targets, noise, unit, **known)


def uneven(length, count):
    """Targets whose steps differ, over exactly `length`."""
    return (
        length
        * (np.arange(count) + 0.1 * np.sin(3.0 * np.arange(count)) * (np.arange(count) % (count - 1) > 0))
        / (count - 1)
    )


@pytest.mark.parametrize(
    ("length", "unit", "count"),
    [
        (300.0, "mm", 5), (1000.0, "mm", 5), (1001.0, "mm", 6), (2000.0, "mm", 10), (4000.0, "mm", 16),
        (90.0, "°", 3), (91.0, "°", 5), (180.0, "°", 5), (181.0, "°", 8), (360.0, "°", 8),
    ],
)  # fmt: skip
def test_number_of_targets(length, unit, count):
    """5 per metre and 5 in all; about 250 mm apart above 2000 mm; 3, 5, 8 of a rotary axis."""
    assert wanted_targets(runs(uneven(length, count), unit=unit))[0] == count
    assert rules(runs(uneven(length, count), unit=unit)) == ()
    if count > 3:
        assert any("asks for at least" in said for said in rules(runs(uneven(length, count - 1), unit=unit)))


def test_recalled_rules_say_so():
    assert all(
        "recalled" in wanted_targets(runs(uneven(*case[:2]), unit=case[2]))[1]
        for case in ((3000.0, 12, "mm"), (90.0, 3, "°"))
    )
    assert "recalled" not in wanted_targets(runs(uneven(900.0, 5)))[1]


def test_equal_steps_are_named_with_their_length():
    assert any("all targets are 50 mm apart" in said for said in rules(runs(np.arange(0.0, 501.0, 50.0))))
    moved = np.arange(0.0, 501.0, 50.0) + np.array([0.0, 3.0] * 5 + [0.0])
    assert rules(runs(moved)) == ()


def test_too_few_approaches_are_named_where_they_are():
    short = runs(uneven(400.0, 6))
    short.deviations[3, 1, 2:] = np.nan
    [said] = rules(short)
    assert said.startswith(f"target {short.targets[3]:g} has 2 approaches in a direction; ISO 230-2 asks for 5")
    assert any(
        "every target has one approach" in said and "not determined" in said
        for said in rules(runs(uneven(400.0, 6), n=1))
    )


def test_the_part_of_the_travel_is_told():
    assert any("cover 50 % of the travel of X" in said for said in rules(runs(uneven(400.0, 6), travel=(0.0, 800.0))))
    assert rules(runs(uneven(400.0, 6), travel=(0.0, 410.0))) == ()


def test_a_stray_approach_is_named_and_chance_is_not():
    """Of 400 tests with normal scatter none: 6 standard deviations in 110 approaches are 2e-7, and s is known to 10 %."""
    rng = np.random.default_rng(2)
    named = 0
    for _ in range(400):
        noise = 1e-3 * rng.standard_normal((11, 2, 5))
        named += sum("lies" in said for said in rules(PositioningRuns("X", uneven(1000.0, 11), noise)))
    assert named == 0
    noise[4, 1, 2] += 0.05
    [said] = rules(PositioningRuns("X", uneven(1000.0, 11), noise))
    assert "approached in -: approach 3 lies +" in said and "counts all the same" in said


def test_runs_that_are_copies_of_each_other_need_attention():
    copies = runs(uneven(400.0, 6))
    copies.deviations[...] = copies.deviations[:, :, :1]
    assert "R is 0" in attention(copies)[0]
    assert attention(runs(uneven(400.0, 6))) == () == attention(runs(uneven(400.0, 6), n=1))


def test_a_whole_turn_displayed_as_0_is_named():
    """Targets 0, 90, … 360° with a drift of 10 mdeg per turn: under 0 stand two targets."""
    targets = np.array([0.0, 90.0, 180.0, 270.0])
    deviations = np.full((4, 2, 10), np.nan)
    deviations[:, :, :5] = (
        1e-4 * np.random.default_rng(1).standard_normal((4, 2, 5)) + (0.01 * targets / 360.0)[:, None, None]
    )
    assert not attention(PositioningRuns("C", targets, deviations, "°"))
    deviations[0, :, 5:] = 0.01
    (said,) = attention(PositioningRuns("C", targets, deviations, "°"))
    assert "target 0 was approached twice as often" in said and "write 360" in said
    assert not attention(PositioningRuns("X", targets, deviations, "mm"))
