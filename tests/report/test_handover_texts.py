"""Every text of workbook and certificate that the code asks for is in the table, with the same values in both languages."""

import re

import pytest
from support.dcc_schema import ASKED
from support.places import SOURCE

from volid.fitting.diagnosis import adequacy
from volid.plausibility.record import FURTHER, ITEMS
from volid.report.certificate.statements import IN_PLACE
from volid.report.language import table

ROOMS = {"workbook": r'texts\(f?"workbook\.([a-z_]\w*)"', "certificate": r'add_texts\([^"]*"\w+", "([a-z]\w*)"'}
GRADES = [grade.replace(", ", "_").replace(" ", "_") for grade in adequacy.GRADES]
MADE = {  # keys that the code puts together
    "workbook": [f"grade_{g}" for g in GRADES]
    + [f"recorded_{name}" for name in (*ITEMS, *FURTHER, "other")]
    + [f"V_{d}" for d in "XYZABC"]
    + ["largest", "rms", "free_max", "free_rms", "after_max", "after_rms", "measured_log", "measured_column"],
    "certificate": [f"grade_{g}{part}" for g in GRADES for part in ("", "_name")]
    + [f"recorded_{name}" for name in (*ITEMS, "other")]
    + [f"volume_V_{d}" for d in "XYZABC"]
    + ["volume_largest", "volume_rms", "measured_log", "measured_column", "rule_simple", "rule_guard_band"]
    + [f"missing_{key}" for key in ASKED]
    + [f"in_place_{key}" for key in IN_PLACE],
}


def asked(room):
    """Keys that stand whole in the code of a room, and those that it puts together."""
    files = sorted((SOURCE / "volid" / "report" / room).glob("*.py"))
    found = {key for file in files for key in re.findall(ROOMS[room], file.read_text(encoding="utf-8"))}
    return {key for key in found if not key.endswith("_")} | set(MADE[room])


@pytest.mark.parametrize("room", ROOMS)
def test_every_text_is_there(room):
    keys = asked(room)
    assert len(keys) > 40
    assert {key for key in keys if f"{room}.{key}" not in table()} == set()


@pytest.mark.parametrize("room", ROOMS)
def test_both_languages_say_the_same_values(room):
    texts = {key: words for key, words in table().items() if key.startswith(f"{room}.")}
    for key, words in texts.items():
        assert words["en"].strip() and words["de"].strip(), key
        values = [set(re.findall(r"{(\w+)", words[language])) for language in ("en", "de")]
        assert values[0] == values[1], key


def test_names_of_sheets_are_legal():
    for key, words in table().items():
        if key.startswith("workbook.sheet_"):
            assert all(len(name) <= 28 and not set(name) & set("[]:*?/\\'") for name in words.values()), key
