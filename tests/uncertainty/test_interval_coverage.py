"""95 % intervals hold the truth in 94 to 96 % of 1000 simulated campaigns, correlated effects present, and fail without them.

Truth in the span of the model (SciPy's splines), readings by the exact chain with effects drawn anew for every campaign; every
campaign is refitted exactly. Averaged over functions and positions, location errors, grid nodes, the deviation field and its
lengths; errors of one campaign are correlated, so shares scatter by less than 0.7 %, the value for 1000 independent intervals.
With truth that is no spline and the resolution chosen by the fit, whole fits of 20 campaigns.
"""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from exact_chain import ExactMachine, Truth, apply, random_truth
from support.judging import spline_truth
from support.machines import VERTICAL, exact_machine, fixed, resolved
from support.rtests import NO_LINEAR, SPHERES, TOOLS, r_test, r_test_campaign
from support.trackers import simulated

from volid.campaign import Campaign, Effect
from volid.compensation.grids.linear import linear_grid
from volid.compensation.grids.rotary import rotary_grids
from volid.compensation.grids.sides import full_positions, tool_reaching
from volid.fitting.fit import fit
from volid.fitting.prediction.deviations import deviation_values, gradient_matrix
from volid.fitting.solution import Solution
from volid.uncertainty.lack_of_fit import lack_of_fit
from volid.uncertainty.outputs import headline_outputs
from volid.uncertainty.statement import statement
from volid.uncertainty.trials.monte_carlo import monte_carlo
from volid.uncertainty.trials.refit import Refitter

pytestmark = pytest.mark.slow

CAMPAIGNS = 1000
K = 1.959964  # 97.5 % quantile of the normal distribution
SCALE, TIP = 3e-6, 3e-3  # u of the stations' scales, and of the tool lengths [mm]
TOOL = (0.0, 0.0, -150.0)
REFERENCE = (100.0, 50.0, 30.0)  # of the rotary grid [mm]
OFFSET = 2e-3  # u of the place of a tool tip in an R-test [mm]


@dataclass
class Case:
    """A campaign with its effects, the true machine, and the readings of many campaigns, (n, readings of the set, k)."""

    campaign: Campaign
    exact: ExactMachine
    truth: Truth
    theta: np.ndarray
    readings: np.ndarray

    def without_effects(self) -> Campaign:
        return replace(self.campaign, sets=(replace(self.campaign.sets[0], effects=()),))


def with_readings(campaign: Campaign, readings: np.ndarray) -> Campaign:
    return replace(campaign, sets=(replace(campaign.sets[0], readings=readings),))


@pytest.fixture(scope="module")
def three_axis() -> Case:
    """Multilateration: every station's scale wrong by its own factor (rectangular), every tool too long by its own amount."""
    rng = np.random.default_rng(31)
    campaign, _, tracker = simulated(
        VERTICAL, 11, extra=fixed(2), n_per_station=100, waviness=0.1, every_station_sees_every_tool=True
    )
    effects = (
        Effect("refraction", "scale", SCALE, "station", {"distribution": "rectangular"}),
        Effect("tip", "tool_length", TIP, "tool", {"components": "Z"}),
    )
    campaign = replace(campaign, sets=(replace(campaign.sets[0], effects=effects),))
    solution = fit(campaign)
    theta = np.asarray(solution.parameters)
    truth = spline_truth(solution.model, theta)
    tools, own_tool = np.unique(tracker.tool, axis=0, return_inverse=True)
    names, own_station = np.unique(tracker.station, return_inverse=True)
    places = np.array([tracker.station_positions[n] for n in names])[own_station]
    beams = zip(tracker.station.tolist(), tracker.segment.tolist(), strict=True)
    dead = np.array([tracker.dead_paths[b] for b in beams])
    # the tool's tip moves by 3 µm: the exact chain once per unit, second order is 1e-9 mm
    lengths = [
        np.linalg.norm(
            VERTICAL.functional_point(tracker.q, tracker.tool + np.array([0, 0, dz]), truth) - places, axis=1
        )
        for dz in (-0.01, 0.0, 0.01)
    ]
    slope = (lengths[2] - lengths[0]) / 0.02
    scale = SCALE * np.sqrt(3) * rng.uniform(-1, 1, (CAMPAIGNS, len(names)))
    tip = TIP * rng.standard_normal((CAMPAIGNS, len(tools)))
    length = lengths[1] + slope * tip[:, np.ravel(own_tool)]
    readings = length * (1.0 + scale[:, own_station]) + dead + tracker.u * rng.standard_normal(length.shape)
    return Case(campaign, VERTICAL, truth, theta, readings[:, :, None])


@pytest.fixture(scope="module")
def five_axis() -> Case:
    """R-test of a tilting rotary table; the place of every tool's tip is wrong in X, Y and Z."""
    rng = np.random.default_rng(33)
    exact = exact_machine("w C' A' Y' X' b Z t")
    counts = {"A": 7, "C": 13}
    start = r_test(exact, random_truth(exact, rng), rng, counts=counts)
    machine = resolved(exact, NO_LINEAR.removeprefix("[model.functions]\n"), segments=3)
    campaign = r_test_campaign(machine, start)
    effects = (Effect("tip", "tool_length", OFFSET, "tool", {"components": "XYZ"}),)
    model = fit(campaign).model
    theta = np.where(np.arange(model.n_parameters) >= 0, rng.standard_normal(model.n_parameters), 0.0)
    units = np.array([8e-5 if "rad" in unit else 4e-2 for unit in _units(model)])  # deviations many u large
    theta = theta * units
    truth = spline_truth(model, theta)
    data = r_test(exact, truth, rng, counts=counts, noise=0.0)
    campaign = r_test_campaign(machine, data)
    campaign = replace(campaign, sets=(replace(campaign.sets[0], effects=effects),))
    u = campaign.sets[0].u
    pose = np.linalg.inv(exact.pose(data.q, truth))
    place = np.array([SPHERES[s] for s in data.sphere])
    seen = apply(pose, place)
    own = np.array([list(SPHERES).index(s) for s in data.sphere])
    tip = OFFSET * rng.standard_normal((CAMPAIGNS, len(TOOLS), 3))
    readings = seen - data.tool - tip[:, own] + u * rng.standard_normal((CAMPAIGNS, *u.shape))
    return Case(campaign, exact, truth, theta, readings)


def _units(model) -> list[str]:
    """Unit of every parameter."""
    units = [""] * model.n_parameters
    for f in model.functions:
        for i in range(f.parameters.start, f.parameters.stop):
            units[i] = "rad" if f.name[1] in "ABC" else "mm"
    return units


def shares(case: Case, solution: Solution) -> dict[str, float]:
    """Share of intervals that hold the truth: error motions, location errors, and the deviation at 100 places."""
    refitter = Refitter(solution)
    noise = refitter.noise_of([case.readings])
    stated = -(refitter.frozen.prior @ refitter.centre)  # what is known of the effects: 0 within u
    found = refitter.refit(noise, np.tile(np.asarray(stated), (len(noise), 1)))
    assert found.error.max() < 1e-4 and not np.isnan(found.x).any()
    outputs = headline_outputs(solution)
    n, rows = solution.model.n_parameters, outputs.rows
    true = rows[:, :n] @ case.theta
    motions = np.isfinite(outputs.positions[: len(rows)])
    u = np.sqrt(np.einsum("qi,ij,qj->q", rows, np.asarray(solution.covariance), rows))
    stated_u = u > 1e-6 * u.max()  # the reference is zero by definition
    inside = np.abs(found.x @ rows.T - true) <= K * u
    result = {
        "functions": float(inside[:, motions & stated_u].mean()),
        "location errors": float(inside[:, ~motions & stated_u].mean()),
    }
    rng = np.random.default_rng(1)
    axes, tools = solution.machine.axes, solution.campaign.sets[0].tool
    q = np.stack([rng.uniform(*axis.travel, 100) for axis in axes], axis=1)
    result |= _field_shares(case, solution, found.x, q, tools[rng.integers(len(tools), size=100)], ("field", "lengths"))
    return result | _field_shares(case, solution, found.x, *grid_places(solution), ("grid values",))


def grid_places(solution: Solution) -> tuple[np.ndarray, np.ndarray]:
    """Axis positions and tool vectors of the nodes of the machine's grid: of the linear axes, or of the rotary ones."""
    machine = solution.machine
    if all(axis.is_linear for axis in machine.axes):
        grid = linear_grid(solution, points=4, tool=TOOL)
        return full_positions(machine, grid.axes, grid.positions), np.tile(TOOL, (len(grid.positions), 1))
    (grid,) = rotary_grids(solution, points=7, reference_point=REFERENCE)
    q = full_positions(machine, grid.axes, grid.positions)
    return q, tool_reaching(machine, grid.side, q, np.array(REFERENCE))


def _field_shares(case: Case, solution: Solution, x, q, tool, names: tuple[str, ...]) -> dict[str, float]:
    """Share of intervals of the deviation's components, and of its lengths, that hold the truth at given places."""
    n, k, m = solution.model.n_parameters, len(solution.nuisance_table), len(q)
    centre, still = np.concatenate([np.asarray(solution.parameters), np.asarray(solution.nuisance)]), np.zeros_like(q)
    gradient = gradient_matrix(solution.model, centre[:n], q, tool, still)[:, :3]
    gradient = np.pad(gradient.reshape(3 * m, n), ((0, 0), (0, k)))
    values = deviation_values(solution.model, centre[:n], q, tool, still)[:, :3].ravel()
    field = values + (x - centre) @ gradient.T
    deviation = case.exact.deviation(q, tool, case.truth)[:, :3].ravel()
    own = np.asarray(deviation_values(solution.model, case.theta, q, tool, still)[:, :3]).ravel()
    assert np.abs(own - deviation).max() < 1e-8, "two programs, one machine"
    covariance = np.asarray(solution.covariance)
    u = np.sqrt(np.einsum("qi,ij,qj->q", gradient, covariance, gradient))
    known = solution.evaluate(q, tool).determined[:, :3].ravel() & (u > 1e-6 * np.nanmax(u))
    assert known.mean() > 0.8
    result = {names[0]: float((np.abs(field - deviation) <= K * u)[:, known].mean())}
    if len(names) > 1:
        size = np.linalg.norm(values.reshape(m, 3), axis=1)
        along = np.einsum("pk,pkn->pn", values.reshape(m, 3), gradient.reshape(m, 3, -1)) / size[:, None]
        own_u = np.sqrt(np.einsum("qi,ij,qj->q", along, covariance, along))
        lengths = np.linalg.norm(field.reshape(len(x), m, 3), axis=2) - np.linalg.norm(deviation.reshape(m, 3), axis=1)
        # where the deviation is not many u large its length is no linear function
        large = (size > 10.0 * own_u) & known.reshape(m, 3).all(axis=1)
        assert large.mean() > 0.4
        result[names[1]] = float((np.abs(lengths) <= K * own_u)[:, large].mean())
    return result


@pytest.mark.parametrize("name", ["three_axis", "five_axis"])
def test_propagation_covers_in_1000_campaigns(name, request):
    case = request.getfixturevalue(name)
    found = shares(case, fit(with_readings(case.campaign, case.readings[0])))
    for what, share in found.items():
        assert 0.94 <= share <= 0.96, (what, found)


@pytest.mark.parametrize("name", ["three_axis", "five_axis"])
def test_coverage_fails_when_a_present_effect_is_left_out(name, request):
    case = request.getfixturevalue(name)
    """With u as stated; what hold-outs by block show enlarges it, and is divided out here."""
    solution = fit(with_readings(case.without_effects(), case.readings[0]))
    stated = replace(
        solution,
        covariance=np.asarray(solution.covariance) / solution.factor**2,
        adequacy=replace(solution.adequacy, factor=1.0),
    )
    found = shares(case, stated)
    assert found["functions"] < 0.85 and found["field"] < 0.85, found
    assert solution.adequacy.grade != "accepted" and solution.factor > 1.2


@pytest.mark.parametrize("name", ["three_axis", pytest.param("five_axis", marks=pytest.mark.long)])
def test_monte_carlo_intervals_cover_in_a_subset(name, request):
    """Twelve campaigns, fitted anew, 1024 trials each; the largest deviation included, which propagation has no interval for."""
    case = request.getfixturevalue(name)
    inside, largest = [], []
    for i in range(12):
        solution = monte_carlo(fit(with_readings(case.campaign, case.readings[i])), 1024, seed=i)
        outputs = headline_outputs(solution)
        rows, n = outputs.rows, solution.model.n_parameters
        true = rows[:, :n] @ case.theta
        found = [r for r in statement(solution, outputs=outputs).rows if np.isfinite(r.u)]
        both = zip(found, true, strict=True)
        inside.append(np.mean([r.low <= t <= r.high for r, t in both if r.u > 1e-9 * abs(r.high) + 1e-15]))
        whole = {r.name: r for r in statement(solution, outputs=outputs).rows if not np.isfinite(r.u)}
        if len(outputs.field):
            lengths = np.linalg.norm((outputs.offset + outputs.field[:, :n] @ case.theta).reshape(-1, 3), axis=1)
            largest.append(whole["largest deviation"].low <= lengths.max() <= whole["largest deviation"].high)
    spread = np.std(inside, ddof=1) / np.sqrt(len(inside))
    assert abs(np.mean(inside) - 0.95) < 0.01 + 3.5 * spread and spread < 0.03, inside
    assert len(largest) == 12 and np.sum(largest) >= 9, "of 12; fewer have a chance of 0.2 % at 95 %"


def test_truth_that_is_no_spline_is_covered_lack_of_fit_included():
    """Whole fits of 20 campaigns, everything default: at least 93 % of the intervals hold the truth of the exact chain."""
    inside: dict[str, list[np.ndarray]] = {"functions": [], "location errors": [], "field": []}
    rng = np.random.default_rng(4)
    for seed in range(20):
        campaign, truth, _ = simulated(VERTICAL, 500 + seed, n_per_station=400, every_station_sees_every_tool=True)
        solution = fit(campaign)
        factor = K * lack_of_fit(solution).factor
        for name in solution.model.names:
            at = (
                np.linspace(*solution.machine.axis(name[2]).travel, 9) if name[2] in "XYZ" and "0" not in name else None
            )
            rows = [solution.location(name)] if at is None else solution.motion(name, at)
            true = np.array([truth.constants[name]]) if at is None else truth.functions[name](at)
            value, u = (np.array([getattr(r, key) for r in rows]) for key in ("value", "u"))
            kept = u > 1e-6 * u.max()
            inside["location errors" if at is None else "functions"].append((np.abs(value - true) <= factor * u)[kept])
        q = np.stack([rng.uniform(*axis.travel, 60) for axis in solution.machine.axes], axis=1)
        found = solution.evaluate(q, TOOL)
        exact = VERTICAL.deviation(q, np.tile(TOOL, (60, 1)), truth)[:, :3]
        inside["field"].append((np.abs(found.values[:, :3] - exact) <= factor * found.u[:, :3]).ravel())
    shares = {name: float(np.mean(np.concatenate(values))) for name, values in inside.items()}
    print(shares)
    assert shares["functions"] >= 0.93 and shares["field"] >= 0.93, shares
    # 120 constants, correlated within a campaign: 95 % scatters by 2 %
    assert shares["location errors"] >= 0.89, shares
