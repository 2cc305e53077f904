"""The two published cases of sequential step diagonals as virtual machines: measured, separated, compensated, measured again.

Nothing of volid is used. The nine functions come from the four equations of every interval one by one, a control takes their
linear interpolation off the command. Machines, errors, noise and mirrors are assumed; published are box, steps, and the largest
diagonal error before and after.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from exact_chain.diagonals import BODY, Way, displacements, range_of, stepped
from exact_chain.files import machine_toml
from exact_chain.machine import ExactMachine
from exact_chain.motions import COMPONENTS, LINEAR
from exact_chain.random_truth import random_truth
from exact_chain.truth import Truth

TOOL = np.array([0.0, 0.0, -150.0])  # mm
U = 5e-4  # mm, of a reading
TILT = 1e-5  # rad, standard deviation of each of the two angles of every mirror
SYNTHETIC = "# SYNTHETIC, computed by make.py; mm, rad"


@dataclass(frozen=True)
class Case:
    """A published case: machine, steps of each axis, its largest diagonal error before and after [mm]; name for people."""

    name: str
    machine: ExactMachine
    n: int
    before: float
    after: float

    def ways(self) -> dict[str, Way]:
        return {name: stepped(self.machine, name, self.n) for name in BODY}

    def nodes(self, axis: str) -> np.ndarray:
        return np.linspace(*self.machine.travel[axis], self.n + 1)


CASES = {
    "800": Case(
        "800 × 600 × 600",
        ExactMachine("w X' Y' b Z t", {"X": (0, 800), "Y": (0, 600), "Z": (0, 600)}),
        40,
        0.060,
        0.0068,
    ),
    "900": Case(
        "900 × 720 × 720",
        ExactMachine("w Y' b X Z t", {"X": (0, 900), "Y": (0, 720), "Z": (0, 720)}),
        30,
        0.058,
        0.0087,
    ),
}


def without_rotations(truth: Truth) -> Truth:
    """The truth without what turns anything but the directions of the linear axes."""
    functions = {name: f for name, f in truth.functions.items() if name[1] in LINEAR}
    reversal = {name: f for name, f in truth.reversal.items() if name[1] in LINEAR}
    return Truth(functions, {k: v for k, v in truth.constants.items() if not k.endswith("S")}, reversal)


def truth_of(case: Case, seed: int, *, rotations: bool = True, reversal: bool = False) -> Truth:
    """Random errors of such a size that the largest E of the four diagonals is the published one."""

    def drawn(scale: float) -> Truth:
        truth = random_truth(case.machine, np.random.default_rng(seed), scale=scale, reversal=reversal)
        return truth if rotations else without_rotations(truth)

    return drawn(case.before / largest_diagonal(case, drawn(1.0)))


def read(
    case: Case, truth: Truth, rng=None, *, tilt: float = 0.0, altered: Callable | None = None
) -> dict[str, np.ndarray]:
    """Readings beyond the nominal ones on four diagonals there and back, (2 (3 n + 1),) each [mm]; `rng`: of noise and tilts."""
    found = {}
    for name, way in case.ways().items():
        angles = (0.0, 0.0) if rng is None else rng.normal(0.0, tilt, 2)
        exact = displacements(case.machine, way, TOOL, truth, tilt=angles, altered=altered)
        found[name] = exact if rng is None else exact + rng.normal(0.0, U, len(exact))
    return found


def largest_diagonal(case: Case, truth: Truth, altered: Callable | None = None) -> float:
    """Largest E of the four diagonals without noise [mm]: every third place, both ways."""
    return largest_of(case, read(case, truth, altered=altered))


def largest_of(case: Case, found: dict[str, np.ndarray]) -> float:
    """Largest E of the four diagonals of readings [mm]."""
    half = 3 * case.n + 1
    return max(range_of(np.concatenate([r[:half:3], r[half:][::-3]])) for r in found.values())


def separated(case: Case, found: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The nine functions by axis, (n + 1, 3) each, 0 at the low end: four equations there and four back for every interval."""
    functions, half = {}, 3 * case.n + 1
    for axis, letter in enumerate(LINEAR):
        increments = np.zeros((case.n, 3))
        for i in range(case.n):
            equations, changes = [], []
            for name, way in case.ways().items():
                sense = BODY[name][axis]
                k = 3 * (i if sense > 0 else case.n - 1 - i) + axis  # the place before the step
                there, back = found[name][:half], found[name][half:][::-1]
                for values in (there, back):
                    equations.append(sense * way.beam)
                    changes.append(values[k + 1] - values[k])
            increments[i] = np.linalg.lstsq(np.array(equations), np.array(changes), rcond=None)[0]
        functions[letter] = np.concatenate([np.zeros((1, 3)), np.cumsum(increments, axis=0)])
    return functions


def control_with(case: Case, functions: dict[str, np.ndarray]) -> Callable:
    """What a control makes of a command that takes the nine functions, linearly interpolated, off it."""
    machine = case.machine

    def altered(q, tool=None, direction=None):
        off = np.zeros((len(q), 3))
        for letter, values in functions.items():
            own = q[:, machine.column(letter)]
            off += np.stack([np.interp(own, case.nodes(letter), values[:, c]) for c in range(3)], axis=1)
        return q - machine.in_axis_order(dict(zip(LINEAR, off.T, strict=True)))

    return altered


# ------------------------------------------------------------------------------------------------------------------ as files


def table(case: Case, found: dict[str, np.ndarray]) -> str:
    """Readings as deviations, 3 n + 1 rows, with columns for the way on and back."""
    travel, half = case.machine.travel, 3 * case.n + 1
    box = ", ".join(f"{a} {travel[a][0]:g} {travel[a][1]:g}" for a in LINEAR)
    lines = [f"# box: {box}", f"# tool: {', '.join(f'{t:g}' for t in TOOL)}", f"# u: {U:g}", "# values: deviation"]
    lines.append(",".join([*found, *(f"{name}_back" for name in found)]))
    columns = [r[:half] for r in found.values()] + [r[half:][::-1] for r in found.values()]
    return "\n".join([*lines, *(",".join(f"{v:.12f}" for v in row) for row in np.column_stack(columns))]) + "\n"


def rows(case: Case, found: dict[str, np.ndarray]) -> list[str]:
    """Rows of a projection set: positions, approach directions, line, displacement."""
    result = []
    for name, way in case.ways().items():
        points = case.machine.functional_point(way.q, TOOL)
        whole = found[name] + (points - points[0]) @ way.beam
        for q, d, value in zip(way.q, way.direction, whole, strict=True):
            result.append(f"{','.join(f'{v:.6g}' for v in q)},{','.join(f'{v:g}' for v in d)},{name},{value:.6f}")
    return result


def functions_rows(case: Case, truth: Truth, step: float = 5.0) -> list[str]:
    """Rows of truth_functions.csv: error functions on a fine table, then the constants."""
    result = []
    for axis in LINEAR:
        low, high = case.machine.travel[axis]
        q = np.arange(low, high + step / 2, step)
        for name in (component + axis for component in COMPONENTS):
            digits = 9 if name[1] in LINEAR else 12
            result += [
                f"{name},{axis},{x:g},0,{v:.{digits}f}" for x, v in zip(q, truth.functions[name](q), strict=True)
            ]
    return result + [f"{name},{name[-1]},,0,{value:.12f}" for name, value in truth.constants.items()]


def write(folder: Path, case: Case, seed: int) -> None:
    """Write all files of a dataset but README.md and make.py into `folder`."""
    rng, truth = np.random.default_rng(1000 + seed), truth_of(case, seed)
    before = read(case, truth, rng, tilt=TILT)
    control = control_with(case, separated(case, before))
    after = read(case, truth, rng, tilt=TILT, altered=control)
    axes = case.machine.axes
    header = [*axes, *(f"{a}_dir" for a in axes), "line", "displacement"]
    texts = {
        "machine.toml": machine_toml(case.machine, f"Virtual machine of {case.name} mm"),
        "campaign.toml": _manifest(case),
        "readings.csv": "\n".join([SYNTHETIC, ",".join(header), *rows(case, before)]) + "\n",
        "steps.csv": f"{SYNTHETIC}\n{table(case, before)}",
        "steps_after.csv": f"{SYNTHETIC}\n{table(case, after)}",
        "truth_functions.csv": "\n".join(
            [SYNTHETIC, "function,axis,position,direction,value", *functions_rows(case, truth)]
        )
        + "\n",
    }
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in texts.items():
        (folder / name).write_bytes(text.encode())


def _manifest(case: Case) -> str:
    beams = ", ".join(f"{name} = [{', '.join(f'{b:.12f}' for b in way.beam)}]" for name, way in case.ways().items())
    return f"""\
# SYNTHETIC: computed by make.py, not measured. See README.md.
format = "volid-campaign/1"
machine = "machine.toml"
title = "SYNTHETIC sequential step diagonals, {case.name} mm, {case.n} steps"

[conditions]
synthetic = true
machine_condition = "warm, not compensated"
tool_length_mm = 150.0             # to the point of the mirror that the beam meets first
ambient_temperature_C = 20.0
active_compensations = []

[[set]]
name = "step diagonals"
kind = "projection"
file = "readings.csv"
tool = [{", ".join(f"{t:g}" for t in TOOL)}]
mirror = "flat"
misalignment = true                # the mirrors' tilt is unknown
lines = {{ {beams} }}
u = {U:g}
"""
