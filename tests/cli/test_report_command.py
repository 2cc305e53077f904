"""`volid report`: one file, limits with exit status, languages, and what is refused before any work."""

import json
from dataclasses import replace

import pytest
from support.page_numbers import Page


@pytest.fixture(scope="module")
def limits(tmp_path_factory):
    path = tmp_path_factory.mktemp("limits") / "limits.toml"
    path.write_text('rule = "simple"\nlargest_deviation = 1e-4\nEC0Y = 9e-3\n', encoding="utf-8")
    return path


def test_a_page_with_limits_and_hashes(solution_file, limits, tmp_path, run):
    out = tmp_path / "report.html"
    status, stdout, stderr = run("report", solution_file, "-o", out, "--limits", limits, "--lang", "de", "--json")
    assert status == 1  # a limit is exceeded
    assert "largest_deviation = " in stderr and " exceeds 0.1 µm" in stderr and "EC0Y" not in stderr
    found = json.loads(stdout)
    assert (found["EC0Y"]["verdict"], found["largest_deviation"]["verdict"]) == ("pass", "fail")
    assert (found["barrier"], found["attention"]) == (None, [])
    html = out.read_text(encoding="utf-8")
    assert '<html lang="de">' in html and "einfache Annahme" in html
    from volid.io.basics.provenance import sha256

    assert sha256(solution_file) in html and sha256(limits) in html
    assert Page(html).ids.count("limits") == 1


def test_without_limits_an_accepted_solution_is_good(solution_file, tmp_path, run):
    out = tmp_path / "report.html"
    status, stdout, _ = run("report", solution_file, "-o", out, "--title", "Abnahme 7", "--tool", "0,0,-100")
    assert (status, stdout) == (0, f"written: {out}\n")
    html = out.read_text(encoding="utf-8")
    assert "<title>Abnahme 7</title>" in html and 'id="limits"' not in html


QUESTION = "are all lengths in mm?"


@pytest.fixture(scope="module")
def barred(solution_file, tmp_path_factory):
    """A solution of which no number is shown: a question about the values is open."""
    from volid.fitting.diagnosis.adequacy import QUESTIONED, Question
    from volid.io.solutions import read_solution, write_solution

    solution = read_solution(solution_file)
    asked = replace(solution.adequacy, grade=QUESTIONED, questions=(Question(QUESTION, True),), verdict=QUESTION)
    path = tmp_path_factory.mktemp("barred") / "s.h5"
    write_solution(replace(solution, adequacy=asked), path)
    return path


def test_behind_a_barrier_only_what_was_written_is_named(barred, tmp_path, run):
    out, book, dcc = (tmp_path / name for name in ("r.html", "r.xlsx", "r.xml"))
    status, stdout, stderr = run("report", barred, "-o", out, "--workbook", book, "--dcc", dcc)
    written, note = stdout.splitlines()
    assert (status, written) == (1, f"written: {out}")
    assert note.startswith(f"note: not written: {book} and {dcc};")
    assert f"volid report: attention: no numbers are shown: {QUESTION}\n" in stderr
    assert (stdout + stderr).count(QUESTION) == 1
    assert [p.name for p in tmp_path.iterdir()] == ["r.html"]


def test_behind_a_barrier_json_gives_the_reason(barred, limits, tmp_path, run):
    status, stdout, stderr = run("report", barred, "-o", tmp_path / "r.html", "--limits", limits, "--json")
    found = json.loads(stdout)
    message = f"no numbers are shown and no limit is judged: {QUESTION}"
    assert (status, found["attention"], found["barrier"]) == (1, [message], QUESTION)
    assert "EC0Y" not in found and message in stderr


def test_existing_files_and_inputs_are_not_replaced(solution_file, limits, tmp_path, run):
    out = tmp_path / "report.html"
    out.write_text("mine", encoding="utf-8")
    for arguments in ((out,), (limits, "--limits", limits, "--force"), (solution_file, "--force")):
        status, _, stderr = run("report", solution_file, "-o", *arguments)
        assert status == 2 and ("exists" in stderr or "is an input" in stderr)
    assert out.read_text(encoding="utf-8") == "mine"


def test_limits_that_cannot_be_read_are_refused_before_the_work(solution_file, tmp_path, run, monkeypatch):
    def worked(*_):
        raise AssertionError("the working volume is evaluated before the limits are read")

    monkeypatch.setattr("volid.report.contents.contents.gather", worked)
    for text, message in (('rule = "kind"\n', "the decision rule"), ("EXX = -1\n", "EXX"), (None, "no such file")):
        path = tmp_path / "limits.toml"
        path.unlink(missing_ok=True)
        if text:
            path.write_text(text, encoding="utf-8")
        status, _, stderr = run("report", solution_file, "-o", tmp_path / "page.html", "--limits", path)
        assert status == 2 and message in stderr and "limits.toml" in stderr
