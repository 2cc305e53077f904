"""Displacements along beams: against rays and planes of exact chains, in recovery, and what their messages say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from exact_chain import LINEAR, MICRO, Smooth, Truth, random_truth
from exact_chain.beams import flat_lengths, retro_lengths
from support.kinds import (
    EXAMPLES,
    THREE,
    TOOLS,
    distances,
    exact_parameters,
    exact_truth,
    machine_of,
    plan_set,
    positions_of,
)
from support.machines import LAYOUTS, VERTICAL, exact_machine, fixed, volid_machine

from volid.campaign import Alignment, Campaign, Effect
from volid.exceptions import InputError
from volid.fitting.diagnosis.identifiability import parameter_units
from volid.fitting.fit import fit
from volid.fitting.nominal import check_nominal
from volid.io import load_campaign, write_manifest
from volid.io.machines import read_machine
from volid.observations.base import NuisanceTable, with_large_errors
from volid.observations.beam_lines import beams_of
from volid.observations.projection import PROJECTION
from volid.planning.diagonals import diagonals, parallel_lines, step_diagonals
from volid.planning.following import follow
from volid.plausibility.checks import check_campaign
from volid.virtual.simulate import simulate

MACHINES = [VERTICAL, *(exact_machine(s) for s in LAYOUTS.values())]
EVERY_LAYOUT = pytest.mark.parametrize("exact", MACHINES, ids=["vertical", *LAYOUTS])
ALONG = (0.6, -0.5, 0.4)


# ----------------------------------------------------------------------------------------------- independent truth


def errors_of(exact, truth, q, way):
    """Error values (6·(n_axes + 1), m) from the exact chain."""
    constants = [truth.constants.get(f"E{c}0S", 0.0) * np.ones((len(q), 1)) for c in "XYZABC"]
    return np.hstack([*(exact.errors(a, q, truth, way) for a in exact.axes), *constants]).T


def beside_a_beam(exact, m=30):
    """The machine, and positions within 15 mm of a beam along `ALONG` through the middle, its rotary axes at some angles."""
    machine, rng = volid_machine(exact), np.random.default_rng(8)
    still = np.tile([0.0 if a.is_linear else 0.15 * a.travel[1] for a in machine.axes], (m, 1))
    low, high = np.array(
        [[a.travel[k] if a.is_linear else s for a, s in zip(machine.axes, still[0], strict=True)] for k in (0, 1)]
    )
    from volid.model.kinematics import nominal_point

    centre = nominal_point(machine, 0.5 * (low + high)[None, :], TOOLS[1])[0]
    unit = np.array(ALONG) / np.linalg.norm(ALONG)
    points = centre + np.outer(rng.uniform(-150.0, 150.0, m), unit) + rng.uniform(-15.0, 15.0, (m, 3))
    return machine, follow(machine, still, TOOLS[1], points), rng.choice([-1.0, 1.0], (m, len(machine.axes)))


def predicted(machine, exact, truth, own, way, angles=()):
    """What the kind predicts for a set of one line, its offset 0."""
    (group,) = PROJECTION.groups(own, Campaign(machine, (), (own,)), NuisanceTable())
    slots = [np.zeros(len(own)), *(np.full(len(own), a) for a in angles)]
    errors = errors_of(exact, truth, own.positions, way)
    return PROJECTION.predict(
        machine, group.settings, own.positions.T, tuple(own.tool.T), errors, slots, group.constants
    )[0]


@EVERY_LAYOUT
def test_a_reflector_is_read_as_an_exact_chain_says(exact):
    """30 µrad about arms of 1 m leave 1e-9 mm to second order; a beam 3 mrad off is no small angle any more."""
    machine, q, way = beside_a_beam(exact)
    truth = random_truth(exact, np.random.default_rng(4), reversal=True)
    own = plan_set("own", "projection", q, TOOLS[1], {"line": "D"}, lines={"D": list(ALONG)}, misalignment=True)
    (line,) = beams_of(own, Campaign(machine, (), (own,)))
    along, first, second = line.frame
    beam = along + 3e-3 * first - 2e-3 * second
    expected = retro_lengths(exact, q, TOOLS[1], truth, beam, line.point, direction=way)
    np.testing.assert_allclose(predicted(machine, exact, truth, own, way, (3e-3, -2e-3)), expected, rtol=0.0, atol=1e-7)
    np.testing.assert_allclose(line.point, exact.functional_point(q[:1], TOOLS[1])[0], atol=1e-9)


@EVERY_LAYOUT
@pytest.mark.parametrize("body", ["workpiece", "bed"])
def test_a_flat_mirror_is_read_where_the_ray_meets_its_plane(exact, body):
    """The mirror is 3 mrad off, and the beam with it: the ray is followed to the plane that the exact chain carries."""
    machine, q, way = beside_a_beam(exact)
    truth = random_truth(exact, np.random.default_rng(5), reversal=True)
    stated = {"lines": {"D": list(ALONG)}, "mirror": "flat", "misalignment": True, "body": body}
    own = plan_set("own", "projection", q, TOOLS[1], {"line": "D"}, **stated)
    (line,) = beams_of(own, Campaign(machine, (), (own,)))
    along, first, second = line.frame
    beam = along + 3e-3 * first - 2e-3 * second
    nominal = np.linalg.inv(exact.body_pose(body, q[:1], Truth())) @ exact.nominal_pose(q[:1])
    normal = nominal[0, :3, :3].T @ beam
    expected = flat_lengths(exact, q, TOOLS[1], truth, beam, line.point, normal, body, way)
    np.testing.assert_allclose(predicted(machine, exact, truth, own, way, (3e-3, -2e-3)), expected, rtol=0.0, atol=1e-7)
    reflector = retro_lengths(exact, q, TOOLS[1], truth, beam, line.point, body, way)
    assert np.abs(expected - reflector).max() > 1e-4, "rotations of the machine, at 15 mm beside the beam"


def linear(slope: float) -> Smooth:
    """slope · q."""
    return Smooth(np.zeros(0), np.zeros(0), np.zeros(0), np.array([0.0, slope]))


def test_what_a_flat_mirror_reads_more_is_its_tilt_times_the_way_beside_the_beam():
    """A table that pitches by 1 µrad/mm in B: at the end of a step of 20 mm in X the mirror reads δn·Δ more, to second order.

    Beam along (1, 0, 1)/√2; X goes from 0 to 20: Δ across the beam is (10, 0, -10). B = 20 µrad turns n by B (1, 0, -1)/√2: the
    mirror reads B · 20/√2 = 0.283 µm more than a reflector.
    """
    machine = volid_machine(VERTICAL)
    truth = Truth({"EBX": linear(MICRO)})
    q = np.zeros((2, 3))
    q[1, machine.index("X")] = 20.0
    found = []
    for mirror in ("retro", "flat"):
        own = plan_set("own", "projection", q, [0.0, 0.0, 0.0], {"line": "D"}, lines={"D": [1, 0, 1]}, mirror=mirror)
        found.append(predicted(machine, VERTICAL, truth, own, np.zeros((2, 3))))
    assert found[1][1] - found[0][1] == pytest.approx(20e-6 * 20.0 / np.sqrt(2.0), abs=1e-8)
    assert found[0][1] == pytest.approx(20.0 / np.sqrt(2.0), abs=3e-3)


# --------------------------------------------------------------------------------------------------------- recovery


def lines_of_functions(machine, exact, truth, rng):
    """Components of the deviation along the middle line of every axis, read with offsets and unknown slopes, u 0.5 µm or µrad."""
    sets, m = [], 41
    for axis in LINEAR:
        i = machine.index(axis)
        q = np.tile([0.5 * sum(a.travel) for a in machine.axes], (m, 1))
        q[:, i] = np.linspace(*machine.axes[i].travel, m)
        found = exact.deviation(q, TOOLS[0], truth)
        for letters, slope in ((axis, False), ("ABC", False), (LINEAR.replace(axis, ""), True)):
            n = len(letters)
            labels = {"component": np.repeat(list(letters), m), "line": axis}
            u = 5e-7 if letters == "ABC" else 5e-4
            own = plan_set(f"{axis} {letters}", "component", np.tile(q, (n, 1)), TOOLS[0], labels, u=u, slope=slope)
            values = np.concatenate([found[:, "XYZABC".index(c)] + 20 * u * rng.normal() for c in letters])
            values += np.tile(slope * 1e-5 * (q[:, i] - q[0, i]), n) + u * rng.normal(size=n * m)
            sets.append(replace(own, readings=values[:, None]))
    return sets


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.slow), pytest.param(3, marks=pytest.mark.slow)])
def test_diagonals_beside_functions_that_are_known_give_squareness(seed):
    """Straightedges of unknown alignment and angular readings leave squareness open; four body diagonals give it within u."""
    exact = VERTICAL
    machine = volid_machine(exact, fixed(4))
    rng = np.random.default_rng(seed)
    truth = random_truth(exact, rng, waviness=0.3)  # within reach of 4 segments
    plan = diagonals(machine, 21, TOOLS[0], faces=False)
    (own,) = plan.sets
    readings = np.empty((len(own), 1))
    for line in beams_of(own, plan):
        q = own.positions[line.rows]
        readings[line.rows, 0] = retro_lengths(exact, q, TOOLS[0], truth, line.beam.along, line.point) + rng.normal()
    readings += 5e-4 * rng.normal(size=readings.shape)
    sets = (*lines_of_functions(machine, exact, truth, rng), replace(own, readings=readings))
    alone, solution = (fit(Campaign(machine, (), s)) for s in (sets[:-1], sets))
    assert not solution.adequacy.rejected, solution.adequacy.verdict
    for name in ("EC0Y", "EA0Z", "EB0Z"):
        assert np.isnan(alone.location(name).u), "slopes of their own take it away"
        found = solution.location(name)
        assert 0.0 < found.u < 2e-6, "1 µrad is 0.5 µm over half a metre"
        assert abs(found.value - truth.constants[name]) < 4.0 * found.u


def chi_square(solution, theta) -> float:
    """Square of the difference from θ in what is determined, in units of its covariance, per dimension."""
    units = parameter_units(solution.model)
    null, _ = np.linalg.qr(np.asarray(solution.null_space) / units[:, None])
    seen = np.linalg.svd(null.T)[2][null.shape[1] :]
    d = seen @ ((np.asarray(solution.parameters) - theta) / units)
    c = seen @ (np.asarray(solution.parameter_covariance) / np.outer(units, units)) @ seen.T
    return float(d @ np.linalg.solve(c, d)) / len(d)


def test_a_tilted_mirror_leaks_into_the_functions_unless_its_tilt_is_unknown():
    """Step diagonals of a machine with errors of its own model, mirrors tilted by up to 1 mrad.

    With unknown tilts all that is determined is within u, and the tilts are. With tilts that are said to be 0 nothing looks wrong
    (the verdict accepts), and the functions are: 1 mrad times a step of 30 mm is 30 µm.
    """
    machine = machine_of(THREE + '[model.functions]\n"E?0S" = false\n')
    plan = step_diagonals(machine, 6, TOOLS[0])
    drawn = simulate(plan, exact_truth(machine), seed=4)[1].instruments
    tilted = {name: 50.0 * value for name, value in drawn.items() if name.startswith("mirror")}
    campaign, truth = simulate(plan, replace(exact_truth(machine), instruments=tilted), seed=4)
    (own,) = campaign.sets
    known = fit(replace(campaign, sets=(replace(own, options={**own.options, "misalignment": False}),)))
    solution = fit(campaign)
    tilts = [(i, e) for i, e in enumerate(solution.nuisance_table) if e.key[0] == "beam"]
    assert len(tilts) == 8 and all(e.name.startswith("mirror step diagonals line") for _, e in tilts)
    for i, entry in tilts:
        i += solution.model.n_parameters
        u = float(np.sqrt(solution.covariance[i, i]))
        assert (
            abs(float(solution.nuisance[i - solution.model.n_parameters]) - truth.instruments[entry.name])
            < 4.0 * u
            < 2e-3
        )
    assert not solution.adequacy.rejected and not known.adequacy.rejected
    theta = exact_parameters(solution.model)
    assert chi_square(solution, theta) < 1.0 + 4.0 * np.sqrt(2.0 / 40)  # some 40 dimensions
    assert chi_square(known, theta) > 100.0


def test_an_interrupted_beam_has_an_offset_of_its_own_and_a_new_run_has_none():
    plan = EXAMPLES["projection"].plan()
    own = plan.sets[-1]
    labels = {**own.labels, "run": np.resize(["1", "2", "3"], len(own))}
    table = NuisanceTable()
    PROJECTION.groups(replace(own, labels=labels), plan, table)
    assert [e.key[2:] for e in table.entries] == [(n, s) for n in own.options["lines"] for s in "12"]
    assert table.entries[0].name == "offset own line PPP segment 1"
    assert PROJECTION.runs_by(own) == ("line", "segment")
    table = NuisanceTable()
    zeroed = replace(own, labels=labels, options={**own.options, "offset_per": "run"})
    PROJECTION.groups(zeroed, plan, table)
    assert len(table.entries) == 4 * 2 * 3 and PROJECTION.runs_by(zeroed) == ("line", "run", "segment")
    assert table.entries[0].name == "offset own line PPP run 1 segment 1"
    starts = PROJECTION.starts(replace(plan, sets=(replace(zeroed, readings=np.zeros((len(own), 1))),)))
    assert starts.keys() == table.keys.keys() and PROJECTION.dead_paths(zeroed, starts).shape == (len(own), 1)


def test_a_cosine_error_is_an_effect_of_the_line():
    """An effect of type scale acts on the displacement, and neither on the offset nor on where the workpiece's origin is."""
    plan = diagonals(machine_of(THREE), 5, faces=False)
    effect = Effect("cosine error", "scale", 5e-7, "line", {})
    campaign = replace(plan, sets=(replace(plan.sets[0], effects=(effect,)),))
    found = simulate(campaign, exact_truth(campaign.machine), seed=3, noise=False)
    plain = simulate(plan, exact_truth(plan.machine), seed=3, noise=False)
    drawn = found[1].instruments
    for line in beams_of(plan.sets[0], plan):
        change = (found[0].sets[0].readings - plain[0].sets[0].readings)[line.rows, 0]
        np.testing.assert_allclose(change, drawn[f"cosine error {line.name}"] * line.nominal, rtol=2e-3, atol=1e-7)


def beside_distances(seed: int = 3) -> Campaign:
    """Simulated diagonals beside distances from four stations that see every tool vector."""
    machine = machine_of(THREE)
    stations, volume = distances(machine, 60)
    plan = Campaign(machine, stations, (volume, *diagonals(machine, 21, TOOLS[0]).sets))
    return simulate(plan, exact_truth(machine), seed=seed, station_error=1.0)[0]


def with_readings(campaign: Campaign, readings: np.ndarray) -> Campaign:
    """The campaign with other readings in its last set."""
    return replace(campaign, sets=(*campaign.sets[:-1], replace(campaign.sets[-1], readings=readings)))


@pytest.mark.slow
def test_a_wrong_refractive_index_and_a_lost_beam_are_named():
    """20 µm/m too long, and 20 µm more from the 26th row of a line on: said, and the latter cured by a robust fit."""
    campaign = beside_distances()
    assert not fit(campaign).adequacy.rejected
    own = campaign.sets[-1]
    cause = fit(with_readings(campaign, own.readings * (1.0 + 2e-5))).adequacy.causes[0]
    assert cause.what == "lengths of set 'diagonals' have another scale" and 'per = "set"' in cause.cure
    jumped = own.readings + 0.02 * ((own.labels["line"] == "PPP") & (np.arange(len(own)) >= 25))[:, None]
    solution = fit(with_readings(campaign, jumped), robust=True)
    assert not solution.adequacy.rejected
    said, found = solution.notes[0].split(" (by ")
    assert said == "beam of line PPP segment 1 was broken before diagonals plan, row 26"
    assert abs(float(found.split()[0]) - 20.0) < 1.0, "two means of ten readings and more of 0.5 µm"


# --------------------------------------------------------------------------------------------------------- messages


def read(plan: Campaign, change=lambda r, s: r) -> Campaign:
    """A plan with readings of the machine of `exact_truth`, changed."""
    campaign, _ = simulate(plan, exact_truth(plan.machine), seed=3)
    own = campaign.sets[-1]
    return replace(campaign, sets=(*campaign.sets[:-1], replace(own, readings=change(own.readings, own))))


def only(line, factor=0.0, add=0.0):
    """Readings of one line times a factor."""
    return lambda r, s: np.where((s.labels["line"] == line)[:, None], factor * r + add, r)


BODY = diagonals(machine_of(THREE), 7, faces=False)
WRONG = {
    "reversed": (
        only("PNP", -1.0),
        r"PNP': displacements decrease where the tool moves along \[.*negate them, or turn",
    ),
    "in metres": (only("NPP", 1e-3), "NPP': displacements seem to be in metres; expected mm"),
    "in inches": (only("NPP", 1 / 25.4), "NPP': displacements seem to be in inches"),
    "reversed, in µm": (only("PPP", -1e3), "PPP': displacements decrease where.*seem to be in micrometres"),
    "deviations": (
        only("PPN", 0.0, 0.004),
        "PPN': displacements change by 0 mm while the tool moves by .*be deviations",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_displacements_that_contradict_the_positions_are_named(name):
    change, said = WRONG[name]
    with pytest.raises(InputError, match=f"diagonals plan, row [0-9]+, line '.*{said}"):
        check_campaign(read(BODY, change))


def test_large_errors_are_taken_when_their_user_says_so():
    """A line 2 % short: no slip that is known, and no error of a machine in order."""
    campaign = read(BODY, only("PPP", 0.0, 0.004))
    check_campaign(with_large_errors(campaign))


def test_a_tool_that_does_not_move_along_the_beam_reads_its_straightness():
    machine = machine_of(THREE)
    q = np.tile([200.0, 300.0, -150.0], (9, 1))
    q[:, machine.index("X")] = np.linspace(0.0, 150.0, 9)
    stated = {"lines": {"S": [0.0, 1.0, 0.0]}, "mirror": "flat", "mirror_on": "body"}
    plan = Campaign(machine, (), (plan_set("own", "projection", q, TOOLS[0], {"line": "S"}, **stated),))
    check_campaign(read(plan))
    with pytest.raises(InputError, match=r"does not move along the beam, but displacement is .* is it in µm"):
        check_campaign(read(plan, lambda r, s: 1e3 * r))


def changed(plan: Campaign, **options) -> Campaign:
    own = plan.sets[-1]
    return replace(plan, sets=(*plan.sets[:-1], replace(own, options={**own.options, **options})))


def test_positions_that_leave_the_beam_are_named_with_where_they_go():
    lines = {**BODY.sets[0].options["lines"], "PPP": [1.0, 1.0, 1.0]}
    said = (
        r"beside the beam of line 'PPP', which runs along \[0.5774, 0.5774, 0.5774\], while positions go along \[0.76"
    )
    with pytest.raises(InputError, match=said):
        check_campaign(read(changed(BODY, lines=lines)))


def test_a_direction_of_two_digits_is_too_rough_and_one_of_four_is_not():
    """(0.77, 0.51, 0.38) is 3 mrad off: 4 µm of 781 mm; four digits are 40 µrad off: 1 nm."""
    exact = np.array(BODY.sets[0].options["lines"]["PPP"])
    campaign = read(BODY)

    def stated(digits):
        return changed(campaign, lines={**campaign.sets[0].options["lines"], "PPP": exact.round(digits).tolist()})

    rough = exact.round(2) / np.linalg.norm(exact.round(2))
    short = 1e3 * np.sqrt(600**2 + 400**2 + 300**2) * (1.0 - rough @ exact)
    said = rf"line 'PPP' is said to run .* run along \[0.768221, 0.512148, 0.384111\]: .* be {short:.2g} µm too short"
    with pytest.raises(InputError, match=said):
        check_campaign(stated(2))
    check_campaign(stated(4))
    check_campaign(changed(stated(2), misalignment=True, misalignment_u=5e-3))
    check_campaign(with_large_errors(stated(2)))


@pytest.mark.parametrize("axis", ["X", "Z"])
def test_an_axis_that_counts_the_other_way_is_thought_of(axis):
    campaign = read(parallel_lines(machine_of(THREE), 5))
    own = campaign.sets[0]
    i = campaign.machine.index(axis)
    low, high = campaign.machine.axes[i].travel
    positions = own.positions.copy()
    positions[:, i] = low + high - positions[:, i]
    with pytest.raises(InputError, match=f"line '{axis}_1': .*if an axis counts the other way, its column"):
        check_campaign(replace(campaign, sets=(replace(own, positions=positions),)))


def test_readings_that_stand_one_row_too_low_are_found_before_the_fit():
    campaign = read(BODY, lambda r, s: np.roll(r, 1, axis=0))
    with pytest.raises(InputError, match="the readings of set 'diagonals' stand one row too low"):
        check_nominal(campaign)


def test_a_rotary_axis_that_turns_the_mirror_away_is_named():
    plan = EXAMPLES["projection, flat mirror, table and head"].plan()
    own = plan.sets[-1]
    positions = own.positions.copy()
    positions[5, plan.machine.index("B")] += 3.0
    campaign = replace(plan, sets=(replace(own, positions=positions),))
    with pytest.raises(InputError, match=r"row 6: a rotary axis turns the flat mirror by 2.47°"):
        PROJECTION.check_values(campaign.sets[0], campaign)


OPTIONS = {
    "no such mirror": ({"mirror": "prism"}, "mirror is 'prism'; expected retro or flat"),
    "no such side": ({"mirror_on": "table"}, "mirror_on is 'table'; expected tool or body"),
    "a reflector on the body": ({"mirror_on": "body"}, "mirror_on = 'body' is for a flat mirror"),
    "no such offset": ({"offset_per": "day"}, "offset_per is 'day'; expected line or run"),
    "no direction": (
        {"lines": {"PPP": [1, 1, 1]}},
        "line 'NPP': nothing among PPP; expected the direction of the beam",
    ),
    "no vector": ({"lines": {"PPP": [0, 0, 0]}}, r"line 'PPP': found \[0, 0, 0\]; expected the direction"),
    "no point": (
        {"lines": {"PPP": {"along": [1, 1, 1], "point": [1, 2]}}},
        r"line 'PPP': point is \[1, 2\]; expected three",
    ),
    "an unknown key": ({"lines": {"PPP": {"along": [1, 1, 1], "normal": [1, 0, 0]}}}, "line 'PPP': found .*normal"),
    "angles twice": ({"alignment": "laser", "misalignment": True}, "misalignment = True beside alignment"),
    "bodies twice": ({"alignment": "laser", "body": "bed"}, "body = bed beside alignment"),
    "a mirror of its own": ({"alignment": "laser", "mirror": "flat"}, "mirror = flat beside alignment"),
}


@pytest.mark.parametrize("name", OPTIONS)
def test_options_that_do_not_fit_are_refused(name):
    options, said = OPTIONS[name]
    with pytest.raises(InputError, match=f"set 'diagonals'.*{said}"):
        PROJECTION.check(changed(BODY, **options).sets[0])


def test_an_alignment_of_surfaces_is_none_of_beams():
    square = EXAMPLES["component, one artefact"].plan()
    own = changed(BODY, alignment="square").sets[0]
    campaign = replace(square, sets=(*square.sets, own))
    with pytest.raises(InputError, match="the alignment 'square' is that of set 'own' too, of kind component"):
        PROJECTION.groups(own, campaign, NuisanceTable())


def test_angles_that_nothing_shows_are_refused_unless_a_prior_is_stated():
    with pytest.raises(InputError, match=r"all positions of line 'PPP' lie on its beam.*type = 'scale', per = 'line'"):
        check_campaign(
            read(changed(BODY, misalignment=True, misalignment_u=1e-3)) and changed(read(BODY), misalignment=True)
        )
    check_campaign(changed(read(BODY), misalignment=True, misalignment_u=1e-3))
    shared = replace(changed(read(BODY), alignment="laser"), alignments=(Alignment("laser"),))
    with pytest.raises(InputError, match="lie on its beam"):
        check_campaign(shared)


@pytest.mark.parametrize("body", ["tool", "Z"])
def test_a_body_that_no_beam_can_stand_on_is_named(body):
    """Z carries the tool: a beam from there would never change."""
    with pytest.raises(
        InputError, match=f"body is '{body}'; expected one that the tool moves against, workpiece, bed, Y, X$"
    ):
        check_campaign(changed(read(BODY), body=body))


def test_a_manifest_as_a_user_writes_it(tmp_path):
    campaign = read(parallel_lines(machine_of(THREE), 5, lines=1))
    path = write_manifest(campaign, tmp_path / "laser")
    text = path.read_text().splitlines()
    kept = [line for line in text if not line.startswith(("mirror", "misalignment", "body"))]
    path.write_text(
        "\n".join(kept).replace("X_1 = [1.0, 0.0, 0.0]", "X_1 = { along = [2, 0, 0], point = [0, 200, -300] }")
    )
    again = load_campaign(path).sets[0]
    assert again.options["mirror"] == "retro" and again.options["misalignment_u"] == np.inf
    (line, *_) = beams_of(again, campaign)
    assert line.beam.along.tolist() == [1.0, 0.0, 0.0] and line.point.tolist() == [0.0, 200.0, -300.0]
    path.write_text("\n".join(line for line in kept if not line.startswith("lines")))
    with pytest.raises(InputError, match="lines"):
        load_campaign(path)


def test_positions_all_over_the_volume_are_no_beam():
    machine = machine_of(THREE)
    own = plan_set(
        "own", "projection", positions_of(machine, 20), TOOLS[0], {"line": "D"}, lines={"D": [1, 0, 0]}, mirror="flat"
    )
    with pytest.raises(InputError, match=r"mm beside the beam of line 'D'.*at most 300 mm with mirror = 'flat'"):
        check_campaign(read(Campaign(machine, (), (own,))))


def test_virtual_mirrors_stand_where_an_interferometer_reads_them():
    """Tilts of mirrors of a planned path, as the simulation draws them, against the tolerance of plane-mirror optics."""
    plan = step_diagonals(read_machine("models/wYXbZt_vertical.toml"), 3)
    _, truth = simulate(plan, seed=1)
    tilts = [abs(value) for name, value in truth.instruments.items() if name.startswith("mirror")]
    assert len(tilts) == 8 and 1e-6 < max(tilts) < 1e-4
