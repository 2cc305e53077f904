"""LinuxCNC itself, in simulation, loads volid's files and moves the machine: motor commands are those that volid predicts."""

import numpy as np
import pytest
from support.control_cases import error_table, job
from support.control_contract import TRUNNION, turning
from support.linuxcnc_simulator import Joint, Setup, needs_linuxcnc, run
from support.places import ROOT

import volid
from volid.compensation.package import Compensation
from volid.controllers import CONTROLS
from volid.controllers.export import write

pytestmark = [needs_linuxcnc, pytest.mark.slow]
ALIKE = 1e-6  # mm
BEYOND = 25.0  # mm that the joints may travel beyond the tables


@pytest.fixture(scope="module")
def positioned():
    """Solution of a published positioning test: X, Y, Z, five runs in both directions."""
    return volid.fit(volid.load_campaign(ROOT / "datasets/published_positioning/campaign.toml"))


def sections(text: str) -> dict[int, str]:
    """Lines of an INI fragment by joint."""
    found, joint = {}, None
    for line in text.splitlines():
        if line.startswith("[JOINT_"):
            joint = int(line[7:-1])
        elif joint is not None:
            found[joint] = found.get(joint, "") + line + "\n"
    return found


def unit(made, letter: str) -> float:
    """What positions [mm or °] are divided by for the machine unit."""
    return 25.4 if made.job.options["units"] == "inch" and made.job.machine.axis(letter).is_linear else 1.0


def setup_of(made, folder) -> Setup:
    """A simulated machine with the files of an export as they are saved: joints in LinuxCNC's order of the letters."""
    volid.save_export(made, folder / "control", predict=False)
    files = {p.name: p.read_bytes() for p in (folder / "control").iterdir() if p.suffix == ".comp"}
    lines = sections((folder / "control" / "linuxcnc.ini").read_text(encoding="utf-8"))
    joints = []
    for n, letter in enumerate(letters_of(made)):
        low, high = made.job.machine.axis(letter).travel
        ends = [(v + by) / unit(made, letter) for v, by in ((low, -BEYOND), (high, BEYOND))]
        home = min(max(0.0, low), high) / unit(made, letter)
        joints.append(Joint(letter, *ends, home, lines.get(n, "")))
    return Setup(joints, files, units=made.job.options["units"])


def letters_of(made) -> list[str]:
    """Letters of the joints: for these machines LinuxCNC's order, X, Y, Z, A, B, C."""
    return [a for a in "XYZABC" if a in made.job.machine.letters]


def targets(made) -> np.ndarray:
    """Positions of each axis there and back: nodes, places between them, and beyond both ends (m, axes) [mm or °]."""
    shares = np.array([-0.01, 0.1, 0.25, 0.61803, 1.01, 0.873, 0.5, 0.3141592, 0.0, 1.0, -0.02])
    ends = np.array([made.job.machine.axis(a).travel for a in letters_of(made)])
    return ends[:, 0] + shares[:, None] * np.ptp(ends, axis=1)


def moved(made, folder) -> tuple[np.ndarray, np.ndarray]:
    """Motor commands of LinuxCNC, and those that volid predicts, both (m, axes) in the order of the joints [mm or °]."""
    setup, letters, places = setup_of(made, folder), letters_of(made), targets(made)
    units = np.array([unit(made, a) for a in letters])
    steps = [
        {"mdi": "G53 G0 " + " ".join(f"{a}{v:.12f}" for a, v in zip(letters, p, strict=True))} for p in places / units
    ]
    pins = [f"joint.{n}.{pin}" for pin in ("motor-pos-cmd", "pos-fb") for n in range(len(letters))]
    rows, shown = np.hsplit(np.array(run(setup, [{"home": True}, *steps], pins).rows), 2)
    home = np.array([j.home for j in setup.joints])
    np.testing.assert_allclose(rows[0], home, rtol=0, atol=1e-12, err_msg="nothing is corrected directly after homing")
    np.testing.assert_allclose(
        shown[1:] * units, places, rtol=0, atol=ALIKE, err_msg="displays show what was commanded"
    )
    ways = np.sign(np.diff(np.vstack([home * units, places]), axis=0))
    order = [letters.index(a) for a in made.job.machine.letters]
    predicted = made.control().command(places[:, order], np.zeros(3), ways[:, order])
    return rows[1:] * units, predicted[:, [made.job.machine.letters.index(a) for a in letters]]


@pytest.mark.parametrize("kind", [0, 1])
def test_a_fitted_compensation_moves_the_motors_as_predicted(positioned, kind, tmp_path):
    made = volid.export(positioned, "linuxcnc", ["L-POS"], options={"comp_file_type": kind})
    found, predicted = moved(made, tmp_path)
    assert np.abs(found - predicted).max() < ALIKE
    assert np.abs(found - targets(made)).max() > 0.005, "something is corrected"


def test_backlash_alone_is_the_mean_reversal(positioned, tmp_path):
    made = volid.export(positioned, "linuxcnc", ["L-POS"], options={"reversal": "backlash"})
    found, predicted = moved(made, tmp_path)
    assert np.abs(found - predicted).max() < ALIKE


def test_backlash_of_either_sign(tmp_path):
    """X stands 4 µm further in + than in -, Y 6 µm less far; expected values written out by hand."""
    x = error_table("EXX", [0, 1000], [0.002, 0.002], [-0.002, -0.002])
    y = error_table("EYY", [0, 600], [-0.003, -0.003], [0.003, 0.003])
    made = job("linuxcnc", Compensation(("L-POS",), (x, y), ()), reversal="backlash")
    export = write(CONTROLS["linuxcnc"], made, ())
    found, predicted = moved(export, tmp_path)
    assert np.abs(found - predicted).max() < ALIKE
    up = np.sign(np.diff(np.vstack([[0.0, 0.0], targets(export)[:, :2]]), axis=0))
    np.testing.assert_allclose(found[:, :2] - targets(export)[:, :2], up * [-0.002, 0.003], rtol=0, atol=ALIKE)


def test_inches_and_a_rotary_joint(tmp_path):
    """X is 10 µm too far at 0 in +, 13 µm in -; C is 40 µrad too far at 180°; expected values written out by hand."""
    x = error_table("EXX", [-300, 0, 300], [0.0, 0.010, -0.004], [0.002, 0.013, -0.001])
    made = Compensation(("L-POS", "R-POS"), (x, *turning().tables), ())
    export = write(CONTROLS["linuxcnc"], job("linuxcnc", made, machine=TRUNNION, comp_file_type="1", units="inch"), ())
    found, predicted = moved(export, tmp_path)
    assert np.abs(found - predicted).max() < ALIKE
    letters, places = letters_of(export), targets(export)
    at_middle = int(np.argmin(np.abs(places[:, 0])))  # X = 0, C = 180, reached in -
    correction = found[at_middle] - places[at_middle]
    assert correction[letters.index("X")] == pytest.approx(-0.013, abs=ALIKE)
    assert correction[letters.index("C")] == pytest.approx(-np.rad2deg(40e-6), abs=ALIKE)


STEPS = {  # mm, of the correction at reversal, at MAX_ACCELERATION in mm/s²: whether the motor makes it
    "X": (0.020, 1e5, True),
    "Y": (0.030, 1e5, False),
    "Z": (-0.045, 1e5, False),
    "A": (0.060, 1e5, True),
    "U": (0.0004, 2e3, True),
    "V": (0.0007, 2e3, False),
    "W": (-0.0012, 2e3, True),
}


def test_the_ramp_at_reversal_leaves_out_steps_of_one_size():
    """With A the MAX_ACCELERATION and T = 1 ms, a step from A T² / 4 to A T² / 2 is not made, whichever its sign."""
    joints, files = [], {}
    for n, (letter, (step, acceleration, made)) in enumerate(STEPS.items()):
        quarter = 0.25 * acceleration * 1e-3**2
        assert made == (not quarter < abs(step) <= 2 * quarter)
        lines = f"COMP_FILE_TYPE = 1\nCOMP_FILE = joint{n}.comp"
        joints.append(Joint(letter, -10, 300, 0.0, lines, acceleration=acceleration))
        files[f"joint{n}.comp"] = f"0 0 {step}\n300 0 {step}\n"
    steps = [{"mdi": "G53 G0 " + " ".join(f"{a}{x}" for a in STEPS)} for x in (100, 50)]
    rows = run(Setup(joints, files), [{"home": True}, *steps], [f"joint.{n}.motor-pos-cmd" for n in range(7)]).rows
    assert rows[1] == pytest.approx([100.0] * 7, abs=ALIKE)
    assert rows[2] == pytest.approx([50.0 + made * step for step, _, made in STEPS.values()], abs=ALIKE)
