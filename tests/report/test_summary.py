"""The summary: the verdict first, numbers that are the solution's own, units and uncertainties beside them."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from support.small_campaign import SINGLE_TOOL, SOLUTIONS

from volid.compensation.residual.volume import volumetric_summary
from volid.report.text.basics import WIDTH, micro, table, vector
from volid.report.text.summary import summary, summary_data
from volid.report.text.summary_lines import decimals, format_summary


@pytest.fixture(scope="module")
def data(solution):
    return summary_data(solution)


@pytest.fixture(scope="module")
def text(data):
    return format_summary(data)


def line(text, start):
    """The first line that begins with `start`."""
    return next(line for line in text.splitlines() if line.startswith(start))


# ---------------------------------------------------------------------------------------------------------- numbers


@pytest.mark.parametrize("name", SOLUTIONS)
def test_data_is_json_without_nan(name, request):
    found = summary_data(request.getfixturevalue(name))
    assert json.loads(json.dumps(found, allow_nan=False)) == found


def test_numbers_are_those_of_the_solution(data, solution):
    assert data["accepted"]
    assert (data["n_readings"], data["degrees_of_freedom"]) == (360, 360 - data["n_parameters"])
    assert data["unit_weight"] == solution.adequacy.unit_weight
    squareness = {s["name"]: s for s in data["squareness"]}
    assert set(squareness) == {"EC0Y", "EA0Z", "EB0Z"}
    assert squareness["EC0Y"]["value"] == solution.location("EC0Y").value
    assert squareness["EC0Y"]["U"] == 2.0 * solution.location("EC0Y").u
    table = {f["name"]: f for f in data["functions"]}
    values = [row for row in solution.functions(points=101) if row.name == "EYX"]
    assert table["EYX"]["range"] == pytest.approx(np.ptp([v.value for v in values]), rel=1e-12)
    assert table["EYX"]["largest_u"] == max(v.u for v in values)
    assert table["EYX"]["segments"] == [2]
    assert len(table) == 18
    accuracy = volumetric_summary(solution, solution.most_used_tool()).accuracy
    assert list(data["volume"]["accuracy"].values()) == accuracy.tolist()


def test_functions_come_axis_by_axis(data):
    names = [f["name"] for f in data["functions"]]
    assert names == [f"E{c}{a}" for a in "XYZ" for c in "XYZABC"]


def test_squareness_holds_on_the_virtual_machine(data, virtual):
    """Signs and units: the truth lies within 4 u of what the summary says."""
    for constant in (*data["squareness"], *data["tool_frame"]):
        error = constant["value"] - virtual.truth.constants[constant["name"]]
        assert abs(error) < 4 * constant["u"]
        assert constant["u"] < 5e-6  # rad: not trivially true


def test_compensation_is_expected_to_help(data):
    before, after = data["volume"]["before"], data["volume"]["after"]
    assert after["type"] == "L-VOL"
    assert after["max_interval_95"][0] < after["max"] < after["max_interval_95"][1]
    assert after["max"] < 0.2 * before["max"]
    assert after["rms"] < after["max"]


def test_weakest_is_the_largest_u(data, solution):
    u = {r.name: 0.0 for r in solution.functions()}
    for r in solution.functions(points=101):
        u[r.name] = max(u[r.name], r.u * (1e3 if r.name[1] in "XYZ" else 1e6))
    assert data["weakest"]["name"] == max(u, key=u.get)
    assert data["weakest"]["u"] * 1e6 == pytest.approx(max(u.values()))


def test_the_most_used_tool_is_taken(solution, single_tool_solution):
    assert single_tool_solution.most_used_tool() == SINGLE_TOOL
    assert solution.most_used_tool() == tuple(solution.campaign.sets[0].tool[0])  # all alike: the first
    assert summary_data(solution, (1.0, 2.0, 3.0))["tool"] == [1.0, 2.0, 3.0]


def test_what_is_not_determined_has_no_number(single_tool_solution):
    found = summary_data(single_tool_solution)
    functions = {f["name"]: f for f in found["functions"]}
    assert functions["ECZ"]["range"] is None
    assert functions["ECZ"]["largest_u"] is None
    assert functions["EXX"]["range"] > 0.0
    assert found["not_determined"] == list(single_tool_solution.statements)
    assert found["held_tool_frame"] == ["EA0S", "EB0S", "EC0S"]
    assert found["weakest"]["name"] in {f["name"] for f in found["functions"] if f["range"] is not None}


def test_components_of_a_set_keep_their_unit(rich_solution):
    found = summary_data(rich_solution)
    levels = next(s for s in found["sets"] if s["set"] == "levels")
    assert (levels["kind"], levels["unit"], levels["n_readings"]) == ("component A", "rad", 22)
    assert levels["u_rms"] == pytest.approx(1e-6)
    assert 0.3e-6 < levels["residual_rms"] < 2e-6
    repeats = next(r for r in found["repeats"] if r["set"] == "levels")
    assert (repeats["n"], repeats["unit"]) == (11, "rad")


def test_reversal_is_listed(rich_solution):
    found = {f["name"]: f["largest_reversal"] for f in summary_data(rich_solution)["functions"]}
    rows = [r for r in rich_solution.functions(points=101) if r.name == "EXX"]
    plus, minus = ([r.value for r in rows if r.direction == d] for d in (1, -1))
    assert found["EXX"] == pytest.approx(abs(plus[0] - minus[0]))
    assert found["EYY"] > 0.0
    assert found["EZX"] is None


# ------------------------------------------------------------------------------------------------------------- text


@pytest.mark.parametrize("name", SOLUTIONS)
def test_text_fits_on_a_screen(name, request):
    lines = summary(request.getfixturevalue(name)).splitlines()
    assert len(lines) <= 72  # of which likely causes take eight where the model is rejected
    # a reading is named by its file, whose path may be longer than a screen is wide
    assert max(len(line) for line in lines if ", row " not in line) <= WIDTH
    assert all(line == line.rstrip() for line in lines)
    assert "nan" not in " ".join(lines).lower().replace("nanometre", "")


def test_active_compensations_are_named_and_what_the_errors_are_relative_to(solution):
    """ISO/TR 16907 10.4: the fit says which state its result is relative to."""
    stated = {
        "active_compensations": ["L-POS: tables of EXX, EYY", "thermal"],
        "second.h5": {"active_compensations": "L-POS"},
    }
    compensated = replace(solution, campaign=replace(solution.campaign, conditions=stated))
    data = summary_data(compensated)
    assert data["active_compensations"] == ["L-POS: tables of EXX, EYY", "thermal", "L-POS"]
    said = " ".join(format_summary(data).split())
    assert "active L-POS: tables of EXX, EYY; thermal; L-POS. The errors below are those that remain with them" in said
    plain = replace(solution, campaign=replace(solution.campaign, conditions={"active_compensations": []}))
    assert not any(row.startswith("active") for row in format_summary(summary_data(plain)).splitlines())


def test_verdict_comes_first(text, rejected_solution):
    assert text.splitlines()[0] == "Model accepted by the data."
    assert "REJECTED" not in text
    lines = summary(rejected_solution).splitlines()
    assert lines[0] == "*** MODEL REJECTED BY THE DATA: the uncertainties below do not hold ***"
    assert lines[1].startswith("Model rejected by the data (unit weight")


def test_micrometres_and_microradians_with_their_uncertainty(text, data):
    constant = next(s for s in data["squareness"] if s["name"] == "EC0Y")
    row = line(text, "EC0Y")
    numbers = re.findall(r"-?\d+\.\d+", row)
    assert float(numbers[0]) == pytest.approx(constant["value"] * 1e6, abs=0.06)
    assert float(numbers[1]) == pytest.approx(constant["U"] * 1e6, abs=0.06)
    assert "µm/m" in row and "EC(0X)Y, angle between +X and +Y" in row
    assert constant["symbol"] == "EC(0X)Y" and abs(constant["value"]) > constant["U"]
    assert ("larger than 90°" in row) == (constant["value"] > 0)  # +Y leans to -X
    function = next(f for f in data["functions"] if f["name"] == "EXX")
    words = line(text, "EXX").split()
    assert words[1:4] == ["positioning", "of", "X"]
    assert float(words[4]) == pytest.approx(function["range"] * 1e3, abs=0.006)
    assert words[6:] == ["µm", "2", "segments"]
    assert line(text, "EBX").split()[-3:] == ["µrad", "2", "segments"]
    assert "U (k = 2)" in text
    assert "tool (0, 0, -150) mm" in text


def test_head_names_machine_campaign_and_datum(text):
    assert line(text, "machine") == "machine   Testmaschine Ω  [w Y' X' b Z (C) t]"
    assert line(text, "travel") == "travel    X 0 … 1000 mm; Y 0 … 600 mm; Z -500 … 0 mm"
    assert line(text, "campaign") == "campaign  Abnahme 2026"
    assert line(text, "datum").startswith("datum     primary axis X, secondary axis Y; zero at X = 500")
    assert "108 parameters, 252 degrees of freedom" in " ".join(text.split())


def test_missing_things_are_said_verbatim(single_tool_solution):
    text = summary(single_tool_solution)
    flat = " ".join(text.split())
    assert "NOT DETERMINED by the data: - " in flat
    for statement in single_tool_solution.statements:
        assert " ".join(statement.split()) in flat
    assert "EA0S, EB0S, EC0S: tool-frame constants held at 0" in flat
    assert line(text, "ECZ").split()[-5:] == ["n.d.", "n.d.", "µrad", "2", "segments"]
    for note in single_tool_solution.notes:
        assert f"- {note}" in flat


def test_outliers_are_listed_with_file_row_and_size(outlier_solution):
    text = summary(outlier_solution)
    n = len(outlier_solution.readings.outlier_readings)
    assert n >= 10
    assert f"{n} readings set aside as outliers" in text
    worst = outlier_solution.readings.outlier_readings[0]
    row = next(line for line in text.splitlines() if line.endswith(worst.where))
    assert row.split()[0] == micro(worst.residual, "mm", 1)
    assert row.split()[1] == "µm"
    assert text.count("volume.csv, row") == 10  # the first ten


def test_suspects_are_listed_when_nothing_was_set_aside(rejected_solution):
    text = summary(rejected_solution)
    assert f"{len(rejected_solution.adequacy.suspects)} readings beyond the critical value" in text


def test_unmeasured_travel_is_shown(data):
    axes = [a | {"measured": [10.0, 480.0]} if a["axis"] == "X" else a for a in data["axes"]]
    assert "X 0 … 1000 mm (measured 10 … 480); Y" in format_summary(data | {"axes": axes})


def test_unconverged_and_unredundant_fits_are_named(data):
    text = format_summary(
        data | {"converged": False, "degrees_of_freedom": 0, "unit_weight": None, "probability": None}
    )
    assert "*** NOT CONVERGED" in text.splitlines()[0] and "accepted" not in text.splitlines()[1]
    assert "no redundancy" in text


def test_location_errors_of_a_rotary_axis(rotary_solution):
    text = summary(rotary_solution)
    assert line(text, "EX0C").split()[-1] == "µm"
    assert line(text, "EA0C").split()[-1] == "µrad"
    found = rotary_solution.location("EX0C").value
    row = line(text, "EX0C")
    assert "error of the position of C in X direction" in row
    value = float(row.split("direction")[1].split()[0])
    parameter = float(rotary_solution.parameters[rotary_solution.model.by_name["EX0C", "location"].parameters.start])
    assert value == pytest.approx(1e3 * found, abs=0.06) and found == -parameter  # C' carries the workpiece
    assert "axis average line in the machine frame" in text and all(len(row) <= WIDTH for row in text.splitlines())
    assert "V_XYZC, ranges" in text
    assert "not in the model: EXX, EYX, EZX, EAX, EBX, ECX, … (18 functions)" in text
    assert "not predicted: the model leaves out error functions" in text
    assert line(text, "travel").endswith("C 0 … 360 °")


def test_forecast_after_two_types_or_none(data):
    after = data["volume"]["after"] | {"type": "L-VOL + R-VOL"}
    assert "after L-VOL + R-VOL, expected largest" in " ".join(
        format_summary(data | {"volume": data["volume"] | {"after": after}}).split()
    )
    assert "thermal change" not in format_summary(data), "none is stated"
    warm = {"after": data["volume"]["after"] | {"thermal_limit": 0.003}}
    said = " ".join(format_summary(data | {"volume": data["volume"] | warm}).split())
    assert "thermal change up to 3.0 µm on top" in said
    volume = data["volume"] | {"after": None, "not_predicted": "not determined for this tool vector"}
    text = format_summary(data | {"volume": volume})
    assert line(text, "after L-VOL, expected").endswith("not predicted: not determined for this tool vector")
    assert "largest n.d." not in text


def test_what_the_model_leaves_out_is_no_zero(data):
    accuracy = data["volume"]["accuracy"] | {"Y": 0.0, "Z": 1e-4}
    left = {"accuracy": accuracy, "left_out": ["EYX", "EBX"], "after": None}
    text = format_summary(data | {"volume": data["volume"] | left})
    assert line(text, "V_XYZ").split()[-5:-3] == ["–", "0.1"]
    assert "not in the model: EYX, EBX; their effect is not in these numbers" in text
    assert data["volume"]["left_out"] == []


# --------------------------------------------------------------------------------------------------------- formats


@pytest.mark.parametrize(
    ("value", "unit", "digits", "expected"),
    [
        (0.0123456, "mm", 2, "12.35"),
        (-1.25e-6, "rad", 1, "-1.2"),
        (-1e-9, "mm", 1, "0.0"),
        (None, "mm", 1, "n.d."),
    ],
)
def test_numbers_in_micro_units(value, unit, digits, expected):
    assert micro(value, unit, digits) == expected


@pytest.mark.parametrize(("u", "expected"), [(0.0123, 3), (0.123, 2), (1.23, 1), (12.3, 0), (123.0, 0), (1e-9, 3)])
def test_two_digits_of_the_uncertainty_are_shown(u, expected):
    assert decimals(u) == expected


def test_tables_are_aligned():
    assert table(["name", "value"], [["a", "1.0"], ["longer", "-12.0"]]) == [
        "name    value",
        "a         1.0",
        "longer  -12.0",
    ]
    assert vector([0.0, 2.5, -150.0]) == "(0, 2.5, -150)"
