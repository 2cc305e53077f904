"""Grids for HAL: files as written out by hand, in both units, for one tool vector and for several types, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from exact_chain import ExactMachine, Truth
from support.control_cases import MACHINE, TOOL, job, pitch, spatial, written
from support.made_up import made_up
from support.volumetric import STEP, corrections, measured, places, rms

import volid
from volid.compensation.grids.interpolation import grid_positions
from volid.compensation.package import Compensation
from volid.compensation.tables.sampling import Sampling
from volid.controllers import CONTROLS
from volid.controllers.export import export
from volid.controllers.linuxcnc.hal.text import read_grid
from volid.exceptions import InputError
from volid.fitting.prediction.largest import Places

HAL = CONTROLS["linuxcnc-hal"]
NAME = "linuxcnc-hal"


def numbers(text: str) -> list[str]:
    """The lines of a file without comments."""
    return [line for line in text.splitlines() if not line.startswith("#")]


def grid(kind: str, axes: str, nodes, values, tool=TOOL) -> volid.Grid:
    """A grid of error values, (n, 6) or (n, 3) with rotations 0; the first axis fastest."""
    lines = tuple(np.array(n, dtype=float) for n in nodes)
    errors = np.array(values, dtype=float)
    errors = np.hstack([errors, np.zeros_like(errors)]) if errors.shape[1] == 3 else errors
    inside = np.zeros(len(errors), bool)
    common = (kind, tuple(axes), lines, grid_positions(lines), errors, np.full_like(errors, np.nan), inside)
    return volid.Grid(*common, tuple(np.asarray(tool, float).tolist()), "machine", "")


@pytest.fixture(scope="module")
def known(tmp_path_factory):
    """A machine of the exact chain, measured and fitted."""
    return measured(tmp_path_factory.mktemp("known"), 0)


def read(files, machine=MACHINE) -> Compensation:
    return HAL.read(files, machine, {"coordinates": None, "units": "mm"})


def test_file_as_written_out_by_hand():
    """X changes slowest, Z fastest, and each number is minus the error."""
    text = written(NAME, spatial())["l_vol.grid"]
    low, high = "-0.005000000 -0.002000000", "0.000000000 -0.002000000"  # Z = -500 and 0
    x = ["0.000000000", "-0.005000000", "-0.010000000"]
    rows = [f"{dx} {rest}" for dx in x for _ in range(2) for rest in (low, high)]
    head = ["volid-hal-grid 1", "type L-VOL", "tool 0 0 -150", "unit mm", "sign compensation"]
    nodes = ["nodes X 3 0 500 1000", "nodes Y 2 0 600", "nodes Z 2 -500 0", "values 12"]
    assert numbers(text) == [*head, *nodes, *rows, "end"]


def test_inches_are_those_of_the_machine():
    text = written(NAME, spatial(((0.0, 508.0), (0.0, 254.0), (-127.0, 0.0))), units="inch")["l_vol.grid"]
    lines = numbers(text)
    assert lines[2:4] == ["tool 0 0 -5.90551181102", "unit inch"]
    assert lines[5:8] == ["nodes X 2 0 20", "nodes Y 2 0 10", "nodes Z 2 -5 0"]
    assert lines[-2] == "-0.000200000 0.000000000 -0.000078740"  # 5.08 µm, 0, 2 µm
    found = read({"l_vol.grid": text}).grids[0]
    assert found.nodes[0].tolist() == [0.0, 508.0]
    np.testing.assert_allclose(found.values[-1, :3], [0.00508, 0.0, 0.002], atol=25.4 * 0.5e-9)


def test_values_are_moved_to_the_tool_of_the_job():
    """Rotation EB of 20 µrad and a tool 100 mm longer: X moves by EB · (z - z0) = 20e-6 · (-100) more."""
    made = grid(
        "L-VOL", "XYZ", ((0, 1000), (0, 600), (-500, 0)), np.tile([0.010, 0, 0, 0, 20e-6, 0], (8, 1)), (0, 0, -50)
    )
    files = written(NAME, Compensation(("L-VOL",), (), (made,)))
    assert numbers(files["l_vol.grid"])[2] == "tool 0 0 -150"
    assert numbers(files["l_vol.grid"])[9:17] == ["-0.008000000 0.000000000 0.000000000"] * 8


def test_a_longer_tool_is_off_by_what_the_note_says():
    """The separate chain: X pitches by 30 µrad about Y; a tool longer by 10 mm goes 0.3 µm wrong."""
    truth = Truth(functions={"EBX": lambda q: 30e-6 * np.asarray(q) / 1000.0})
    exact = ExactMachine("w Y' X' b Z t", {"X": (0, 1000), "Y": (0, 600), "Z": (-500, 0)})
    lines = ([0.0, 500.0, 1000.0], [0.0, 600.0], [-500.0, 0.0])
    places = grid_positions(tuple(np.array(n) for n in lines))
    q = exact.in_axis_order(dict(zip("XYZ", places.T, strict=True)))
    made = grid("L-VOL", "XYZ", lines, exact.deviation(q, TOOL, truth))
    wanted = job(NAME, Compensation(("L-VOL",), (), (made,)))
    files = HAL.write(wanted)
    assert (
        files.notes[0] == "L-VOL holds for the tool vector (0, 0, -150) mm; one longer by 10 mm is off by up to 0.30 µm"
    )
    control = read({f.name: f.content for f in files.files}).control(MACHINE)
    for tool, largest in ((TOOL, 0.0), (TOOL - [0.0, 0.0, 10.0], 0.30e-3)):
        to = control.command(np.stack([MACHINE.order(X=x, Y=y, Z=z) for x, y, z in places]), tool)
        as_exact = exact.in_axis_order({a: to[:, MACHINE.index(a)] for a in "XYZ"})
        left = exact.functional_point(as_exact, tool, truth) - exact.functional_point(q, tool)
        # of second order: rotation times correction, 30 µrad · 34 µm = 1 nm, in two of the three directions
        assert np.abs(left).max() == pytest.approx(largest, abs=2e-6)


def test_a_machine_of_two_axes_has_one_node_for_the_third():
    lathe = replace(MACHINE, axes=tuple(a for a in MACHINE.axes if a.letter != "Y"), structure="w X' b Z t")
    made = grid(
        "L-VOL", "XZ", ((0.0, 1000.0), (-500.0, 0.0)), [[0, 0, 0], [0.010, 0, 0], [0, 0, 0.004], [0.010, 0, 0.004]]
    )
    wanted = job(NAME, Compensation(("L-VOL",), (), (made,)), machine=lathe)
    files = {f.name: f.content for f in HAL.write(wanted).files}
    assert numbers(files["l_vol.grid"])[5:12] == [
        "nodes X 2 0 1000",
        "nodes Y 1 0",
        "nodes Z 2 -500 0",
        "values 4",
        "0.000000000 0.000000000 0.000000000",
        "0.000000000 0.000000000 -0.004000000",
        "-0.010000000 0.000000000 0.000000000",
    ]
    assert "joint.1.pos-cmd => volid-l-vol.pos-z" in files["volid_grid.hal"] and "-y" not in files["volid_grid.hal"]
    again = read(files, lathe).grids[0]
    assert again.axes == ("X", "Z")
    np.testing.assert_allclose(again.values, made.values, atol=1e-9)
    with pytest.raises(
        InputError, match=r"l_vol.grid: 2 nodes of Y, and machine '.*' has no axis Y; expected one node"
    ):
        read(written(NAME, spatial()), lathe)


def test_types_are_instances_of_their_own_in_a_chain():
    first = grid("L-POS", "XYZ", ((0, 1000), (0, 600), (-500, 0)), np.tile([0.010, 0, 0], (8, 1)))
    second = grid("L-SQU", "XYZ", ((0, 1000), (0, 600), (-500, 0)), np.tile([0.002, 0, 0], (8, 1)))
    files = written(NAME, Compensation(("L-POS", "L-SQU"), (), (first, second)))
    assert set(files) == {"l_pos.grid", "l_squ.grid", "volid_grid.hal"}
    lines = files["volid_grid.hal"].splitlines()
    assert "loadrt volid_grid names=volid-l-pos,volid-l-squ files=l_pos.grid,l_squ.grid" in lines
    assert "net volid-l-pos-x volid-l-pos.d-x => volid-l-squ.more-x" in lines
    assert "net volid-x-motor volid-l-squ.motor-x" in lines
    q = MACHINE.order(X=300.0, Y=200.0, Z=-100.0)[None]
    step = read(files).control(MACHINE).command(q, TOOL) - q
    assert step[0, MACHINE.index("X")] == pytest.approx(-0.012, abs=1e-9)


@pytest.mark.parametrize(
    ("types", "left"),
    [(["L-VOL"], 0.08), (["L-POS", "L-STR", "L-SQU", "L-ANG"], 0.08), (["L-POS", "L-SQU"], 0.7), (["L-POS"], 0.9)],
)
def test_each_type_leaves_what_was_forecast(known, types, left):
    """A fitted machine: the files, read and added apart from volid, against the exact chain; `left`: rough share of the error."""
    at, tool = places(200), volid.compensation_base(known.solution, TOOL)
    made = export(known.solution, NAME, types, base=tool, sampling=Sampling(step=STEP))
    added = sum(corrections(f.content)(at) for f in made.written.files if f.name.endswith(".grid"))
    before, after = (rms(known.without_motion(known.off(at, at + d), at)) for d in (0.0, added))
    where = Places(known.ordered(at), np.zeros_like(at))
    given = {"places": where, "grids": Sampling(step=STEP), "form": "grid", "repeatability": 0.0}
    forecast = volid.forecast(known.solution, [types], tool, **given)
    assert after / before == pytest.approx(left, rel=0.25)
    # the noise of one campaign: 0.36 µm of fit beside what interpolation or other types leave
    assert after == pytest.approx(forecast.columns[1].predictions[0].value[2], rel=0.15)


def test_two_grids_of_one_type_have_names_of_their_own():
    files = written(NAME, Compensation(("L-VOL",), (), (*spatial().grids, *spatial().grids)))
    assert set(files) == {"l_vol.grid", "l_vol_2.grid", "volid_grid.hal"}
    assert "loadrt volid_grid names=volid-l-vol,volid-l-vol-2 files=l_vol.grid,l_vol_2.grid" in files["volid_grid.hal"]
    q = MACHINE.order(X=500.0, Y=0.0, Z=0.0)[None]
    assert (read(files).control(MACHINE).command(q, TOOL) - q)[0, MACHINE.index("X")] == pytest.approx(-0.010, abs=1e-9)


def test_no_name_of_a_machine_becomes_a_number_of_the_grid():
    odd = replace(MACHINE, name="mill\nend\r# 7 \x1b[2J")
    text = HAL.write(job(NAME, spatial(), machine=odd)).files[0].content
    assert numbers(text) == numbers(written(NAME, spatial())["l_vol.grid"]) and "\x1b" not in text


def test_joints_are_those_of_the_coordinates():
    hal = written(NAME, spatial(), coordinates="ZXY")["volid_grid.hal"]
    assert "net volid-z-asked joint.0.motor-pos-cmd => volid-l-vol.motor-in-z" in hal
    assert "net volid-y-feedback volid-l-vol.fb-y => joint.2.motor-pos-fb" in hal
    with pytest.raises(InputError, match="option coordinates is 'XZ' and has no Y; the grid moves X, Y, Z"):
        written(NAME, spatial(), coordinates="XZ")
    with pytest.raises(
        InputError, match=r"option coordinates is 'XYYZ'; expected the letter of each joint .* each once"
    ):
        written(NAME, spatial(), coordinates="XYYZ")


def test_headroom_is_that_of_the_largest_correction():
    """X: 10 µm over 1000 mm of X; Y: 5 µm over 500 mm of Z; Z: 2 µm everywhere."""
    found = {name: value for name, value, _ in HAL.write(job(NAME, spatial())).parameters}
    assert found["[JOINT_0] travel of the drive"] == "limits ± 0.0100 mm"
    assert found["[JOINT_0] STEPGEN_MAXVEL or that of the drive"] == "MAX_VELOCITY × 1.000010"
    assert found["[JOINT_1] STEPGEN_MAXVEL or that of the drive"] == "MAX_VELOCITY × 1.000010"
    assert found["[JOINT_2] STEPGEN_MAXVEL or that of the drive"] == "MAX_VELOCITY × 1.000000"


def test_comments_and_lines_are_free():
    text = written(NAME, spatial())["l_vol.grid"]
    other = "\n".join(numbers(text)).replace(" ", "\t # a remark\r\n", 40).replace("\n", "\n\n")
    np.testing.assert_array_equal(read_grid("a", other).values, read_grid("a", text).values)
    assert HAL.recognises("some.txt", text) and not HAL.recognises("some.txt", "# " + text)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("type L-VOL", "type R-VOL", "l_vol.grid, line 4: found 'R-VOL', expected 'L-VOL' or"),
        ("values 12", "values 11", "line 11: found '11', expected 12 nodes, 3 × 2 × 2"),
        (
            "nodes X 3 0 500 1000",
            "nodes X 3 0 500 500",
            "line 8: found '500', expected nodes of X that rise: after 500",
        ),
        ("unit mm", "unit µm", "line 6: found 'µm', expected 'mm' or 'inch'"),
        ("\nend", "", "the file ends, expected 'end'"),
    ],
)
def test_damage_is_named_with_file_and_line(old, new, message):
    text = written(NAME, spatial())["l_vol.grid"]
    assert old in text
    with pytest.raises(InputError) as caught:
        read({"l_vol.grid": text.replace(old, new)})
    assert message in str(caught.value) and "l_vol.grid, line" in str(caught.value)


def test_what_it_cannot_hold_is_refused():
    with pytest.raises(InputError, match="linuxcnc-hal: EXX, EYY: no grid over X, Y, Z"):
        HAL.write(job(NAME, pitch()))
    blank = spatial()
    blank.grids[0].values[3, 1] = np.nan
    with pytest.raises(
        InputError,
        match=r"L-VOL with the tool vector .* is not determined at 1 of 12 nodes, the first at X = 0, Y = 600",
    ):
        HAL.write(job(NAME, blank))
    trunnion = volid.load_machine("models/wCAYXbZt_trunnion.toml")
    solution = made_up(trunnion)
    with pytest.raises(InputError, match="`type=R-VOL`: linuxcnc-hal cannot carry R-VOL: a grid in HAL moves X, Y, Z"):
        export(solution, NAME, ["R-VOL"])


def test_more_nodes_than_the_component_holds_are_refused(monkeypatch):
    monkeypatch.setattr("volid.controllers.linuxcnc.hal_grid.MOST", 11)
    with pytest.raises(
        InputError, match=r"linuxcnc-hal: L-VOL has 12 nodes; the component holds 11\. Take a larger `step`"
    ):
        HAL.write(job(NAME, spatial()))


def test_linear_axes_that_turn_with_a_table_are_refused():
    """A grid over X that stands on the rotary table: its corrections would have to turn."""
    carried = volid.load_machine("models/wCAYXbZt_trunnion.toml")
    order = {a.letter: a for a in carried.axes}
    turned = replace(carried, axes=tuple(order[a] for a in "YCAXZ"), structure="w Y' C' A' X' b Z t")
    made = grid("L-VOL", "XYZ", ((-300, 300), (-300, 300), (0, 550)), np.zeros((8, 3)))
    with pytest.raises(InputError, match="Y of 'w Y' C' A' X' b Z t' turn with a rotary axis"):
        HAL.write(job(NAME, Compensation(("L-VOL",), (), (made,)), machine=turned))


def test_nothing_but_the_default_types_that_go_together():
    made = export(made_up(MACHINE), NAME)
    assert made.types == ("L-VOL",) and [f.name for f in made.written.files] == ["l_vol.grid", "volid_grid.hal"]
