"""The exchange text of ETALON, both ways."""

from dataclasses import replace

import numpy as np
import pytest
from exact_chain import Truth
from support.control_cases import error_table, spatial
from support.iso_files import FileChain, sections
from support.machines import exact_of
from support.made_up import made_up

import volid
from volid.compensation.package import Compensation
from volid.compensation.tables.sampling import Sampling
from volid.controllers import CONTROLS
from volid.controllers.base import Job, options_of
from volid.controllers.export import export
from volid.exceptions import InputError

GANTRY = volid.load_machine("models/wbXYZt_gantry.toml")
TRUNNION = volid.load_machine("models/wCAYXbZt_trunnion.toml")
TOOL = np.array([0.0, 0.0, -150.0])


def text_of(machine, tables, **options):
    declared = CONTROLS["etalon"].declaration
    at = np.array([np.mean(a.travel) for a in machine.axes])
    job = Job(machine, Compensation((), tuple(tables), ()), at, TOOL, "error", options_of(declared, options))
    (file,) = CONTROLS["etalon"].write(job).files
    return file.content


def read(text, machine=GANTRY, **options):
    return CONTROLS["etalon"].read({"m.txt": text}, machine, options_of(CONTROLS["etalon"].declaration, options))


def test_the_text_as_the_vendors_page_shows_it():
    lines = text_of(GANTRY, [error_table("EXY", [-280, -270], [-0.0013, -0.0002])]).splitlines()
    assert lines[0].startswith("//")
    assert lines[1:] == ["[EXY]", "Gridpoints = {", "-280.0 -0.0013", "-270.0 -0.0002", "}  // end of EXY"]


def test_constants_have_a_value():
    made = [
        error_table("EXC", [0, 360], [0.010, 0.010], kind="R-POR"),
        error_table("EAC", [0, 360], [2e-5, 2e-5], kind="R-POR"),
    ]
    found = {c[-1]: rows[:, -1] for c, rows in sections(text_of(TRUNNION, made, location_errors="constants"))}
    assert found["X0C"] == pytest.approx([-0.010]) and found["A0C"] == pytest.approx([-2e-5])
    assert not found["EXC"].any()


def test_a_text_of_the_vendors_page_is_read():
    text = (
        "// Every parameter is specified in a block.\n[C0B]\nVALUE = 0.000022355737\n[A0B]\nVALUE = 0.000047622950\n"
        "[EXY]\nGridpoints = {\n  -280.0 -0.001358635132\n -270.0 -0.000240680764\n\n 270.0 -0.000316265101\n}  // end of EXY\n"
    )
    found = {t.function: t for t in read(text, volid.load_machine("models/wBZbXYt_rotary_table.toml")).tables}
    assert found["EXY"].positions.tolist() == [-280.0, -270.0, 270.0]
    assert found["EXY"].forward.tolist() == [-0.001358635132, -0.000240680764, -0.000316265101]
    # B carries the workpiece: tool relative to workpiece is minus the location of its line
    np.testing.assert_array_equal(found["ECB"].forward, -0.000022355737)
    np.testing.assert_array_equal(found["EAB"].forward, -0.000047622950)


def test_numbers_are_read_as_the_same_numbers():
    rng = np.random.default_rng(31)
    tables = [
        error_table(f, np.sort(rng.uniform(0, 900, 9)), rng.normal(size=9) * 10.0 ** rng.integers(-17, -2, size=9))
        for f in ("EXX", "EBX", "EYY", "EAZ")
    ]
    held = {t.function: t for t in read(text_of(GANTRY, tables)).tables}
    for one in tables:
        at = np.searchsorted(held[one.function].positions, one.positions)  # axis X: positions of both its functions
        np.testing.assert_array_equal(held[one.function].positions[at], one.positions)
        np.testing.assert_array_equal(held[one.function].forward[at], one.forward)


@pytest.mark.parametrize("location_errors", ["functions", "constants"])
def test_the_text_gives_the_deviation_of_the_exact_chain(location_errors):
    rng, tables, truth = np.random.default_rng(32), [], Truth()
    for a in TRUNNION.axes:
        x = np.linspace(*a.travel, 5)
        for c in "XYZABC":
            y = rng.normal(scale=3e-6 if c in "ABC" else 3e-3, size=5)
            tables.append(error_table(f"E{c}{a.letter}", x, y, kind="L-VOL"))
            truth.functions[f"E{c}{a.letter}"] = lambda q, x=x, y=y: np.interp(q, x, y)
    found = sections(text_of(TRUNNION, tables, location_errors=location_errors))
    # chain, centres and tool stand elsewhere: those of the machine
    about = [([f"P{c}{a.letter}" for c in "XYZ"], np.array([a.point])) for a in TRUNNION.axes if not a.is_linear]
    chain = FileChain([*found, (["P0X", "P0Y", "P0Z"], TOOL[None]), *about], "CAYXZ", 2)
    q = np.stack([rng.uniform(*a.travel, 200) for a in TRUNNION.axes], axis=1)
    wanted = exact_of(TRUNNION).deviation(q, TOOL, truth)[:, :3]
    # 5e-5 mm: five axes of 1e-5 mm each between the points, and terms of second order
    np.testing.assert_allclose(chain.deviation({a: q[:, i] for i, a in enumerate(TRUNNION.letters)}), wanted, atol=5e-5)


def test_texts_read_again_give_the_solutions_deviation_within_the_interpolation_bound():
    machine, bound = volid.load_machine("models/wYXbZt_vertical.toml"), 5e-5
    solution, rng = made_up(machine), np.random.default_rng(33)
    made = export(solution, "etalon", ["L-VOL"], sampling=Sampling(max_error=bound))
    q = np.stack([rng.uniform(*a.travel, 500) for a in machine.axes], axis=1)
    found = made.control().expected(q, np.tile(made.job.tool, (500, 1))).point
    wanted = np.asarray(solution.deviation(q, made.job.tool))[:, :3]
    most = (bound + 1e-5) * len(made.job.compensation.tables)  # each keeps the bound; at worst they add up
    assert np.abs(wanted).max() > 10 * most
    assert np.abs(found - wanted).max() < most


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "m.txt: no error parameters"),
        ("VALUE = 1\n", r"m.txt, line 1: 'VALUE = 1'; expected the name of a parameter in brackets"),
        ("[EXX]\nGridpoints = {\n0 0.1\n", r"m.txt, line 1: \[EXX\] is not closed"),
        ("[EXX]\nGridpoints = {\n}\n", r"m.txt, line 1: \[EXX\] has no points"),
        ("[EXX]\nGridpoints = {\n0 0.1 2\n}\n", "m.txt, line 3: 3 numbers; expected 2: X EXX"),
        ("[EXX]\nGridpoints = {\n0 nan\n}\n", "m.txt, line 3, EXX: 'nan'"),
        ("[EXX]\nVALUE = 0.1\n", r"m.txt, line 1: \[EXX\] is followed by 'VALUE = 0.1'"),
        ("[C0Y]\nVALUE = 1e-5\n[C0Y]\nVALUE = 1e-5\n", r"m.txt, line 3: \[C0Y\] stands twice"),
        ("[EXQ]\nGridpoints = {\n0 0.1\n}\n", r"m.txt, line 1: \[EXQ\] is followed by"),
        ("[PXC]\nVALUE = 3\n", r"m.txt, line 1: \[PXC\] describes the machine"),
        ("[EXA]\nGridpoints = {\n0 0.1\n}\n", "EXA: the machine has no axis A"),
    ],
)
def test_texts_that_cannot_be_understood_are_refused_with_their_line(text, message):
    with pytest.raises(InputError, match=message):
        read(text)


def test_grids_are_refused_and_the_nearest_is_named():
    declared = CONTROLS["etalon"].declaration
    job = Job(GANTRY, spatial(), np.zeros(3), TOOL, "error", options_of(declared, {}))
    with pytest.raises(InputError, match="no grids.*isg-volcomp carries grids".replace(".*", "[^$]*")):
        CONTROLS["etalon"].write(job)


def test_the_order_of_axes_and_the_centres_are_told():
    declared, made = CONTROLS["etalon"].declaration, (error_table("EXC", [0, 360], [0.0, 0.001]),)
    job = Job(TRUNNION, Compensation((), made, ()), np.zeros(5), TOOL, "error", options_of(declared, {}))
    (note,) = CONTROLS["etalon"].write(job).notes
    assert note.startswith("Axes from workpiece to tool, not in the file: CAYXZ; C about (") and "along" not in note
    axes = tuple(replace(a, direction=(0.0, 0.0, -1.0)) if a.letter == "C" else a for a in TRUNNION.axes)
    (note,) = CONTROLS["etalon"].write(replace(job, machine=replace(TRUNNION, axes=axes))).notes
    assert " mm along (0, 0, -1); A about (" in note


def test_its_files_are_recognised():
    assert CONTROLS["etalon"].recognises("a.txt", "// made\n[EXX]\nGridpoints = {\n0 1\n}\n")
    assert not CONTROLS["etalon"].recognises("a.toml", "[axis.X]\ntravel = [0, 1]\n")
