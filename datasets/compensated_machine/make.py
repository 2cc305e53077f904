"""Makes these SYNTHETIC campaigns, tables and truth again, byte for byte: python make.py [FOLDER].

Needs NumPy and SciPy only: machine and control are those of tests/exact_chain/, which share no code with volid. The control reads
the tables from the files that this program writes. README.md says what is in which file.
"""

import sys
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[1] / "tests"))

from exact_chain import COMPONENTS, ExactControl, ExactMachine, Truth, random_truth  # noqa: E402
from exact_chain.instruments import Instruments, Rows, Virtual  # noqa: E402

SEED = 21
STRUCTURE = "w Y' X' b Z (C) t"
TRAVEL = {"X": (0.0, 1000.0), "Y": (0.0, 600.0), "Z": (-500.0, 0.0)}  # mm, as models/wYXbZt_vertical.toml
TOLD = (0.0, 0.0, -150.0)  # mm: the tool vector that the control uses, whatever is in the spindle
STEP = {"X": 40.0, "Y": 30.0, "Z": 25.0}  # mm: of the tables
CENTRE, RADIUS = (500.0, 300.0, -400.0), 150.0  # mm, of the ball bar
OFFSETS = {"told": (0.0, 0.0, -150.0), "untold": (150.0, -120.0, -300.0)}  # mm, of the sphere in the spindle
MANDREL = -560.0  # mm: height at which the indicator touches the mandrel, 60 to 360 mm below the spindle nose
MANDREL_Z = (-500.0, -200.0)  # mm: its travel past the indicator
U = {"levels": 1e-6, "bar told": 5e-4, "bar untold": 5e-4, "mandrel": 3e-4}  # rad, mm
DEGREES = 10

MACHINE = f"""\
# The machine of models/wYXbZt_vertical.toml. SYNTHETIC campaigns: no such machine was measured.
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
ACTIVE = [
    "L-VOL: tables of the 18 error functions, squareness as slopes of the straightness tables",
    "tool vector that the control uses: 0, 0, -150 mm",
]


def virtual_machine() -> tuple[ExactMachine, Truth]:
    """The exact chain, and its errors with reversal of X and Y."""
    machine = ExactMachine(STRUCTURE, TRAVEL)
    truth = random_truth(machine, np.random.default_rng(SEED), reversal=["EXX", "EYY"])
    return machine, truth


def tables(machine: ExactMachine, truth: Truth) -> dict[str, str]:
    """Compensation tables by file name: what the machine does, every `STEP`, to 0.1 µm and 0.1 µrad."""
    found = {}
    for axis in "XYZ":
        x = np.linspace(*TRAVEL[axis], round(np.ptp(TRAVEL[axis]) / STEP[axis]) + 1)
        q = machine.in_axis_order({a: x if a == axis else 0 * x for a in "XYZ"})
        both = [machine.errors(axis, q, truth, np.full(q.shape, way)) for way in (1.0, -1.0)]
        for k, name in enumerate(component + axis for component in COMPONENTS):
            found[f"{name}.csv"] = table(name, x, -both[0][:, k], -both[1][:, k])
    return found


def table(name: str, x: np.ndarray, up: np.ndarray, down: np.ndarray) -> str:
    """One file in the layout of ISO/TR 16907 Table 1, compensation values."""
    kind = "L-ANG" if name[1] in "ABC" else "L-POS" if name[1] == name[2] else "L-STR + L-SQU"
    digits = 7 if kind == "L-ANG" else 4
    head = ["format: volid-table/1", f"type: {kind}", f"function: {name}", "values: compensation", "rows: absolute"]
    head += ["applied: kinematic model", "zero: at the references", "period: none"]
    head += ["datum: primary axis X, secondary axis Y", "note 1: SYNTHETIC"]
    columns = [f"{name}(+)", f"{name}(-)"] if np.any(up != down) else [name]
    rows = zip(x, *((up, down)[: len(columns)]), strict=True)
    lines = [",".join([f"{p:g}", *(f"{v:.{digits}f}" for v in values)]) for p, *values in rows]
    return "\n".join([*(f"# {k}" for k in head), ",".join([name[2], *columns]), *lines]) + "\n"


def there_and_back(axis: str, travel: tuple[float, float], at: dict[str, float]) -> tuple[dict, np.ndarray]:
    """21 positions along an axis and back by axis letter, and its directions of approach."""
    line = np.linspace(*travel, 21)
    way = np.repeat([1.0, -1.0], 21)
    return {**at, axis: np.concatenate([line, line[::-1]])}, way


def programme(machine: ExactMachine) -> dict[str, Rows]:
    """Rows of every set."""
    levels = []
    for axis, at in (("X", {"Y": 300.0, "Z": -250.0}), ("Y", {"X": 500.0, "Z": -250.0})):
        for component in "AB":
            where, way = there_and_back(axis, TRAVEL[axis], at)
            labels = {"component": component, "line": axis, "run": "1", "placement": "machine"}
            levels.append(rows_of(machine, where, {axis: way}, TOLD, labels))
    found = {"levels": joined(levels)}
    for name, offset in OFFSETS.items():
        angle = np.deg2rad(np.arange(0.0, 360.0, DEGREES))
        where = [c - t for c, t in zip(CENTRE, offset, strict=True)]
        at = {"X": where[0] + RADIUS * np.cos(angle), "Y": where[1] + RADIUS * np.sin(angle), "Z": where[2]}
        at = {a: np.round(v, 6) for a, v in at.items()}
        way = {"X": np.where(np.sin(angle) > 1e-9, -1.0, 1.0), "Y": np.where(np.cos(angle) > 1e-9, 1.0, -1.0)}
        found[f"bar {name}"] = rows_of(machine, at, way, offset, {"station": "centre", "segment": "1"})
    mandrel = []
    for component in "XY":
        where, way = there_and_back("Z", MANDREL_Z, {"X": 500.0, "Y": 300.0})
        along = np.stack([0 * way, 0 * way, MANDREL - where["Z"]], axis=1)
        labels = {"component": component, "line": f"mandrel {component}", "run": "1"}
        mandrel.append(rows_of(machine, where, {"Z": way}, along, labels))
    return {**found, "mandrel": joined(mandrel)}


def rows_of(machine: ExactMachine, at: dict, way: dict, tool, labels: dict) -> Rows:
    """Rows at positions by axis letter; an axis that rests was approached in + before."""
    q = machine.in_axis_order(at)
    direction = machine.in_axis_order({a: way.get(a, np.ones(len(q))) for a in machine.axes})
    return Rows(q, direction, np.broadcast_to(np.asarray(tool, float), (len(q), 3)), {
        k: np.full(len(q), v) for k, v in labels.items()
    })  # fmt: skip


def joined(parts: list[Rows]) -> Rows:
    """Rows one after another."""
    labels = {k: np.concatenate([p.labels[k] for p in parts]) for k in parts[0].labels}
    return Rows(*(np.concatenate([getattr(p, n) for p in parts]) for n in ("q", "direction", "tool")), labels)


def readings(machine: ExactMachine, truth: Truth, control: ExactControl | None, seed: int) -> dict[str, np.ndarray]:
    """Readings of every set (m,), of the pose that the drives reach, with noise."""
    rng, found = np.random.default_rng(seed), {}
    for name, rows in programme(machine).items():
        driven, way = rows.q, rows.direction
        if control is not None:
            driven = control.command(rows.q, rows.tool, rows.direction)
            way = control.arrivals(rows.q, driven, rows.direction)
        reached = Rows(driven, way, rows.tool, rows.labels)
        found[name] = read(name, machine, truth, rows, reached) + U[name] * rng.standard_normal(len(rows.q))
    return found


def read(name: str, machine: ExactMachine, truth: Truth, rows: Rows, reached: Rows) -> np.ndarray:
    """Exact readings of one set: `rows` as programmed, `reached` as driven."""
    zero = np.random.default_rng(SEED + 1)
    if name == "levels":
        options = {"vertical": "Z", "moving_on": "workpiece", "reference_on": "tool"}
        moving, reference = Virtual(machine, truth, Instruments(zero)).levels(name, reached, options, {})
        return moving - reference
    point = machine.functional_point(reached.q, reached.tool, truth, reached.direction)
    if name.startswith("bar"):
        return np.linalg.norm(point - np.array(CENTRE), axis=1)
    from_nominal = point - machine.functional_point(rows.q, rows.tool)
    offset = dict(zip("XY", zero.uniform(-0.2, 0.2, 2), strict=True))
    return np.array([d["XY".index(c)] + offset[c] for d, c in zip(from_nominal, rows.labels["component"], strict=True)])


def text_of(machine: ExactMachine, rows: Rows, values: np.ndarray, column: str) -> str:
    """A set as CSV."""
    letters, tools = "XYZ", ["tool_x", "tool_y", "tool_z"]
    names = [k for k in rows.labels if k not in ("placement", "run")]
    header = [*letters, *(f"{a}_dir" for a in letters), *tools, *names, column]
    order, digits = [machine.column(a) for a in letters], 9 if column == "value" else 6
    lines = [
        ",".join([*(f"{v:g}" if v == round(v, 1) else f"{v:.6f}" for v in q[order]), *(f"{d:g}" for d in way[order]),
                  *(f"{t:g}" for t in tool), *(str(rows.labels[k][i]) for k in names), f"{value:.{digits}f}"])
        for i, (q, way, tool, value) in enumerate(zip(rows.q, rows.direction, rows.tool, values, strict=True))
    ]  # fmt: skip
    return "\n".join([",".join(header), *lines]) + "\n"


def manifest(state: str, active: list[str]) -> str:
    """The manifest of a state, "before" or "after"."""
    listed = ", ".join(f'"{text}"' for text in active)
    text = f"""\
# SYNTHETIC: computed by make.py, not measured. See README.md.
format = "volid-campaign/1"
machine = "machine.toml"
title = "SYNTHETIC levels, ball bar and mandrel on a virtual machine {state} compensation"

[conditions]
synthetic = true
warm_up = "60 min axis cycle over the whole travels"
ambient_temperature_C = 20.0
active_compensations = [{listed}]

[[station]]
name = "centre"
position = [{", ".join(f"{c:g}" for c in CENTRE)}]

[[set]]
name = "levels"
kind = "level"
file = "levels_{state}.csv"
vertical = "Z"
moving_on = "workpiece"
reference_on = "tool"
u = {U["levels"]:g}
"""
    for name in OFFSETS:
        text += f"""
[[set]]
name = "bar {name}"
kind = "distance"
file = "bar_{name}_{state}.csv"
relative = false
calibrated_u = 0.0005
u = {U["bar told"]:g}
"""
    return f"""{text}
[[set]]
name = "mandrel"
kind = "component"
file = "mandrel_{state}.csv"
u = {U["mandrel"]:g}
"""


def truth_rows(machine: ExactMachine, truth: Truth) -> str:
    """The true error functions every 20 mm in both directions, then the constants."""
    lines = ["function,axis,position,direction,value"]
    for axis in "XYZ":
        x = np.arange(TRAVEL[axis][0], TRAVEL[axis][1] + 1.0, 20.0)
        for name in (component + axis for component in COMPONENTS):
            for way in (1, -1) if name in truth.reversal else (0,):
                values = truth.functions[name](x) + way * (truth.reversal[name](x) / 2 if way else 0.0)
                lines += [
                    f"{name},{axis},{p:g},{way},{v:.{12 if name[1] in 'ABC' else 9}f}"
                    for p, v in zip(x, values, strict=True)
                ]
    return "\n".join([*lines, *(f"{n},{n[-1]},,0,{v:.12f}" for n, v in truth.constants.items())]) + "\n"


def write(folder: Path) -> None:
    """All files but this one and the README."""
    machine, truth = virtual_machine()
    files = {"machine.toml": MACHINE, "truth_functions.csv": truth_rows(machine, truth), **tables(machine, truth)}
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8")
    control = ExactControl.of(machine, [folder / name for name in tables(machine, truth)], tool=np.array(TOLD))
    for state, acting, active in (("before", None, []), ("after", control, ACTIVE)):
        found = readings(machine, truth, acting, SEED + len(state))
        for name, rows in programme(machine).items():
            column = "distance" if name.startswith("bar") else "value"
            path = folder / f"{name.replace(' ', '_')}_{state}.csv"
            path.write_text(text_of(machine, rows, found[name], column), encoding="utf-8")
        (folder / ("campaign.toml" if state == "after" else "before.toml")).write_text(
            manifest(state, active), encoding="utf-8"
        )


if __name__ == "__main__":
    write(Path(sys.argv[1]) if len(sys.argv) > 1 else HERE)
