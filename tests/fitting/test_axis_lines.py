"""A number under the symbol of a location error is that of the axis average line, wherever it stands: exact poses say where."""

import io
import json
from dataclasses import replace

import numpy as np
import pytest
from exact_chain import Truth
from support.axis_lines import line_error, zero_error
from support.machines import NUTATING, ROTARY_TABLE, STRUCTURES, exact_machine, resolved
from support.made_up import made_up, truth_of

import volid
from volid.cli import main
from volid.fitting.results import Residuals, Statistics
from volid.io.functions_csv import functions_sheet, read_functions, write_csv
from volid.model.axis_lines import is_of_a_line, line_values
from volid.uncertainty.intervals import function_rows
from volid.uncertainty.outputs import headline_outputs
from volid.virtual.comparison import compare

ALL = {**STRUCTURES, **NUTATING, "four axes": ROTARY_TABLE}
CONSTANTS_ONLY = '"E??" = false\n"E?0[XYZS]" = false\n'
ZEROS = "".join(f"E{a}0{a} = true\n" for a in "ABC")
MM, RAD = 2e-6, 1e-9  # products of two errors, 20 µm and 60 µrad


def known(layout, zeros=False):
    """A solution with location errors alone, and the errors of the exact lines by symbol."""
    exact = exact_machine(ALL[layout])
    names = [a for a in exact.axes if a in "ABC"]
    more = "".join(line for line in ZEROS.splitlines(True) if line[1] in names) if zeros else ""
    solution = made_up(resolved(exact, CONSTANTS_ONLY + more, segments=4), seed=6)
    truth = truth_of(solution)
    lines = {}
    for a in names:
        along = "ABC".index(a)
        numbers = line_error(exact, truth, a)
        lines |= {f"E{d}0{a}": v for k, (d, v) in enumerate(zip("XYZABC", numbers, strict=True)) if k % 3 != along}
        lines |= {f"E{a}0{a}": zero_error(exact, truth, a)} if zeros else {}
    return exact, solution, truth, lines


def assert_same(found, lines):
    """All of `lines` are among `found`, within what is of second order; and they are no zeros."""
    assert set(lines) <= set(found)
    for name, value in lines.items():
        tolerance = RAD if name[1] in "ABC" else MM
        assert found[name] == pytest.approx(value, abs=tolerance), name
        assert abs(value) > 20 * tolerance


def written(solution, path):
    """The solution in a file, with what a file needs: residuals and statistics."""
    still = tuple(np.zeros_like(s.readings) for s in solution.campaign.sets)
    full = replace(
        solution,
        readings=Residuals(still, still, tuple(s != 0 for s in still)),
        statistics=Statistics(6, 0, {"ends": 0.0}, 1, True),
    )
    volid.save_solution(full, path)
    return path


@pytest.mark.parametrize("layout", ALL)
def test_every_table_of_numbers_has_the_exact_axis_lines(layout, tmp_path):
    _, solution, truth, lines = known(layout)
    assert_same({n: solution.location(n).value for n in lines}, lines)
    assert_same({row.name: row.value for row in solution.functions()}, lines)
    outputs = headline_outputs(solution)
    values = outputs.rows @ np.asarray(solution.parameters)
    assert_same(dict(zip(outputs.names, values.tolist(), strict=False)), lines)
    assert_same(line_values(solution.machine, truth.constants), lines)
    assert_same({row.symbol: row.line for row in volid.location_errors(solution)}, lines)
    rows = solution.functions()
    np.testing.assert_allclose(
        function_rows(solution, rows) @ np.asarray(solution.parameters), [r.value for r in rows], rtol=1e-12
    )
    stream = io.StringIO()
    write_csv(stream, functions_sheet(rows, solution))
    (tmp_path / "functions.csv").write_text(stream.getvalue(), encoding="utf-8")
    assert_same({row.name: row.value for row in read_functions(tmp_path / "functions.csv")}, lines)
    assert "# location errors: axis average line in the machine frame" in stream.getvalue()
    moved = max(abs(lines[n] - truth.constants[n]) for n in lines)
    assert moved > 0.001  # mm: these are not the parameters


@pytest.mark.parametrize("layout", ["four axes", "tilting table C'A'", "mill-turn", "fork head CB"])
def test_zeros_turn_with_the_sign_of_the_line(layout):
    exact, solution, _, lines = known(layout, zeros=True)
    zeros = {n: v for n, v in lines.items() if n[1] == n[3]}
    assert len(zeros) == sum(a in "ABC" for a in exact.axes)
    for name, value in zeros.items():
        assert solution.location(name).value == pytest.approx(value, abs=1e-8), name  # 60 µrad squared
        assert abs(value) > 1e-6


def test_a_table_stands_on_the_other_side_by_hand():
    """EX0C = +10 µm of a table C' as parameter: the tool is at +10 µm, and so the table's centre at -10 µm (CONVENTIONS 3)."""
    exact = exact_machine(ROTARY_TABLE)
    machine = resolved(exact, CONSTANTS_ONLY + "EC0C = true")
    given = {"EX0C": 0.010, "EY0C": 0.0, "EA0C": 0.0, "EB0C": 20e-6, "EC0C": 30e-6}
    found = line_values(machine, given)
    assert found == pytest.approx({"EX0C": -0.010, "EY0C": 0.0, "EA0C": 0.0, "EB0C": -20e-6, "EC0C": -30e-6}, abs=1e-15)
    head = resolved(exact_machine("w b X Y Z C t"), CONSTANTS_ONLY)
    assert line_values(head, {"EX0C": 0.010}) == {"EX0C": 0.010}
    assert line_values(head, {"EC0Y": 1e-5, "EA0S": 2e-5}) == {"EC0Y": 1e-5, "EA0S": 2e-5}
    assert np.sign(line_error(exact, Truth({}, {"EX0C": 0.010}), "C")[0]) == -1.0


def test_comparison_with_a_truth_has_the_sign_of_the_line():
    _, solution, _, lines = known("tilting table C'A'")
    perfect = compare(solution, volid.Truth(solution.machine))
    for name, value in lines.items():
        assert perfect.functions[name] == pytest.approx(value, abs=1e-8 if name[1] in "ABC" else 5e-6), name


@pytest.mark.parametrize("layout", ["tilting table C'A'", "fork head CB"])
def test_summary_functions_and_locations_show_one_value_for_one_symbol(layout, tmp_path, capsys):
    exact, solution, truth, lines = known(layout)
    path = written(solution, tmp_path / "S.h5")

    def shown(*words):
        main([words[0], str(path), *words[1:], "--json"])
        return json.loads(capsys.readouterr().out)

    summary = {c["name"]: c for c in shown("summary")["location_errors"]}
    assert_same({n: c["value"] for n, c in summary.items()}, lines)
    functions = {row[0]: row[4] for row in shown("functions")["rows"]}
    located = {row[0]: row for row in shown("locations")["rows"]}
    carried = next(c for c in summary.values() if c["relative_to"] != "machine")
    relative = {row[0]: row for row in shown("locations", "--relative-to", carried["relative_to"])["rows"]}
    for name, c in summary.items():
        table = located if c["relative_to"] == "machine" else relative
        assert c["value"] == pytest.approx(table[name][4], rel=1e-12)
        assert c["parameter"] == pytest.approx(table[name][3], rel=1e-12)
        assert functions.get(name, c["value"]) == pytest.approx(c["value"], rel=1e-12)
    own = truth.constants[f"{carried['name'][:2]}0{carried['name'][-1]}"]
    assert carried["value"] == pytest.approx(-own if exact.primed["C"] else own, rel=1e-9)
    main(["summary", str(path)])
    text = " ".join(capsys.readouterr().out.split())
    assert "axis average line in the machine frame, other axes at 0, as ISO 230-1 has it" in text
    assert f"relative to the line of {carried['relative_to']}, which carries {carried['name'][-1]}" in text


def test_the_hdf5_file_says_the_same_and_what_it_refers_to(tmp_path):
    import h5py

    _, solution, _, lines = known("tilting table C'A'")
    written(solution, tmp_path / "S.h5")
    with h5py.File(tmp_path / "S.h5") as file:
        assert_same({n: float(file[f"functions/{n}/value"][0]) for n in lines}, lines)
        assert file["functions/EX0C"].attrs["refers_to"].startswith("axis average line in the machine frame")
        labels = file["parameters/label"].asstr()[:].tolist()
        parameter = float(file["parameters/value"][labels.index("EX0C")])
    assert parameter == float(np.asarray(solution.parameters)[labels.index("EX0C")])
    again = volid.load_solution(tmp_path / "S.h5")
    assert {n: again.location(n) for n in lines} == {n: solution.location(n) for n in lines}


def test_statement_and_budget_say_what_location_errors_refer_to():
    from volid.report.text.budget import format_budget
    from volid.uncertainty.budget import Line
    from volid.uncertainty.lack_of_fit import lack_of_fit
    from volid.uncertainty.statement import Row, Statement, format_statement

    _, solution, _, lines = known("tilting table C'A'")
    found, said = lack_of_fit(solution), "location errors: axis average line in the machine frame, other axes at 0"
    row = Row("EX(0A)C", "mm", np.nan, *[0.001] * 8, True, True)
    line = Line("EX0C", np.nan, "mm", 1e-4, "readings", 1e-3, "mm", 0.1, 1e-4, 1.0)
    assert said in format_statement(Statement((row,), 100, 0, 0, np.nan, found))
    assert said not in format_statement(Statement((row._replace(name="EC0Y"),), 100, 0, 0, np.nan, found))
    assert said in format_budget([line], found)
    assert said not in format_budget([line._replace(output="EXC")], found)
    assert {is_of_a_line(n) for n in lines} == {True}
    assert not any(map(is_of_a_line, ("EXC", "EC0Y", "EA0S", "V_X", "EC(0X)Y")))
