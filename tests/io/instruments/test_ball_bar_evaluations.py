"""Evaluated ball-bar tests: shown as what they are, and never made a campaign of."""

import json

import pytest
from support.instrument_files import FEATURES, MEASURED, ball_bar_file
from support.places import MODELS

from volid.exceptions import InputError
from volid.io.campaign.imported import evaluation_of, import_files

MACHINE = MODELS / "wYXbZt_vertical.toml"
BOMB = (
    '<?xml version="1.0"?>\n<!DOCTYPE t [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]>\n'
    '<t><FEATURE NAME="AF_SQUARENESS" DT="UT_SQUARENESS">&b;</FEATURE></t>'
)


def write(folder, text, encoding="utf-8"):
    path = folder / "t.b5r"
    path.write_bytes(text.encode(encoding))
    return path


def test_values_have_the_unit_of_their_type(tmp_path):
    found = evaluation_of(write(tmp_path, ball_bar_file()))
    assert found.rows == [
        ("AF_SQUARENESS", "XY", -12.5, "µm/m", "UT_SQUARENESS"),
        ("AF_SCALE_MISMATCH", "XY", 3.4, "µm", "UT_LENGTH_UM"),
        ("AF_BACKLASH_A_POS", "XY", 1.5, "µm", "UT_LENGTH_UM"),
        ("AF_SERVO_MISMATCH", "XY", 0.02, "ms", "UT_SERVO_MISMATCH"),
    ]
    assert found.header == {
        "values": "the vendor's evaluation, not volid's",
        "machine_tested": "Mill",
        "date_started": "2025-12-18",
    }


def test_unknown_types_and_texts_are_kept_as_they_stand(tmp_path):
    found = evaluation_of(write(tmp_path, ball_bar_file([("AF_NEW", "UT_NEW", "good"), ("AF_B", "UT_ANGLE", "1,5")])))
    assert found.rows == [("AF_NEW", "XY", "good", "", "UT_NEW"), ("AF_B", "XY", 1.5, "degrees", "UT_ANGLE")]


def test_two_planes_are_told_apart_or_left_open(tmp_path):
    one = '<PLANE TEST_PLANE="{}">\n<FEATURE NAME="AF_CIRCULARITY" DT="UT_LENGTH_UM">{}</FEATURE></PLANE>'
    found = evaluation_of(write(tmp_path, f"<T>{one.format('XY', 5)}{one.format('YZ', 7)}</T>"))
    assert [(row[1], row[2]) for row in found.rows] == [("XY", 5.0), ("YZ", 7.0)]
    two = ball_bar_file().replace("<FEATURES>", '<PLANE TEST_PLANE="ZX"/><FEATURES>')
    assert {row[1] for row in evaluation_of(write(tmp_path, two)).rows} == {""}


def test_it_is_no_readings(tmp_path):
    path = write(tmp_path, ball_bar_file())
    with pytest.raises(InputError, match="this is a ball-bar test as the vendor evaluated it, which holds no readings"):
        import_files([path], MACHINE, {"as": "b5r", **MEASURED})


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_a_document_type_declaration_is_refused(encoding, tmp_path):
    text = BOMB.replace('<?xml version="1.0"?>', f'<?xml version="1.0" encoding="{encoding}"?>')
    with pytest.raises(
        InputError, match="row 2: a document type declaration, which can fill the memory; expected XML without"
    ):
        evaluation_of(write(tmp_path, text, encoding))


def test_damaged_xml_is_named_by_its_line(tmp_path):
    text = ball_bar_file().replace("</FEATURE>", "</FEATUR>", 1)
    with pytest.raises(InputError, match="row 7: the XML is damaged: mismatched tag"):
        evaluation_of(write(tmp_path, text))


def test_depth_and_size_cost_nothing(tmp_path):
    deep = "<a>" * 30_000 + "</a>" * 30_000
    path = write(tmp_path, ball_bar_file().replace("<FEATURES>", f"{deep}<FEATURES>"))
    assert len(evaluation_of(path).rows) == len(FEATURES)


def test_the_command_shows_the_table_or_writes_it(run, tmp_path):
    path, output = write(tmp_path, ball_bar_file()), tmp_path / "t.csv"
    status, text, _ = run("import", path)
    assert status == 0
    assert text.startswith("# values: the vendor's evaluation, not volid's\n")
    assert "\nAF_SQUARENESS,XY,-12.5,µm/m,UT_SQUARENESS\n" in text
    assert run("import", path, "-o", output)[0] == 0
    assert output.read_text(encoding="utf-8") == text
    found = json.loads(run("import", path, "--json")[1])
    assert found["rows"][1] == ["AF_SCALE_MISMATCH", "XY", 3.4, "µm", "UT_LENGTH_UM"]
    assert (
        "holds what was evaluated, and no readings; show it without --machine"
        in run("import", path, "--machine", MACHINE)[2]
    )
