"""Makes these SYNTHETIC surveys again, byte for byte: python make.py [FOLDER].

Needs NumPy and SciPy only: the machine is the one of ../vertical_multilateration, from the exact chain of 4x4 matrices in
tests/exact_chain/, which shares no code with volid. README.md says what is in which file.
"""

import copy
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[1] / "tests"))

from exact_chain import ExactMachine, Truth, random_truth  # noqa: E402

MACHINE_SEED, SEED = 1, 21  # of ../vertical_multilateration/make.py; of the readings of the first survey
STRUCTURE = "w Y' X' b Z (C) t"
TRAVEL = {"X": (0.0, 1000.0), "Y": (0.0, 600.0), "Z": (-500.0, 0.0)}  # mm
TOOLS = np.array([[0.0, 0.0, -150.0], [80.0, 0.0, -250.0], [0.0, 90.0, -200.0]])  # mm
STATIONS = {  # true positions in the workpiece frame, mm
    "S1": (-423.271, -243.906, -868.443),
    "S2": (1428.653, -331.118, -421.927),
    "S3": (1481.034, 897.662, -702.385),
    "S4": (-318.497, 963.825, -258.716),
}
U_CONSTANT, U_PROPORTIONAL = 0.0003, 3e-7  # mm, mm/mm
U_SCALE = 2e-7  # of the one laser of all surveys
QUARTER = {"EC0Y": 4e-6, "EXX": 3e-6}  # rad and mm/mm in each quarter: squareness, and the scale of X
KNOCK = 10.0 / 600.0 / 1000.0  # rad: 10 µm over the travel of Y


class Survey(NamedTuple):
    """Name of the files, date, quarters since the first, change of EC0Y by a collision, distances per station and tool."""

    name: str
    date: str
    quarters: int
    knock: float
    n: int
    stations: tuple[str, ...]


ALL = tuple(STATIONS)
SURVEYS = (
    Survey("january", "2026-01-12", 0, 0.0, 50, ALL),
    Survey("april", "2026-04-13", 1, 0.0, 50, ALL),
    Survey("july", "2026-07-13", 2, 0.0, 50, ALL),
    Survey("monday", "2026-01-19", 0, KNOCK, 20, ("S2", "S4")),
)

MANIFEST = f"""\
# SYNTHETIC: computed by make.py, not measured. See README.md.
format = "volid-campaign/1"
machine = "../vertical_multilateration/machine.toml"
title = "SYNTHETIC survey of a virtual vertical machining centre, {{date}}"

[conditions]
synthetic = true
date = "{{date}}"
machine_condition = "60 min axis cycle over the whole travels before the first station"
ambient_temperature_C = 20.0
active_compensations = []
instrument = "virtual tracking interferometer, the same one in all surveys"
{{stations}}
[[set]]
name = "{{name}}"
kind = "distance"
file = "{{name}}.csv"
relative = true                    # one unknown dead path for every station and segment
u = {{{{ constant = {U_CONSTANT}, proportional = {U_PROPORTIONAL} }}}}

[[set.effect]]                     # one laser: the same unknown in all surveys
name = "laser scale"
type = "scale"
u = {U_SCALE}
per = "campaign"
"""


def truth_at(survey: Survey) -> Truth:
    """The machine on the day of a survey."""
    found = copy.deepcopy(random_truth(ExactMachine(STRUCTURE, TRAVEL), np.random.default_rng(MACHINE_SEED)))
    first, scale = found.functions["EXX"], survey.quarters * QUARTER["EXX"]
    found.functions["EXX"] = lambda x: first(x) + scale * np.asarray(x)
    found.constants["EC0Y"] += survey.quarters * QUARTER["EC0Y"] + survey.knock
    return found


def readings(machine: ExactMachine, survey: Survey, scale: float, rng: np.random.Generator) -> list[str]:
    """Rows of one file; `scale`: of the laser, the same in all."""
    truth, rows = truth_at(survey), []
    tools = TOOLS if survey.stations == ALL else TOOLS[:1]
    for name in survey.stations:
        for segment, tool in enumerate(tools, start=1):
            xyz = {a: np.round(rng.uniform(*TRAVEL[a], survey.n)) for a in "XYZ"}
            q = machine.in_axis_order(xyz)
            dead = float(rng.uniform(-300.0, 300.0))
            exact = np.linalg.norm(machine.functional_point(q, tool, truth) - STATIONS[name], axis=1) + dead
            noise = np.hypot(U_CONSTANT, U_PROPORTIONAL * exact) * rng.standard_normal(survey.n)
            distance = (1.0 + scale) * exact + noise
            numbers = np.column_stack([*(xyz[a] for a in "XYZ"), np.tile(tool, (survey.n, 1))])
            rows += [
                f"{','.join(f'{v:g}' for v in p)},{name},{segment},{d:.5f}"
                for p, d in zip(numbers, distance, strict=True)
            ]
    return rows


def write(folder: Path) -> None:
    """Write all files of the dataset but README.md and this program into `folder`."""
    machine = ExactMachine(STRUCTURE, TRAVEL)
    scale = U_SCALE * float(np.random.default_rng(SEED - 1).standard_normal())
    folder.mkdir(parents=True, exist_ok=True)
    for seed, survey in enumerate(SURVEYS, start=SEED):
        near = {name: [round(v / 10.0) * 10.0 for v in STATIONS[name]] for name in survey.stations}
        stations = "".join(
            f'\n[[station]]\nname = "{name}"\nposition = {place}   # rounded to 10 mm\n' for name, place in near.items()
        )
        header = ["# SYNTHETIC, computed by make.py; mm", "X,Y,Z,tool_x,tool_y,tool_z,station,segment,distance"]
        lines = [*header, *readings(machine, survey, scale, np.random.default_rng(seed))]
        text = MANIFEST.format(name=survey.name, date=survey.date, stations=stations)
        (folder / f"{survey.name}.toml").write_bytes(text.encode())
        (folder / f"{survey.name}.csv").write_bytes(("\n".join(lines) + "\n").encode())


if __name__ == "__main__":
    write(Path(sys.argv[1]) if len(sys.argv) > 1 else HERE)
