"""Machine files: what a good one gives, and what each bad one is told."""

import numpy as np
import pytest
from support.campaign_files import MACHINE

from volid.exceptions import InputError
from volid.io import format_machine, parse_machine, read_machine
from volid.model.error_functions import location_names
from volid.model.machine import Axis, FunctionSettings, Machine

FIVE_AXIS = """\
format = "volid-machine/1"
name = "Table-table"
structure = "w C' A' Y' b X Z (S) t"
[axis.X]
travel = [-300, 300]
reference = 10
[axis.Y]
travel = [0, 400]
[axis.Z]
travel = [-500, 0]
error_point = [0, 0, 250]
[axis.A]
travel = [-120, 30]
point = [0, 200, -400]
[axis.C]
travel = [-360, 360]
point = [0, 200, -450]
direction = [0, 0, -2]
axis_frame = "machine"
"""


def parsed(*changes: tuple[str, str], text: str = MACHINE) -> Machine:
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    return parse_machine(text, "machine.toml")


def with_model(lines: str) -> Machine:
    return parse_machine(MACHINE + lines, "machine.toml")


def test_defaults_of_linear_axes_and_datum():
    machine = parsed()
    assert machine.letters == ("X", "Y", "Z")
    assert [axis.reference for axis in machine.axes] == [500.0, 300.0, -250.0]
    assert machine.axis("Y").travel == (0.0, 600.0)
    assert machine.axis("Z").direction == (0.0, 0.0, 1.0)
    assert machine.axis("X").error_point == (0.0, 0.0, 0.0)
    assert (machine.datum.primary, machine.datum.secondary, machine.datum.line) == ("X", "Y", "least_squares")
    assert (machine.model.degree, machine.model.segments, dict(machine.model.functions)) == (3, "auto", {})
    assert machine.text == MACHINE


def test_rotary_axes():
    machine = parsed(text=FIVE_AXIS)
    assert machine.letters == ("C", "A", "Y", "X", "Z")
    assert [axis.primed for axis in machine.axes] == [True, True, True, False, False]
    assert machine.axis("C").direction == (0.0, 0.0, -1.0)
    assert machine.axis("A").direction == (1.0, 0.0, 0.0)
    assert machine.axis("C").error_point == machine.axis("C").point == (0.0, 200.0, -450.0)
    assert (machine.axis("C").reference, machine.axis("X").reference) == (0.0, 10.0)
    assert machine.axis("Z").error_point == (0.0, 0.0, 250.0)


def test_axis_frame_is_read_and_written():
    machine = parsed(("[0, 0, -2]", "[0, 1, 1]"), ('"machine"\n', '"axis"\n'), text=FIVE_AXIS)
    axis = machine.axis("C")
    assert axis.axis_frame and not machine.axis("A").axis_frame
    half = np.sqrt(0.5)
    np.testing.assert_allclose(axis.frame, [[1, 0, 0], [0, half, half], [0, -half, half]], atol=1e-15)
    bare = Machine(machine.name, machine.structure, machine.axes, machine.datum, machine.model)
    assert parse_machine(format_machine(bare), "again.toml").axes == machine.axes


def test_parallel_axes_with_another_between_them_are_told_apart():
    text = FIVE_AXIS.replace("w C' A' Y' b X Z (S) t", "w C' Y' b X Z A (S) t").replace("[0, 0, -2]", "[1, 0, 0]")
    assert parse_machine(text, "machine.toml").axis("C").unit_vector == (1.0, 0.0, 0.0)


def test_a_rotary_axis_made_by_hand_turns_its_errors_about_its_point():
    assert Axis("A", False, (-90.0, 90.0), 0.0, point=(1.0, 2.0, 3.0)).error_point == (1.0, 2.0, 3.0)
    assert Axis("X", False, (0.0, 90.0), 45.0).error_point == (0.0, 0.0, 0.0)


def test_the_zero_of_a_rotary_axis_is_a_location_error_only_when_asked_for():
    usual = ("EX0C", "EY0C", "EA0C", "EB0C")
    for lines, names in (("", usual), ("EC0C = true", (*usual, "EC0C")), ("EX0C = false", usual[1:])):
        machine = parse_machine(FIVE_AXIS + f"[model.functions]\n{lines}\n", "machine.toml")
        assert [n for n in location_names(machine) if n.endswith("C")] == list(names)


@pytest.mark.parametrize(
    ("structure", "missing", "datum"),
    [("w X' b Z t", "[axis.Y]\ntravel = [0.0, 600.0]\n", ("X", "Z")), ("w b Z Y t", None, ("Y", "Z"))],
)
def test_datum_without_x_or_y(structure, missing, datum):
    removed = missing or "[axis.X]\ntravel = [0.0, 1000.0]\n"
    machine = parsed(("w b X Y Z t", structure), (removed, ""))
    assert (machine.datum.primary, machine.datum.secondary) == datum


def test_datum_as_stated():
    datum = with_model('[datum]\nprimary = "Y"\nline = "end_point"\n').datum
    assert (datum.primary, datum.secondary, datum.line) == ("Y", "X", "end_point")


def test_model_functions():
    machine = with_model(
        """
[model]
degree = 2
segments = 12
[model.functions]
EXX = { segments = 20, reversal = true, degree = 1 }
EYY = { reversal = "constant", segments = "auto" }
EAZ = { over = ["Z", "X"], segments = [6, 4] }
EC0Y = false
ECZ = false
EAX = "constant"
"E*Y" = true
"E[ABC]*" = { segments = 6 }
"""
    )
    assert (machine.model.degree, machine.model.segments) == (2, 12)
    assert dict(machine.model.functions) == {
        "EXX": FunctionSettings(segments=20, reversal=True, degree=1),
        "EYY": FunctionSettings(segments="auto", reversal="constant"),
        "EAZ": FunctionSettings(segments=(6, 4), over=("Z", "X")),
        "EC0Y": FunctionSettings(use=False),
        "ECZ": FunctionSettings(use=False),
        "EAX": FunctionSettings(use="constant"),
        "E*Y": FunctionSettings(use=True),
        "E[ABC]*": FunctionSettings(segments=6),
    }
    assert list(machine.model.functions)[-1] == "E[ABC]*"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "volid-machine/1",
            "volid-machine/2",
            r"machine\.toml: format is 'volid-machine/2'; this volid reads 'volid-mac",
        ),
        ('format = "volid-machine/1"', "", r"machine\.toml: key 'format' is missing"),
        ('name = "Test machine"', "", r"key 'name' is missing"),
        ("structure =", "structur =", r"unknown key 'structur'; did you mean 'structure'\?"),
        ("w b X Y Z t", "w b X Y U t", r"machine\.toml: structure: 'U' in .* is no axis"),
        ("w b X Y Z t", "w b X Y Z B t", r"table \[axis\.B\] is missing; the structure .* has axis B"),
        ("w b X Y Z t", "w b X Y t", r"\[axis\.Z\] is not in the structure .*; its axes are X, Y"),
        ("[axis.Y]\ntravel", "[axis.Y]\ntravle", r"\[axis\.Y\]: unknown key 'travle'; did you mean 'travel'\?"),
        ("travel = [0.0, 600.0]", "", r"\[axis\.Y\]: key 'travel' is missing"),
        ("[0.0, 600.0]", "[600.0, 0.0]", r"\[axis\.Y\]: travel is \[600\.0, 0\.0\]; expected two increasing"),
        ("[0.0, 600.0]", "[0.0, inf]", r"travel is \[0\.0, inf\]; expected a list of 2 finite numbers"),
        ("[0.0, 600.0]", '[0.0, "600"]', r"travel is .*expected a list of 2 finite numbers"),
        ("[0.0, 600.0]", "[0.0, 600.0]\nreference = 700", r"reference is 700; expected a position within the travel 0"),
        ("[0.0, 600.0]", "[0.0, 600.0]\nreference = nan", r"reference is nan; expected a finite number"),
        ("[0.0, 600.0]", "[0.0, 600.0]\nerror_point = [0, 1]", r"error_point is \[0, 1\]; expected a list of 3"),
        ("[0.0, 600.0]", "[0.0, 600.0]\npoint = [0, 1, 2]", r"point is for rotary axes; Y is linear"),
        ("[0.0, 600.0]", "[0.0 600.0]", r"machine\.toml, line 8: not valid TOML: .*, column"),
    ],
)
def test_bad_machine(old, new, message):
    with pytest.raises(InputError, match=message):
        parsed((old, new))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "point = [0, 200, -400]\n",
            "",
            r"\[axis\.A\]: key 'point' is missing; a rotary axis needs a point on its nominal",
        ),
        (
            "[-120, 30]",
            "[10, 30]",
            r"\[axis\.A\]: reference is 0 by default; expected a position within the travel 10 … 30",
        ),
        ("[0, 0, -2]", "[0, 0, 0]", r"\[axis\.C\]: direction is \[0, 0, 0\]; expected a vector other than zero"),
        ('"machine"\n', '"table"\n', r'axis_frame is "table"; expected one of "machine", "axis"'),
        (
            "[0, 0, -2]",
            "[1, 0, 0.0001]",
            r"\[axis\.A\]: direction \[1, 0, 0\] is parallel to that of axis C and no axis lies",
        ),
    ],
)
def test_bad_rotary_axis(old, new, message):
    with pytest.raises(InputError, match=message):
        parsed((old, new), text=FIVE_AXIS)


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ('[datum]\nprimary = "A"', r'\[datum\]: primary is "A"; expected one of "X", "Y", "Z"'),
        ('[datum]\nprimary = "Y"\nsecondary = "Y"', r'secondary is "Y"; expected another linear axis'),
        ('[datum]\nsecundary = "Y"', r"\[datum\]: unknown key 'secundary'; did you mean 'secondary'\?"),
        ('[datum]\nline = "mean"', r'line is "mean"; expected one of "least_squares", "end_point"'),
        ("[model]\ndegree = 0", r"\[model\]: degree is 0; expected a whole number from 1 to 5"),
        ("[model]\ndegree = true", r"degree is true; expected a whole number"),
        ("[model]\nsegments = 0", r'segments is 0; expected "auto" or a whole number >= 1'),
        ("[model]\nsegments = [3, 3]", r'segments is \[3, 3\]; expected "auto" or a whole number >= 1$'),
        ("[model]\nsegment = 4", r"unknown key 'segment'; did you mean 'segments'\?"),
        (
            "[model.functions]\nEXC = true",
            r"'EXC' is no error of this machine; did you mean .*expected an ISO 230-1 symbol",
        ),
        ("[model.functions]\nEX0Y = true", r"'EX0Y' is no error of this machine"),
        ("[model.functions]\nEXXX = true", r"'EXXX' is no error of this machine; did you mean 'EXX'\?"),
        ('[model.functions]\n"E*B" = true', r"pattern 'E\*B' matches no error of this machine"),
        ("[model.functions]\nEXX = 3", r"EXX is 3; expected true, false, \"constant\" or \{"),
        ('[model.functions]\nEXX = "const"', r"EXX is \"const\"; expected true, false"),
        ("[model.functions]\nEC0Y = { segments = 3 }", r"EC0Y is a constant; expected true or false"),
        ("[model.functions]\nEXX = { segmens = 3 }", r"EXX: unknown key 'segmens'; did you mean 'segments'\?"),
        (
            '[model.functions]\nEXX = { reversal = "yes" }',
            r"EXX: reversal is \"yes\"; expected true, false or \"constant\"",
        ),
        ('[model.functions]\nEAZ = { over = ["Z"] }', r"EAZ: over is \[\"Z\"\]; expected two different axes"),
        ('[model.functions]\nEAZ = { over = ["Z", "C"] }', r"over is .*expected two different axes of this machine"),
        ('[model.functions]\nEAZ = { over = ["X", "Y"] }', r"over is .*expected the function's own axis Z first"),
        (
            "[model.functions]\nEAZ = { segments = [6, 4] }",
            r"segments is \[6, 4\]; expected \"auto\" or a whole number >= 1$",
        ),
    ],
)
def test_bad_datum_and_model(lines, message):
    with pytest.raises(InputError, match=message):
        with_model(lines)


def test_file_is_read_and_byte_order_mark_and_windows_line_ends_are_no_matter(tmp_path):
    (tmp_path / "m.toml").write_bytes(b"\xef\xbb\xbf" + MACHINE.replace("\n", "\r\n").encode())
    assert read_machine(tmp_path / "m.toml") == parsed()


def test_missing_file_and_wrong_encoding_are_named(tmp_path):
    with pytest.raises(InputError, match=r"none\.toml: there is no such file"):
        read_machine(tmp_path / "none.toml")
    (tmp_path / "m.toml").write_bytes(MACHINE.replace("Test machine", "Fräsmaschine").encode("latin-1"))
    with pytest.raises(InputError, match=r"m\.toml, line 2: byte 0xe4 is not UTF-8 text"):
        read_machine(tmp_path / "m.toml")
    with pytest.raises(InputError, match=r"cannot be read"):
        read_machine(tmp_path)


@pytest.mark.parametrize(
    "text", [MACHINE, FIVE_AXIS, MACHINE + '[model.functions]\nEAZ = { over = ["Z", "X"] }\nEXX = false\n']
)
def test_a_machine_without_text_can_be_written(text):
    machine = parse_machine(text, "machine.toml")
    bare = Machine(machine.name, machine.structure, machine.axes, machine.datum, machine.model)
    again = parse_machine(format_machine(bare), "again.toml")
    assert (again.axes, again.datum, again.model) == (machine.axes, machine.datum, machine.model)
    assert format_machine(machine) == text


def test_a_text_that_no_longer_describes_the_machine_is_not_written():
    machine = parsed()
    changed = Machine("Other name", machine.structure, machine.axes, machine.datum, machine.model, machine.text)
    assert parse_machine(format_machine(changed), "again.toml").name == "Other name"
