"""Diagonals, step diagonals and parallel lines: what the plans hold, and how much they determine, by a count apart."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from exact_chain import ExactMachine, Truth
from exact_chain.beams import flat_lengths
from exact_chain.ranks import differences, offsets, rank, sensitivities, without
from support.machines import exact_machine, volid_machine

from volid.exceptions import InputError
from volid.fitting.diagnosis.identifiability import analyse
from volid.fitting.equations.interpreted import Interpreted
from volid.fitting.equations.problem import build_problem
from volid.fitting.starts import find_starts
from volid.model.error_functions import motion_names
from volid.model.error_model import build_model
from volid.observations.beam_lines import beams_of
from volid.planning.diagonals import diagonals, parallel_lines, step_diagonals
from volid.standards.diagonals.evaluation import evaluate_diagonals
from volid.standards.diagonals.lines import diagonals_of
from volid.virtual.random_truth import random_truth
from volid.virtual.simulate import simulate
from volid.virtual.truth import Truth as VolidTruth

BED_XYZ = ExactMachine("w b X Y Z t", {"X": (0.0, 1000.0), "Y": (0.0, 600.0), "Z": (-500.0, 0.0)})
QUARTIC = '[model]\ndegree = 4\nsegments = 1\n[model.functions]\n"E?0S" = false'
THREE_TOOLS = [[0.0, 0.0, -150.0], [80.0, 0.0, -250.0], [0.0, 90.0, -200.0]]
MACHINE = volid_machine(BED_XYZ, QUARTIC)
PLANS = {
    "four body diagonals": (lambda m: diagonals(m, faces=False), 19),
    "and six face diagonals, in the middle": (diagonals, 37),
    "and six face diagonals, in outer planes": (lambda m: diagonals(m, height=0.0), 41),
    "step diagonals, tilted mirror": (lambda m: step_diagonals(m, 5), 46),
    "step diagonals, known mirror": (lambda m: changed(step_diagonals(m, 5), misalignment=False), 54),
    "step diagonals, reflector along an unknown beam": (lambda m: changed(step_diagonals(m, 40), mirror="retro"), 44),
    "one line of every axis": (lambda m: parallel_lines(m, lines=1), 12),
    "two lines of every axis": (lambda m: parallel_lines(m, lines=2), 20),
    "four lines of every axis": (parallel_lines, 24),
    "four lines of every axis, three tools": (lambda m: parallel_lines(m, 6, THREE_TOOLS), 36),
}


def changed(plan, **options):
    """The plan with other options of its set."""
    (own,) = plan.sets
    return replace(plan, sets=(replace(own, options={**own.options, **options}),))


@cache
def counted(name: str) -> tuple[int, float]:
    """Combinations of 72 coefficients that a plan determines, and the gap of singular values, by the exact chain.

    Offset of every line, and where they are unknown two angles of beam or mirror, are taken out line by line.
    """
    (own,) = PLANS[name][0](MACHINE).sets
    beams = {n: np.array(d) for n, d in own.options["lines"].items()}
    design, blocks = sensitivities(BED_XYZ, lambda truth: lengths(own, beams, truth)), []
    for line, beam in beams.items():
        rows = own.labels["line"] == line
        unknown, across = [offsets(np.ones(rows.sum()))], np.linalg.svd(beam[None, :])[2][1:]
        if own.options["misalignment"]:

            def turned(angles, line=line, beam=beam, across=across, rows=rows):
                return lengths(own, {**beams, line: beam + angles @ across}, Truth())[rows]

            unknown.append(differences(turned, np.zeros(2), np.full(2, 1e-4)))
        blocks.append(without(np.hstack(unknown), design[rows]))
    return rank(np.vstack(blocks))


def lengths(own, beams, truth) -> np.ndarray:
    """What the interferometer reads of the rows of a set, their lines one after the other, along `beams` by name, (m,) [mm]."""
    starts = {n: BED_XYZ.functional_point(own.positions[i : i + 1], own.tool[i])[0] for n, i in first_rows(own).items()}
    if own.options["mirror"] == "retro":
        points = BED_XYZ.functional_point(own.positions, own.tool, truth)
        along = np.array([beams[n] / np.linalg.norm(beams[n]) for n in own.labels["line"]])
        return np.sum(along * (points - np.array([starts[n] for n in own.labels["line"]])), axis=1)
    found = np.empty(len(own))
    for name, beam in beams.items():
        rows = own.labels["line"] == name
        found[rows] = flat_lengths(BED_XYZ, own.positions[rows], own.tool[rows], truth, beam, starts[name], beam)
    return found


def first_rows(own) -> dict[str, int]:
    """The first row of every line."""
    return {n: int(np.argmax(own.labels["line"] == n)) for n in own.options["lines"]}


def analysed(plan):
    """The model, and what is determined of it, for readings of a machine without errors."""
    campaign, _ = simulate(plan, VolidTruth(plan.machine, {}), seed=1, noise=False)
    model = build_model(plan.machine, {n: (1,) for n in motion_names(plan.machine)})
    problem = build_problem(campaign, model, find_starts(campaign), engine=Interpreted())
    return model, analyse(problem, campaign)


@pytest.mark.parametrize("name", PLANS)
def test_what_a_plan_determines_of_quartic_functions(name):
    """18 functions of 4 coefficients; 1e-7 of the largest singular value counts (`exact_chain.ranks`), and none is near that."""
    found, gap = counted(name)
    assert found == PLANS[name][1] and gap > 1e4


@pytest.mark.parametrize("name", PLANS)
def test_the_package_says_the_same(name):
    """Its datum takes three rotations of the 72 coefficients, which none of these readings shows."""
    model, found = analysed(PLANS[name][0](MACHINE))
    assert model.n_parameters - found.null_space.shape[1] == PLANS[name][1]
    left = 69 - PLANS[name][1]
    assert sum(found.undetermined.values()) == pytest.approx(left, abs=1e-3)
    text = " ".join(found.statements)
    for function in (name for name, share in found.undetermined.items() if share > 0.1):
        assert function in text, "every function concerned is named"
    assert "displacements along beams show no movement across them" in text
    assert ("single tool vector (0, 0, -150) mm" in text) == ("three tools" not in name)
    assert ("no beam is inclined in the plane of X and Z" in text) == ("line" in name)


def test_body_diagonals_begin_and_end_in_corners():
    plan = diagonals(MACHINE, 5, faces=False)
    (own,) = plan.sets
    starts = {"PPP": (0, 0, -500), "NPP": (1000, 0, -500), "PNP": (0, 600, -500), "PPN": (0, 0, 0)}
    ends = {"PPP": (1000, 600, 0), "NPP": (0, 600, 0), "PNP": (1000, 0, 0), "PPN": (1000, 600, -500)}
    for name in starts:
        rows = own.labels["line"] == name
        assert own.positions[rows][[0, 4, 5, 9]].tolist() == [
            list(map(float, p[name])) for p in (starts, ends, ends, starts)
        ]
        signs = [1.0 if s == "P" else -1.0 for s in name]
        assert own.directions[rows][:5].tolist() == [signs] * 5 and (own.directions[rows][5:] == -np.array(signs)).all()
        expected = np.subtract(ends[name], starts[name]) / np.sqrt(1000**2 + 600**2 + 500**2)
        np.testing.assert_allclose(own.options["lines"][name], expected, atol=1e-9)


def test_steps_move_one_axis_after_the_other_and_meet_the_diagonal_every_third():
    """REQUIREMENTS C: X, then Y, then Z by an n-th of their travels; 3 n readings after the first."""
    (own,) = step_diagonals(MACHINE, 40).sets
    for line in beams_of(own, step_diagonals(MACHINE, 40)):
        there = own.positions[line.rows][:121]
        steps = np.diff(there, axis=0)
        assert (np.count_nonzero(steps, axis=1) == 1).all()
        np.testing.assert_allclose(np.abs(steps[:3]), np.diag([25.0, 15.0, 12.5]), atol=1e-6)
        assert line.beside[:121:3].max() < 1e-5 < 10.0 < line.beside.max() < 30.0
        np.testing.assert_array_equal(own.positions[line.rows][121:], there[::-1])


def test_face_diagonals_keep_the_third_axis():
    (own,) = diagonals(MACHINE, 3, height=1.0).sets
    names = [n for n in own.options["lines"] if "_" in n]
    assert names == [f"{plane}_{sense}" for plane in ("XY", "XZ", "YZ") for sense in ("PP", "NP")]
    rows = own.positions[own.labels["line"] == "XZ_NP"]
    assert rows[:3].tolist() == [[1000.0, 600.0, -500.0], [500.0, 600.0, -250.0], [0.0, 600.0, 0.0]]


def test_lines_of_a_machine_with_rotary_axes_hold_these_at_0():
    machine = volid_machine(exact_machine("w C' Y' b X Z B t"))
    plan = parallel_lines(machine, 4, THREE_TOOLS[:2], lines=1)
    (own,) = plan.sets
    rotary = [machine.index("B"), machine.index("C")]
    assert not own.positions[:, rotary].any() and set(own.options["lines"]) == {
        f"{a}_1_T{k}" for a in "XYZ" for k in (1, 2)
    }
    assert len(own) == 3 * 2 * 2 * 4 and (np.abs(list(own.options["lines"].values())).sum(axis=1) == 1.0).all()


def test_plans_that_are_none_are_refused():
    plotter = volid_machine(ExactMachine("w b X Y t", {"X": (0.0, 500.0), "Y": (0.0, 400.0)}))
    with pytest.raises(InputError, match="has no axis Z; diagonals need X, Y and Z"):
        diagonals(plotter)
    with pytest.raises(InputError, match="`height=2`: expected a share of the travel, 0 to 1"):
        diagonals(MACHINE, height=2.0)
    with pytest.raises(InputError, match=r"`?n`?\b"):
        step_diagonals(MACHINE, 0)
    with pytest.raises(InputError, match="lines"):
        parallel_lines(MACHINE, lines=5)


def test_five_runs_give_a_repeatability():
    """As ISO 230-6 asks for it: each line there and back, five times, and then R of every diagonal."""
    plan = diagonals(MACHINE, 5, faces=False, runs=5)
    readings = plan.sets[0]
    assert len(readings) == 4 * 5 * 2 * 5 and set(readings.labels["run"]) == set("12345")
    measured, _ = simulate(plan, random_truth(plan.machine, 1), seed=1)
    [body] = evaluate_diagonals(diagonals_of(measured)["diagonals"])
    for name in ("PPP", "NPP", "PNP", "PPN"):
        # noise of 0.5 µm on a machine that repeats: R is 2 s + 2 s + |B| of the worst of five targets, s within chance of 0.5 µm
        assert 0.001 < body[f"R_{name}"].value < 0.006
