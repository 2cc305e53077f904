"""Corrected programs on the exact machine: its functional point follows the programmed path, within chord and grid error."""

import numpy as np
import pytest
from exact_chain import ExactMachine, random_truth
from scipy.interpolate import RegularGridInterpolator
from support.gcode import RS274, dense, distances, interpreted, lines_of
from support.programs import CAM, CASES, LENGTHS, OFFSETS, TOOL, line, random_program

import volid
from volid.compensation.tables.error_table import ErrorTable

MACHINE = ExactMachine("w Y' X' b Z t", {"X": (0.0, 1000.0), "Y": (0.0, 600.0), "Z": (-500.0, 0.0)})
TRUTH = random_truth(MACHINE, np.random.default_rng(20), scale=4.0)
GRID_TOOL = (0.0, 0.0, -100.0)  # not the one of the programs: rotations act through the lever arm between them
NODES = [np.linspace(*MACHINE.travel[a], n) for a, n in zip("XYZ", (21, 13, 11), strict=True)]
PRINTED = 0.01  # mm: inches are printed with four decimals, 2.2 µm in space, twice; an arc turns both about its centre
SECOND_ORDER = 2e-5  # mm: a correction of 0.1 mm where errors change by 1e-4, and rotations of 1e-4 squared times 50 mm


def exact(places, tool=TOOL) -> np.ndarray:
    """Deviation (m, 6) of the exact machine at places (m, 3) in the order X, Y, Z."""
    return MACHINE.deviation(MACHINE.in_axis_order(dict(zip("XYZ", places.T, strict=True))), tool, TRUTH)


MESH = np.stack([m.ravel(order="F") for m in np.meshgrid(*NODES, indexing="ij")], axis=1)
VALUES = exact(MESH, GRID_TOOL)
GRID = volid.Grid(
    "L-VOL", ("X", "Y", "Z"), tuple(NODES), MESH, VALUES, np.full_like(VALUES, np.nan), MESH[:, 0] > 1e9, GRID_TOOL,
    "machine", "",
)  # fmt: skip
TABLE = RegularGridInterpolator(NODES, VALUES.reshape(*map(len, NODES), 6, order="F"))


def by_grid(places) -> np.ndarray:
    """Translations (m, 3) that the grid gives for the programs' tool, by SciPy."""
    found = TABLE(places)
    return found[:, :3] + np.cross(found[:, 3:], np.subtract(TOOL, GRID_TOOL))


def corrected(case, **options) -> str:
    setting = volid.ProgramSetting(offsets=OFFSETS, lengths=LENGTHS, **options)
    return volid.apply_to_program(GRID, case.text, setting).text


def feed_points(text) -> np.ndarray:
    """Where the drives go in feed, densely."""
    moves = [m for m in lines_of(text, OFFSETS, LENGTHS) if m[0] == 1]
    return np.concatenate([dense(np.stack([a, b])) for _, a, b in moves])


def reached(places) -> np.ndarray:
    """Actual functional point less the tool vector, (m, 3): what the program means by a place."""
    return places + exact(places)[:, :3]


@pytest.mark.parametrize("chord", [0.001, 0.01])
@pytest.mark.parametrize("name", CASES)
def test_the_functional_point_follows_the_programmed_path(name, chord):
    ideal = CASES[name].ideal()
    driven = feed_points(corrected(CASES[name], chord=chord))
    grid_error = np.linalg.norm(exact(ideal)[:, :3] - by_grid(ideal), axis=1).max()
    apart = distances(reached(driven), ideal)
    assert np.linalg.norm(exact(ideal)[:, :3], axis=1).max() > 0.02, "there is something to correct"
    assert apart.max() < chord + grid_error + SECOND_ORDER
    assert distances(ideal, reached(driven)).max() < chord + grid_error + SECOND_ORDER, "all of the path is there"


def test_tables_of_the_kinematic_chain_with_reversal():
    """All 18 functions as dense tables: what is left is the chord. X comes back with its other direction, Y and Z keep theirs."""
    truth = random_truth(MACHINE, np.random.default_rng(4), scale=4.0, reversal=True)
    truth.constants.clear()
    tables = []
    for name, function in truth.functions.items():
        x = np.linspace(*MACHINE.travel[name[2]], 301)
        half = 0.5 * truth.reversal[name](x) if name in truth.reversal else 0.0
        values = function(x) + half, function(x) - half
        tables.append(ErrorTable("L-VOL", name, x, *values, np.zeros((301, 2)), x > 1e9, "kinematic model", 0.0))
    control = volid.Control(volid.load_machine("models/wYXbZt_vertical.toml"), tuple(tables))
    setting = volid.ProgramSetting(offsets=OFFSETS, lengths=LENGTHS, chord=0.002)
    text = CASES["lines"].text.replace("X-300", "X-300\nZ0\nY100")
    made = volid.apply_to_program(control, text, setting)
    ideal = line((0, 0, 50), (500, 300, -50), (-300, 300, -50), (-300, 300, 0), (-300, 100, 0))
    ideal = ideal + np.array(OFFSETS["G54"]) + [0, 0, LENGTHS[1]]
    moves = [m for m in lines_of(made.text, OFFSETS, LENGTHS) if m[0] == 1]
    way = np.array([1.0, 1.0, -1.0])
    for _, a, b in moves:
        if np.linalg.norm(b - a) > 0.05:  # else it is taken up
            way = np.where(np.abs(b - a) > 0.5, np.sign(b - a), way)
            q = dense(np.stack([a, b]))
            both = [
                MACHINE.in_axis_order(dict(zip("XYZ", np.broadcast_to(v, q.shape).T, strict=True))) for v in (q, way)
            ]
            apart = q + MACHINE.deviation(both[0], TOOL, truth, both[1])[:, :3]
            assert distances(apart, ideal).max() < 0.002 + SECOND_ORDER
    assert made.counted.taken_up >= 3


def test_a_part_lies_where_its_origin_was_touched():
    """Touched at the position that the control shows, the origin lies beside it by the machine's error there."""
    case, origin = CASES["lines"], np.add([OFFSETS["G54"]], [[0.0, 0.0, LENGTHS[1]]])
    driven = feed_points(corrected(case, touched=True))
    ideal = case.ideal()
    beside = exact(origin)[:, :3]
    grid_error = np.linalg.norm(exact(ideal)[:, :3] - by_grid(ideal), axis=1).max()
    grid_error += np.linalg.norm(beside - by_grid(origin))
    assert np.linalg.norm(beside) > 0.015
    assert distances(reached(driven), ideal + beside).max() < 0.001 + grid_error + SECOND_ORDER


@pytest.mark.parametrize("chord", [0.0004, 0.01])
@pytest.mark.parametrize("name", CASES)
def test_the_new_path_lies_within_the_chord_of_the_path_that_the_grid_asks_for(name, chord):
    """Without the grid's own error: what is left is the chord, and corrections of corrections."""
    driven = feed_points(corrected(CASES[name], chord=chord))
    apart = distances(driven + by_grid(driven), CASES[name].ideal())
    assert apart.max() < chord + SECOND_ORDER
    if name != "two work offsets":
        assert apart.max() > 0.02 * chord, "and is not many times more blocks than needed"


def test_the_bound_that_is_reported_holds_and_is_no_wild_one():
    case = CASES["lines"]
    made = volid.apply_to_program(GRID, case.text, volid.ProgramSetting(offsets=OFFSETS, lengths=LENGTHS, chord=0.005))
    driven = feed_points(made.text)
    apart = distances(driven + by_grid(driven), case.ideal()).max()
    assert apart - SECOND_ORDER < made.counted.chord < 0.005
    assert made.counted.chord < 5 * apart


@pytest.mark.skipif(RS274 is None, reason="LinuxCNC's interpreter rs274 is not installed")
@pytest.mark.parametrize("name", CASES)
def test_linuxcnc_reads_both_programs_as_they_are_meant(name, tmp_path):
    """Coordinates are printed with four decimals: half of it is 0.05 µm, or 1.3 µm in inches."""
    case, rounding = CASES[name], 1.3e-3 if name == "inches" else 1e-4
    for text, wanted in ((case.text, case.ideal()), (corrected(case), None)):
        found = np.concatenate([p for code, p in interpreted(text, tmp_path, OFFSETS, LENGTHS) if code])
        wanted = feed_points(text) if wanted is None else wanted
        assert distances(found, wanted).max() < 2.0 * rounding
        assert distances(wanted[::97], dense(found, 0.5)).max() < 2.0 * rounding + 1e-4


def feed_by_rs274(text, folder) -> np.ndarray:
    moves = [p for code, p in interpreted(text, folder, OFFSETS, LENGTHS) if code]
    return np.concatenate([dense(p, 1.0) if len(p) == 2 else p for p in moves])


def nearness(lines, found) -> float:
    """Largest distance between lines (m, 2, 3) and places of a path, either way."""
    own = np.concatenate([dense(pair, 1.0) for pair in lines])
    return max(distances(own[::3], found, 12).max(), distances(found[::7], own, 12).max())


@pytest.mark.skipif(RS274 is None, reason="LinuxCNC's interpreter rs274 is not installed")
def test_linuxcnc_reads_a_program_as_cam_writes_it_and_its_correction(tmp_path):
    made = volid.apply_to_program(GRID, CAM, volid.ProgramSetting(offsets=OFFSETS, lengths=LENGTHS))
    assert nearness(made.nominal, feed_by_rs274(CAM, tmp_path)) < PRINTED
    assert nearness(made.corrected, feed_by_rs274(made.text, tmp_path)) < PRINTED


@pytest.mark.skipif(RS274 is None, reason="LinuxCNC's interpreter rs274 is not installed")
@pytest.mark.parametrize("seed", range(6))
def test_linuxcnc_follows_every_mode_as_volid_does(seed, tmp_path):
    text = random_program(np.random.default_rng(seed))
    made = volid.apply_to_program(GRID, text, volid.ProgramSetting(offsets=OFFSETS, tool=TOOL))
    assert nearness(made.nominal, feed_by_rs274(text, tmp_path)) < PRINTED
    assert nearness(made.corrected, feed_by_rs274(made.text, tmp_path)) < PRINTED
