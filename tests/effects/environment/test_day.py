"""Campaigns over a day of drifting air, whose readings are made apart from the package: files, fit, simulation, streams."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from support.days import Day, log_csv
from support.judging import judge
from support.kinds import exact_truth

import volid
from volid.effects.environment.reduction import as_read, reduced
from volid.exceptions import InputError
from volid.fitting.air import check_air
from volid.io import load_campaign, write_campaign, write_manifest
from volid.io.solutions import read_solution
from volid.observations.base import with_large_errors
from volid.report.text.summary import summary, summary_data

AIR = '\n[[environment]]\nfile = "day.csv"\ncorrected = false\n'
STEEL = 11.5e-6
WARM = f'{AIR}machine = {{ expansion = {STEEL!r}, material = "material_1" }}\n'


def body(t):
    """A machine that warms from 21 to 24 °C."""
    return 21.0 + 3.0 * (1.0 - np.exp(-np.asarray(t) / 7200.0))


@cache
def day():
    return Day()


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    return load_campaign(day().write(tmp_path_factory.mktemp("day"), AIR))


@pytest.fixture(scope="module")
def solution(campaign):
    return volid.fit(campaign)


def test_a_fit_with_the_log_recovers_the_machine(solution):
    """Errors are recovered within u although the air drifts by 5 µm/m, dead paths are unknown, and the formula is another."""
    assert solution.adequacy.grade == "accepted" and 0.85 < solution.adequacy.unit_weight < 1.15
    found = judge(solution, day().machine, day().truth)
    assert found.rms < 0.4e-3 and found.normalised_rms < 1.3


@pytest.mark.slow
def test_without_the_log_the_model_is_rejected(campaign):
    """Each station reads at another time of day, in other air."""
    bare = volid.fit(replace(campaign, environments=()))
    assert bare.adequacy.rejected
    assert judge(bare, day().machine, day().truth).rms > 20e-3  # 265 µm/m of a metre


@pytest.mark.slow
def test_a_common_index_leaves_the_drift(campaign, tmp_path):
    """The mean index alone gives the scale but for 5 µm/m, and the misfit shows it."""
    mean = log_csv().splitlines()
    values = np.array([[float(c) for c in line.split(",")] for line in mean[1:]])[:, 1:].mean(axis=0)
    names = ("air_temperature_C", "pressure_hPa", "humidity_percent")
    constant = ", ".join(f"{n} = {v!r}" for n, v in zip(names, values.tolist(), strict=True))
    text = f'\n[[environment]]\nname = "room"\nvalues = {{ {constant} }}\ncorrected = false\nsets = ["volume"]\n'
    found = volid.fit(load_campaign(day().write(tmp_path, text)))
    assert found.adequacy.grade != "accepted"


def test_solutions_hold_what_was_read_and_what_was_made_of_it(solution, campaign, tmp_path):
    solution.save(tmp_path / "s.h5")
    again = read_solution(tmp_path / "s.h5")
    (own,), (made,) = again.campaign.sets, solution.campaign.sets
    np.testing.assert_array_equal(own.as_read, campaign.sets[0].readings)
    np.testing.assert_array_equal(own.readings, made.readings)
    np.testing.assert_array_equal(as_read(again.campaign).sets[0].readings, campaign.sets[0].readings)
    assert volid.fit(again.campaign).adequacy.unit_weight == pytest.approx(solution.adequacy.unit_weight)


def test_the_summary_says_what_was_applied(solution):
    n = day().n - 1.0
    (said,) = summary_data(solution)["environment"]
    # lengths change by 1/n - 1; two formulas agree within 1e-8, and the log is linear between its entries
    assert said["refraction"] == pytest.approx([1.0 / (1.0 + n.max()) - 1.0, 1.0 / (1.0 + n.min()) - 1.0], abs=2e-8)
    text = summary(solution)
    assert "- volume: refraction -268.4" in text and "no u of it is stated" in text


@pytest.mark.parametrize("form", ["text", "hdf5"])
def test_files_hold_the_environment(campaign, tmp_path, form):
    keys = {"at": {"refractive_index": 1.00027}, "u": {"air_temperature_C": 0.2}, "beyond": 60.0, "co2": 400.0}
    given = replace(campaign, environments=(replace(campaign.environments[0], **keys),))
    if form == "text":
        path = write_manifest(given, tmp_path / "out")
    else:
        path = tmp_path / "out.h5"
        write_campaign(given, path)
    (found,), (expected,) = load_campaign(path).environments, given.environments
    for name in (
        "name",
        "sets",
        "corrected",
        "at",
        "wavelength",
        "co2",
        "dead_path",
        "u",
        "machine",
        "artefact",
        "beyond",
    ):
        assert getattr(found, name) == getattr(expected, name), name
    assert list(found.log) == list(expected.log)
    for name, values in expected.log.items():
        np.testing.assert_array_equal(found.log[name], values)


def test_a_reduced_campaign_is_written_as_it_was_read(solution, campaign, tmp_path):
    again = load_campaign(write_manifest(solution.campaign, tmp_path / "out"))
    np.testing.assert_array_equal(again.sets[0].readings, campaign.sets[0].readings)
    assert again.environments[0].sets == ("volume",) and again.sets[0].effects == ()


def test_two_campaigns_of_a_day_share_its_log(campaign, tmp_path):
    other = load_campaign(day().write(tmp_path, AIR.replace("false", "false\nbeyond = 5.0")))
    half = [replace(c, sets=(replace(c.sets[0], name=n),), environments=(replace(c.environments[0], sets=(n,)),)) for c, n in
            ((campaign, "one"), (campaign, "two"), (other, "three"))]  # fmt: skip
    for i, part in enumerate(half):
        write_campaign(part, tmp_path / f"{i}.h5")
    joined = load_campaign(*(tmp_path / f"{i}.h5" for i in range(3)))
    assert [(e.name, e.sets) for e in joined.environments] == [("day", ("one", "two")), ("day 2", ("three",))]


def test_readings_that_are_corrected_already_are_noticed(campaign):
    """Said to be uncorrected, they would be corrected twice: only the scale of the nominal machine shows it in steady air."""
    own = campaign.sets[0]
    twice = replace(campaign, sets=(replace(own, readings=own.readings - 265e-6 * day().path[:, None]),))
    with pytest.raises(InputError, match=r"hold the refractive correction already.*corrected = true in"):
        volid.fit(twice)
    never = replace(campaign, environments=(replace(campaign.environments[0], corrected=True),))
    with pytest.raises(InputError, match="do not hold the refractive correction, although corrected = true"):
        volid.fit(never)
    check_air(with_large_errors(reduced(never)))  # whoever says that it is so is believed
    with pytest.raises(InputError, match="do not hold"):
        check_air(reduced(never))


@pytest.mark.slow
def test_a_machine_that_warms_is_recovered_at_20_degrees(tmp_path):
    warm = Day(grown=lambda t: STEEL * (body(t) - 20.0))
    manifest = warm.write(tmp_path, WARM, log_csv(material=body))
    found = volid.fit(load_campaign(manifest))
    judged = judge(found, warm.machine, warm.truth)
    assert found.adequacy.grade == "accepted" and judged.rms < 0.4e-3 and judged.normalised_rms < 1.3
    (said,) = summary_data(found)["environment"]
    assert said["machine"]["temperature"] == pytest.approx([body(0.0), body(8 * 3600.0)], abs=1e-3)
    without = volid.fit(load_campaign(warm.write(tmp_path / "b", AIR, log_csv(material=body))))
    assert judge(without, warm.machine, warm.truth).rms > 5e-3  # 11.5 µm/m and K, 1 to 4 K


@pytest.mark.slow
def test_a_virtual_instrument_reads_in_the_air_of_its_plan(campaign):
    """Simulated readings hold the refraction of the log, so that a fit to them recovers the truth."""
    truth = exact_truth(campaign.machine)
    read, _ = volid.simulate(campaign, truth, seed=4)
    assert read.sets[0].as_read is None and read.sets[0].effects == ()
    plain, _ = volid.simulate(replace(campaign, environments=()), truth, seed=4)
    away = np.abs(read.sets[0].readings - plain.sets[0].readings)
    assert away.max() > 0.2  # mm: 265 µm/m
    found = volid.fit(read)
    assert found.adequacy.grade == "accepted"
    other = volid.fit(plain)
    q = campaign.sets[0].positions[:50]
    tool = campaign.sets[0].tool[:50]
    np.testing.assert_allclose(found.deviation(q, tool), other.deviation(q, tool), rtol=0, atol=2e-5)


@pytest.mark.slow
def test_part_by_part_gives_the_same(solution, campaign, tmp_path):
    write_campaign(campaign, tmp_path / "c.h5")
    found = volid.fit_streamed(volid.CampaignStream(tmp_path / "c.h5"), sample=300)
    q, tool = campaign.sets[0].positions[:50], campaign.sets[0].tool[:50]
    difference = np.abs(found.deviation(q, tool) - solution.deviation(q, tool))[:, :3]
    assert found.statistics.n_readings == 420 and difference.max() < 0.3e-3  # its smoothness is that of the sample
