"""Makes this SYNTHETIC campaign and its truth again, byte for byte: python make.py [FOLDER].

Needs NumPy and SciPy only: the machine is the exact chain of 4x4 matrices in tests/exact_chain/, which shares no code
with volid. Error motions are sums of sines, not splines. README.md says what is in which file.
"""

import sys
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[1] / "tests"))

from exact_chain import ExactMachine, random_truth  # noqa: E402
from exact_chain.ball_bar import BallBar, Drives, turn  # noqa: E402

SEED = 16
STRUCTURE = "w Y' X' b Z (C) t"  # as models/wYXbZt_vertical
TRAVEL = {"X": (0.0, 1000.0), "Y": (0.0, 600.0), "Z": (-500.0, 0.0)}
TOOL = (0.0, 0.0, -150.0)  # ball on the tool from the spindle nose, mm
SOCKET = (500.0, 300.0, -420.0)  # where the program has the ball in the socket, mm
OFF = (0.031, -0.018, 0.012)  # where it really stands, less that
RADIUS = 150.0  # mm
LENGTH = 0.0004  # mm: true length of the bar less the calibrated one
U, LENGTH_U = 0.0003, 0.0005  # mm
FEED = 1000.0  # mm/min
LAG = {"X": 0.0080, "Y": 0.0082, "Z": 0.0079}  # s, by which an axis is behind its command
REVERSAL = {"X": 0.004, "Y": -0.002, "Z": 0.003}  # mm, added to the reversal value of positioning
SPIKE = {"X": (0.009, 0.012), "Y": (0.006, 0.005), "Z": (0.004, 0.007)}  # mm, at the axis's + and - end
DECAY = 1.5  # degrees: a spike falls to 1/e
STEP = 2.0  # degrees
PLANES = {"XY": (360.0, 2), "YZ": (220.0, 1), "ZX": (220.0, 1)}  # arc, runs of each sense

MACHINE = f"""\
# The machine of models/wYXbZt_vertical.toml. SYNTHETIC campaign: no such machine was measured.
format = "volid-machine/1"
name = "Virtual cross-table vertical machining centre"
structure = "{STRUCTURE}"

[axis.X]
travel = [0.0, 1000.0]
[axis.Y]
travel = [0.0, 600.0]
[axis.Z]
travel = [-500.0, 0.0]

[model.functions]
EXX = {{ reversal = true }}
EYY = {{ reversal = true }}
EZZ = {{ reversal = true }}
"""

MANIFEST = f"""\
# SYNTHETIC: computed by make.py, not measured. See README.md.
format = "volid-campaign/1"
machine = "machine.toml"
title = "SYNTHETIC ball-bar test of a virtual vertical machining centre in three planes"

[conditions]                       # the record of ISO/TR 16907 9.1, as a real campaign would have it
synthetic = true
machine_condition = "30 min cycle of all axes before the first circle"
ambient_temperature_C = 20.0
feed = "{FEED:g} mm/min"
active_compensations = []
instrument = "virtual double ball bar of {RADIUS:g} mm, calibrated"

[[station]]
name = "ball"
position = [{SOCKET[0]}, {SOCKET[1]}, {SOCKET[2]}]
"""

SET = """
[[set]]
name = "{name}"
kind = "distance"
file = "{plane}.csv"
relative = false
calibrated_u = {length_u}
tool = [{tool}]
u = {u}
"""


DRIVES = Drives(FEED, LAG, SPIKE, DECAY)


def virtual() -> BallBar:
    """The machine with the errors of a good machine and reversal of positioning, and the bar on it."""
    machine = ExactMachine(STRUCTURE, TRAVEL)
    truth = random_truth(machine, np.random.default_rng(SEED), reversal=True)
    for axis, value in REVERSAL.items():
        truth.reversal[f"E{axis}{axis}"] = truth.reversal[f"E{axis}{axis}"].times(0.2).plus(value)
    return BallBar(machine, truth, TOOL, SOCKET, RADIUS, OFF, LENGTH, digits=5)


def rows(bar: BallBar, plane: str, rng: np.random.Generator) -> list[str]:
    """Rows of a set: runs of both senses by turns."""
    arc, runs = PLANES[plane]
    found = []
    for run in range(2 * runs):
        sense = 1 if run % 2 == 0 else -1
        angle = turn(plane, arc, sense, STEP)
        q, ways = bar.command(plane, angle, sense)
        read = bar.read(plane, angle, sense, DRIVES) + U * rng.standard_normal(len(angle))
        found += [
            f"{','.join(f'{v + 0.0:.5f}' for v in p)},{','.join(f'{v + 0.0:g}' for v in w)},ball,{run + 1},{r:.5f}"
            for p, w, r in zip(q, ways, read, strict=True)
        ]
    return found


def terms(bar: BallBar, plane: str) -> list[str]:
    """Rows of truth_terms.csv: second harmonics of the true path, and what the instrument and the drives were given."""
    a, b = plane
    squareness, scale = bar.harmonics(plane)
    values = {
        f"squareness_{plane}": squareness,
        f"scale_{plane}": scale,
        f"B_E{a}{a}": bar.reversal(a),
        f"B_E{b}{b}": bar.reversal(b),
        f"mismatch_{plane}": 1e3 * (LAG[a] - LAG[b]),
    }
    for k, letter in enumerate(plane):
        for sign, end in enumerate((0, 180)):
            for name in (plane, plane[::-1]):
                values[f"spike_{name}_{(end + 90 * k) % 360}"] = SPIKE[letter][sign]
    return [f"{plane},{name},{value + 0.0:.9f}" for name, value in values.items()]


def write(folder: Path) -> None:
    """Write all files of the dataset but README.md and this program into `folder`."""
    rng = np.random.default_rng(SEED + 1)
    bar = virtual()
    tool = ", ".join(str(c) for c in TOOL)
    names = {plane: f"{'circle' if arc == 360.0 else 'arc'} {plane}" for plane, (arc, _) in PLANES.items()}
    sets = [SET.format(name=n, plane=p, length_u=LENGTH_U, tool=tool, u=U).rstrip("\n") for p, n in names.items()]
    synthetic = "# SYNTHETIC, computed by make.py; mm, rad, ms"
    header = ",".join(
        [*bar.machine.axes, *(f"{axis}_dir" for axis in bar.machine.axes), "station", "segment", "distance"]
    )
    texts = {
        "machine.toml": [MACHINE.rstrip("\n")],
        "campaign.toml": [MANIFEST.rstrip("\n"), *sets],
        **{f"{plane}.csv": [synthetic, header, *rows(bar, plane, rng)] for plane in PLANES},
        "truth_terms.csv": [synthetic, "plane,term,value", *(t for p in PLANES for t in terms(bar, p))],
    }
    folder.mkdir(parents=True, exist_ok=True)
    for name, lines in texts.items():
        (folder / name).write_bytes(("\n".join(lines) + "\n").encode())


if __name__ == "__main__":
    write(Path(sys.argv[1]) if len(sys.argv) > 1 else HERE)
