"""Tables of $AN_CEC: their sum, as the manual describes it, against the exact chain; what stands in them; what is refused."""

import numpy as np
import pytest
from exact_chain import Truth, random_truth
from support.cec_interpreter import Tables
from support.control_cases import MACHINE, crossed, error_table, job, levered, pitch, written
from support.machines import exact_of

import volid
from volid.compensation.package import Compensation
from volid.compensation.tables.error_table import ErrorTable
from volid.controllers import CONTROLS
from volid.controllers.base import Job, options_of
from volid.controllers.exported import write
from volid.controllers.handover.sheet import checks_of
from volid.exceptions import InputError

NAME = "sinumerik-cec"
TOOL = np.array([20.0, -30.0, -150.0])
LETTERS = "XYZ"


def sampled(exact, truth: Truth, machine, nodes: int) -> Compensation:
    """Tables of all functions of the exact machine, squareness in them, at equally spaced nodes."""
    found = []
    for a in machine.axes:
        x = np.linspace(*a.travel, nodes)
        q = np.tile([np.mean(b.travel) for b in machine.axes], (nodes, 1))
        q[:, machine.index(a.letter)] = x
        up, down = (exact.errors(a.letter, q, truth, np.full(q.shape, way)) for way in (1.0, -1.0))
        for k, c in enumerate("XYZABC"):
            u, known = np.zeros((nodes, 2)), np.zeros(nodes, dtype=bool)
            name = f"E{c}{a.letter}"
            found.append(ErrorTable("L-VOL", name, x, up[:, k], down[:, k], u, known, "kinematic model", 0.0))
    return Compensation(("L-VOL",), tuple(found), ())


def job_of(machine, made: Compensation, sign: str = "error", **options) -> Job:
    at = np.array([np.mean(a.travel) for a in machine.axes])
    return Job(machine, made, at, TOOL, sign, options_of(CONTROLS[NAME].declaration, options))


def by_name(machine, rows: np.ndarray) -> dict[str, np.ndarray]:
    return {f"{a.letter}1": rows[:, i] for i, a in enumerate(machine.axes)}


STRUCTURES = ("wYXbZt_vertical", "wXbZYt_moving_column", "wbXYZt_gantry")


@pytest.mark.parametrize("options", [{}, {"ramps": "each"}], ids=["shared ramps", "a ramp for each axis"])
@pytest.mark.parametrize("structure", STRUCTURES)
def test_the_sum_of_all_tables_is_the_deviation_of_a_machine_with_21_errors(structure, options):
    machine = volid.load_machine(f"models/{structure}.toml")
    exact, rng = exact_of(machine), np.random.default_rng(8)
    truth = random_truth(exact, rng, reversal=("EXX", "EYY", "EZZ", "EAY", "EBX"), tool_rotation=False)
    nodes = 41
    (file,) = CONTROLS[NAME].write(job_of(machine, sampled(exact, truth, machine, nodes), **options)).files
    tables = Tables(file.content)
    assert any(v["MULT_BY_TABLE"] != "0" for v in tables.variables.values())
    at_nodes = np.stack([rng.choice(np.linspace(*a.travel, nodes), 300) for a in machine.axes], axis=1)
    between = np.stack([rng.uniform(*a.travel, 300) for a in machine.axes], axis=1)
    for q, allowed in ((at_nodes, 1e-6), (between, interpolation(exact, truth, machine, nodes))):
        ways = rng.choice([-1.0, 1.0], size=q.shape)
        wanted = exact.deviation(q, TOOL, truth, ways)[:, :3]
        found = np.stack([tables.total(f"{a}1", by_name(machine, q), by_name(machine, ways)) for a in LETTERS], axis=1)
        # products of two errors, 30 µrad times 40 µrad over 1.2 m, are 1.5e-6 mm
        assert np.abs(found - wanted).max() <= allowed + 1.5e-6
    assert np.abs(wanted).max() > 0.02, "the machine has errors"


def interpolation(exact, truth, machine, nodes: int) -> float:
    """Largest error that linear interpolation of the exact machine's functions can make at the functional point [mm]."""
    total = 0.0
    reach = sum(max(map(abs, a.travel)) for a in machine.axes) + np.abs(TOOL).sum()
    for name, f in truth.functions.items():
        a = machine.axis(name[2])
        x = np.linspace(*a.travel, 4001)
        coarse = np.linspace(*a.travel, nodes)
        off = max(
            np.abs(g(x) - np.interp(x, coarse, g(coarse))).max()
            for g in (f, truth.reversal.get(name, lambda q: 0.0 * q))
        )
        total = max(total, off * (1.0 if name[1] in LETTERS else reach))
    return 3.0 * total  # of the three axes


def test_what_is_left_between_the_points_falls_with_the_square_of_the_step():
    machine = volid.load_machine("models/wbXYZt_gantry.toml")
    exact, rng = exact_of(machine), np.random.default_rng(9)
    truth = random_truth(exact, rng, tool_rotation=False)
    q = np.stack([rng.uniform(*a.travel, 2000) for a in machine.axes], axis=1)
    ways, wanted, rms = np.ones(q.shape), exact.deviation(q, TOOL, truth)[:, :3], []
    for nodes in (31, 61):
        (file,) = CONTROLS[NAME].write(job_of(machine, sampled(exact, truth, machine, nodes))).files
        tables = Tables(file.content)
        found = [tables.total(f"{a}1", by_name(machine, q), by_name(machine, ways)) for a in LETTERS]
        rms.append(np.sqrt(np.mean((np.stack(found, axis=1) - wanted) ** 2)))
    assert 3.5 < rms[0] / rms[1] < 4.5 and rms[1] < 2e-4


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_sign_error_and_compensation_differ_in_what_the_axes_do_alone(sense):
    """20 µrad at Y = 600, 400 mm below the origin at Z = -250: Y +8 µm, Z +12 µm; 150 mm lower another 3 µm."""
    sign = "error" if sense > 0 else "compensation"
    tables = Tables(written(NAME, levered(), sign)["nc_cec.ini"])
    at = {"X1": np.array([500.0] * 2), "Y1": np.array([600.0] * 2), "Z1": np.array([-250.0, -400.0])}
    ways = {k: np.ones(2) for k in at}
    np.testing.assert_allclose(tables.total("Y1", at, ways), sense * np.array([0.008, 0.011]), atol=1e-8)
    np.testing.assert_allclose(tables.total("Z1", at, ways), sense * np.array([0.012, 0.012]), atol=1e-8)
    np.testing.assert_allclose(tables.total("X1", at, ways), [0.0, 0.0], atol=1e-8)
    at["Y1"] = np.zeros(2)  # the lever arm moves alone: nothing
    np.testing.assert_allclose(tables.total("Y1", at, ways), [0.0, 0.0], atol=1e-8)


def test_a_control_whose_product_acts_alone_gets_plain_tables():
    """With multiplied=not nothing is taken out: the plain table of Y over Y has the 8 µm, and none of Y over Z is there."""
    text = written(NAME, levered(), "error", multiplied="not")["nc_cec.ini"]
    tables = Tables(text)
    plain = [t for t, v in tables.variables.items() if v["MULT_BY_TABLE"] == "0" and v["INPUT_AXIS"] == "(Y1)"]
    ends = {tables.variables[t]["OUTPUT_AXIS"]: list(tables.points[t].values()) for t in plain}
    assert ends["(Y1)"] == pytest.approx([0.0, 0.0, 0.008], abs=1e-9)
    assert ends["(Z1)"] == pytest.approx([0.0, 0.0, 0.012], abs=1e-9)
    assert len(tables.variables) == 4


def test_how_far_a_plain_table_alone_would_move_its_axis_is_said():
    """dY = -20 µrad · z, in units of 10 m -0.2 mm: the plain table of Y over Y has 0.2 mm more than its own 8 µm."""
    (note,) = [n for n in CONTROLS[NAME].write(job(NAME, levered(), "error")).notes if "ramps" in n]
    assert "A plain table alone would move its axis by up to 0.208 mm, and no sign of Y can be proved" in note
    (note,) = [n for n in CONTROLS[NAME].write(job(NAME, levered(), "error", multiplied="not")).notes if "ramps" in n]
    assert "multiplied=not" in note and "plain" not in note


def test_both_directions_stand_in_two_tables():
    found = Tables(written(NAME, pitch(), "error")["nc_cec.ini"])
    x = [
        (v["DIRECTION"], list(found.points[t].values()))
        for t, v in found.variables.items()
        if v["INPUT_AXIS"] == "(X1)"
    ]
    assert x == [("1", [0.0, 0.010, -0.004]), ("-1", [0.002, 0.013, -0.001])]
    (y,) = [
        (v["DIRECTION"], list(found.points[t].values()))
        for t, v in found.variables.items()
        if v["INPUT_AXIS"] == "(Y1)"
    ]
    assert y == ("0", [-0.006, 0.0, 0.012])
    mean = Tables(written(NAME, pitch(), "error", reversal="mean")["nc_cec.ini"])
    assert [v["DIRECTION"] for v in mean.variables.values()] == ["0", "0"]


def test_numbers_begin_where_room_is_and_the_factor_is_counted_from_one():
    found = Tables(written(NAME, levered(), "error", first_table="7", axes="X=AX1,Y=AX2,Z=AX3")["nc_cec.ini"])
    assert min(found.variables) == 7
    (ramp,) = {int(v["MULT_BY_TABLE"]) for v in found.variables.values()} - {0}
    assert found.variables[ramp - 1]["INPUT_AXIS"] == "(AX3)"
    assert list(found.points[ramp - 1].values()) == pytest.approx([-0.025, 0.025])


def test_each_table_is_switched_by_its_setting_data():
    made = CONTROLS[NAME].write(job(NAME, crossed(), "error"))
    names = [name for name, _, _ in made.parameters]
    assert [n for n in names if n.startswith("SD41300")] == [f"SD41300 $SN_CEC_TABLE_ENABLE[{t}]" for t in range(3)]
    assert "MD32710 $MA_CEC_ENABLE[X1]" in names and "MD32710 $MA_CEC_ENABLE[Y1]" not in names


def test_the_points_of_the_model_are_its_limit():
    """The manuals: 200 points for each table of an 828D, 350 on an 802D sl; on an 840D sl MD18342 decides."""
    most = {
        model: CONTROLS[NAME]
        .declared_for(MACHINE, options_of(CONTROLS[NAME].declaration, {"model": model}))
        .most_points
        for model in ("840d-sl", "828d", "802d-sl")
    }
    assert most == {"840d-sl": None, "828d": 200, "802d-sl": 350}


def test_models_with_few_tables_say_what_fits():
    machine = volid.load_machine("models/wYXbZt_vertical.toml")
    exact = exact_of(machine)
    truth = random_truth(exact, np.random.default_rng(1), reversal=True, tool_rotation=False)
    made = sampled(exact, truth, machine, 11)
    with pytest.raises(
        InputError,
        match=r"828d has 8, 8 of them.*What fits: L-POS alone, with the mean of both directions .reversal=mean.: 3",
    ):
        CONTROLS[NAME].write(job_of(machine, made, model="828d"))
    positioning = Compensation(("L-POS",), tuple(t for t in made.tables if t.function in ("EXX", "EYY", "EZZ")), ())
    with pytest.raises(InputError, match=r"6 tables are needed; 802d-sl has 2"):
        CONTROLS[NAME].write(job_of(machine, positioning, model="802d-sl"))
    many = Compensation(("L-POS",), (error_table("EXX", np.linspace(0, 1000, 201), np.zeros(201) + 0.001),), ())
    with pytest.raises(InputError, match="needs 201 points; 828d has 200"):
        CONTROLS[NAME].write(job_of(machine, many, model="828d"))


PRODUCT = """%_N_NC_CEC_INI
CHANDATA(1)
$AN_CEC_INPUT_AXIS[0]=(AX2) ; basic axis
$AN_CEC_OUTPUT_AXIS[0]="AX1"
$AN_CEC[0,0]=0.0
$AN_CEC[0,1]=0.04
$AN_CEC_STEP[0]=600
$AN_CEC_MIN[0]=0
$AN_CEC_MAX[0]=600
$AN_CEC_MULT_BY_TABLE[0]=2
$AN_CEC[1,0]=1.0
$AN_CEC[1,1]=2.0
$AN_CEC[1,2]=0.0
$AN_CEC_INPUT_AXIS[1]=(AX3)
$AN_CEC_OUTPUT_AXIS[1]=(AX1)
$AN_CEC_STEP[1]=250
$AN_CEC_MIN[1]=-500
$AN_CEC_MAX[1]=0
M17
"""


def read(text: str, machine=MACHINE, sign: str = "error", **options):
    stated = options_of(CONTROLS[NAME].declaration, {"axes": "X=AX1,Y=AX2,Z=AX3", **options})
    return CONTROLS[NAME].read({"old.ini": text}, machine, {**stated, "sign": sign})


def test_a_product_with_a_bent_factor_is_read_as_the_control_does_it():
    found, rng = read(PRODUCT).control(MACHINE), np.random.default_rng(4)
    q = np.stack([rng.uniform(a.travel[0] - 50, a.travel[1] + 50, 50) for a in MACHINE.axes], axis=1)
    positions = {f"AX{1 + LETTERS.index(a.letter)}": q[:, i] for i, a in enumerate(MACHINE.axes)}
    wanted = Tables(PRODUCT.replace('"AX1"', "(AX1)")).total("AX1", positions, {k: np.ones(50) for k in positions})
    step = found.command(q, None)[:, MACHINE.index("X")] - q[:, MACHINE.index("X")]
    np.testing.assert_allclose(step, -wanted, atol=1e-12)


def test_a_table_that_is_switched_off_does_nothing():
    off = "$SN_CEC_TABLE_ENABLE[1]=FALSE\n"
    alone = PRODUCT.replace("MULT_BY_TABLE[0]=2", "MULT_BY_TABLE[0]=0")
    assert [t.argument for t in read(alone + off).axis_tables] == ["Y"]
    with pytest.raises(InputError, match="table 0 is multiplied by table number 2, which the files do not have"):
        read(PRODUCT + off)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("MULT_BY_TABLE[0]=2", "MULT_BY_TABLE[0]=3", "multiplied by table number 3, which the files do not have"),
        ("M17", "$AN_CEC_DIRECTION[1]=1", "multiplied by table number 2, whose values depend on direction"),
        ("M17", "$AN_CEC_DIRECTION[0]=2", r"old.ini, line 19: \$AN_CEC_DIRECTION is 2; expected 0, 1, -1"),
        ("M17", "$AN_CEC_IS_MODULO[0]=1", "line 19: .*table 0 repeats after 600; expected a rotary axis and 360"),
        ("M17", "$SN_CEC_TABLE_WEIGHT[0]=0.5", r"line 19: \$SN_CEC_TABLE_WEIGHT is 0.5; expected 1"),
        (
            "M17",
            "$MA_CEC_SCALING_SYSTEM_METRIC[AX1]=FALSE",
            r"line 19: \$MA_CEC_SCALING_SYSTEM_METRIC is FALSE; .*millimetres",
        ),
        ("(AX2)", "(AX9)", "line 3: machine axis 'AX9' belongs to no axis of the machine"),
        ("$AN_CEC[0,1]=0.04\n", "", "table 0 has no value at point 1 of 0 … 1"),
        ("$AN_CEC_OUTPUT_AXIS[1]=(AX1)\n", "", "table 1: OUTPUT_AXIS is not assigned"),
        ("$AN_CEC[0,0]", "$AN_CEC[0.0]", r"line 5: .*\[0.0\] is unknown; expected \$AN_CEC\[table,point\]"),
    ],
)
def test_what_volid_cannot_know_is_refused(old, new, message):
    assert old in PRODUCT
    with pytest.raises(InputError, match=message):
        read(PRODUCT.replace(old, new))


@pytest.mark.parametrize(("multiplied", "together"), [("also", {True}), ("not", {True, False})])
def test_plain_tables_beside_products_are_not_checked_alone(multiplied, together):
    """By the manual the tables of a product act by themselves too, and the plain tables take that out again."""
    both = levered().tables + crossed().tables
    made = write(
        CONTROLS[NAME], job(NAME, Compensation(("L-VOL",), both, ()), "error", multiplied=multiplied), ("L-VOL",)
    )
    assert {c.is_together for c in checks_of(made) if c.axis == "Y"} == together
