"""What is independent from position to position stays in u wherever a solution goes, and what cannot follow says so."""

from dataclasses import replace

import numpy as np
import pytest
from exact_chain import default_tools
from support.machines import VERTICAL, volid_machine
from support.short_waves import with_waves
from support.trackers import simulated

from volid import compensate, compensation_base, error_tables, save_solution
from volid.compensation.residual.volume import predict_residual
from volid.compensation.rigid import best_rigid
from volid.compensation.types import TYPES
from volid.exceptions import InputError, OutputError
from volid.fitting.fit import fit
from volid.model.machine import Datum
from volid.uncertainty.trials.monte_carlo import monte_carlo

TOOL = (0.0, 0.0, -150.0)
PLACES = np.array([[380.0, 215.0, -230.0], [700.0, 20.0, -30.0], [10.0, 400.0, -400.0]])


@pytest.fixture(scope="module")
def campaign():
    return with_waves(2e-3, 7.3, n=300, every_station_sees_every_tool=True)[0]


@pytest.fixture(scope="module")
def solution(campaign):
    return fit(campaign)


def u_of_x(solution):
    return solution.evaluate(PLACES, TOOL).u[:, 0]


def test_a_robust_fit_finds_it_too(campaign, solution):
    assert solution.scatter["X"] == pytest.approx(1.41e-3, rel=0.15)
    np.testing.assert_allclose(u_of_x(fit(campaign, robust=True)), u_of_x(solution), rtol=0.1)


@pytest.mark.parametrize(
    "change",
    [
        lambda s: s.extrapolated({"X": (-100.0, 800.0)}),
        lambda s: best_rigid(s, default_tools())[0],
        lambda s: s.in_datum(Datum("Z", "X")),
    ],
    ids=["extrapolated", "rigid", "other datum"],
)
def test_a_changed_solution_keeps_it(solution, change):
    changed = change(solution)
    assert changed.scatter == solution.scatter
    assert np.all(u_of_x(changed) > 0.9 * solution.scatter["X"])
    assert [e.function for e in changed.seen_lengths] == [e.function for e in solution.seen_lengths]


def test_an_earlier_solution_hands_it_on(solution):
    """A second campaign in which the waves do not show, since few readings see them."""
    later = fit(with_waves(2e-3, 7.3, seed=9, n=12)[0], prior=solution)
    assert later.scatter["X"] >= solution.scatter["X"] and np.all(u_of_x(later) > 0.9 * solution.scatter["X"])


def test_functions_grids_and_predictions_contain_it(solution):
    """It may be of any function in its direction; a table of differences from a zero has it twice."""
    scatter = solution.scatter["X"]
    for name in ("EXX", "EXY", "EXZ"):
        assert min(row.u for row in solution.motion(name, np.linspace(10.0, 300.0, 5))) >= scatter
    assert max(row.u for row in solution.motion("EYX", np.linspace(10.0, 300.0, 5))) < 0.5 * scatter
    base = compensation_base(solution, TOOL)
    for names in (["L-VOL"], ["L-POS"]):
        (grid,) = compensate(solution, names, base, points=5, form="grid").grids
        assert np.all(grid.u[:, 0] >= 0.99 * scatter), names
    (table,) = [t for t in error_tables(solution, [TYPES["L-POS"]], base) if t.function == "EXX"]
    assert np.all(table.u >= scatter)
    left = predict_residual(solution, solution.grid(points=9, tool=TOOL))
    assert left.rms > 0.9 * scatter and left.interval[0] > 2.0 * scatter


def test_an_extrapolated_solution_is_neither_refitted_nor_saved(solution, tmp_path):
    further = solution.extrapolated({"X": (-100.0, 800.0)})
    with pytest.raises(InputError, match="this solution is extrapolated"):
        monte_carlo(further, 20)
    with pytest.raises(OutputError, match="an extrapolated solution is not saved"):
        save_solution(further, tmp_path / "s.h5")
    with pytest.raises(InputError, match="change the datum first"):
        further.in_datum(Datum("Z", "X"))
    assert not (tmp_path / "s.h5").exists()


def test_waves_of_a_stated_pitch_are_in_the_u_of_tables_and_not_in_their_values():
    """Nodes every 76 mm meet the waves at few phases; the values are those of the smooth function."""
    solution = fit(with_waves(1e-3, 10.0, pitch=10.0)[0])
    plain = fit(with_waves(0.0, 10.0)[0])
    grids = [s.grid(points=11, tool=TOOL) for s in (solution, plain)]
    assert np.std(grids[0].values[:, 0] - grids[1].values[:, 0]) < 0.15e-3
    assert grids[0].u[:, 0].min() > 0.65e-3
    (note,) = [n for n in solution.notes if n.startswith("short waves")]
    assert "EXX every 10 mm up to" in note


def test_positions_at_one_phase_of_a_pitch_are_named():
    """Levels 40 mm apart and a pitch of 10 mm: no reading tells the waves, so u is large, and the reason is said."""
    campaign, _, _ = simulated(VERTICAL, 3, n_per_station=200, n_grid=20)
    axes = tuple(replace(a, pitch=10.0) if a.letter == "X" else a for a in campaign.machine.axes)
    found = fit(replace(campaign, machine=replace(campaign.machine, axes=axes)))
    assert any("axis X was measured at 1 of 8 phases of its pitch of 10 mm" in text for text in found.unseen)


def test_a_reference_outside_the_measured_range_is_moved_and_said(solution):
    moved = solution.in_datum(Datum(reference=(("X", 900.0),)))
    assert dict(moved.datum.reference) == {"X": 760.0}
    assert any("the reference of X at 900 lies outside the measured range 0 … 760" in n for n in moved.notes)
    assert abs(moved.motion("EXX", np.array([760.0]))[0].value) < 1e-12


# --------------------------------------------------------------------------- stated segments beside estimated smoothness


def beside(factor=1.0, part=None):
    """Functions of X with three segments each, all others estimated; u of every reading times `factor`."""
    extra = '[model.functions]\n"E?X" = { segments = 3 }\n'
    campaign, truth, _ = simulated(
        VERTICAL, 12, n_per_station=200, n_grid=9, every_station_sees_every_tool=True, waviness=0.3
    )
    (s,) = campaign.sets
    rows = np.arange(len(s)) if part is None else np.flatnonzero(s.positions[:, campaign.machine.index("Y")] <= part)
    chosen = s.rows_of(rows)
    return replace(
        campaign, machine=volid_machine(VERTICAL, extra), sets=(replace(chosen, u=factor * chosen.u),)
    ), truth


def test_rank_does_not_depend_on_u_beside_stated_segments():
    said = [fit(beside(factor)[0]) for factor in (1.0, 1000.0)]
    assert said[0].statements == said[1].statements == () and said[0].undetermined == said[1].undetermined


def test_datum_and_extrapolation_go_in_either_order_beside_stated_segments():
    """The smoothness that is continued is that of each function itself: u outside in another datum as in this one."""
    campaign, _ = beside(part=300.0)
    solution = fit(campaign)
    places = np.stack([np.full(3, 380.0), [330.0, 380.0, 430.0], np.full(3, -230.0)], axis=1)
    u = [s.extrapolated().evaluate(places, TOOL).u[:, :3] for s in (solution, solution.in_datum(Datum("Y", "X")))]
    assert np.all(np.diff(u[0], axis=0) > 0.0)
    assert np.all(u[1] > 0.5 * u[0]) and np.all(u[1] < 2.0 * u[0])


def test_one_very_precise_reading_does_not_undetermine_the_rest():
    campaign = simulated(VERTICAL, 12, n_per_station=200, every_station_sees_every_tool=True)[0]
    (s,) = campaign.sets
    u = s.u.copy()
    u[:40] = 1e-6
    assert fit(replace(campaign, sets=(replace(s, u=u),))).fully_determined
