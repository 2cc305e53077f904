"""The workbook read back by openpyxl: every number is the library's, every text stays a text."""

from dataclasses import replace

import numpy as np
import openpyxl
import pytest

import volid
from volid.compensation.residual.accuracy import volume_sizes
from volid.exceptions import InputError, OutputError
from volid.fitting.diagnosis.adequacy import Question
from volid.report.text.summary import summary_data
from volid.report.workbook.table import Column, Table
from volid.report.workbook.write import write_workbook

EVIL = (
    "=1+1",
    "+cmd|' /C calc'!A0",
    "-2+3",
    "@SUM(A1)",
    "http://example.org",
    "12",
    "{=1}",
    "a & b <c> \"d\" 'e'",
    "ß µ 角",
    "\x07",
)


@pytest.fixture(scope="module")
def book(solution, tmp_path_factory):
    path = tmp_path_factory.mktemp("workbook") / "result.xlsx"
    volid.save_workbook(solution, path)
    return openpyxl.load_workbook(path)


def table(book, name):
    """Headings and rows of a sheet."""
    heading, *rows = book[name].iter_rows(values_only=True)
    return list(heading), rows


def number(cell):
    return np.nan if cell is None else float(cell)


def micro(row):
    return 1e6 if row.name[1] in "ABC" else 1e3


def test_functions_equal_the_tabulated_ones(solution, book):
    rows = [row for row in solution.functions() if row.name[2] != "0"]
    seen = 0
    for axis in "XYZ":
        heading, cells = table(book, f"Functions {axis}")
        assert heading[0] == f"position of {axis} [mm]"
        for row in (r for r in rows if r.axis == axis):
            title = row.name + {0: "", 1: " (+)", -1: " (−)"}[row.direction]
            unit = "µrad" if row.name[1] in "ABC" else "µm"
            j = heading.index(f"{title} [{unit}]")
            assert heading[j + 1] == f"U({title}) [{unit}]"
            (found,) = [c for c in cells if abs(c[0] - row.position) < 1e-6]
            expected = np.array([row.value, 2.0 * row.u]) * micro(row)
            assert np.allclose(
                [number(found[j]), number(found[j + 1])], expected, rtol=1e-12, atol=1e-12, equal_nan=True
            )
            seen += 1
    assert seen == len(rows) > 300


def test_directions_stand_beside_each_other(tmp_path):
    solution = volid.fit(volid.load_campaign("datasets/published_positioning/campaign.toml"))
    volid.save_workbook(solution, tmp_path / "result.xlsx")
    heading, rows = table(openpyxl.load_workbook(tmp_path / "result.xlsx"), "Functions X")
    assert heading == ["position of X [mm]", "EXX (+) [µm]", "U(EXX (+)) [µm]", "EXX (−) [µm]", "U(EXX (−)) [µm]"]
    up, down = (np.array([row[j] for row in rows]) for j in (1, 3))
    assert np.ptp([up, down]) == pytest.approx(31.8, abs=0.05)  # published: E = 31.8 µm
    assert len(rows) == 21 and rows[-1][0] == 500.0


def test_constants_and_volume_equal_the_summary(solution, book):
    summary, heading = summary_data(solution), table(book, "Squareness")[0]
    assert heading[:4] == ["symbol", "description", "value [µrad]", "U (k = 2) [µrad]"]
    for found, row in zip(table(book, "Squareness")[1], summary["squareness"], strict=True):
        assert found[0] == row["symbol"] and found[4] == row["angle"]
        assert np.allclose(found[2:4], [1e6 * row["value"], 1e6 * row["U"]], rtol=1e-12)
    rows = {row[0]: row for row in table(book, "Working volume")[1]}
    sizes, scale = volume_sizes(solution, solution.most_used_tool()), [1e3] * 3 + [1e6] * 3
    for k, letter in enumerate("XYZABC"):
        (name,) = [key for key in rows if key.startswith(f"V_{letter},")]
        expected = [scale[k] * sizes.accuracy.value[k], scale[k] * sizes.accuracy.U[k]]
        assert np.allclose([number(v) for v in rows[name][1:3]], expected, rtol=1e-12, equal_nan=True)
    largest = rows["largest deviation in the stated datum"]
    assert largest[1] == pytest.approx(1e3 * summary["volume"]["before"]["max"], rel=1e-12)


def test_every_reading_has_its_residual(solution, book):
    heading, rows = table(book, "Residuals")
    column = {name: j for j, name in enumerate(heading)}
    sets = solution.campaign.sets
    assert len(rows) == sum(s.readings.size for s in sets)
    for name, arrays, scale in (
        ("reading [mm, rad, °]", [s.readings for s in sets], 1.0),
        ("residual [µm, µrad]", solution.readings.residuals, 1e3),
        ("u (k = 1) [µm, µrad]", [s.u for s in sets], 1e3),
        ("normalised residual", solution.readings.normalised, 1.0),
    ):
        expected = scale * np.concatenate([np.ravel(a) for a in arrays])
        assert np.allclose([number(row[column[name]]) for row in rows], expected, rtol=1e-12, equal_nan=True), name
    first = rows[0]
    assert [first[column[f"{a} [mm]"]] for a in solution.machine.letters] == pytest.approx(
        sets[0].positions[0].tolist(),
        rel=1e-15,  # the format's writer keeps 16 digits
    )


def test_what_is_not_determined_is_blank_and_named(single_tool_solution, tmp_path):
    title, note = "=1+1", "@SUM(A1)"
    campaign = replace(single_tool_solution.campaign, title=title, conditions={"note": note})
    volid.save_workbook(replace(single_tool_solution, campaign=campaign), tmp_path / "result.xlsx", lang="de")
    book = openpyxl.load_workbook(tmp_path / "result.xlsx")
    unknown = {r.name for r in single_tool_solution.functions() if np.isnan(r.value) and r.name[2] != "0"}
    assert unknown
    for name in unknown:
        heading, rows = table(book, f"Funktionen {name[2]}")
        (j,) = [j for j, title in enumerate(heading) if title.startswith(f"{name} [")]
        assert any(row[j] is None for row in rows)
    texts = [row[1] for row in table(book, "Nicht bestimmt")[1]]
    cells = [cell for sheet in book for row in sheet.iter_rows() for cell in row]
    assert not [cell for cell in cells if cell.data_type == "f"]
    assert {title, note} <= {cell.value for cell in cells}
    assert book.sheetnames[0] == "Ergebnis"
    assert set(single_tool_solution.statements) <= set(texts)


def test_missing_items_of_the_record_are_named(solution, book):
    assert "load" not in solution.campaign.conditions
    missing = [row[0] for row in table(book, "Campaign")[1] if row[2] == "NOT RECORDED"]
    assert {"load", "feed"} <= set(missing)


def test_sheets_have_filters_and_headings_that_stay(book):
    for sheet in book:
        assert len(sheet.title) <= 31 and not set(sheet.title) & set("[]:*?/\\'")
        assert sheet.freeze_panes == "A2" and sheet.auto_filter.ref and sheet.print_title_rows == "$1:$1"


def test_foreign_texts_are_never_run(tmp_path):
    table = Table("Texts", [Column("=text", width=20)], [[text] for text in EVIL])
    write_workbook(tmp_path / "evil.xlsx", [table], EVIL[0])
    cells = [row[0] for row in openpyxl.load_workbook(tmp_path / "evil.xlsx")["Texts"].iter_rows()]
    assert not [cell for cell in cells if cell.data_type == "f" or cell.hyperlink]
    assert [cell.value for cell in cells] == ["=text", *("\\x07" if text == "\x07" else text for text in EVIL)]


def test_a_long_table_goes_on_on_a_second_sheet(tmp_path, monkeypatch):
    monkeypatch.setattr("volid.report.workbook.write.ROWS", 10)
    long = Table("Long", [Column("number")], ([float(i)] for i in range(25)))
    write_workbook(tmp_path / "long.xlsx", [long], "long")
    book = openpyxl.load_workbook(tmp_path / "long.xlsx")
    assert book.sheetnames == ["Long", "Long 2", "Long 3"]
    numbers = [row[0] for sheet in book for row in sheet.iter_rows(min_row=2, values_only=True)]
    assert numbers == list(range(25))


def test_an_existing_file_is_kept(solution, tmp_path):
    (tmp_path / "result.xlsx").write_text("mine")
    with pytest.raises(OutputError, match="exists"):
        volid.save_workbook(solution, tmp_path / "result.xlsx")
    assert (tmp_path / "result.xlsx").read_text() == "mine"


def test_no_numbers_behind_the_barrier(solution, tmp_path):
    question = Question("the readings are negated", about_values=True)
    adequacy = replace(solution.adequacy, questions=(question,))
    with pytest.raises(InputError, match="the readings are negated"):
        volid.save_workbook(replace(solution, adequacy=adequacy), tmp_path / "result.xlsx")


def test_limits_and_what_types_leave(tmp_path):
    solution = volid.fit(volid.load_campaign("datasets/published_positioning/campaign.toml"))
    volid.save_workbook(solution, tmp_path / "result.xlsx", limits={"EXX": 0.030, "EZZ": 0.040}, lang="de")
    book = openpyxl.load_workbook(tmp_path / "result.xlsx")
    found = {row[0]: row for row in table(book, "Grenzwerte")[1]}
    assert found["EXX"][1] == pytest.approx(31.8, abs=0.05) and found["EXX"][3] == 30.0  # published: E = 31.8 µm
    assert (found["EXX"][5], found["EZZ"][5]) == ("nicht erfüllt", "erfüllt")
    rule = found["EXX"][6]
    assert "Schutzabstand" in rule and ": erfüllt bis Grenzwert" in rule and "nicht erfüllt über" in rule
    assert not {"pass", "fail", "conditionalPass"} & set(rule.replace(",", " ").replace(":", " ").split())
    base = volid.compensation_base(solution, (0.0, 0.0, 0.0))
    expected = volid.forecast(solution, [["L-POS"]], base, np.zeros((1, 3)), most_draws=400).columns
    rows = [row for row in table(book, "Kompensation")[1] if row[4] == "größte"]
    for name, column in zip(("ohne", "L-POS"), expected, strict=True):
        (row,) = [row for row in rows if row[0] == name]
        (p,) = column.predictions
        assert row[5:9] == pytest.approx([1e3 * v[0] for v in p], rel=1e-9)


def test_a_solution_fitted_part_by_part_says_why_it_has_no_budget(tmp_path):
    campaign = volid.load_campaign("datasets/published_positioning/campaign.toml")
    volid.save_campaign(campaign, tmp_path / "campaign.h5")
    solution = volid.fit_streamed(volid.CampaignStream(tmp_path / "campaign.h5"))
    volid.save_workbook(solution, tmp_path / "result.xlsx")
    book = openpyxl.load_workbook(tmp_path / "result.xlsx")
    ((*_, reason, _, _, _),) = table(book, "Budget")[1]
    assert "budget" in reason and "Functions X" in book.sheetnames
