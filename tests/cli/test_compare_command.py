"""`volid compare` and `volid check`: files in, words, tables, figures and exit codes out."""

import json
import re

import pytest
from support.surveys import changed, few_distances, survey, surveyed, truth_of_tests

import volid
from volid.fitting.fit import fit
from volid.io.basics.csv_table import read_csv

CRASH = ("EC0Y", 25e-6)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("surveys")
    for name, solution in (("a", surveyed(1)), ("b", surveyed(2)), ("c", surveyed(3, CRASH))):
        volid.save_solution(solution, path / f"{name}.h5")
    for day, seed in (("2026-01-10", 21), ("2026-02-10", 22), ("2026-03-12", 23)):
        truth = changed(truth_of_tests(), "EC0Y", (seed - 21) * 25e-6)
        volid.save_solution(fit(survey(truth, seed, date=day)), path / f"{day}.h5")
    volid.save_campaign(few_distances(truth_of_tests(), 5), path / "same.h5")
    volid.save_campaign(few_distances(changed(truth_of_tests(), *CRASH), 6), path / "crashed.h5")
    return path


def test_two_unchanged_surveys(folder, tmp_path, run):
    status, out, err = run("compare", folder / "a.h5", folder / "b.h5", "-o", tmp_path / "d.csv")
    assert status == 0 and "attention" not in err and "no function has changed significantly" in out
    table = read_csv(tmp_path / "d.csv")
    assert list(table.columns) == ["function", "position", "direction", "beside", "change", "u", "unit", "significant"]
    assert set(table.columns["significant"]) == {"0"} and "EC0Y" in table.columns["function"]


def test_a_change_is_named_and_drawn(folder, tmp_path, run):
    figure = tmp_path / "d.svg"
    status, out, err = run("compare", folder / "a.h5", folder / "c.h5", "--figure", figure)
    assert status == 1 and "changed: EC0Y" in out and "attention: EC0Y changed by 2" in err
    assert "EC0Y" in figure.read_text(encoding="utf-8") or figure.stat().st_size > 10_000
    status, out, _ = run("compare", folder / "a.h5", folder / "c.h5", "--json", "--datum", "primary=Y,secondary=X")
    data = json.loads(out)
    assert status == 1 and data["changed"] == ["EC0X", "EC0S"] and data["EC0X"]["significant"]
    assert data["EXX"]["largest_change"] is not None and data["volume"]["largest"] > 0


def test_a_series_by_the_dates_of_the_campaigns(folder, tmp_path, run):
    files = [folder / f"{day}.h5" for day in ("2026-03-12", "2026-01-10", "2026-02-10")]
    status, out, err = run(
        "compare", *files, "--limit", "0.02", "-o", tmp_path / "s.csv", "--figure", tmp_path / "s.png"
    )
    assert status == 1 and "3 surveys, 2026-01-10 to 2026-03-12" in out and "drifting: EC0Y" in out
    assert "EC0Y drifts" in err and (tmp_path / "s.png").stat().st_size > 10_000
    assert set(read_csv(tmp_path / "s.csv").columns["time"]) == {"2026-01-10", "2026-02-10", "2026-03-12"}
    status, out, _ = run("compare", *files, "--dates", "60,0,30", "--json")
    assert json.loads(out)["surveys"][1]["time"] == "30" and json.loads(out)["span"] == 60.0


@pytest.mark.parametrize(
    "arguments, words",
    [
        (["a.h5"], "one solution is given; expected two"),
        (["a.h5", "b.h5", "--limit", "0.01"], "--limit is for a series of three solutions"),
        (["a.h5", "b.h5", "c.h5"], r"\[conditions\] date is missing; .* or give the days of all solutions by --dates"),
        (["a.h5", "b.h5", "c.h5", "--dates", "1,2"], "--dates 1,2: 2 dates for 3 solutions"),
        (
            ["a.h5", "b.h5", "--common", "laser"],
            "--common laser: not every solution has an effect or artefact of this name",
        ),
        (["a.h5", "b.h5", "--figure", "d.txt"], r"a figure ends in"),
    ],
)
def test_what_is_refused(folder, run, arguments, words):
    status, _, err = run("compare", *(folder / a if a.endswith("h5") else a for a in arguments))
    assert status == 2
    assert re.search(words, err), err


def test_a_check_updates_the_old_solution(folder, tmp_path, run):
    status, out, err = run("check", folder / "a.h5", folder / "same.h5", "-o", tmp_path / "u.h5")
    assert status == 0 and "attention" not in err and out.startswith("no change found")
    updated = volid.load_solution(tmp_path / "u.h5")
    assert "prior" in updated.provenance["options"] and updated.options["prior"]
    status, out, err = run("check", folder / "a.h5", folder / "crashed.h5", "--json", "-o", tmp_path / "v.h5")
    data = json.loads(out)
    assert status == 1 and data["changed"] and [f["name"] for f in data["findings"]] == ["EC0Y"]
    assert "attention: EC0Y changed by 2" in err
    status, _, err = run("check", folder / "a.h5", folder / "same.h5", "-o", folder / "a.h5", "--force")
    assert status == 2 and "is an input of this command" in err


def test_an_updated_solution_is_compared_with_the_one_it_came_from(folder, tmp_path, run):
    run("check", folder / "a.h5", folder / "crashed.h5", "-o", tmp_path / "v.h5")
    status, out, err = run("compare", folder / "a.h5", tmp_path / "v.h5", "--json")
    assert status == 1 and json.loads(out)["changed"] == ["EC0Y"] and "attention: EC0Y" in err


def test_places_have_axis_and_unit_and_columns_are_explained(folder, run):
    _, out, _ = run("compare", folder / "a.h5", folder / "c.h5")
    assert re.search(
        r"most at (X|Y|Z) -?[\d.]+ mm, (X|Y|Z) -?[\d.]+ mm, (X|Y|Z) -?[\d.]+ mm with tool \(.*\) mm",
        " ".join(out.split()),
    )
    assert re.search(r"^EXX .* µm +X -?[\d.]+ mm ", out, re.MULTILINE)
    _, out, _ = run("compare", *(folder / f"2026-0{day}.h5" for day in ("1-10", "2-10", "3-12")))
    assert "* significant" in out and "found: the size" in " ".join(out.split())
