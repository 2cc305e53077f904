"""`volid figures`: files that appear all or none, what was left out and why, refusals."""

import json

import pytest

from volid.report.plot.collection import FIGURES


@pytest.mark.parametrize(("kind", "begins"), [("svg", b"<?xml"), ("pdf", b"%PDF"), ("png", b"\x89PNG")])
def test_figures_are_written_as_asked(run, solution_file, tmp_path, kind, begins):
    status, out, _ = run("figures", solution_file, "-o", tmp_path / "f", "--only", "functions", "--format", kind)
    assert status == 0
    assert out == f"written to {tmp_path / 'f'}: functions.{kind}\n"
    assert [p.name for p in (tmp_path / "f").iterdir()] == [f"functions.{kind}"]
    assert (tmp_path / "f" / f"functions.{kind}").read_bytes().startswith(begins)


def test_a_figure_that_does_not_apply_says_why(run, solution_file, tmp_path):
    status, out, _ = run("figures", solution_file, "-o", tmp_path / "f", "--only", "locations,functions,coverage")
    assert status == 0
    assert "left out: locations: the machine has no rotary axes\n" in out
    assert "left out: coverage: the solution has no samples of Monte Carlo refits" in out
    assert [p.name for p in (tmp_path / "f").iterdir()] == ["functions.svg"]


def test_one_reason_for_many_figures_is_said_once(run, solution_file, tmp_path, monkeypatch):
    from volid.fitting.diagnosis.adequacy import Adequacy

    monkeypatch.setattr(Adequacy, "barrier", "the hands of the frames differ")
    status, out, _ = run("figures", solution_file, "-o", tmp_path / "f", "--only", "functions,locations,sections")
    assert status == 0
    lines = [line for line in out.splitlines() if line.startswith("left out: ")]
    assert len(lines) == 1 and lines[0].startswith("left out: functions, locations, sections: its numbers"), out


def test_names_as_json(run, solution_file, tmp_path):
    status, out, _ = run("figures", solution_file, "-o", tmp_path / "f", "--only", "functions,rotary", "--json")
    found = json.loads(out)
    assert (status, found["written"]) == (0, ["functions.svg"])
    assert found["left_out"] == {"rotary": "the machine has no rotary axes"}


def test_the_same_solution_gives_the_same_files(run, solution_file, tmp_path):
    for folder in ("a", "b"):
        run("figures", solution_file, "-o", tmp_path / folder, "--only", "functions")
    assert (tmp_path / "a" / "functions.svg").read_bytes() == (tmp_path / "b" / "functions.svg").read_bytes()


def test_german_texts(run, solution_file, tmp_path):
    """Texts of a PDF are kept as text, in fonts that people can edit."""
    pypdf = pytest.importorskip("pypdf")
    run("figures", solution_file, "-o", tmp_path / "f", "--only", "functions", "--format", "pdf", "--lang", "de")
    text = pypdf.PdfReader(tmp_path / "f" / "functions.pdf").pages[0].extract_text()
    assert "Geradheitsabweichung von X in Richtung Y" in text


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--only", "function"], "--only: there is no figure 'function'; choose among functions, "),
        (["--tool", "0,0,-0.15"], "tool"),
        (["--format", "gif"], "invalid choice: 'gif'"),
        (["--lang", "fr"], "invalid choice: 'fr'"),
    ],
)
def test_refusals_write_nothing(run, solution_file, tmp_path, options, message):
    status, _, err = run("figures", solution_file, "-o", tmp_path / "f", *options)
    assert (status, message in err) == (2, True), err
    assert not list(tmp_path.iterdir())


def test_a_folder_with_files_is_left_as_it_is(run, solution_file, tmp_path):
    (tmp_path / "f").mkdir()
    (tmp_path / "f" / "mine.txt").write_text("mine")
    status, _, err = run("figures", solution_file, "-o", tmp_path / "f", "--only", "functions")
    assert (status, "exists; choose another name or pass --force" in err) == (2, True), err
    assert run("figures", solution_file, "-o", tmp_path / "f", "--only", "functions", "--force")[0] == 0
    assert sorted(p.name for p in (tmp_path / "f").iterdir()) == ["functions.svg", "mine.txt"]


def test_all_or_none(run, solution_file, tmp_path, monkeypatch):
    """The second figure fails: the first is not left behind."""
    from volid.exceptions import InputError
    from volid.report.plot import sections

    def fail(asked):
        raise InputError("cannot be drawn")

    monkeypatch.setattr(sections, "draw", fail)
    status, _, err = run("figures", solution_file, "-o", tmp_path / "f", "--only", "functions,sections")
    assert (status, err.splitlines()[-1]) == (2, "volid figures: cannot be drawn")
    assert not list(tmp_path.iterdir())


def test_help_names_every_figure(run, capsys):
    status, out, _ = run("figures", "--help")
    assert status == 0
    for name, (_, words) in FIGURES.items():
        assert f"  {name:<13}{words}\n" in out


def test_an_undetermined_solution_needs_attention(run, single_tool_solution, tmp_path):
    from volid.io.solutions import write_solution

    write_solution(single_tool_solution, tmp_path / "s.h5")
    status, out, err = run("figures", tmp_path / "s.h5", "-o", tmp_path / "f", "--only", "functions")
    assert (status, "attention: the data do not determine" in err, "functions.svg" in out) == (1, True, True)
