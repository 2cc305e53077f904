"""`volid plan … validate`, `volid simulate`, `volid validate`: from a solution to its verdict, by files alone."""

import csv
import json

import pytest
from support.places import DATASETS, MODELS

from volid.cli import main
from volid.io import load_campaign
from volid.report.text.validation import COLUMNS

MODEL = MODELS / "wYXbZt_vertical.toml"


def main_of(*arguments) -> int:
    return main([str(a) for a in arguments])


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A machine that was simulated and fitted, a plan for its validation, and that plan measured on it and on another one."""
    folder = tmp_path_factory.mktemp("validate")
    plan, truth = folder / "first.toml", folder / "first.truth.h5"
    assert main_of("plan", MODEL, "standard", "--points", "80", "-o", plan) == 0
    assert main_of("simulate", MODEL, "--plan", plan, "--seed", "4", "-o", folder / "first.h5") == 0
    assert main_of("fit", folder / "first.h5", "-o", folder / "solution.h5") == 0
    check = folder / "check.toml"
    assert main_of("plan", "--validate", folder / "solution.h5", "--points", "40", "-o", check) == 0
    for name, more in (("right", ("--truth", truth)), ("wrong", ())):
        arguments = ("simulate", MODEL, "--plan", check, *more, "--seed", "9", "-o", folder / f"{name}.h5")
        assert main_of(*arguments) == 0
    return folder


def test_a_right_solution_is_confirmed_with_its_table_and_figure(files, run):
    table, figure = files / "out.csv", files / "out.svg"
    status, out, err = run("validate", files / "solution.h5", files / "right.h5", "-o", table, "--figure", figure)
    assert status == 0 and "attention" not in err, err
    assert "Confirmed" in out and "E_n > 1" in out and "Smallest changes" in out and "squareness" in out
    rows = list(csv.reader(line for line in table.read_text().splitlines() if not line.startswith("#")))
    assert tuple(rows[0]) == COLUMNS and len(rows) == 1 + load_campaign(files / "right.h5").n_readings
    _, row, column, predicted, reading, residual, u, e_n = rows[1]
    assert (row, column) == ("1", "1")
    assert float(reading) - float(predicted) == pytest.approx(float(residual), abs=1e-9)
    assert float(e_n) == pytest.approx(abs(float(residual)) / (2 * float(u)))
    assert figure.read_text().startswith("<?xml")
    status, _, err = run("validate", files / "solution.h5", files / "right.h5", "-o", table)
    assert status == 2 and "out.csv exists" in err


def test_another_machine_is_not_confirmed_and_named(files, run):
    status, out, err = run("validate", files / "solution.h5", files / "wrong.h5", "--json")
    found = json.loads(out)
    assert status == 1 and "attention: not confirmed" in err
    assert not found["confirmed"] and found["causes"] and found["E_n_above_1"] > 0.5
    assert {t["what"] for t in found["tests"] if not t["passed"]}
    assert {"scale of X", "scale of Y"} <= {s["change"] for s in found["smallest_changes"]}


def test_the_fits_own_readings_are_no_test(files, run):
    status, out, err = run("validate", files / "solution.h5", files / "first.h5")
    assert status == 1 and "the fit has seen the readings" in err and "Not independent of the fit" in out
    assert "No test:" in out and "Confirmed" not in out


def test_after_compensation_and_with_its_tables_stated(files, run):
    tables = files / "tables"
    assert run("tables", files / "solution.h5", "--type", "L-POS", "-o", tables)[0] == 0
    arguments = ("--plan", files / "check.toml", "--truth", files / "first.truth.h5", "--seed", "9")
    after = files / "after.h5"
    assert run("simulate", MODEL, *arguments, "--compensation", tables, "-o", after)[0] == 0
    status, out, _ = run("validate", files / "solution.h5", after, "--compensation", tables)
    assert status == 0 and "Confirmed" in out
    status, out, err = run("validate", files / "solution.h5", after)
    assert status == 1 and "--compensation" in out and "state them with --compensation" in err


def test_bad_input_is_one_message(files, run):
    status, _, err = run("validate", files / "solution.h5", files / "check.toml")
    assert status == 2 and "column 'distance' is missing" in err
    direct = DATASETS / "direct_measurement" / "campaign.toml"
    status, _, err = run("validate", files / "solution.h5", direct)
    assert status == 2 and "expected the same machine" in err
    status, _, err = run("validate", files / "solution.h5", files / "right.h5", "--level", "95")
    assert status == 2 and "--level" in err
    status, _, err = run("plan", "-o", files / "p.toml")
    assert status == 2 and "no machine is named" in err and "--solution" in err
    status, _, err = run("plan", MODEL, "validate", "-o", files / "p.toml")
    assert status == 2 and "--solution" in err
    status, _, err = run("plan", MODEL, "standard", "--solution", files / "solution.h5", "-o", files / "p.toml")
    assert status == 2 and "--solution is not for the test standard" in err
