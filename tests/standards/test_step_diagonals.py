"""Sequential step diagonals: the nine functions, what leaks into them, and what a control makes of them.

Readings are rays that meet planes on exact machines (`exact_chain.diagonals`), without anything of the package.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from exact_chain import ExactMachine, Truth, random_truth
from exact_chain.diagonals import displacements, stepped
from exact_chain.step_cases import (
    CASES,
    TOOL,
    Case,
    U,
    largest_diagonal,
    read,
    separated,
    table,
    truth_of,
    without_rotations,
)
from support.machines import volid_machine
from support.step_diagonals import along_middle, compensated, largest_in_volume, nine_of

import volid
from volid.campaign import Effect
from volid.exceptions import InputError, NotDeterminedError
from volid.io.evaluations.step_diagonals import read_step_diagonals
from volid.planning.diagonals import diagonals, parallel_lines, step_diagonals
from volid.standards.step_diagonals.evaluation import contradiction, evaluate_step_diagonals
from volid.standards.step_diagonals.leak import leak_of, not_known
from volid.standards.step_diagonals.separation import NAMES, separate
from volid.standards.step_diagonals.steps import step_sets, steps_of
from volid.virtual.truth import Truth as VolidTruth

STRUCTURES = ("w X' Y' b Z t", "w b X Y Z t", "w Y' b X Z t", "w Z' Y' X' b t")
BOX = {"X": (0.0, 700.0), "Y": (-200.0, 300.0), "Z": (-450.0, -50.0)}
ROTATIONS = [f"E{c}{a}" for a in "XYZ" for c in "ABC"]


def case_of(structure: str, n: int = 6) -> Case:
    return Case("small", ExactMachine(structure, BOX), n, 0.06, 0.007)


def only(truth: Truth, *names: str) -> Truth:
    """The truth with some functions alone."""
    return Truth({name: truth.functions[name] for name in names})


def as_volid(case: Case, truth: Truth) -> VolidTruth:
    return VolidTruth(volid_machine(case.machine), truth.functions, constants=truth.constants)


def largest_difference(one, other) -> float:
    return max(float(np.abs(a - b).max()) for a, b in zip(one, other, strict=True))


@pytest.mark.parametrize("structure", STRUCTURES)
def test_without_rotations_the_nine_functions_are_the_deviations(structure, tmp_path):
    """Positions, straightness and squareness of any size: to 1e-8 mm, products of errors of 1e-5 and 1e-2 mm."""
    case = case_of(structure)
    truth = without_rotations(random_truth(case.machine, np.random.default_rng(5), scale=0.5))
    nine = nine_of(tmp_path, case, read(case, truth))
    assert largest_difference(nine.values, along_middle(case, truth)) < 1e-6
    assert max(np.ptp(v) for v in nine.values) > 0.005


def test_squareness_and_straightness_are_those_of_the_machine(tmp_path):
    """Closed form: EC0Y alone, EXX a line, EYX a parabola: slopes and ranges by hand."""
    case = case_of("w X' Y' b Z t", 20)
    functions = {"EXX": lambda x: 3e-5 * x, "EYX": lambda x: 0.02 * ((x - 350.0) / 350.0) ** 2}
    truth = Truth(functions, {"EC0Y": 4e-5, "EB0Z": -2e-5, "EA0Z": 1e-5})
    path = tmp_path / "steps.csv"
    path.write_text(table(case, read(case, truth)))
    campaign = read_step_diagonals(path)
    found = evaluate_step_diagonals(campaign.sets[0], campaign)
    assert found["Dx(x)"].value == pytest.approx(3e-5 * 700.0, abs=1e-6)
    for name, value in truth.constants.items():
        assert found[name].value == pytest.approx(value, abs=2e-9), name
    assert found["Dx(y)"].value == pytest.approx(4e-5 * 500.0, abs=1e-6)
    assert found["EYX"].value == pytest.approx(0.02, abs=1e-6)
    assert found["EZX"].value < 1e-6 and found["EXY"].value < 1e-6


def test_the_separation_is_that_of_four_equations_one_by_one(tmp_path):
    case = case_of("w Y' b X Z t")
    found = read(case, random_truth(case.machine, np.random.default_rng(2)), np.random.default_rng(3), tilt=1e-4)
    nine = nine_of(tmp_path, case, found)
    assert largest_difference(nine.values, separated(case, found).values()) < 1e-9


@pytest.mark.parametrize("structure", STRUCTURES)
def test_the_leak_of_every_rotation_is_predicted(structure, tmp_path):
    """Within 1 % of the largest; what is left are products of errors."""
    case = case_of(structure)
    truth = random_truth(case.machine, np.random.default_rng(7), tool_rotation=False)
    for name in [*ROTATIONS, "all"]:
        own = truth if name == "all" else only(truth, name)
        nine = nine_of(tmp_path, case, read(case, own))
        leak = leak_of(nine, as_volid(case, own))
        there = [v - e for v, e in zip(nine.values, along_middle(case, own), strict=True)]
        size = max(np.abs(x).max() for x in there)
        assert largest_difference(leak.total, there) < max(0.01 * size, 2e-6), name
        assert set(leak.by_function) <= set(ROTATIONS)
        if name != "all":
            assert set(leak.by_function) == ({name} if size > 1e-6 else set()), name


def test_the_leak_of_a_mirror_and_of_a_beam_is_predicted(tmp_path):
    case = case_of("w X' Y' b Z t")
    nine = nine_of(tmp_path, case, read(case, Truth()))
    leak = leak_of(nine, as_volid(case, Truth()))
    assert not leak.by_function
    across = {name: np.linalg.svd(w.beam[None, :])[2][1:] for name, w in case.ways().items()}
    tilt = np.array([3e-5, -2e-5])
    found = {name: displacements(case.machine, w, TOOL, Truth(), tilt=tilt) for name, w in case.ways().items()}
    frames = [line.frame[1:] for line in leak.nine.steps.lines]
    turned = np.concatenate([f @ (tilt @ across[n]) for n, f in zip(case.ways(), frames, strict=True)])
    assert largest_difference([t @ turned for t in leak.tilt], nine_of(tmp_path, case, found).values) < 1e-6
    assert max(np.abs(t @ turned).max() for t in leak.tilt) > 0.002
    # a beam turned by 2 mrad, its mirror square to the diagonal: the whole way grows by δ²/2
    found = {n: 0.5 * 2e-3**2 * (case.machine.functional_point(w.q, TOOL) @ w.beam) for n, w in case.ways().items()}
    found = {name: f - f[0] for name, f in found.items()}
    assert largest_difference([2e-3**2 * b for b in leak.beam], nine_of(tmp_path, case, found).values) < 1e-9


def test_the_leak_of_a_simulation_holds_its_mirrors(tmp_path):
    """`volid.simulate` tilts mirrors by up to 20 µrad: some µm, which leak_of finds in the truth beside the campaign."""
    case = case_of("w Y' b X Z t")
    truth = random_truth(case.machine, np.random.default_rng(7))
    plan = step_diagonals(volid_machine(case.machine), case.n)
    campaign, known = volid.simulate(plan, as_volid(case, truth), seed=2, noise=False)
    nine = separate(steps_of(campaign.sets[0], campaign))
    leak = leak_of(nine, known)
    there = [v - e for v, e in zip(nine.values, along_middle(case, truth), strict=True)]
    size = max(np.abs(x).max() for x in there)
    assert leak.mirrors is not None and max(np.abs(m).max() for m in leak.mirrors) > 0.002
    assert largest_difference(leak.total, there) < 0.01 * size
    rows = [row[0] for row in leak.section().rows]
    assert rows[-4:-2] == ["mirrors as simulated", "all together"]


def test_u_is_the_scatter_of_repeated_readings_and_effects_add_to_it(tmp_path):
    case = case_of("w b X Y Z t", 4)
    nine = nine_of(tmp_path, case, read(case, Truth(), np.random.default_rng(0)))
    m, rng = len(nine.steps.observations), np.random.default_rng(1)
    values = [nine.from_readings(row) for row in rng.normal(0.0, U, (4000, m))]
    for axis in range(3):
        scatter = np.std([v[axis] for v in values], axis=0)[1:]
        np.testing.assert_allclose(scatter, nine.u[axis][1:], rtol=0.05)  # four standard deviations of 4000
    # a scale of 1e-6 on everything: 1e-6 of the way, which is all there is at the far end, in Dx(x) alone
    scale = Effect("laser", "scale", 1e-5, "set", {})
    own = replace(nine.steps.observations, effects=(scale,), u=np.full((m, 1), 1e-9))
    campaign = replace(nine.steps.campaign, sets=(own,))
    far = [u[-1] for u in separate(steps_of(own, campaign)).u]
    np.testing.assert_allclose(np.diag(far), 1e-5 * np.array([700.0, 500.0, 400.0]), rtol=1e-5)
    assert max(far[0][1], far[0][2], far[1][0]) < 1e-6
    # positions that repeat within U in every axis scatter the readings by U along the beam
    own = replace(own, effects=(Effect("machine", "repeatability", U, "point", {}),))
    again = separate(steps_of(own, replace(campaign, sets=(own,))))
    assert largest_difference(again.u, nine.u) < 1e-9


def test_contradictions_are_told_where_they_exceed_the_noise(tmp_path):
    case = case_of("w X' Y' b Z t", 10)
    quiet = nine_of(tmp_path, case, read(case, Truth(), np.random.default_rng(4)))
    found, noise, squares, dof = contradiction(quiet)
    assert dof == 5 * 30 and 0.6 * dof < squares < 1.5 * dof and found == pytest.approx(noise, rel=0.2)
    assert evaluate_step_diagonals(quiet.steps.observations, quiet.steps.campaign).attention == ()
    loud = random_truth(case.machine, np.random.default_rng(4), scale=6.0)
    told = nine_of(tmp_path, case, read(case, loud, np.random.default_rng(4)))
    (text,) = evaluate_step_diagonals(told.steps.observations, told.steps.campaign).attention
    assert "the four diagonals contradict each other" in text and "The axes rotate" in text


def test_constant_reversal_stays_out_of_the_nine_functions(tmp_path):
    """It acts where axes turn back, which is between the steps."""
    case = case_of("w X' Y' b Z t")
    truth = Truth(
        {"EXX": lambda x: 1e-5 * x}, reversal={"EXX": lambda x: 0.01 + 0.0 * x, "EZY": lambda y: -0.004 + 0.0 * y}
    )
    nine = nine_of(tmp_path, case, read(case, truth))
    assert largest_difference(nine.values, along_middle(case, Truth(truth.functions))) < 1e-6
    assert nine.steps.both_senses


@pytest.mark.parametrize("key", CASES)
def test_published_case_with_positions_alone_is_compensated_to_noise(key, tmp_path):
    """60 (58) µm before; without rotations nothing but interpolation is left, with noise about what was published."""
    case = CASES[key]
    truth = truth_of(case, 3, rotations=False)
    assert largest_diagonal(case, truth) == pytest.approx(case.before, abs=1e-5)
    control = compensated(tmp_path, case, truth, tilt=0.0)
    assert largest_diagonal(case, truth, control.command) < 0.0001
    assert largest_in_volume(case, truth, control) < 0.0005
    control = compensated(tmp_path, case, truth, np.random.default_rng(3), tilt=0.0)
    assert largest_diagonal(case, truth, control.command) < 1.2 * case.after


def test_rotations_stay_in_the_volume_after_the_diagonals_are_better(tmp_path):
    """Of the same 60 µm, rotations leave more than was published, and more in the volume than on the diagonals."""
    case = CASES["800"]
    truth = truth_of(case, 3)
    control = compensated(tmp_path, case, truth, np.random.default_rng(3))
    after = largest_diagonal(case, truth, control.command)
    assert 0.004 < after < 0.5 * case.before
    assert largest_in_volume(case, truth, control) > 1.2 * after


# ------------------------------------------------------------------------------------------------------- what is refused


def readings_of(tmp_path, text: str):
    path = tmp_path / "steps.csv"
    path.write_text(text)
    return read_step_diagonals(path)


def test_tables_of_every_form_are_the_same_readings(tmp_path):
    case = case_of("w b X Y Z t", 3)
    found = read(case, Truth({"EXX": lambda x: 1e-5 * x, "EZY": lambda y: 2e-5 * y}))
    expected = nine_of(tmp_path, case, found).values
    head = table(case, found).splitlines()[:3]
    nominal = {n: (case.machine.functional_point(w.q, TOOL) @ w.beam)[: w.half] for n, w in case.ways().items()}
    whole = np.column_stack([found[n][: w.half] + nominal[n] for n, w in case.ways().items()])
    whole = whole - whole[0]  # the interferometer is set to zero at the start
    for values, rows in (("displacement", whole), ("displacement", whole[1:]), ("increments", np.diff(whole, axis=0))):
        lines = [*head, f"# values: {values}", "PPP,NPP,PNP,PPN", *(",".join(map(repr, r.tolist())) for r in rows)]
        campaign = readings_of(tmp_path, "\n".join(lines) + "\n")
        nine = separate(steps_of(campaign.sets[0], campaign))
        assert largest_difference(nine.values, expected) < 1e-6  # positions of the table are whole nanometres
        assert not nine.steps.both_senses


HEAD = "# box: X 0 200, Y 0 150, Z 0 150\n# u: 0.0005\n"
ROWS = "PPP,NPP,PNP,PPN\n" + "0,0,0,0\n" * 4


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (f"# u: 0.0005\n{ROWS}", r"steps.csv: the line box is missing; expected rising positions of X, Y and Z"),
        (f"# box: X 0 700, Y 500 0, Z 0 400\n# u: 1e-3\n{ROWS}", "the line box is 'X 0 700, Y 500 0, Z 0 400'"),
        (f"# box: X 0 700, Y 0 500, Z 0 400\n{ROWS}", "the line u is missing; expected a positive number in mm"),
        (f"{HEAD}# tool: 1, 2\n{ROWS}", "the line tool is '1, 2'; expected three numbers"),
        (f"{HEAD}PPP,NPP,PNP\n0,0,0\n0,0,0\n0,0,0\n", "column 'PPN'|'PPN'"),
        (f"{HEAD}PPP,NPP,PNP,NNN\n0,0,0,0\n", "column 'NNN' is no diagonal; expected PPP, NPP, PNP, PPN"),
        (f"{HEAD}{ROWS}0,0,0,0\n", "5 rows; expected three for every step, X, Y, Z, or one more"),
        (f"{HEAD}# values: mm\n{ROWS}", "the line values is 'mm'; expected displacement or deviation or increments"),
        (f"{HEAD}{ROWS}", "seem to be deviations"),
    ],
)
def test_wrong_tables_are_refused_with_what_was_expected(text, message, tmp_path):
    with pytest.raises(InputError, match=message):
        readings_of(tmp_path, text)


@pytest.mark.parametrize("box", ["X 0 600, Y 0 800, Z 0 600", "X 0 8e2, Y 0 6e2, Z 0 500"])
def test_steps_of_another_box_are_asked_about(box, tmp_path):
    """Steps of 20, 15, 15 mm on the diagonals of 800 × 600 × 600 mm, said to be those of another box."""
    step = np.tile([20.0 * 800.0, 15.0 * 600.0, 15.0 * 600.0], 40) / np.linalg.norm([800.0, 600.0, 600.0])
    rows = [",".join(4 * [f"{v:.6f}"]) for v in np.cumsum(step)]
    text = "\n".join([f"# box: {box}", "# u: 0.0005", "PPP,NPP,PNP,PPN", *rows]) + "\n"
    campaign = readings_of(tmp_path, text)
    with pytest.raises(InputError, match=r"D.\(.\) reaches \d+.*in the stated order .*: are box, steps and unit those"):
        evaluate_step_diagonals(campaign.sets[0], campaign)
    right = readings_of(tmp_path, text.replace(box, "X 0 8e2, Y 0 6E2, Z 0 600.0"))
    assert evaluate_step_diagonals(right.sets[0], right)["Dx(x)"].value < 1e-4  # rounding of the rows


def test_steps_that_are_none_are_refused(tmp_path):
    case = case_of("w b X Y Z t", 3)
    nine = nine_of(tmp_path, case, read(case, Truth()))
    own, campaign = nine.steps.observations, nine.steps.campaign
    assert step_sets(campaign) == [own] and step_sets(campaign, ["other"]) == []
    skipped = own.rows_of(np.delete(np.arange(len(own)), [1]))
    with pytest.raises(InputError, match="X and Y move in one step of line 'PPP'; expected one axis"):
        steps_of(skipped, replace(campaign, sets=(skipped,)))
    three = own.rows_of(np.flatnonzero(np.isin(own.labels["line"], ["PPP", "NPP"])))
    with pytest.raises(NotDeterminedError, match="do not determine three functions; expected steps on all four"):
        separate(steps_of(three, replace(campaign, sets=(three,))))


def test_runs_one_way_are_told_from_each_other_and_in_any_order(tmp_path):
    """Three runs on, none back: between them the tool goes back unread. Rows of runs may alternate."""
    case = case_of("w b X Y Z t", 3)
    truth = Truth({"EXX": lambda x: 1e-5 * x, "EZY": lambda y: 2e-5 * y})
    nine = nine_of(tmp_path, case, read(case, truth))
    own = nine.steps.observations
    there = own.rows_of(np.flatnonzero(own.directions[:, 0] * np.where(own.labels["line"] == "NPP", -1, 1) > 0))
    rows = np.concatenate(
        [np.repeat(np.flatnonzero(there.labels["line"] == n), 3) for n in dict.fromkeys(own.labels["line"])]
    )
    runs = there.rows_of(rows)
    runs = replace(runs, labels={**runs.labels, "run": np.resize(np.array(["1", "2", "3"]), len(rows))})
    campaign = replace(nine.steps.campaign, sets=(runs,))
    assert step_sets(campaign) == [runs]
    again = separate(steps_of(runs, campaign))
    assert largest_difference(again.values, nine.values) < 1e-9 and not again.steps.both_senses
    one_by_one = there.rows_of(
        np.concatenate([np.flatnonzero(there.labels["line"] == n) for n in ("PPP", "NPP", "PNP", "PPN")] * 2)
    )
    assert step_sets(replace(campaign, sets=(one_by_one,))) == []  # without numbers of runs three axes go back at once


def test_lines_along_axes_and_straight_diagonals_are_no_steps():
    machine = volid_machine(case_of("w b X Y Z t").machine)
    assert step_sets(parallel_lines(machine, 5)) == [] and step_sets(diagonals(machine, 5)) == []
    assert len(step_sets(step_diagonals(machine, 5))) == 1


def test_a_turned_table_is_refused():
    exact = ExactMachine("w C' X' Y' b Z t", {**BOX, "C": (-180.0, 180.0)})
    plan = step_diagonals(volid_machine(exact), 3)
    turned = plan.sets[0].moved(lambda q: np.where(np.arange(4) == 0, 90.0, q), lambda way: way)
    with pytest.raises(InputError, match="the rotary axes have turned the workpiece; expected them at 0"):
        steps_of(turned, replace(plan, sets=(turned,)))


@pytest.mark.slow
def test_rotations_that_a_solution_does_not_know_are_named(tmp_path):
    case = case_of("w b X Y Z t", 4)
    nine = nine_of(tmp_path, case, read(case, Truth(), np.random.default_rng(1)))
    solution = volid.fit(nine.steps.campaign)
    names = set(not_known(solution))
    assert {"EAX", "EAY"} <= names <= set(ROTATIONS), "one tool vector and mirrors of unknown tilt"


def test_names_are_by_axis():
    assert NAMES[:3] == ("Dx(x)", "Dy(x)", "Dz(x)") and NAMES[-1] == "Dz(z)"
    assert stepped(case_of("w b X Y Z t").machine, "NPP", 2).q[:4, 0].tolist() == [700.0, 350.0, 350.0, 350.0]
