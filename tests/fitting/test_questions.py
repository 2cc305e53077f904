"""Questions about the size of what was found: which are asked, and that a sound machine is asked none."""

from dataclasses import replace

import numpy as np
import pytest
from support.machines import GANTRY, VERTICAL, volid_machine

import volid
from volid.campaign import Campaign, ObservationSet, Station
from volid.fitting.diagnosis.adequacy import QUESTIONED, Adequacy, Cause, Question
from volid.fitting.questions import questions

MACHINE = '[model]\nsegments = 4\n[model.functions]\n"*" = false\nEXX = true\nEYX = true\nECX = true\n'


def lines(exx, eyx, ecx, u=5e-4, **options):
    """A campaign of X alone: positioning, straightness and yaw on a line along X, as functions of X [mm, rad]."""
    x = np.repeat(np.linspace(0.0, 3000.0, 41), 2)
    q = np.zeros((3 * len(x), 3))
    machine = volid_machine(GANTRY, MACHINE)
    q[:, machine.index("X")] = np.tile(x, 3)
    noise = np.random.default_rng(1).standard_normal(len(q))
    size = np.concatenate([np.full(len(x), u), np.full(len(x), u), np.full(len(x), u / 500.0)])
    value = np.concatenate([exx(x), eyx(x), ecx(x)]) + size * noise
    component = np.repeat(np.array(["X", "Y", "C"]), len(x))
    labels = {"component": component, "line": component}
    s = ObservationSet(
        "laser", "component", q, np.zeros_like(q), np.zeros((len(q), 3)), value[:, None], size[:, None], labels,
        options={"slope": False} | options,
    )  # fmt: skip
    return Campaign(machine, (), (s,))


def bow(size, shape=1.0):
    return lambda x: size * 4.0 * shape * (x / 3000.0) * (1.0 - x / 3000.0)


def asked(campaign):
    found = volid.fit(campaign)
    return found.adequacy, " ".join(q.text for q in found.adequacy.questions)


def test_a_sound_machine_is_asked_nothing():
    adequacy, text = asked(lines(bow(0.02), bow(0.01), bow(5e-5)))
    assert adequacy.grade.startswith("accepted") and text == ""


def test_errors_of_a_hundredth_of_the_travel_are_asked_about_and_taken_when_that_is_answered():
    campaign = lines(bow(35.0), bow(0.01), bow(5e-5), large_errors=True)
    assert asked(campaign)[0].grade.startswith("accepted")
    (s,) = campaign.sets
    solution = volid.fit(campaign)
    silent = replace(solution, campaign=replace(campaign, sets=(replace(s, options={"slope": False}),)))
    (question,) = questions(silent)
    assert question.about_values and "EXX 35 mm" in question.text and "large_errors = true" in question.text


def test_angles_that_no_guideway_follows_are_asked_about():
    """0.9 mrad of yaw over 3000 mm with a straightness of 1 µm."""
    adequacy, text = asked(lines(bow(0.02), bow(0.001), bow(9e-4)))
    assert adequacy.grade == QUESTIONED and "are the angles in degrees" in text and "ECX" in text
    assert adequacy.barrier
    assert asked(lines(bow(0.02), bow(0.06), bow(9e-4)))[1] == ""  # a guideway that is bent that much


def test_a_barrier_stands_for_hopeless_fits_and_questions_about_values_alone():
    base = Adequacy(1.0, 100, 1.0, 0.5, (), (), False, "accepted")
    assert base.barrier == ""
    assert replace(base, questions=(Question("u?", False),)).barrier == ""
    assert replace(base, questions=(Question("mm?", True),)).barrier == "mm?"
    rejected = replace(base, rejected=True, unit_weight=7.0)
    assert rejected.barrier == ""  # its numbers may be looked at, its u does not hold
    assert "unit weight 60" in replace(rejected, unit_weight=60.0).barrier
    slip = Cause("exchanged columns", "columns are exchanged", "exchange them", 1.0, 1.0, 0, -300.0, float("inf"))
    assert "columns are exchanged" in replace(rejected, causes=(slip,)).barrier


def test_questions_are_kept_in_files(tmp_path):
    solution = volid.fit(lines(bow(0.02), bow(0.001), bow(9e-4)))
    solution.save(tmp_path / "s.h5")
    assert volid.load_solution(tmp_path / "s.h5").adequacy.questions == solution.adequacy.questions


def test_a_station_amid_the_places_of_the_tool_is_asked_about():
    """Relative lengths from a place where no instrument can stand."""
    rng = np.random.default_rng(2)
    machine = volid_machine(
        VERTICAL, '[model]\nsegments = 2\n[model.functions]\n"*" = false\nEXX = true\nEYY = true\nEZZ = true\n'
    )
    low, high = (np.array([VERTICAL.travel[a][k] for a in machine.letters]) for k in (0, 1))
    q = low + rng.uniform(0, 1, (400, 3)) * (high - low)
    order = [machine.index(a) for a in "XYZ"]
    places = {"S1": (380.0, 215.0, -230.0), "S2": (-300.0, -200.0, 50.0)}
    station = np.array(["S1", "S2"])[np.arange(400) % 2]
    d = np.linalg.norm(q[:, order] - np.array([places[s] for s in station]), axis=1) + 5e-4 * rng.standard_normal(400)
    labels = {"station": station, "segment": np.full(400, "1")}
    s = ObservationSet(
        "volume", "distance", q, np.zeros_like(q), np.zeros((400, 3)), d[:, None] - 100.0, np.full((400, 1), 5e-4), labels,
        options={"relative": True, "calibrated_u": 0.0},
    )  # fmt: skip
    stations = tuple(Station(n, position=p) for n, p in places.items())
    adequacy, text = asked(Campaign(machine, stations, (s,)))
    assert adequacy.grade == QUESTIONED and "station S1 is found at (380, 215, -230)" in text and "S2" not in text


@pytest.mark.parametrize(
    ("factor", "said"), [(1e3, "is it in µm"), (15.0, "times as large"), (1e-4, "is it in metres")]
)
def test_u_far_off_is_asked_about(factor, said):
    campaign = lines(bow(0.02), bow(0.01), bow(5e-5), u=2e-4 if factor < 1 else 5e-4)
    (s,) = campaign.sets
    adequacy, text = asked(replace(campaign, sets=(replace(s, u=factor * s.u),)))
    assert adequacy.grade == QUESTIONED or adequacy.rejected
    assert said in text
