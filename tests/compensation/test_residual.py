"""Predicted residuals: they agree with what the exact chain leaves, within their intervals; wrong tools, increments, limits,
draws."""

from dataclasses import replace

import h5py
import numpy as np
import pytest
from exact_chain import Truth, gauge_free
from scipy.spatial.transform import Rotation
from support.compensated import MACHINES, TOOL, machine_and_solution, node_positions, remaining
from support.machines import NUTATING, ROTARY_TABLE, STRUCTURES, exact_machine, resolved
from support.made_up import made_up, truth_of

from volid.cli import main
from volid.compensation.alignment import aligned_to_spindle
from volid.compensation.base import base_of
from volid.compensation.control import Control
from volid.compensation.grids.linear import linear_grid
from volid.compensation.motion import asked_motion, asked_speed, check_motion
from volid.compensation.orientation import PoleRule, distance_from_pole, poles
from volid.compensation.package import compensate
from volid.compensation.residual.fields import QUANTITIES, Places, volume_places
from volid.compensation.residual.forecast import forecast
from volid.compensation.residual.volume import predict_residual
from volid.compensation.rigid import best_rigid
from volid.compensation.tables.sampling import Sampling
from volid.compensation.types import TYPES, select
from volid.exceptions import InputError, NotDeterminedError
from volid.fitting.results import Residuals, Statistics
from volid.io.solutions import write_solution
from volid.uncertainty.trials.samples import Samples

SECOND_ORDER = 5e-5  # mm: (100 µrad)² × 1 m is 0.01 µm; products of several errors add up
TRUTHS = 24
# Binomial(24, 5 %) reaches 8 with probability 1.4e-5; over 45 cases × 10 quantities one of them does in 0.6 % of all seeds.
# Intervals half as wide as they should be hold 67 %: then 8 of 24 are outside on average, and about half of all pairs fail.
MOST_OUTSIDE = 7


@pytest.mark.parametrize("layout", MACHINES)
def test_prediction_agrees_with_the_simulated_machine(layout):
    """Every type by itself, every quantity: of true machines drawn from the covariance, judged by exact matrices, no fewer lie
    inside the 95 % interval than such intervals allow, case by case and without slack; nor are all of them inside."""
    exact, solution = machine_and_solution(layout, seed=3, u=0.15)
    rotary = layout != "three-axis"
    base = base_of(solution, TOOL, functions=("EXX", "EBX", "EXC", "EYC") if rotary else ("EXX", "EBX"))
    places = volume_places(solution.machine, 48)
    lists = [[n] for n in TYPES if rotary or (n.startswith("L-") and n != "L-VOL+")]
    lists += [["L-VOL", "R-VOL"], ["L-VOL+", "R-VOL+"], ["L-POS", "R-POR"]] if rotary else []
    rule = {"poles": PoleRule(10.0)}
    found = forecast(solution, lists, base, places=places, points=7, tables=Sampling(max_points=11), control=rule)
    assert [c.name for c in found.columns] == ["none", *(" + ".join(names) for names in lists)]
    altered = [
        c.compensation.control(solution.machine, **rule).command(places.positions, np.array(TOOL))
        for c in found.columns
    ]
    spindle = exact.nominal_pose(places.positions)[:, :3, 2]
    axis = np.einsum("mji,mj->mi", exact.table_rotation(places.positions), spindle)
    root = np.linalg.cholesky(solution.parameter_covariance)
    rng, theta = np.random.default_rng(1), np.asarray(solution.parameters)
    outside = np.zeros((len(found.columns), len(QUANTITIES)))
    for _ in range(TRUTHS):
        truth = truth_of(replace(solution, parameters=theta + root @ rng.standard_normal(len(theta))))
        every = remaining(exact, truth, np.tile(places.positions, (len(altered), 1)), np.concatenate(altered), TOOL)
        for i, left in enumerate(np.split(every, len(altered))):
            value, p = simulated(exact, left, places.positions, axis), found.columns[i].predictions[0]
            outside[i] += (value < p.low) | (value > p.high)
    cases = {(c.name, q): n for c, row in zip(found.columns, outside, strict=True)
             for q, n in zip(QUANTITIES, row, strict=True) if n > MOST_OUTSIDE}  # fmt: skip
    assert not cases
    assert outside.mean() / TRUTHS > 0.005  # intervals twice as wide as they should be leave 0.01 % outside


def simulated(exact, left, q, axis):
    """The ten quantities of deviations (m, 6), the rigid motion that fits their translations best taken out, in plain NumPy."""
    back = exact.table_rotation(q).transpose(0, 2, 1)
    f = exact.functional_point(q, TOOL)
    turn = np.cross(np.eye(3)[None], f[:, None]).transpose(0, 2, 1)  # ω × f as a matrix
    rows = np.concatenate([back, back @ turn], axis=2)
    scale = np.linalg.norm(rows.reshape(-1, 6), axis=0)
    motion = np.linalg.lstsq((rows / scale).reshape(-1, 6), left[:, :3].ravel(), rcond=None)[0] / scale
    point, angle = left[:, :3] - rows @ motion, left[:, 3:] - back @ motion[3:]
    size = np.linalg.norm(point, axis=1)
    lengths = [size.max(), np.quantile(size, 0.95), np.sqrt(np.mean(size**2)), *np.abs(point).max(axis=0)]
    return np.array([*lengths, *np.abs(angle).max(axis=0), np.linalg.norm(np.cross(axis, angle), axis=1).max()])


def test_types_go_down_from_none_to_the_last():
    _, solution = machine_and_solution("tilting table", seed=3)
    found = forecast(solution, [["L-VOL"], ["L-VOL", "R-VOL"], ["L-VOL+", "R-VOL+"]], base_of(solution, TOOL), points=9)
    assert [c.name for c in found.columns] == ["none", "L-VOL", "L-VOL + R-VOL", "L-VOL+ + R-VOL+"]
    value = np.array([c.predictions[0].value for c in found.columns])
    rms, tilt = QUANTITIES.index("RMS"), QUANTITIES.index("tool axis")
    assert value[2, rms] < 0.2 * value[0, rms]
    np.testing.assert_allclose(value[2, tilt], value[0, tilt], rtol=0.1)  # orientation untouched
    np.testing.assert_allclose(value[3, :3], value[2, :3], rtol=0.01)
    for c in found.columns:
        assert np.all(c.predictions[0].low <= c.predictions[0].value) and np.all(
            c.predictions[0].value <= c.predictions[0].high
        )


def test_wrong_tool_length_shows_the_predicted_extra_deviation():
    """L-VOL with a control that believes in a tool 100 mm too long: the extra is ω × Δt in every point, by exact matrices too."""
    exact, solution = machine_and_solution("three-axis", seed=3)
    error = np.array([0.0, 0.0, -100.0])
    base, q = base_of(solution, TOOL), node_positions(exact, 64)
    made = compensate(solution, ["L-VOL"], base, points=5, uncertainty=False)
    right, wrong = made.control(solution.machine), made.control(solution.machine, tool=tuple(np.add(TOOL, error)))
    truth = truth_of(solution)
    left = [remaining(exact, truth, q, c.command(q, np.array(TOOL)), TOOL)[:, :3] for c in (right, wrong)]
    orientation = exact.deviation(q, TOOL, truth)[:, 3:]
    np.testing.assert_allclose(left[1] - left[0], -np.cross(orientation, error), atol=2e-4)
    still = Places(q, np.zeros_like(q))
    found = forecast(solution, [["L-VOL"]], base, places=still, points=5, tool_error=error)
    free, _ = gauge_free(left[1], q, TOOL, tool_rotation=False, machine=exact)
    assert found.columns[1].predictions[0].exact[0] == pytest.approx(np.linalg.norm(free, axis=1).max(), abs=1e-4)
    plain = forecast(solution, [["L-VOL"]], base, places=still, points=5)
    assert found.columns[1].predictions[0].exact[2] > 1.2 * plain.columns[1].predictions[0].exact[2]


def test_draws_are_the_monte_carlo_samples_when_there_are_some():
    """Samples of which every second is the estimate and every other one shifted by one vector: intervals end at these two
    values."""
    _, solution = machine_and_solution("three-axis", seed=3)
    theta = np.asarray(solution.parameters)
    x = np.tile(theta, (200, 1))
    x[::2] *= 1.5
    none = np.zeros(200)
    samples = Samples(200, lambda: iter([x]), none, none, none, none, 0)
    found = forecast(replace(solution, samples=samples), [], base_of(solution, TOOL))
    p = found.columns[0].predictions[0]
    assert (found.draws, found.source) == (200, "Monte Carlo samples of the solution")
    np.testing.assert_allclose(p.low, p.exact, rtol=1e-9)
    np.testing.assert_allclose(p.high, 1.5 * p.exact, rtol=1e-9)


def test_least_increment_and_clamped_axes():
    """Rounding to 2 µm adds a uniform deviation of variance (2 µm)²/12 per axis; a clamped axis gets no correction."""
    _, solution = machine_and_solution("three-axis", seed=3)
    base = base_of(solution, TOOL)
    increment = {a: 0.002 for a in "XYZ"}
    made = compensate(solution, ["L-VOL"], base, points=9, uncertainty=False)
    q = np.round(volume_places(solution.machine, 512).positions, 1)
    fine = made.control(solution.machine).command(q, np.array(TOOL)) - q
    coarse = made.control(solution.machine, increment=increment, clamped=("Y",)).command(q, np.array(TOOL)) - q
    y = solution.machine.index("Y")
    assert np.all(coarse[:, y] == 0.0)
    others = [i for i in range(3) if i != y]
    np.testing.assert_allclose(coarse[:, others] / 0.002, np.round(coarse[:, others] / 0.002), atol=1e-6)
    assert np.std((coarse - fine)[:, others]) == pytest.approx(0.002 / np.sqrt(12), rel=0.1)


def test_motion_speed_and_limits():
    """Control of one table EXX = 10 µm · sin: largest correction and its slope in closed form."""
    _, solution = machine_and_solution("three-axis", seed=3)
    made = compensate(solution, ["L-POS"], base_of(solution, TOOL), tables=Sampling(max_points=101), uncertainty=False)
    table = next(t for t in made.tables if t.function == "EXX")
    x = np.linspace(-400.0, 400.0, 801)
    wave = 0.010 * np.sin(2 * np.pi * x / 200.0)
    table = replace(table, positions=x, forward=wave, reverse=wave)
    control = Control(solution.machine, (table,))
    q = np.zeros((801, 3))
    q[:, solution.machine.index("X")] = x
    motion = asked_motion(control, q, np.array(TOOL))
    i = solution.machine.index("X")
    assert motion.largest[i] == pytest.approx(0.010, rel=1e-3)
    assert motion.slope[i, i] == pytest.approx(0.010 * 2 * np.pi / 200.0, rel=0.01)
    speed = asked_speed(motion, np.full(3, 10_000.0))
    assert speed[i] == pytest.approx(10_000.0 * 0.010 * 2 * np.pi / 200.0, rel=0.01)
    check_motion(solution.machine, motion, speed, {"X": 0.011}, {"X": 4.0})
    with pytest.raises(InputError, match=r"axis X for moves of 0\.01 mm, more than the limit of 0\.005"):
        check_motion(solution.machine, motion, speed, {"X": 0.005}, {})
    with pytest.raises(InputError, match=r"axis X for speed of 3\.1.* mm/min, more than the limit of 1"):
        check_motion(solution.machine, motion, speed, {}, {"X": 1.0})


def test_poles_are_found_named_and_kept_out_or_limited():
    """C' A' with A = 0, fork head C A with A = 0: C parallel to the spindle. Three-axis machines have no FOR to ask about."""
    for layout in ("tilting table", "fork head"):
        exact, solution = machine_and_solution(layout, seed=3)
        (pole,) = poles(solution.machine)
        assert (pole.position, pole.axis, pole.direction) == ((("A", 0.0),), "C", (0.0, 1.0, 0.0))
        assert "A = 0°: C is parallel to the spindle" in str(pole)
        q = np.zeros((201, len(exact.axes)))
        a = np.linspace(-10.0, 10.0, 201)
        q[:, exact.column("A")] = a
        made = compensate(solution, ["FOR"], base_of(solution, TOOL), points=9, uncertainty=False)
        c = exact.column("C")
        limited, out = (
            np.abs(made.control(solution.machine, poles=PoleRule(5.0, mode)).command(q, np.array(TOOL)) - q)[:, c]
            for mode in ("limit", "keep out")
        )
        assert np.all(out[np.abs(a) < 4.99] == 0.0)
        np.testing.assert_allclose(limited[np.abs(a) > 5.01], out[np.abs(a) > 5.01], rtol=1e-9)
        assert limited.max() < 2.0 * out.max() and limited[100] < 1e-9  # at the pole itself no turn
        with pytest.raises(InputError, match="`poles=off`"):
            PoleRule(5.0, "off")


@pytest.mark.parametrize("structure", [STRUCTURES["fork head CA"], NUTATING["nutating head"]])
def test_a_clamped_rotary_axis_leaves_the_best_that_the_other_can_do(structure):
    """C clamped: among all turns of the other axis none leaves less of the tool's tilt, by trial with exact matrices."""
    exact = exact_machine(structure)
    solution = made_up(resolved(exact, segments=4), seed=7)
    (other,) = set(exact.axes) & set("AB")
    q = volume_places(solution.machine, 24).positions
    made = compensate(solution, ["FOR"], base_of(solution, TOOL), grids=Sampling(max_points=9), uncertainty=False)
    control = made.control(solution.machine, clamped=("C",))
    altered = control.command(q, np.array(TOOL))
    assert np.all(altered[:, exact.column("C")] == q[:, exact.column("C")])
    told = control.expected(q, np.array(TOOL)).orientation  # interpolated; what the axis does against it is judged
    axis = np.einsum("mji,mj->mi", exact.table_rotation(q), exact.nominal_pose(q)[:, :3, 2])

    def tilt(extra):
        moved = q.copy()
        moved[:, exact.column(other)] = altered[:, exact.column(other)] + extra
        turned = exact.nominal_pose(moved)[:, :3, :3] @ exact.nominal_pose(q)[:, :3, :3].transpose(0, 2, 1)
        back = np.einsum("mji,mj->mi", exact.table_rotation(q), Rotation.from_matrix(turned).as_rotvec())
        return np.linalg.norm(np.cross(axis, told + back), axis=1)

    away = distance_from_pole(solution.machine, q) > 20.0
    assert away.sum() > 8
    for extra in (-1e-3, -1e-4, 1e-4, 1e-3):
        assert np.all((tilt(0.0) < tilt(extra))[away])
    assert np.abs(altered - q)[:, exact.column(other)].max() > 1e-3


def test_best_rigid_functions_leave_the_interaction_only():
    """EXX(x, y) without angular functions: the best EXX(x) and EXY(y) leave the doubly centred part, a closed form (7.4.2)."""
    cross = 'EXX = { over = ["X", "Y"], segments = [3, 3] }\n"E[ABC]?" = false\n"E[ABC]0S" = false'
    _, solution = machine_and_solution("three-axis", functions=cross, segments=3, seed=2)
    model = solution.model
    keep = model.by_name["EXX", "mean"].parameters
    theta = np.zeros(model.n_parameters)
    theta[keep] = np.asarray(solution.parameters)[keep]
    solution = replace(solution, parameters=theta)
    rigid, left = best_rigid(solution, np.array([TOOL]))
    assert all(len(f.splines) < 2 for f in rigid.model.functions)
    for array in (rigid.parameters, rigid.nuisance, rigid.covariance, rigid.null_space):
        assert isinstance(array, np.ndarray) and not array.flags.writeable
    x, y = np.meshgrid(np.linspace(-400, 400, 81), np.linspace(-350, 350, 81), indexing="ij")
    q = np.zeros((x.size, 3))
    q[:, solution.machine.index("X")], q[:, solution.machine.index("Y")] = x.ravel(), y.ravel()
    from volid.compensation.base import model_errors

    row = 6 * solution.machine.index("X")
    field = (model_errors(solution, q, np.zeros_like(q), lambda _: True)[:, row] @ theta).reshape(x.shape)
    centred = field - field.mean(axis=0) - field.mean(axis=1, keepdims=True) + field.mean()
    assert left.rms == pytest.approx(np.sqrt(np.mean(centred**2)), rel=0.03)  # Sobol points against a dense grid
    assert left.rms < left.rms_before
    one_line = field - field[:, 40:41]  # what functions of the line y = 0 would leave
    assert left.rms < 0.9 * np.sqrt(np.mean((one_line - one_line.mean()) ** 2))


def test_alignment_to_the_spindle():
    """After L-VOL aligned to the spindle, Z motion is parallel to the spindle at the reference: both directions from exact
    matrices."""
    exact, solution = machine_and_solution("three-axis", seed=6)
    truth = truth_of(solution)
    plain = base_of(solution, TOOL)
    z = exact.column("Z")
    q = np.tile([np.mean(exact.travel[a]) for a in exact.axes], (2, 1))
    q[:, z] = exact.travel["Z"]
    spindle = exact.pose(q[:1] * 0 + np.mean(q, axis=0), truth)[0, :3, 2]
    angle = {}
    for name, base in (("datum", plain), ("spindle", aligned_to_spindle(solution, plain))):
        made = compensate(solution, ["L-VOL"], base, points=5, uncertainty=False)
        moved = exact.functional_point(made.control(solution.machine).command(q, np.array(TOOL)), TOOL, truth)
        direction = (moved[1] - moved[0]) / np.linalg.norm(moved[1] - moved[0])
        angle[name] = np.linalg.norm(np.cross(direction, spindle))
    tilt = np.hypot(truth.constants["EA0S"], truth.constants["EB0S"])
    assert angle["datum"] == pytest.approx(tilt, abs=2e-7)
    assert angle["spindle"] < 2e-7
    column = np.zeros((solution.model.n_parameters, 1))
    column[solution.model.by_name["EA0S", "location"].parameters] = 1.0
    with pytest.raises(NotDeterminedError, match="tilt of the spindle"):
        aligned_to_spindle(replace(solution, null_space=column), plain)


def aligned_loop(layout, names, seed=6):
    """Exact machine, truth, and the controls of `names` in the datum's frame and in that of the spindle."""
    exact, solution = machine_and_solution(layout, seed=seed)
    plain = base_of(solution, TOOL)
    controls = [
        compensate(solution, names, base, points=5, uncertainty=False).control(solution.machine)
        for base in (plain, aligned_to_spindle(solution, plain))
    ]
    return exact, truth_of(solution), controls


def loop_positions(exact, m):
    """Random choices among the five nodes of every axis."""
    rng = np.random.default_rng(2)
    return np.stack([rng.choice(np.linspace(*exact.travel[a], 5), m) for a in exact.axes], axis=1)


def tilt_of_spindle(exact, truth):
    """Turn of the tool against the machine frame at the reference, rotary axes at 0, table perfect: (A, B, 0), exact matrices."""
    table = [a for a in exact.axes if a in "ABC" and exact.primed[a]]
    alone = Truth(
        functions={n: f for n, f in truth.functions.items() if n[2] not in table},
        constants={n: v for n, v in truth.constants.items() if n[3] not in table},
    )
    at = np.array([[np.mean(exact.travel[a]) if a in "XYZ" else 0.0 for a in exact.axes]])
    a, b, _ = exact.deviation(at, TOOL, alone)[0, 3:]
    return np.array([a, b, 0.0])


@pytest.mark.parametrize("layout", ["tilting table", "fork head"])
def test_z_is_parallel_to_the_spindle_on_five_axis_machines(layout):
    """L-VOL aligned to the spindle: Z moves along the spindle, on a table at every position of it, with a head at its zeros; in
    the datum's frame it is off by the tilt of the spindle. Directions in the workpiece frame by exact matrices."""
    exact, truth, controls = aligned_loop(layout, ["L-VOL"])
    tilt = np.linalg.norm(tilt_of_spindle(exact, truth))
    assert tilt > 1e-5
    turned = [(0.0, 0.0), (50.0, -90.0), (-100.0, 180.0)] if layout == "tilting table" else [(0.0, 0.0)]
    for control, expected in zip(controls, (tilt, 0.0), strict=True):
        for a, c in turned:
            at = {"A": a, "C": c, **{k: np.mean(exact.travel[k]) for k in "XY"}}
            q = exact.in_axis_order(
                at | {"Z": [exact.travel["Z"][0], np.mean(exact.travel["Z"]), exact.travel["Z"][1]]}
            )
            moved = exact.functional_point(control.command(q, np.array(TOOL)), TOOL, truth)
            direction = (moved[2] - moved[0]) / np.linalg.norm(moved[2] - moved[0])
            spindle = exact.pose(q[1:2], truth)[0, :3, 2]
            assert np.linalg.norm(np.cross(direction, spindle)) == pytest.approx(expected, abs=3e-7), (a, c)


@pytest.mark.parametrize("layout", ["tilting table", "fork head"])
def test_location_errors_are_restated_in_the_frame_of_the_spindle(layout):
    """The frame is turned by t about the datum's origin r. What linear axes alone, or rotary axes alone, leave differs by
    t × (f - r), f the functional point, whatever the rotary axes do; together a table leaves nothing in either frame, a head
    the turn itself. Signs and places from exact matrices."""
    both = {}
    for names in (["L-VOL"], ["R-VOL"], ["L-VOL", "R-VOL"]):
        exact, truth, controls = aligned_loop(layout, names)
        q, tool = loop_positions(exact, 200), np.array([30.0, -40.0, -210.0])
        both[tuple(names)] = [remaining(exact, truth, q, c.command(q, tool), tool)[:, :3] for c in controls]
    t = tilt_of_spindle(exact, truth)
    linear = np.stack([q[:, exact.column(a)] for a in "XYZ"], axis=1)
    reference = np.array([np.mean(exact.travel[a]) for a in "XYZ"])
    point = exact.functional_point(q, tool)  # workpiece frame; a head's machine frame
    carried = linear + tool - reference if layout == "tilting table" else point - linear
    change = {names: aligned - plain for names, (plain, aligned) in both.items()}
    if layout == "tilting table":
        np.testing.assert_allclose(change["L-VOL",], np.cross(t, carried), atol=SECOND_ORDER)
        np.testing.assert_allclose(change["R-VOL",], -np.cross(t, carried), atol=SECOND_ORDER)
        whole = np.zeros_like(carried)
    else:
        np.testing.assert_allclose(change["L-VOL",], np.cross(t, linear - reference), atol=SECOND_ORDER)
        np.testing.assert_allclose(change["R-VOL",], np.cross(t, carried), atol=SECOND_ORDER)
        whole = np.cross(t, point - reference)
    assert np.linalg.norm(change["L-VOL",], axis=1).max() > 0.005
    aligned = both["L-VOL", "R-VOL"][1]
    np.testing.assert_allclose(aligned, whole, atol=SECOND_ORDER)


def test_alignment_to_other_axes_is_the_solution_in_that_datum():
    """Primary Z, secondary X: after L-VOL in that datum, Z's mean line stands as the frame's own, whatever the old datum said."""
    from volid.fitting.datum import parse_datum

    exact, solution = machine_and_solution("three-axis", seed=6)
    moved = solution.in_datum(parse_datum(solution.machine, "primary=Z,secondary=X"))
    made = compensate(moved, ["L-VOL"], base_of(moved, TOOL), points=5, uncertainty=False)
    q = node_positions(exact, 200)
    altered = made.control(solution.machine).command(q, np.array(TOOL))
    left = remaining(exact, truth_of(solution), q, altered, TOOL)[:, :3]
    free, _ = gauge_free(left, q, TOOL, tool_rotation=False, machine=exact)
    assert np.linalg.norm(left, axis=1).max() > 0.002  # a rigid motion: the new frame
    assert np.linalg.norm(free, axis=1).max() < 2e-4  # and nothing else, at the nodes


@pytest.mark.parametrize(
    ("layout", "names", "message"),
    [
        ("three-axis", ["FOR"], "`type=FOR`: machine .* cannot turn its tool"),
        ("three-axis", ["R-POS"], "has no rotary axis"),
        ("three-axis", ["LVOL"], "is no compensation type of ISO/TR 16907; available: L-POS"),
        ("three-axis", ["L-POS", "L-VOL"], "L-POS and L-VOL both correct positioning"),
        ("tilting table", ["R-POS", "FOR"], "R-POS and FOR both turn the rotary axes"),
        ("tilting table", ["L-SPEC", "L-POS"], "may correct the same errors twice"),
    ],
)
def test_types_that_cannot_be(layout, names, message):
    _, solution = machine_and_solution(layout)
    with pytest.raises(InputError, match=message):
        select(names, solution.machine)


def test_for_needs_two_directions_of_rotary_axes():
    with pytest.raises(InputError, match=r"FOR`: .* at least two rotary axes that are not parallel"):
        select(["FOR"], resolved(exact_machine(ROTARY_TABLE), segments=4))


def test_control_without_tool_vector_is_refused():
    _, solution = machine_and_solution("three-axis", seed=3)
    q = np.zeros((1, 3))
    for name in ("L-ANG", "L-VOL"):
        made = compensate(solution, [name], base_of(solution, TOOL), points=3, uncertainty=False)
        with pytest.raises(InputError, match=f"{name} needs the tool vector"):
            made.control(solution.machine).command(q, None)
    made = compensate(solution, ["L-POS"], base_of(solution, TOOL), uncertainty=False)
    assert made.control(solution.machine).command(q, None).shape == (1, 3)


def test_undetermined_deviation_is_not_predicted():
    _, solution = machine_and_solution("three-axis", seed=3)
    column = np.zeros((solution.model.n_parameters, 1))
    column[solution.model.by_name["EXX", "mean"].parameters] = 1e-3
    lost = replace(solution, null_space=column, statements=("EXX: of a test.",))
    with pytest.raises(NotDeterminedError, match="EXX: of a test"):
        forecast(lost, [], base_of(solution, TOOL))


def with_reversal(b):
    """A three-axis machine whose only error is the reversal B = `b` of EXX [mm], the same everywhere."""
    exact, solution = machine_and_solution("three-axis", functions="EXX = { reversal = true }", seed=3, u=1e-4)
    theta = np.zeros(solution.model.n_parameters)
    theta[solution.model.by_name["EXX", "reversal"].parameters] = b
    return exact, replace(solution, parameters=theta), Truth(reversal={"EXX": lambda q: np.full(np.shape(q), b)})


def test_what_grids_leave_of_reversal_is_predicted():
    """B = 6 µm: tables remove it by direction, a grid leaves ± 3 µm, by exact matrices and by the prediction alike."""
    exact, solution, truth = with_reversal(0.006)
    base, places = base_of(solution, TOOL), volume_places(solution.machine, 128)
    for form, left in (("grid", 0.003), ("tables", 0.0)):
        (_, column) = forecast(solution, [["L-VOL"]], base, places=places, points=3, form=form).columns
        control = column.compensation.control(solution.machine)
        altered = control.command(places.positions, np.array(TOOL), places.directions)
        found = remaining(exact, truth, places.positions, altered, TOOL, places.directions)[:, :3]
        np.testing.assert_allclose(np.abs(found), np.tile([left, 0.0, 0.0], (128, 1)), atol=1e-6)
        free, _ = gauge_free(found, places.positions, TOOL, tool_rotation=False, machine=exact)
        largest = np.abs(free).max(axis=0)
        np.testing.assert_allclose(column.predictions[0].exact[3:6], largest, atol=1e-6)
    after = predict_residual(solution, linear_grid(solution, points=3, tool=TOOL))
    assert after.rms == pytest.approx(0.003, rel=1e-3)  # opposite signs at every place: no rigid motion


def test_commands_say_what_grids_do_with_reversal(tmp_path, capsys):
    """In the output, in the file and beside the prediction: the mean of both directions, and that half of 6 µm stays."""
    _, solution, _ = with_reversal(0.006)
    z = np.zeros((2, 3))
    solution = replace(
        solution, statistics=Statistics(6, 0, {"ends": 0.0}, 1, True), readings=Residuals((z,), (z,), (z > 1,))
    )
    write_solution(solution, tmp_path / "s.h5")
    said = "mean of both approach directions; half the reversal is left in either direction, at most EXX 3.00 µm"
    for name in ("g.csv", "g.h5"):
        command = ["grid", str(tmp_path / "s.h5"), "--points", "2", "--tool", "0,0,-150", "-o", str(tmp_path / name)]
        assert main(command) == 0
        assert said in capsys.readouterr().out
    assert f"# reversal: {said}" in (tmp_path / "g.csv").read_text(encoding="utf-8")
    with h5py.File(tmp_path / "g.h5") as file:
        assert file.attrs["reversal"].startswith(said)
    predict = ["residual", str(tmp_path / "s.h5"), "--tool", "0,0,-150", "--points", "2", "--type"]
    assert main([*predict, "L-VOL"]) == 0
    assert said in capsys.readouterr().out
    assert main([*predict, "L-POS"]) == 0  # a table holds both directions
    assert "reversal" not in capsys.readouterr().out
