"""Makes this SYNTHETIC campaign and its truth again, byte for byte: python make.py [FOLDER].

Needs NumPy and SciPy only: the machine is the exact chain of 4x4 matrices in tests/exact_chain/, which shares no code
with volid. Error functions are sines and a cubic, not splines. README.md says what is in which file.
"""

import sys
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[1] / "tests"))

from exact_chain import COMPONENTS, ExactMachine, Truth, random_truth, spread_positions  # noqa: E402

SEED = 1
STRUCTURE = "w Y' X' b Z (C) t"
TRAVEL = {"X": (0.0, 1000.0), "Y": (0.0, 600.0), "Z": (-500.0, 0.0)}  # mm, as models/wYXbZt_vertical.toml
TOOLS = np.array([[0.0, 0.0, -150.0], [80.0, 0.0, -250.0], [0.0, 90.0, -200.0]])  # mm
STATIONS = {  # true positions in the workpiece frame, mm
    "S1": (-423.271, -243.906, -868.443),
    "S2": (1428.653, -331.118, -421.927),
    "S3": (1481.034, 897.662, -702.385),
    "S4": (-318.497, 963.825, -258.716),
    "S5": (472.318, -362.551, -4.092),
    "S6": (583.946, 988.273, -552.604),
}
N_SEGMENT = (133, 133, 134)  # distances of one station with one tool after the other
STEP = 20.0  # mm: positions stand on multiples of it
U_CONSTANT, U_PROPORTIONAL = 0.0003, 3e-7  # mm, mm/mm
RAPID, DWELL, TOOL_CHANGE, NEW_STATION = 400.0, 4.0, 240.0, 900.0  # mm/s, s
TABLE_STEP = 5.0  # mm
N_POINTS = 1000

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
"""

MANIFEST = """\
# SYNTHETIC: computed by make.py, not measured. See README.md.
format = "volid-campaign/1"
machine = "machine.toml"
title = "SYNTHETIC multilateration of a virtual vertical machining centre"

[conditions]                       # the record of ISO/TR 16907 9.1, as a real campaign would have it
synthetic = true
machine_condition = "60 min axis cycle over the whole travels before the first station"
axis_positions = "X, Y, Z in volume.csv; the machine has no other axis"
tool_length_mm = [150.0, 250.0, 200.0]   # of the retroreflector's centre from the spindle nose, segments 1, 2, 3
tool_offset_mm = [[0.0, 0.0], [80.0, 0.0], [0.0, 90.0]]
load = "none; retroreflector holder 1.2 kg in the spindle"
feed = "rapid, 24 m/min; standstill of 4 s at every point"
acceleration_m_s2 = 3.0
ambient_temperature_C = 20.0
component_temperatures_C = { bed = 20.0, table = 20.0, column = 20.0, spindle = 20.0 }
active_compensations = []
instrument = "virtual tracking interferometer, beam interrupted at every change of tool or station"
"""

SET = f"""
[[set]]
name = "volume"
kind = "distance"
file = "volume.csv"
relative = true                    # one unknown dead path for every station and segment
u = {{ constant = {U_CONSTANT}, proportional = {U_PROPORTIONAL} }}
"""


def virtual_machine() -> ExactMachine:
    """The exact chain."""
    return ExactMachine(STRUCTURE, TRAVEL)


def program(machine: ExactMachine, n: int, rng: np.random.Generator) -> np.ndarray:
    """Positions (n, axes) of one segment: corners, end planes and inside, in rows to and fro, layer by layer.

    The first point comes again in the middle and at the end (closure).
    """
    intervals = [round(np.ptp(machine.travel[a]) / STEP) + 1 for a in machine.axes]
    q = rng.permutation(np.unique(spread_positions(machine, n + 10, rng, n_grid=intervals), axis=0))[: n - 2]
    x, y, z = (q[:, machine.column(a)] for a in "XYZ")
    layer, row = np.floor((z - TRAVEL["Z"][0]) / 100.0), np.floor(y / 100.0)
    order = np.lexsort([x * (-1) ** (layer + row), row * (-1) ** layer, layer])
    q = q[order]
    middle = len(q) // 2
    return np.concatenate([q[:middle], q[:1], q[middle:], q[:1]])


def readings(machine: ExactMachine, truth: Truth, rng: np.random.Generator) -> tuple[list[str], dict[str, float]]:
    """Rows of volume.csv, and the dead paths by name."""
    rows, dead_paths, clock = [], {}, 0.0
    for name, station in STATIONS.items():
        for segment, (tool, n) in enumerate(zip(TOOLS, N_SEGMENT, strict=True), start=1):
            q = program(machine, n, rng)
            dead = round(float(rng.uniform(-300.0, 300.0)), 4)
            dead_paths[f"dead path {name} segment {segment}"] = dead
            exact = np.linalg.norm(machine.functional_point(q, tool, truth) - station, axis=1) + dead
            distance = exact + np.hypot(U_CONSTANT, U_PROPORTIONAL * exact) * rng.standard_normal(n)
            moves = np.abs(np.diff(q, axis=0, prepend=q[:1])).max(axis=1) / RAPID + DWELL
            time = clock + np.cumsum(moves)
            clock = time[-1] + TOOL_CHANGE
            xyz = q[:, [machine.column(a) for a in "XYZ"]]
            rows += [
                f"{','.join(f'{v:g}' for v in (*p, *tool))},{name},{segment},{d:.5f},{t:.1f}"
                for p, d, t in zip(xyz, distance, time, strict=True)
            ]
        clock += NEW_STATION
    return rows, dead_paths


def functions(machine: ExactMachine, truth: Truth) -> list[str]:
    """Rows of truth_functions.csv: error functions on a fine table, then the constants."""
    rows = []
    for axis in "XYZ":
        q = np.arange(TRAVEL[axis][0], TRAVEL[axis][1] + TABLE_STEP / 2, TABLE_STEP)
        for name in (component + axis for component in COMPONENTS):
            digits = 9 if name[1] in "XYZ" else 12
            rows += [f"{name},{axis},{x:g},0,{v:.{digits}f}" for x, v in zip(q, truth.functions[name](q), strict=True)]
    return rows + [f"{name},{name[-1]},,0,{value:.12f}" for name, value in truth.constants.items()]


def points(machine: ExactMachine, truth: Truth, rng: np.random.Generator) -> list[str]:
    """Rows of truth_points.csv: true deviations at random positions with random tools."""
    xyz = {a: np.round(rng.uniform(*TRAVEL[a], N_POINTS), 2) for a in "XYZ"}
    tool = np.round(rng.uniform([-100.0, -100.0, -300.0], [100.0, 100.0, -100.0], (N_POINTS, 3)), 1)
    deviation = machine.deviation(machine.in_axis_order(xyz), tool, truth)
    numbers = np.column_stack([*xyz.values(), tool])
    return [
        f"{','.join(f'{v:g}' for v in p)},{','.join(f'{v:.9f}' for v in d[:3])},{','.join(f'{v:.12f}' for v in d[3:])}"
        for p, d in zip(numbers, deviation, strict=True)
    ]


def write(folder: Path) -> None:
    """Write all files of the dataset but README.md and this program into `folder`."""
    rng = np.random.default_rng(SEED)
    machine = virtual_machine()
    truth = random_truth(machine, rng)
    rows, dead_paths = readings(machine, truth, rng)
    stations = [
        f'\n[[station]]\nname = "{name}"\nposition = {[round(v / 10.0) * 10.0 for v in p]}   # rounded to 10 mm\n'
        for name, p in STATIONS.items()
    ]
    instruments = [f"station {n} {c},mm,{v:.3f}" for n, p in STATIONS.items() for c, v in zip("XYZ", p, strict=True)]
    instruments += [f"{name},mm,{value:.4f}" for name, value in dead_paths.items()]
    synthetic = "# SYNTHETIC, computed by make.py; mm, rad, s"
    texts = {
        "machine.toml": [MACHINE.rstrip("\n")],
        "campaign.toml": [(MANIFEST + "".join(stations) + SET).rstrip("\n")],
        "volume.csv": [synthetic, "X,Y,Z,tool_x,tool_y,tool_z,station,segment,distance,time", *rows],
        "truth_functions.csv": [synthetic, "function,axis,position,direction,value", *functions(machine, truth)],
        "truth_instruments.csv": [synthetic, "name,unit,value", *instruments],
        "truth_points.csv": [
            synthetic,
            "X,Y,Z,tool_x,tool_y,tool_z,ex,ey,ez,ea,eb,ec",
            *points(machine, truth, rng),
        ],
    }
    folder.mkdir(parents=True, exist_ok=True)
    for name, lines in texts.items():
        (folder / name).write_bytes(("\n".join(lines) + "\n").encode())


if __name__ == "__main__":
    write(Path(sys.argv[1]) if len(sys.argv) > 1 else HERE)
