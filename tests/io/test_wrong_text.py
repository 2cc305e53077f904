"""Wrong text files: what is said names the cause, not what the parser stumbled over."""

import pytest
from support.campaign_files import MANIFEST, write_files
from support.mutated_text import originals, trial

import volid
from volid.exceptions import InputError
from volid.io.basics.toml_table import Table

WRONG = {
    'machine = "machine.toml"\nmachine = "b.toml"': (
        'machine = "machine.toml"',
        "line 3: .*'machine' stands twice, keep one",
    ),
    "[station]": ("[[station]]", r"'station' stands twice; where there may be several, head each with \[\[station\]\]"),
    'file = "data\\volume.csv"': ('file = "volume.csv"', "a path in quotes has / between its folders"),
    "file = volume.csv": ('file = "volume.csv"', "put a text in quotes"),
    "title = “Acceptance”": ('title = "Acceptance"', r"'“' \(U\+201C, left double quotation mark\) is no TOML"),
    "title\u00a0= ": ("title = ", r"U\+00A0, no-break space"),
    "constant = 0,0003": ("constant = 0.0003", "numbers have decimal points"),
    "position = [-150,0, 80,0, -700,0]": ("position = [-150.0, 80.0, -700.0]", "3 finite numbers, with decimal points"),
    "known = True": ("known = true", "write true or false in small letters"),
    'machine = "volume.csv"': ('machine = "machine.toml"', "machine is .*; expected a machine file"),
    'file = "machine.toml"': ('file = "volume.csv"', "file is .*; expected a table"),
    'file = "."': ('file = "volume.csv"', "it is a folder; name a file in it"),
}


@pytest.mark.parametrize("new", WRONG)
def test_the_cause_is_named(new, tmp_path):
    old, message = WRONG[new]
    path = write_files(tmp_path, manifest=MANIFEST.replace(old, new, 1))
    assert path.read_text() != MANIFEST
    with pytest.raises(InputError, match=message):
        volid.load_campaign(path)


@pytest.mark.parametrize(
    ("data", "what"), [(b"\x89HDF\r\n\x1a\n", "an HDF5 file"), (b"PK\x03\x04", "a workbook"), (b"%PDF-1.7", "a PDF")]
)
def test_what_is_no_text_is_named(data, what, tmp_path):
    (tmp_path / "m.toml").write_bytes(data + b"\x00" * 100)
    with pytest.raises(InputError, match=f"m.toml: this is {what}"):
        volid.load_machine(tmp_path / "m.toml")


def test_one_campaign_given_twice(tmp_path):
    path = write_files(tmp_path)
    with pytest.raises(InputError, match="is given twice; name every campaign once"):
        volid.load_campaign(path, tmp_path / "." / "campaign.toml")


def test_a_good_hint_is_no_guess():
    """A word that is merely alike is not offered."""
    with pytest.raises(InputError, match="unknown key 'titel'; did you mean 'title'"):
        Table({"titel": 1}, "x").only(["title", "machine"])
    with pytest.raises(InputError) as error:
        Table({"laser": 1}, "x").only(["polar", "distance"])
    assert "did you mean" not in str(error.value)


# ------------------------------------------------------------------------------------------------- damaged at random


@pytest.fixture(scope="module", params=list(originals()))
def original(request):
    return originals()[request.param]


def test_every_sound_file_is_read(original, tmp_path):
    for name, data in original.files.items():
        (tmp_path / name).write_bytes(data)
    original.read(tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("first", range(0, 600, 100))
def test_damage_leads_to_a_message_and_to_nothing_else(first):
    """A hundred files at a time; `benchmarks/mutated_text.py` does the same with any number."""
    outcomes = [trial(number) for number in range(first, first + 100)]
    assert [o for o in outcomes if o.fault] == []
    assert {o.result for o in outcomes} >= {"read", "InputError"}
