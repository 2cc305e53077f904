"""Requests that look like a slip get a question, before any work and in little memory; who means them insists.

Each row of `ASKED` is one option of one command with an absurd value, and words of the question. All are tried a second time with
--accept-unusual, but those that no computer can hold. `REFUSED`: numbers that mean nothing, whatever is insisted on.
"""

from dataclasses import replace

import numpy as np
import pytest
from support.places import MODELS

import volid
from volid.backend.consent import ask_memory
from volid.cli import main
from volid.io.machines import parse_machine
from volid.model.requests import ask_positions, ask_tools

VERTICAL, TRUNNION = MODELS / "wYXbZt_vertical.toml", MODELS / "wCAYXbZt_trunnion.toml"
SIZES = ("--step 1e-6", "--points 1000000000000", "--trials 1000000000000", "--points 100000,100000")
TOOLS = {
    "0,0,-0.15": "is it in metres?",
    "0,0,1000000": "is it in micrometres?",
    "0,0,-150000": "is it in micrometres?",
}


def asked():
    """Command line with {s} solution, {out} output, {m} machine, {c} campaign; and the words of the question."""
    for tool, words in TOOLS.items():
        for line in (
            "grid {s} --points 2 -o {out}.csv --tool",
            "tables {s} --type L-POS -o {out} --tool",
            "residual {s} --type L-POS --points 2 -o {out}.csv --tool",
            "residual {s} --type L-POS --points 2 -o {out}.csv --tools",
            "summary {s} -o {out}.txt --tool",
            "budget {s} -o {out}.csv --tool",
            "uncertainty {s} --trials 20 -o {out}.h5 --tool",
            "fit {c} -o {out}.h5 --tool",
            "plan {m} static-grid --points 3,3 -o {out}.toml --tool",
            "plan {m} K1 --points 3 -o {out}.toml --tool",
        ):
            yield f"{line} {tool}", words
    for place in ("metres.csv", "far.csv", "short.csv", "long.csv"):
        words = {"m": "as if they were in metres", "f": "far outside the travel", "s": "metres?", "l": "micrometres?"}[
            place[0]
        ]
        yield f"errors {{s}} -o {{out}}.csv --at {{folder}}/{place}", words
        yield f"budget {{s}} -o {{out}}.csv --at {{folder}}/{place}", words
    for verb, line in (("grid", "--points 2 -o {out}.csv"), ("tables", "--type L-POS -o {out}")):
        yield f"{verb} {{s}} {line} --at X=0.5,Y=0.3,Z=-0.25", "as if they were in metres"
        yield f"{verb} {{s}} {line} --zero X=0.5", "as if they were in metres"
        yield f"{verb} {{s}} {line} --range X=0:0.9", "as if they were in metres"
        yield f"{verb} {{s}} {line} --increment 1", "least increments of controls are below 0.1 mm"
        yield f"{verb} {{s}} {line} --increment 1000", "least increments of controls are below 0.1 mm"
        yield f"{verb} {{s}} {line} --angle-increment 5", "least increments of controls are below 0.1 degrees"
    yield "grid {s} -o {out}.csv --max-points 3 --max-error 1", "is it in micrometres?"
    yield "residual {s} --type L-POS --points 2 -o {out}.csv --increment X=1", "least increments of controls"
    yield "residual {s} --type L-POS --points 2 -o {out}.csv --tool-error 0,0,150000", "is it in micrometres?"
    yield "grid {s} -o {out}.csv --step 5000", "is longer than every range (X 0 … 1000, Y 0 … 600, Z -500 … 0)"
    yield "functions {s} -o {out}.csv --step 5000", "is longer than every range"
    yield "tables {s} --type L-POS -o {out} --step 5000", "is longer than every range"
    yield "plan {m} static-grid --points 3,3 -o {out}.toml --sphere P1=0.06,0.02,0.03", "is it in metres?"
    yield "plan {m} static-grid --points 3,3 -o {out}.toml --u 0.5", "is it in micrometres?"
    yield "plan {m} static-grid --points 3,3 -o {out}.toml --u 1e-9", "is it in metres?"
    yield "plan {m} cone-frustum --points 5 -o {out}.toml --length 0.1", "is it in metres?"
    yield "plan {m} cone-frustum --points 5 -o {out}.toml --calibrated-u 0.5", "is it in micrometres?"
    yield "grid {s} -o {out}.csv --step 1e-6", "nodes, a file of more than 1 YB"
    yield "functions {s} -o {out}.csv --step 1e-6", "1,000,000,001 positions of X"
    yield "plan {m} standard -o {out}.toml --points 1000000000000", "6,000,000,000,000 rows"
    yield "plan {m} static-grid -o {out}.toml --points 100000,100000", "10,000,000,000 rows; that needs 10 TB"
    yield "uncertainty {s} -o {out}.h5 --trials 1000000000000", "1,000,000,000,000 trials"


ASKED = list(asked())
REFUSED = [
    *(
        f"grid {{s}} -o {{out}}.csv {o} {v}"
        for o in ("--step", "--increment", "--max-error")
        for v in ("nan", "inf", "-1", "0")
    ),
    *(
        f"tables {{s}} --type L-POS -o {{out}} {o} {v}"
        for o in ("--step", "--offset", "--angle-increment")
        for v in ("nan", "0")
    ),
    *(f"functions {{s}} -o {{out}}.csv --step {v}" for v in ("nan", "inf", "-5", "0", "five")),
    *(f"grid {{s}} -o {{out}}.csv --points {v}" for v in ("1", "-3", "nan", "1e3", "1000000000000")),
    *(f"grid {{s}} -o {{out}}.csv --points 2 --tool {v}" for v in ("nan,0,0", "0,inf,0", "1,2", "a,b,c")),
    *(f"grid {{s}} -o {{out}}.csv --points 2 {o} X={v}" for o in ("--at", "--zero") for v in ("nan", "inf", "-1e300")),
    *(f"grid {{s}} -o {{out}}.csv --points 2 --range X={v}" for v in ("0:nan", "nan:5", "0:inf", "5:0", "0:1e300")),
    *(
        f"residual {{s}} --type L-POS {o} X={v}"
        for o in ("--increment", "--limit", "--speed-limit")
        for v in ("nan", "0", "-1")
    ),
    *(
        f"residual {{s}} --type L-POS {o} {v}"
        for o in ("--feed", "--turn", "--pole-margin")
        for v in ("nan", "inf", "0", "-1")
    ),
    *(f"residual {{s}} --type L-POS --seed {v}" for v in ("-1", "1.5", "nan", str(10**30))),
    *(f"uncertainty {{s}} --trials {v}" for v in ("19", "-5", "0", "nan", str(10**30))),
    *(f"uncertainty {{s}} --digits {v}" for v in ("9", "0", "-1", "nan")),
    *(f"uncertainty {{s}} --trials 20 --seed {v}" for v in ("-1", str(10**30))),
    *(
        f"plan {{m}} cone-frustum -o {{out}}.toml {o} {v}"
        for o in ("--length", "--u", "--half-angle")
        for v in ("nan", "inf", "-1")
    ),
    *(f"plan {{m}} standard -o {{out}}.toml --points {v}" for v in ("0", "-5", "nan", "1e6")),
    *(f"plan {{m}} standard -o {{out}}.toml --seed {v}" for v in ("-1", str(10**30))),
    *(f"study study.toml -o {{out}}.h5 --workers {v}" for v in ("0", "-1", "nan", str(10**9))),
]


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A three-axis campaign with its solution, and tables of points of the kinds that `ASKED` names."""
    folder = tmp_path_factory.mktemp("absurd")
    campaign, _ = volid.simulate(volid.standard_plan(volid.load_machine(VERTICAL), 60), seed=1)
    volid.save_campaign(campaign, folder / "c.h5")
    volid.fit(campaign).save(folder / "s.h5")
    points = {"metres": "0.5,0.3,-0.25,0,0,-150", "far": "500000,300,-250,0,0,-150"}
    points |= {"short": "500,300,-250,0,0,-0.15", "long": "500,300,-250,0,0,-150000", "good": "500,300,-250,0,0,-150"}
    for name, row in points.items():
        (folder / f"{name}.csv").write_text(f"X,Y,Z,tool_x,tool_y,tool_z\n{row}\n", encoding="utf-8")
    return folder


@pytest.fixture
def words(files, tmp_path):
    """The words of a command line with its files in place."""
    places = {"s": files / "s.h5", "c": files / "c.h5", "m": TRUNNION, "folder": files, "out": tmp_path / "out"}
    return lambda line: line.format(**places).split()


@pytest.mark.parametrize(("line", "question"), ASKED)
def test_what_looks_like_a_slip_is_asked_about(line, question, words, tmp_path, capsys):
    assert main(words(line)) == 2
    err = capsys.readouterr().err
    assert question in err
    hopeless = any(line.endswith(size) for size in SIZES)
    assert ("this computer has" if hopeless else "If that is meant, insist with --accept-unusual") in err
    assert not list(tmp_path.glob("out*"))


MEANT = [line for line, _ in ASKED if not any(line.endswith(size) for size in SIZES)]


@pytest.mark.parametrize(
    "line", [line for line in MEANT if line.split()[0] not in ("residual", "uncertainty", "fit")][::3]
)
def test_who_insists_gets_it(line, words, capsys):
    """No question any more; another refusal (a sphere of no use at that place) has its own reason."""
    status = main([*words(line), "--accept-unusual"])
    err = capsys.readouterr().err
    assert "insist" not in err
    assert status in (0, 1) or "within the travels" in err or "outside the travel" in err, err


@pytest.mark.parametrize("line", REFUSED)
def test_numbers_that_mean_nothing_are_refused(line, words, tmp_path, capsys):
    assert main([*words(line), "--accept-unusual"]) == 2
    err = capsys.readouterr().err.splitlines()[-1]
    assert "expected" in err, err
    assert not list(tmp_path.glob("out*"))


@pytest.mark.parametrize(
    "line", ["errors {s} --at {folder}/good.csv", "budget {s} --at {folder}/good.csv", "summary {s}"]
)
def test_what_is_usual_is_not_asked_about(line, words, capsys):
    assert main(words(line)) == 0
    assert "insist" not in capsys.readouterr().err


def test_python_gets_the_same_questions(files):
    solution = volid.load_solution(files / "s.h5")
    middle = [[300.0, 500.0, -250.0]]
    for call in (
        lambda: solution.evaluate(middle, [0.0, 0.0, -0.15]),
        lambda: solution.evaluate([[0.3, 0.5, -0.25]], [0.0, 0.0, -150.0]),
        lambda: solution.evaluate([[300.0, 5e5, -250.0]], [0.0, 0.0, -150.0]),
        lambda: solution.grid(points=2, tool=(0.0, 0.0, 1e6)),
        lambda: solution.grid(step=1e4),
        lambda: solution.grid(points=200),
        lambda: solution.functions(step=1e4),
        lambda: solution.extrapolated({"X": (0.0, 1e9)}),
        lambda: volid.compensation_base(solution, (0.0, 0.0, -0.15)),
        lambda: volid.compensation_base(solution, (0.0, 0.0, -150.0), {"X": 0.5}),
        lambda: volid.volumetric_summary(solution, (0.0, 0.0, 1e6)),
        lambda: volid.summary(solution, (0.0, 0.0, 1e6)),
        lambda: volid.best_rigid(solution, np.array([[0.0, 0.0, 1e6]])),
        lambda: volid.monte_carlo(solution, 10_000_000),
        lambda: volid.standard_plan(solution.machine, 1_000_000),
    ):
        with pytest.raises(volid.InputError, match=r"insist with `volid\.accept_unusual`|this computer has"):
            call()
    with volid.accept_unusual():
        assert np.isfinite(solution.evaluate(middle, [0.0, 0.0, -0.15]).values).all()
    with pytest.raises(volid.InputError, match="insist"):  # it ends with its block
        solution.evaluate(middle, [0.0, 0.0, -0.15])
    with volid.accept_unusual(), pytest.raises(volid.InputError, match="three finite numbers"):
        solution.evaluate(middle, [0.0, 0.0, np.nan])


def test_tools_that_the_campaign_used_are_not_asked_about():
    machine = volid.load_machine(VERTICAL)
    known = np.array([[0.0, 0.0, -1.5], [0.0, 0.0, -2600.0]])
    ask_tools(machine, known, lambda: known)
    ask_tools(machine, [0.0, 0.0, -5000.0], lambda: known)  # not twice as long
    with pytest.raises(volid.InputError, match=r"tool vector of 1\.2 mm"):
        ask_tools(machine, [0.0, 0.0, -1.2], lambda: known)


@pytest.mark.parametrize("seed", range(20))
def test_ordinary_requests_on_any_machine_are_not_asked_about(seed):
    """Positions over 1 % to all of the travels, tool vectors of 5 mm to the machine's size, on travels of 0.1 m to 20 m."""
    rng = np.random.default_rng(seed)
    toml = 'format = "volid-machine/1"\nname = "any"\nstructure = "w b X Y Z t"\n'
    for letter in "XYZ":
        low = float(np.round(rng.choice([0.0, -1.0, -0.5]) * (length := float(10 ** rng.uniform(2.0, 4.3))), 3))
        toml += f"[axis.{letter}]\ntravel = [{low}, {low + length}]\n"
    machine = parse_machine(toml, "machine.toml")
    low, high = np.array([a.travel for a in machine.axes]).T
    share = rng.uniform(0.01, 1.0)
    start = rng.uniform(0.0, 1.0 - share)
    positions = low + (start + share * rng.random((30, 3))) * (high - low)
    ask_positions(machine, dict(zip(machine.letters, positions.T, strict=True)))
    direction = rng.standard_normal((10, 3))
    size = 10 ** rng.uniform(np.log10(5.0), np.log10(np.linalg.norm(high - low)), (10, 1))
    ask_tools(machine, size * direction / np.linalg.norm(direction, axis=1, keepdims=True))


def test_memory_is_asked_about_and_refused_beyond_the_computers():
    ask_memory("a table of 10 rows", 1e4, "Take less")
    with pytest.raises(volid.InputError, match=r"needs 3 GB of memory; up to 2 GB .* Take less\. If that is meant"):
        ask_memory("a table, rows", 3e9, "Take less")
    with volid.accept_unusual():
        ask_memory("a table, rows", 3e9, "Take less")
        with pytest.raises(volid.InputError, match="this computer has"):
            ask_memory("a table, rows", 1e18, "Take less")


def test_more_segments_or_campaigns_than_fit_are_refused_before_the_work(tmp_path, capsys):
    text = 'format = "volid-study/1"\n{}\nseeds = {}\n[[design]]\nname = "standard"\nn_per_station = {}\n'
    machine = f'machines = ["{VERTICAL.as_posix()}"]'
    for seeds, n, words in (
        (10**12, 400, "at most 100000"),
        (90_000, 400, "90,000 campaigns"),
        (1, 10**9, "n_per_station is 1000000000"),
    ):
        (tmp_path / "study.toml").write_text(text.format(machine, seeds, n), encoding="utf-8")
        status = main(["study", str(tmp_path / "study.toml"), "-o", str(tmp_path / "r.h5")])
        assert (status, words in capsys.readouterr().err) == (2, True)
    campaign, _ = volid.simulate(volid.standard_plan(volid.load_machine(VERTICAL), 20), seed=1)
    fine = replace(campaign.machine, model=replace(campaign.machine.model, segments=10**9))
    with pytest.raises(volid.InputError, match="18,000,000,054 coefficients of error functions"):
        volid.fit(replace(campaign, machine=fine))
