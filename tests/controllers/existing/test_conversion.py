"""One compensation in the forms of several controls: values by hand, refusals where the other form would be another motion."""

import json
from dataclasses import replace

import numpy as np
import pytest
from support.control_cases import AT, MACHINE, TOOL, crossed, error_table, levered, pitch, spatial

import volid
from volid.compensation.on_top import add_compensations, summed, with_opposite
from volid.compensation.package import Compensation
from volid.compensation.tables.axis_table import AxisTable, Factor
from volid.compensation.types import GRID, TABLES
from volid.controllers import CONTROLS
from volid.controllers.base import ControlFile, Controller, Written
from volid.controllers.existing.contents import nodes_by_axis, types_of
from volid.controllers.existing.conversion import Target, convert
from volid.controllers.existing.forms import as_functions, as_grid, sum_of_lines
from volid.exceptions import InputError


def table(output, argument, x, up, down=None, factor=None):
    up = np.array(up, dtype=float)
    return AxisTable(output, argument, np.array(x, dtype=float), up, up if down is None else np.array(down), factor)


def of(*tables):
    return Compensation((), (), (), tables)


class Toy(Controller):
    """A control of the tests: keeps what it is given in the memory of the test, rounded to `quantum`."""

    kept: Compensation

    def __init__(self, **declared):
        self.declaration = replace(CONTROLS["linuxcnc"].declaration, **declared)

    def write(self, job):
        if job.compensation.grids and GRID not in self.declaration.carries.values():
            raise InputError("toy: a grid has no place here")
        Toy.kept = job.compensation
        return Written((ControlFile("toy.json", json.dumps("kept"), "toy"),))

    def read(self, files, machine, options):
        return Toy.kept


@pytest.fixture
def toys(monkeypatch):
    """A control with a grid alone, one with a kinematic model, and one with tables of all kinds."""
    grid = Toy(name="toy-grid", carries={"L-VOL": GRID}, options=())
    model = Toy(name="toy-model", carries={"L-VOL": TABLES, "R-VOL": TABLES}, model=True, options=())
    plain = Toy(name="toy-tables", carries={"L-VOL": TABLES}, options=())
    for toy in (grid, model, plain):
        monkeypatch.setitem(CONTROLS, toy.declaration.name, toy)


def at_centre(control, **q):
    """Correction of Y, X, Z [mm] at a position."""
    positions = MACHINE.order(**q)[None]
    return (control.command(positions, TOOL) - positions)[0]


def test_types_are_told_from_what_moves_what():
    assert types_of(pitch(), MACHINE) == ("L-POS",)
    assert types_of(crossed(), MACHINE) == ("L-POS", "L-STR")
    assert types_of(levered(), MACHINE) == ("L-VOL",)
    ramp = Factor("Z", np.array([-500.0, 0.0]), np.array([-250.0, 250.0]))
    assert types_of(of(table("Y", "Y", [0, 600], [0, 20e-6], factor=ramp)), MACHINE) == ("L-VOL",)
    assert nodes_by_axis(crossed())["X"].tolist() == [0.0, 500.0, 1000.0]


def test_tables_of_axes_become_functions_of_the_same_values():
    made = as_functions(of(table("X", "Y", [0, 600], [0.0, 0.012]), table("X", "X", [0, 1000], [0.0, 0.01])), MACHINE)
    assert {t.function: t.forward.tolist() for t in made.tables} == {"EXY": [0.0, 0.012], "EXX": [0.0, 0.01]}


def test_tables_become_a_grid_on_the_product_of_their_positions():
    (grid,) = as_grid(
        of(table("X", "X", [0, 500, 1000], [0, 0.01, -0.004]), table("X", "Y", [0, 600], [0, 0.012])), MACHINE, TOOL
    )
    assert [n.tolist() for n in grid.nodes] == [[0.0, 500.0, 1000.0], [0.0, 600.0], [-500.0, 0.0]]
    # at X 500, Y 600: 10 + 12 µm, at X 250, Y 300 between the nodes: 5 + 6 µm
    found = grid.interpolate(np.array([[500.0, 600.0, -250.0], [250.0, 300.0, -100.0]]))
    np.testing.assert_allclose(found[:, 0], [0.022, 0.011], atol=1e-15)
    np.testing.assert_array_equal(found[:, 1:], 0.0)


def test_a_product_with_a_lever_arm_is_exact_in_a_grid(toys):
    """20 µrad · (Z + 250) at Y 600: linear in Y and in Z alone, so that a grid of 2 × 2 nodes holds it."""
    ramp = Factor("Z", np.array([-500.0, 0.0]), np.array([-250.0, 250.0]))
    found = convert(of(table("Y", "Y", [0, 600], [0, 20e-6], factor=ramp)), MACHINE, Target("toy-grid"))
    at = at_centre(found.control(), X=500.0, Y=300.0, Z=-50.0)
    np.testing.assert_allclose(at, [-10e-6 * 200.0, 0.0, 0.0], atol=1e-12)


def test_an_angle_that_acts_along_its_own_axis_has_no_exact_grid(toys):
    """EAY moves Z by EAY·Y: a square of Y between the nodes, 20 µrad · 300 mm / 4 = 1.5 µm off in the middle of 300 … 600."""
    with pytest.raises(InputError, match=r"toy-grid would move the axes otherwise than these files: by up to 1\.5 µm"):
        convert(
            levered(), MACHINE, Target("toy-grid", at=dict(zip(MACHINE.letters, AT, strict=True)), tool=tuple(TOOL))
        )


def test_two_directions_have_no_place_in_a_grid_unless_the_mean_is_taken(toys):
    with pytest.raises(
        InputError, match=r"these tables differ by direction: EXX; .* `mean=True` takes the mean of both directions"
    ):
        convert(pitch(), MACHINE, Target("toy-grid"))
    found = convert(pitch(), MACHINE, Target("toy-grid", mean=True))
    # at X 500: 10 µm in +, 13 µm in -; at Y 600: 12 µm
    np.testing.assert_allclose(at_centre(found.control(), X=500.0, Y=600.0, Z=0.0), [-0.012, -0.0115, 0.0], atol=1e-12)


def test_a_grid_that_is_a_sum_becomes_tables(toys):
    found = convert(spatial(), MACHINE, Target("toy-tables"))
    made = {(t.output, t.argument): (t.forward[0], t.forward[-1]) for t in found.job.compensation.axis_tables}
    # dX = 10 µm X/1000; dY = -5 µm Z/500, Z from -500; dZ = 2 µm, which the table over the first axis carries
    expected = {
        ("X", "X"): (0.0, 0.01),
        ("Y", "Z"): (0.0, -0.005),
        ("Y", "X"): (0.005, 0.005),
        ("Z", "X"): (0.002, 0.002),
    }
    assert made.keys() == expected.keys()
    for pair, ends in expected.items():
        np.testing.assert_allclose(made[pair], ends, atol=1e-15)


def test_a_grid_that_is_no_sum_is_refused_with_what_is_missed(toys):
    (grid,) = spatial().grids
    values = grid.values.copy()
    values[:, 2] = 0.008 * (grid.positions[:, 0] / 1000) * (grid.positions[:, 1] / 600)
    assert sum_of_lines(replace(grid, values=values))[1] == pytest.approx(0.008)
    with pytest.raises(InputError, match=r"the L-VOL grid is up to 8\.0 µm off any sum of functions of single axes"):
        convert(Compensation((), (), (replace(grid, values=values),)), MACHINE, Target("toy-tables"))


def test_what_the_other_control_cannot_carry_is_refused_with_the_nearest():
    with pytest.raises(
        InputError, match="linuxcnc cannot carry L-STR, which these files hold: a COMP_FILE corrects a joint"
    ):
        convert(crossed(), MACHINE, Target("linuxcnc"))


def test_a_grid_with_rotations_is_told_to_hold_for_one_tool(toys):
    """The table holds what the grid does with its own tool vector; with another one 30 µrad act."""
    (grid,) = spatial().grids
    values = grid.values.copy()
    values[:, 3] = 30e-6
    found = convert(Compensation((), (), (replace(grid, values=values),)), MACHINE, Target("toy-tables"))
    (said,) = [n for n in found.notes if "right for the tool vector" in n]
    assert "0, 0, -150 mm alone" in said and "up to 3.0 µm otherwise" in said


def test_files_of_linuxcnc_in_both_types_move_the_joints_alike():
    made = {
        kind: convert(pitch(), MACHINE, Target("linuxcnc", options={"comp_file_type": kind})) for kind in ("0", "1")
    }
    text = {k: next(f.content for f in m.written.files if f.name == "x.comp") for k, m in made.items()}
    rows = {k: [[float(v) for v in line.split()] for line in t.splitlines()] for k, t in text.items()}
    np.testing.assert_allclose(rows["0"], [[0, 0, 0.002], [500, 500.01, 500.013], [1000, 999.996, 999.999]], atol=1e-9)
    np.testing.assert_allclose(rows["1"], [[0, 0, -0.002], [500, -0.01, -0.013], [1000, 0.004, 0.001]], atol=1e-9)


# ------------------------------------------------------------------------------------------------ sums


def test_tables_of_one_pair_of_axes_are_summed_on_the_union_of_their_positions():
    (one,) = summed(
        [table("X", "X", [0, 100], [0, 0.01]), table("X", "X", [0, 50, 100], [0.001, 0.004, 0.001], [0, 0, 0])]
    )
    assert one.positions.tolist() == [0.0, 50.0, 100.0]
    np.testing.assert_allclose(one.forward, [0.001, 0.009, 0.011], atol=1e-15)
    np.testing.assert_allclose(one.reverse, [0.0, 0.005, 0.01], atol=1e-15)


def test_other_axes_and_other_levers_stay_apart():
    ramps = [Factor("Z", np.array([-500.0, 0.0]), np.array([a, b])) for a, b in ((-500.0, 0.0), (-250.0, 250.0))]
    tables = [table("Y", "Y", [0, 600], [0, 1e-6], factor=f) for f in (*ramps, ramps[0])]
    found = summed([*tables, table("Y", "Y", [0, 600], [0, 0.01]), table("Y", "X", [0, 600], [0, 0.01])])
    assert len(found) == 4
    np.testing.assert_allclose(found[0].forward, [0.0, 2e-6])


def test_a_sum_and_the_opposite_of_a_part_leave_the_rest():
    old, new = pitch(), Compensation((), (error_table("EXX", [0, 250, 1000], [0.0, 0.004, 0.0]),), ())
    rest = with_opposite(add_compensations(new, old), old).control(MACHINE)
    q = np.array([[100.0, 125.0, -200.0]])
    for way in (1.0, -1.0):
        moved = rest.command(q, TOOL, np.full((1, 3), way)) - q
        np.testing.assert_allclose(moved, [[0.0, -0.002, 0.0]], atol=1e-12)


def test_a_grid_is_added_to_the_one_of_its_side_and_tables_stay_beside():
    both = add_compensations(
        spatial(), add_compensations(spatial(((0.0, 250.0, 1000.0), (0.0, 600.0), (-500.0, 0.0))), pitch())
    )
    assert (len(both.grids), len(both.tables)) == (1, 2)
    at = both.grids[0].interpolate(np.array([[250.0, 0.0, 0.0]]))
    np.testing.assert_allclose(at[0, :3], [0.005, 0.0, 0.004], atol=1e-15)


@pytest.mark.parametrize("cnc", ["isg-ssfk", "fanuc-pitch", "pmac"])
def test_steps_of_the_values_explain_a_difference_of_rotary_axes(cnc):
    """Values in steps of 0.0001°, 0.001° or 1/16 of a count are off by up to half of that, in ° and not in rad."""
    trunnion = volid.load_machine("models/wCAYXbZt_trunnion.toml")
    c = np.arange(0.0, 361.0, 30.0)
    e = 80e-6 * np.sin(np.deg2rad(c))
    e[-1] = e[0]
    old = Compensation((), (), (), (AxisTable("C", "C", c, e, e, period=360.0),))
    open_sign = "error" if CONTROLS[cnc].declaration.sign == "open" else None
    found = convert(old, trunnion, Target(cnc, open_sign, {"counts": "10000"} if cnc == "pmac" else None))
    (held,) = found.held.axis_tables
    at = {"C": c}
    assert held.at(at, {"C": 0 * c}) - held.at({"C": c[:1]}, {"C": c[:1]}) == pytest.approx(e, abs=2 * np.deg2rad(5e-4))


class Continued(Toy):
    """Goes on beyond the last value of a table of X, by 10 µm up to the end of the travel at 1000 mm."""

    def read(self, files, machine, options):
        (kept,) = Toy.kept.axis_tables
        up = np.append(kept.forward, kept.forward[-1] + 0.010)
        return of(AxisTable("X", "X", np.append(kept.positions, 1000.0), up, up))


def test_what_differs_beyond_the_tables_is_refused(monkeypatch):
    """The old control holds the last value from 600 mm on."""
    monkeypatch.setitem(CONTROLS, "toy", Continued(name="toy", carries={"L-POS": TABLES}, options=()))
    old = of(table("X", "X", [200.0, 600.0], [0.0, 0.004]))
    with pytest.raises(InputError, match=r"otherwise than these files: by up to 10\.0 µm at .*X 1000"):
        convert(old, MACHINE, Target("toy"))


@pytest.mark.parametrize("cnc", ["linuxcnc-hal", "isg-volcomp", "sinumerik-cec"])
def test_a_grid_with_rotations_on_a_head_is_refused_where_no_lever_arm_turns_with_it(cnc):
    """A rotation of 20 µrad times a tool of 150 mm that the head turns over: 3 µm and more at A = 90, and nothing at A = 0."""
    head = volid.load_machine("models/wbXYZCAt_fork_head.toml")
    nodes = tuple(np.array(head.axis(a).travel) for a in "XYZ")
    places = np.array([(x, y, z) for z in nodes[2] for y in nodes[1] for x in nodes[0]])
    values = np.zeros((8, 6))
    values[:, 0], values[:, 3] = 1e-5 * places[:, 0], 20e-6
    given = ("L-VOL", ("X", "Y", "Z"), nodes, places, values, values, places[:, 0] > 1e9, (0.0, 0.0, -150.0))
    made = Compensation((), (), (volid.Grid(*given, "machine", ""),))
    open_sign = "error" if CONTROLS[cnc].declaration.sign == "open" else None
    with pytest.raises(InputError, match="would move the axes otherwise"):
        convert(made, head, Target(cnc, open_sign))
