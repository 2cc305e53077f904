"""Cross and plane compensation of the ISG kernel."""

import numpy as np
import pytest
from exact_chain import Truth
from support.control_cases import MACHINE, TOOL, error_table, job, levered, pitch, spatial, written
from support.machines import exact_of
from support.made_up import made_up

import volid
from volid.compensation.package import Compensation
from volid.controllers import CONTROLS
from volid.controllers.base import options_of
from volid.controllers.export import export
from volid.exceptions import InputError

NAME = "isg-crosscomp"


def read(files, sign="error", machine=MACHINE):
    options = {**options_of(CONTROLS[NAME].declaration, {}), "sign": sign}
    return CONTROLS[NAME].read(files, machine, options)


def square(kind="L-SQU"):
    return Compensation((), (error_table("EXY", [0, 300, 600], [-0.006, 0.0, 0.006], kind=kind),), ())


@pytest.mark.parametrize(("sign", "factor"), [("error", 1), ("compensation", -1)])
def test_squareness_as_a_table_of_the_slave_over_its_master(sign, factor):
    text = written(NAME, square(), sign)["x_crosscomp.lis"]
    assert [line.split() for line in text.splitlines()] == [
        ["kopf.achs_nr", "1"],
        ["kopf.log_achs_name", "X"],
        ["kw.crosscomp.unit", "1"],
        ["kw.crosscomp.master_ax_nr", "2"],
        ["kw.crosscomp.last_index", "2"],
        ["kw.crosscomp.table[0].setpoint", "0"],
        ["kw.crosscomp.table[0].correction", str(-60 * factor)],
        ["kw.crosscomp.table[1].setpoint", "3000000"],
        ["kw.crosscomp.table[1].correction", "0"],
        ["kw.crosscomp.table[2].setpoint", "6000000"],
        ["kw.crosscomp.table[2].correction", str(60 * factor)],
    ]


def test_a_rotation_through_a_lever_arm_is_a_plane():
    """Pitch of the Y table of 20 µrad at Y = 600: Y moves by -20 µrad · (z + tool z), z counted from the line Z = -250.

    At Y = 600 and Z = -500 the point lies 250 mm below the line: +5 µm there against the line itself.
    """
    files = written(NAME, levered(), "error")
    values = dict(line.split() for line in files["y_crosscomp.lis"].splitlines())
    masters = {values["kw.crosscomp2.master1_ax_nr"], values["kw.crosscomp2.master2_ax_nr"]}
    assert masters == {"2", "3"}
    held = read(files).control(MACHINE)
    q = np.stack([MACHINE.order(X=0.0, Y=600.0, Z=z) for z in (-500.0, -250.0, 0.0)])
    step = held.command(q, TOOL)[:, MACHINE.index("Y")] - 600.0
    # e_y = ω × r: -20 µrad · z' with z' = Z - 150 (tool): 13, 8 and 3 µm; the drive moves the other way
    np.testing.assert_allclose(step, [-0.013, -0.008, -0.003], atol=1.5e-4)


def test_the_separate_chain_says_that_the_deviation_is_gone():
    """Straightness, squareness and a pitch together, in the types that one list can hold."""
    tables = (*levered().tables, error_table("EZX", [0, 500, 1000], [0.0, 0.003, 0.0], kind="L-STR"))
    held = read(written(NAME, Compensation((), tables, ()), "compensation"), "compensation").control(MACHINE)
    truth = Truth(
        functions={
            "EAY": lambda y: np.interp(y, [0, 300, 600], [0, 0, 20e-6]),
            "EZX": lambda x: np.interp(x, [0, 500, 1000], [0, 0.003, 0]),
        }
    )
    exact, rng = exact_of(MACHINE), np.random.default_rng(41)
    q = np.stack([rng.choice(np.linspace(*a.travel, 3), 60) for a in MACHINE.axes], axis=1)
    before = exact.functional_point(q, TOOL, truth) - exact.functional_point(q, TOOL)
    left = exact.functional_point(held.command(q, TOOL), TOOL, truth) - exact.functional_point(q, TOOL)
    # 3e-4 mm: half a step of 0.1 µm for each of the tables, and the slope of the errors times what was moved
    assert np.abs(before).max() > 0.01 and np.abs(left).max() < 3e-4


def test_two_masters_without_products_take_both_tables():
    """X by Y and by Z: 6 µm at Y = 600 and -4 µm at Z = 0."""
    tables = (*square().tables, error_table("EXZ", [-500, -250, 0], [0.0, 0.0, -0.004], kind="L-STR"))
    files = written(NAME, Compensation((), tables, ()), "error")
    assert (
        "kw.crosscomp.table[2]" in files["x_crosscomp.lis"] and "kw.crosscomp2.table[1][2]" in files["x_crosscomp.lis"]
    )
    held = read(files).control(MACHINE)
    q = np.stack([MACHINE.order(X=200.0, Y=y, Z=z) for y, z in ((600.0, 0.0), (600.0, -250.0), (0.0, 0.0))])
    step = held.command(q, TOOL)[:, MACHINE.index("X")] - 200.0
    np.testing.assert_allclose(step, [-0.002, -0.006, 0.010], atol=1e-4)


def test_more_than_one_pair_of_masters_is_refused():
    """ECX moves X with y, EBX moves X with z: two planes of one slave."""
    gantry = volid.load_machine("models/wbXYZt_gantry.toml")
    tables = tuple(error_table(f, [0, 500, 1000], [0.0, 20e-6, 0.0], kind="L-ANG") for f in ("ECX", "EBX"))
    made = job(NAME, Compensation((), tables, ()), "error", machine=gantry)
    with pytest.raises(
        InputError, match=r"X would move by .* and .*one table over one axis and one over two.*isg-volcomp"
    ):
        CONTROLS[NAME].write(made)


def test_rotations_that_one_plane_cannot_hold_are_left_out_with_the_reason():
    solution = made_up(MACHINE)
    made = export(solution, NAME, sign="error")
    assert made.types == ("L-STR", "L-SQU")
    assert any("L-ANG" in n and "one table over one axis and one over two" in n for n in made.notes)
    with pytest.raises(InputError, match="the control has one table over one axis and one over two for each axis"):
        export(solution, NAME, ["L-ANG"], sign="error")


def test_positioning_and_grids_are_refused():
    with pytest.raises(InputError, match="Y corrects itself by its own position; isg-ssfk carries that"):
        written(NAME, pitch(), "error")
    with pytest.raises(InputError, match="no grid over X, Y, Z; isg-volcomp carries grids"):
        written(NAME, spatial(), "error")


def test_an_old_list_stands_with_the_master_and_names_the_slave():
    text = (
        "kopf.achs_nr 3\nkopf.log_achs_name Z\nkw.crosscomp.last_index 1\nkw.crosscomp.slave_ax_nr 1\nkw.crosscomp.unit 1\n"
        "kw.crosscomp.table[0].setpoint 10735\nkw.crosscomp.table[0].correction 3\n"
        "kw.crosscomp.table[1].setpoint 10000000 /*at 1000 mm of axis 3*/\n"
        "kw.crosscomp.table[1].correction 1000 /*corr. of 0,1 mm for axis 1*/\n"
    )
    (table,) = read({"achskw3.lis": text}).axis_tables
    assert (table.output, table.argument) == ("X", "Z")
    np.testing.assert_allclose(table.positions, [1.0735, 1000.0])
    np.testing.assert_allclose(table.forward, [0.0003, 0.1])


PLANE = """\
kopf.achs_nr                            1
kopf.log_achs_name                      X
kw.crosscomp2.interval             100000   /* 10 mm */
kw.crosscomp2.last_index_master1        2
kw.crosscomp2.last_index_master2        1
kw.crosscomp2.start_position_master1    0
kw.crosscomp2.start_position_master2    -700000
kw.crosscomp2.unit 1
kw.crosscomp2.master1_ax_nr 1
kw.crosscomp2.master2_ax_nr 2
kw.crosscomp2.n_cycles 20
kw.crosscomp2.table[ 0][ 0].correction -3
kw.crosscomp2.table[ 0][ 1].correction -1
kw.crosscomp2.table[ 0][ 2].correction 4
kw.crosscomp2.table[ 1][ 0].correction 9
kw.crosscomp2.table[ 1][ 1].correction 13
kw.crosscomp2.table[ 1][ 2].correction 17
End
"""


def test_a_plane_of_the_vendors_page_is_read_as_its_bilinear_surface():
    """table[j][i]: i along X (0, 10, 20 mm), j along Y (-70, -60 mm); in the middle of the first cell the mean of four nodes."""
    tables = read({"achskw1.lis": PLANE}).axis_tables

    def value(x, y):
        at = {"X": np.array([x]), "Y": np.array([y])}
        return 1e4 * sum(t.at(at, {a: np.zeros(1) for a in at})[0] for t in tables)

    nodes = [[value(x, y) for x in (0.0, 10.0, 20.0)] for y in (-70.0, -60.0)]
    np.testing.assert_allclose(nodes, [[-3, -1, 4], [9, 13, 17]], atol=1e-9)
    assert value(5.0, -65.0) == pytest.approx((-3 - 1 + 9 + 13) / 4)
    assert value(-100.0, 500.0) == pytest.approx(9.0)  # its margin stays valid


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("table[ 1][ 1].correction 13\n", "", r"a.lis: kw.crosscomp2.table\[1\]\[1\].correction is missing"),
        ("table[ 1][ 1].correction 13", "", r"line 16"),
        ("master2_ax_nr 2", "master2_ax_nr 1", "both masters of kw.crosscomp2 are X; expected two axes"),
        (
            "master2_ax_nr 2",
            "master2_ax_nr 17",
            r"a.lis, line 10: kw.crosscomp2.master2_ax_nr is 17; option axes states X=1",
        ),
        (
            "interval             100000",
            "interval 0",
            r"a.lis, line 3: kw.crosscomp2.interval is '0'; expected a whole number, 1",
        ),
        ("unit 1", "unit 0", "increments of the encoder"),
    ],
)
def test_planes_that_cannot_be_understood_are_refused(old, new, message):
    text = PLANE.replace("kw.crosscomp2." + old if old.startswith("table") and old.endswith("\n") else old, new)
    assert text != PLANE
    with pytest.raises(InputError, match=message):
        read({"a.lis": text})
