"""Programs of G-code corrected in advance: what is followed, what is written, what is refused with its line."""

import re
from itertools import pairwise

import numpy as np
import pytest
from support.gcode import lines_of

import volid
from volid.compensation.tables.error_table import ErrorTable
from volid.controllers.programs.correction import Corrector
from volid.controllers.programs.lines import Lines
from volid.controllers.programs.program import plain_machine
from volid.controllers.programs.words import blocks

OFFSETS = {"G54": (100.0, 100.0, -200.0)}
HEAD = "G21 G90\nG0 X0 Y0 Z50\n"
SETTING = volid.ProgramSetting(offsets=OFFSETS, tool=(0.0, 0.0, 0.0))


def grid(slope=(1e-4, 0.0, 0.0), constant=(0.0, 0.0, 0.0), turn=0.0, tool=(0.0, 0.0, 0.0)) -> volid.Grid:
    """Deviations constant + slope · X over X alone, from 0 to 1000; a rotation about Y everywhere."""
    x = np.array([0.0, 1000.0])
    values = np.zeros((2, 6))
    values[:, :3] = np.array(constant) + x[:, None] * np.array(slope)
    values[:, 4] = turn
    return volid.Grid("L-VOL", ("X",), (x,), x[:, None], values, values * np.nan, x > 1e9, tool, "machine", "")


def made(body: str, field=None, setting=SETTING, head=HEAD, **options):
    return volid.apply_to_program(field or grid(), head + body + "\n", setting, **options)


def body_of(program) -> list[str]:
    """The lines below the header and the first motion."""
    return program.text.splitlines()[3:]


# ---------------------------------------------------------------------------------------------- by hand


def test_a_line_is_corrected_at_its_ends():
    """Deviation 1e-4 X: at the machine's 300 the axis is 30 µm too far, at 100, where the program begins, 10 µm."""
    program = made("G1 X200 F100")
    assert program.text.splitlines() == ["(CORRECTED BY VOLID)", "G21 G90", "G0 X-0.01 Y0. Z50.", "G1 X199.97 F100"]
    assert program.counted.largest == (pytest.approx(0.03), 0.0, 0.0)
    assert program.counted.blocks == (3, 4)


def test_corrections_count_from_an_origin_that_was_touched():
    """What was touched at the position 100 that the control shows lies at 100.01: X0 stays, X200 is 20 µm less, not 30."""
    setting = volid.ProgramSetting(offsets=OFFSETS, tool=(0.0, 0.0, 0.0), touched=True)
    assert made("G1 X200 F100", setting=setting).text.splitlines()[2:] == ["G0 X0. Y0. Z50.", "G1 X199.98 F100"]


def test_rapids_are_cut_where_they_must_be_straight():
    """A grid that bends at the machine's 500: 10 µm per 100 mm up to there, then back."""
    x, values = np.array([0.0, 500.0, 1000.0]), np.zeros((3, 6))
    values[1, 0] = 0.05
    bent = volid.Grid("L-VOL", ("X",), (x,), x[:, None], values, values * np.nan, x > 1e9, (0, 0, 0), "machine", "")
    setting = volid.ProgramSetting(offsets=OFFSETS, tool=(0, 0, 0), straight_rapids=True)
    assert body_of(made("G0 X800", bent)) == ["G0 X799.99"]
    assert body_of(made("G0 X800", bent, setting)) == ["G0 X399.95", "X799.99"]


def test_axes_that_rest_are_named_where_their_correction_changes():
    assert body_of(made("G1 X200 F100\nX100 Y10", grid((0.0, 2e-5, 0.0), (0.001, 0.0, 0.0)))) == [
        "G1 X199.999 Y-0.006 F100",
        "X99.999 Y9.996",
    ]


def test_the_tool_vector_carries_rotations():
    """10 µrad about Y with a tool 150 longer than the grid's: x = ω_y · z = 1e-5 · (-150) = -1.5 µm, so X moves +1.5 µm."""
    setting = volid.ProgramSetting(offsets=OFFSETS, tool=(0.0, 0.0, -250.0))
    assert body_of(made("G1 X200 F100", grid((0, 0, 0), turn=1e-5, tool=(0, 0, -100.0)), setting)) == [
        "G1 X200.0015 F100"
    ]


def test_g43_gives_the_tool_its_length():
    """The same by G43, whose length also moves Z: 150 to where the grid's tool is 100 long is a lever arm of -50."""
    setting = volid.ProgramSetting(offsets=OFFSETS, lengths={7: 150.0})
    program = made(
        "G43 H7 G0 Z20\nG1 X200 F100",
        grid((0, 0, 0), turn=2e-5, tool=(0, 0, -100.0)),
        setting,
        "G21 G90\nG43 H7\nG0 X0 Y0 Z50\n",
    )
    assert program.text.splitlines()[-1] == "G1 X200.001 F100"


def test_each_tool_has_its_own_vector():
    setting = volid.ProgramSetting(offsets=OFFSETS, tools={1: (0, 0, -100.0), 2: (0, 0, -300.0)})
    text = "T1 M6\nG0 X0 Y0 Z50\nG1 X10 F100\nT2 M6\nG0 X0 Y0 Z50\nG1 X10"
    rows = made(text, grid((0, 0, 0), turn=1e-5, tool=(0, 0, -100.0)), setting, "G21 G90\n").text.splitlines()
    assert [r for r in rows if r.startswith("G1")] == ["G1 X10. F100", "G1 X10.002"]


@pytest.mark.parametrize("change", ["T2 M6", "M6 T2", "T2\nM6", "T1 M6\nT3 M6\nM61 Q2", "T2\nT3 M6\nM6 T2"])
@pytest.mark.parametrize("between", ["", "\nG64 P0.01 Q0.01", "\nM100 Q3", "\nT3"])
def test_the_tool_in_the_spindle(change, between):
    """T acts before M6 in whatever order; Q is a tool with M61 alone. 10 µrad about Y: T2 of 200 mm is pushed by 2 µm."""
    tools = {n: (0.0, 0.0, -100.0 * n) for n in (1, 2, 3)}
    setting = volid.ProgramSetting(offsets=OFFSETS, tools=tools, passing=(100.0,))
    program = made(
        f"{change}{between}\nG0 X0 Y0 Z50\nG1 X100 F100", grid((0, 0, 0), turn=1e-5), setting, head="G21 G90\n"
    )
    assert body_of(program)[-1] == "G1 X100.002 F100"


def test_turns_of_a_modal_helix():
    """P stands without G3, which is in force: two turns are twice as long."""
    rows = ["G3 X0 Y0 I-20 Z-5 F100", "X0 Y0 I-20 Z-10 P2"]
    once = made(rows[0], grid((0, 0, 0))).counted.length
    both = made("\n".join(rows), grid((0, 0, 0))).counted.length
    assert both - once == pytest.approx(4 * np.pi * 20, rel=1e-3)


def test_inverse_time_has_no_exponent():
    """E would be a word of its own: the first piece, 0.2 µm of 500 mm, has a large F."""
    program = made("G93 G1 X0 F2\nG0 Z0\nG1 X0.0002 F9000000\nX-100 F2", grid((1e-4, 0, 0)))
    feeds = [row.split("F")[1] for row in body_of(program) if "F" in row]
    assert "9000000" in feeds and not any("E" in f.upper() for f in feeds)


def test_increments_do_not_add_up_their_rounding():
    """1e-4 of 0.0123 mm is below the last digit: 1000 steps still end where they should."""
    text = made("G91 G1 F100\n" + "X0.0123\n" * 1000).text
    end = lines_of(text, OFFSETS, {})[-1][2]
    assert end[0] == pytest.approx(112.3 * (1 - 1e-4), abs=0.6e-4)


def test_inches_have_digits_enough():
    program = made("G20 G1 X8 F5", head="G21 G90\nG0 X0 Y0 Z50\n")
    assert body_of(program) == [f"G20 G1 X{(303.2 * (1 - 1e-4) - 100) / 25.4:.6f} F5"]


def test_inverse_time_is_shared_by_length():
    """A quarter of 100 mm in half a minute, F2: its n chords take 1/n of it each, F 2 n."""
    rows = body_of(made("G0 X0 Y100\nG93 G2 X100 Y0 J-100 F2\nG94 G1 X0 F100", grid((0, 0, 0))))
    feeds = [float(re.search(r"F([\d.]+)", r)[1]) for r in rows[1:-1]]
    assert sum(1.0 / f for f in feeds) == pytest.approx(0.5, rel=1e-4)
    assert rows[1].startswith("G93 G1 X") and "I" not in rows[1] + rows[2]


def test_words_stay_where_they_act():
    rows = body_of(made("N10 G2 X50 Y50 I25 J25 F80 M3 S500 M0 (half)\nN20 M9\nX0 Y0 R40"))
    assert rows[0].startswith("N10 G1 X") and rows[0].endswith("F80 M3 S500 (half)")
    assert rows[rows.index("N20 M9") - 1].endswith(" M0")
    assert not any("M0" in r or "M3" in r for r in rows[1 : rows.index("N20 M9") - 1])
    assert rows[rows.index("N20 M9") + 1].startswith("X")


def test_reversal_is_taken_up_before_the_motion():
    """EXX is 10 µm in + and 4 µm in -: on the way back X starts 6 µm further before it moves."""
    machine = volid.load_machine("models/wYXbZt_vertical.toml")
    x = np.array([0.0, 1000.0])
    up, down = np.full(2, 0.010), np.full(2, 0.004)
    table = ErrorTable("L-POS", "EXX", x, up, down, np.zeros((2, 2)), x > 1e9, "kinematic model", 0.0)
    program = made("G1 X200 F100\nX100 F50\nY10", volid.Control(machine, (table,)))
    assert body_of(program) == ["G1 X-0.01 F100", "X199.99", "X199.996 F50", "X99.996", "Y10."]
    assert program.counted.taken_up == 2, "at first too: from where X came to its first place is not known"


def test_from_the_reference_no_direction_is_known():
    """EXX is 10 µm in + and 4 µm in -: whence X comes after G28 is not known, so that the mean of 7 µm counts until it moves."""
    machine, x = volid.load_machine("models/wYXbZt_vertical.toml"), np.array([0.0, 1000.0])
    up, down = np.full(2, 0.010), np.full(2, 0.004)
    table = ErrorTable("L-POS", "EXX", x, up, down, np.zeros((2, 2)), x > 1e9, "kinematic model", 0.0)
    program = made("G1 X200 F100\nG28\nG0 X50 Y0 Z50\nG1 Y10\nX60", volid.Control(machine, (table,)))
    assert body_of(program)[2:] == ["G28", "G0 X49.993 Y0. Z50.", "G1 Y10.", "X49.99", "X59.99"]


def test_a_circle_turns_where_its_axes_do():
    """Reversal of X and Y on a full circle: within the chord on either side of all four turning points."""
    machine = volid.load_machine("models/wYXbZt_vertical.toml")
    x = np.array([0.0, 1000.0])
    up, down = np.full(2, 0.010), np.full(2, -0.010)
    tables = [
        ErrorTable("L-POS", f, x, up, down, np.zeros((2, 2)), x > 1e9, "kinematic model", 0.0) for f in ("EXX", "EYY")
    ]
    program = made("G0 X100 Y100 Z0\nG0 X150 Y100\nG3 I-50 F100", volid.Control(machine, tuple(tables)))
    corners = [b for code, _, b in lines_of(program.text, OFFSETS, {}) if code == 1]
    for a, b in pairwise(corners):
        if np.linalg.norm(b - a) < 0.05:  # taken up
            continue
        middle = 0.5 * (a + b) - 200.0
        actual = middle + 0.010 * np.sign([-middle[1], middle[0], 0.0])  # the error of each direction
        assert abs(np.hypot(*actual[:2]) - 50.0) < 0.001
    assert program.counted.taken_up == 4


def test_positions_that_are_not_known_yet_are_left_alone():
    program = made("G0 X10 Y10\nG0 Z20\nG1 X20 F100", head="G21 G90\n")
    assert program.text.splitlines()[2:] == ["G0 X10 Y10", "G0 X9.989 Z20.", "G1 X19.988 F100"]
    assert program.counted.as_they_are == (2,)


def test_after_a_change_of_tools_or_a_pause_no_axis_moves_unasked():
    """The control, or a person, may have raised Z: a word Z before the program's own would lower it again."""
    field = grid((0.0, 0.0, 1e-5))
    for stop in ("T2 M6", "M0", "M1", "M60"):
        rows = body_of(made(f"{stop}\nG0 X200\nG0 Z10\nG1 X100 F100", field))
        assert rows[1:] == ["G0 X200.", "G0 Z9.997", "G1 X100. Z9.998 F100"]


def test_machine_coordinates_and_the_reference_are_left_alone():
    rows = body_of(made("G53 G0 Z0\nG0 X100\nG91 G28 Z0\nG90 G0 X0\nG0 Z5\nG1 X100 F100", grid((0.0, 0.0, 1e-5))))
    assert rows == ["G53 G0 Z0", "G0 X100.", "G91 G28 Z0", "G90 G0 X0", "G0 Z4.999", "G1 X100. Z4.998 F100"]


def test_real_looking_text_is_read_as_it_is_meant():
    lines = [
        "%", "O0001 (PART)", "", "n10g21g90g17g40g49g80", "n20 t1m6", "g0x+0.y0.z50.", "g1 x 200 . 0 f100. ;end", "/m8", "M30",
        "%",
    ]  # fmt: skip
    text = "\r\n".join(lines)
    setting = volid.ProgramSetting(offsets=OFFSETS, tool=(0, 0, 0), block_delete="run")
    rows = volid.apply_to_program(grid(), text, setting).text.splitlines()
    assert rows[:3] == ["%", "O0001 (PART)", "(CORRECTED BY VOLID)"]
    assert rows[6:] == ["G0 X-0.01 Y0. Z50.", "G1 X199.97 F100. ;end", " m8", "M30", "%"]


@pytest.mark.parametrize(("choice", "row"), [("skip", "(left out: /G1 X200 F100)"), ("run", "G1 X199.97 F100")])
def test_block_delete_is_decided(choice, row):
    setting = volid.ProgramSetting(offsets=OFFSETS, tool=(0, 0, 0), block_delete=choice)
    assert body_of(made("/G1 X200 F100", setting=setting)) == [row]


def test_points_outside_are_named_and_the_end_is_held():
    program = made("G1 X200 F100\nX1000\nX0")
    assert program.counted.outside == (4, 5)
    assert body_of(program) == ["G1 X199.97 F100", "X899.9", "X999.9", "X899.9", "X-0.01"], "cut where the grid ends"


# ---------------------------------------------------------------------------------------------- what is refused

NEW = "\n"
REFUSED = {
    "G81 X1 Z-5 R2": "canned cycle",
    "G38.2 Z-5 F10": "probe",
    "G41 D1": "cutter compensation",
    "G92 X0": "moves the origin",
    "G10 L2 P1 X0": "moves the origin",
    "G52 X1": "moves the origin",
    "G68 X0 Y0 R45": "turns, mirrors or scales",
    "G51 P2": "turns, mirrors or scales",
    "G16": "turns, mirrors or scales",
    "G5 X1 Y1 I1 J1 P1 Q1": "spline",
    "G33 Z-5 K1": "spindle's turns",
    "G65 P100": "subprogram or a macro",
    "M98 P100": "subprogram",
    "M6.5": "M6.5 is not known",
    "M123": "name it in `passing`",
    "G123": "G123 is not known",
    "G1 X[1+2] F10": "an expression",
    "G1 X#5 F10": "a variable",
    "#1=5": "a variable",
    "o100 call": "subroutine",
    "O200": "subprogram",
    "G1 X1 A5 F10": "rotary or a parallel axis",
    "G1 X1 X2 F10": "two words X",
    "G0 G1 X1": "both codes of one group",
    "G1 X1..2": "is no word",
    "G1 X1 (open": "not closed",
    "$H": "firmware",
    "G1 X1 *71": "check sum",
    "G2 X10 Y0": "centre is not stated",
    "G2 X10 Y0 I3 J0": "radius is 3.0000 mm at the start and 7.0000 mm at the end",
    "G2 X10 Y0 R2": "more than twice R",
    "G2 X0 Y0 R5": "ends where it starts",
    "G2 X10 Y0 I5 R5": "it has R and also I",
    "G2 X10 Y0 I5 K1": "K does not belong to the plane G17",
    "G18 G2 X10 J5": "J does not belong to the plane G18",
    "G28 X5": "a place between",
    "G53 G1 X1 F10": "G53 is followed as a rapid",
    "G80 X1": "no motion is in force",
    "G93 G1 X1": "its own F",
    "G43 H9": "state it as `length`",
    "G55 G1 X1 F10": "G55 is active, and where it lies is not stated",
    "G4 X1 Y2": "a dwell",
    "G1 X1 F10\nG4 P1 X5": "a dwell",
    "G43 H0": "that of the loaded tool on another",
    "M2\nG1 X5 F10": "after the program's end",
    "M30\n%\n(next)\nX5": "after the program's end",
    "G1 X5 T" + "9" * 400: "is a larger number",
    "G1 X1000000001 F10": "is a larger number",
    "T1.5 M6": "T1.5 is no number of a tool; expected a whole one",
    "M61 Q2.5": "Q2.5 is no number of a tool",
    "G43 H1.2": "H1.2 is no number of a tool length",
    "G1 X１０ F10": "'１' is no sign of G-code outside a comment",
    "ſ100": "'ſ' is no sign of G-code",
    "I5": "without a motion it means nothing",
    "G1 X5 P3 F10": "P3 stands without",
    "H3": "H3 stands without G43",
    "G2 X50 Y50 I25 J25 F80 M5": "block of its own",
    "/G1 X5": "`block_delete`",
    "(CORRECTED BY VOLID)": "corrected already",
}


@pytest.mark.parametrize("body", REFUSED)
def test_what_cannot_be_followed_is_refused_with_its_line(body):
    with pytest.raises(volid.InputError, match=rf"^part\.nc, line {4 + body.count(NEW)}: ") as refused:
        made(f"M8\n{body}", name="part.nc")
    assert REFUSED[body] in str(refused.value)


@pytest.mark.parametrize(
    ("text", "setting", "message"),
    [
        ("G90 G0 X0", SETTING, "line 1: the axes move before G20 or G21"),
        ("G21 G1 X0 F9", SETTING, "line 1: the position of X, Y, Z is not known here"),
        ("G21 G91 G0 X1", SETTING, "line 1: the position of X, Y, Z is not known here, so an incremental"),
        ("G21 G0 X0 Y0 Z0", volid.ProgramSetting(offsets=OFFSETS), "line 1: the tool vector is not known, "),
        ("G21\nT4 M6\nG0 X0 Y0 Z0", volid.ProgramSetting(offsets=OFFSETS, tools={1: (0, 0, 0)}), r"line 3: .* \(T4\)"),
        ("G21 G0 X0 Y0 Z0", volid.ProgramSetting(tool=(0, 0, 0)), "line 1: work offset G54 is active"),
    ],
)  # fmt: skip
def test_what_the_setting_must_say(text, setting, message):
    with pytest.raises(volid.InputError, match=message):
        volid.apply_to_program(grid(), text, setting)


def test_a_start_makes_the_first_motion_known():
    setting = volid.ProgramSetting(offsets=OFFSETS, tool=(0, 0, 0), start=(100.0, 100.0, -200.0), units="mm")
    rows = volid.apply_to_program(grid(), "G1 X100 F9", setting).text.splitlines()
    assert rows[1:] == ["G1 X-0.01 F9", "X99.98"], "the machine stands at 100, where X should be 10 µm less"


def test_settings_are_checked():
    with pytest.raises(volid.InputError, match="`chord` is 0\\.0001 mm, and coordinates are rounded"):
        volid.ProgramSetting(chord=0.0001)
    with pytest.raises(volid.InputError, match="`offset=G60`: there is no such work offset"):
        volid.ProgramSetting(offsets={"G60": (0, 0, 0)})
    with pytest.raises(volid.InputError, match="`units` is 'cm'"):
        volid.ProgramSetting(units="cm")


def test_controls_that_cannot_be_followed_are_refused():
    machine = volid.load_machine("models/wYXbZt_vertical.toml")
    with pytest.raises(volid.InputError, match="increments, smoothing"):
        volid.apply_to_program(volid.Control(machine, increment={"X": 0.001}), "", SETTING)
    five = volid.load_machine("datasets/five_axis_rtest/machine.toml")
    with pytest.raises(volid.InputError, match="corrected on X, Y and Z"):
        volid.apply_to_program(volid.Control(five), "", SETTING)


def test_damaged_programs_give_nothing_but_a_message():
    """Characters changed, doubled and left out at random."""
    rng, whole = (
        np.random.default_rng(3),
        HEAD + "N5 G2 X50 Y50 I25 J25 F80 (a)\nG91 G1 X3 Z-1\nG90 G18 G3 X10 R90\nM30\n",
    )
    refused = 0
    for _ in range(300):
        text = list(whole)
        for _ in range(rng.integers(1, 4)):
            i = int(rng.integers(len(text)))
            text[i] = ["", text[i] * 2, chr(int(rng.integers(1, 255)))][int(rng.integers(3))]
        try:
            volid.apply_to_program(grid(), "".join(text), SETTING)
        except volid.InputError:
            refused += 1
    assert 60 < refused < 300


def test_comments_and_signs_within_words():
    (block,) = blocks("x1(a)y-.5;(b", "p")
    assert [w[:2] for w in block.words] == [("X", 1.0), ("Y", -0.5)]
    assert block.comments == ("(a)", ";(b")


@pytest.mark.parametrize(
    ("corner", "end", "bound"),
    [
        ("xyz", (100.0, 100.0, 100.0), 2.0 / 3.0),  # t³ has the control points 0, 0, 0, 1; its chord 0, 1/3, 2/3, 1
        ("xyz", (100.0, 100.0, 0.0), 0.0),  # Z stays where the value is 0
        ("xy", (100.0, 100.0, 50.0), 1.0 / 3.0),  # t²: 0, 0, 1/3, 1
        ("x", (100.0, 30.0, 60.0), 0.0),
    ],
)
def test_the_bound_of_a_line_is_that_of_its_control_points(corner, end, bound):
    """A cell whose value is 1 µm times x y z, or fewer of them, over 0 … 100, and the line from its corner at 0."""
    nodes = (np.array([0.0, 100.0]),) * 3
    mesh = np.stack([m.ravel(order="F") for m in np.meshgrid(*nodes, indexing="ij")], axis=1)
    values = np.zeros((8, 6))
    values[:, 1] = 0.001 * np.prod(mesh[:, ["xyz".index(c) for c in corner]] / 100.0, axis=1)
    cell = volid.Grid(
        "L-VOL", ("X", "Y", "Z"), nodes, mesh, values, values * np.nan, mesh[:, 0] > 1e9, (0, 0, 0), "machine", ""
    )
    start, tool = np.zeros((1, 3)), np.zeros((1, 3))
    lines = Lines(np.zeros(1, int), start, np.array([end]), tool, tool, np.ones(1), np.full((1, 3), np.nan))
    found, node = Corrector(volid.Control(plain_machine(), grids=(cell,))).bounds(lines)
    assert found[0] == pytest.approx(0.001 * bound, abs=1e-12)
    assert np.isnan(node[0])
