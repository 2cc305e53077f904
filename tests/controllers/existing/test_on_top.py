"""A machine with an old compensation file: measured with it active, corrected again, and the sum loaded (ISO/TR 16907 10.5).

The machine is the exact chain, the old files are written by hand, and drives go where the lines of a COMP_FILE say: read here
with NumPy alone, for the old files and for those that volid writes.
"""

import numpy as np
import pytest
from exact_chain import ExactMachine, Truth, machine_toml

import volid
from volid.cli import main
from volid.compensation.tables.sampling import Sampling

EXACT = ExactMachine("w Y' X' b Z t", {"X": (0, 1000), "Y": (0, 600), "Z": (-500, 0)})
MACHINE = machine_toml(EXACT) + (
    '[model]\ndegree = 1\n[model.functions]\n"E*" = false\nEXX = { segments = 40, reversal = true }\n'
)
FINE = Sampling(step=25.0)
TARGETS = np.linspace(0.0, 1000.0, 41)
# compensates 12 µm at mid-travel, and 4 µm of reversal: too little of the errors below, as an old file does
OLD = "0 0.000 0.004\n500 500.012 500.016\n1000 1000.000 1000.004\n"
TRUTH = Truth(
    functions={"EXX": lambda x: 0.030 * np.sin(np.pi * x / 1000) + 0.004 * np.sin(6 * np.pi * x / 1000)},
    reversal={"EXX": lambda x: -0.006 + 0.0 * x},  # B = E(+) - E(-)
)
HEAD = """\
format = "volid-campaign/1"
machine = "machine.toml"
title = "with an old file"
[conditions]
active_compensations = {active}
[[set]]
name = "X"
kind = "component"
file = "X.csv"
tool = [0.0, 0.0, 0.0]
u = 2e-4
"""
ENTRY = '[{ file = "x.comp", cnc = "linuxcnc" }]'


def motor(text, q, way):
    """Where a motor goes: columns nominal, actual in +, actual in -, linear between them; the rule of LinuxCNC, type 0."""
    if not text:
        return q
    rows = np.array([[float(v) for v in line.split()] for line in text.splitlines()])
    return q - np.interp(q, rows[:, 0], rows[:, 1 if way > 0 else 2] - rows[:, 0])


def deviation(text, q, way):
    """Deviation in X where the file `text` is loaded, moving in one direction, by the exact chain [mm]."""
    stand = np.tile(np.array([[300.0, 0.0, -250.0]]), (len(q), 1))  # Y, X, Z
    stand[:, 1] = motor(text, q, way)
    ways = np.zeros_like(stand)
    ways[:, 1] = way
    error = EXACT.deviation(stand, np.zeros(3), TRUTH, ways)[:, 0]
    return stand[:, 1] - q + error


def largest(text, q):
    """Largest deviation, counted from that at mid-travel, where the functions are zero by the datum."""
    middle = np.mean([deviation(text, np.array([500.0]), way) for way in (1.0, -1.0)])
    return max(np.abs(deviation(text, q, way) - middle).max() for way in (1.0, -1.0))


def measured(folder, text, active):
    """The campaign of a laser along X, both directions, without noise, with a file loaded."""
    (folder / "machine.toml").write_text(MACHINE)
    (folder / "x.comp").write_text(OLD)
    (folder / "campaign.toml").write_text(HEAD.replace("{active}", active))
    rows = [
        f"{x!r},300,-250,{way:+d},X,{v!r}"
        for way in (1, -1)
        for x, v in zip(TARGETS.tolist(), deviation(text, TARGETS, way).tolist(), strict=True)
    ]
    (folder / "X.csv").write_text("\n".join(["X,Y,Z,X_dir,component,value", *rows, ""]))
    return folder / "campaign.toml"


def comp(made):
    return next(f.content for f in made.written.files if f.name.endswith("x.comp"))


@pytest.fixture(scope="module")
def solution(tmp_path_factory):
    return volid.fit(volid.load_campaign(measured(tmp_path_factory.mktemp("old"), OLD, ENTRY)))


def test_the_sum_removes_the_deviation_and_the_remainder_alone_brings_the_old_errors_back(solution):
    between = TARGETS[:-1] + 12.5
    before = largest(OLD, between)
    existing = volid.recorded_compensations(solution.campaign)
    ways = {"sum": existing, "remainder": ()}
    made = {n: comp(volid.export(solution, "linuxcnc", ["L-POS"], sampling=FINE, add_to=o)) for n, o in ways.items()}
    assert before > 0.010
    # straight lines over 25 mm miss a wave of 4 µm and 333 mm by 4 µm (2π 25/333)²/8 = 0.11 µm, in the fit and in the table
    assert largest(made["sum"], between) < 0.0003
    assert largest(made["remainder"], between) > 0.010


def test_files_say_to_which_state_they_belong(solution):
    (existing,) = volid.recorded_compensations(solution.campaign)
    alone = volid.export(solution, "linuxcnc", ["L-POS"])
    (warned,) = [n for n in alone.notes if "REPLACE" in n]
    assert existing.words in warned and "`volid.recorded_compensations`" in warned
    both = volid.export(solution, "linuxcnc", ["L-POS"], add_to=[existing])
    assert (
        f"the new files are a sum with {existing.words}: load them in the place of those, not beside them" in both.notes
    )
    assert not [n for n in both.notes if "REPLACE" in n or "not active" in n]


def test_what_remains_is_predicted_for_the_machine_with_the_old_file(solution):
    """The errors of the solution are those with the old file: only what is added acts on them."""
    old = volid.recorded_compensations(solution.campaign)
    made = volid.export(solution, "linuxcnc", ["L-POS"], sampling=FINE, add_to=old)
    q, way = np.array([[300.0, 112.5, -250.0]]), np.array([[0.0, -1.0, 0.0]])
    middle = np.mean([deviation(OLD, np.array([500.0]), w) for w in (1.0, -1.0)])
    added = (made.added_control().command(q, np.zeros(3), way) - q)[0, 1]
    assert added == pytest.approx(middle - deviation(OLD, q[:, 1], -1.0)[0], abs=3e-4)
    whole = (made.control().command(q, np.zeros(3), way) - q)[0, 1]
    assert whole == pytest.approx(added + motor(OLD, q[:, 1], -1.0)[0] - 112.5, abs=1e-8)


def test_adding_to_what_was_not_active_is_named(tmp_path):
    solution = volid.fit(volid.load_campaign(measured(tmp_path, "", "[]")))
    old = volid.load_compensation([tmp_path / "x.comp"], "linuxcnc", solution.machine)
    notes = volid.export(solution, "linuxcnc", ["L-POS"], add_to=[old]).notes
    assert [n for n in notes if "by the record it was not active" in n and "corrects them twice" in n]


def test_a_model_without_reversal_cannot_describe_a_file_with_one(tmp_path):
    from volid.controllers.existing.state import not_described

    path = measured(tmp_path, OLD, ENTRY)
    (tmp_path / "machine.toml").write_text(MACHINE.replace(", reversal = true", ""))
    solution = volid.fit(volid.load_campaign(path))
    (said,) = not_described(solution, volid.recorded_compensations(solution.campaign))
    assert "EXX jumps by up to 4.0 µm with the direction, and the model has no reversal of EXX" in said


def test_the_commands_do_the_same(tmp_path, capsys):
    path = measured(tmp_path, OLD, ENTRY)
    solution, out = str(tmp_path / "s.h5"), tmp_path / "out"
    main(["fit", str(path), "-o", solution])
    assert "x.comp for linuxcnc" in capsys.readouterr().out  # the summary names the state
    command = ["export", solution, "--cnc", "linuxcnc", "--type", "L-POS", "--step", "25", "-o", str(out), "--force"]
    assert main(command) == 1
    assert (
        "REPLACE it, and its errors come back; add these values to L-POS: x.comp for linuxcnc"
        in capsys.readouterr().err
    )
    assert main([*command, "--add-active"]) == 0
    assert largest((out / "x.comp").read_text(), TARGETS) < 0.0003
    text = (out / "RECORD.md").read_text()
    assert "these files hold the sum of the existing compensation and what remained with it" in text
    added = ["--add-to", str(tmp_path / "x.comp"), "--add-to-cnc", "linuxcnc"]
    assert main([*command, *added]) == 0
    assert largest((out / "x.comp").read_text(), TARGETS) < 0.0003
    tables = tmp_path / "tables"
    assert main(["tables", solution, "--type", "L-POS", "-o", str(tables), "--errors", "--add-active"]) in (0, 1)
    rows = columns(tables / "EXX.csv")
    q, up = rows["X"], rows["EXX(+)"]
    true = TRUTH.functions["EXX"](q) - 0.003
    np.testing.assert_allclose(up - up[0], true - true[0], atol=3e-4)


def columns(path):
    lines = [line for line in path.read_text().splitlines() if not line.startswith("#")]
    names = lines[0].split(",")
    values = np.array([[float(v or "nan") for v in line.split(",")] for line in lines[1:]])
    return dict(zip(names, values.T, strict=True))


def test_residual_tells_the_sum_from_the_remainder(tmp_path, capsys):
    """Files of the control that was active stand in the place of the old ones: the sum leaves nothing, the remainder does."""
    path = measured(tmp_path, OLD, ENTRY)
    solution = str(tmp_path / "s.h5")
    main(["fit", str(path), "-o", solution])
    for name, more in (("sum", ["--add-active"]), ("remainder", [])):
        main(["export", solution, "--cnc", "linuxcnc", "--type", "L-POS", "-o", str(tmp_path / name), *more])
    left = {}
    for name in ("sum", "remainder"):
        capsys.readouterr()
        files = ["--compensation", str(tmp_path / name / "x.comp"), "--compensation-cnc", "linuxcnc"]
        main(
            [
                "residual",
                solution,
                "--tool",
                "0,0,0",
                "--repeatability",
                "0",
                *files,
                "-o",
                str(tmp_path / f"{name}.csv"),
            ]
        )
        assert "the files stand in the place of L-POS: x.comp for linuxcnc" in capsys.readouterr().out
        lines = (tmp_path / f"{name}.csv").read_text().splitlines()
        rows = [line.split(",") for line in lines if line.startswith("x.comp")]
        (left[name],) = [float(row[6]) for row in rows if row[4] == "RMS"]
    # 50 mm between the points: 4 µm of 333 mm wave miss 0.44 µm at most
    assert left["sum"] < 0.0005
    assert left["remainder"] > 0.003
