"""What the contract of controls needs: for each control the small compensations that it carries, and what each machine has.

A new control takes part without a line here. Options that it cannot do without stand in `NEEDED`. Files written out by hand from
its documentation stand in `tests/controllers/by_hand/<control>/`, and hold what `case.txt` there names.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from exact_chain import ExactMachine, Truth

import volid
from support.control_cases import AT, MACHINE, TOOL, crossed, error_table, levered, pitch, spatial
from support.machines import exact_of
from support.places import ROOT
from volid.compensation.control import Control
from volid.compensation.package import Compensation
from volid.compensation.tables.axis_table import AxisTable
from volid.compensation.tables.by_axis import axis_tables
from volid.compensation.tables.error_table import ITSELF, ErrorTable
from volid.compensation.types import GRID, TABLES
from volid.controllers import CONTROLS
from volid.controllers.base import COMPENSATION, ERROR, ONE_VALUE, OPEN, Declaration, Job, options_of

BY_HAND = ROOT / "tests" / "controllers" / "by_hand"
TRUNNION = volid.load_machine("models/wCAYXbZt_trunnion.toml")  # X, Y -300..300, Z 0..550, A -120..30, C 0..360
ROTARY_AT = TRUNNION.order(X=0.0, Y=0.0, Z=275.0, A=0.0, C=0.0)
NEEDED: dict[str, dict[str, Any]] = {
    "pmac": {"counts": "10000000"}
}  # options without which a control writes nothing, by its name
SIGNS = (ERROR, COMPENSATION)


def straight() -> Compensation:
    """Straightness of Z over X alone."""
    return Compensation(("L-STR",), (error_table("EZX", [0, 500, 1000], [0.0, 0.003, 0.0], kind="L-STR"),), ())


def square() -> Compensation:
    """Squareness of 20 µrad of X over Y alone."""
    return Compensation(("L-SQU",), (error_table("EXY", [0, 300, 600], [-0.006, 0.0, 0.006], kind="L-SQU"),), ())


def turning() -> Compensation:
    """Angular positioning of C of the trunnion, 40 µrad at half a turn, closed over a full turn."""
    x, up = np.array([0.0, 90.0, 180.0, 270.0, 360.0]), np.array([0.0, 20e-6, 40e-6, 20e-6, 0.0])
    table = ErrorTable("R-POS", "ECC", x, up, up, np.zeros((5, 2)), x > 1e9, ITSELF, 0.0, period=360.0)
    return Compensation(("R-POS",), (table,), ())


def scaled() -> Compensation:
    """X goes 20 µm/m too far, counted from the machine's origin."""
    return Compensation(("L-POS",), (error_table("EXX", [0, 500, 1000], [0.0, 0.010, 0.020]),), ())


def skewed() -> Compensation:
    """Y leans by 20 µrad towards +X, counted from the machine's origin."""
    return Compensation(("L-SQU",), (error_table("EXY", [0, 300, 600], [0.0, 0.006, 0.012], kind="L-SQU"),), ())


@dataclass(frozen=True)
class Case:
    """A small compensation, its machine, the places of its lines, and the control that takes it."""

    control: str
    type: str
    make: Callable[[], Compensation]
    sign: str
    rotary: bool = False

    def __str__(self) -> str:
        return f"{self.control}-{self.type}-{self.make.__name__}-{self.sign}"

    @property
    def machine(self) -> volid.Machine:
        return TRUNNION if self.rotary else MACHINE

    def job(self, made: Compensation | None = None, **options) -> Job:
        """What is to be written."""
        declared = CONTROLS[self.control].declaration
        stated = options_of(declared, {**NEEDED.get(self.control, {}), **options})
        at = ROTARY_AT if self.rotary else AT
        return Job(self.machine, self.make() if made is None else made, at, TOOL, self.sign, stated)


# type and form: compensations that hold it; a rotary one is for the trunnion
SMALL: dict[tuple[str, str], tuple[Callable[[], Compensation], ...]] = {
    ("L-POS", TABLES): (pitch,),
    ("L-STR", TABLES): (straight,),
    ("L-SQU", TABLES): (square,),
    ("L-VOL", TABLES): (levered,),
    ("R-POS", TABLES): (turning,),
    ("L-VOL", GRID): (spatial,),
}

STRAIGHT: dict[str, tuple[Callable[[], Compensation], ...]] = {
    "L-POS": (scaled,),
    "L-SQU": (skewed,),
}  # for `linear` controls


def signs_of(declared: Declaration) -> tuple[str, ...]:
    """Senses in which the control's files are written: both where public sources leave it open."""
    return SIGNS if declared.sign == OPEN else (declared.sign,)


def cases(name: str) -> list[Case]:
    """All small cases of a control."""
    declared = CONTROLS[name].declaration
    found = []
    for sign in signs_of(declared):
        for kind, form in declared.carries.items():
            rotary = kind.startswith("R-")
            small = STRAIGHT.get(kind, ()) if declared.linear else SMALL.get((kind, form), ())
            found += [Case(name, kind, make, sign, rotary) for make in small]
        if all(declared.carries.get(t) == TABLES for t in crossed().names):
            found.append(Case(name, "L-SQU", crossed, sign))
    return found


ALL = [case for name in CONTROLS for case in cases(name)]


def asked(case: Case, job: Job) -> Control:
    """The control as it would move if it held the job exactly, in the form that the control has."""
    declared = CONTROLS[case.control].declaration
    if declared.model or job.compensation.grids:
        return job.compensation.control(job.machine)
    if declared.linear:
        return Control(job.machine, axis_tables=straightened(job))
    return Control(job.machine, axis_tables=job.axis_tables(products=declared.products))


def straightened(job: Job) -> tuple[AxisTable, ...]:
    """What a control with straight lines through the origin alone moves X, Y, Z by: I - (I + M)⁻¹ + E, as tables.

    M and E are slopes of least-squares lines, of tables of error functions and of tables of axes.
    """
    made = axis_tables(job.machine, job.compensation.tables, job.at, job.tool, products=False)
    motion = np.eye(3) - np.linalg.inv(np.eye(3) + slopes(made)) + slopes(job.compensation.axis_tables)
    travels = [np.array(job.machine.axis(a).travel) for a in "XYZ"]
    lines = [(a, b, motion[i, j] * travels[j], travels[j]) for i, a in enumerate("XYZ") for j, b in enumerate("XYZ")]
    return tuple(AxisTable(a, b, x, e, e) for a, b, e, x in lines)


def slopes(tables: Sequence[AxisTable]) -> np.ndarray:
    """Slopes over the range of each table, exact: two Gauss points integrate a parabola between neighbours."""
    found = np.zeros((3, 3))
    for t in tables:
        half, middle = 0.5 * np.diff(t.positions), 0.5 * (t.positions[1:] + t.positions[:-1])
        x = np.concatenate([middle - half / np.sqrt(3.0), middle + half / np.sqrt(3.0)])
        y, w = np.interp(x, t.positions, 0.5 * (t.forward + t.reverse)), np.tile(half, 2)
        s = x - 0.5 * (t.positions[0] + t.positions[-1])
        found["XYZ".index(t.output), "XYZ".index(t.argument)] += np.sum(w * s * y) / np.sum(w * s * s)
    return found


def held(case: Case, job: Job) -> Compensation:
    """What the control holds once its files are loaded."""
    control = CONTROLS[case.control]
    files = {f.name: f.content for f in control.write(job).files}
    return control.read(files, job.machine, {**job.options, "sign": job.sign})


def places(machine: volid.Machine, m: int = 40, seed: int = 5) -> np.ndarray:
    """Positions over the travels, among them the nodes of the small cases (m, axes)."""
    rng = np.random.default_rng(seed)
    some = np.stack([rng.uniform(*a.travel, m) for a in machine.axes], axis=1)
    nodes = np.stack([rng.choice(np.linspace(*a.travel, 5), m) for a in machine.axes], axis=1)
    return np.concatenate([some, nodes])


def allowance(case: Case, job: Job) -> np.ndarray:
    """What rounding to the quantum may change of each axis's correction: half a quantum for each table, and its lever (axes,)."""
    declared = CONTROLS[case.control].declaration
    share = 1.0 if declared.zero_fixed else 0.5  # half a quantum at the place, and half at the zero
    length, angle = (1e-8 if q is None else share * q for q in declared.quantum)
    found = np.full(len(job.machine.axes), 1e-8)
    if declared.model or job.compensation.grids:
        arm = max(abs(v) for a in job.machine.linear for v in a.travel) + np.abs(job.tool).max()
        for i, a in enumerate(job.machine.axes):
            found[i] += 3 * (length + arm * angle) if a.is_linear else np.rad2deg(angle)
        return found
    for table in job.axis_tables(products=declared.products):
        i = job.machine.index(table.output)
        found[i] += _of_table(table, job.machine.axes[i].is_linear, length, angle)
    return found


def _of_table(table: AxisTable, linear: bool, length: float, angle: float) -> float:
    if table.factor is not None:
        return float(angle * np.abs(table.factor.values).max() + length)
    return length if linear else float(np.rad2deg(angle))


def shifts(case: Case, difference: np.ndarray) -> np.ndarray:
    """By what each axis is shifted as a whole where the control itself fixes the zero of its values, else 0; (axes,)."""
    return difference[0] if CONTROLS[case.control].declaration.zero_fixed else np.zeros(difference.shape[1])


def ways(case: Case, m: int, axes: int) -> list[np.ndarray]:
    """Directions in which the control is asked: both where its files have them, else the mean of both."""
    reversal = CONTROLS[case.control].declaration.reversal
    both = reversal.startswith("both") or reversal == ONE_VALUE
    return [np.full((m, axes), w) for w in ((1.0, -1.0, 0.0) if both else (0.0,))]


def truth_of(case: Case) -> Truth:
    """The machine that has exactly the errors of the tables or grid, for the separate chain."""
    made, truth = case.make(), Truth()
    for t in made.tables:
        truth.functions[t.function] = lambda q, t=t: np.interp(q, t.positions, 0.5 * (t.forward + t.reverse))
        truth.reversal[t.function] = lambda q, t=t: np.interp(q, t.positions, t.forward - t.reverse)
    return truth


def field(case: Case, exact: ExactMachine, q: np.ndarray) -> np.ndarray:
    """The linear field of `spatial` as its docstring says it, (m, 3) [mm]."""
    at = {a: q[:, i] for i, a in enumerate(case.machine.letters)}
    return np.stack([0.010 * at["X"] / 1000, -0.005 * at["Z"] / 500, np.full(len(q), 0.002)], axis=1)


def deviation(case: Case, exact: ExactMachine, q: np.ndarray, way: np.ndarray) -> np.ndarray:
    """Actual - nominal functional point at programmed positions without compensation, (m, 3) [mm]."""
    if case.make is spatial:
        return field(case, exact, q)
    return exact.functional_point(q, TOOL, truth_of(case), way) - exact.functional_point(q, TOOL)


def between(case: Case, exact: ExactMachine, q: np.ndarray, way: np.ndarray) -> np.ndarray:
    """The deviation as a control without a model holds it: linear between Y = 300 and 600, where `levered` has its positions."""
    y = q[:, case.machine.index("Y")]
    if case.make is not levered or not np.all((y > 300.0) & (y < 600.0)):
        return deviation(case, exact, q, way)
    low, high, w = q.copy(), q.copy(), (y - 300.0) / 300.0
    low[:, case.machine.index("Y")], high[:, case.machine.index("Y")] = 300.0, 600.0
    return (1.0 - w) * deviation(case, exact, low, way) + w * deviation(case, exact, high, way)


def left(case: Case, control: Control, q: np.ndarray, way: np.ndarray) -> np.ndarray:
    """What the separate chain says is left of the deviation of the functional point when the control moves it, (m, 3) [mm]."""
    exact = exact_of(case.machine)
    where = control.command(q, TOOL, way)
    moved = exact.functional_point(where, TOOL) - exact.functional_point(q, TOOL)
    return deviation(case, exact, where, way) + moved
