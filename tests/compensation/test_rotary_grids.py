"""R-VOL grids: with the linear grid they say what the exact chain does, for any tool vector, to second order (CONVENTIONS 5)."""

from dataclasses import replace

import numpy as np
import pytest
from exact_chain import apply as carried
from support.machines import LINEAR_OFF, NUTATING, ROTARY_TABLE, STRUCTURES, exact_machine, resolved
from support.made_up import made_up, truth_of

from volid.compensation.grids.linear import linear_grid
from volid.compensation.grids.rotary import deviation_from_grids, rotary_grids
from volid.exceptions import InputError, NotDeterminedError

ALL = {**STRUCTURES, **NUTATING, "four axes": ROTARY_TABLE, "single head": "w Y' X' b Z B t"}
LINEAR_POINTS, ROTARY_POINTS = 4, 9


def at_nodes(exact, linear, rotary, m, seed=5):
    """Positions that are nodes of every grid, where no interpolation stands between grid and model."""
    rng = np.random.default_rng(seed)
    q = np.zeros((m, len(exact.axes)))
    for grid in (linear, *rotary):
        for axis, nodes in zip(grid.axes, grid.nodes, strict=True):
            q[:, exact.column(axis)] = rng.choice(nodes, m)
    return q, np.array([0.0, 0.0, -150.0]) + rng.uniform(-150.0, 150.0, (m, 3))


def as_a_control(exact, linear, rotary, q, tool):
    """CONVENTIONS 5 with the nominal chain of exact matrices: look up, lever arms, add. Nothing from the package but tables."""
    m = len(q)
    head = np.tile(np.eye(4), (m, 1, 1))
    for axis in exact.axes:
        if axis in "ABC" and not exact.primed[axis]:
            head = head @ exact.nominal_factor(axis, q)
    turned = carried(head, tool)
    total = np.zeros((m, 6))

    def look_up(grid):
        own = q[:, [exact.column(a) for a in grid.axes]]
        return grid.values[[np.flatnonzero(np.all(np.isclose(grid.positions, x), axis=1))[0] for x in own]]

    values = look_up(linear)
    total += values
    total[:, :3] += np.cross(values[:, 3:], turned - linear.tool)
    for grid in rotary:
        values = look_up(grid)
        point = turned if grid.side == "head" else q[:, [exact.column(a) for a in "XYZ"]] + turned
        total += values
        total[:, :3] += np.cross(values[:, 3:], point - grid.reference_point)
    return total


def alone(exact, name, value):
    """A solution whose only error is the constant `name`."""
    solution = made_up(resolved(exact, f'"E??" = false\n"E?0?" = false\n{name} = true', segments=4))
    assert solution.model.names == (name,)
    return replace(solution, parameters=np.array([value]))


def second_order_bound(exact, truth, q, tool):
    """|ω||e| + |ω|²·lever with both summed over all bodies: no product of two errors in the chain is larger."""
    reach = (
        np.linalg.norm(q[:, [exact.column(a) for a in "XYZ"]], axis=1).max()
        + np.linalg.norm(tool, axis=1).max()
        + 120.0
    )
    errors = [exact.errors(a, q, truth) for a in exact.axes]
    spindle = [truth.constants.get(f"E{c}0S", 0.0) for c in "XYZABC"]
    translation = sum(np.linalg.norm(e[:, :3], axis=1).max() for e in errors) + np.linalg.norm(spindle[:3])
    rotation = sum(np.linalg.norm(e[:, 3:], axis=1).max() for e in errors) + np.linalg.norm(spindle[3:])
    return rotation * (translation + rotation * reach), rotation**2


@pytest.mark.parametrize("layout", ALL)
def test_linear_and_rotary_grids_together_are_the_full_model_to_second_order(layout):
    exact = exact_machine(ALL[layout])
    left = []
    for scale in (1.0, 0.5):
        solution = made_up(resolved(exact, segments=6), seed=2, scale=scale)
        linear = linear_grid(solution, points=LINEAR_POINTS, tool=(10.0, -20.0, -100.0))
        rotary = rotary_grids(solution, points=ROTARY_POINTS, reference_point=(15.0, 25.0, -35.0))
        assert all(np.isfinite(g.values).all() and g.determined.all() and not g.outside.any() for g in rotary)
        q, tool = at_nodes(exact, linear, rotary, 300)
        truth = truth_of(solution)
        full = exact.deviation(q, tool, truth)
        said = as_a_control(exact, linear, rotary, q, tool)
        left.append(full - said)
        bounds = second_order_bound(exact, truth, q, tool)
        assert (
            np.linalg.norm(left[-1][:, :3], axis=1).max() < bounds[0] < 0.01 * np.linalg.norm(full[:, :3], axis=1).max()
        )
        assert np.linalg.norm(left[-1][:, 3:], axis=1).max() < bounds[1]
        np.testing.assert_allclose(deviation_from_grids(solution.machine, linear, rotary, q, tool), said, atol=1e-12)
    for part in (slice(0, 3), slice(3, 6)):  # halving the errors quarters what is left
        ratio = np.linalg.norm(left[0][:, part]) / np.linalg.norm(left[1][:, part])
        assert ratio == pytest.approx(4.0, rel=0.01)


def test_one_grid_for_a_stacked_pair_one_per_side_for_a_split_pair():
    shapes = {layout: [(g.side, g.axes) for g in rotary_grids(made_up(resolved(exact_machine(c), segments=4)), points=3)]
              for layout, c in ALL.items() if layout not in ("fork head CB", *NUTATING)}  # fmt: skip
    assert shapes == {
        "tilting table C'A'": [("table", ("A", "C"))],
        "tilting table C'B'": [("table", ("B", "C"))],
        "table and head": [("table", ("C",)), ("head", ("B",))],
        "fork head CA": [("head", ("A", "C"))],
        "mill-turn": [("table", ("C",)), ("head", ("B",))],
        "four axes": [("table", ("C",))],
        "single head": [("head", ("B",))],
    }


def test_location_error_of_the_table_in_closed_form():
    """EX0C of a table alone: the tool is +10 µm off in X of the *stator* whatever C, and no lever arm matters."""
    exact = exact_machine(ROTARY_TABLE)
    solution = alone(exact, "EX0C", 0.010)
    (grid,) = rotary_grids(solution, points=5)
    np.testing.assert_allclose(grid.values, np.tile([0.010, 0, 0, 0, 0, 0], (5, 1)), atol=1e-15)
    np.testing.assert_allclose(grid.compensation, -grid.values)
    u = float(np.sqrt(solution.covariance[0, 0]))
    np.testing.assert_allclose(grid.u, np.tile([u, 0, 0, 0, 0, 0], (5, 1)), atol=1e-12 * u)
    columns, table = grid.table_3()
    assert columns == ("n", "C", "ΔX", "ΔY", "ΔZ", "ΔA", "ΔB", "ΔC")
    np.testing.assert_allclose(table[1], [2, -90, -0.010, 0, 0, 0, 0, 0], atol=1e-15)


def test_table_3_of_a_pair_is_compensation_in_degrees():
    grid = rotary_grids(made_up(resolved(exact_machine("w C' A' Y' X' b Z t"), segments=4)), step=50.0)[0]
    columns, table = grid.table_3()
    assert columns == ("n", "A", "C", "ΔX", "ΔY", "ΔZ", "ΔA", "ΔB", "ΔC")
    assert len(table) == 5 * 9  # A -100 … 100 by 50; C -180 … 180 by 50 and the end of travel
    assert np.all(np.diff(table[:9, 2]) > 0) and np.all(table[:9, 1] == -100.0)  # C runs fastest, as printed
    values = grid.interpolate(table[:, 1:3])
    np.testing.assert_allclose(table[:, 3:6], -values[:, :3], atol=1e-15)
    np.testing.assert_allclose(np.deg2rad(table[:, 6:]), -values[:, 3:], atol=1e-15)
    np.testing.assert_allclose(grid.table_3(errors=True)[1][:, 3:], -table[:, 3:])


@pytest.mark.parametrize("layout", ["tilting table C'A'", "table and head", "fork head CA"])
def test_uncertainty_follows_the_covariance(layout):
    """A covariance of rank 3: u² is the sum of squares of what its three directions do to the grid."""
    solution = made_up(resolved(exact_machine(STRUCTURES[layout]), segments=4))
    theta = np.asarray(solution.parameters)
    directions = 0.02 * theta * np.random.default_rng(1).standard_normal((3, len(theta)))
    solution = replace(solution, covariance=directions.T @ directions)
    grids = rotary_grids(solution, points=4)
    moved = [rotary_grids(replace(solution, parameters=solution.parameters + d), points=4) for d in directions]
    for k, grid in enumerate(grids):
        expected = np.sqrt(sum((m[k].values - grid.values) ** 2 for m in moved))
        np.testing.assert_allclose(grid.u, expected, rtol=2e-3, atol=1e-4 * grid.u.max())


def test_full_turn_axis_wraps_and_a_tilting_axis_does_not():
    grid = rotary_grids(made_up(resolved(exact_machine("w C' A' Y' X' b Z t"), segments=6)), points=13)[0]
    np.testing.assert_allclose(grid.interpolate([[20.0, 190.0]]), grid.interpolate([[20.0, -170.0]]), atol=1e-15)
    with pytest.raises(ValueError, match="out of bounds"):
        grid.interpolate([[120.0, 0.0]])


def test_what_the_data_do_not_determine_is_refused_or_left_blank():
    exact = exact_machine("w C' A' Y' X' b Z t")
    solution = made_up(resolved(exact, LINEAR_OFF, segments=4))

    def without(name):
        column = np.zeros((solution.model.n_parameters, 1))
        column[solution.model.by_name[name, "location"].parameters] = 1.0
        return replace(solution, null_space=column, statements=(f"{name}: of a test.",))

    with pytest.raises(NotDeterminedError, match=r"dX of the rotary axes of the table\. EX0C: of a test"):
        rotary_grids(without("EX0C"), points=3)
    tilt = without(
        "EB0A"
    )  # turns about the reference point: translations of that point stay determined, rotation B does not
    (grid,) = rotary_grids(tilt, points=3, reference_point=exact.point["A"])
    assert not grid.determined[:, 4].any() and grid.determined[:, :4].all() and np.isnan(grid.values[:, 4]).all()
    assert any("dB" in note for note in grid.notes)
    with pytest.raises(NotDeterminedError, match="dX"):  # 100 mm above it they do not
        rotary_grids(tilt, points=3, reference_point=np.add(exact.point["A"], [0.0, 0.0, 100.0]))


def test_machines_without_rotary_axes_or_with_a_linear_axis_between_them_are_refused():
    with pytest.raises(InputError, match="has no rotary axis"):
        rotary_grids(made_up(resolved(exact_machine("w Y' X' b Z t"), segments=4)))
    with pytest.raises(InputError, match="a linear axis lies between"):
        rotary_grids(made_up(resolved(exact_machine("w C' X' A' b Y Z t"), segments=4)), points=3)
    with pytest.raises(InputError, match="step"):
        rotary_grids(made_up(resolved(exact_machine(ROTARY_TABLE), segments=4)), step=-1.0)


def test_tool_frame_constants_turn_with_the_head():
    """EB0S alone under a fork head: at C the tool's tilt about its own Y is one about (-sin C, cos C, 0) of the machine."""
    exact = exact_machine("w b X Y Z C A t")
    solution = alone(exact, "EB0S", 20e-6)
    (grid,) = rotary_grids(solution, step=50.0)
    at = np.flatnonzero(np.all(np.isclose(grid.positions, [0.0, 70.0]), axis=1))
    c, s = np.cos(np.deg2rad(70.0)), np.sin(np.deg2rad(70.0))
    np.testing.assert_allclose(grid.values[at, 3:], [[-20e-6 * s, 20e-6 * c, 0.0]], atol=1e-14)
    assert np.all(linear_grid(solution, points=2).values == 0.0)
