"""Volumetric compensation of the ISG kernel: what the files mean, written out by hand and set to work by a separate chain."""

import numpy as np
import pytest
from exact_chain import ExactMachine, Truth
from support.control_cases import MACHINE, TOOL, error_table, job, levered, spatial, written
from support.iso_files import FileChain, blocks
from support.machines import LAYOUTS, NUTATING, exact_machine, exact_of, volid_machine
from support.made_up import made_up

import volid
from volid.compensation.package import Compensation
from volid.compensation.tables.axis_table import AxisTable
from volid.compensation.tables.sampling import Sampling
from volid.controllers import CONTROLS
from volid.controllers.base import Job, options_of
from volid.controllers.export import export
from volid.exceptions import InputError

NAME = "isg-volcomp"
GANTRY = volid.load_machine("models/wbXYZt_gantry.toml")
SHAPES = {**LAYOUTS, **NUTATING}
LINEAR_SHAPES = ("wYXbZt_vertical", "wXZbYt_cross_bed", "wZbXYt_horizontal", "wbXYZt_gantry", "wXbZYt_moving_column")


def read(files, machine=MACHINE, **options):
    return CONTROLS[NAME].read(files, machine, options_of(CONTROLS[NAME].declaration, options))


def chain_of(files, number_of_tables=None) -> FileChain:
    stated = dict(line.split(None, 1) for line in files["vol.lis"].splitlines())
    tables = int(stated["workpiece_axes"]) if number_of_tables is None else number_of_tables
    return FileChain(blocks(files["vol.csv"]), stated["chain"].strip(), tables)


def random_errors(machine, rng, size=1.0):
    """A table of every function, 3 µm and 3 µrad at random between unequal positions, and the truth that equals them."""
    tables, truth = [], Truth()
    for axis in machine.axes:
        inner = np.sort(rng.uniform(*axis.travel, 4))
        x = np.array([axis.travel[0], *inner, axis.travel[1]])
        for c in "XYZABC":
            y = size * rng.normal(scale=3e-6 if c in "ABC" else 3e-3, size=len(x))
            tables.append(error_table(f"E{c}{axis.letter}", x, y, kind="L-VOL"))
            truth.functions[f"E{c}{axis.letter}"] = lambda q, x=x, y=y: np.interp(q, x, y)
    return tuple(tables), truth


def places(machine, rng, m=200):
    q = np.stack([rng.uniform(*a.travel, m) for a in machine.axes], axis=1)
    return q, {a.letter: q[:, i] for i, a in enumerate(machine.axes)}


def files_of(machine, made, **options):
    declared = CONTROLS[NAME].declaration
    at = np.array([np.mean(a.travel) for a in machine.axes])
    tool = np.array([30.0, -20.0, -150.0])
    return {
        f.name: f.content
        for f in CONTROLS[NAME].write(Job(machine, made, at, tool, "error", options_of(declared, options))).files
    }


# ------------------------------------------------------------------------------------------------ what is written


def test_a_grid_as_the_vendor_shows_one():
    lines = written(NAME, spatial(((0.0, 1000.0), (0.0, 600.0), (-500.0, 0.0))))["vol.csv"].splitlines()
    assert lines[0].startswith("// error values, actual - nominal")
    assert lines[1:4] == ["X Y Z EXX EYY EZZ", "0.0 0.0 -500.0 0.0 0.005 0.002", "1000.0 0.0 -500.0 0.01 0.005 0.002"]
    assert len(lines) == 2 + 8


def test_the_list_names_axes_chain_and_file():
    text = written(NAME, spatial(), axes="X=4 Y=5 Z=6", folder="D:\\nc")["vol.lis"]
    assert [line.split() for line in text.splitlines()] == [
        ["x", "4"],
        ["y", "5"],
        ["z", "6"],
        ["chain", "XYZ"],
        ["workpiece_axes", "0"],
        ["interpolation", "GRID"],
        ["file[0]", "D:\\nc\\vol.csv"],
        ["file_format[0]", "ISG_CSV"],
    ]


def test_the_startup_list_gets_the_number_of_rows():
    made = CONTROLS[NAME].write(job(NAME, spatial(), id="2"))
    assert [p[:2] for p in made.parameters] == [
        ("vol_comp[2].file_name", "C:\\volcomp\\vol.lis"),
        ("vol_comp[2].max_records", "12"),
    ]


def test_functions_of_a_gantry_stand_as_they_are():
    """All axes on the tool side, errors at the machine origin: the file's numbers are volid's."""
    tables = (
        error_table("EXX", [0, 1000], [0.0, 0.010]),
        error_table("EYX", [0, 500, 1000], [0.001, 0.0, -0.001]),
        error_table("EAZ", [-300, 0], [2e-6, -3e-6], kind="L-VOL"),
    )
    files = files_of(GANTRY, Compensation((), tables, ()))
    assert files["vol.csv"].splitlines()[1:] == [
        "P0X P0Y P0Z",
        "30.0 -20.0 -150.0",
        "#",
        "X EXX EYX",
        "0.0 0.0 0.001",
        "500.0 0.005 0.0",
        "1000.0 0.01 -0.001",
        "#",
        "Z EAZ",
        "-300.0 0.000002",
        "0.0 -0.000003",
    ]


def test_squareness_stands_once_within_the_function_or_as_a_constant():
    """X leans by 20 µrad towards +x over Y: the y axis is turned about z by -20 µrad."""
    made = Compensation((), (error_table("EXY", [0, 300, 600], [-0.006, 0.0, 0.006], kind="L-SQU"),), ())
    within, apart = (dict_of(files_of(GANTRY, made, location_errors=w)) for w in ("functions", "constants"))
    assert within["EXY"].tolist() == [-0.006, 0.0, 0.006] and "C0Y" not in within
    assert apart["C0Y"] == pytest.approx([-20e-6], abs=1e-12)
    np.testing.assert_allclose(apart["EXY"], -0.006, atol=1e-12)  # what is left is no slope


def dict_of(files):
    return {n: rows[:, k] for columns, rows in blocks(files["vol.csv"]) for k, n in enumerate(columns)}


def test_the_location_of_a_table_stands_where_its_axis_average_line_is():
    """Tool relative to workpiece +10 µm in x means that the line of the table is at -10 µm (ISO 230-1)."""
    trunnion = volid.load_machine("models/wCAYXbZt_trunnion.toml")
    c = np.array([0.0, 360.0])
    made = Compensation((), (error_table("EXC", c, [0.010, 0.010], kind="R-POR"),), ())
    own, relative = (
        dict_of(files_of(trunnion, made, location_errors="constants", table_errors=t))
        for t in ("table", "tool relative to workpiece")
    )
    assert own["X0C"] == pytest.approx([-0.010]) and relative["X0C"] == pytest.approx([0.010])


# ------------------------------------------------------------------------------------------------ what the file means


@pytest.mark.parametrize("shape", LINEAR_SHAPES)
@pytest.mark.parametrize("location_errors", ["functions", "constants"])
def test_component_tables_give_the_deviation_of_the_exact_chain(shape, location_errors):
    machine, rng = volid.load_machine(f"models/{shape}.toml"), np.random.default_rng(21)
    tables, truth = random_errors(machine, rng)
    chain = chain_of(files_of(machine, Compensation((), tables, ()), location_errors=location_errors))
    q, at = places(machine, rng)
    wanted = exact_of(machine).deviation(q, np.array([30.0, -20.0, -150.0]), truth)[:, :3]
    assert np.abs(wanted).max() > 5e-3
    # 3e-5 mm: 1e-5 mm between the points of each of three axes, and terms of second order (5 µrad times 10 µm)
    np.testing.assert_allclose(chain.deviation(at), wanted, atol=3e-5)


@pytest.mark.parametrize("shape", SHAPES)
def test_component_tables_of_five_axes_give_the_deviation_of_the_exact_chain(shape):
    exact, rng = exact_machine(SHAPES[shape]), np.random.default_rng(22)
    machine = volid_machine(exact)
    tables, truth = random_errors(machine, rng)
    chain = chain_of(files_of(machine, Compensation((), tables, ())))
    q, at = places(machine, rng)
    wanted = exact.deviation(q, np.array([30.0, -20.0, -150.0]), truth)[:, :3]
    assert np.abs(wanted).max() > 5e-3
    np.testing.assert_allclose(chain.deviation(at), wanted, atol=5e-5)  # five axes


def test_error_points_of_their_own_give_the_deviation_of_the_exact_chain():
    """A pitch of X about a point 400 mm above the origin: the functional point is below it by 550 mm."""
    exact = ExactMachine(
        "w Y' b X Z t",
        {"X": (0, 800), "Y": (0, 500), "Z": (-400, 0)},
        error_point={"X": (10.0, 20.0, 400.0), "Y": (0, -50, 70)},
    )
    machine, rng = volid_machine(exact), np.random.default_rng(23)
    tables, truth = random_errors(machine, rng)
    chain = chain_of(files_of(machine, Compensation((), tables, ())))
    q, at = places(machine, rng)
    wanted = exact.deviation(q, np.array([30.0, -20.0, -150.0]), truth)[:, :3]
    np.testing.assert_allclose(chain.deviation(at), wanted, atol=3e-5)


@pytest.mark.parametrize("shape", ["wbXYZt_gantry", "wYXbZt_vertical", "wbXYZCAt_fork_head"])
def test_constants_of_the_tool_frame_go_into_the_last_axis(shape):
    machine, rng = volid.load_machine(f"models/{shape}.toml"), np.random.default_rng(24)
    tables, truth = random_errors(machine, rng, size=0.3)
    one, value = np.zeros(1), {"EX0S": 2e-3, "EB0S": 10e-6}
    spindle = tuple(error_table(n, one, [v]) for n, v in value.items())
    truth.constants |= value
    chain = chain_of(files_of(machine, Compensation((), (*tables, *spindle), ())))
    q, at = places(machine, rng)
    wanted = exact_of(machine).deviation(q, np.array([30.0, -20.0, -150.0]), truth)[:, :3]
    np.testing.assert_allclose(chain.deviation(at), wanted, atol=5e-5)


@pytest.mark.parametrize("shape", ["wYXbZt_vertical", "wCAYXbZt_trunnion", "wbXYZCAt_fork_head", "wCbZXYBt_mill_turn"])
def test_what_is_read_back_moves_the_axes_as_the_tables_did(shape):
    machine, rng = volid.load_machine(f"models/{shape}.toml"), np.random.default_rng(25)
    tables, _ = random_errors(machine, rng)
    q, _ = places(machine, rng)
    wanted = Compensation((), tables, ()).control(machine).command(q, TOOL)
    for apart in ("functions", "constants"):
        held = read(files_of(machine, Compensation((), tables, ()), location_errors=apart), machine)
        np.testing.assert_allclose(held.control(machine).command(q, TOOL), wanted, atol=2e-5 * len(machine.axes))


# ------------------------------------------------------------------------------------------------ bit-exact, and in bounds


def test_numbers_are_read_as_the_same_numbers():
    """Random bits of the exponents that errors can have, written and read: the same double, for grids and for tables."""
    rng = np.random.default_rng(26)
    values = rng.normal(size=(12, 3)) * 10.0 ** rng.integers(-17, 1, size=(12, 3))
    made = spatial()
    made.grids[0].values[:, :3] = values
    np.testing.assert_array_equal(read(written(NAME, made)).grids[0].values[:, :3], values)
    tables = tuple(
        error_table(f, np.sort(rng.uniform(0, 900, 7)), rng.normal(size=7) * 10.0 ** rng.integers(-17, -2, size=7))
        for f in ("EXX", "EYY", "EAZ")
    )
    held = read(files_of(GANTRY, Compensation((), tables, ())), GANTRY).tables
    for one, other in zip(tables, held, strict=True):
        assert one.function == other.function
        np.testing.assert_array_equal(one.positions, other.positions)
        np.testing.assert_array_equal(one.forward, other.forward)


@pytest.mark.parametrize(
    ("shape", "form"), [("wYXbZt_vertical", "grid"), ("wYXbZt_vertical", "tables"), ("wCAYXbZt_trunnion", "tables")]
)
def test_files_read_again_give_the_solutions_deviation_within_the_interpolation_bound(shape, form):
    machine, bound = volid.load_machine(f"models/{shape}.toml"), 1e-3 if form == "grid" else 5e-5
    solution, rng = made_up(machine), np.random.default_rng(27)
    sampling = Sampling(max_error=bound)
    types = ["L-VOL"] if shape == "wYXbZt_vertical" else ["L-VOL", "R-VOL"]
    made = export(solution, NAME, types, sampling=sampling, options={"form": form})
    q, _ = places(machine, rng, 500)
    found = made.control().expected(q, np.tile(made.job.tool, (500, 1))).point
    wanted = np.asarray(solution.deviation(q, made.job.tool))[:, :3]
    # each table keeps the bound (rotations at the reach of the axis), and their errors add up at worst
    most = bound if form == "grid" else (bound + 1e-5) * len(made.job.compensation.tables)
    assert np.abs(wanted).max() > 10 * most
    assert np.abs(found - wanted).max() < most


def test_the_deviation_that_is_left_is_none_by_the_exact_chain():
    """Pitch of the Y table through lever arms, closed with the separate chain: error in, motion, nothing left."""
    held = read(written(NAME, levered(), form="tables"))
    truth = Truth(functions={"EAY": lambda y: np.interp(y, [0, 300, 600], [0, 0, 20e-6])})
    exact, rng = exact_of(MACHINE), np.random.default_rng(28)
    q, _ = places(MACHINE, rng)
    driven = held.control(MACHINE).command(q, TOOL)
    left = exact.functional_point(driven, TOOL, truth) - exact.functional_point(q, TOOL)
    before = exact.functional_point(q, TOOL, truth) - exact.functional_point(q, TOOL)
    assert np.abs(before).max() > 5e-3 and np.abs(left).max() < 2e-5


# ------------------------------------------------------------------------------------------------ refusals


def test_grids_over_rotary_axes_are_refused_with_what_can_be_done():
    trunnion = volid.load_machine("models/wCAYXbZt_trunnion.toml")
    solution = made_up(trunnion)
    base = volid.compensation_base(solution, TOOL)
    made = volid.compensate(solution, ["R-VOL"], base, points=3, form="grid", uncertainty=False)
    with pytest.raises(InputError, match=r"a grid over A, C with lever arms cannot be written.*form=tables"):
        files_of(trunnion, made)


def test_blank_nodes_are_refused():
    made = spatial()
    made.grids[0].values[3, 1] = np.nan
    with pytest.raises(InputError, match=r"1 of 12 nodes of the grid are not determined.*`ranges`"):
        written(NAME, made)


def test_tables_that_turn_a_rotary_axis_or_move_one_axis_are_refused():
    x = np.array([0.0, 1000.0])
    moved = Compensation((), (), (), (AxisTable("X", "X", x, x * 0.0, x * 0.0),))
    with pytest.raises(InputError, match=r"tables of single axes.*isg-ssfk"):
        written(NAME, moved)
    with pytest.raises(InputError, match=r"R-POS.*isg-ssfk carries R-POS"):
        export(made_up(MACHINE), NAME, ["R-POS"])


def test_a_machine_without_three_linear_axes_is_refused():
    machine = volid.load_machine("models/wYXbZt_vertical.toml").over({})
    two = volid.Machine("two", "w b X Z t", tuple(a for a in machine.axes if a.letter != "Y"))
    with pytest.raises(InputError, match="has the axes X, Z; the control asks for exactly X, Y, Z"):
        files_of(two, Compensation((), (error_table("EXX", [0, 1000], [0.0, 0.01]),), ()))


def test_reversal_is_said_to_stay():
    made = Compensation((), (error_table("EXX", [0, 1000], [0.0, 0.010], [0.004, 0.010]),), ())
    (note,) = CONTROLS[NAME].write(job(NAME, made)).notes
    assert "mean of both" in note and "EXX 2 µm" in note and "isg-ssfk" in note


def test_the_tool_stands_in_the_file_unless_the_control_adds_it():
    made = CONTROLS[NAME].write(job(NAME, levered(), form="tables"))
    assert "P0X P0Y P0Z\n0.0 0.0 -150.0\n" in made.files[0].content
    assert any(
        "P0X, P0Y, P0Z is the tool (0, 0, -150) mm" in n and "two tools of different length" in n for n in made.notes
    )
    added = CONTROLS[NAME].write(job(NAME, levered(), form="tables", tool="control"))
    assert "P0X P0Y P0Z\n0.0 0.0 0.0\n" in added.files[0].content


def test_rotations_of_a_grid_are_said_to_be_lost():
    made = spatial()
    made.grids[0].values[5, 4] = 30e-6
    (note,) = CONTROLS[NAME].write(job(NAME, made)).notes
    assert "tool vector (0, 0, -150) mm alone" in note and "up to 3 µm" in note


# ------------------------------------------------------------------------------------------------ reading others' files

EXAMPLE = """\
// The header only contains position errors.
C0Y    A0Z
2e-5   1e-5
# component errors of the X axis
// argument and component errors
X      EXX    EYX
10.0   0.00   -0.1
0.0    0.02    0.01
#
X      Z      EZY
0      -500   0.001
1000   -500   0.002
0      0      0.003
1000   0      0.004
"""


def test_several_headers_constants_and_functions_over_two_axes_are_read():
    found = read({"vc.csv": EXAMPLE}, GANTRY)
    by_name = {t.function: t for t in found.tables}
    assert sorted(by_name) == ["EXX", "EXY", "EYX", "EYZ"]
    assert by_name["EXX"].positions.tolist() == [0.0, 10.0] and by_name["EXX"].forward.tolist() == [0.02, 0.0]
    # C0Y turns y towards -x, A0Z turns z towards -y
    y, z = by_name["EXY"], by_name["EYZ"]
    np.testing.assert_allclose(y.forward, -2e-5 * y.positions)
    np.testing.assert_allclose(z.forward, -1e-5 * z.positions)
    (grid,) = found.grids
    assert grid.axes == ("X", "Z") and grid.values[:, 2].tolist() == [0.001, 0.002, 0.003, 0.004]


def test_negated_and_zeroed_axes_of_a_list_are_taken_so():
    files = dict(written(NAME, spatial()))
    plain = read(files).grids[0].values
    turned = read({**files, "vol.lis": files["vol.lis"] + "negate XZ\nset_to_zero Y\n"}).grids[0].values
    np.testing.assert_array_equal(turned[:, :3], plain[:, :3] * [-1, 0, -1])


def test_a_list_may_name_a_text_of_etalon():
    files = {
        "a.lis": "X 1\nY 2\nZ 3\nfile[0] C:\\vc\\m.exc\nfile_format[0] ETALON_EXCHANGE\n",
        "m.exc": "[EXX]\nGridpoints = {\n0 0.0\n100 0.01\n}\n",
    }
    (table,) = read(files, GANTRY).tables
    assert table.function == "EXX" and table.forward.tolist() == [0.0, 0.01]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("X EXX\n0 0.1\n0 0.2\n", "vc.csv, line 1: position X = 0 stands twice"),
        ("X EXX\n0 0.1\n1 1e5\n", r"vc.csv, line 3, EXX: '1e5'; expected a number in mm, rad or degrees, at most 100"),
        ("X EXX\n0 0.1 3\n", "vc.csv, line 2: 3 numbers; expected 2: X EXX"),
        ("X;EXX\n0;0.1\n", "vc.csv, line 1: 'X;EXX' is no argument and no parameter.*blanks"),
        ("X EXX EXX\n", "vc.csv, line 1: a column stands twice"),
        ("X Y\n1 2\n", "vc.csv, line 1: arguments alone"),
        ("X EXX\n#\n", "vc.csv, line 1: a header without rows"),
        ("C0Y\n1e-5\n2e-5\n", "vc.csv, line 1: 2 rows without an argument"),
        (
            "X Y EXX\n0 0 1\n1 0 1\n0 1 1\n",
            "vc.csv, line 1: 3 rows, whose positions do not form a grid; expected each of 2 × 2 = 4.*70471",
        ),
        ("X C EAX\n0 0 1e-6\n", "vc.csv, line 1: EAX over X C; volid holds"),
        ("A EXA\n0 0.1\n", "vc.csv, line 1: EXA: the machine has no axis A"),
        ("X EXX\n0 0.1\n#\nX EXX\n0 0.1\n", "vc.csv, line 4: EXX stands in two blocks"),
    ],
)
def test_files_that_cannot_be_understood_are_refused_with_their_line(text, message):
    with pytest.raises(InputError, match=message):
        read({"vc.csv": text})


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            "file[0] C:\\vc\\other.csv\nfile_format[0] ISG_CSV\n",
            r"v.lis, line 1: file\[0\] names .*other.csv, which is not among",
        ),
        ("file[0] vc.csv\nfile_format[0] TEXT\n", r"v.lis, line 2: file_format\[0\] is 'TEXT'; expected ISG_CSV or"),
        ("file[0] vc.csv\nchain XYZCA\n", "v.lis, line 2: chain is 'XYZCA'; the machine's axes .* are YXZ"),
        ("file[0] vc.csv\nchain YXZ\nworkpiece_axes 2\n", "v.lis, line 3: workpiece_axes is 2; expected 0"),
        ("file[0] vc.csv\nchain YXZ\nalternative_model 1\n", "v.lis, line 3: alternative_model is '1'"),
        ("file[0] vc.csv\nchain YXZ\nnegate XY\n", "v.lis, line 3: negate: tables with lever arms"),
        ("chain YXZ\n", r"v.lis: file\[0\] is missing"),
        ("file[0] vc.csv\nchain\n", "v.lis, line 2: 'chain'; expected a key and a value"),
    ],
)
def test_lists_that_do_not_go_with_the_machine_are_refused(change, message):
    with pytest.raises(InputError, match=message):
        read({"v.lis": change, "vc.csv": "X EXX EAX\n0 0.1 1e-5\n1 0.2 0\n"})


def test_its_files_are_recognised():
    files = written(NAME, spatial())
    assert all(CONTROLS[NAME].recognises(name, content) for name, content in files.items())
    tables = written(NAME, levered(), form="tables")
    assert all(CONTROLS[NAME].recognises(name, content) for name, content in tables.items())
    assert not CONTROLS[NAME].recognises("x.csv", "position,positive,negative\n0,0,0\n")
    assert not CONTROLS[NAME].recognises("x.comp", "0.0 0.0 0.002\n")


def test_a_displaced_line_of_a_table_is_its_location_in_the_machine():
    """Geometry alone: the line of C' stands 12 µm in x and -7 µm in y off its nominal place; the workpiece sits on the table.

    No error model takes part: a machine whose C turns about the displaced point, less the shift of the workpiece with the table.
    """
    structure, travel = "w C' Y' X' b Z t", {"X": (-300, 300), "Y": (-300, 300), "Z": (0, 500), "C": (0, 360)}
    off, tool = np.array([0.012, -0.007, 0.0]), np.array([30.0, -20.0, -150.0])
    nominal = ExactMachine(structure, travel, point={"C": (4.0, -6.0, 3.0)})
    displaced = ExactMachine(structure, travel, point={"C": np.array([4.0, -6.0, 3.0]) + off})
    machine, c = volid_machine(nominal), np.array([0.0, 360.0])
    # volid's parameters are tool relative to workpiece, minus where the line stands
    tables = (error_table("EXC", c, [-0.012] * 2, kind="R-POR"), error_table("EYC", c, [0.007] * 2, kind="R-POR"))
    files = files_of(machine, Compensation((), tables, ()), location_errors="constants")
    assert dict_of(files)["X0C"] == pytest.approx([0.012]) and dict_of(files)["Y0C"] == pytest.approx([-0.007])
    q, at = places(machine, np.random.default_rng(29))
    moved = displaced.functional_point(q, tool) - nominal.functional_point(q, tool) - off  # workpiece frame
    wanted = np.einsum("mji,mj->mi", nominal.table_rotation(q), moved)
    np.testing.assert_allclose(chain_of(files).deviation(at), wanted, atol=1e-9)
    held = read(files, machine).control(machine).expected(q, tool).point
    np.testing.assert_allclose(held, wanted, atol=1e-9)
