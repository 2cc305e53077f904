"""Rotary axes of which a part was measured, more than a turn, or one position alone; and a linear axis that stood still.

Truths are random, in the datum of the measured range, and measured by the independent chain of exact matrices; the machine file
states a longer travel.
"""

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from exact_chain import ExactMachine, random_truth
from support.machines import LINEAR_OFF, POINTS, STRUCTURES, volid_machine
from support.rtests import index_grid, r_test, r_test_campaign, rotary_only

import volid
from volid.cli import main
from volid.fitting.location_errors import location_parameter

CASES = Path(__file__).parent
CLAMPED_C = CASES / "23_c_clamped_a_swept" / "campaign.toml"
PART_OF_C = CASES / "24_part_of_a_long_rotary_travel" / "campaign.toml"
LINEAR = {"X": (-300.0, 300.0), "Y": (-300.0, 300.0), "Z": (-100.0, 450.0)}
FAR = 5.0  # u: of some 150 correlated values none is farther off by chance
TURN = (-180.0, 180.0)
RANGES = [  # layout, travel of C in the machine file, what of it is measured, over what its errors are those of
    ("tilting table C'A'", (-200.0, 200.0), (-90.0, 90.0), (-90.0, 90.0)),
    ("tilting table C'A'", (-400.0, 400.0), (-30.0, 300.0), TURN),  # all around but for 30°: errors of a turn repeat
    ("fork head CB", (-400.0, 400.0), (-250.0, 20.0), (-250.0, 20.0)),
    ("tilting table C'A'", (-400.0, 400.0), (-300.0, 300.0), TURN),
]


def run(capsys, *arguments):
    """Exit status, standard output and standard error of a command; a traceback fails the test by itself."""
    status = main([str(a) for a in arguments])
    return status, *capsys.readouterr()


def exact_machine(layout, travel_of_c):
    structure = STRUCTURES[layout]
    letters = [c for c in structure if c in "XYZABC"]
    travel = {a: LINEAR.get(a, travel_of_c if a == "C" else (-60.0, 60.0)) for a in letters}
    return ExactMachine(structure, travel, point={a: POINTS[a] for a in letters if a in POINTS})


def with_travel(machine, letter, travel):
    axes = tuple(replace(a, travel=travel) if a.letter == letter else a for a in machine.axes)
    return replace(machine, axes=axes)


def measured(layout, travel, part, own, counts):
    """Truth in the datum of `own`, and solution of a machine with `travel` of C, of which `part` is measured by an R-test."""
    exact = exact_machine(layout, part)
    rng = np.random.default_rng(7)
    truth = rotary_only(random_truth(exact_machine(layout, own), rng))
    data = r_test(exact, truth, rng, counts=counts)
    machine = with_travel(volid_machine(exact, f"[model.functions]\n{LINEAR_OFF}"), "C", travel)
    return exact, truth, volid.fit(r_test_campaign(machine, data))


@pytest.mark.parametrize(("layout", "travel", "part", "own"), RANGES)
def test_a_part_of_a_rotary_travel_is_fitted_on_what_was_measured(layout, travel, part, own, tmp_path, capsys):
    exact, truth, solution = measured(layout, travel, part, own, {"A": 9, "B": 9, "C": 25})
    assert not solution.adequacy.rejected, solution.adequacy.verdict
    assert solution.measured_range()[solution.machine.index("C")].tolist() == list(part)
    off = []
    for name, function in truth.functions.items():
        low, high = exact.travel[name[2]]
        rows = solution.motion(name, np.linspace(max(low, -180.0), min(high, 180.0), 11))
        largest = max(row.u for row in rows)
        off += [(r.value - float(function(r.position))) / r.u for r in rows if r.u > 1e-3 * largest]
    for name in (n for n in solution.model.names if n[2] == "0"):
        found = location_parameter(solution, name)
        if np.isfinite(found.value):
            off.append((found.value - truth.constants.get(name, 0.0)) / found.u)
    assert len(off) > 100
    assert np.abs(off).max() < FAR
    assert 0.5 < np.sqrt(np.mean(np.square(off))) < 1.4
    every_output(solution, None if own == TURN else part, tmp_path, capsys)


def every_output(solution, part, tmp_path, capsys):
    """functions, grid, errors and summary of a solution are of the measured `part` of C, None where that is a turn."""
    path, points = tmp_path / "s.h5", tmp_path / "points.csv"
    solution.save(path)
    status, out, _ = run(capsys, "functions", path, "--json")
    at = [row[2] for row in json.loads(out)["rows"] if row[0] == "ECC"]
    assert (status in (0, 1), part is None or (min(at), max(at)) == part) == (True, True)
    low, high = solution.measured_range()[solution.machine.index("C")]
    reach = (
        () if part else ("--range", f"C={low:g}:{high:g}")
    )  # a turn is more than was measured, which a grid would name
    status, out, err = run(capsys, "grid", path, "--type", "R-VOL", "--points", "5", "--json", *reach)
    assert status in (0, 1), err
    grids = json.loads(out)["grids"]
    nodes = [row[g["columns"].index("C")] for g in grids if "C" in g["columns"] for row in g["rows"]]
    assert part is None or (min(nodes), max(nodes)) == part
    letters = solution.machine.letters
    inside = [0.5 * (low + high) for low, high in solution.measured_range()]
    with points.open("w", newline="", encoding="utf-8") as stream:
        csv.writer(stream).writerows([[*letters, "tool_x", "tool_y", "tool_z"], [*inside, 0, 0, -150]])
    status, out, _ = run(capsys, "errors", path, "--at", points, "--json")
    sheet = json.loads(out)
    assert (status in (0, 1), sheet["rows"][0][sheet["columns"].index("outside")]) == (True, 0)
    status, out, _ = run(capsys, "summary", path)
    assert status in (0, 1)
    assert f"C {solution.campaign.machine.axis('C').travel[0]:g} …" in out


def test_the_case_of_a_fork_head_is_fitted_on_what_was_measured(tmp_path, capsys):
    """C -90 … 90 of -200 … 200: was "6 segments do not refine 4 segments". One sphere: what it leaves open is named."""
    path = tmp_path / "s.h5"
    status, out, err = run(capsys, "fit", PART_OF_C, "-o", path)
    text = " ".join(out.split())
    assert status == 1, err
    assert "Model accepted by the data, but not everything is determined" in text
    assert "C -200 … 200 ° (measured -80 … 80)" in text
    assert "C -80 … 80 of -200 … 200 °" in text
    assert "one sphere place only; use three that do not lie on one line" in text
    status, out, _ = run(capsys, "functions", path, "--step", "20", "--json")
    at = [row[2] for row in json.loads(out)["rows"] if row[0] == "EXC"]
    assert (status, at) == (1, [float(c) for c in range(-80, 81, 20)])


OUTPUTS = [  # verb, arguments, exit status
    ("summary", (), 1),
    ("functions", (), 1),
    ("locations", (), 1),
    ("errors", ("--at", "{points}"), 1),
    ("budget", ("--at", "{points}"), 1),
    ("budget", (), 1),
    ("uncertainty", ("--trials", "20"), 1),
    ("grid", ("--type", "R-VOL", "--points", "3"), 1),
    ("tables", ("--type", "R-VOL", "-o", "{folder}"), 1),
    ("tables", ("--type", "R-POS", "-o", "{folder}"), 1),
    ("residual", ("--type", "R-VOL", "--points", "3"), 1),
]


def outputs(solution, tmp_path, capsys, verbs=OUTPUTS):
    """Everything that the command line says of a solution; every verb ends in its status, and none speaks of a symbol."""
    path, points = tmp_path / "s.h5", tmp_path / "points.csv"
    solution.save(path)
    letters = solution.machine.letters
    middle = [0.5 * (low + high) for low, high in solution.measured_range()]
    with points.open("w", newline="", encoding="utf-8") as stream:
        csv.writer(stream).writerows([[*letters, "tool_x", "tool_y", "tool_z"], [*middle, 0, 0, -180]])
    said = {}
    for i, (verb, arguments, expected) in enumerate(verbs):
        places = {"points": points, "folder": tmp_path / f"tables{i}"}
        status, out, err = run(capsys, verb, path, *(a.format(**places) for a in arguments))
        assert status == expected, (verb, err)
        assert "is not an ISO 230-1 error symbol" not in err
        said[verb] = out + err
    return said


def test_c_clamped_while_a_is_swept(tmp_path, capsys):
    """Was "'EXC,' is not an ISO 230-1 error symbol": nothing of C is determined, everything of A is."""
    solution = volid.fit(volid.load_campaign(CLAMPED_C))
    rows = {name: [r for r in solution.functions() if r.name == name] for name in solution.model.names}
    of_c = [n for n in rows if n.endswith("C")]
    of_a = [n for n in rows if n.endswith("A")]
    assert (len(of_c), len(of_a)) == (10, 10)  # six motions and four locations each
    assert all(np.isnan(r.value) or r.position % 360.0 == 0.0 for n in of_c for r in rows[n])  # 0 there by the datum
    assert all(np.isnan(r.value).any() for n in of_c for r in rows[n][1:-1])
    assert all(np.isfinite([r.value for r in rows[n]]).all() for n in of_a)
    text = " ".join(solution.statements)
    assert all(n in text for n in of_c)
    assert "axis C was measured at 1 position only" in text
    said = outputs(solution, tmp_path, capsys)
    assert "EX0C, EY0C, EA0C, EB0C" in said["locations"]


def with_rows(readings, rows):
    labels = {k: v[rows] for k, v in readings.labels.items()}
    kept = {n: getattr(readings, n)[rows] for n in ("positions", "directions", "tool", "readings", "u")}
    return replace(readings, labels=labels, rows=None, **kept)


def test_a_clamped_while_c_is_swept(tmp_path, capsys):
    """By the independent chain: the error motions of C are determined and true, nothing of A is."""
    exact = exact_machine("tilting table C'A'", (-180.0, 180.0))
    rng = np.random.default_rng(3)
    truth = rotary_only(random_truth(exact, rng))
    data = r_test(exact, truth, rng, counts={"A": 1, "C": 37})
    assert set(index_grid(exact, {"A": 1, "C": 37})[:, exact.column("A")]) == {0.0}
    campaign = r_test_campaign(volid_machine(exact, f"[model.functions]\n{LINEAR_OFF}"), data)
    solution = volid.fit(campaign)
    unknown = {r.name for r in solution.functions() if np.isnan(r.value)}
    assert {"EXA", "EYA", "EZA", "EAA", "EBA", "ECA", "EY0A", "EZ0A"} <= unknown
    assert "axis A was measured at 1 position only" in " ".join(solution.statements)
    off = []
    for name in ("EXC", "EYC", "EZC", "EAC", "EBC"):
        rows = solution.motion(name, np.linspace(-180.0, 180.0, 13))
        assert np.isfinite([r.value for r in rows]).all(), name
        off += [(r.value - float(truth.functions[name](r.position))) / r.u for r in rows]
    assert np.abs(off).max() < FAR
    outputs(solution, tmp_path, capsys, [v for v in OUTPUTS if v[0] in ("summary", "functions", "errors", "locations")])


def test_a_linear_axis_clamped(tmp_path, capsys):
    """Y stood at 300 mm: its six motions and what needs them are named, X and Z are determined."""
    plan = volid.standard_plan(volid.load_machine(CASES.parents[1] / "models" / "wYXbZt_vertical.toml"), 60)
    readings = plan.sets[0]
    still = readings.positions.copy()
    still[:, plan.machine.index("Y")] = 300.0
    campaign, _ = volid.simulate(replace(plan, sets=(replace(readings, positions=still),)), seed=2)
    solution = volid.fit(campaign)
    unknown = {r.name for r in solution.functions() if np.isnan(r.value)}
    assert unknown == {"EXY", "EYY", "EZY", "EAY", "EBY", "ECY", "EC0Y", "EA0Z", "EA0S"}
    verbs = [v for v in OUTPUTS if v[0] in ("summary", "functions", "errors", "budget", "uncertainty")]
    verbs += [(v, ("--type", "L-VOL", *more), 1) for v, more in (("grid", ("--points", "3")), ("residual", ()))]
    verbs.append(("tables", ("--type", "L-VOL", "--tool", "0,0,-150", "-o", "{folder}"), 1))
    said = outputs(solution, tmp_path, capsys, verbs)
    assert "axis Y was measured at 1 position only" in said["tables"]
