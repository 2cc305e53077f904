"""Cases of text files and of what is written as text: right values, or one message that names file and row."""

import shutil
from pathlib import Path

import pytest

import volid
from volid.exceptions import InputError

CASES = Path(__file__).parent


@pytest.mark.parametrize(
    ("case", "manifest", "message"),
    [
        ("25_unclosed_quote", "c.toml", r"m3\.csv, row 12: a quote is opened and not closed; close it, or remove it"),
        (
            "26_reading_of_1e300",
            "c.toml",
            r"m3\.csv, row 5: distance is 1e300; expected at most 1e\+09 mm, more than anything that is measured",
        ),
        (
            "27_two_names_for_one_header",
            "campaign.toml",
            r"set 'Volumen': columns gives 'Soll X \[mm\]' of .*m3\.csv two names, X and Y; expected one column for each",
        ),
    ],
)
def test_case_is_named(case, manifest, message):
    with pytest.raises(InputError, match=message):
        volid.load_campaign(CASES / case / manifest)


def copied(tmp_path, case, edit, name="m3.csv"):
    """The manifest of a copy of a case, with one of its files edited as text."""
    folder = shutil.copytree(CASES / case, tmp_path / case)
    text = (folder / name).read_text(encoding="utf-8-sig")
    assert edit(text) != text
    (folder / name).write_text(edit(text), encoding="utf-8")
    return next(folder.glob("c*.toml"))


def changed(row, column, cell):
    """One cell of one line changed, both from 1."""

    def edit(text):
        lines = text.split("\n")
        cells = lines[row - 1].split(",")
        cells[column - 1] = cell
        lines[row - 1] = ",".join(cells)
        return "\n".join(lines)

    return edit


@pytest.mark.parametrize(
    ("row", "column", "cell", "message"),
    [
        (7, 2, '"Platz 1', r"m3\.csv, row 7: a quote is opened and not closed"),
        (7, 2, '"' + "9" * 200_000, r"m3\.csv, row 7: \d+ characters in one line; expected cells of at most 131072"),
        (7, 10, "-1e12", r"m3\.csv, row 7: distance is -1e12; expected at most 1e\+09 mm"),
        (7, 4, "1e308", r"m3\.csv, row 7: Y is 1e308; expected at most"),
        (7, 9, "-1e30", r"m3\.csv, row 7: tool_z is -1e30; expected at most"),
        (7, 10, "7" * 500, r"m3\.csv, row 7: distance is '7{79}…'; expected a finite number in mm"),
        (7, 10, "\x1b[31m", r"m3\.csv, line 7: byte 0x1b stands in no text"),
    ],
)
def test_kind_of_25_and_26(tmp_path, row, column, cell, message):
    sound = (CASES / "26_reading_of_1e300" / "m3.csv").read_text().replace("1e300", "1432.10737")
    path = copied(tmp_path, "26_reading_of_1e300", lambda _: changed(row, column, cell)(sound))
    with pytest.raises(InputError, match=message) as found:
        volid.load_campaign(path)
    assert len(str(found.value)) < 600


def test_the_sound_file_is_read(tmp_path):
    path = copied(tmp_path, "26_reading_of_1e300", lambda text: text.replace("1e300", "1432.10737"))
    campaign = volid.load_campaign(path)
    assert campaign.warnings == () and len(campaign.stations) == 6


U = "u = { constant = 0.0003, proportional = 3e-7 }"
STATION = 'name = "Platz 2"'


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (U, "u = 1e300", r"m3\.csv, row 2: u is 1e\+300; expected at most"),
        (U, "u = { proportional = 1e-30 }", r"row 2: u is .*e-28; expected a standard uncertainty of at least 1e-15"),
        (
            STATION,
            f"{STATION}\nposition = [0, 1e300, 0]",
            r"station 'Platz 2': position is .*; expected at most 1e\+09",
        ),
        ('ignore = ["Nr"]', 'ignore = ["Nr", "WZ X"]', r"'WZ X' stands under columns and under ignore; keep one"),
    ],
)
def test_kind_in_manifests(tmp_path, old, new, message):
    shutil.copytree(CASES / "26_reading_of_1e300", tmp_path / "a")
    file = tmp_path / "a" / "m3.csv"
    file.write_text(file.read_text().replace("1e300", "1432.10737"))
    manifest = tmp_path / "a" / "c.toml"
    assert old in manifest.read_text()
    manifest.write_text(manifest.read_text().replace(old, new))
    with pytest.raises(InputError, match=message):
        volid.load_campaign(manifest)
