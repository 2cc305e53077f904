"""The kinematic model against the exact chain of 4×4 matrices, closed forms, and its derivatives."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from exact_chain import LINEAR, ExactMachine, Truth, apply, random_truth
from scipy.spatial.transform import Rotation
from support.machines import VERTICAL, fixed, volid_machine
from support.trackers import simulated

from volid.fitting.fit import fit
from volid.model.geometry import best_rigid_motion, rotate_small
from volid.model.jacobian import influence
from volid.model.kinematics import deviation, functional_point, nominal_point, transform

TRAVEL = {"X": (0.0, 1000.0), "Y": (0.0, 600.0), "Z": (-500.0, 0.0), "A": (-120, 30), "B": (-90, 90), "C": (0, 360)}
ARRANGEMENTS = [
    " ".join(["w", *[a + "'" for a in order[:split]], "b", *order[split:], "t"])
    for order in itertools.permutations(LINEAR)
    for split in range(4)
]
FIVE_AXES = ["w C' A' X' b Y Z t", "w b X Y Z C B t", "w C' Y' b X Z B t", "w X' C' b Y Z t"]
# Rotations enter as 1 + ω + ω²/2; what is left out is θ³/6: 3e-13 at the 120 µrad of the tool frame, times 0.5 m, and a
# tenth of that from each axis over 1.5 m. Terms of second order are 30,000 times larger, so they cannot be missing.
POINT = 3e-10  # mm
ORIENTATION = 1e-11  # rad; also sin θ for θ, with all rotations added up to 400 µrad: θ³/6


def same_in_both(structure, seed=0, scale=1.0):
    """Positions, tools and error values of a random machine, the package's deviation and the exact one, all (m, ·)."""
    rng = np.random.default_rng(seed)
    exact = ExactMachine(structure, TRAVEL, error_point={"Y": (30.0, -40.0, 20.0)}, point={"C": (310.0, 280.0, 0.0)}
                         if "C" in structure else None)  # fmt: skip
    truth = random_truth(exact, rng, scale=scale, reversal=True)
    truth.constants.update(EX0S=0.02, EY0S=-0.01, EZ0S=0.03)
    low, high = np.array([exact.travel[a] for a in exact.axes], float).T
    q = low + rng.random((25, len(exact.axes))) * (high - low)
    tool = rng.uniform(-300, 300, (25, 3))
    direction = rng.choice([-1, 1], q.shape)
    spindle = [truth.constants[f"{c}0S"] for c in ("EX", "EY", "EZ", "EA", "EB", "EC")]
    errors = [exact.errors(a, q, truth, direction) for a in exact.axes] + [np.tile(spindle, (25, 1))]
    ours = deviation(volid_machine(exact), jnp.asarray(q.T), tuple(tool.T), jnp.asarray(np.hstack(errors).T))
    return np.asarray(ours).T, exact.deviation(q, tool, truth, direction)


@pytest.mark.parametrize("structure", ARRANGEMENTS + FIVE_AXES)
def test_deviation_is_the_exact_chains(structure):
    ours, exact = same_in_both(structure)
    assert np.abs(exact[:, :3]).max() > 0.01, "errors too small to test anything"
    np.testing.assert_allclose(ours[:, :3], exact[:, :3], atol=POINT, rtol=0)
    np.testing.assert_allclose(ours[:, 3:], exact[:, 3:], atol=ORIENTATION, rtol=0)


def test_what_is_left_out_is_of_third_order():
    # ten times larger errors, a thousand times the difference; 30 times too large so that it stands above rounding
    small, large = (np.subtract(*same_in_both("w X' b Y Z t", scale=s)) for s in (30.0, 300.0))
    assert np.abs(large).max() / np.abs(small).max() == pytest.approx(1000, rel=0.1)


def test_small_rotation_is_exact_to_second_order():
    angle, x = 1e-3, (0.0, 1000.0, 0.0)
    turned = np.array(rotate_small((angle, 0.0, 0.0), x))
    expected = np.array([0.0, 1000 * np.cos(angle), 1000 * np.sin(angle)])
    assert np.abs(turned - expected).max() == pytest.approx(1000 * angle**3 / 6, rel=1e-3)  # 1.7e-7 mm


@pytest.mark.parametrize("structure", ["w b X Y Z t", "w Y' b X Z t", "w X' Y' Z' b t"])
def test_perfect_machine_has_no_deviation(structure):
    machine = volid_machine(ExactMachine(structure, TRAVEL))
    q = np.random.default_rng(0).uniform(-500, 1000, (3, 9))
    zero = deviation(machine, q, (10.0, 20.0, -150.0), jnp.zeros((24, 9)))
    np.testing.assert_array_equal(zero, 0.0)
    nominal = nominal_point(machine, q.T, np.tile([10.0, 20.0, -150.0], (9, 1)))
    np.testing.assert_allclose(nominal, q.T[:, [machine.index(a) for a in LINEAR]] + [10, 20, -150], atol=1e-12)


@pytest.mark.parametrize("structure, arm_x", [("w b X Y Z t", 0.0), ("w X' b Y Z t", 700.0)])
def test_abbe_arm(structure, arm_x):
    """EBX = 10 µrad, X = 700, Z = -300, tool (40, 0, -250): the arm reaches from the X carriage's origin to the tool.

    N·D on the tool side: the arm holds no x, ex = EB·(z + tz), ez = -EB·tx. D·N on the workpiece side: -EB·(x + tx).
    """
    machine = volid_machine(ExactMachine(structure, TRAVEL))
    errors = np.zeros((24, 1))
    errors[6 * machine.index("X") + 4] = 10e-6
    q = machine.order(X=700.0, Y=100.0, Z=-300.0)[:, None]
    found = np.asarray(deviation(machine, q, (40.0, 0.0, -250.0), jnp.asarray(errors)))[:, 0]
    expected = [10e-6 * -550.0, 0.0, -10e-6 * (40.0 + arm_x), 0.0, 10e-6, 0.0]
    np.testing.assert_allclose(found, expected, atol=10e-6**2 * 1000)  # second order: 1e-7 mm


def test_error_point_moves_the_arm():
    machine = volid_machine(ExactMachine("w b X Y Z t", TRAVEL, error_point={"X": (0.0, 0.0, -550.0)}))
    errors = np.zeros((24, 1))
    errors[4] = 10e-6
    q = machine.order(X=700.0, Y=100.0, Z=-300.0)[:, None]
    found = np.asarray(deviation(machine, q, (0.0, 0.0, -250.0), jnp.asarray(errors)))[:, 0]
    np.testing.assert_allclose(found[:3], 0.0, atol=10e-6**2 * 1000)


@pytest.mark.parametrize("body, start", [("bed", 2), ("Y", 0), ("X", 1), ("Z", 3), ("tool", 3), ("workpiece", 0)])
def test_frames_of_bodies(body, start):
    """Partial products of the exact chain: a point fixed on a body, seen from the workpiece."""
    exact = ExactMachine("w Y' X' b Z t", TRAVEL)
    machine = volid_machine(exact)
    assert machine.body_index(body) == start
    rng = np.random.default_rng(3)
    truth = random_truth(exact, rng, tool_rotation=False)
    q, x = rng.uniform(-400, 600, (7, 3)), np.array([30.0, -80.0, 200.0])
    cut = ExactMachine(" ".join(["w", *["Y'", "X'"][:start], "b", *(["Z"] if start == 3 else []), "t"]), TRAVEL)
    kept = Truth({k: f for k, f in truth.functions.items() if k[2] in cut.axes},
                 {k: v for k, v in truth.constants.items() if k[3] in cut.axes})  # fmt: skip
    kept_q = np.column_stack([q[:, exact.column(a)] for a in cut.axes] or [np.zeros((7, 0))])
    expected = apply(cut.pose(kept_q, kept), x) if cut.axes else np.tile(x, (7, 1))
    errors = np.hstack([exact.errors(a, q, truth) for a in exact.axes] + [np.zeros((7, 6))]).T
    ours = transform(machine, q.T, jnp.asarray(errors), tuple(x), start=start)
    np.testing.assert_allclose(np.stack([np.broadcast_to(c, 7) for c in ours], 1), expected, atol=POINT)


def test_jax_derivatives_of_deviation_are_finite_differences():
    machine = volid_machine(ExactMachine("w C' A' X' b Y Z t", TRAVEL, point={"C": (10.0, 20.0, 0.0)}))
    rng = np.random.default_rng(5)
    q, tool = rng.uniform(-90, 90, 5), rng.uniform(-200, 200, 3)
    errors = np.tile([1e-2] * 3 + [1e-4] * 3, 6) * rng.normal(size=36)

    @jax.jit
    def of(errors, q, tool):
        return deviation(machine, q[:, None], tuple(tool[:, None]), errors[:, None])[:, 0]

    arguments = tuple(map(jnp.asarray, (errors, q, tool)))
    for k, steps in enumerate((np.tile([1e-2] * 3 + [1e-5] * 3, 6), np.full(5, 1e-2), np.full(3, 1e-1))):
        ours = np.asarray(jax.jit(jax.jacrev(of, argnums=k))(*arguments))
        forward = np.asarray(jax.jit(jax.jacfwd(of, argnums=k))(*arguments))
        np.testing.assert_allclose(forward, ours, rtol=1e-12, atol=1e-14)
        for i, h in enumerate(steps):
            both = [np.asarray(of(*[a.at[i].add(s * h) if j == k else a for j, a in enumerate(arguments)]))
                    for s in (1, -1)]  # fmt: skip
            # central differences: rounding 1e-13 mm / h, curvature h²
            np.testing.assert_allclose(ours[:, i], (both[0] - both[1]) / (2 * h), atol=3e-13 / h + 1e-12, rtol=1e-7)


def test_solution_can_be_differentiated_and_mapped():
    campaign, _, _ = simulated(VERTICAL, 3, extra=fixed(4), n_per_station=60)
    solution = fit(campaign)
    tool = jnp.array([10.0, 20.0, -150.0])
    x, y, z = np.random.default_rng(0).uniform([0, 0, -460], [760, 430, 0], (6, 3)).T
    q = jnp.asarray(campaign.machine.order(X=x, Y=y, Z=z))
    deviation_at = jax.jit(lambda x: solution.deviation(x, tool))
    both = deviation_at(q)
    assert both.shape == (6, 6)
    np.testing.assert_allclose(jax.vmap(deviation_at)(q), both, atol=1e-12)  # rounding at 1 m
    slopes = jax.vmap(jax.jit(jax.jacfwd(deviation_at)))(q)
    np.testing.assert_allclose(slopes, jax.vmap(jax.jit(jax.jacrev(deviation_at)))(q), atol=1e-16)
    for i in range(3):
        step = jnp.zeros(3).at[i].set(2e-2)
        difference = (deviation_at(q + step) - deviation_at(q - step)) / 4e-2
        # rounding of 1 m, 2e-13 mm, over 4e-2 mm; slopes are 1e-8 (rad/mm) to 1e-4
        np.testing.assert_allclose(slopes[:, :, i], difference, atol=2e-11)
    gradient = jax.grad(lambda s: s.deviation(q[0], tool)[0], allow_int=True)(solution)
    assert np.count_nonzero(np.asarray(gradient.parameters)) > 10, "the numbers of a solution are leaves"


def test_functional_point_moves_with_the_tool():
    exact = ExactMachine("w X' b Y Z t", TRAVEL)
    machine, q = volid_machine(exact), np.array([[400.0], [200.0], [-100.0]])
    one, other = (functional_point(machine, q, t, jnp.zeros((24, 1))) for t in ((0, 0, -150.0), (5.0, 6.0, -143.0)))
    np.testing.assert_allclose(np.subtract(other, one)[:, 0], [5.0, 6.0, 7.0], atol=1e-12)


def test_best_rigid_motion_is_the_one_that_was_made():
    """Points carried by a stated rotation and translation: the motion back is found, also where they lie in a plane."""
    rng = np.random.default_rng(4)
    for flat in (1.0, 0.0):
        points = rng.uniform(-300.0, 300.0, (9, 3)) * [1.0, 1.0, flat]
        turn = Rotation.from_rotvec([0.4, -2.0, 1.1])
        shift = np.array([10.0, -20.0, 3000.0])
        found = best_rigid_motion(points, turn.apply(points) + shift)
        np.testing.assert_allclose(found.rotation, turn.as_matrix(), atol=1e-13)
        np.testing.assert_allclose(found.translation, shift, atol=1e-10)
        np.testing.assert_allclose(found(points), turn.apply(points) + shift, atol=1e-10)


def test_best_rigid_motion_does_not_mirror():
    """A mirrored tetrahedron along the axes: with edges 3, 2, 1 the shortest stays on its wrong side (closed form)."""
    points = np.array([[3.0, 0, 0], [-3.0, 0, 0], [0, 2.0, 0], [0, -2.0, 0], [0, 0, 1.0], [0, 0, -1.0]])
    found = best_rigid_motion(points, points * [1.0, 1.0, -1.0])
    assert np.linalg.det(found.rotation) == pytest.approx(1.0)
    np.testing.assert_allclose(found.rotation, np.eye(3), atol=1e-14)
    assert np.sum((found(points) - points * [1.0, 1.0, -1.0]) ** 2) == pytest.approx(2 * 2.0**2)


@pytest.mark.parametrize("structure", FIVE_AXES)
def test_influence_is_the_derivative_of_the_exact_chain(structure):
    """Against 4×4 matrices: a single small error moves the exact chain by its influence, to the second order left out."""
    exact = ExactMachine(structure, TRAVEL, point={"C": (310.0, 280.0, 0.0)})
    machine, rng, step = volid_machine(exact), np.random.default_rng(2), 1e-4
    low, high = np.array([exact.travel[a] for a in exact.axes], float).T
    q, tool = low + rng.random((6, len(low))) * (high - low), rng.uniform(-200, 200, (6, 3))
    rows = influence(machine, q, tool)
    for i, axis in enumerate(exact.axes):
        for k, direction in enumerate("XYZABC"):
            truth = Truth({f"E{direction}{axis}": lambda x: np.full_like(x, step)})
            moved = exact.deviation(q, tool, truth, np.zeros_like(q)) / step
            scale = 1.0 if k < 3 else 1000.0
            np.testing.assert_allclose(moved, rows[:, :, 6 * i + k], atol=step * scale, err_msg=f"E{direction}{axis}")
