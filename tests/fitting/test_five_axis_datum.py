"""Datum of five-axis machines: another datum describes the same machine; location errors are those of the exact lines."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from exact_chain import Truth, gauge_free
from support.axis_lines import axis_line, line_error
from support.machines import NUTATING, ROTARY_TABLE, STRUCTURES, exact_machine, resolved
from support.made_up import made_up, truth_of
from support.rtests import r_test, r_test_campaign

from volid.exceptions import InputError
from volid.fitting.equations.problem import build_problem
from volid.fitting.location_errors import location_errors, location_parameter, motions_with_mean, split_mean
from volid.fitting.prediction.deviations import gradient_rows
from volid.model.machine import Datum

ALL = {**STRUCTURES, "four axes": ROTARY_TABLE}
OTHER = Datum("Z", "X", "end_point", (("C", 40.0), ("X", -100.0)))


def positions_of(exact, m, seed=0):
    rng = np.random.default_rng(seed)
    low, high = np.array([exact.travel[a] for a in exact.axes]).T
    tool = np.array([0.0, 0.0, -150.0]) + rng.uniform(-150.0, 150.0, (m, 3))
    return low + rng.random((m, len(low))) * (high - low), tool


@pytest.mark.parametrize("layout", ALL)
def test_another_datum_is_the_same_machine_up_to_a_motion_of_the_workpiece(layout):
    exact = exact_machine(ALL[layout])
    before = made_up(resolved(exact, segments=4), seed=4, segments=3)
    after = before.in_datum(OTHER)
    assert after.datum == OTHER and np.ptp(np.asarray(after.parameters) - np.asarray(before.parameters)) > 1e-6
    q, tool = positions_of(exact, 60)
    fields = [np.asarray(s.deviation(q, tool))[:, :3] for s in (before, after)]
    assert np.abs(fields[0] - fields[1]).max() > 0.001  # not the same numbers
    left, _ = gauge_free(fields[1] - fields[0], q, tool, tool_rotation=False, machine=exact)
    # errors of 15 µrad and 5 µm, a frame turned by some 15 µrad at 1 m: products below 1e-3 µm, summed over six bodies
    assert np.abs(left).max() < 5e-6
    # the same for the uncertainty
    covariances = []
    for s in (before, after):
        rows = gradient_rows(
            s.machine,
            s.model.layout,
            s.model.parametrisation @ np.asarray(s.parameters),
            q[:40].T,
            tool[:40].T,
            np.zeros_like(q[:40].T),
        )
        g = np.asarray(rows)[:3].transpose(2, 0, 1).reshape(120, -1) @ s.model.parametrisation
        projected = gauge_free(np.zeros((40, 3)), q[:40], tool[:40], g @ s.parameter_covariance @ g.T,
                               tool_rotation=False, machine=exact)[1]  # fmt: skip
        covariances.append(projected)
    scale = np.sqrt(np.diag(covariances[0])).max() ** 2
    np.testing.assert_allclose(covariances[1], covariances[0], atol=2e-3 * scale)
    # and back again
    back = after.in_datum(before.datum)
    np.testing.assert_allclose(back.parameters, before.parameters, atol=1e-9)
    same = before.in_datum(before.datum)
    np.testing.assert_allclose(same.parameters, before.parameters, atol=1e-10)
    np.testing.assert_allclose(same.covariance, before.covariance, atol=1e-10 * float(np.max(before.covariance)))


@pytest.mark.parametrize("layout", ["tilting table C'A'", "table and head", "fork head CA"])
def test_spheres_move_with_the_workpiece_frame(layout):
    """Predicted R-test readings do not change with the datum: the spheres' places follow the workpiece frame."""
    exact = exact_machine(STRUCTURES[layout])
    data = r_test(exact, Truth(), np.random.default_rng(0), counts={"A": 3, "B": 3, "C": 5})
    machine = resolved(exact, segments=5)
    campaign = r_test_campaign(machine, data, off_by=0.0)
    made = made_up(machine, seed=4)
    problem = build_problem(campaign, made.model)
    n = made.model.n_parameters
    size = n + len(problem.nuisance)
    before = replace(
        made,
        campaign=campaign,
        nuisance=jnp.asarray([e.start for e in problem.nuisance]),
        nuisance_table=problem.nuisance,
        covariance=jnp.eye(size) * 1e-12,
    )
    after = before.in_datum(OTHER)
    assert np.abs(np.asarray(after.nuisance) - np.asarray(before.nuisance)).max() > 0.001

    def readings(s):
        z = np.concatenate([s.model.parametrisation @ np.asarray(s.parameters), np.asarray(s.nuisance)])
        return np.asarray(build_problem(campaign, s.model).equations.predictions(z)[0])

    assert np.abs(readings(after) - readings(before)).max() < 5e-6
    moved = replace(after, nuisance=before.nuisance)
    assert np.abs(readings(moved) - readings(before)).max() > 0.001


# ------------------------------------------------------------------------------------------------------ axis lines


@pytest.mark.parametrize("layout", [*ALL, *NUTATING])
def test_location_errors_are_those_of_the_exact_axis_lines(layout):
    exact = exact_machine((ALL | NUTATING)[layout])
    off = '"E??" = false\n"E?0[XYZS]" = false'  # location errors alone: motions at 0 would shift the line of a carried axis
    solution = made_up(resolved(exact, off, segments=5), seed=6)
    truth = truth_of(solution)
    found = location_errors(solution)
    rotary = [a for a in exact.axes if a in "ABC"]
    assert len(found) == 4 * len(rotary)
    lines = {a: line_error(exact, truth, a) for a in rotary}
    for row in found:
        k = "XYZABC".index(row.name[1])
        tolerance = 1e-9 if k >= 3 else 2e-6  # products of two errors
        assert row.line == pytest.approx(lines[row.axis][k], abs=tolerance), row
        assert row.parameter == (-row.line if exact.primed[row.axis] else row.line)
        assert abs(row.line) > 20 * tolerance and row.u > 0 and row.symbol == row.name
    # the axis next to the bed has the parameters themselves
    outer = [a for a in rotary if exact.primed[a]][-1:] + [a for a in rotary if not exact.primed[a]][:1]
    for row in found:
        if row.axis in outer:
            own = location_parameter(solution, row.name)
            assert (row.parameter, row.u) == pytest.approx((own.value, own.u), rel=1e-12)


@pytest.mark.parametrize("layout", ["tilting table C'A'", "tilting table C'B'", "fork head CA", "fork head CB"])
def test_relative_to_its_carrier_an_axis_has_its_own_parameters(layout):
    exact = exact_machine(STRUCTURES[layout])
    solution = made_up(resolved(exact, '"E??" = false\n"E?0[XYZS]" = false', segments=5), seed=6)
    truth = truth_of(solution)
    tilting = next(a for a in exact.axes if a in "AB")
    carrier, carried = (tilting, "C") if exact.primed["C"] else ("C", tilting)
    found = location_errors(solution, relative_to=carrier)
    assert [r.axis for r in found] == [carried] * 4
    for row in found:
        own = location_parameter(solution, row.name)
        assert (row.parameter, row.u) == pytest.approx((own.value, own.u), rel=1e-12)
        assert row.symbol == f"E{row.name[1]}(0{carrier}){carried}"
        along = exact.direction[carrier]["XYZABC".index(row.name[1]) % 3] != 0
        assert bool(row.remark) == along
    # the angle between the two exact lines needs no frame at all
    a, b = axis_line(exact, truth, carrier)[0], axis_line(exact, truth, carried)[0]
    about = np.cross(exact.direction[carrier], exact.direction[carried])
    tilt = next(r for r in found if r.name[1] == "ABC"[int(np.argmax(np.abs(about)))])
    lean = tilt.line * np.cross(about, exact.direction[carried]) @ exact.direction[carrier] * np.sign(about.sum())
    assert a @ b == pytest.approx(lean, abs=2e-9) and abs(lean) > 1e-6
    # the other way round: minus the same angle
    back = {r.name[1]: r for r in location_errors(solution, relative_to=carried)}
    assert back[tilt.name[1]].line == pytest.approx(-tilt.line, rel=1e-12)


def test_relative_to_needs_a_rotary_axis_of_the_same_side():
    solution = made_up(resolved(exact_machine(STRUCTURES["table and head"]), segments=5))
    with pytest.raises(InputError, match="stand on two sides"):
        location_errors(solution, relative_to="C")
    with pytest.raises(InputError, match="is a linear axis"):
        location_errors(solution, relative_to="X")
    with pytest.raises(InputError, match="has no axis A"):
        location_errors(solution, relative_to="A")


def test_undetermined_location_errors_have_no_number():
    solution = made_up(resolved(exact_machine(STRUCTURES["tilting table C'A'"]), segments=5))
    column = np.zeros((solution.model.n_parameters, 1))
    column[solution.model.by_name["EB0A", "location"].parameters] = 1.0
    rows = {r.name: r for r in location_errors(replace(solution, null_space=jnp.asarray(column)))}
    lost = {name for name, r in rows.items() if np.isnan(r.parameter) and np.isnan(r.line) and np.isnan(r.u)}
    # C is carried by A, its point 53 mm above A's: its tilt and its place in X turn with EB0A; relative to A both are known
    assert lost == {"EB0A", "EB0C", "EX0C"}
    relative = location_errors(replace(solution, null_space=jnp.asarray(column)), relative_to="A")
    assert all(np.isfinite(r.parameter) for r in relative)


# ----------------------------------------------------------------------------------------- means and co-rotating parts


@pytest.mark.parametrize("letter", ["C", "A"])
def test_motions_with_mean_split_into_location_errors_and_zero_mean_motions(letter):
    solution = made_up(resolved(exact_machine(STRUCTURES["tilting table C'A'"]), segments=8), seed=9)
    x = np.linspace(*solution.machine.axis(letter).travel, 2001)
    rows = motions_with_mean(solution, letter, x)
    values = np.array([r.value for r in rows]).reshape(6, -1).T
    split = split_mean(solution, letter, x, values)
    for name, value in split.location.items():
        known = location_parameter(solution, name).value if name in solution.model.names else 0.0
        assert value == pytest.approx(known, abs=2e-8)  # trapezoidal rule against exact quadrature
    assert np.abs(split.corotating).max() < 2e-8
    for k, d in enumerate("XYZABC"):
        own = [r.value for r in solution.motion(f"E{d}{letter}", x)]
        np.testing.assert_allclose(split.motions[:, k], own, atol=3e-8)
    # a vector fixed in the rotor is found as such: on the workpiece side it turns with -q
    angle = np.deg2rad(x)
    values[:, 3:] += 20e-6 * (np.stack([np.cos(angle), -np.sin(angle), 0 * x], axis=1) if letter == "C"
                              else np.stack([0 * x, np.cos(angle), -np.sin(angle)], axis=1))  # fmt: skip
    again = split_mean(solution, letter, x, values)
    np.testing.assert_allclose(again.motions, split.motions, atol=1e-8)
    assert np.linalg.norm(again.corotating[1] - split.corotating[1]) == pytest.approx(20e-6, rel=1e-6)
    # uncertainty of the sum is that of parameter combinations, not a root sum of squares
    first = next(r for r in rows if r.name == f"E{'X' if letter == 'C' else 'Y'}{letter}")
    row = solution.motion_rows(first.name, np.array([first.position]), 0)[0]
    row[solution.model.by_name[f"{first.name[:2]}0{letter}", "location"].parameters] = 1.0
    assert first.u == pytest.approx(np.sqrt(row @ solution.parameter_covariance @ row), rel=1e-12)


def test_linear_axes_have_no_mean():
    with pytest.raises(InputError, match="is a linear axis"):
        motions_with_mean(made_up(resolved(exact_machine(ROTARY_TABLE), segments=5)), "X", np.zeros(1))
