"""Ball plates, hole plates and beams: what is read, what they determine, and recovery from the exact chain's own probing."""

from dataclasses import replace

import numpy as np
import pytest
from exact_chain import ExactMachine, Truth, random_truth
from exact_chain.plate import found_positions, plate_at, turned
from exact_chain.ranks import rank, sensitivities, without
from scipy.stats import chi2, qmc
from support.judging import judge
from support.machines import exact_machine, resolved, volid_machine

from volid.campaign import Campaign, ObservationSet
from volid.fitting.diagnosis.identifiability import analyse
from volid.fitting.equations.choice import engine_named
from volid.fitting.equations.problem import build_problem
from volid.fitting.fit import fit
from volid.fitting.starts import find_starts
from volid.model.error_functions import motion_names
from volid.model.error_model import build_model
from volid.planning.ball_plate import Placing, ball_plate, plate_plan
from volid.virtual.simulate import simulate
from volid.virtual.truth import Truth as VolidTruth

X, Y, Z = np.eye(3).tolist()
TRAVEL = {"X": (0.0, 600.0), "Y": (0.0, 500.0), "Z": (-400.0, 0.0)}
BED_XYZ = ExactMachine("w b X Y Z t", TRAVEL)
ONE, THREE = [[0.0, 0.0, -150.0]], [[0.0, 0.0, -150.0], [70.0, 0.0, -180.0], [0.0, 60.0, -120.0]]
QUARTIC = '[model]\ndegree = 4\nsegments = 1\n[model.functions]\n"E?0S" = false'


def probed(
    plan: Campaign, exact: ExactMachine, truth: Truth, seed=1, u=0.0, deviations=None, pose=(2e-4, 0.1)
) -> Campaign:
    """The plan's points as a probe finds them, readings 0 at the positions found, noise u along the axes.

    `deviations` (n, 3): of the points from the calibrated ones. `pose`: each placement is off the planned one by so much at most.
    """
    (s,), rng = plan.sets, np.random.default_rng(seed)
    points = s.options["points"]["plate"]
    xyz, names = np.array([row[:3] for row in points.values()]), list(points)
    true = xyz + (0.0 if deviations is None else deviations)
    q = s.positions.copy()
    for name in dict.fromkeys(s.labels["placement"].tolist()):
        own = np.flatnonzero(s.labels["placement"] == name)
        numbers = np.array([names.index(p) for p in s.labels["point"][own]])
        nominal = exact.functional_point(s.positions[own], s.tool[own])
        design = xyz[numbers] - xyz.mean(axis=0)
        h = (design - design.mean(axis=0)).T @ (nominal - nominal.mean(axis=0))
        left, _, right = np.linalg.svd(h)
        turn = right.T @ np.diag([1.0, 1.0, np.linalg.det(right.T @ left.T)]) @ left.T
        middle = nominal.mean(axis=0) - turn @ design.mean(axis=0)
        places = plate_at(
            true, middle, turn[:, 0], turn[:, 1], pose[0] * rng.uniform(-1, 1, 3), pose[1] * rng.uniform(-1, 1, 3)
        )
        q[own] = found_positions(exact, places[numbers], s.tool[own], truth, q[own])
    q += u * rng.standard_normal(q.shape)
    return replace(plan, sets=(replace(s, positions=q, readings=np.zeros_like(s.u)),))


# ------------------------------------------------------------------------------------------------------- what is read


@pytest.mark.parametrize("structure", ["w Y' b X Z t", "w C' Y' b X Z B t"])
@pytest.mark.parametrize("body", ["workpiece", "Y"])
def test_readings_are_what_matrices_give(structure, body):
    """Machine with tilted axes, exact placement, scale, calibration: the gap in the body's frame, turned to the machine's."""
    exact = ExactMachine(structure, TRAVEL) if "B" not in structure else exact_machine(structure)
    machine, rng = volid_machine(exact), np.random.default_rng(3)
    constants = {"EC0Y": 3e-4, "EB0Z": -2e-4} | (
        {"EX0C": 0.02, "EA0C": 1e-4, "EB0B": -2e-4} if "B" in structure else {}
    )
    low, high = np.array([exact.travel[a] for a in exact.axes]).T
    q, tool = low + rng.random((6, len(low))) * (high - low), np.array([40.0, -20.0, -150.0])
    inverse = np.linalg.inv(exact.body_pose(body, q, Truth())[:, :3, :3])
    nominal = np.einsum(
        "mij,mj->mi", inverse, exact.functional_point(q, tool) - exact.body_pose(body, q, Truth())[:, :3, 3]
    )
    turn, centre = turned((0, 1, 0), (0.6, 0, 0.8)), nominal.mean(axis=0)
    xyz = (nominal - centre) @ turn  # points that the nominal machine meets exactly
    points = {f"P{i}": [*row.tolist(), 1e-3, 2e-3, 3e-3] for i, row in enumerate(xyz)}
    labels = {"artefact": "plate", "point": list(points), "placement": "1", "run": "1"}
    own = {"points": {"plate": points}, "scale_u": 1e-5, "components": "XYZ", "body": body}
    empty, labels = np.full((6, 3), np.nan), {k: np.broadcast_to(v, 6).astype(str) for k, v in labels.items()}
    s = ObservationSet(
        "own", "artefact", q, 0 * q, np.tile(tool, (6, 1)), empty, np.full((6, 3), 1e-3), labels, options=own
    )
    pose = {"plate placement 1 A": 3e-4, "plate placement 1 B": -2e-4, "plate placement 1 C": 1e-4}
    pose |= {"plate placement 1 X": 0.02, "plate placement 1 Y": -0.03, "plate placement 1 Z": 0.01}
    off = rng.normal(scale=2e-3, size=(6, 3))
    drawn = {f"calibration plate P{i} {c}": off[i, k] for i in range(6) for k, c in enumerate("XYZ")}
    instruments = pose | drawn | {"scale of artefact plate": 2e-5}
    given = VolidTruth(machine, {}, constants=constants, instruments=instruments)
    read = simulate(Campaign(machine, (), (s,)), given, noise=False)[0].sets[0].readings
    places = (
        plate_at(xyz * (1.0 + 2e-5), centre, turn[:, 0], turn[:, 1], [3e-4, -2e-4, 1e-4], [0.02, -0.03, 0.01])
        + off @ turn.T
    )
    T = exact.body_pose(body, q, Truth({}, constants))
    actual = exact.functional_point(q, tool, Truth({}, constants))
    seen = np.einsum("mji,mj->mi", T[:, :3, :3], actual - T[:, :3, 3])
    to_machine = np.einsum(
        "mji,mjk->mik", exact.body_pose("bed", q, Truth())[:, :3, :3], exact.body_pose(body, q, Truth())[:, :3, :3]
    )
    expected = np.einsum("mij,mj->mi", to_machine, places - seen)
    np.testing.assert_allclose(read, expected, rtol=0, atol=2e-6)  # the calibration is turned by R0 alone, 4e-4 of 2 µm


# --------------------------------------------------------------------------------------------------- what is determined


def determined(campaign: Campaign) -> int:
    """Number of combinations that the package finds determined, of 69 (72 less the three that the datum takes)."""
    model = build_model(campaign.machine, {n: (1,) for n in motion_names(campaign.machine)})
    problem = build_problem(campaign, model, find_starts(campaign))
    return model.n_parameters - analyse(problem, campaign).null_space.shape[1]


def counted(s: ObservationSet, exact: ExactMachine) -> tuple[int, float]:
    """Rank of 72 quartic coefficients in the places found, less what placements, tool, unknown scale and depths can follow."""
    nominal, points = exact.functional_point(s.positions, s.tool), s.options["points"]["plate"]
    xyz = np.array([points[p][:3] for p in s.labels["point"]])
    columns, scale = [np.cross(e, s.tool) for e in np.eye(3)], np.zeros((len(s), 3))
    for name in np.unique(s.labels["placement"]):
        own = (s.labels["placement"] == name)[:, None]
        arm = own * (nominal - nominal[own[:, 0]].mean(axis=0))
        columns += [own * np.eye(3)[k] for k in range(3)] + [np.cross(e, arm) for e in np.eye(3)]
        scale += arm
        if s.options["components"] == "XY":  # the normal of the plate, from two sides of it
            flat = xyz[own[:, 0]] - xyz[own[:, 0]].mean(axis=0)
            sides = np.linalg.lstsq(flat[:, :2], arm[own[:, 0]], rcond=None)[0]
            normal = np.cross(*sides)
            columns += [(np.arange(len(s)) == row)[:, None] * normal for row in np.flatnonzero(own[:, 0])]
    columns += [scale] if np.isinf(s.options["scale_u"]) else []

    def places(truth):
        return exact.functional_point(s.positions, s.tool, truth)

    return rank(without(np.stack([np.ravel(c) for c in columns], axis=1), sensitivities(exact, places)))


def beams(machine, **options) -> Campaign:
    """A beam of seven balls along every axis, in two places each."""
    lines = {"X": (X, Y), "Y": (Y, Z), "Z": (Z, X)}
    middle, aside = np.array([300.0, 250.0, -350.0]), np.array([150.0, 120.0, 80.0])
    places = [
        Placing(f"{name} {sign}", middle + sign * aside * (1 - np.abs(way[0])) * (1, -1, 1), *way)
        for name, way in lines.items()
        for sign in (1, -1)
    ]
    return plate_plan(machine, {f"B{i}": [50.0 * i, 0.0, 0.0] for i in range(7)}, places, ONE, u=5e-4, **options)


def plates(machine, tools=ONE, only=(), scale_u=0.0, **options) -> Campaign:
    """The ball plate in four places, or in those named."""
    plan = ball_plate(machine, tools, calibrated_u=0.0, scale_u=scale_u)
    (s,) = plan.sets
    s = replace(s, options=s.options | options)
    kept = np.flatnonzero(np.isin(s.labels["placement"], only)) if only else np.arange(len(s))
    return replace(plan, sets=(s.rows_of(kept),))


PLANS = {
    "four places": (plates, {}, 53),
    "four places, unknown scale": (plates, {"scale_u": np.inf}, 52),
    "four places, holes": (plates, {"components": "XY"}, 52),
    "four places, three tools": (plates, {"tools": THREE}, 69),
    "flat at two heights": (plates, {"only": ("flat low", "flat high")}, 41),
    "six lines of a beam": (beams, {}, 44),
}


@pytest.mark.parametrize("name", PLANS)
def test_what_an_artefact_determines_is_what_a_count_apart_gives(name):
    """Of 72 modulo a tool rotation: 5 × 5 balls, flat at two heights, upright along X and Y; limit of the count 1e-7."""
    make, given, expected = PLANS[name]
    plan = make(volid_machine(BED_XYZ, QUARTIC), **given)
    (s,) = plan.sets
    found, gap = counted(s, BED_XYZ)
    assert gap > 1e3, "the count is clear"
    assert found == expected == determined(replace(plan, sets=(replace(s, readings=np.zeros_like(s.readings)),)))


# ------------------------------------------------------------------------------------------------------ the calibration

ONE_SLOPE = '[model]\ndegree = 1\nsegments = 1\n[model.functions]\n"*" = false\nEXX = true\n'
AT = np.array([0.0, 40.0, 95.0, 150.0, 230.0, 290.0, 350.0])  # mm, balls of a beam
U = 4e-4


def _near(distance):
    return (3e-4) ** 2 * np.exp(-np.abs(AT[:, None] - AT) / distance)


def _rank_two():
    return sum(np.outer(v, v) for v in np.random.default_rng(2).normal(scale=5e-4, size=(2, 7)))


COVARIANCES = {
    "independent": np.diag([2e-4, 3e-4, 1e-4, 5e-4, 2e-4, 4e-4, 3e-4]) ** 2,
    "a common scale": (1e-4) ** 2 * np.eye(7) + (3e-6) ** 2 * np.outer(AT, AT),
    "neighbours alike": _near(100.0),
    "of rank two": _rank_two(),
}


def beam_along_x(covariance: np.ndarray, independent: bool = False, scale_u: float = 0.0) -> Campaign:
    """A beam along X with the covariance of its x (7, 7) [mm²], y and z exact; found 0.3 µm off."""
    machine = volid_machine(BED_XYZ, ONE_SLOPE)
    u = np.sqrt(np.diag(covariance)) if independent else np.zeros(7)
    beam = {f"B{i}": [x, 0.0, 0.0, float(u[i]), 0.0, 0.0] for i, x in enumerate(AT)}
    matrix = {"names": [f"B{i} x" for i in range(7)], "values": covariance.tolist()}
    given = {} if independent else {"covariance": matrix}
    place = Placing("along", (300.0, 250.0, -350.0), X, Y)
    plan = plate_plan(machine, beam, [place], ONE, u=U, scale_u=scale_u, **given)
    (s,) = plan.sets
    found = s.positions + np.outer(3e-4 * np.random.default_rng(7).normal(size=7), [1.0, 0.0, 0.0])
    return replace(plan, sets=(replace(s, positions=found, readings=np.zeros((7, 3))),))


def slope_by_least_squares(campaign: Campaign, covariance: np.ndarray) -> tuple[float, float]:
    """Slope of EXX and its u: generalised least squares, x found = calibrated + shift - slope (x - reference)."""
    x = campaign.sets[0].positions[:, 0]
    design = np.stack([x - 300.0, np.ones(7)], axis=1)
    weight = np.linalg.inv(covariance + U**2 * np.eye(7))
    inverse = np.linalg.inv(design.T @ weight @ design)
    return float((inverse @ design.T @ weight @ (AT - x))[0]), float(np.sqrt(inverse[0, 0]))


def slope_of(campaign: Campaign) -> tuple[float, float]:
    """The same from the package."""
    row = max((f for f in fit(campaign).functions() if f.name == "EXX"), key=lambda f: f.position)
    return row.value / (row.position - 300.0), row.u / (row.position - 300.0)


@pytest.mark.parametrize("name", COVARIANCES)
def test_the_covariance_of_a_calibration_weighs_as_generalised_least_squares_says(name):
    campaign, covariance = beam_along_x(COVARIANCES[name]), COVARIANCES[name]
    np.testing.assert_allclose(slope_of(campaign), slope_by_least_squares(campaign, covariance), rtol=1e-4)


def test_correlated_is_not_independent():
    """A common scale of 3e-6 is passed on whole, 3e-6 in the slope; taken as independent it would average to half of that."""
    covariance = COVARIANCES["a common scale"]
    whole, parts = (slope_of(beam_along_x(covariance, independent))[1] for independent in (False, True))
    diagonal = np.diag(np.diag(covariance))
    assert whole == pytest.approx(slope_by_least_squares(beam_along_x(covariance), covariance)[1], rel=1e-4)
    assert parts == pytest.approx(slope_by_least_squares(beam_along_x(covariance, True), diagonal)[1], rel=1e-4)
    assert 3e-6 < whole < 3.4e-6 and parts < 0.75 * whole


def test_a_stated_scale_is_the_covariance_of_a_scale():
    stated = slope_of(beam_along_x((1e-4) ** 2 * np.eye(7), scale_u=3e-6))
    np.testing.assert_allclose(stated, slope_of(beam_along_x(COVARIANCES["a common scale"])), rtol=1e-4)


PLANE = '[model]\ndegree = 1\nsegments = 1\n[model.functions]\n"*" = false\nEXX = true\nEYY = true\nEC0Y = true\n'


@pytest.mark.slow
def test_results_scatter_over_calibration_errors_as_u_says():
    """60 plates of one covariance (common scale, a bend, each ball), probed by the exact chain: spread of the results and u."""
    machine, rng = volid_machine(BED_XYZ, PLANE), np.random.default_rng(4)
    xyz = np.array([(120.0 * i, 100.0 * j, 0.0) for j in range(3) for i in range(3)])
    arm = (xyz - xyz.mean(axis=0)).ravel()
    bend = np.stack([(xyz[:, 1] - 100.0) ** 2 / 1e4, 0.0 * xyz[:, 0], 0.0 * xyz[:, 0]], axis=1).ravel()
    covariance = (2e-4) ** 2 * np.eye(27) + (4e-6) ** 2 * np.outer(arm, arm) + (5e-4) ** 2 * np.outer(bend, bend)
    names = [f"P{i} {c}" for i in range(9) for c in "xyz"]
    plate = {f"P{i}": row for i, row in enumerate(xyz.tolist())}
    places = [
        Placing("flat", (300.0, 250.0, -350.0), X, Y),
        Placing("turned", (300.0, 250.0, -350.0), Y, (-1.0, 0.0, 0.0)),
    ]
    matrix = {"names": names, "values": covariance.tolist()}
    plan = plate_plan(machine, plate, places, ONE, u=2e-4, covariance=matrix)
    found, u = [], []
    for _ in range(60):
        off = rng.multivariate_normal(np.zeros(27), covariance, method="eigh").reshape(-1, 3)
        solution = fit(probed(plan, BED_XYZ, Truth(), int(rng.integers(1 << 30)), 2e-4, off))
        found.append(np.asarray(solution.parameters))
        u.append(np.sqrt(np.diag(solution.parameter_covariance)))
    ratio = np.std(found, axis=0) / np.mean(u, axis=0)
    assert np.abs(ratio - 1.0).max() < 4.0 / np.sqrt(2 * 60), ratio  # four standard deviations of a spread
    bias = np.mean(found, axis=0) / np.mean(u, axis=0) * np.sqrt(60)
    assert np.abs(bias).max() < 4.0, bias


# ------------------------------------------------------------------------------------------------------------- recovery

VERTICAL = ExactMachine("w X' Y' b Z t", {"X": (0.0, 700.0), "Y": (0.0, 500.0), "Z": (-500.0, 0.0)})


def recovered(seed: int, **options):
    """A plate of 5 × 5 balls in four places with three tool vectors, calibrated with a covariance."""
    rng = np.random.default_rng(100 + seed)
    truth = random_truth(VERTICAL, rng, waviness=0.6)
    plan = ball_plate(resolved(VERTICAL, segments=4), THREE, u=5e-4, calibrated_u=0.0, scale_u=0.0)
    (s,) = plan.sets
    points = s.options["points"]["plate"]
    arm = (xyz := np.array([row[:3] for row in points.values()])) - xyz.mean(axis=0)
    covariance = (3e-4) ** 2 * np.eye(75) + (2e-6) ** 2 * np.outer(arm.ravel(), arm.ravel())
    names = [f"{p} {c}" for p in points for c in "xyz"]
    given = {"covariance": {"names": names, "values": covariance.tolist()}} | options
    off = rng.multivariate_normal(np.zeros(75), covariance, method="eigh").reshape(-1, 3)
    plan = replace(plan, sets=(replace(s, options=s.options | given),))
    campaign = probed(plan, VERTICAL, truth, seed, 5e-4, off)
    solution, (low, high) = fit(campaign), campaign.measured_range().T
    q = low + qmc.Sobol(3, seed=3).random(256) * (high - low)
    return solution, judge(solution, VERTICAL, truth, q, np.array(THREE)[np.arange(256) % 3], tool_rotation=False)


def within(judgements) -> None:
    """Chi-square of all differences together within its 99.9 % limits."""
    total, freedom = sum(j.nees for j in judgements), sum(j.rank for j in judgements)
    assert chi2.ppf(5e-4, freedom) < total < chi2.ppf(1 - 5e-4, freedom), (total, freedom)


def test_a_machine_is_recovered_from_a_plate_within_u():
    solution, found = recovered(1)
    assert not solution.adequacy.rejected, solution.adequacy.verdict
    within([found])
    assert found.rank > 15


@pytest.mark.slow
@pytest.mark.parametrize("components", ["XYZ", "XY"])
def test_machines_are_recovered_from_plates_with_balls_and_with_holes(components):
    found = [recovered(seed, components=components) for seed in range(5)]
    assert not any(solution.adequacy.rejected for solution, _ in found)
    within([judgement for _, judgement in found])


@pytest.mark.slow
def test_compiled_and_interpreted_programs_agree():
    """Predictions and derivatives with a calibration, a scale and depths, to rounding."""
    campaign = beam_along_x(COVARIANCES["neighbours alike"], scale_u=1e-6)
    (s,) = campaign.sets
    campaign = replace(campaign, sets=(replace(s, options=s.options | {"components": "XY"}),))
    model = build_model(campaign.machine, {n: (1,) for n in motion_names(campaign.machine)})
    found = []
    for name in ("interpreted", "compiled"):
        problem = build_problem(campaign, model, engine=engine_named(name))
        z = problem.start + 1e-4 * np.random.default_rng(0).normal(size=len(problem.start))
        equations = problem.equations
        found.append(
            [np.asarray(v) for v in (*equations.predictions(z), *(c for b in equations.jacobian(z) for c in b))]
        )
    for one, other in zip(*found, strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-12 * np.abs(one).max())
