"""KinematicsComp: the chain of its lines against the exact chain; what stands in the tables; what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from exact_chain import ExactMachine, Truth, random_truth
from support.control_cases import MACHINE, error_table, job, levered, pitch, spatial, written
from support.kinematics_chain import Chain
from support.machines import volid_machine

from volid.compensation.package import Compensation
from volid.compensation.tables.axis_table import AxisTable
from volid.compensation.tables.error_table import ErrorTable
from volid.controllers import CONTROLS
from volid.controllers.base import Job, options_of
from volid.exceptions import InputError

NAME = "heidenhain-kinematicscomp"
TRAVEL = {"X": (0.0, 800.0), "Y": (-300.0, 300.0), "Z": (-400.0, 100.0), "C": (0.0, 360.0)}
TOOL = np.array([30.0, -20.0, -150.0])
NODES = 25


def sampled(exact: ExactMachine, truth: Truth) -> Compensation:
    """Tables of all functions at equally spaced nodes; the rotary axis turns itself for its own positioning."""
    found, middle = [], [np.mean(exact.travel[a]) for a in exact.axes]
    for i, axis in enumerate(exact.axes):
        x = np.linspace(*exact.travel[axis], NODES)
        q = np.tile(middle, (NODES, 1))
        q[:, i] = x
        errors = exact.errors(axis, q, truth)
        for k, c in enumerate("XYZABC"):
            itself = axis == "C" and c == "C"
            how = "the axis itself" if itself else "kinematic model"
            u, known = np.zeros((NODES, 2)), np.zeros(NODES, dtype=bool)
            found.append(ErrorTable("", f"E{c}{axis}", x, errors[:, k], errors[:, k], u, known, how, 0.0))
    for name, value in truth.constants.items():
        if name.endswith("S"):
            one, u = np.array([value]), np.zeros((1, 2))
            found.append(ErrorTable("", name, np.zeros(1), one, one, u, np.zeros(1, bool), "kinematic model", 0.0))
    return Compensation((), tuple(found), ())


def files_of(machine, made: Compensation, sign="error", **options) -> dict[str, str]:
    stated = options_of(CONTROLS[NAME].declaration, options)
    what = Job(machine, made, np.zeros(len(machine.axes)), TOOL, sign, stated)
    return {f.name: f.content for f in CONTROLS[NAME].write(what).files}


@pytest.mark.parametrize("c", [1.0, -1.0])
@pytest.mark.parametrize("structure", ["w C' Y' X' b Z t", "w b X Y Z C t", "w X' b Y Z t", "w Y' C' b X Z t"])
def test_the_chain_of_the_lines_is_the_machine_with_all_its_errors(structure, c):
    turned = {"C": (0.0, 0.0, c)} if "C" in structure else {}
    exact = ExactMachine(structure, {a: t for a, t in TRAVEL.items() if a in structure}, direction=turned)
    rng = np.random.default_rng(5)
    truth = random_truth(exact, rng)
    chain = Chain(exact, files_of(volid_machine(exact), sampled(exact, truth), decimals="7"))
    q = np.stack([rng.choice(np.linspace(*exact.travel[a], NODES), 200) for a in exact.axes], axis=1)
    off = chain.point(q, TOOL) - exact.functional_point(q, TOOL, truth)
    # angles are rounded to 5e-7°, 9e-9 rad, over levers of 0.5 m in ten lines; slope of 30 µm/m times 15 µm
    assert np.abs(off).max() < 3e-5
    assert np.abs(exact.functional_point(q, TOOL, truth) - exact.functional_point(q, TOOL)).max() > 0.02


def test_an_angle_stands_in_its_column_in_degrees_and_its_line_where_iso_counts_it():
    """Y carries the workpiece: its errors stand on the workpiece side. 20 µrad are 0.001146°."""
    files = written(NAME, levered(), "error")
    assert [line.split() for line in files["YAXIS.COM"].splitlines()][1:5] == [
        ["NR", "AXISPOS", "BACKLASH", "C4"],
        ["0", "0.0000", "0.000000"],
        ["1", "300.0000", "0.000000"],
        ["2", "600.0000", "0.001146"],
    ]
    assert [line.split()[1:] for line in files["VOLID.TAB"].splitlines()[2:-1]] == [
        ["MachAxis", "Z"],
        ["MachBase"],
        ["MachAxis", "X"],
        ["MachAxis", "Y"],
        ["EAY", "Trans", "A", "Y..C4"],
    ]
    turned = written(NAME, levered(), "compensation")
    assert turned["YAXIS.COM"].splitlines()[4].split()[-1] == "-0.001146"


def test_positioning_stays_in_the_column_of_the_axis_with_both_directions_and_its_sign():
    for sign in ("error", "compensation"):
        text = written(NAME, pitch(), sign)["XAXIS.COM"]
        assert [line.split()[1:] for line in text.splitlines()[1:5]] == [
            ["AXISPOS", "BACKLASH", "X"],
            ["0.0000", "0.0020", "0.0000"],
            ["500.0000", "0.0130", "0.0100"],
            ["1000.0000", "-0.0010", "-0.0040"],
        ]


def test_location_errors_are_constants_without_a_table():
    exact = ExactMachine("w C' Y' X' b Z t", TRAVEL, point={"C": (10.0, 0.0, 0.0)})
    machine = volid_machine(exact)
    constants = {"EXC": 0.012, "EBC": -30e-6}
    made = [replace(error_table(n, [0, 180, 360], [v] * 3, kind="R-POR"), period=360.0) for n, v in constants.items()]
    what = Job(
        machine,
        Compensation(("R-POR",), tuple(made), ()),
        np.zeros(4),
        TOOL,
        "error",
        options_of(CONTROLS[NAME].declaration, {}),
    )
    done = CONTROLS[NAME].write(what)
    assert [f.name for f in done.files] == ["VOLID.TAB"]
    rows = [line.split()[1:] for line in done.files[0].content.splitlines()[2:-1]]
    # C carries the workpiece: its stator is towards the tool, and so are its errors
    assert rows[-3:] == [["EXC", "Trans", "X", "0.0120"], ["EBC", "Trans", "B", "-0.001719"], ["MachAxis", "C"]]
    assert any("the lines of C stand where the chain's origin is at 10, 0, 0 mm" in n for n in done.notes)
    back = CONTROLS[NAME].read({f.name: f.content for f in done.files}, machine, {**what.options, "sign": "error"})
    assert {t.function: round(float(t.forward[0]), 8) for t in back.tables} == {
        "EXC": 0.012,
        "EBC": round(np.deg2rad(-0.001719), 8),
    }


def test_what_it_cannot_hold_is_refused():
    with pytest.raises(InputError, match="tables of axes and grids are none of error functions"):
        CONTROLS[NAME].write(job(NAME, spatial(), "error"))
    one = AxisTable("X", "Y", np.array([0.0, 1.0]), np.zeros(2), np.ones(2))
    with pytest.raises(InputError, match="tables of axes and grids"):
        CONTROLS[NAME].write(job(NAME, Compensation((), (), (), (one,)), "error"))
    exact = ExactMachine("w C' Y' X' b Z t", TRAVEL)
    turning = Compensation(("R-VOL",), (error_table("ECC", [0, 180, 360], [0, 1e-5, 0]),), ())
    with pytest.raises(InputError, match="ECC through the kinematic model has no column; take R-POS"):
        files_of(volid_machine(exact), turning)


def read(files: dict[str, str]) -> Compensation:
    return CONTROLS[NAME].read(files, MACHINE, {**options_of(CONTROLS[NAME].declaration, {}), "sign": "error"})


def changed(old: str, new: str, name: str = "VOLID.TAB") -> dict[str, str]:
    files = written(NAME, levered(), "error")
    assert old in files[name]
    return {**files, name: files[name].replace(old, new)}


@pytest.mark.parametrize(
    ("name", "old", "new", "message"),
    [
        ("VOLID.TAB", "Y..C4", "W..C4", r"VOLID.TAB, line 7: 'W\.\.C4' names no axis of the machine"),
        (
            "VOLID.TAB",
            "Y..C4",
            "Y..C5",
            r"YAXIS.COM: column C5 has no values, but the kinematics table names it for EAY",
        ),
        ("VOLID.TAB", "Y..C4", "X..C4", r"EAX: COMPTAB names column C4 of X, whose \.COM is not among the files"),
        ("VOLID.TAB", "A       ", "Q       ", r"line 7: AXIS of an error is 'Q'"),
        ("YAXIS.COM", "C4", "Z ", r"YAXIS.COM: column Z corrects another axis than Y; heidenhain-com"),
    ],
)
def test_lines_that_lead_nowhere_are_refused(name, old, new, message):
    with pytest.raises(InputError, match=message):
        read(changed(old, new, name))


def test_an_error_on_the_other_side_of_its_axis_is_refused():
    files = written(NAME, levered(), "error")
    lines = files["VOLID.TAB"].splitlines()
    lines[5], lines[6] = lines[6], lines[5]
    with pytest.raises(InputError, match="line 6: the error of Y stands before its MachAxis"):
        read({**files, "VOLID.TAB": "\n".join(lines)})


def test_a_constant_that_names_no_error_is_refused():
    nameless = changed("Y..C4", "0.001")
    nameless["VOLID.TAB"] = nameless["VOLID.TAB"].replace("EAY", "   ")
    with pytest.raises(
        InputError,
        match=r"line 7: the constant 0\.001 names no error in DOC; expected the function .* such as EAC, and not EA0C",
    ):
        read(nameless)


def test_a_shift_of_the_chain_that_leads_to_no_rotary_axis_is_refused():
    files = written(NAME, levered(), "error")
    last = files["VOLID.TAB"].splitlines()[-2]
    assert last.split()[-1] == "Y..C4" and files["VOLID.TAB"].splitlines()[1].index("COORD") < last.index("Y..C4")
    shift = last.replace("EAY", "to ").replace(" A ", " X ").replace("Y..C4", "     ").rstrip()
    at = files["VOLID.TAB"].splitlines()[1].index("COORD")
    text = files["VOLID.TAB"].replace("[END]", f"{shift.ljust(at)}12.5\n[END]")
    with pytest.raises(InputError, match=r"line 8: Trans X by 12.5 leads to no rotary axis"):
        read({**files, "VOLID.TAB": text})


@pytest.mark.parametrize("name", [NAME, "heidenhain-com", "sinumerik-cec", "sinumerik-enc-comp"])
def test_files_are_recognised_by_their_own_control_alone(name):
    made = levered() if name in (NAME, "sinumerik-cec") else pitch()
    sign = "error" if name in (NAME, "sinumerik-cec") else None
    files = {f.name: f.content for f in CONTROLS[name].write(job(name, made, sign)).files if f.name != "CONFIG.CMA"}
    for file, text in files.items():
        for content in (text, text.encode().replace(b"\n", b"\r\n")):
            assert [n for n, c in CONTROLS.items() if c.recognises(file, content)] == [name]
