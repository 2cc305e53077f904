"""`volid functions --plot`: pictures instead of the table, beside it where the table has a file."""

import pytest


def test_pictures_of_the_functions_asked_for(run, solution_file):
    status, out, _ = run("functions", solution_file, "--plot", "EXX,E?Y")
    heads = [line.split()[0] for line in out.splitlines() if line.startswith("E")]
    assert status == 0 and heads == ["EXX", "EXY", "EYY", "EZY", "EAY", "EBY", "ECY"]
    assert "function,axis,position" not in out


def test_all_functions_beside_the_table_in_a_file(run, solution_file, tmp_path):
    status, out, _ = run("functions", solution_file, "--plot", "-o", tmp_path / "functions.csv")
    assert status == 0 and sum(line.startswith("E") for line in out.splitlines()) == 18
    assert "function,axis,position" in (tmp_path / "functions.csv").read_text()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--plot", "EXX,EC0Y"], "--plot EC0Y: the model has no such error motion; it has EXX"),
        (["--plot", "exx"], "--plot exx: the model has no such error motion"),
        (["--plot", "EXX", "--json"], "leave one out"),
        (["--plot", "EXX", "-o", "-"], "leave one out"),
    ],
)
def test_what_cannot_be_drawn_is_said(run, solution_file, arguments, message):
    status, out, err = run("functions", solution_file, *arguments)
    assert status == 2 and message in err and out == ""
