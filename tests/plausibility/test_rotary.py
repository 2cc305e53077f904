"""Rotary positions in radians by mistake: one axis or all, in R-tests, centres of a touch probe, and ball-bar paths."""

from dataclasses import replace

import numpy as np
import pytest
from exact_chain import Truth, random_truth
from support.machines import STRUCTURES, exact_machine, exact_of, resolved
from support.places import MODELS
from support.probe_centres import COUNTS, TCP, probed, write
from support.rtests import index_grid, r_test, r_test_campaign

from volid.exceptions import InputError
from volid.io import read_machine, read_manifest
from volid.planning import cone_frustum
from volid.plausibility.checks import check_campaign

LAYOUTS = ("tilting table C'A'", "table and head", "fork head CB")


def in_radians(exact, q, letters):
    """The same positions with some rotary axes in radians."""
    columns = [exact.column(a) for a in letters]
    q = q.copy()
    q[:, columns] = np.deg2rad(q[:, columns])
    return q


def choices(exact):
    rotary = [a for a in exact.axes if a in "ABC"]
    return [(a,) for a in rotary] + [tuple(rotary)]


@pytest.mark.parametrize("layout", LAYOUTS)
def test_one_axis_of_an_r_test_or_all(layout):
    exact = exact_machine(STRUCTURES[layout])
    rng = np.random.default_rng(0)
    data = r_test(exact, random_truth(exact, rng), rng, counts={"A": 5, "B": 5, "C": 7})
    campaign = r_test_campaign(resolved(exact, segments=4), data)
    assert check_campaign(campaign) == ()
    for letters in choices(exact):
        wrong = replace(campaign.sets[0], positions=in_radians(exact, data.q, letters))
        with pytest.raises(
            InputError, match=f"positions of {' and '.join(letters)} seem to be in radians: .* scatter by"
        ):
            check_campaign(replace(campaign, sets=(wrong,)))


@pytest.mark.parametrize("layout", ["table and head", "fork head CB"])
def test_centres_of_a_touch_probe(layout, tmp_path):
    """A control's tool-tip coordinates agree whatever the angles are taken for; the angles themselves give it away."""
    exact = exact_machine(STRUCTURES[layout])
    q = probed(exact, Truth())
    rotary = [a for a in exact.axes if a in "ABC"]
    angles = q[:, [exact.column(a) for a in rotary]]
    tip = exact.functional_point(q, np.array([0.0, 0.0, -230.0]))
    header = ["seq", *(f"{a}_deg" for a in rotary), "x_mm", "y_mm", "z_mm"]
    number = np.arange(len(q))
    good = read_manifest(write(tmp_path, exact, q, TCP, header, cells=np.column_stack([number, angles, tip])))
    check_campaign(good)
    for chosen in (*((k,) for k in range(len(rotary))), tuple(range(len(rotary)))):
        wrong = angles.copy()
        wrong[:, list(chosen)] = np.round(np.deg2rad(wrong[:, list(chosen)]), 4)
        campaign = read_manifest(write(tmp_path, exact, q, TCP, header, cells=np.column_stack([number, wrong, tip])))
        named = " and ".join(a for a in campaign.machine.letters if a in [rotary[k] for k in chosen])
        with pytest.raises(InputError, match=f"centres.csv, set 'probe': positions of {named} seem to be in radians"):
            check_campaign(campaign)


def test_centres_given_by_axis_positions(tmp_path):
    exact = exact_machine(STRUCTURES["table and head"])
    q = probed(exact, Truth())
    for letters in choices(exact):
        cells = in_radians(exact, q, letters)
        campaign = read_manifest(write(tmp_path, exact, q, "centres = true", list(exact.axes), cells=cells))
        with pytest.raises(InputError, match=f"positions of {' and '.join(letters)} seem to be in radians"):
            check_campaign(campaign)


def test_small_angles_of_centres_are_no_radians(tmp_path):
    """Angles that really are a few degrees, half and whole."""
    exact = exact_machine(STRUCTURES["table and head"])
    full = index_grid(exact, COUNTS)
    q = probed(exact, Truth())
    rotary = [exact.column(a) for a in "BC"]
    q[:, rotary] = np.round(6.0 * full[:, rotary] / np.abs(full[:, rotary]).max(axis=0), 1)
    tip = exact.functional_point(q, np.array([0.0, 0.0, -230.0]))
    cells = np.column_stack([np.arange(len(q)), q[:, rotary], tip])
    header = ["seq", "B_deg", "C_deg", "x_mm", "y_mm", "z_mm"]
    check_campaign(read_manifest(write(tmp_path, exact, q, TCP, header, cells=cells)))


@pytest.mark.parametrize("name", ["wCAYXbZt_trunnion", "wCXbYZBt_swivel_head"])
def test_ball_bar_paths(name):
    machine = read_machine(MODELS / f"{name}.toml")
    exact, plan = exact_of(machine), cone_frustum(machine, n=25)
    (one,) = plan.sets
    place = plan.stations[0].position
    truth = random_truth(exact, np.random.default_rng(1))
    length = np.linalg.norm(exact.functional_point(one.positions, one.tool, truth) - place, axis=1)[:, None]
    stations = tuple(replace(s, position=tuple(np.add(s.position, (2.0, -3.0, 1.0)))) for s in plan.stations)
    good = replace(plan, stations=stations, sets=(replace(one, readings=length),))
    check_campaign(good)
    for letters in choices(exact):
        wrong = replace(good.sets[0], positions=in_radians(exact, one.positions, letters))
        if np.abs(np.deg2rad(one.positions[:, [exact.column(a) for a in letters]])).max() < 0.02:
            continue  # an axis that hardly moves
        with pytest.raises(
            InputError, match=f"positions of {' and '.join(letters)} seem to be in radians: .*distances"
        ):
            check_campaign(replace(good, sets=(wrong,)))
