"""Makes this SYNTHETIC campaign and its truth again, byte for byte: python make.py [FOLDER].

Needs NumPy and SciPy only: the machine is the exact chain of 4x4 matrices in tests/exact_chain/, its instruments are those of
tests/exact_chain/instruments.py; both share no code with volid. README.md says what is in which file.
"""

import sys
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[1] / "tests"))

from exact_chain import COMPONENTS, ExactMachine, random_truth  # noqa: E402
from exact_chain.instruments import Instruments, Rows, Virtual  # noqa: E402

SEED = 4
STRUCTURE = "w X' Z' b Y (C) t"
TRAVEL = {"X": (0.0, 1000.0), "Y": (0.0, 800.0), "Z": (0.0, 800.0)}  # mm, as models/wXZbYt_cross_bed.toml
STEPS = {"X": 100.0, "Y": 80.0, "Z": 80.0}  # mm: a tenth of the travel
UNIT = {a: v.tolist() for a, v in zip("XYZ", np.eye(3), strict=True)}
U, U_LASER, U_LEVEL, U_ANGLE = 0.0006, 0.0004, 1e-6, 0.5e-6  # mm, mm, rad, rad
FORM_U, ANGLE_U = 0.0008, 2e-6  # mm, rad
TABLE_STEP = 10.0  # mm

MACHINE = f"""\
# The machine of models/wXZbYt_cross_bed.toml. SYNTHETIC campaign: no such machine was measured.
format = "volid-machine/1"
name = "Virtual horizontal machine with cross bed"
structure = "{STRUCTURE}"

[axis.X]
travel = [0.0, 1000.0]
[axis.Y]                     # height above the table
travel = [0.0, 800.0]
[axis.Z]
travel = [0.0, 800.0]

[model.functions]
EXX = {{ reversal = true }}
EYY = {{ reversal = true }}
EZZ = {{ reversal = true }}
"E?0S" = false               # lines of readings do not tell how the spindle is tilted
"""

MANIFEST = """\
# SYNTHETIC: computed by make.py, not measured. See README.md.
format = "volid-campaign/1"
machine = "machine.toml"
title = "SYNTHETIC direct measurement of a virtual horizontal machine"

[conditions]                       # the record of ISO/TR 16907 9.1, as a real campaign would have it
synthetic = true
machine_condition = "60 min axis cycle over the whole travels before the first line"
axis_positions = "X, Y, Z in every CSV file; the machine has no other axis"
tool_length_mm = [150.0, 180.0, 210.0]
load = "none; square 35 kg on the table"
feed = "2 m/min; standstill of 5 s at every point"
ambient_temperature_C = 20.0
component_temperatures_C = { bed = 20.0, table = 20.0, column = 20.0 }
active_compensations = []
instrument = "virtual laser interferometer, two electronic levels, straightedge, square"
"""


@dataclass
class Set:
    """A set: where its lines lie, how they are read, and further keys of the manifest as text and as Python has them."""

    name: str
    lines: list[tuple[str, str, str, int]]  # name of the line, moving axis, component, runs forward and back
    rest: dict[str, float]
    tool: tuple[float, float, float]
    u: float
    keys: dict = field(default_factory=dict)


def sets() -> list[Set]:
    """All instruments, each on lines of its own."""
    on_table = {"X": 480.0, "Y": 320.0, "Z": 360.0}
    found = [
        Set("levels", [(a, a, c, 1) for a in "XYZ" for c in "AC"], on_table, (0, 0, 0), U_LEVEL, {"vertical": "Y"}),
        Set("laser", [(a, a, a, 5) for a in "XYZ"], {"X": 420.0, "Y": 240.0, "Z": 280.0}, (40, -30, -210), U_LASER),
        Set(
            "angular optics",
            [(a, a, "B", 2) for a in "XZ"],
            {"X": 420.0, "Y": 240.0, "Z": 280.0},
            (40, -30, -210),
            U_ANGLE,
        ),
    ]
    for axis, across in ("XY", "XZ", "ZX", "ZY"):
        for turned, sense in (("upright", 1.0), ("over", -1.0)):
            line = {"edge": {"along": UNIT[axis], "normal": [sense * c for c in UNIT[across]]}}
            keys = {"alignment": f"edge {axis}{across} {turned}", "lines": line, "form_u": FORM_U}
            found.append(Set(keys["alignment"], [("edge", axis, across, 1)], on_table, (0, 0, -180), U, keys))
    for one, other in ("XY", "ZY", "XZ"):
        legs = {f"leg_{a}": {"along": UNIT[a], "normal": UNIT[b]} for a, b in ((one, other), (other, one))}
        keys = {"alignment": f"square {one}{other}", "lines": legs, "form_u": FORM_U, "angle_u": ANGLE_U}
        lines = [(f"leg_{one}", one, other, 1), (f"leg_{other}", other, one, 1)]
        found.append(Set(keys["alignment"], lines, {"X": 560.0, "Y": 400.0, "Z": 440.0}, (0, 0, -180), U, keys))
    for place, x in (("left", -300.0), ("right", 300.0)):
        leg = {"leg_Y": {"along": UNIT["Y"], "normal": UNIT["Z"]}}
        keys = {"alignment": f"square {place}", "lines": leg, "form_u": FORM_U}
        found.append(Set(keys["alignment"], [("leg_Y", "Y", "Z", 2)], on_table, (x, 0, -180), U, keys))
    found.append(Set("level on the square", [], on_table, (0, 0, 0), U_LEVEL, {"vertical": "Y"}))
    return found


ARTEFACTS = {"square left": "square ZY", "square right": "square ZY"}


def artefact(alignment: str) -> str:
    """The artefact of a placement: an edge whichever way up it lies, the square of Z and Y in both its places."""
    return ARTEFACTS.get(alignment, alignment.removesuffix(" upright").removesuffix(" over"))


def rows(machine: ExactMachine, own: Set) -> Rows:
    """Positions, directions and labels of a set."""
    rest = [own.rest[a] for a in machine.axes]
    q, way, labels = [], [], []
    for line, axis, component, runs in own.lines:
        i = machine.column(axis)
        forward = np.arange(TRAVEL[axis][0], TRAVEL[axis][1] + 1.0, STEPS[axis])
        for run in range(1, runs + 1):
            for sense, places in ((1.0, forward), (-1.0, forward[::-1])):
                part, direction = np.tile(rest, (len(places), 1)), np.zeros((len(places), 3))
                part[:, i], direction[:, i] = places, sense
                q.append(part)
                way.append(direction)
                labels += [(component, line, str(run), "machine")] * len(places)
    if not own.lines:  # the level on the square, read four times in either place
        q, way = [np.tile(rest, (8, 1))], [np.zeros((8, 3))]
        labels = [("A", "1", str(run), f"square {place}") for place in ("left", "right") for run in range(1, 5)]
    columns = [np.array(c) for c in zip(*labels, strict=True)]
    names = ("component", "line", "run", "placement")
    tool = np.tile(np.array(own.tool, float), (len(labels), 1))
    return Rows(np.concatenate(q), np.concatenate(way), tool, dict(zip(names, columns, strict=True)))


def table(machine: ExactMachine, own: Set, at: Rows, readings: dict[str, np.ndarray], digits: int) -> list[str]:
    """A CSV file's lines."""
    used = [a for a in "XYZ" if at.direction[:, machine.column(a)].any()]
    shown = [k for k in at.labels if k != "placement" or not own.lines]
    lines = [",".join(["X,Y,Z", *(f"{a}_dir" for a in used), *shown, *readings])]
    for i in range(len(at.q)):
        cells = [f"{at.q[i, machine.column(a)]:g}" for a in "XYZ"]
        cells += [f"{at.direction[i, machine.column(a)]:g}" for a in used]
        cells += [str(at.labels[k][i]) for k in shown]
        lines.append(",".join([*cells, *(f"{v[i]:.{digits}f}" for v in readings.values())]))
    return ["# SYNTHETIC, computed by make.py", *lines]


def measured(virtual: Virtual, own: Set, rng: np.random.Generator) -> list[str]:
    """A set's file: levels in µm/m, all others in mm or rad."""
    at = rows(virtual.machine, own)
    alignments = {s.name: {"name": s.name, "artefact": artefact(s.name)} for s in sets() if "alignment" in s.keys}
    noise = rng.normal(0.0, own.u, len(at.q))
    if "vertical" in own.keys:
        moving, reference = virtual.levels(own.name, at, own.keys, alignments)
        pair = {"moving": 1e6 * (moving + noise), "reference": 1e6 * reference}
        return table(virtual.machine, own, at, pair, 2)
    if "alignment" in own.keys:
        values = virtual.surfaces(own.name, at, own.keys, alignments)
    else:
        values = virtual.components(own.name, at, own.keys)
    return table(virtual.machine, own, at, {"value": values + noise}, 8 if own.name == "angular optics" else 5)


def toml(value) -> str:
    """A value of a manifest."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{k} = {toml(v)}" for k, v in value.items()) + " }"
    return f'"{value}"' if isinstance(value, str) else str(value)


def manifest(all_sets: list[Set]) -> str:
    """Text of campaign.toml."""
    parts = [MANIFEST]
    for own in all_sets:
        if "alignment" in own.keys:
            parts.append(
                f'\n[[alignment]]\nname = "{own.name}"\nbody = "workpiece"\nartefact = "{artefact(own.name)}"\n'
            )
    for own in all_sets:
        head = f'\n[[set]]\nname = "{own.name}"\nkind = "component"\nfile = "{own.name.replace(" ", "_")}.csv"\nu = {own.u}\n'
        tool = "" if "vertical" in own.keys else f"tool = {[float(c) for c in own.tool]}\n"
        keys = "".join(f"{k} = {toml(v)}\n" for k, v in own.keys.items())
        units = '[set.csv]\nunits = { moving = "µm/m", reference = "µm/m" }\n' if "vertical" in own.keys else ""
        parts.append(head + tool + keys + units)
    return "".join(parts)


def functions(truth) -> list[str]:
    """Rows of truth_functions.csv: error functions on a fine table, both directions where they differ, then the constants."""
    found = []
    for axis in "XYZ":
        q = np.arange(TRAVEL[axis][0], TRAVEL[axis][1] + TABLE_STEP / 2, TABLE_STEP)
        for name in (component + axis for component in COMPONENTS):
            digits = 9 if name[1] in "XYZ" else 12
            for way in (1, -1) if name in truth.reversal else (0,):
                values = truth.functions[name](q) + (0.5 * way * truth.reversal[name](q) if way else 0.0)
                found += [f"{name},{axis},{x:g},{way},{v:.{digits}f}" for x, v in zip(q, values, strict=True)]
    return found + [f"{name},{name[-1]},,0,{value:.12f}" for name, value in truth.constants.items()]


def write(folder: Path) -> None:
    """Write all files of the dataset but README.md and this program into `folder`."""
    rng = np.random.default_rng(SEED)
    machine = ExactMachine(STRUCTURE, TRAVEL)
    truth = random_truth(machine, rng, reversal=True, tool_rotation=False)
    virtual = Virtual(machine, truth, Instruments(rng, ANGLE_U, FORM_U))
    all_sets, synthetic = sets(), "# SYNTHETIC, computed by make.py; mm, rad"
    texts = {f"{own.name.replace(' ', '_')}.csv": measured(virtual, own, rng) for own in all_sets}
    texts |= {
        "machine.toml": [MACHINE.rstrip("\n")],
        "campaign.toml": [manifest(all_sets).rstrip("\n")],
        "truth_functions.csv": [synthetic, "function,axis,position,direction,value", *functions(truth)],
    }
    folder.mkdir(parents=True, exist_ok=True)
    for name, lines in texts.items():
        (folder / name).write_bytes(("\n".join(lines) + "\n").encode())


if __name__ == "__main__":
    write(Path(sys.argv[1]) if len(sys.argv) > 1 else HERE)
