"""Circular tests: closed forms on machines with one error at a time, minimum zones against a search, what is refused."""

import re
from dataclasses import replace

import numpy as np
import pytest
from exact_chain import ExactMachine, Truth
from exact_chain.ball_bar import BallBar, Drives, turn
from support.circles import bar, bar_test

from volid.exceptions import InputError
from volid.standards.circular.evaluation import evaluate_circular
from volid.standards.circular.readings import circular_readings
from volid.standards.circular.remarks import by_noise
from volid.standards.circular.zone import minimum_zone

R = 150.0  # mm
TINY = 2e-6  # mm: second-order terms of errors of some µm, and positions rounded to 10 nm
SLOPE = 4.0 * TINY / R


def values(evaluation, *but):
    """Values of the geometry that ought to be 0, but for those named."""
    named = ("squareness", "scale", "B_E", "lag", "bow", "spike")
    return {q.symbol: q.value for q in evaluation.quantities if q.symbol.startswith(named) and q.symbol not in but}


def assert_nothing_else(evaluation, *but):
    for symbol, value in values(evaluation, *but).items():
        assert abs(value) < (SLOPE if symbol[:2] in ("sq", "sc") else TINY), (symbol, value)


@pytest.mark.parametrize("plane, name, sign", [("XY", "EC0Y", 1), ("YZ", "EA0Z", 1), ("ZX", "EB0Z", -1)])
def test_squareness_gives_r_times_it(plane, name, sign):
    """Δr = -(R α/2) sin 2φ: both circular deviations are R α in every sense, no mean radius, no hysteresis."""
    square = 40e-6
    found = evaluate_circular(bar_test(bar(Truth(constants={name: square})), plane))
    reversed_name = plane[::-1]
    for symbol in (f"G_{plane}", f"G_{reversed_name}", f"G_b_{plane}"):
        # largest at 45°, which steps of 5° meet
        assert found[symbol].value == pytest.approx(R * square, abs=TINY)
        assert found[f"{symbol}_ls"].value == pytest.approx(R * square, abs=TINY)
    assert found["F_max"].value == pytest.approx(R * square / 2.0, abs=TINY)
    assert found["F_min"].value == pytest.approx(-R * square / 2.0, abs=TINY)
    assert found[f"D_{plane}"].value == pytest.approx(0.0, abs=TINY)
    assert found[f"H_{plane}"].value == pytest.approx(0.0, abs=TINY)
    assert found[f"squareness_{plane}"].value == pytest.approx(sign * square, abs=SLOPE)
    assert_nothing_else(found, f"squareness_{plane}")


def test_scale_gives_an_ellipse_and_half_of_it_as_mean_radius():
    """EXX = s (x - x0): Δr = R s cos²φ."""
    scale = 30e-6
    found = evaluate_circular(bar_test(bar(Truth({"EXX": lambda x: scale * (x - 500.0)})), "XY"))
    assert found["scale_XY"].value == pytest.approx(scale, abs=SLOPE)
    assert found["G_b_XY"].value == pytest.approx(R * scale, abs=TINY)
    assert found["D_XY"].value == pytest.approx(R * scale / 2.0, abs=TINY)
    assert found["diameter_XY"].value == pytest.approx(R * scale, abs=2 * TINY)
    assert_nothing_else(found, "scale_XY")


def test_pitch_gives_a_scale_that_depends_on_the_lever():
    """EBX = κ (x - x0) turns what stands z above the carriage's origin: e_x = κ (x - x0) z."""
    pitch = 2e-7  # rad/mm
    virtual = bar(Truth({"EBX": lambda x: pitch * (x - 500.0)}))
    found = evaluate_circular(bar_test(virtual, "XY"))
    lever = virtual.socket[2]  # functional point over the machine's origin
    assert found["scale_XY"].value == pytest.approx(pitch * lever, abs=3 * SLOPE)  # (R κ)² R of second order
    assert found["G_b_XY"].value == pytest.approx(R * abs(pitch * lever), abs=3 * TINY)


@pytest.mark.parametrize("name, shift", [("EYX", ("centre_Y", -1)), ("EXY", ("centre_X", -1))])
def test_a_bow_gives_three_lobes_and_moves_the_centre(name, shift):
    """EYX = k ((x - x0)/R)²: Δr = k cos²φ sin φ = k/4 (sin φ + sin 3φ); three lobes of k/4, so G = k/2."""
    bow, middle = 0.008, {"X": 500.0, "Y": 300.0}[name[2]]
    found = evaluate_circular(bar_test(bar(Truth({name: lambda q: bow * ((q - middle) / R) ** 2})), "XY"))
    assert found[f"bow_{name}"].value == pytest.approx(bow, rel=1e-3)
    assert found[shift[0]].value == pytest.approx(shift[1] * bow / 4.0, rel=1e-3)
    assert found["G_b_XY"].value == pytest.approx(bow / 2.0, abs=TINY)  # lobes at 30°, 90°, …: steps of 5° meet them
    assert_nothing_else(found, f"bow_{name}")


@pytest.mark.parametrize("name", ["EXX", "EYY", "EYX", "EXY"])
def test_reversal_is_found_with_its_sign_and_axis(name):
    """E(±) = ±B/2; of positioning the paths of both senses differ by B where the axis turns, and no mean radius is left."""
    reversal = 0.005
    found = evaluate_circular(bar_test(bar(Truth(reversal={name: lambda q: np.full(np.shape(q), reversal)})), "XY"))
    assert found[f"B_{name}"].value == pytest.approx(reversal, abs=TINY)
    assert_nothing_else(found, f"B_{name}")
    turns = (
        1.0 / 72.0 if name in ("EXX", "EYY") else 0.0
    )  # two of 72 readings stand at a turn, where both senses see +B/2
    assert found["D_XY"].value == pytest.approx(turns * reversal, abs=TINY)
    if name in ("EXX", "EYY"):  # the reading at the turn has the old direction, the next one, 5° on, the new one
        assert found["H_XY"].value == pytest.approx(reversal, rel=0.5 * np.deg2rad(5.0) ** 2)
        least = 0.5 * reversal * (1.0 + np.cos(np.deg2rad(5.0)))
        assert least - TINY <= found["G_XY"].value <= reversal + TINY


def test_lag_of_one_axis_is_an_ellipse_of_opposite_sign_in_the_two_senses():
    """e = -v τ: half-range v/2 (τ_X - τ_Y), and squareness stays 0."""
    lag = {"X": 0.0004, "Y": 0.0001}
    found = evaluate_circular(bar_test(bar(Truth()), "XY", drives=Drives(feed=3000.0, lag=lag)))
    assert found["lag_XY"].value == pytest.approx(25.0 * 0.0003, abs=TINY)
    assert found["mismatch_XY"].value == pytest.approx(0.3, rel=1e-3)
    assert found["G_XY"].value == pytest.approx(50.0 * 0.0003, abs=2 * TINY)
    assert found["H_XY"].value == pytest.approx(50.0 * 0.0003, abs=2 * TINY)
    assert_nothing_else(found, "lag_XY")


def test_spikes_of_20_micrometres_do_not_move_the_geometry():
    """Less than its u, with 0.3 µm of noise and all errors; and their heights are found, at every end in either sense."""
    spikes = {"X": (0.02, 0.015), "Y": (-0.02, 0.012)}
    truth = Truth({"EXX": lambda x: 2e-5 * (x - 500.0)}, {"EC0Y": 3e-5}, {"EXX": lambda q: np.full(np.shape(q), 0.003)})
    without, with_spikes = (
        evaluate_circular(bar_test(bar(truth), "XY", drives=Drives(spike=s), noise=3e-4, step=2.5))
        for s in ({}, spikes)
    )
    for symbol in ("squareness_XY", "scale_XY", "B_EXX", "B_EYY", "lag_XY", "centre_X"):
        moved = abs(with_spikes[symbol].value - without[symbol].value)
        assert moved < with_spikes[symbol].U / 2.0, symbol
    for sense in ("XY", "YX"):
        for quadrant, height in ((0, 0.02), (180, 0.015), (90, -0.02), (270, 0.012)):
            spike = with_spikes[f"spike_{sense}_{quadrant}"]
            assert abs(spike.value - height) < 4.0 * spike.U / 2.0, spike  # eight normal numbers: quantile of 5e-4
    assert with_spikes["G_b_XY"].value > 0.03 > without["G_b_XY"].value
    assert not with_spikes.attention


@pytest.mark.parametrize("noise", [0.0, 3e-4])
def test_a_pulse_that_outlasts_the_window_is_named(noise):
    """It looks like a reversal, and less so where the window is wider; a short one does not."""
    for decay, named in ((10.0, True), (1.5, False)):
        drives = Drives(spike={"X": (0.02, 0.02)}, decay=decay)
        found = evaluate_circular(bar_test(bar(Truth()), "XY", drives=drives, noise=noise))
        assert any("B_EXX" in text and "`spike_window`" in text for text in found.attention) == named, (decay, noise)


def test_eccentricity_of_half_a_millimetre_is_taken_out_exactly():
    """The second order of it is 0.8 µm on this circle, and would look like a scale."""
    virtual = replace(bar(Truth(constants={"EC0Y": 2e-5})), off=(0.4, -0.3, 0.0))
    found = evaluate_circular(bar_test(virtual, "XY"))
    assert found["centre_X"].value == pytest.approx(0.4, abs=TINY)
    assert found["squareness_XY"].value == pytest.approx(2e-5, abs=SLOPE)
    assert found["scale_XY"].value == pytest.approx(0.0, abs=SLOPE)
    assert found["G_b_XY"].value == pytest.approx(R * 2e-5, abs=TINY)
    setup = evaluate_circular(bar_test(virtual, "XY"), setup_centre=True)
    assert setup["F_max"].value == pytest.approx(0.5, abs=0.01) and setup["G_b_XY"].value == found["G_b_XY"].value


# ------------------------------------------------------------------------------------------------------- minimum zone


def test_minimum_zone_is_that_of_a_search():
    """Centres on a fine grid: none encloses the path more narrowly, and one does as narrowly."""
    rng = np.random.default_rng(5)
    phi = np.sort(rng.uniform(0.0, 2.0 * np.pi, 60))
    d = np.stack([np.cos(phi), np.sin(phi)], axis=1)
    path = (100.0 + 0.02 * rng.standard_normal(60) + 0.03 * np.cos(2 * phi) + 0.3 * np.cos(phi))[:, None] * d
    deviation = np.linalg.norm(path, axis=1) - 100.0
    zone = minimum_zone(d, deviation, 100.0)

    def width(centre):
        away = np.linalg.norm(path - centre, axis=1)
        return np.ptp(away)

    assert width(zone.centre) == pytest.approx(zone.width, abs=1e-9)
    grid = [zone.centre + 1e-3 * np.array([i, j]) for i in range(-20, 21) for j in range(-20, 21)]
    assert min(width(c) for c in grid) >= zone.width - 1e-9
    touching = np.flatnonzero(zone.weights)
    assert len(touching) == 4  # two circles touch at two places each, by turns
    assert sum(zone.weights[zone.weights > 0]) == pytest.approx(1.0) == -sum(zone.weights[zone.weights < 0])


def test_u_of_a_circular_deviation_is_what_repeats_scatter_by():
    """400 repeats of a path whose extremes stand well apart."""
    rng = np.random.default_rng(11)
    angle = np.arange(0.0, 360.0, 15.0)
    shape = 0.02 * np.sin(2.0 * np.deg2rad(angle))
    d = np.stack([np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle))], axis=1)
    widths = [minimum_zone(d, shape + 3e-4 * rng.standard_normal(24), 100.0).width for _ in range(400)]
    weights = minimum_zone(d, shape, 100.0).weights
    u = 3e-4 * np.sqrt(np.sum(weights**2))
    assert np.std(widths) == pytest.approx(u, rel=0.2)  # s of 400 is within 10 %; other points may touch


# --------------------------------------------------------------------------------------- readings, and what is refused


def test_runs_are_cut_where_sense_label_or_turn_changes():
    up, down = np.arange(-110.0, 111.0, 5.0), np.arange(110.0, -111.0, -5.0)
    test = circular_readings("YZ", R, np.concatenate([up, down, down, up]), np.zeros(4 * len(up)))
    assert [int(test.sense[rows[0]]) for rows in test.runs] == [1, -1, -1, 1]
    assert [len(rows) for rows in test.runs] == [45, 45, 45, 45] and test.arc == 220.0
    two_turns = circular_readings("XY", R, np.arange(0.0, 721.0, 5.0), np.zeros(145))
    assert [len(rows) for rows in two_turns.runs] == [73, 72] and two_turns.is_full


def test_a_plane_named_the_other_way_round_counts_its_angle_from_the_other_axis():
    """XZ: from +X towards +Z. A readings at 0° stands at +X either way, and the squareness is the same."""
    virtual = bar(Truth(constants={"EB0Z": 3e-5}))
    known = bar_test(virtual, "ZX")
    turned = circular_readings("XZ", R, 90.0 - known.angle, known.deviation, -known.sense)
    assert turned.plane == "ZX" and np.allclose(turned.angle, known.angle) and (turned.sense == known.sense).all()
    found = evaluate_circular(turned)
    assert found["squareness_ZX"].value == pytest.approx(-3e-5, abs=SLOPE)


def test_one_sense_alone_does_not_tell_squareness_from_lag():
    test = bar_test(bar(Truth(constants={"EC0Y": 3e-5})), "XY", senses=(1,))
    found = evaluate_circular(test)
    symbols = [q.symbol for q in found.quantities]
    assert not {"squareness_XY", "lag_XY", "G_b_XY", "H_XY", "D_XY", "G_YX"} & set(symbols)
    assert any("not determined: squareness_XY, lag_XY" in text for text in found.remarks)
    assert {"G_XY", "scale_XY", "B_EXX"} <= set(symbols)


def test_an_unknown_length_leaves_out_what_needs_it():
    test = replace(bar_test(bar(Truth(constants={"EC0Y": 3e-5})), "XY"), length_u=np.inf)
    raised = replace(test, deviation=test.deviation + 1.0)
    found = evaluate_circular(raised)
    assert not [q.symbol for q in found.quantities if q.symbol.startswith(("F_", "D_", "diameter"))]
    assert found["G_b_XY"].value == pytest.approx(R * 3e-5, abs=TINY)
    assert found["squareness_XY"].value == pytest.approx(3e-5, abs=SLOPE)


def test_a_bar_set_anew_between_the_senses_has_a_length_of_its_own_each():
    test = bar_test(bar(Truth(constants={"EC0Y": 3e-5})), "XY")
    part = (test.sense < 0).astype(int)
    anew = replace(test, deviation=test.deviation + 0.2 * part, part=part, length_u=np.inf)
    found = evaluate_circular(anew)
    assert found["G_b_XY"].value == pytest.approx(R * 3e-5, abs=TINY)
    assert found["H_XY"].value == pytest.approx(0.0, abs=TINY)


@pytest.mark.parametrize(
    "changed, message",
    [
        ({"plane": "XA"}, r"c\.csv: plane is 'XA'; expected one of XY, YZ, ZX"),
        ({"radius": 0.0}, r"radius is 0; expected the nominal radius"),
        ({"deviation": np.linspace(0.0, 100.0, 73)}, "deviations of the radius reach 50 mm on a circle of 150 mm"),
        (
            {"angle": np.arange(5.0), "deviation": np.zeros(5)},
            "the run that begins at 0° has 5 readings; expected at least 8",
        ),
    ],
)
def test_what_is_no_circular_test_is_refused(changed, message):
    given = {"plane": "XY", "radius": R, "angle": np.arange(0.0, 361.0, 5.0), "deviation": np.zeros(73)} | changed
    with pytest.raises(InputError, match=message):
        circular_readings(**given, source="c.csv")


def test_a_window_of_more_than_half_a_quadrant_is_refused():
    test = bar_test(bar(Truth()), "XY")
    with pytest.raises(InputError, match=r"`spike_window=50`: expected an angle from 0 to 45 degrees"):
        evaluate_circular(test, spike_window=50.0)


def test_the_virtual_bar_reads_its_length_on_a_perfect_machine():
    machine = ExactMachine("w b X Y Z t", {"X": (0.0, 1000.0), "Y": (0.0, 600.0), "Z": (-500.0, 0.0)})
    perfect = BallBar(machine, Truth(), (0.0, 0.0, -150.0), (500.0, 300.0, -420.0))
    assert np.allclose(perfect.read("YZ", turn("YZ", 220.0, 1, 5.0), 1), R, atol=2e-5)


def test_a_short_arc_leaves_blank_what_it_does_not_tell():
    test = bar_test(bar(Truth(constants={"EA0Z": 3e-5})), "YZ", 40.0, step=1.0, noise=3e-4)
    found = evaluate_circular(test)
    symbols = {q.symbol for q in found.quantities}
    assert {"G_YZ", "G_b_YZ", "H_YZ"} <= symbols and not {"squareness_YZ", "scale_YZ"} & symbols
    assert any(text.startswith("not determined: scale_YZ, squareness_YZ") for text in found.remarks)


def test_an_arc_within_the_windows_is_refused():
    test = bar_test(bar(Truth()), "XY", 10.0, step=1.0)
    with pytest.raises(InputError, match=r"6 readings stand outside the windows .* expected at least 14"):
        evaluate_circular(test)


def test_readings_that_scatter_by_more_than_their_u_enlarge_it_and_that_is_said():
    good = bar_test(bar(Truth()), "XY", noise=1e-3)
    boast = replace(good, u=np.full(len(good), 1e-4))
    found = evaluate_circular(boast)
    assert any("scatter by" in text and "times the stated u" in text for text in found.remarks)
    assert pytest.approx(evaluate_circular(good)["squareness_XY"].U, rel=0.3) == found["squareness_XY"].U
    unknown = evaluate_circular(replace(good, u=None))
    assert pytest.approx(found["squareness_XY"].U, rel=0.1) == unknown["squareness_XY"].U and unknown["G_XY"].U is None


def test_many_noisy_readings_make_a_range_larger_and_that_is_said():
    """R α = 4.5 µm; 3602 readings with u = 0.3 µm reach farther than 3 u on either side."""
    test = bar_test(bar(Truth(constants={"EC0Y": 3e-5})), "XY", step=0.2, noise=3e-4)
    found = evaluate_circular(test)
    symbol, larger, U = by_noise(found.details)
    assert symbol == "G_b_XY" and pytest.approx(found["G_b_XY"].U) == U
    assert found["G_b_XY"].value - R * 3e-5 > 2.0 * U  # beyond its U
    assert found["G_b_XY"].value - larger == pytest.approx(R * 3e-5, abs=3e-4)
    assert any("noise of the readings makes G_b_XY about" in text for text in found.remarks)
    quiet = evaluate_circular(bar_test(bar(Truth(constants={"EC0Y": 3e-4})), "XY", noise=1e-4))
    assert not any("noise of the readings" in text for text in quiet.remarks)


def test_a_short_arc_has_no_wider_window_to_be_tried_with():
    """A spike, and an arc of which 30° leave too little: evaluated, and nothing is said of the window."""
    drives = Drives(spike={"Z": (0.02, 0.02)})
    found = evaluate_circular(bar_test(bar(Truth()), "YZ", 50.0, step=5.0, drives=drives, noise=3e-4), spike_window=8.0)
    assert found["spike_YZ_90"].value == pytest.approx(0.02, abs=2e-3) and not found.attention


@pytest.mark.parametrize(("radius", "added"), [(R, R), (2.0 * R, -R), (R, -R)])
def test_lengths_of_another_circle_are_refused(radius, added):
    """Lengths under deviation, a diameter for a radius, deviations under radius: squareness would be wrong by a factor."""
    angle = np.arange(0.0, 360.0, 5.0)
    with pytest.raises(
        InputError, match=f"radii of about .* on a circle of {radius:g} mm; expected the nominal radius"
    ):
        circular_readings("XY", radius, angle, added - 0.0015 * np.sin(np.deg2rad(2.0 * angle)))


def test_a_length_without_u_is_named():
    angle = np.concatenate([np.arange(0.0, 361.0, 5.0), np.arange(360.0, -1.0, -5.0)])
    test = replace(circular_readings("XY", R, angle, 0.0 * angle), u=np.full(len(angle), 2e-4))
    said = [
        any("no u of the bar's length is known" in r for r in evaluate_circular(t).remarks)
        for t in (test, replace(test, length_u=5e-4))
    ]
    assert said == [True, False]


def pitched(amplitude: float, step: float, phase: float, rng):
    """Angles there and back, and radii of a machine whose X has a pitch error of 10 mm and a reversal of 2 µm, in closed form."""
    way = np.arange(0.0, 360.0 + step / 2.0, step)
    angle, sense = np.concatenate([way, way[::-1]]), np.repeat([1.0, -1.0], len(way))
    phi = np.deg2rad(angle)
    moving = -sense * np.sign(np.sin(phi - 1e-7 * sense))
    x = R * np.cos(phi) + amplitude * np.sin(2.0 * np.pi * R * np.cos(phi) / 10.0 + phase) + 0.001 * moving
    read = np.hypot(x, R * np.sin(phi)) - R + 2e-4 * rng.standard_normal(len(angle))
    return angle, read


@pytest.mark.parametrize("step", [1.0, 2.0])
def test_short_waves_of_both_senses_are_named_and_noise_is_not(step):
    """A pitch error of 2 µm makes B_EXX wrong by twice its U where it stands still at the ends of X."""
    rng = np.random.default_rng(5)
    for amplitude, named in ((0.002, True), (0.0, False)):
        for phase in (0.0, 1.0, 2.0):
            angle, read = pitched(amplitude, step, phase, rng)
            test = replace(circular_readings("XY", R, angle, read), u=np.full(len(angle), 2e-4), length_u=5e-4)
            found = [text for text in evaluate_circular(test).attention if "too short for the geometry" in text]
            assert bool(found) == named
            assert not named or re.search("about (1.[0-9]|2.[0-4]) µm", found[0])
