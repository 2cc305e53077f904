"""Cases of text files and of what is written as text: right values, or one message that names file and row."""

import csv
import json
import shutil
from pathlib import Path

import pytest
from support.places import ROOT

import volid
from volid.cli import main
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
        (7, 2, '"' + "9" * 200_000, r"m3\.csv, row 7: a cell of 200001 characters; expected cells of at most 131072"),
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
        (U, "u = 1e300", r"set 'Volumen': u is 1e\+300; expected a number of at most"),
        (U, "u = { proportional = 1e-30 }", r"row 2: u is .*e-28; expected a standard uncertainty of at least 1e-15"),
        (
            STATION,
            f"{STATION}\nposition = [0, 1e300, 0]",
            r"station 'Platz 2': position is .*; expected numbers of at most",
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


# ---------------------------------------------------------------------------- 12: positions without binary noise


@pytest.fixture(scope="module")
def solution(tmp_path_factory):
    path = tmp_path_factory.mktemp("12") / "s.h5"
    volid.save_solution(volid.fit(volid.load_campaign(ROOT / "datasets/published_positioning/campaign.toml")), path)
    return path


def column(text, name):
    """One column of a CSV text below its record, as text."""
    return [row[name] for row in csv.DictReader(line for line in text.splitlines() if not line.startswith("#"))]


def digits_behind_the_point(cell):
    return len(cell.partition(".")[2])


@pytest.mark.parametrize("step", ["25.4", "12.7", "0.3", "33.3333333333", "7.1"])
def test_positions_of_every_writer_are_round(solution, tmp_path, capsys, step):
    """Right: i * step printed to 1e-6 mm, the ends as they are."""
    wanted = [
        str(p) for p in dict.fromkeys([*(round(float(step) * i, 6) for i in range(int(500 / float(step)) + 1)), 500.0])
    ]
    main(["tables", str(solution), "--type", "L-POS", "--step", step, "-o", str(tmp_path / "t")])
    assert column((tmp_path / "t" / "EXX.csv").read_text(), "X") == wanted
    main(["functions", str(solution), "--step", step, "-o", str(tmp_path / "f.csv")])
    found = (tmp_path / "f.csv").read_text()
    rows = [p for p, n in zip(column(found, "position"), column(found, "function"), strict=True) if n == "EXX"]
    assert rows[: len(wanted)] == wanted
    capsys.readouterr()
    main(["tables", str(solution), "--type", "L-POS", "--step", step, "-o", str(tmp_path / "j"), "--json"])
    tables = json.loads(capsys.readouterr().out)["tables"]
    assert [repr(row[0]) for t in tables if t["columns"][0] == "X" for row in t["rows"]] == wanted


def test_positions_of_grids_are_round(tmp_path, capsys):
    campaign = ROOT / "datasets/five_axis_rtest/campaign.toml"
    volid.save_solution(volid.fit(volid.load_campaign(campaign)), tmp_path / "s.h5")
    main(["grid", str(tmp_path / "s.h5"), "--type", "R-VOL", "--points", "7", "-o", str(tmp_path / "g.csv")])
    text = (tmp_path / "g.csv").read_text()
    for axis in "AC":
        cells = column(text, axis)
        assert len(set(cells)) == 7 and max(map(digits_behind_the_point, cells)) <= 6
    main(["budget", str(tmp_path / "s.h5"), "-o", str(tmp_path / "b.csv")])
    assert max(map(digits_behind_the_point, column((tmp_path / "b.csv").read_text(), "position"))) <= 6


# ------------------------------------------------------------------- what a command reads, before the work begins


@pytest.mark.parametrize(
    ("points", "message"),
    [(None, "there is no such file"), ("X,Y\n1,2\n", "column 'Z' is missing"), ("X;Y;Z\n1;2;x\n", "column 'tool_x' is missing")],
)  # fmt: skip
def test_a_budget_reads_its_points_first(solution, tmp_path, capsys, monkeypatch, points, message):
    path = tmp_path / "points.csv"
    if points is not None:
        path.write_text(points)
    monkeypatch.setattr(
        "volid.uncertainty.budget.budget", lambda _: pytest.fail("the work began before the file was read")
    )
    assert main(["budget", str(solution), "--at", str(path)]) == 2
    assert message in capsys.readouterr().err
