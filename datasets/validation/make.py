"""Makes these two SYNTHETIC campaigns again, byte for byte: python make.py [FOLDER].

Needs NumPy and SciPy only: the machine is the one of ../vertical_multilateration, from the exact chain of 4x4 matrices in
tests/exact_chain/, which shares no code with volid. README.md says what is in which file.
"""

import copy
import sys
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[1] / "tests"))

from exact_chain import ExactMachine, Truth, random_truth  # noqa: E402

MACHINE_SEED, SEED = 1, 16  # of ../vertical_multilateration/make.py; of the readings here
STRUCTURE = "w Y' X' b Z (C) t"
TRAVEL = {"X": (0.0, 1000.0), "Y": (0.0, 600.0), "Z": (-500.0, 0.0)}  # mm
TOOLS = np.array([[0.0, 0.0, -190.0], [60.0, -50.0, -170.0]])  # mm
STATIONS = {  # true positions in the workpiece frame, mm
    "V1": (517.428, -402.816, -611.237),
    "V2": (1392.164, 284.539, -173.884),
    "V3": (466.713, 1011.945, -288.361),
    "V4": (-402.377, 331.062, -760.519),
}
N_SEGMENT = 30  # distances of one station with one tool after the other
STEP, OFFSET = 20.0, 7.0  # mm: positions stand beside the multiples of 20 mm of the first campaign
U_CONSTANT, U_PROPORTIONAL = 0.0003, 3e-7  # mm, mm/mm
KNOCK = 12e-6  # rad: by which a collision has changed the squareness of Y to X

MANIFEST = """\
# SYNTHETIC: computed by make.py, not measured. See README.md.
format = "volid-campaign/1"
machine = "../vertical_multilateration/machine.toml"
title = "SYNTHETIC validation of a virtual vertical machining centre{title}"

[conditions]
synthetic = true
machine_condition = "60 min axis cycle over the whole travels before the first station"
ambient_temperature_C = 20.0
active_compensations = []
instrument = "virtual tracking interferometer, beam interrupted at every change of tool or station"
"""

SET = f"""
[[set]]
name = "validation"
kind = "distance"
file = "{{file}}"
relative = true                    # one unknown dead path for every station and segment
u = {{{{ constant = {U_CONSTANT}, proportional = {U_PROPORTIONAL} }}}}
"""


def after_the_knock(truth: Truth) -> Truth:
    """The same machine with another squareness of Y to X."""
    found = copy.deepcopy(truth)
    found.constants["EC0Y"] += KNOCK
    return found


def readings(machine: ExactMachine, truth: Truth, rng: np.random.Generator) -> list[str]:
    """Rows of one file."""
    rows = []
    for name, station in STATIONS.items():
        for segment, tool in enumerate(TOOLS, start=1):
            steps = {a: int(np.ptp(TRAVEL[a]) / STEP) for a in "XYZ"}
            xyz = {a: TRAVEL[a][0] + OFFSET + STEP * rng.integers(steps[a], size=N_SEGMENT) for a in "XYZ"}
            q = machine.in_axis_order(xyz)
            dead = float(rng.uniform(-300.0, 300.0))
            exact = np.linalg.norm(machine.functional_point(q, tool, truth) - station, axis=1) + dead
            distance = exact + np.hypot(U_CONSTANT, U_PROPORTIONAL * exact) * rng.standard_normal(N_SEGMENT)
            numbers = np.column_stack([*(xyz[a] for a in "XYZ"), np.tile(tool, (N_SEGMENT, 1))])
            rows += [
                f"{','.join(f'{v:g}' for v in p)},{name},{segment},{d:.5f}"
                for p, d in zip(numbers, distance, strict=True)
            ]
    return rows


def write(folder: Path) -> None:
    """Write all files of the dataset but README.md and this program into `folder`."""
    machine = ExactMachine(STRUCTURE, TRAVEL)
    truth = random_truth(machine, np.random.default_rng(MACHINE_SEED))
    folder.mkdir(parents=True, exist_ok=True)
    stations = "".join(
        f'\n[[station]]\nname = "{name}"\nposition = {[round(v / 10.0) * 10.0 for v in p]}   # rounded to 10 mm\n'
        for name, p in STATIONS.items()
    )
    cases = (
        ("campaign", "validation", truth, ""),
        ("after_knock", "after_knock", after_the_knock(truth), ", after a collision"),
    )
    for seed, (manifest, table, true, title) in enumerate(cases, start=SEED):
        text = MANIFEST.format(title=title) + stations + SET.format(file=f"{table}.csv")
        header = ["# SYNTHETIC, computed by make.py; mm", "X,Y,Z,tool_x,tool_y,tool_z,station,segment,distance"]
        lines = [*header, *readings(machine, true, np.random.default_rng(seed))]
        (folder / f"{manifest}.toml").write_bytes(text.encode())
        (folder / f"{table}.csv").write_bytes(("\n".join(lines) + "\n").encode())


if __name__ == "__main__":
    write(Path(sys.argv[1]) if len(sys.argv) > 1 else HERE)
