"""Tables of axes move the axes as the tables of error functions do."""

import numpy as np
import pytest

import volid
from volid.compensation.tables.axis_table import AxisTable
from volid.compensation.tables.by_axis import axis_tables, bent_between
from volid.compensation.tables.error_table import ErrorTable
from volid.exceptions import InputError

MACHINES = ("wYXbZt_vertical", "wXbZYt_moving_column", "wbXYZt_gantry", "wXYbZt_vertical")


def error_table(machine, name, rng):
    axis = machine.axis(name[2])
    x = np.linspace(*axis.travel, 5)
    size = 20e-6 if name[1] in "ABC" else 0.02
    up = rng.normal(scale=size, size=5)
    return ErrorTable("L-VOL", name, x, up, up + 0.1 * size, np.zeros((5, 2)), x > 1e9, "kinematic model", 0.0)


@pytest.mark.parametrize("structure", MACHINES)
def test_products_do_what_the_kinematic_model_does(structure):
    machine, rng = volid.load_machine(f"models/{structure}.toml"), np.random.default_rng(3)
    tables = tuple(error_table(machine, f"E{c}{a}", rng) for a in "XYZ" for c in "XYZABC")
    at, tool = np.array([np.mean(a.travel) for a in machine.axes]), np.array([20.0, -30.0, -150.0])
    made = axis_tables(machine, tables, at, tool)
    # at nodes, because a product of two lines is a parabola between them
    q = np.stack([rng.choice(np.linspace(*a.travel, 5), 40) for a in machine.axes], axis=1)
    ways = rng.choice([-1.0, 1.0], size=q.shape)
    wanted = volid.Control(machine, tables).command(q, tool, ways)
    found = volid.Control(machine, axis_tables=made).command(q, tool, ways)
    np.testing.assert_allclose(found, wanted, atol=1e-9)


def test_without_products_the_lines_are_right():
    machine, rng = volid.load_machine("models/wYXbZt_vertical.toml"), np.random.default_rng(4)
    tables = tuple(error_table(machine, f"E{c}Z", rng) for c in "XYZABC")
    at, tool = np.array([np.mean(a.travel) for a in machine.axes]), np.array([0.0, 0.0, -150.0])
    made = axis_tables(machine, tables, at, tool, products=False)
    q = np.tile(at, (5, 1))
    q[:, machine.index("Z")] = tables[0].positions
    wanted = volid.Control(machine, tables).command(q, tool)
    np.testing.assert_allclose(volid.Control(machine, axis_tables=made).command(q, tool), wanted, atol=1e-9)


def test_what_lines_between_the_positions_miss_of_rotations_that_act_through_their_own_position():
    """20 µrad more over 300 mm, and 300 mm more lever arm: a quarter of 20e-6 · 300 mm off halfway; a gantry has no such arm."""
    x, angle = np.array([0.0, 300.0, 600.0]), np.array([0.0, 0.0, 20e-6])
    table = ErrorTable("L-VOL", "EAY", x, angle, angle, np.zeros((3, 2)), x > 1e9, "kinematic model", 0.0)
    for structure, missed in (("wYXbZt_vertical", 1.5e-3), ("wbXYZt_gantry", 0.0)):
        machine = volid.load_machine(f"models/{structure}.toml")
        at = np.array([np.mean(a.travel) for a in machine.axes])
        found = bent_between(machine, [table], at, np.array([0.0, 0.0, -150.0]))
        assert found == pytest.approx(missed, abs=1e-12)


def tool_frame(translation: float) -> list[ErrorTable]:
    """A spindle tilted by 30 µrad about X, and a shift along Y."""
    made, u = {"EA0S": 30e-6, "EY0S": translation}, np.zeros((1, 2))
    return [
        ErrorTable("L-VOL", n, np.zeros(1), np.array([v]), np.array([v]), u, np.zeros(1, bool), "kinematic model", 0.0)
        for n, v in made.items()
    ]


def test_constants_of_the_tool_frame_that_do_nothing_at_this_tool_need_no_table():
    """A tilt of 30 µrad about X moves the point 150 mm below by +4.5 µm along Y; a shift of -4.5 µm undoes it."""
    machine = volid.load_machine("models/wYXbZt_vertical.toml")
    at, tool = np.array([np.mean(a.travel) for a in machine.axes]), np.array([0.0, 0.0, -150.0])
    assert axis_tables(machine, tool_frame(-0.0045), at, tool) == ()
    with pytest.raises(InputError, match=r"EA0S, EY0S: .* move this tool's point by 1.5 µm everywhere"):
        axis_tables(machine, tool_frame(-0.0045), at, np.array([0.0, 0.0, -200.0]))


def test_a_rotary_axis_corrects_itself_in_degrees():
    machine = volid.load_machine("models/wCAYXbZt_trunnion.toml")
    c = np.array([0.0, 360.0])
    table = AxisTable("C", "C", c, np.array([1e-4, 1e-4]), np.array([1e-4, 1e-4]))
    q = np.zeros((1, len(machine.axes)))
    step = volid.Control(machine, axis_tables=(table,)).command(q, None)[0, machine.index("C")]
    assert step == pytest.approx(-np.rad2deg(1e-4), abs=1e-12)
