"""`volid evaluate iso230-2` from the command line: exit status, JSON, table, figure."""

import csv
import json

import pytest
from support.commands import run as run
from support.places import DATASETS

FOLDER = DATASETS / "iso230_2_synthetic"
RUNS = FOLDER / "X.csv"


def test_limits_decide_the_exit_status(run, tmp_path):
    status, out, error = run("evaluate", "iso230-2", RUNS, "--axis", "X", "--limits", FOLDER / "limits.toml")
    assert status == 1 and "X: A = " in error and " exceeds " in error and "E = " not in error
    assert "13.10" in out
    (tmp_path / "wide.toml").write_text("E = 0.1\n[X]\nR = 0.1\n")
    assert run("evaluate", "iso230-2", RUNS, "--axis", "X", "--limits", tmp_path / "wide.toml")[0] == 0


def test_json_has_the_quantities_under_their_symbols_in_mm(run):
    arguments = ("evaluate", "iso230-2", RUNS, "--axis", "X", "--uncertainty", FOLDER / "conditions.toml", "--json")
    status, out, _ = run(*arguments)
    found = json.loads(out)
    assert status == 0 and found["subject"] == "X"
    wanted = {"E", "E_up", "E_down", "A", "A_up", "A_down", "R", "R_up", "R_down", "M", "B", "B_mean"}
    assert wanted <= set(found)
    assert found["E"]["value"] == pytest.approx(0.0131) and found["E"]["unit"] == "mm"
    assert 0.0 < found["E"]["U"] < 0.003 and found["E"]["verdict"] is None


def test_table_and_figure_are_written(run, tmp_path):
    out, figure = tmp_path / "targets.csv", tmp_path / "figure.png"
    assert run("evaluate", "iso230-2", FOLDER / "campaign.toml", "-o", out, "--figure", figure)[0] == 0
    rows = list(csv.DictReader(line for line in out.read_text().splitlines() if not line.startswith("#")))
    assert len(rows) == 11 and rows[0]["n_up"] == "5"
    assert float(rows[10]["mean_up_mm"]) == pytest.approx(0.011)
    assert figure.read_bytes().startswith(b"\x89PNG")


def test_bad_input_has_one_message(run, tmp_path):
    (tmp_path / "runs.csv").write_text("a,b\n1,2\n")
    status, out, error = run("evaluate", "iso230-2", tmp_path / "runs.csv")
    assert status == 2 and out == "" and "runs.csv: columns a, b; expected a campaign" in error


def test_a_limit_within_u_is_not_good(run, tmp_path):
    """E = 13.10 µm and U = 0.5 µm or more: a limit of 13.2 µm is neither kept nor exceeded (ISO 14253-1)."""
    (tmp_path / "narrow.toml").write_text("E = 0.0132\n")
    limits = ("--axis", "X", "--limits", tmp_path / "narrow.toml", "--uncertainty", FOLDER / "conditions.toml")
    status, _, error = run("evaluate", "iso230-2", RUNS, *limits)
    assert status == 1 and "X: E = 13.1 µm (U " in error
    assert "is within U of its limit of 13.2 µm, so that neither pass nor fail is proved" in error
