"""Text that was made to do harm, or that no person would write: one message, nothing executed, nothing shown raw."""

import csv
import json
import os
import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.campaign_files import MACHINE, MANIFEST, write_files
from support.places import DATASETS

import volid
from volid.cli import main
from volid.exceptions import InputError, OutputError
from volid.io import write_manifest
from volid.io.basics.cells import neutral, original
from volid.io.basics.toml_table import LARGEST_TOML, parse_toml, read_text
from volid.io.basics.toml_values import DEEPEST
from volid.io.machines import MOST_SEGMENTS, parse_machine
from volid.io.table_reader import read_table

HOSTILE = Path(__file__).parent / "hostile"
CONTROL = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f]")


@pytest.fixture
def run(capsys):
    def run(*arguments):
        status = main([str(a) for a in arguments])
        return status, *capsys.readouterr()

    return run


# ------------------------------------------------------------------------------------------------------- the cases

MESSAGES = {
    "5_toml_deep/deep.toml": "deep.toml: nested more than 32 deep",
    "7_nul_station/campaign.toml": r"campaign.toml: station.1.name is 'S1\x00', with the control character U+0000",
    "7_nul_title/campaign.toml": r"campaign.toml: title is 'a\x00b', with the control character U+0000",
    "14_escape/campaign.toml": r"campaign.toml: title is '\x1b]0;PWNED\x07\x1b[2J\x1b[1;31m=cmd|x'",
}


@pytest.mark.parametrize("case", MESSAGES)
def test_a_campaign_is_refused_in_one_line(case, run, tmp_path):
    status, out, err = run("import", HOSTILE / case, "-o", tmp_path / "o.h5")
    assert (status, out) == (2, "")
    assert MESSAGES[case] in err
    assert len(err.splitlines()) == 1
    assert not CONTROL.search(err.rstrip("\n"))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("m400.toml", "axis.X.travel.2 is a whole number of 400 digits"),
        ("m5000.toml", "line 5: a number of thousands of digits"),
    ],
)
def test_whole_numbers_of_hundreds_of_digits(name, message):
    with pytest.raises(InputError, match=re.escape(message)):
        volid.load_machine(HOSTILE / "6_toml_hugeint" / name)


def test_a_table_with_a_damaged_header():
    with pytest.raises(InputError, match="period is 'x'; expected a number"):
        read_table(HOSTILE / "18_table" / "period.csv")


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("period: none,#", "period is 'none,#'"),
        ("period: nan", "period is 'nan'"),
        ("interpolation: linear; largest deviation between the points - mm", "interpolation is 'linear"),
        ("function: X", "period.csv: function: 'X' is not an ISO 230-1 error symbol"),
        ("reversal value: much", "reversal value is 'much'"),
    ],
)
def test_other_damaged_headers(line, message, tmp_path):
    text = (HOSTILE / "18_table" / "period.csv").read_text(encoding="utf-8").replace("# period: x", "# period: none")
    key = line.split(":")[0]
    lines = [old for old in text.splitlines() if not old.startswith(f"# {key}:")]
    (tmp_path / "period.csv").write_text("\n".join([f"# {line}", *lines, ""]), encoding="utf-8")
    with pytest.raises(InputError, match=re.escape(message)):
        read_table(tmp_path / "period.csv")


# -------------------------------------------------------------------------------------------------------- their kind


@pytest.mark.parametrize(
    "text",
    ["a = " + "[" * n + "]" * n for n in (40, 300, 20000)]
    + ["a = " + "{a = " * 200 + "1" + "}" * 200, ".".join("a" * 40) + " = 1", "[" + ".".join("a" * 100_000) + "]"],
)
def test_nesting_of_every_form(text):
    with pytest.raises(InputError, match=f"nested more than {DEEPEST} deep") as error:
        parse_toml(text, "a.toml")
    assert len(str(error.value)) < 300


def test_what_looks_deep_but_is_not():
    row = ", ".join(["0.25"] * 3000)
    text = f"a = [{row}]\n# {'a.' * 1000}\n"
    assert len(parse_toml(text, "a.toml")["a"]) == 3000


@pytest.mark.parametrize("number", ["9223372036854775808", "-9223372036854775809", "0x" + "f" * 4000, "1" * 4400])
def test_whole_numbers_beyond_64_bits(number):
    with pytest.raises(InputError, match=r"a\.toml.* digits; expected less than 19 digits"):
        parse_toml(f"x = 1\na = {number}", "a.toml")
    assert parse_toml("a = 9223372036854775807", "a.toml") == {"a": 2**63 - 1}


NAMES = {
    'name = "S1"': "station.1.name",
    'title = "Acceptance"': "title",
    'name = "volume"': "set.1.name",
    'name = "refraction"': "set.1.effect.1.name",
    'warm_up = "30 min axis cycle"': "conditions.warm_up",
}


@pytest.mark.parametrize("sign", ["0000", "001b", "007f", "009b"])
@pytest.mark.parametrize("line", NAMES)
def test_control_characters_in_every_name(line, sign, tmp_path):
    key = line.split(" = ")[0]
    path = write_files(tmp_path, manifest=MANIFEST.replace(line, f'{key} = "a\\u{sign}b"', 1))
    with pytest.raises(InputError, match=re.escape(f"{NAMES[line]} is 'a\\x{sign[2:]}b'")):
        volid.load_campaign(path)


def test_line_ends_belong_into_titles_and_not_into_names(tmp_path):
    path = write_files(tmp_path, manifest=MANIFEST.replace('"Acceptance"', '"Two\\nlines"'))
    assert volid.load_campaign(path).title == "Two\nlines"
    path = write_files(tmp_path, manifest=MANIFEST.replace('name = "volume"', 'name = "vol\\nume"'))
    with pytest.raises(InputError, match="name is 'vol\nume', with the control character U"):
        volid.load_campaign(path)


def test_keys_too():
    with pytest.raises(InputError, match=r"a key is 'E\\x1b'"):
        parse_machine(MACHINE + '[model.functions]\n"E\\u001b" = false\n', "m.toml")


def test_too_large_a_file(tmp_path):
    path = tmp_path / "machine.toml"
    with path.open("wb") as file:
        file.truncate(LARGEST_TOML + 1)
    with pytest.raises(InputError, match="expected a text file of at most 8 MiB"):
        volid.load_machine(path)


def test_what_never_ends_is_not_read(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", "/dev/zero", "/dev/stdin"):
        with pytest.raises(InputError, match="cannot be read: it is a pipe or device"):
            read_text(path)


def test_segments_beyond_reason():
    for value in (10**9, MOST_SEGMENTS + 1):
        with pytest.raises(InputError, match=f"segments is {value}; expected at most {MOST_SEGMENTS} of one function"):
            parse_machine(MACHINE + f"[model]\nsegments = {value}\n", "m.toml")
    cross = '[model.functions]\nEAZ = {{ over = ["Z", "X"], segments = [{}, 40] }}\n'
    with pytest.raises(InputError, match=r"segments is \[400, 40\]; expected at most"):
        parse_machine(MACHINE + cross.format(400), "m.toml")
    assert parse_machine(MACHINE + cross.format(25), "m.toml").model.functions["EAZ"].segments == (25, 40)


def test_segments_of_all_functions_together(tmp_path):
    path = write_files(tmp_path, machine=MACHINE + "[model]\nsegments = 200\n")
    with pytest.raises(
        InputError, match="functions have 3600 segments, and there are 64 readings; expected at most 2000"
    ):
        volid.fit(volid.load_campaign(path))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("[-150.0, 80.0, -700.0]", "[-1.5e200, 80.0, -700.0]", "position is .*; expected numbers of at most 1e"),
        ("constant = 0.0003", "constant = 1e300", "constant is 1e.300; expected a number of at most 1e"),
    ],
)
def test_numbers_beyond_anything_measured(old, new, message, tmp_path):
    with pytest.raises(InputError, match=message):
        volid.load_campaign(write_files(tmp_path, manifest=MANIFEST.replace(old, new)))
    with pytest.raises(InputError, match="expected numbers of at most 1e"):
        parse_machine(MACHINE.replace("1000.0]", "1e300]"), "m.toml")


# --------------------------------------------------------------------------------------- names on paper and screen


@pytest.fixture(scope="module")
def escaping(tmp_path_factory):
    """Names as in 14_escape, in an HDF5 file, in which they pass: somebody else's program could have written it."""
    folder = tmp_path_factory.mktemp("escape")
    campaign = volid.load_campaign(DATASETS / "published_positioning" / "campaign.toml")
    title = "\x1b]0;PWNED\x07\x1b[2J\x1b[1;31m a,=cmd|x"
    volid.save_campaign(replace(campaign, title=title), folder / "c.h5")
    assert main(["fit", str(folder / "c.h5"), "-o", str(folder / "s.h5")]) in (0, 1)
    return folder


def test_nothing_reaches_the_terminal_raw(escaping, run):
    for arguments in (
        ["summary"],
        ["budget"],
        ["functions"],
        ["grid", "--points", "2", "--extrapolate"],
        ["summary", "--json"],
    ):
        status, out, err = run(arguments[0], escaping / "s.h5", *arguments[1:])
        assert status in (0, 1), err
        assert not CONTROL.search((out + err).replace("\n", "")), arguments
    assert json.loads(run("summary", escaping / "s.h5", "--json")[1])["campaign"].startswith("\x1b]0;PWNED")


def test_nor_a_text_file(escaping, run, tmp_path):
    run("summary", escaping / "s.h5", "-o", tmp_path / "s.txt")
    text = (tmp_path / "s.txt").read_text()
    assert r"\x1b]0;PWNED\x07" in text
    assert not CONTROL.search(text.replace("\n", ""))


def test_no_cell_runs_in_a_spreadsheet(escaping, run, tmp_path):
    """Whatever cuts a line into cells: commas, semicolons or tabs, in the record above the table too."""
    for verb in ("budget", "functions"):
        status, _, err = run(verb, escaping / "s.h5", "-o", tmp_path / f"{verb}.csv")
        assert status in (0, 1), err
    assert " a,'=cmd|x" in (tmp_path / "budget.csv").read_text()
    (tmp_path / "n.csv").write_text("from,to,distance,u\n" + "".join(f"{a},{b},{d},0.1\n" for a, b, d in TRIANGLE))
    (tmp_path / "p.csv").write_text("point,x,y,fixed\n'=1+1,0,0,1\n@B,3,0,1\n-C,0,4,0\n")
    status, _, err = run(
        "multilaterate", tmp_path / "n.csv", "--approximate", tmp_path / "p.csv", "-o", tmp_path / "c.csv"
    )
    assert status in (0, 1), err
    assert "\n'=1+1," in (tmp_path / "c.csv").read_text()
    for name in ("budget.csv", "functions.csv", "c.csv"):
        for delimiter in ",;\t":
            for row in csv.reader((tmp_path / name).read_text().splitlines(), delimiter=delimiter):
                assert not [cell for cell in row if would_run(cell)]


TRIANGLE = (("=1+1", "@B", 3.0), ("=1+1", "-C", 4.0), ("@B", "-C", 5.0))


def would_run(cell):
    """Whether a spreadsheet would take the cell for a formula that calls something: a function, a program, another sheet."""
    text = cell.strip()
    return text.startswith(("=", "@")) or (text.startswith(("+", "-")) and re.search(r"[|!]|\w\(", text) is not None)


@pytest.mark.parametrize("cell", ["=1+1", "+1", "-1e3", "-Z", "@x", "'=1+1", "''-x", "'quoted'", "S1", "", "-", "\tx"])
def test_a_cell_reads_back_as_it_was(cell):
    written = neutral(cell)
    assert original(written) == cell
    assert not would_run(written)
    assert written == cell or written == f"'{cell}"


def test_names_of_a_campaign_read_back_as_they_were(tmp_path):
    """Stations and lines may well be called +X or -X."""
    campaign = volid.load_campaign(write_files(tmp_path / "a"))
    first = campaign.sets[0]
    renamed = {"S1": "-S1", "S2": "=S2"}
    labels = {**first.labels, "station": np.array([renamed[n] for n in first.labels["station"].tolist()])}
    stations = tuple(replace(s, name=renamed[s.name]) for s in campaign.stations)
    campaign = replace(campaign, stations=stations, sets=(replace(first, labels=labels), *campaign.sets[1:]))
    path = write_manifest(campaign, tmp_path / "b")
    assert "'=S2" in (tmp_path / "b" / "volume.csv").read_text()
    read = volid.load_campaign(path)
    assert read.sets[0].labels["station"].tolist() == labels["station"].tolist()


def test_a_long_name_is_cut_in_messages(tmp_path):
    path = write_files(tmp_path, manifest=MANIFEST.replace('"distance"', f'"{"x" * 100_000}"'))
    with pytest.raises(InputError, match=r"unknown kind 'x{79}…'"):
        volid.load_campaign(path)
    many = {f"{'y' * 50}{i}": 1 for i in range(3000)}
    assert len(str(InputError(f"a.csv, header: {', '.join(many)}; mend it"))) < 4100
    assert str(OutputError("'" * 100_000))


def test_quotations_within_limits_stay():
    text = "the machine's 'E*' and the axis' 'x' are what a user's 'a b c' says, and so on for very many further words: 'E*X'"
    assert str(InputError(text)) == text


# ----------------------------------------------------------------------------------------- how far a manifest reaches


@pytest.fixture
def below(tmp_path):
    """A manifest in a folder whose readings stand beside that folder."""
    (tmp_path / "sent").mkdir()
    path = write_files(tmp_path / "sent")
    (tmp_path / "volume.csv").write_text((tmp_path / "sent" / "volume.csv").read_text())
    return path


@pytest.mark.parametrize("how", ["../volume.csv", "absolute", "link", "sub/../../volume.csv"])
def test_readings_stand_below_the_manifest(how, below, tmp_path):
    name = str(tmp_path / "volume.csv") if how == "absolute" else how
    if how == "link":
        (below.parent / "link").symlink_to("../volume.csv")
    (below.parent / "sub").mkdir()
    below.write_text(below.read_text().replace('"volume.csv"', f'"{name}"'))
    with pytest.raises(InputError, match=r"file is .*, which is outside the manifest's folder; .*`allow_outside=True`"):
        volid.load_campaign(below)
    assert volid.load_campaign(below, allow_outside=True).n_readings > 0


def test_the_option_of_the_command_line(below, run, tmp_path):
    below.write_text(below.read_text().replace('"volume.csv"', '"../volume.csv"'))
    status, _, err = run("import", below, "-o", tmp_path / "c.h5")
    assert status == 2
    assert "pass --allow-outside if you trust the manifest" in err
    assert run("import", below, "-o", tmp_path / "c.h5", "--allow-outside")[0] == 0


def test_samples_and_subfolders(below, tmp_path):
    (tmp_path / "samples.csv").write_text("value\n1\n2\n")
    text = below.read_text()
    below.write_text(
        text.replace(
            'u = 2.0e-7\nper = "station"\ndistribution = "rectangular"', 'file = "../samples.csv"\nper = "set"'
        )
    )
    with pytest.raises(InputError, match=r'file is "\.\./samples\.csv", which is outside'):
        volid.load_campaign(below)
    (below.parent / "data").mkdir()
    shutil.move(below.parent / "volume.csv", below.parent / "data" / "volume.csv")
    below.write_text(
        text.replace('"volume.csv"', '"data/volume.csv"').replace("[conditions]", '[conditions]\nfile = "/raw/x.txt"')
    )
    assert volid.load_campaign(below).conditions["file"] == "/raw/x.txt"


def test_a_machine_file_may_be_shared_and_nothing_else_is_told(below, tmp_path):
    shutil.move(below.parent / "machine.toml", tmp_path / "machine.toml")
    below.write_text(below.read_text().replace('"machine.toml"', '"../machine.toml"'))
    assert volid.load_campaign(below).machine.letters == ("X", "Y", "Z")
    (tmp_path / "machine.toml").write_text(MACHINE.replace("travel = [0.0, 600.0]", "travl = 1"))
    with pytest.raises(InputError, match="unknown key 'travl'"):
        volid.load_campaign(below)
    for secret in ("root:x:0:0", "password = 'secret'", 'format = "secret"'):
        (tmp_path / "machine.toml").write_text(secret)
        with pytest.raises(InputError, match="is no machine file; expected one with format") as error:
            volid.load_campaign(below)
        assert secret.split("=")[-1].strip("'\" ") not in str(error.value)
