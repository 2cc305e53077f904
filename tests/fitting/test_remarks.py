"""Remarks a careful colleague would make: they appear when they should, and not on sound campaigns."""

import re
from dataclasses import replace

import numpy as np
import pytest
from exact_chain import random_truth
from support.machines import STRUCTURES, exact_machine, volid_machine
from support.places import DATASETS
from support.rtests import NOISE, SPHERES, TOOLS, displacement, following, index_grid, rotary_only

import volid
from volid.campaign import Campaign, ObservationSet
from volid.fitting.linear_trial import trial_of
from volid.fitting.remarks import remarks
from volid.fitting.sensor_remarks import in_the_nest
from volid.model.kinematics import nominal_point

NO_LINEAR = '[model.functions]\n"E?[XYZ]" = false\n"E?0[XYZ]" = false\n'
ONE_TOOL = (TOOLS[0],) * 3
CANNOT, BETTER, TILT = (
    "cannot be told from the data",
    "fit better when they are negated",
    "the tilt of the head is known only",
)


def measured(layout, *, off=(0.0, 0.0, 0.0), tools=TOOLS, aside=0.0, sign=1.0, seed=1):
    """An R-test of the exact chain; the axes follow places that are `off`, every fifth position with X moved `aside` [mm]."""
    exact, rng = exact_machine(STRUCTURES[layout]), np.random.default_rng(seed)
    truth = rotary_only(random_truth(exact, rng), "ABCS")
    grid, parts = index_grid(exact, {"A": 7, "B": 7, "C": 13}), []
    for place, tool in zip(SPHERES.values(), tools, strict=True):
        q = following(exact, grid, np.tile(np.asarray(tool), (len(grid), 1)), np.add(place, off))
        q[::5, exact.column("X")] += aside
        d = displacement(exact, q, np.asarray(tool), place, truth)
        parts.append((q, np.tile(np.asarray(tool), (len(q), 1)), d + NOISE * rng.standard_normal(d.shape)))
    q, tool, d = (np.concatenate(column) for column in zip(*parts, strict=True))
    names = np.repeat(list(SPHERES), len(grid))
    options = {"sensor_on": "tool", "sphere": {n: list(p) for n, p in SPHERES.items()}}
    options |= {"nest_u": 0.0, "rotation_u": 0.0, "scale_u": 0.0, "range": 3.0}
    readings = ObservationSet(
        "R-test", "displacement", q, np.zeros_like(q), tool, sign * d, np.full_like(d, NOISE), {"sphere": names},
        options=options,
    )  # fmt: skip
    return Campaign(volid_machine(exact, NO_LINEAR), (), (readings,))


@pytest.mark.parametrize("name", ["five_axis_rtest", "published_positioning", "vertical_multilateration"])
def test_sound_datasets_have_none(name):
    solution = volid.fit(volid.load_campaign(DATASETS / name / "campaign.toml"))
    assert remarks(solution) == ()
    assert not any(text in note for note in solution.notes for text in (CANNOT, BETTER, TILT, "mistaken?"))


# ---------------------------------------------------------------------------------------------------- too large by far


@pytest.mark.parametrize(("length", "said"), [(1.0, True), (0.1, False)])
def test_a_mistaken_tool_length_shows_as_a_location_error(length, said):
    """The nest is 1 mm higher than stated: seen from it, the line of A, about which the table swings, is 1 mm lower or higher."""
    campaign = volid.load_campaign(DATASETS / "five_axis_rtest" / "campaign.toml")
    (readings,) = campaign.sets
    wrong = replace(readings, tool=readings.tool - [0.0, 0.0, length])
    solution = volid.fit(replace(campaign, sets=(wrong,)))
    found = [note for note in solution.notes if "mistaken?" in note]
    assert bool(found) == said
    assert abs(solution.location("EZ0A").value) == pytest.approx(length, abs=0.03)  # the true error is 18 µm
    if said:
        (note,) = found
        value, expanded = re.search(r"EZ0A = (\S+) mm \(U = (\S+) µm\)", note).groups()
        assert abs(float(value)) == pytest.approx(length, abs=0.03) and float(expanded) < 0.2
        assert "tool length, the place of a sphere or station, or `point` of [axis.A] mistaken?" in note
        assert "EY0A" not in note and "axis.C" not in note  # what is as usual is not named


def test_what_is_large_but_not_known_is_no_remark():
    """1 mm with U = 2 mm says nothing."""
    campaign = volid.load_campaign(DATASETS / "five_axis_rtest" / "campaign.toml")
    (readings,) = campaign.sets
    solution = volid.fit(replace(campaign, sets=(replace(readings, tool=readings.tool - [0.0, 0.0, 1.0]),)))
    vague = replace(solution, covariance=np.asarray(solution.covariance) * 1e10)
    assert "mistaken?" in remarks(solution)[0]
    assert not any("mistaken?" in note for note in remarks(vague))


# ---------------------------------------------------------------------------------------------------------------- sign


def test_readings_whose_sign_nothing_tells_are_named():
    solution = volid.fit(measured("tilting table C'A'"))
    (note,) = [n for n in solution.notes if CANNOT in n]
    assert "set 'R-test'" in note and "moved aside by 0.05 mm" in note
    trial = trial_of(solution)
    assert trial.chi_square([0]) == pytest.approx(trial.chi_square(), rel=1e-3)
    assert 0.9 < trial.chi_square() / trial.degrees_of_freedom < 1.15  # of readings with normal noise of the stated u
    known = replace(solution, options={**solution.options, "prior": True})
    assert not any(CANNOT in n for n in remarks(known))


def test_positions_aside_tell_the_sign_and_find_negated_readings():
    right, wrong = (volid.fit(measured("tilting table C'A'", aside=0.05, sign=s)) for s in (1.0, -1.0))
    assert not any(CANNOT in n or BETTER in n for n in right.notes)
    (note,) = [n for n in wrong.notes if BETTER in n]
    assert "does the sensor give the nest relative to the sphere?" in note and "set 'R-test'" in note
    better, worse = (float(v) for v in re.search(r"unit weight (\S+) instead of (\S+) in", note).groups())
    # 2 · 50 µm in one of three coordinates at every fifth position, u = 0.5 µm: 200 / sqrt(21) = 44
    assert better == pytest.approx(1.0, abs=0.1) and worse == pytest.approx(52.0, rel=0.1)
    assert wrong.adequacy.rejected and not right.adequacy.rejected


# ---------------------------------------------------------------------------------------------------------------- tilt


SPINDLE_TILTS = {"EA0S", "EB0S", "EC0S"}


def with_value(solution):
    return {n for n in SPINDLE_TILTS if np.isfinite(solution.location(n).value)}


@pytest.mark.parametrize("layout", ["fork head CB", "table and head"])
def test_a_tilt_that_only_the_deflection_shows_is_named(layout):
    off = (0.6, -0.5, 0.4)  # mm: the sphere never stands in the nest
    solution = volid.fit(measured(layout, off=off, tools=ONE_TOOL))
    (note,) = [n for n in solution.notes if TILT in n]
    names = note.split(":")[0].split(", ")
    assert "EA0S" in names and all(n[1] in "ABC" for n in names)
    assert with_value(solution) <= set(names)
    assert "one tool vector, (0, 0, -150) mm" in note and "second tool length" in note
    largest = float(re.search(r"up to (\S+) mm", note).group(1))
    assert largest == pytest.approx(np.linalg.norm(off), abs=0.2)
    # 0.5 µm over 0.9 mm, over the root of some hundred readings: ten times and more what a lever arm of 60 mm gives
    several = volid.fit(measured(layout, off=off))
    assert solution.location("EA0S").u > 10.0 * several.location("EA0S").u
    assert not any(TILT in n for n in several.notes) and with_value(several) == SPINDLE_TILTS


@pytest.mark.parametrize("layout", ["fork head CB", "table and head"])
def test_with_one_tool_a_tilt_has_no_value_or_the_remark(layout):
    """Spheres in the nest: some hundredths of a mm may be enough to call a tilt determined, but nobody must take it for known."""
    solution = volid.fit(measured(layout, tools=ONE_TOOL))
    said = {name for n in solution.notes if TILT in n for name in n.split(":")[0].split(", ")}
    assert with_value(solution) <= said


def test_a_table_has_no_such_tilt():
    solution = volid.fit(measured("tilting table C'A'", off=(0.6, -0.5, 0.4), tools=ONE_TOOL))
    assert not any(TILT in n for n in solution.notes)


def test_in_the_nest_the_functional_point_stands_on_one_place_of_each_sphere():
    campaign = measured("table and head", off=(0.6, -0.5, 0.4))
    (still,) = in_the_nest(campaign, campaign).sets
    points = nominal_point(campaign.machine, still.positions, still.tool)
    for name, place in SPHERES.items():
        rows = still.labels["sphere"] == name
        assert np.ptp(points[rows], axis=0).max() < 1e-9
        assert np.abs(points[rows][0] - place).max() < 0.1  # where it stands, but for the machine's errors
    assert not still.readings.any()


def test_what_is_weak_and_has_no_value_is_not_said_to_have_a_u():
    """A head with one tool vector: weakly determined combinations contain constants that are not determined by themselves."""
    solution = volid.fit(measured("fork head CB", off=(0.6, -0.5, 0.4), tools=ONE_TOOL))
    (note,) = [n for n in solution.notes if n.startswith("weakly determined")]
    assert "u up to nan" not in note
    for name, words in re.findall(r"(E[XYZABC]0[BCS]) \(([^)]*)\)", note):
        assert (words == "no value in the machine frame") == (not np.isfinite(solution.location(name).u)), name
