"""Machines with one linear axis, with two, with rotary axes alone: every verb ends in a result or in a message that says why."""

import json

import numpy as np
import pytest

import volid
from volid.cli import main
from volid.virtual.comparison import compare

HEAD = 'format = "volid-machine/1"\nname = "{}"\nstructure = "{}"\n'
X, Y = "[axis.X]\ntravel = [0.0, 500.0]\n", "[axis.Y]\ntravel = [0.0, 400.0]\n"
A = "[axis.A]\ntravel = [-90.0, 30.0]\npoint = [0.0, 0.0, 0.0]\n"
C = "[axis.C]\ntravel = [{}, {}]\npoint = [0.0, 0.0, 0.0]\n"
MACHINES = {
    "one linear axis": ("w b X t", X),
    "two linear axes": ("w Y' b X t", X + Y),
    "one rotary axis": ("w C' b t", C.format(0.0, 360.0)),
    "one long rotary axis": ("w b C t", C.format(-400.0, 400.0)),
    "two rotary axes": ("w C' A' b t", A + C.format(0.0, 360.0)),
    "one of each": ("w C' X' b t", X + C.format(0.0, 360.0)),
}
KNOWN = {  # what the standard plan determines of each, from counting the motions that no distance from a station sees
    "one linear axis": ("EXX", "EYX", "EZX", "EAX", "EBX", "ECX"),
    "two linear axes": ("EXX", "EYY", "EC0Y"),
    "one rotary axis": ("EXC", "EYC", "EZC", "EAC", "EBC", "ECC", "EX0C", "EY0C"),
    "one long rotary axis": ("EXC", "EYC", "EZC", "ECC"),
    "two rotary axes": ("ECC", "EAA", "EZC", "EXA"),
    "one of each": ("EXX", "ECC", "EX0C", "EY0C", "EB0C"),
}
TYPES = ("L-POS", "L-STR", "L-SQU", "L-ANG", "L-VOL", "R-POS", "R-RAX", "R-VOL", "FOR")
NO_AXIS = ("has no linear axis", "has no rotary axis", "has one linear axis", "cannot turn its tool")
NO_GRID = "R-POS has no grid"
REASONS = (*NO_AXIS, NO_GRID, "do not determine", "not determined by the data", "no function that it corrects")


def run(capsys, *arguments):
    """Exit status, standard output and standard error of a command; a traceback fails the test by itself."""
    status = main([str(a) for a in arguments])
    return status, *capsys.readouterr()


@pytest.fixture(scope="module", params=MACHINES)
def odd(request, tmp_path_factory):
    """Name, folder and solution of a machine that was measured by its standard plan."""
    structure, axes = MACHINES[request.param]
    folder = tmp_path_factory.mktemp("odd")
    (folder / "machine.toml").write_text(HEAD.format(request.param, structure) + axes, encoding="utf-8")
    plan = volid.standard_plan(volid.load_machine(folder / "machine.toml"), 40)
    campaign, truth = volid.simulate(plan, seed=1)
    volid.save_campaign(campaign, folder / "campaign.h5")
    solution = volid.fit(campaign)
    solution.save(folder / "s.h5")
    rows = [",".join([*plan.machine.letters, "tool_x", "tool_y", "tool_z"])]
    rows += [
        ",".join(f"{a.travel[0] + f * a.length:g}" for a in plan.machine.axes) + ",0,0,-150" for f in (0.0, 0.3, 1.0)
    ]
    (folder / "points.csv").write_text("\n".join(rows), encoding="utf-8")
    return request.param, folder, solution, truth


def test_what_is_stated_is_true(odd):
    """The functions against the truth, in the solution's own model and datum (`compare`): |difference| below 5 u everywhere."""
    name, _, solution, truth = odd
    found = compare(solution, truth)
    for known in KNOWN[name]:
        assert np.isfinite(found.functions[known]).all(), known
    off = np.concatenate([found.functions[n] / np.maximum(found.functions_u[n], 1e-7) for n in found.functions])
    assert np.nanmax(np.abs(off)) < 5.0
    assert np.nanmax(np.abs(found.field / found.field_u)) < 5.0


def test_every_verb_of_a_solution(odd, tmp_path, capsys):
    name, folder, solution, _ = odd
    rotary = "rotary" in name or name == "one of each"
    s, points = folder / "s.h5", folder / "points.csv"
    whole = 0 if solution.fully_determined else 1
    for verb, *arguments in (("summary",), ("budget",), ("budget", "--at", points), ("uncertainty", "--trials", "20")):
        status, _, err = run(capsys, verb, s, *arguments)
        assert status == whole, (verb, err)
    status, out, err = run(capsys, "errors", s, "--at", points, "--json")
    assert (status in (0, whole), len(json.loads(out)["rows"])) == (True, 3), err
    assert run(capsys, "functions", s)[0] in (whole, 1)
    status, _, err = run(capsys, "locations", s)
    assert (status in (0, 1)) if rotary else (status == 2 and "has no rotary axis; expected one at least" in err), err
    primary = min((a.letter for a in solution.machine.axes if a.is_linear), default=None)  # X: the machine file's own
    status, _, err = run(capsys, "datum", s, "--to", f"primary={primary or 'X'}", "-o", tmp_path / "d.h5")
    assert (
        (status == whole) if primary else (status == 2 and "this machine has no linear axis; leave primary out" in err)
    ), err


def test_the_datum_is_told_without_axes_that_are_not_there(odd, capsys):
    _, folder, solution, _ = odd
    _, out, _ = run(capsys, "summary", folder / "s.h5")
    text = " ".join(out.split())
    assert "axis ," not in text and "axis ;" not in text and "zero at mm" not in text
    linear = [a.letter for a in solution.machine.axes if a.is_linear]
    assert ("primary axis" in text, "secondary axis" in text) == (len(linear) > 0, len(linear) > 1)


@pytest.mark.parametrize("verb", ["grid", "tables", "residual"])
def test_every_type_of_compensation(odd, verb, tmp_path, capsys):
    """A type that the machine cannot have, or that the data leave open, is refused with the reason; all others are written."""
    _, folder, solution, _ = odd
    letters = set(solution.machine.letters)
    for kind in TYPES if verb != "residual" else ("L-POS", "L-STR", "R-VOL"):  # it takes longest
        more = {
            "grid": ("--points", "3"),
            "tables": ("--tool", "0,0,-150", "-o", tmp_path / kind),
            "residual": ("--points", "3"),
        }
        status, _, err = run(capsys, verb, folder / "s.h5", "--type", kind, *more[verb])
        reason = any(r in err for r in REASONS)
        assert status == 0 or reason, (kind, status, err)
        impossible = (kind[0] == "L" and not letters & set("XYZ")) or (kind[0] == "R" and not letters & set("ABC"))
        assert not impossible or (status == 2 and any(r in err for r in (*NO_AXIS, NO_GRID))), (kind, err)


def test_from_plan_to_study(odd, tmp_path, capsys):
    """`plan`, `simulate`, `import`, `fit` and `study` of the same machine by the command line."""
    _, folder, _, _ = odd
    machine, plan, campaign = folder / "machine.toml", tmp_path / "plan.toml", tmp_path / "c"
    assert run(capsys, "plan", machine, "standard", "--points", "20", "-o", plan)[0] == 0
    for test in ("static-grid", "K1", "cone-frustum"):
        status, _, err = run(capsys, "plan", machine, test, "-o", tmp_path / "no.toml")
        assert (status, "machine '" in err) == (2, True), err
    assert run(capsys, "simulate", machine, "--plan", plan, "-o", campaign)[0] == 0
    assert run(capsys, "import", campaign / "campaign.toml", "-o", tmp_path / "c.h5")[0] == 0
    assert run(capsys, "fit", tmp_path / "c.h5", "-o", tmp_path / "s.h5")[0] in (0, 1)
    study = tmp_path / "study.toml"
    text = f'format = "volid-study/1"\nmachines = ["{machine.as_posix()}"]\nseeds = 1\n[[design]]\nname = "standard"\n'
    study.write_text(f"{text}n_per_station = 20\n", encoding="utf-8")
    status, out, err = run(capsys, "study", study, "-o", tmp_path / "r.h5", "--workers", "1")
    assert (status, "1       0" in out) == (0, True), err  # one campaign, none failed


def test_a_study_that_determines_nothing_says_so(tmp_path, capsys):
    """One station on one line: was "cannot reshape array of size 0"."""
    (tmp_path / "machine.toml").write_text(HEAD.format("two", "w Y' b X t") + X + Y, encoding="utf-8")
    machine = volid.load_machine(tmp_path / "machine.toml")
    rows = "\n".join(f"{x},0,S,1" for x in range(0, 500, 12))
    (tmp_path / "line.csv").write_text(f"X,Y,station,segment\n{rows}\n", encoding="utf-8")
    (tmp_path / "plan.toml").write_text(
        'format = "volid-campaign/1"\nmachine = "machine.toml"\n[[station]]\nname = "S"\nposition = [-300.0, 20.0, 30.0]\n'
        '[[set]]\nname = "line"\nkind = "distance"\nfile = "line.csv"\ntool = [0.0, 0.0, 0.0]\nu = 0.0005\n',
        encoding="utf-8",
    )
    assert machine.letters == ("Y", "X")
    study = 'format = "volid-study/1"\nmachines = ["machine.toml"]\nseeds = 2\n[[design]]\nname = "line"\nplan = "plan.toml"\n'
    (tmp_path / "study.toml").write_text(study, encoding="utf-8")
    status, out, err = run(capsys, "study", tmp_path / "study.toml", "-o", tmp_path / "r.h5", "--workers", "1")
    assert status == 1
    assert "2 of 2 campaigns determine the deviation nowhere (design line)" in err
    assert "failed: " not in err
    assert "n.d." in out and "nan" not in out


def test_positioning_of_one_axis_alone_is_stated_and_nothing_else(tmp_path, capsys):
    """A laser along the only axis: EXX is true (closed form), all else is named; tables do not leave it out as 0."""
    (tmp_path / "machine.toml").write_text(HEAD.format("slide", "w b X t") + X, encoding="utf-8")
    rng = np.random.default_rng(4)

    def true(x):
        return 0.005 * np.sin(x / 80.0)

    x = np.linspace(0.0, 500.0, 51)
    rows = "\n".join(f"{q:g},X,{true(q) + 5e-4 * rng.standard_normal():.6f},0.0005" for q in x)
    (tmp_path / "x.csv").write_text(f"X,component,value,u\n{rows}\n", encoding="utf-8")
    (tmp_path / "c.toml").write_text(
        'format = "volid-campaign/1"\nmachine = "machine.toml"\n[[set]]\nname = "laser"\nkind = "component"\nfile = "x.csv"\n'
        "tool = [0.0, 0.0, 0.0]\n",
        encoding="utf-8",
    )
    s = tmp_path / "s.h5"
    assert run(capsys, "fit", tmp_path / "c.toml", "-o", s)[0] == 1
    solution = volid.load_solution(s)
    found = solution.motion("EXX", x[::5])
    off = [(r.value - (true(r.position) - true(250.0))) / r.u for r in found if r.u > 1e-6]
    assert np.abs(off).max() < 4.0
    unknown = {r.name for r in solution.functions() if np.isnan(r.value)}
    assert unknown == {"EYX", "EZX", "EAX", "EBX", "ECX", "EA0S", "EB0S", "EC0S"}
    assert run(capsys, "tables", s, "--type", "L-POS", "-o", tmp_path / "pos")[0] == 0
    status, _, err = run(capsys, "tables", s, "--type", "L-VOL", "--tool", "0,0,0", "-o", tmp_path / "vol")
    assert (status, "the data do not determine EYX" in err, (tmp_path / "vol").exists()) == (1, True, False), err
