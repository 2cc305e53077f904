"""Scripts of DEFINE COMP and DEFINE BLCOMP: written out by hand, and played by a small control of its own in this file."""

import re
from dataclasses import replace

import numpy as np
import pytest
from support.control_cases import MACHINE, TOOL, error_table, job, levered, pitch, spatial, written

import volid
from volid.compensation.control import Control
from volid.compensation.package import Compensation
from volid.compensation.tables.axis_table import AxisTable, Factor
from volid.compensation.tables.error_table import ITSELF, ErrorTable
from volid.controllers import CONTROLS
from volid.controllers.base import options_of
from volid.exceptions import InputError

PMAC = CONTROLS["pmac"]
TRUNNION = volid.load_machine("models/wCAYXbZt_trunnion.toml")


def stated(**options):
    return {**options_of(PMAC.declaration, {"counts": "1000", **options}), "sign": "compensation"}


def script(made: Compensation, machine=MACHINE, **options) -> str:
    asked = job("pmac", made, machine=machine, **{"counts": "1000", **options})
    return PMAC.write(asked).files[0].content


def read(text: str, machine=MACHINE, **options) -> Compensation:
    return PMAC.read({"a.pmc": text}, machine, stated(**options))


TRAVEL = {"X": (0.0, 1000.0), "Y": (0.0, 600.0), "Z": (-500.0, 0.0)}
ODD = "X=123.4,Y=77,Z=-33"  # between the positions of the tables
SHIFT: dict[str, np.ndarray] = {}  # by home, from the direction +: motor zero is 0, the same in both directions


class Played:
    """What the manual says that the control does with a script: counts in, sixteenths of a count for each motor out."""

    def __init__(self, text: str) -> None:
        self.comp, self.blcomp, self.constant = [], {}, {}
        addressed, table = 0, None
        for line in text.splitlines():
            line = line.split(";")[0].strip()
            if re.fullmatch(r"#\d+", line):
                addressed = int(line[1:])
            elif line.startswith("DEFINE COMP"):
                size, *motors, spans = re.fullmatch(r"DEFINE COMP ([\d.]+),((?:#\d+D?,)+)([\d,]+)", line).groups()
                table = []
                names = [int(m.strip("#D")) for m in motors[0].strip(",").split(",")]
                self.comp.append(([int(n) for n in size.split(".")], names, [int(s) for s in spans.split(",")], table))
            elif line.startswith("DEFINE BLCOMP"):
                n, span = line.split(" ")[2].split(",")
                table = []
                self.blcomp[addressed] = (int(n), int(span), table)
            elif match := re.fullmatch(r"I(\d+)86=(\d+)", line):
                self.constant[int(match[1])] = int(match[2])
            elif line and not line.startswith("I51"):
                table.extend(int(v) for v in line.split())

    def corrections(self, at: dict[int, float], way: dict[int, int]) -> dict[int, float]:
        total = dict.fromkeys(at, 0.0)
        for size, motors, spans, table in self.comp:
            entries = [0, *table]
            if len(size) == 1:
                (n,), (source, target) = size, motors
                total[target] += self.line(entries, n, spans[0], at[source])
            else:
                (rows, columns), (row, column, target) = size, motors
                lines = [entries[(columns + 1) * r : (columns + 1) * (r + 1)] for r in range(rows + 1)]
                along = [self.line(line, columns, spans[0], at[row]) for line in lines]
                total[target] += self.line(along, rows, spans[1], at[column])
        for motor in at:
            if way[motor] < 0:
                n, span, table = self.blcomp.get(motor, (1, 1, [0]))
                total[motor] -= self.constant.get(motor, 0) + self.line([0, *table], n, span, at[motor])
        return total

    @staticmethod
    def line(entries, n: int, span: int, counts: float) -> float:
        place = counts % span / (span / n)
        i = int(place)
        return entries[i] + (place - i) * (entries[i + 1] - entries[i])


def test_a_script_written_out_by_hand():
    """X 1000 counts/mm, 16 entries per µm. In +: 0, 10, -4 µm: -160, 64. In - further by 2, 3, 3 µm. Y against its value at 0."""
    assert script(pitch()).splitlines() == [
        "; motors: X #1, Y #2, Z #3",
        "; entries in 1/16 count, added to the commanded position",
        "#2",
        "DEFINE COMP 3,#2D,#2,900000 ; EYY",
        "-96 -288 0",
        "#1",
        "DEFINE COMP 3,#1D,#1,1500000 ; EXX",
        "-160 64 0",
        "#1",
        "DEFINE BLCOMP 3,1500000 ; backlash of X",
        "16 16 0",
        "I186=32",
        "I51=1",
    ]


def test_positions_below_motor_zero_stand_behind():
    """X from -500 to 500 around motor zero: entry 1 at +500, entry 2 at -500, entry 3 at 0 again."""
    made = Compensation(("L-POS",), (error_table("EXX", [0, 500, 1000], [0.001, 0.003, -0.004]),), ())
    lines = script(made, home="X=500").splitlines()
    assert lines[3:5] == ["DEFINE COMP 3,#1D,#1,1500000 ; EXX", "112 32 0"]


def test_the_example_of_the_manual():
    """200 entries over 100,000 counts for ±50,000: the first hundred reach to +50,000, the last ones to 0."""
    text = "#1\nDEFINE COMP 200,100000\n" + "\n".join(str(v) for v in [*range(1, 101), *range(-99, 1)])
    machine = volid.load_machine("models/wYXbZt_vertical.toml")
    (table,) = read(text, machine, counts="100", home="X=500").axis_tables
    q = np.array([500.0, 505.0, 750.0, 1000.0, 495.0, 250.0, 502.5])
    moved = -1600 * table.of_argument(q, np.ones(7))
    np.testing.assert_allclose(moved, [0, 1, 50, 100, -1, -50, 0.5], atol=1e-9)


def test_without_a_machine_the_table_reaches_over_its_span_alone():
    wide = replace(MACHINE, axes=tuple(replace(a, travel=(-1e5, 1e5)) for a in MACHINE.axes))
    found = {t.output: t for t in read(script(pitch()), wide).axis_tables}
    assert found["X"].positions.tolist() == [0, 500, 1000, 1500] and found["Y"].positions.tolist() == [0, 300, 600, 900]
    np.testing.assert_allclose(found["X"].forward, [0.0, 0.010, -0.004, 0.0], atol=1e-12)
    (constant,) = read("#1\nI186=16\n", wide).axis_tables
    assert constant.positions.tolist() == [0, 1] and constant.reversal_value == pytest.approx(-0.001)


def test_rows_and_columns_stand_in_the_order_of_the_chart():
    """Columns along the first source motor; row 0 has no entry at 0, each further row has."""
    text = "#1 DEFINE COMP 1.2,#1D,#2D,#3,2000000,600000\n16 32\n160 176 192"
    (grid,) = read(text).grids
    assert grid.axes == ("X", "Y")
    at = {tuple(p): -16000 * v for p, v in zip(grid.positions.tolist(), grid.values[:, 2].tolist(), strict=True)}
    # the travel of Y ends at the span, where it is rolled over to 0
    assert {p: round(v) for p, v in at.items()} == {(0, 0): 0, (1000, 0): 16, (0, 600): 0, (1000, 600): 16}


def rough(rng, name="EXX", low=0.0, high=1000.0, n=11, size=0.02) -> ErrorTable:
    x, up = np.linspace(low, high, n), rng.normal(scale=size, size=n)
    return error_table(name, x, up, up + np.abs(rng.normal(scale=0.2 * size, size=n)), kind="L-VOL")


@pytest.mark.parametrize("home", ["X=0,Y=0,Z=0", "X=500,Y=300,Z=-250", "X=1000,Y=600,Z=-500", ODD])
def test_the_played_script_does_what_the_tables_ask(home):
    """All 18 functions of three axes, lever arms included; in both directions, against tables without a file.

    From a motor zero between the positions of a table only straight lines are held exactly.
    """
    rng = np.random.default_rng(9)
    components = "XYZ" if home == ODD else "XYZABC"  # a rotation's lever arm makes no straight line
    tables = [
        rough(rng, f"E{c}{a}", *TRAVEL[a], n=6, size=3e-5 if c in "ABC" else 0.02) for a in "XYZ" for c in components
    ]
    tables = [t if t.function[1] == t.function[2] else with_mean(t) for t in tables]
    tables = [straight(t) for t in tables] if home == ODD else tables
    made = Compensation(("L-VOL",), tuple(tables), ())
    asked = job("pmac", made, counts="X=2000,Y=2500,Z=10000", home=home)
    done = PMAC.write(asked)
    played, tables_alone = Played(done.files[0].content), Control(MACHINE, axis_tables=asked.axis_tables(products=True))
    zero = {p.split("=")[0]: float(p.split("=")[1]) for p in home.split(",")}
    counts, numbers = {"X": 2000, "Y": 2500, "Z": 10000}, {"X": 1, "Y": 2, "Z": 3}
    q = np.stack([rng.choice(np.linspace(*TRAVEL[a], 6), 60) for a in MACHINE.letters], axis=1)
    for way in (1.0, -1.0):
        wanted = tables_alone.command(q, TOOL, np.full_like(q, way)) - q
        found = []
        for row in q:
            place = dict(zip(MACHINE.letters, row.tolist(), strict=True))
            at = {numbers[a]: (place[a] - zero[a]) * counts[a] for a in numbers}
            moved = played.corrections(at, dict.fromkeys(at, int(way)))
            found.append([moved[numbers[a]] / (16 * counts[a]) for a in MACHINE.letters])
        off = np.array(found) - wanted
        off -= SHIFT.setdefault(home, np.median(off, axis=0))
        # each of up to ten tables of an axis is rounded to 1/16 count, and so is the table at zero
        assert np.abs(off).max() <= 10 * 0.5 / (16 * 2000)
    held = PMAC.read({"a.pmc": done.files[0].content}, MACHINE, asked.options | {"sign": "compensation"}).control(
        MACHINE
    )
    back = held.command(q, TOOL, np.full_like(q, -1.0)) - q
    np.testing.assert_allclose(back, found, atol=2e-9)


def straight(table: ErrorTable) -> ErrorTable:
    """A straight line, with one reversal."""
    up = np.linspace(table.forward[0], table.forward[-1], len(table.positions))
    down = up + (0.003 if table.has_reversal else 0.0)
    return ErrorTable(table.type, table.function, table.positions, up, down, table.u, table.outside, table.applied, 0.0)


def with_mean(table: ErrorTable) -> ErrorTable:
    """Cross tables hold one direction."""
    mean = 0.5 * (table.forward + table.reverse)
    return ErrorTable(
        *(getattr(table, n) for n in ("type", "function", "positions")),
        mean,
        mean,
        table.u,
        table.outside,
        table.applied,
        0.0,
    )


def test_a_turn_has_as_many_entries_as_sections():
    x, up = np.linspace(0.0, 360.0, 5), np.deg2rad([0.0, 0.001, 0.002, 0.001, 0.0])
    table = ErrorTable("R-POS", "ECC", x, up, up, np.zeros((5, 2)), x > 1e9, ITSELF, 0.0, period=360.0)
    text = script(Compensation(("R-POS",), (table,), ()), TRUNNION, counts="C=10000,X=1,Y=1,Z=1,A=1")
    assert text.splitlines()[3:5] == ["DEFINE COMP 4,#6D,#6,3600000 ; ECC", "-160 -320 -160 0"]
    (back,) = read(text, TRUNNION, counts="C=10000,X=1,Y=1,Z=1,A=1").axis_tables
    found = back.of_argument(np.array([90.0, 450.0, -90.0]), np.ones(3))
    np.testing.assert_allclose(np.rad2deg(found), [0.001, 0.001, 0.001], atol=1e-12)


def test_a_turn_with_reversal_is_one_table_again():
    x, up = np.linspace(0.0, 360.0, 5), np.deg2rad([0.0, 0.001, 0.002, 0.001, 0.0])
    for lost in ([0.001] * 5, [0.001, 0.002, 0.001, 0.003, 0.001]):
        down = up + np.deg2rad(lost)
        table = ErrorTable("R-POS", "ECC", x, up, down, np.zeros((5, 2)), x > 1e9, ITSELF, 0.0, period=360.0)
        counts = "C=16000,X=1,Y=1,Z=1,A=1"
        text = script(Compensation(("R-POS",), (table,), ()), TRUNNION, counts=counts)
        assert "I686=256" in text and text.count("BLCOMP") == len(set(lost)) // 2
        (back,) = read(text, TRUNNION, counts=counts).axis_tables
        q = np.array([0.0, 90.0, 270.0, 450.0, -90.0])
        wanted = np.array([0.0, 0.001, 0.001, 0.001, 0.001]) + np.array(lost)[[0, 1, 3, 1, 3]]
        np.testing.assert_allclose(np.rad2deg(back.of_argument(q, -np.ones(5))), wanted, atol=1e-9)


def test_sixteenths_of_a_count_are_lost_at_most_by_half():
    rng = np.random.default_rng(4)
    done = PMAC.write(job("pmac", Compensation(("L-POS",), (rough(rng),), ()), counts="200"))
    assert 0.0 < done.rounding <= 0.5 / (16 * 200) * (1 + 1e-9)


def test_what_is_left_out_is_said():
    turned = error_table("EXX", [0, 1000], [0.001, 0.002], [-0.001, 0.0])
    notes = PMAC.write(job("pmac", Compensation(("L-POS",), (turned,), ()), counts="1000")).notes
    assert any("X: 1.00 µm are taken off the error values of all its tables together everywhere" in n for n in notes)
    assert any("runs ahead by 0.002 mm after a reversal; I186 holds no such value" in n for n in notes)
    crossed = error_table("EXY", [0, 600], [0.0, 0.002], [0.001, 0.003], kind="L-SQU")
    notes = PMAC.write(job("pmac", Compensation(("L-SQU",), (crossed,), ()), counts="1000")).notes
    assert any("X over Y: the mean of both directions; up to 0.0005 mm are left in either" in n for n in notes)


def test_counts_must_be_stated():
    with pytest.raises(InputError, match=r"pmac: option counts of Y, X, Z is missing.*counts=Y=…,X=…,Z=…"):
        written("pmac", pitch())
    with pytest.raises(InputError, match=r"pmac: option counts of Z is missing.*counts=Z=…"):
        written("pmac", pitch(), counts="X=1000,Y=1000")


def test_more_tables_than_owners_are_refused():
    rng = np.random.default_rng(1)
    made = Compensation(
        ("L-VOL",), tuple(with_mean(rough(rng, f"E{c}{a}", *TRAVEL[a])) for a in "XYZ" for c in "XYZABC"), ()
    )
    assert 8 < script(made).count("DEFINE COMP") <= 32
    with pytest.raises(InputError, match="pmac: more than 8 tables; each belongs to a motor of its own"):
        script(made, owners="8")


def test_two_axes_of_one_motor_are_refused():
    with pytest.raises(InputError, match="motor 2 drives X and Y"):
        script(pitch(), motors="X=2")


def test_grids_over_three_axes_are_refused():
    with pytest.raises(InputError, match="pmac: grid of L-VOL over X, Y, Z; expected one over two linear axes"):
        script(spatial())


def test_a_script_by_hand_may_be_written_otherwise():
    text = "; by hand\ni51=0\n#1 delete comp\n#1define comp 3 , #1d , 1500000 ; X\n-160\n64\n 0\nI186 = 32\nI51=1\r\n"
    (table,) = read(text).axis_tables
    q = np.array([0.0, 500.0, 1000.0])
    np.testing.assert_allclose(table.of_argument(q, np.ones(3)), [0.0, 0.010, -0.004], atol=1e-12)
    np.testing.assert_allclose(table.of_argument(q, -np.ones(3)), [0.002, 0.012, -0.002], atol=1e-12)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "a.pmc: holds no table"),
        ("DEFINE COMP 3,#1D,#1,1500000\n1 2", "a.pmc: ends before the last table does; expected 1 more"),
        ("DEFINE COMP 3,#1D,#1,1500000\n1 2 3 4", "line 2: 4 numbers; expected 3 entries"),
        ("DEFINE COMP 3,#1D,#1,1500000\n1 2.5 3", r"line 2: is '1 2.5 3'; expected 3 more entries"),
        ("DEFINE COMP 3,#1D,#1,0\n1 2 3", "line 1: is 'DEFINE COMP 3,#1D,#1,0'; expected DEFINE COMP entries"),
        ("DEFINE COMP 3.2,#1D,#1,5\n", "line 1: is 'DEFINE COMP 3.2,#1D,#1,5'; expected DEFINE COMP entries"),
        ("DEFINE COMP 2,#1D,#9,1000000\n1 0", "a.pmc: motor 9 drives no axis"),
        ("DEFINE COMP 1.1,#1D,#1D,#2,1000000,600000\n1 2 3", "a table moves Y over X and X; expected two different"),
        ("DEFINE COMP 1000000,#1D,#1,1000\n" + "0 " * 1000000, "at most 20000 over its travel"),
        ("#1J+", r"line 1: is 'J\+'; expected DEFINE COMP"),
    ],
)
def test_scripts_that_are_wrong_are_refused(text, message):
    with pytest.raises(InputError, match=message):
        read(text)


def test_an_axis_table_with_a_lever_and_a_grid_over_two_axes_are_one_table():
    """What is read back as a grid is written as the same script again."""
    text = script(levered())
    again = PMAC.write(job("pmac", read(text), counts="1000")).files[0].content
    q = np.array([[y, x, z] for y in (0.0, 450.0, 600.0) for x in (0.0, 1000.0) for z in (-500.0, -250.0, 0.0)])
    one, two = (read(t).control(MACHINE).command(q, TOOL) for t in (text, again))
    np.testing.assert_allclose(one, two, atol=1e-12)


def test_a_table_with_a_lever_meets_its_positions_though_motor_zero_lies_between_them():
    """Positions -200, -115, -30, 55 and motor zero at 0: 5 mm meet all, 240 sections up to the travel's end, one rolls over."""
    x, angle = np.array([-200.0, -115.0, -30.0, 55.0]), np.array([0.0, 20e-6, -10e-6, 30e-6])
    lever = Factor("Z", np.array([-500.0, 0.0]), np.array([-250.0, 250.0]))
    done = PMAC.write(
        job("pmac", Compensation((), (), (), (AxisTable("Y", "X", x, angle, angle, lever),)), counts="1000")
    )
    assert re.findall(r"DEFINE COMP [\w.#,]+", done.files[0].content) == [
        "DEFINE COMP 2.241,#1D,#3D,#2,1205000,1000000"
    ]
    assert not any("other positions" in n for n in done.notes)
    x = x + 0.12345
    x[1] += 1.0
    done = PMAC.write(
        job("pmac", Compensation((), (), (), (AxisTable("Y", "X", x, angle, angle, lever),)), counts="1000")
    )
    assert any(n.startswith("Y over X and Z: other positions than those of the table: up to") for n in done.notes)


def test_its_scripts_are_recognised():
    assert PMAC.recognises("a.pmc", script(pitch())) and not PMAC.recognises("x.comp", "0 0 0\n")


def test_tables_of_one_pair_of_axes_become_one():
    tables = tuple(
        AxisTable("X", "X", np.array([0.0, 1000.0]), np.array([0.0, v]), np.array([0.0, v])) for v in (0.004, 0.001)
    )
    text = script(Compensation((), (), (), tables))
    assert text.count("DEFINE COMP") == 1 and "-80" in text


def test_a_table_that_ends_inside_the_travel_is_held_up_to_its_ends():
    """X travels 0 … 1000, the table ends at 600: without positions up to 1000 the control would begin it again."""
    x = np.array([200.0, 400.0, 600.0])
    table = error_table("EXX", x, np.array([0.0, 0.010, 0.004]))
    (held,) = read(script(Compensation(("L-POS",), (table,), ()))).axis_tables
    at, way = {"X": np.array([0.0, 100.0, 200.0, 400.0, 600.0, 610.0, 900.0, 1000.0])}, {"X": np.zeros(8)}
    assert held.at(at, way) == pytest.approx([0.0, 0.0, 0.0, 0.010, 0.004, 0.004, 0.004, 0.004], abs=1e-6)
