"""Makes this SYNTHETIC campaign and its truth again, byte for byte: python make.py [FOLDER].

Needs NumPy and SciPy only: the machine is the exact chain of 4x4 matrices in tests/exact_chain/, which shares no code
with volid. Error motions are sums of sines, not splines. README.md says what is in which file.
"""

import sys
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[1] / "tests"))

from exact_chain import COMPONENTS, ExactMachine, Truth, apply, random_truth  # noqa: E402

SEED = 2
STRUCTURE = "w C' A' Y' X' b Z (S) t"
TRAVEL = {
    "X": (-300, 300),
    "Y": (-300, 300),
    "Z": (0, 550),
    "A": (-120, 30),
    "C": (0, 360),
}  # as models/wCAYXbZt_trunnion
SPHERES = {
    "P1": (110.31, 24.72, 60.18),
    "P2": (-75.43, 95.26, 90.37),
    "P3": (-19.68, -120.39, 129.76),
}  # true places, mm
TOOL = (0.0, 0.0, -180.0)  # nest of the sensors from the spindle nose, mm
N = {"C": 37, "A": 13}
U = 0.0005  # mm
TABLE_STEP = 2.5  # degrees
N_POINTS = 500

MACHINE = f"""\
# The machine of models/wCAYXbZt_trunnion.toml. SYNTHETIC campaign: no such machine was measured.
format = "volid-machine/1"
name = "Virtual five-axis machining centre with tilting rotary table"
structure = "{STRUCTURE}"

[axis.X]
travel = [-300.0, 300.0]
[axis.Y]
travel = [-300.0, 300.0]
[axis.Z]
travel = [0.0, 550.0]
[axis.A]
travel = [-120.0, 30.0]
point = [0.0, 0.0, 0.0]
[axis.C]
travel = [0.0, 360.0]
point = [0.0, 0.0, 0.0]

[model.functions]                  # the linear axes and the spindle have no errors, and the model knows it
"E?[XYZ]" = false
"E?0[XYZS]" = false
"""

MANIFEST = f"""\
# SYNTHETIC: computed by make.py, not measured. See README.md.
format = "volid-campaign/1"
machine = "machine.toml"
title = "SYNTHETIC R-test of a virtual tilting rotary table"

[conditions]                       # the record of ISO/TR 16907 9.1, as a real campaign would have it
synthetic = true
machine_condition = "60 min cycle of all axes before the first sphere"
axis_positions = "C, A, Y, X, Z in rtest.csv; the machine has no other axis"
ambient_temperature_C = 20.0
component_temperatures_C = {{ bed = 20.0, table = 20.0, spindle = 20.0 }}
active_compensations = ["linear axes: L-VOL, taken as perfect"]
instrument = "virtual R-test: three displacement sensors in the spindle, calibrated, axes parallel to the machine's"

[[set]]
name = "R-test"
kind = "displacement"
file = "rtest.csv"
sensor_on = "tool"
tool = [{TOOL[0]}, {TOOL[1]}, {TOOL[2]}]
u = {U}
[set.sphere]                       # approximate places on the table, rounded to 1 mm
"""


def virtual_machine() -> ExactMachine:
    """The exact chain; the lines of A and C meet in the origin."""
    return ExactMachine(STRUCTURE, TRAVEL)


def rotary_truth(machine: ExactMachine, rng: np.random.Generator) -> Truth:
    """Errors of a good machine, those of A and C kept."""
    truth = random_truth(machine, rng)
    return Truth(
        {name: f for name, f in truth.functions.items() if name[2] in "AC"},
        {name: value for name, value in truth.constants.items() if name[3] in "AC"},
    )


def following(machine: ExactMachine, q: np.ndarray, place: tuple[float, float, float]) -> np.ndarray:
    """X, Y, Z moved so that the nominal nest is at the sphere, rounded to 0.1 µm: linear in them, one solution."""
    columns = [machine.column(a) for a in "XYZ"]
    start = machine.functional_point(q, TOOL)
    step = np.eye(len(machine.axes))
    slope = np.stack([machine.functional_point(q + step[c], TOOL) - start for c in columns], axis=-1)
    q = q.copy()
    q[:, columns] += np.linalg.solve(slope, (np.asarray(place) - start)[..., None])[..., 0]
    return np.round(q, 4)


def readings(machine: ExactMachine, truth: Truth, rng: np.random.Generator) -> list[str]:
    """Rows of rtest.csv: every sphere at all pairs of positions, C to and fro."""
    rows = []
    for name, place in SPHERES.items():
        q = np.zeros((N["A"] * N["C"], len(machine.axes)))
        turns = np.linspace(*TRAVEL["C"], N["C"])
        q[:, machine.column("A")] = np.repeat(np.linspace(*TRAVEL["A"], N["A"]), N["C"])
        q[:, machine.column("C")] = np.concatenate([turns[:: 1 - 2 * (i % 2)] for i in range(N["A"])])
        q = following(machine, q, tuple(round(c) for c in place))  # the program knows them to 1 mm
        d = apply(np.linalg.inv(machine.pose(q, truth)), place) - TOOL
        d = d + U * rng.standard_normal(d.shape)
        rows += [
            f"{','.join(f'{v + 0.0:g}' for v in p[:2])},{','.join(f'{v + 0.0:.4f}' for v in p[2:])},{name},"
            f"{','.join(f'{v + 0.0:.5f}' for v in r)}"
            for p, r in zip(q, d, strict=True)
        ]
    return rows


def functions(truth: Truth) -> list[str]:
    """Rows of truth_functions.csv: error motions on a fine table, then the location errors."""
    rows = []
    for axis in "AC":
        q = np.arange(TRAVEL[axis][0], TRAVEL[axis][1] + TABLE_STEP / 2, TABLE_STEP)
        for name in (component + axis for component in COMPONENTS):
            digits = 9 if name[1] in "XYZ" else 12
            rows += [
                f"{name},{axis},{x:g},0,{round(v, digits) + 0.0:.{digits}f}"
                for x, v in zip(q, truth.functions[name](q), strict=True)
            ]
    return rows + [f"{name},{name[-1]},,0,{value:.12f}" for name, value in axis_lines(truth).items()]


def axis_lines(truth: Truth) -> dict[str, float]:
    """Location errors as ISO 230-1 means them: where the axis average lines stand in the machine frame.

    Minus what the truth adds to the tool relative to the workpiece, because both axes carry the workpiece; C rides on A, and
    both lines meet in the origin, so that there is no lever arm.
    """
    carried = {name: truth.constants.get(name[:3] + "A", 0.0) if name[3] == "C" else 0.0 for name in truth.constants}
    return {name: -(value + carried[name]) for name, value in truth.constants.items()}


def points(machine: ExactMachine, truth: Truth, rng: np.random.Generator) -> list[str]:
    """Rows of truth_points.csv: true deviations at random positions with random tools."""
    places = {a: np.round(rng.uniform(*TRAVEL[a], N_POINTS), 2) for a in "CAYXZ"}
    tool = np.round(rng.uniform([-30.0, -30.0, -250.0], [30.0, 30.0, -100.0], (N_POINTS, 3)), 1)
    deviation = machine.deviation(machine.in_axis_order(places), tool, truth)
    numbers = np.column_stack([*places.values(), tool])
    return [
        f"{','.join(f'{v:g}' for v in p)},{','.join(f'{v:.9f}' for v in d[:3])},{','.join(f'{v:.12f}' for v in d[3:])}"
        for p, d in zip(numbers, deviation, strict=True)
    ]


def write(folder: Path) -> None:
    """Write all files of the dataset but README.md and this program into `folder`."""
    rng = np.random.default_rng(SEED)
    machine = virtual_machine()
    truth = rotary_truth(machine, rng)
    rows = readings(machine, truth, rng)
    spheres = [f"{name} = {[float(round(c)) for c in place]}" for name, place in SPHERES.items()]
    instruments = [f"sphere {n} {c},mm,{v:.3f}" for n, p in SPHERES.items() for c, v in zip("XYZ", p, strict=True)]
    synthetic = "# SYNTHETIC, computed by make.py; mm, rad, degrees"
    texts = {
        "machine.toml": [MACHINE.rstrip("\n")],
        "campaign.toml": [MANIFEST.rstrip("\n"), *spheres],
        "rtest.csv": [synthetic, "C,A,Y,X,Z,sphere,x,y,z", *rows],
        "truth_functions.csv": [synthetic, "function,axis,position,direction,value", *functions(truth)],
        "truth_instruments.csv": [synthetic, "name,unit,value", *instruments],
        "truth_points.csv": [
            synthetic,
            "C,A,Y,X,Z,tool_x,tool_y,tool_z,ex,ey,ez,ea,eb,ec",
            *points(machine, truth, rng),
        ],
    }
    folder.mkdir(parents=True, exist_ok=True)
    for name, lines in texts.items():
        (folder / name).write_bytes(("\n".join(lines) + "\n").encode())


if __name__ == "__main__":
    write(Path(sys.argv[1]) if len(sys.argv) > 1 else HERE)
