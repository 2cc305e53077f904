"""`volid export`: files, sheet and record in a folder, controls explained, all at once, one clear message for bad input."""

import json

import pytest
from support.control_contract import NEEDED

import volid
from volid.controllers import CONTROLS
from volid.controllers.base import OPEN


@pytest.fixture(scope="module")
def solution(tmp_path_factory):
    """The published interferometer runs of X and Z, fitted."""
    path = tmp_path_factory.mktemp("export") / "solution.h5"
    volid.fit(volid.load_campaign("datasets/published_positioning/campaign.toml")).save(path)
    return path


def test_one_control(solution, run, tmp_path):
    out = tmp_path / "control"
    status, text, _ = run("export", solution, "--cnc", "linuxcnc", "-o", out)
    assert status == 0 and "LinuxCNC" in text and "x.comp: " in text
    assert {"x.comp", "z.comp", "COMMISSIONING.md", "RECORD.md"} <= {p.name for p in out.iterdir()}
    record = (out / "RECORD.md").read_text(encoding="utf-8")
    assert "source sha256" in record and "volid export" in record and "with these files" in record
    status, _, err = run("export", solution, "--cnc", "linuxcnc", "-o", out)
    assert (status, f"{out} exists" in err) == (2, True)
    assert run("export", solution, "--cnc", "linuxcnc", "-o", out, "--force")[0] == 0


def test_machine_reading(solution, run, tmp_path):
    status, text, _ = run(
        "export", solution, "--cnc", "linuxcnc", "-o", tmp_path / "c", "--json", "--increment", "X=0.001"
    )
    found = json.loads(text)
    assert (status, found["cnc"], found["types"]) == (0, "linuxcnc", ["L-POS"])
    assert {c["axis"] for c in found["sign_checks"]} == {"X", "Z"} and found["helping_axes"] == []


@pytest.mark.parametrize("name", list(CONTROLS))
def test_every_control_is_explained_without_a_solution(name, run):
    status, text, _ = run("export", "--cnc", name, "--explain")
    assert status == 0 and text.startswith(f"# {name}: ") and "What is known, and on what it rests" in text


def test_controls_are_listed(run):
    status, text, _ = run("export", "--cnc", "list")
    assert status == 0 and all(name in text for name in CONTROLS) and "sinumerik-vcs: no layout" in text
    listed = json.loads(run("export", "--cnc", "list", "--json")[1])
    assert [c["name"] for c in listed["controls"]] == list(CONTROLS)


def test_all_controls_at_once(solution, run, tmp_path):
    """Every control has its line; files of one are those of `--cnc` with its name; signs that are open are asked for."""
    out, alone = tmp_path / "controls", tmp_path / "alone"
    stated = [f"{name}.{k}={v}" for name, options in NEEDED.items() for k, v in options.items()]
    more = [word for text in ("linuxcnc.comp_file_type=1", *stated) for word in ("--option", text)]
    status, text, err = run("export", solution, "--cnc", "all", "-o", out, "--json", *more)
    assert status == 0, err
    found = {c["cnc"]: c for c in json.loads(text)["controls"]}
    assert list(found) == list(CONTROLS)
    written = {name for name, c in found.items() if c["status"] == "written"}
    assert {p.name for p in out.iterdir()} == written
    assert all((out / name / "COMMISSIONING.md").exists() and found[name]["sign_checks"] for name in written)
    asking = {name for name, c in CONTROLS.items() if c.declaration.sign == OPEN}
    assert {name for name, c in found.items() if c["status"] == "asks for the sign"} == asking
    assert run("export", solution, "--cnc", "linuxcnc", "--option", "comp_file_type=1", "-o", alone)[0] == 0
    one = (alone / "x.comp").read_text()
    assert one == (out / "linuxcnc" / "x.comp").read_text()
    assert abs(float(one.split()[-2])) < 1.0  # what is added to the command, not a position


@pytest.mark.parametrize(
    "words, message",
    [
        (("--cnc", "foo"), "--cnc foo is no control that volid knows; available: linuxcnc"),
        (("--cnc", "sinumerik-vcs"), "--cnc sinumerik-vcs: nothing can be written for it"),
        (("--cnc", "linuxcnc", "--type", "L-VOL"), "--type L-VOL: linuxcnc cannot carry L-VOL"),
        (("--cnc", "linuxcnc", "--option", "x"), "--option 'x'; expected KEY=VALUE"),
        (("--cnc", "linuxcnc", "--option", "x=1"), "linuxcnc: option 'x' is unknown"),
        (("--cnc", "linuxcnc", "--option", "comp_file_type=9"), "comp_file_type is '9'"),
        (("--cnc", "all", "--option", "comp_file_type=1"), "begins with the name of one"),
        (
            ("--cnc", "linuxcnc", "--range", "X=-50:100"),
            "--range X=-50:100; expected a range that rises within the travel",
        ),
        (("--cnc", "linuxcnc", "--clamp", "B"), "has no axis B"),
        (("--cnc", "linuxcnc", "--most-turns", "0"), "--most-turns 0 needs the least increment"),
        (("--cnc", "linuxcnc", "--sign", "error"), "leave it out"),
    ],
)
def test_bad_input_has_one_clear_message(solution, run, tmp_path, words, message):
    status, _, err = run("export", solution, *words, "-o", tmp_path / "out")
    assert status == 2 and message in err, err
    assert (not (tmp_path / "out").exists() and len(err.strip().splitlines()) == 1) or "reading" in err


def test_a_folder_and_a_solution_are_asked_for(solution, run):
    assert "-o DIR is missing" in run("export", solution, "--cnc", "linuxcnc")[2]
    assert "no solution is named" in run("export", "--cnc", "linuxcnc", "-o", "x")[2]


def test_files_from_before_are_named(solution, run, tmp_path):
    """With all controls too, folders of an earlier run are filled again; a table that is of no part of it any more is named."""
    out = tmp_path / "controls"
    assert run("export", solution, "--cnc", "all", "-o", out)[0] == 0
    (out / "linuxcnc" / "y.comp").write_text("0 0 0\n100 100.01 100.01\n")
    (out / "linuxcnc" / "notes.txt").write_text("of a person\n")
    (out / "linuxcnc" / "x.comp").write_text("")
    status, _, err = run("export", solution, "--cnc", "all", "-o", out, "--force")
    assert status == 1 and "not part of this export: linuxcnc/y.comp; remove them" in err
    assert len((out / "linuxcnc" / "x.comp").read_text().splitlines()) > 2
    status, _, err = run("export", solution, "--cnc", "linuxcnc", "-o", out / "linuxcnc", "--force")
    assert status == 1 and "not part of this export: y.comp; remove them" in err
    (out / "linuxcnc" / "y.comp").unlink()
    assert run("export", solution, "--cnc", "linuxcnc", "-o", out / "linuxcnc", "--force")[0] == 0


def test_an_explanation_is_json_too(run):
    found = json.loads(run("export", "--cnc", "fanuc-pitch", "--explain", "--json")[1])
    options = {o["name"]: o["default"] for o in found["options"]}
    assert found["name"] == "fanuc-pitch" and options["bidirectional"] == "0" and options["limit"] == "not stated"
    assert {"text", "basis", "source"} == set(found["facts"][0]) and found["commissioning"]["backup"]


def test_options_that_were_not_stated_are_so_in_the_record(solution, run, tmp_path):
    run("export", solution, "--cnc", "linuxcnc", "-o", tmp_path / "c")
    record = (tmp_path / "c" / "RECORD.md").read_text(encoding="utf-8")
    rows = {
        cells[1].strip(): cells[2].strip()
        for cells in (line.split("|") for line in record.splitlines())
        if len(cells) > 2
    }
    assert rows["option coordinates"] == "not stated" and rows["option units"] == "mm"


def test_files_that_are_not_added_to_are_named(solution, run, tmp_path):
    (tmp_path / "old").mkdir()
    (tmp_path / "old" / "x.comp").write_text("0 0 0\n1000 1000.01 1000.01\n")
    (tmp_path / "old" / "z.comp").write_text("; z\n0 0 0\n")
    text = run("export", solution, "--cnc", "linuxcnc", "--add-to", tmp_path / "old", "-o", tmp_path / "c")[1]
    assert "old: left out, because linuxcnc does not know them: z.comp\n" in text


def test_the_sign_of_existing_files_is_asked_for_by_its_own_option(solution, run, tmp_path):
    (tmp_path / "cec.ini").write_text("$AN_CEC[0,0]=0\n")
    words = ("--cnc", "sinumerik-cec", "--sign", "error", "--add-to", tmp_path / "cec.ini", "-o", tmp_path / "c")
    status, _, err = run("export", solution, *words)
    assert status == 2 and "state --add-to-sign error (actual - nominal) or --add-to-sign compensation" in err


def test_papers_name_options_as_the_command_line_has_them(solution, run, tmp_path):
    """Never the parameters of Python, between backquotes, for which the command has an option."""
    out = tmp_path / "control"
    run("export", solution, "--cnc", "sinumerik-enc-comp", "--max-points", "5", "-o", out)
    texts = "".join((out / name).read_text(encoding="utf-8") for name in ("COMMISSIONING.md", "RECORD.md"))
    texts += run("export", "--cnc", "sinumerik-enc-comp", "--explain")[1]
    assert "--max-error" in texts and "`max_error`" not in texts and "`zero`" not in texts
