"""Runs out of campaigns: linear and rotary components, beams of either sense, and what the sets say of their uncertainty."""

import re
from dataclasses import replace

import numpy as np
import pytest
from support.places import DATASETS, MODELS

import volid
from volid.campaign import Campaign, Effect, Environment, ObservationSet
from volid.exceptions import InputError
from volid.standards.positioning.evaluation import evaluate_positioning
from volid.standards.positioning.sets import positioning_of

TARGETS = np.array([10.0, 105.0, 210.0, 290.0])
RNG = np.random.default_rng(3)
DEVIATIONS = 1e-3 * RNG.standard_normal((4, 2, 3))


@pytest.fixture(scope="module")
def machine():
    return volid.load_machine(MODELS / "wCAYXbZt_trunnion.toml")


def approaches(machine, letter, still):
    """Positions, directions, run and deviation of every approach, in the order of a test."""
    i, way, run = (k.ravel() for k in np.indices(DEVIATIONS.shape))
    positions = np.tile([still[a] for a in machine.letters], (len(i), 1))
    directions = np.zeros_like(positions)
    axis = machine.index(letter)
    positions[:, axis], directions[:, axis] = TARGETS[i], np.where(way == 0, 1.0, -1.0)
    return positions, directions, run.astype(str), DEVIATIONS[i, way, run]


def component(machine, letter, factor=1.0, **options):
    still = dict.fromkeys("XYZAC", 0.0)
    positions, directions, run, deviation = approaches(machine, letter, still)
    labels = {"component": np.full(len(run), letter), "line": np.full(len(run), "1"), "run": run}
    readings = (factor * deviation)[:, None]
    u = np.full_like(readings, factor * 2e-4)
    tool = np.zeros((len(run), 3))
    return ObservationSet("s", "component", positions, directions, tool, readings, u, labels, options=options)


def beam(machine, along, still, offset=0.0, mirror="retro"):
    """Displacements along a beam on a machine that errs along X only: along · way + offset."""
    positions, directions, run, deviation = approaches(machine, "X", still)
    labels = {"line": np.full(len(run), "D"), "run": run, "segment": np.full(len(run), "1")}
    travelled = positions[:, machine.index("X")] + deviation
    turned = np.deg2rad(still["C"])  # CONVENTIONS 2: the tool turns by +C against the workpiece, and X with it
    direction = np.array([np.cos(turned), np.sin(turned), 0.0])
    readings = (travelled * (np.array(along) @ direction) + offset)[:, None]
    options = {
        "lines": {"D": list(along)}, "mirror": mirror, "mirror_on": "tool", "misalignment": False, "misalignment_u": np.inf,
        "body": "workpiece",
    }  # fmt: skip
    tool = np.zeros((len(run), 3))
    u = np.full_like(readings, 2e-4)
    return ObservationSet("s", "projection", positions, directions, tool, readings, u, labels, options=options)


def same_up_to_a_constant(found, expected=DEVIATIONS):
    difference = found - expected
    np.testing.assert_allclose(difference, difference.mean(), rtol=0, atol=1e-11)


def test_a_linear_component_is_taken_as_it_is(machine):
    [found] = positioning_of(Campaign(machine, sets=(component(machine, "X"),)))
    assert (found.runs.axis, found.runs.unit) == ("X", "mm")
    np.testing.assert_array_equal(found.runs.targets, TARGETS)
    np.testing.assert_allclose(found.runs.deviations, DEVIATIONS, rtol=0, atol=1e-15)


def test_a_rotary_component_in_rad_becomes_degrees(machine):
    [found] = positioning_of(Campaign(machine, sets=(component(machine, "C", factor=np.pi / 180.0),)))
    assert (found.runs.axis, found.runs.unit) == ("C", "°")
    np.testing.assert_allclose(found.runs.deviations, DEVIATIONS, rtol=0, atol=1e-14)
    evaluation = evaluate_positioning(*found)
    assert pytest.approx(2.0 * 2e-4 * np.sqrt(2.0 / 12.0), rel=0.05) == evaluation["B_mean"].U  # u in degrees again


@pytest.mark.parametrize(("along", "turn"), [((1.0, 0.0, 0.0), 0.0), ((-1.0, 0.0, 0.0), 0.0), ((0.0, -1.0, 0.0), 90.0)])
def test_a_beam_along_an_axis_counts_with_the_axis(machine, along, turn):
    """Also against it, and on a table that stands turned, where the axis is along the workpiece's Y."""
    still = dict.fromkeys("XYZA", 0.0) | {"C": turn}
    [found] = positioning_of(Campaign(machine, sets=(beam(machine, along, still, offset=7.0),)))
    assert found.runs.axis == "X"
    same_up_to_a_constant(found.runs.deviations)


def test_a_beam_across_or_along_a_diagonal_is_no_positioning(machine):
    still = dict.fromkeys("XYZAC", 0.0)
    inclined = beam(machine, (np.sqrt(0.5), np.sqrt(0.5), 0.0), still)
    with pytest.raises(InputError, match="all sets: no line is positioning of one axis"):
        positioning_of(Campaign(machine, sets=(inclined,)))


def test_other_components_are_left_out(machine):
    straight = component(machine, "X")
    straight = replace(straight, name="t", labels={**straight.labels, "component": np.full(len(straight), "Y")})
    found = positioning_of(Campaign(machine, sets=(straight, component(machine, "X"))))
    assert [f.runs.axis for f in found] == ["X"]
    with pytest.raises(InputError, match="t: no line is positioning of one axis"):
        positioning_of(Campaign(machine, sets=(straight, component(machine, "X"))), ["t"])
    with pytest.raises(InputError, match="no set 'q'; expected one of t, s"):
        positioning_of(Campaign(machine, sets=(straight, component(machine, "X"))), ["q"])


def test_runs_that_nobody_numbered_count_in_their_order(machine):
    given = component(machine, "X")
    plain = replace(given, labels={**given.labels, "run": np.full(len(given), "1")})
    [found] = positioning_of(Campaign(machine, sets=(plain,)))
    np.testing.assert_allclose(found.runs.deviations, DEVIATIONS, rtol=0, atol=1e-15)


def test_zeros_of_every_run_are_told(machine):
    [found] = positioning_of(Campaign(machine, sets=(component(machine, "X", offset_per="run"),)))
    assert "zeroed 3 times" in found.runs.notes[0]


def test_effects_of_a_set_enter_by_what_they_do(machine):
    """A scale on the travelled length acts on M by its whole length; the machine's repeatability is no uncertainty."""
    given = replace(component(machine, "X", interferometer=True), u=np.full((24, 1), 1e-9))
    rising = replace(given, readings=given.readings + 1e-4 * given.positions[:, [machine.index("X")]])
    scale, own = Effect("air", "scale", 1e-6, "set"), Effect("machine", "repeatability", 1e-3, "point")
    [found] = positioning_of(Campaign(machine, sets=(replace(rising, effects=(scale, own)),)))
    assert [c.name for c in found.contributions] == ["u of the readings", "effect 'air'"]
    assert pytest.approx(2.0 * 1e-6 * np.ptp(TARGETS), rel=0.05) == evaluate_positioning(*found)["M"].U


def test_means_are_those_of_the_fit():
    """As many unknowns of EXX as targets in both directions: the fitted function goes through every mean."""
    campaign = volid.load_campaign(DATASETS / "iso230_2_synthetic" / "campaign.toml")
    campaign = replace(
        campaign, sets=(replace(campaign.sets[0], effects=()),)
    )  # a scale is unknown to the fit, within its u
    [found] = positioning_of(campaign)
    solution = volid.fit(campaign)
    statistics = evaluate_positioning(*found).details.statistics
    fitted = np.full((len(found.runs.targets), 2), np.nan)
    for row in solution.motion("EXX", found.runs.targets):
        fitted[np.argmin(np.abs(found.runs.targets - row.position)), 0 if row.direction == 1 else 1] = row.value
    difference = fitted - statistics.mean
    np.testing.assert_allclose(
        difference, difference.mean(), rtol=0, atol=1e-8
    )  # mm; the zero is that of the fit's datum


def test_runs_with_zeros_at_both_ends_are_asked_about(machine):
    """The second run was set to zero at the far end: its displacements are 280 mm less, and no R is."""
    still = dict.fromkeys("XYZAC", 0.0)
    observations = beam(machine, np.array([1.0, 0.0, 0.0]), still)
    readings = observations.readings - 280.0 * (observations.labels["run"] == "1")[:, None]
    other = Campaign(machine, (), (replace(observations, readings=readings),))
    with pytest.raises(InputError, match="was a run set to zero at another place"):
        evaluate_positioning(positioning_of(other)[0].runs)


def test_a_correction_of_the_air_is_told(machine):
    """n = 1.000 271 37 at 20 °C, 1013.25 hPa and 50 % (NIST's tables of Ciddor's equation): 76.0 µm over 280 mm."""
    still = dict.fromkeys("XYZAC", 0.0)
    air = {"air_temperature_C": 20.0, "pressure_hPa": 1013.25, "humidity_percent": 50.0}
    log = {name: np.array([value]) for name, value in air.items()}
    notes = []
    for corrected in (False, True):
        environment = Environment("air", log, corrected=corrected)
        campaign = Campaign(machine, (), (beam(machine, (1.0, 0.0, 0.0), still),), environments=(environment,))
        notes.append([n for n in positioning_of(campaign)[0].runs.notes if "corrected the readings" in n])
    (said,), none = notes
    assert float(re.search("up to ([0-9.]+) µm", said)[1]) == pytest.approx(280.0 * 0.27137 / 1.00027, abs=0.1)
    assert none == []


def test_a_scale_of_deviations_alone_is_told(machine):
    """2e-6 of 280 mm would be 0.56 µm, of deviations of µm nothing: unless the travel was counted."""
    scale = Effect("laser", "scale", 2e-6, "campaign")
    said = []
    for counted in (False, True):
        observations = replace(component(machine, "X", interferometer=counted), effects=(scale,))
        runs = positioning_of(Campaign(machine, sets=(observations,)))[0].runs
        said.append(any("scales the deviations alone" in note for note in runs.notes))
    assert said == [True, False]
