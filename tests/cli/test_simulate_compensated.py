"""`volid simulate --compensation`: files through the command line, what is refused and what is said."""

import json

import numpy as np
import pytest
from exact_chain import Truth, machine_toml
from support.drives import at, both_truths, components, write_table
from support.machines import VERTICAL, volid_machine

from volid.campaign import Campaign
from volid.io import load_campaign
from volid.io.campaign.manifest import write_manifest
from volid.io.grid_reader import read_grid
from volid.io.grids import write_grid_hdf5
from volid.io.record import read_header
from volid.io.truths import load_truth, write_truth

TOOL = (0.0, 0.0, -150.0)
NOISE = 1e-7  # mm: u of a plan whose readings shall be nearly exact
X = np.linspace(0.0, 760.0, 5)


def scale(x):
    return 5e-5 * (x - 380.0)


@pytest.fixture
def bench(tmp_path):
    """A vertical machine that is too long in X by 50 µm/m, a plan of one line along X, and the table of its error."""
    machine = volid_machine(VERTICAL)
    (tmp_path / "machine.toml").write_text(machine_toml(VERTICAL), encoding="utf-8")
    line = components(at(VERTICAL, X=X, Y=100.0, Z=-100.0), TOOL, "X", u=NOISE)
    write_manifest(Campaign(machine, (), (line,)), tmp_path / "plan")
    write_truth(both_truths(machine, Truth({"EXX": scale})), tmp_path / "truth.h5")
    write_table(tmp_path / "tables", "EXX", X, scale(X))
    return tmp_path


def simulate(run, bench, *more):
    return run(
        "simulate", bench / "machine.toml", "--plan", bench / "plan" / "campaign.toml", "--truth", bench / "truth.h5",
        "-o", bench / "out.h5", "--force", *more,
    )  # fmt: skip


def test_a_compensated_line_is_straight_and_the_campaign_and_its_truth_say_what_they_are(run, bench):
    more = ("--compensation", bench / "tables", "--control-tool", "0,0,-140", "--increment", "X=0.0005")
    status, text, _ = simulate(run, bench, *more, "--clamp", "Z", "--smoothing", "X=20")
    assert status == 0
    assert "active compensation: L-POS: table of EXX" in text
    campaign = load_campaign(bench / "out.h5")
    assert campaign.conditions["active_compensations"] == [
        "L-POS: table of EXX",
        "tool vector that the control uses: 0, 0, -140 mm",
        "least increment: X 0.0005 mm",
        "smoothing over: X 20 mm",
        "clamped for compensations: Z",
    ]
    np.testing.assert_array_equal(campaign.sets[0].positions[:, VERTICAL.column("X")], X)  # as programmed
    values = campaign.sets[0].readings[:, 0]
    # at the ends smoothing takes 20/8 mm off the table's last slope: 0.125 µm, below half an increment
    np.testing.assert_allclose(values - values[2], 0.0, atol=3e-6)
    assert load_truth(bench / "out.truth.h5").functions["EXX"](X)[0] == pytest.approx(scale(X)[0], abs=1e-9)
    status, text, _ = simulate(run, bench, "--json", *more)
    assert json.loads(text)["active_compensations"][0] == "L-POS: table of EXX"


def write_grid(path, kind, x, values, frame="machine"):
    """A grid over X alone with errors along X [mm], rotations 0."""
    head = ["format: volid-grid/1", f"type: {kind}", "values: compensation", f"frame: {frame}", "datum: not stated"]
    columns = "X,dX,dY,dZ,dA,dB,dC,u_dX,u_dY,u_dZ,u_dA,u_dB,u_dC,outside"
    rows = [f"{a},{-v}" + ",0" * 12 for a, v in zip(x, values, strict=True)]
    text = [*(f"# {k}" for k in [*head, "tool vector: 0, 0, 0 mm"]), columns, *rows, ""]
    path.write_text("\n".join(text), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("kind", "said"),
    [("L-POS", "L-POS stands in tables and in a grid"), ("L-VOL", "L-POS and L-VOL both correct positioning")],
)
def test_what_is_corrected_twice_is_said_and_simulated(run, bench, kind, said):
    grid = write_grid(bench / "grid.csv", kind, X, scale(X))
    status, _, err = simulate(run, bench, "--compensation", bench / "tables", grid)
    assert status == 1
    assert f"attention: {said}" in err and "the control applies the sum of both" in err
    values = load_campaign(bench / "out.h5").sets[0].readings[:, 0]
    np.testing.assert_allclose(values - values[2], -scale(X), rtol=0, atol=3e-6)
    folder = bench / "grids"
    folder.mkdir()
    copies = [write_grid(folder / f"{n}.csv", kind, X, scale(X)) for n in "ab"]
    status, _, err = simulate(run, bench, "--compensation", *copies)
    assert (status, f"attention: two {kind} grids of one side (linear)" in err) == (1, True)


def test_grids_of_both_formats_act_alike_and_a_measured_field_holds_for_its_own_tool_alone(run, bench):
    csv = write_grid(bench / "grid.csv", "L-VOL", X, scale(X))
    write_grid_hdf5(read_grid(csv), read_header(csv), bench / "grid.h5")
    found = []
    for path in (csv, bench / "grid.h5"):
        assert simulate(run, bench, "--compensation", path)[0] == 0
        found.append(load_campaign(bench / "out.h5").sets[0].readings[:, 0])
    np.testing.assert_array_equal(*found)
    np.testing.assert_allclose(found[0] - found[0][2], 0.0, atol=3e-6)
    blank = csv.read_text(encoding="utf-8").replace(",0,0,0,0,0,0,0,0,0,0,0,0", ",0,0,,,,0,0,0,,,,0")
    (bench / "field.csv").write_text(blank, encoding="utf-8")
    status, _, err = simulate(run, bench, "--compensation", bench / "field.csv")
    assert (status, "holds for its own tool vector or reference point only, 0, 0, 0 mm" in err) == (2, True)
    assert simulate(run, bench, "--compensation", bench / "field.csv", "--control-tool", "0,0,0")[0] == 0


def test_what_does_not_fit_is_named_with_its_file(run, bench):
    tables = bench / "tables"
    (bench / "empty").mkdir()
    rotary = bench / "rotary" / "ECC.csv"
    write_table(bench / "rotary", "ECC", [0.0, 90.0], [0.0, 1e-5])
    tilted = write_grid(bench / "tilted.csv", "L-VOL", X, scale(X), frame="workpiece")
    write_table(bench / "more", "EXX", X, scale(X))
    cases = [
        ([rotary], "ECC.csv: table of ECC, but machine 'virtual machine' has no axis C; its axes are X, Y, Z"),
        ([tilted], "tilted.csv: frame is 'workpiece'; expected machine, in which a control applies the values"),
        ([bench / "empty"], "empty: holds no table or grid"),
        ([bench / "absent.csv"], "absent.csv"),
        ([tables, bench / "more"], "two tables of EXX"),
        ([tables, "--clamp", "C"], "has no axis C"),
        ([tables, "--control-tool", "0,0,-0.15"], "--control-tool 0,0,-0.15 is a tool vector of 0.15 mm"),
        ([tables, "--smoothing", "X=0"], "expected a number > 0"),
        ([bench / "truth.h5"], "truth.h5"),
    ]
    for arguments, said in cases:
        (bench / "out.h5").unlink(missing_ok=True)
        status, text, err = simulate(run, bench, "--compensation", *arguments)
        assert (status, text, (bench / "out.h5").exists()) == (2, "", False)
        assert said in err and "Traceback" not in err
    for option in (("--control-tool", "0,0,-1"), ("--increment", "X=0.001"), ("--clamp", "X"), ("--smoothing", "X=9")):
        status, _, err = simulate(run, bench, *option)
        assert (status, f"{option[0]} says how a control compensates" in err) == (2, True)
    status, _, err = simulate(run, bench, "--compensation", tables / "EXX.csv", "-o", tables / "EXX.csv")
    assert status == 2
