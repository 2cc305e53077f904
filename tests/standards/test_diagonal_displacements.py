"""Diagonals after ISO 230-6: closed forms of machines with one error at a time, and the exact chain."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from exact_chain import ExactMachine, Truth, random_truth
from exact_chain.diagonals import BODY, FACE, displacements, straight
from scipy.stats import binom
from support.machines import volid_machine

from volid.campaign import Campaign
from volid.cli import main
from volid.exceptions import InputError
from volid.io.evaluations.diagonals import read_diagonals
from volid.planning.diagonals import diagonals
from volid.standards.diagonals.evaluation import contributions_from, evaluate_diagonals
from volid.standards.diagonals.lines import Diagonal, diagonals_of, standard_name
from volid.standards.positioning.runs import PositioningRuns
from volid.standards.positioning.uncertainty import PROBABILITY
from volid.virtual.simulate import simulate
from volid.virtual.truth import Truth as VolidTruth

SIZE = np.array([1000.0, 600.0, 500.0])
LENGTH = float(np.linalg.norm(SIZE))
MACHINE = ExactMachine("w Y' X' b Z t", {"X": (0.0, 1000.0), "Y": (0.0, 600.0), "Z": (-500.0, 0.0)})
TOOL = (0.0, 0.0, -150.0)
N = 11


def table_of(truth: Truth, names, runs: int = 1, rng=None) -> str:
    """Rows of a table of diagonals as the exact chain reads them."""
    rows = ["diagonal,target,direction,run,deviation"]
    for name in names:
        way = straight(MACHINE, name, N)
        read = displacements(MACHINE, way, TOOL, truth, mirror="retro")
        distance = np.abs((way.q - way.q[0]) @ MACHINE.in_axis_order(dict(zip("XYZ", way.beam, strict=True)))[0])
        for run in range(runs):
            noise = 0.0 if rng is None else rng.normal(0.0, 1e-3, len(read))
            rows += [
                f"{name},{t:.6f},{1 if i < N else -1},{run},{r:.9f}"
                for i, (t, r) in enumerate(zip(distance, read + noise, strict=True))
            ]
    return "\n".join(rows) + "\n"


def evaluated(tmp_path, truth: Truth, names=tuple(BODY), **more):
    path = tmp_path / "diagonals.csv"
    path.write_text(table_of(truth, names, **more))
    return evaluate_diagonals(read_diagonals(path))


def change(evaluation, name: str) -> float:
    """Deviation at the end of a diagonal less that at its start, on the way on [mm]."""
    (runs,) = (d.runs for d in evaluation.details if d.name == name)
    return float(runs.deviations[-1, 0, 0] - runs.deviations[0, 0, 0])


def test_a_scale_of_one_axis_changes_every_body_diagonal_alike(tmp_path):
    """s X²/L at the end, and nothing goes back: 20e-6 · 1000² / 1269 = 15.8 µm."""
    (found,) = evaluated(tmp_path, Truth({"EXX": lambda x: 2e-5 * x}))
    for name in BODY:
        assert found[f"E_{name}"].value == pytest.approx(2e-5 * SIZE[0] ** 2 / LENGTH, abs=1e-7)
        assert found[f"B_{name}"].value == pytest.approx(0.0, abs=1e-8)
    assert found["E_d"].value == max(found[f"E_{name}"].value for name in BODY)


def test_squareness_has_the_sign_of_the_two_senses(tmp_path):
    """EC0Y moves the tool by -EC0Y (y - y_ref) in X: X and Y of one sense shorten, of opposite sense lengthen."""
    gamma = 3e-5
    truth = Truth({}, {"EC0Y": gamma})
    body, face = evaluated(tmp_path, truth, (*BODY, *FACE))
    for name, senses in BODY.items():
        expected = -gamma * senses[0] * senses[1] * SIZE[0] * SIZE[1] / LENGTH
        assert change(body, name) == pytest.approx(expected, abs=1e-7), name
        assert body[f"E_{name}"].value == pytest.approx(abs(expected), abs=1e-7)
    across = np.hypot(*SIZE[:2])
    assert face["E_XY_PP"].value == pytest.approx(gamma * SIZE[0] * SIZE[1] / across, abs=1e-7)
    assert face["E_XZ_PP"].value < 1e-7 and face["E_YZ_NP"].value < 1e-7


def test_reversal_is_counted_with_the_share_of_the_axis(tmp_path):
    """B of EXX = 8 µm acts by X/L, in the sense in which the diagonal runs X: on minus back is (X/L) B for all four."""
    (found,) = evaluated(tmp_path, Truth(reversal={"EXX": lambda x: 0.008 + 0.0 * x}))
    for name in BODY:
        assert found[f"B_{name}"].value == pytest.approx(0.008 * SIZE[0] / LENGTH, abs=1e-7)
        assert found[f"E_{name}"].value == pytest.approx(0.008 * SIZE[0] / LENGTH, abs=1e-7)


def test_straightness_adds_its_share_across(tmp_path):
    """EYX = 10 µm sin: (Y/L) of it, of the sense of Y; the whole range of the wave."""
    truth = Truth({"EYX": lambda x: 0.010 * np.sin(2.0 * np.pi * x / 1000.0)})
    (found,) = evaluated(tmp_path, truth)
    largest = 0.010 * np.abs(np.sin(2.0 * np.pi * np.linspace(0.0, 1.0, N))).max()
    for name in BODY:
        assert found[f"E_{name}"].value == pytest.approx(2.0 * largest * SIZE[1] / LENGTH, abs=1e-7)


def test_pitch_of_the_vertical_axis_tilts_the_tool(tmp_path):
    """EBZ = c (z - z_ref) turns the carriage: EBZ × (0, 0, tool_z) moves the tool in X by EBZ · tool_z."""
    c = 4e-8
    (found,) = evaluated(tmp_path, Truth({"EBZ": lambda z: c * (z + 250.0)}))
    for name, senses in BODY.items():
        expected = -150.0 * c * 500.0 * senses[0] * senses[2] * SIZE[0] / LENGTH
        assert change(found, name) == pytest.approx(expected, abs=1e-7), name


def test_campaign_and_table_give_the_same(tmp_path):
    """A campaign that the package simulates against the table of the exact chain, body and face diagonals."""
    truth = random_truth(MACHINE, np.random.default_rng(3), reversal=True)
    machine = volid_machine(MACHINE)
    own = VolidTruth(machine, truth.functions, reversal=truth.reversal, constants=truth.constants)
    campaign, _ = simulate(diagonals(machine, N), own, noise=False)
    (found,) = diagonals_of(campaign).values()
    ours, exact = evaluate_diagonals(found), evaluated(tmp_path, truth, (*BODY, *FACE))
    for one, other in zip(ours, exact, strict=True):
        assert [q.symbol for q in one.quantities] == [q.symbol for q in other.quantities]
        for q in one.quantities:
            assert q.value == pytest.approx(other[q.symbol].value, abs=5e-6), q.symbol  # products of errors


def test_a_diagonal_run_the_other_way_round_is_the_same():
    machine = volid_machine(MACHINE)
    truth = VolidTruth(machine, {"EXX": lambda x: 1e-5 * x}, constants={"EC0Y": 2e-5})
    truth = VolidTruth(machine, truth.functions, reversal={"EXX": lambda x: 0.004 + 0.0 * x}, constants=truth.constants)
    plan = diagonals(machine, N, faces=False)
    (own,) = plan.sets
    turned = own.moved(lambda q: np.array([600.0, 1000.0, -500.0]) - q, lambda way: -way)
    lines = {name: (-np.array(d)).tolist() for name, d in own.options["lines"].items()}
    turned = Campaign(machine, (), (own_with(turned, lines),), "turned")
    (one,), (other,) = (diagonals_of(simulate(p, truth, noise=False)[0]).values() for p in (plan, turned))
    (first,), (second,) = evaluate_diagonals(one), evaluate_diagonals(other)
    for q in first.quantities:
        assert second[q.symbol].value == pytest.approx(q.value, abs=2e-7), q.symbol
    for a, b in zip(one, other, strict=True):
        np.testing.assert_allclose(np.ptp(a.runs.deviations[:, 0]), np.ptp(b.runs.deviations[:, 0]), atol=2e-7)


def own_with(observations, lines):
    return replace(observations, options={**observations.options, "lines": lines})


def test_repeatability_is_that_of_five_runs(tmp_path):
    """Noise of 1 µm: R of a target is near 4 µm, the largest of 11 above; it is missing where there is one run."""
    (found,) = evaluated(tmp_path, Truth(), runs=5, rng=np.random.default_rng(0))
    assert 0.004 < found["R_d"].value < 0.012
    assert not any("approach(es)" in r for r in found.remarks)
    (single,) = evaluated(tmp_path, Truth())
    assert {q.symbol for q in single.quantities} == {f"{s}_{n}" for s in "EB" for n in (*BODY, "d")}
    assert any("of one approach R is not determined" in r for r in single.remarks)


def test_u_of_the_largest_covers_four_alike_diagonals(monkeypatch):
    """Each has E = 10 µm; noise of 0.5 µm raises the largest of the four, on the average by about one u of each."""
    monkeypatch.setattr("volid.standards.positioning.uncertainty.TRIALS", 400)
    rng, targets, u, tests, inside = np.random.default_rng(1), np.linspace(0.0, 1200.0, 4), 5e-4, 100, 0
    true = 0.010 * targets[:, None, None] / 1200.0
    for _ in range(tests):
        runs = [PositioningRuns(name, targets, true + u * rng.standard_normal((4, 2, 5))) for name in BODY]
        lines = [Diagonal(r.axis, True, r) for r in runs]
        (found,) = evaluate_diagonals([d._replace(contributions=(contributions_from(u, d),)) for d in lines])
        inside += abs(found["E_d"].value - 0.010) <= found["E_d"].U
    assert inside >= binom.ppf(1e-3, tests, PROBABILITY)


def test_missing_diagonals_and_ways_are_said(tmp_path):
    path = tmp_path / "d.csv"
    rows = [r for r in table_of(Truth(), ["PPP", "NPP"]).splitlines() if not re.match(r"NPP,.*,-1,", r)]
    path.write_text("\n".join(rows) + "\n")
    (found,) = evaluate_diagonals(read_diagonals(path))
    text = " ".join(found.remarks)
    assert "not measured: PNP, PPN" in text and "run one way only: NPP" in text
    assert "E_NPP" not in {q.symbol for q in found.quantities}


def test_names():
    assert standard_name({"X": 1.0, "Y": 1.0, "Z": 1.0}) == ("PPP", 1.0)
    assert standard_name({"X": 1.0, "Y": -1.0, "Z": -1.0}) == ("NPP", -1.0)
    assert standard_name({"X": 1.0, "Z": -1.0}) == ("XZ_NP", -1.0)
    with pytest.raises(InputError, match="no diagonal; expected two or three of X, Y, Z"):
        standard_name({"X": 1.0})


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("diagonal,target,direction,deviation\nQQQ,0,1,0\n", "row 2: diagonal is 'QQQ'; expected PPP, NPP"),
        ("diagonal,target,direction\nPPP,0,1\n", "neither deviation nor displacement given; expected one of them"),
        ("# u: fine\ndiagonal,target,direction,deviation\nPPP,0,1,0\nPPP,9,1,0\n", "the line u is 'fine'"),
        ("diagonal,target,deviation\nPPP,0,0\n", "direction"),
        ("diagonal,target,direction,deviation\nPPP,0,0,0\nPPP,9,1,0\n", r"row 2: the direction of approach is 0"),
    ],
)
def test_wrong_tables_are_refused(text, message, tmp_path):
    path = tmp_path / "d.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=message):
        read_diagonals(path)


def test_the_command_judges_and_draws(tmp_path, capsys):
    (tmp_path / "d.csv").write_text("# u: 0.0005\n" + table_of(Truth({"EXX": lambda x: 2e-5 * x}), (*BODY, *FACE)))
    (tmp_path / "limits.toml").write_text("[body]\nE_d = 0.010\n")
    options = [
        "--limits",
        str(tmp_path / "limits.toml"),
        "--figure",
        str(tmp_path / "d.svg"),
        "-o",
        str(tmp_path / "o.csv"),
    ]
    assert main(["evaluate", "iso230-6", str(tmp_path / "d.csv"), *options]) == 1
    said = capsys.readouterr()
    assert "body: E_d = " in said.err and " exceeds " in said.err and "E_XY_NP" in said.out
    assert (tmp_path / "d.svg").stat().st_size > 1000
    assert "diagonal,target_mm,mean_up_mm" in (tmp_path / "o.csv").read_text()


def test_diagonals_run_one_way_have_their_way(tmp_path):
    """Scale s of X: s X²/L = 15.8 µm on every diagonal, whichever way it was run; nothing is said of the other way."""
    text = table_of(Truth({"EXX": lambda x: 20e-6 * x}), tuple(BODY))
    path = tmp_path / "diagonals.csv"
    path.write_text("".join(line + "\n" for line in text.splitlines() if ",-1," not in line))
    (found,) = evaluate_diagonals(read_diagonals(path))
    expected = 20e-6 * SIZE[0] ** 2 / LENGTH
    assert [found[f"E_up_{name}"].value for name in BODY] == pytest.approx([expected] * 4, abs=2e-6)
    assert found["E_up_d"].value == pytest.approx(expected, abs=2e-6)
    assert {q.symbol[:4] for q in found.quantities} == {"E_up"}
