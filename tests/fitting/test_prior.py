"""An earlier solution as prior knowledge says what a joint fit of both campaigns says."""

from dataclasses import replace

import numpy as np
import pytest
from exact_chain import ExactMachine, default_stations, machine_toml, random_truth, tracker_campaign, write_campaign
from support.places import DATASETS

from volid.campaign import Campaign
from volid.exceptions import InputError
from volid.fitting.diagnosis.identifiability import parameter_units
from volid.fitting.fit import fit
from volid.fitting.prior import prior_notes, prior_of
from volid.io import load_campaign

TRAVEL = {"X": (0.0, 800.0), "Y": (0.0, 500.0), "Z": (-400.0, 0.0)}


@pytest.fixture(scope="module")
def campaigns(tmp_path_factory):
    """Two days on one machine, each with its own three stations; and both days together."""
    machine, rng = ExactMachine("w Y' X' b Z t", TRAVEL), np.random.default_rng(3)
    truth = random_truth(machine, rng, waviness=0.3, scale=0.3)
    days = []
    for day in (0, 1):
        stations = dict(list(default_stations(machine).items())[3 * day : 3 * day + 3])
        campaign = tracker_campaign(
            machine, truth, rng, stations=stations, n_per_station=150, every_station_sees_every_tool=True
        )
        folder = tmp_path_factory.mktemp(f"day{day}")
        text = machine_toml(machine, extra="[model]\nsegments = 2\n")
        loaded = load_campaign(write_campaign(folder, campaign, text, f"day {day}"))
        rename = {s.name: f"D{day}{s.name}" for s in loaded.stations}
        sets = tuple(
            replace(
                s, name=f"day {day}", labels={**s.labels, "station": np.array([rename[n] for n in s.labels["station"]])}
            )
            for s in loaded.sets
        )
        days.append(
            replace(loaded, stations=tuple(replace(s, name=rename[s.name]) for s in loaded.stations), sets=sets)
        )
    first, second = days
    return first, second, replace(first, stations=first.stations + second.stations, sets=first.sets + second.sets)


def test_prior_equals_joint_fit(campaigns):
    first, second, both = campaigns
    joint = fit(both)
    sequential = fit(second, prior=fit(first))
    u = np.sqrt(np.diag(joint.parameter_covariance))
    # first-order equality: second-order terms of errors of 20 µm stay below a thousandth of u
    assert np.max(np.abs(np.asarray(sequential.parameters - joint.parameters)) / u) < 2e-3
    np.testing.assert_allclose(
        sequential.parameter_covariance / np.outer(u, u), joint.parameter_covariance / np.outer(u, u), atol=2e-3
    )
    # and the prior matters: the second day alone is less certain
    alone = np.sqrt(np.diag(fit(second).parameter_covariance))
    assert np.median(alone / u) > 1.2


def test_a_prior_of_another_state_of_the_machine_is_named(campaigns):
    """What was loaded between both days changed the errors; what was active on both days, or on neither, did not."""
    first, second, _ = campaigns
    prior, loaded = fit(first), {"active_compensations": ["L-POS: x.comp"]}
    said = [w for w in fit(replace(second, conditions=loaded), prior=prior).notes if "prior was" in w]
    assert len(said) == 1 and "other compensations active (none) than the campaign (L-POS: x.comp)" in said[0]
    assert prior_notes(prior, second) == ()
    both = replace(prior, campaign=replace(first, conditions=loaded))
    assert prior_notes(both, replace(second, conditions=loaded)) == ()


def test_what_a_prior_determined_stays_determined():
    """Smoothness is stiff: the readings' share in what is known was once lost in its rounding, and with it a combination."""
    january, monday = (load_campaign(DATASETS / "surveys" / f"{day}.toml") for day in ("january", "monday"))
    prior = fit(january)
    n, units = prior.model.n_parameters, parameter_units(prior.model)
    readings, smooth = prior.factor * prior_of(prior, prior.model).root * units, prior.smooth_rows[:, :n] * units
    covariance = prior.bare_covariance[:n, :n] / np.outer(units, units)
    left = covariance @ (readings.T @ readings + smooth.T @ smooth) @ covariance - covariance  # 0, as C C⁻¹ C = C
    u = np.sqrt(np.diagonal(covariance))
    assert np.max(np.abs(left)) < 1e-6 * np.max(u) ** 2
    known = u > 0.0
    assert np.max(np.abs(left[np.ix_(known, known)] / np.outer(u[known], u[known]))) < 1e-6
    assert prior.fully_determined and fit(monday, prior=prior).fully_determined


def test_prior_of_another_machine_is_refused(campaigns):
    first, second, _ = campaigns
    axes = tuple(
        replace(a, travel=(0.0, 900.0), reference=400.0) if a.letter == "X" else a for a in second.machine.axes
    )
    other = Campaign(replace(second.machine, axes=axes), second.stations, second.sets)
    with pytest.raises(InputError, match=r"prior: travel of axis X is \(0.0, 800.0\) in its machine"):
        fit(other, prior=fit(first))
