"""Independent virtual machine: exact 4x4 matrices in plain NumPy/SciPy, nothing from volid or JAX.

Written from CONVENTIONS.md alone, to judge the package. Units: mm, rad; rotary positions in degrees. Arrays of axis
positions `q` have shape (m, number of axes), columns in the order of the structural code, workpiece to tool.
"""

import functools
import itertools
import json
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

LINEAR = "XYZ"
ROTARY = "ABC"
COMPONENTS = ("EX", "EY", "EZ", "EA", "EB", "EC")
MICRO = 1e-6  # 1 µrad in rad
MICROMETRE = 1e-3  # 1 µm in mm


def unit(letter: str) -> np.ndarray:
    """Unit vector that belongs to a letter: X, A -> e_x; Y, B -> e_y; Z, C -> e_z."""
    return np.eye(3)[(LINEAR if letter in LINEAR else ROTARY).index(letter)]


def rigid(rotation_vector, translation, centre=(0.0, 0.0, 0.0)) -> np.ndarray:
    """Exact motion x -> c + R (x - c) + e as matrices (m, 4, 4); R = exp[rotation vector x]. [rad, mm, mm]."""
    rotation_vector, translation = np.atleast_2d(rotation_vector), np.atleast_2d(translation)
    m = max(len(rotation_vector), len(translation))
    rotation_vector, centre = np.broadcast_to(rotation_vector, (m, 3)).copy(), np.asarray(centre, float)
    matrix = np.tile(np.eye(4), (m, 1, 1))
    matrix[:, :3, :3] = Rotation.from_rotvec(rotation_vector).as_matrix()
    matrix[:, :3, 3] = centre + translation - matrix[:, :3, :3] @ centre
    return matrix


def apply(matrix: np.ndarray, point) -> np.ndarray:
    """Points T p, shape (m, 3), of one point (3,) or one per matrix (m, 3)."""
    point = np.broadcast_to(np.asarray(point, float), (len(matrix), 3))
    return np.einsum("mij,mj->mi", matrix[:, :3, :3], point) + matrix[:, :3, 3]


# --------------------------------------------------------------------------------------------------------- truth


@dataclass(frozen=True)
class Smooth:
    """f(q) = sum_k amplitude_k sin(2 pi frequency_k q + phase_k) + sum_j coefficient_j ((q - centre) / width)^j."""

    amplitude: np.ndarray
    frequency: np.ndarray  # cycles per mm or degree
    phase: np.ndarray
    coefficient: np.ndarray
    centre: float = 0.0
    width: float = 1.0

    def __call__(self, q) -> np.ndarray:
        q = np.asarray(q, float)
        waves = np.sin(2 * np.pi * q[..., None] * self.frequency + self.phase) @ self.amplitude
        return waves + np.polynomial.polynomial.polyval((q - self.centre) / self.width, self.coefficient)

    def plus(self, constant: float = 0.0, slope: float = 0.0) -> "Smooth":
        """The function f(q) + constant + slope (q - centre)."""
        coefficient = np.append(self.coefficient, np.zeros(max(0, 2 - len(self.coefficient))))
        coefficient[:2] += constant, slope * self.width
        return Smooth(self.amplitude, self.frequency, self.phase, coefficient, self.centre, self.width)

    def plus_first_harmonic(self, cosine: float, sine: float) -> "Smooth":
        """The function f(q) + cosine cos(q) + sine sin(q), q in degrees."""
        return Smooth(
            np.append(self.amplitude, [cosine, sine]),
            np.append(self.frequency, [1 / 360, 1 / 360]),
            np.append(self.phase, [np.pi / 2, 0.0]),
            self.coefficient,
            self.centre,
            self.width,
        )

    def times(self, factor: float) -> "Smooth":
        """The function factor f(q)."""
        return Smooth(
            factor * self.amplitude, self.frequency, self.phase, factor * self.coefficient, self.centre, self.width
        )


@dataclass(frozen=True)
class Product:
    """Cross effect f(q, other) = own(q) across(other)."""

    own: Callable
    across: Callable

    def __call__(self, q, other) -> np.ndarray:
        return self.own(q) * self.across(other)


@dataclass
class Truth:
    """What the machine really does; every name is ISO 230-1's, every absent name is zero.

    functions: name -> f(q_own). cross: name -> (other axis, f(q_own, q_other)), added to `functions`.
    constants: EC0Y, EX0C, EA0S, ... reversal: name -> B(q_own), E(q, +-) = E(q) +- B(q)/2. [mm, rad]
    """

    functions: dict[str, Callable] = field(default_factory=dict)
    constants: dict[str, float] = field(default_factory=dict)
    reversal: dict[str, Callable] = field(default_factory=dict)
    cross: dict[str, tuple[str, Callable]] = field(default_factory=dict)


# ------------------------------------------------------------------------------------------------------- machine


class ExactMachine:
    """Chain of exact 4x4 factors in the order of the structural code, workpiece to tool (CONVENTIONS 2 and 3)."""

    def __init__(
        self,
        structure: str,
        travel: Mapping[str, tuple[float, float]],
        reference: Mapping[str, float] | None = None,
        error_point: Mapping[str, Iterable[float]] | None = None,
        point: Mapping[str, Iterable[float]] | None = None,
        direction: Mapping[str, Iterable[float]] | None = None,
        axis_frame: Iterable[str] = (),
    ):
        """`axis_frame`: letters of inclined axes whose six components stand in a frame turned with the axis's direction."""
        self.structure = structure
        tokens = re.findall(r"\(\w'?\)|\w'?", structure.strip().strip("[]"))
        if "".join(tokens) != re.sub(r"\s", "", structure.strip().strip("[]")):
            raise ValueError(
                f"structural code {structure!r}: expected axis letters, primes and bracketed spindles only"
            )
        if tokens[:1] != ["w"] or tokens[-1:] != ["t"] or tokens.count("b") != 1:
            raise ValueError(f"structural code {structure!r}: expected 'w ... b ... t'")
        bed = tokens.index("b")
        moving = [(i, token) for i, token in enumerate(tokens) if token not in ("w", "b", "t") and token[0] != "("]
        for i, token in moving:
            if token[0] not in LINEAR + ROTARY or (i < bed) != token.endswith("'"):
                raise ValueError(f"structural code {structure!r}: {token!r}; axes left of b carry a prime, others none")
        self.axes = tuple(token[0] for _, token in moving)
        if len(set(self.axes)) != len(self.axes):
            raise ValueError(f"structural code {structure!r}: an axis appears twice")
        self.primed = {token[0]: token.endswith("'") for _, token in moving}
        self.travel = {a: (float(travel[a][0]), float(travel[a][1])) for a in self.axes}
        self.reference = {a: float(np.mean(self.travel[a])) if a in LINEAR else 0.0 for a in self.axes}
        self.reference.update(reference or {})
        self.point = {a: np.zeros(3) for a in self.axes}
        self.point.update({a: np.asarray(p, float) for a, p in (point or {}).items()})
        self.error_point = dict(self.point)  # linear: machine origin; rotary: its point
        self.error_point.update({a: np.asarray(p, float) for a, p in (error_point or {}).items()})
        self.direction = {a: unit(a) for a in self.axes}
        for a, d in (direction or {}).items():
            self.direction[a] = np.asarray(d, float) / np.linalg.norm(d)
        self.inclined = tuple(axis_frame)
        self.frame = {
            a: _turn_between(unit(a), self.direction[a]) if a in self.inclined else np.eye(3) for a in self.axes
        }

    def column(self, axis: str) -> int:
        """Column of an axis in `q`."""
        return self.axes.index(axis)

    def in_axis_order(self, positions: Mapping[str, Iterable[float]]) -> np.ndarray:
        """Array q (m, number of axes) from positions by axis letter."""
        return np.column_stack(np.broadcast_arrays(*[np.asarray(positions[a], float) for a in self.axes]))

    def errors(self, axis: str, q, truth: Truth, direction=None) -> np.ndarray:
        """Six error values of one axis (m, 6): functions, cross effects, reversal, axis direction, location errors."""
        q = np.atleast_2d(np.asarray(q, float))
        own = q[:, self.column(axis)]
        values = np.zeros((len(q), 6))
        for k, component in enumerate(COMPONENTS):
            name = component + axis
            if name in truth.functions:
                values[:, k] += truth.functions[name](own)
            if name in truth.cross:
                other, function = truth.cross[name]
                values[:, k] += function(own, q[:, self.column(other)])
            if name in truth.reversal and direction is not None:
                sign = np.atleast_2d(np.asarray(direction, float))[:, self.column(axis)]
                values[:, k] += sign * truth.reversal[name](own) / 2
        constant = np.array([truth.constants.get(f"{component}0{axis}", 0.0) for component in COMPONENTS])
        if axis in ROTARY:
            return values + constant
        slope = np.cross(constant[3:], self.direction[axis])  # rotation x direction
        values[:, :3] += (own - self.reference[axis])[:, None] * slope
        return values

    def nominal_factor(self, axis: str, q) -> np.ndarray:
        """Nominal factor N (m, 4, 4): translation by q along, or rotation by q about, the axis."""
        own = np.atleast_2d(np.asarray(q, float))[:, [self.column(axis)]]
        if axis in LINEAR:
            return rigid(np.zeros(3), own * self.direction[axis])
        return rigid(np.deg2rad(own) * self.direction[axis], np.zeros(3), self.point[axis])

    def pose(self, q, truth: Truth, direction=None) -> np.ndarray:
        """Exact T_workpiece_tool (m, 4, 4): product over the axes of N D or D N, then the tool frame's S."""
        S = np.array([truth.constants.get(f"{component}0S", 0.0) for component in COMPONENTS])
        return self.body_pose("tool", q, truth, direction) @ rigid(S[3:], S[:3])

    def body_pose(self, body: str, q, truth: Truth, direction=None) -> np.ndarray:
        """Exact T_workpiece_body (m, 4, 4) of "workpiece", "bed", "tool" (without S) or what an axis letter moves."""
        self._check_names(truth)
        q = np.atleast_2d(np.asarray(q, float))
        T = np.tile(np.eye(4), (len(q), 1, 1))
        primed = [a for a in self.axes if self.primed[a]]
        ends = {"workpiece": 0, "bed": len(primed), "tool": len(self.axes)}
        ends |= {a: i + (not self.primed[a]) for i, a in enumerate(self.axes)}
        for axis in self.axes[: ends[body]]:
            N = self.nominal_factor(axis, q)
            E = self.errors(axis, q, truth, direction)
            turn = self.frame[axis].T  # of rows: from the axis's frame to the machine's
            D = rigid(E[:, 3:] @ turn, E[:, :3] @ turn, self.error_point[axis])
            # linear on the tool side: N D; primed: D N. Rotary the other way round.
            T = T @ (N @ D if (axis in LINEAR) != self.primed[axis] else D @ N)
        return T

    def nominal_pose(self, q) -> np.ndarray:
        """Nominal T_workpiece_tool (m, 4, 4)."""
        return self.pose(q, Truth())

    def table_rotation(self, q) -> np.ndarray:
        """R_w (m, 3, 3): product of the nominal factors' rotations of the primed rotary axes."""
        q = np.atleast_2d(np.asarray(q, float))
        R = np.tile(np.eye(3), (len(q), 1, 1))
        for axis in self.axes:
            if axis in ROTARY and self.primed[axis]:
                R = R @ self.nominal_factor(axis, q)[:, :3, :3]
        return R

    def functional_point(self, q, tool, truth: Truth | None = None, direction=None) -> np.ndarray:
        """Functional point T p in the workpiece frame (m, 3); nominal when `truth` is None. [mm]."""
        return apply(self.pose(q, truth or Truth(), direction), tool)

    def deviation(self, q, tool, truth: Truth, direction=None) -> np.ndarray:
        """Deviation (m, 6) in the machine frame: R_w^T (actual - nominal point), R_w^T rotvec(actual nominal^-1)."""
        actual, nominal = self.pose(q, truth, direction), self.nominal_pose(q)
        turn = actual[:, :3, :3] @ nominal[:, :3, :3].transpose(0, 2, 1)
        orientation = Rotation.from_matrix(turn).as_rotvec()
        both = np.stack([apply(actual, tool) - apply(nominal, tool), orientation], axis=1)
        return np.einsum("mji,mkj->mki", self.table_rotation(q), both).reshape(-1, 6)

    def _check_names(self, truth: Truth) -> None:
        """Refuse names that would silently mean nothing."""
        motions = {component + axis for component in COMPONENTS for axis in self.axes}
        constants = {f"{component}0{axis}" for component in COMPONENTS[3:] for axis in (*self.axes, "S")}
        constants |= {f"{component}0{a}" for component in COMPONENTS[:3] for a in (*self.axes, "S") if a not in LINEAR}
        wrong = sorted({*truth.functions, *truth.cross, *truth.reversal} - motions) + sorted(
            set(truth.constants) - constants
        )
        if wrong:
            raise ValueError(f"structural code {self.structure!r} has no error {', '.join(wrong)}")


def _turn_between(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """The smallest rotation that carries one unit vector to another, (3, 3)."""
    about = np.cross(start, end)
    size = np.linalg.norm(about)
    if size < 1e-12 and start @ end < 0:
        raise ValueError("opposite vectors: the smallest rotation between them is not unique")
    angle = np.arctan2(size, start @ end)
    return Rotation.from_rotvec(about * (angle / size if size else 0.0)).as_matrix()


def machine_grid(machine: ExactMachine, n) -> np.ndarray:
    """Regular grid over the whole travel, ends included: (n^axes, axes); n an int or one per axis."""
    counts = np.broadcast_to(n, len(machine.axes))
    lines = [np.linspace(*machine.travel[a], int(k)) for a, k in zip(machine.axes, counts, strict=True)]
    return np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, len(lines))


def machine_toml(machine: ExactMachine, name: str = "virtual machine", extra: str = "") -> str:
    """Text of the machine file, `extra` appended: [datum], [model], ..."""
    lines = ['format = "volid-machine/1"', f"name = {json.dumps(name)}", f"structure = {json.dumps(machine.structure)}"]
    for axis in machine.axes:
        lines += ["", f"[axis.{axis}]", f"travel = {_numbers(machine.travel[axis])}"]
        lines.append(f"reference = {machine.reference[axis]!r}")
        if axis in ROTARY:
            lines.append(f"point = {_numbers(machine.point[axis])}")
            if not np.array_equal(machine.direction[axis], unit(axis)):
                lines.append(f"direction = {_numbers(machine.direction[axis])}")
            if axis in machine.inclined:
                lines.append('axis_frame = "axis"')
        if not np.array_equal(machine.error_point[axis], machine.point[axis]):
            lines.append(f"error_point = {_numbers(machine.error_point[axis])}")
    return "\n".join(lines) + "\n" + (f"\n{extra.strip()}\n" if extra.strip() else "")


def _numbers(values) -> str:
    return "[" + ", ".join(repr(float(v)) for v in values) + "]"


# -------------------------------------------------------------------------------------------------- random truth


def random_truth(
    machine: ExactMachine,
    rng: np.random.Generator,
    *,
    waviness: float = 1.0,
    scale: float = 1.0,
    reversal: bool | Iterable[str] = False,
    cross: Mapping[str, str] | None = None,
    tool_rotation: bool = True,
    primary: str = "X",
    secondary: str = "Y",
) -> Truth:
    """Smooth non-spline errors of a good machine, in the datum of CONVENTIONS 4.

    Largest value over the travel: translations 3-15 µm (plus a slope up to 30 µm/m for positioning), rotations
    10-30 µrad; squareness 20-40 µrad, tool rotation 30-70 µrad, rotary location errors 5-25 µm and 20-40 µrad.
    The shortest wave is 0.45 travels / waviness. `scale` multiplies everything. `reversal`: names of functions, or True
    for the positioning functions. `cross`: e.g. {"EAZ": "X"} adds own(z) across(x), zero at both references.
    """
    truth = Truth()
    for axis in machine.axes:
        draw = _linear_functions if axis in LINEAR else _rotary_functions
        truth.functions.update(draw(machine, axis, rng, waviness, scale))
    for axis in machine.axes:
        if axis in ROTARY:
            truth.constants.update(_location_errors(machine, axis, rng, scale))
    for name in _squareness_names(machine, primary, secondary):
        truth.constants[name] = scale * _signed(rng, 20, 40) * MICRO
    if tool_rotation:
        truth.constants.update({f"{component}0S": scale * _signed(rng, 30, 70) * MICRO for component in COMPONENTS[3:]})
    for name, other in (cross or {}).items():
        waves = [_wave(machine, axis, rng, waviness) for axis in (name[2], other)]
        own, across = (
            _unit_peak(f.plus(-f(f.centre)), machine.travel[axis])
            for f, axis in zip(waves, (name[2], other), strict=True)
        )
        size = rng.uniform(3, 8) * MICROMETRE if name[1] in LINEAR else rng.uniform(5, 15) * MICRO
        truth.cross[name] = (other, Product(own.times(scale * size), across))
    if reversal is True:
        reversal = [("E" + axis + axis) for axis in machine.axes]
    for name in reversal or ():
        size = _signed(rng, 1, 4) * MICROMETRE if name[1] in LINEAR else _signed(rng, 2, 6) * MICRO
        ripple = _unit_peak(_wave(machine, name[2], rng, waviness), machine.travel[name[2]])
        truth.reversal[name] = ripple.times(0.2).plus(1.0).times(scale * size)
    return truth


def _signed(rng, low, high) -> float:
    """Random value with magnitude between low and high and random sign."""
    return float(rng.uniform(low, high) * rng.choice([-1.0, 1.0]))


def _wave(machine: ExactMachine, axis: str, rng, waviness: float) -> Smooth:
    """Four sines, periods log-uniform in 0.45-2 travels / waviness, power falling with frequency, plus a cubic."""
    low, high = machine.travel[axis]
    length = high - low
    period = length / waviness * np.exp(rng.uniform(np.log(0.45), np.log(2.0), 4))
    amplitude = rng.uniform(0.5, 1.0, 4) * np.sqrt(period / period.max())
    cubic = rng.normal(0.0, 0.7, 4) * [0, 1, 1, 1]
    return Smooth(amplitude, 1 / period, rng.uniform(0, 2 * np.pi, 4), cubic, machine.reference[axis], length)


@functools.cache
def _gauss_legendre(n: int) -> tuple[np.ndarray, np.ndarray]:
    return np.polynomial.legendre.leggauss(n)


def _dense(travel, n: int = 400) -> tuple[np.ndarray, np.ndarray]:
    """Gauss-Legendre nodes over the travel and weights that sum to one."""
    node, weight = _gauss_legendre(n)
    return np.mean(travel) + np.ptp(travel) / 2 * node, weight / 2


def _unit_peak(function: Smooth, travel) -> Smooth:
    """The function scaled to a largest absolute value of 1 over the travel."""
    return function.times(1 / np.abs(function(np.linspace(*travel, 401))).max())


def _without_slope(function: Smooth, travel) -> Smooth:
    """The function minus its least-squares slope, uniform weight over the travel; zero at the reference."""
    q, weight = _dense(travel)
    lever = q - weight @ q
    function = function.plus(slope=-(weight @ (lever * function(q))) / (weight @ lever**2))
    return function.plus(-function(function.centre))


def _linear_functions(machine, axis, rng, waviness, scale) -> dict[str, Smooth]:
    """Six functions of a linear axis: zero at the reference; straightness without slope, positioning with."""
    functions, travel = {}, machine.travel[axis]
    for component in COMPONENTS:
        f = _wave(machine, axis, rng, waviness)
        if component[1] in LINEAR:
            f = _unit_peak(_without_slope(f, travel), travel).times(rng.uniform(3, 15) * MICROMETRE)
            if component[1] == axis:
                f = f.plus(slope=rng.uniform(-30, 30) * MICRO)  # µm/m
        else:
            f = _unit_peak(f.plus(-f(f.centre)), travel).times(rng.uniform(10, 30) * MICRO)
        functions[component + axis] = f.times(scale)
    return functions


def _rotary_functions(machine, axis, rng, waviness, scale) -> dict[str, Smooth]:
    """Six functions of a rotary axis: zero mean, no co-rotating vector (CONVENTIONS 4); angle zero at the reference.

    Rotor-fixed vector v across the axis d, seen from the stator: cos(q) v +- sin(q) d x v, + on the tool side.
    """
    travel, d = one_turn(machine.travel[axis]), machine.frame[axis].T @ machine.direction[axis]
    along = ROTARY.index(axis)
    if abs(abs(d[along]) - 1.0) > 1e-12:
        raise ValueError(f"axis {axis}: random_truth needs a rotary axis parallel to its machine axis, or axis_frame")
    turn = -1.0 if machine.primed[axis] else 1.0
    q, weight = _dense(travel)
    cos, sin = np.cos(np.deg2rad(q)), turn * np.sin(np.deg2rad(q))
    functions = {}
    for names, size in ((COMPONENTS[:3], MICROMETRE), (COMPONENTS[3:], MICRO)):
        low, high = (2, 8) if size == MICROMETRE else (10, 30)
        f = [_periodic_or_wave(machine, axis, rng, waviness) for _ in names]
        across = [k for k in range(3) if k != along]
        v1, v2 = np.eye(3)[across[0]], np.eye(3)[across[1]]
        fields = [np.outer(cos, v) + np.outer(sin, np.cross(d, v)) for v in (v1, v2)]  # co-rotating
        fields += [np.tile(v, (len(q), 1)) for v in (v1, v2)]  # mean
        A = np.stack([vectors[:, across] for vectors in fields], axis=-1)  # (nodes, 2, 4)
        value = np.stack([f[k](q) for k in across], axis=-1)
        normal = np.einsum("n,nca,ncb->ab", weight, A, A)
        c = np.linalg.solve(normal, np.einsum("n,nca,nc->a", weight, A, value))
        turned = [turn * np.cross(d, v) for v in (v1, v2)]
        for k in across:
            cosine, sine = c[0] * v1[k] + c[1] * v2[k], c[0] * turned[0][k] + c[1] * turned[1][k]
            f[k] = f[k].plus_first_harmonic(-cosine, -sine).plus(-(c[2] * v1[k] + c[3] * v2[k]))
        f[along] = f[along].plus(-(weight @ f[along](q)) if size == MICROMETRE else -f[along](machine.reference[axis]))
        pair = max(np.abs(f[k](q)).max() for k in across)  # one factor for the pair: keeps it free of co-rotation
        peak = [np.abs(f[along](q)).max() if k == along else pair for k in range(3)]
        amplitude = {k: rng.uniform(low, high) * size for k in ("pair", "along")}
        for k, name in enumerate(names):
            factor = amplitude["along" if k == along else "pair"] / peak[k]
            functions[name + axis] = f[k].times(scale * factor)
    return functions


def one_turn(travel) -> tuple[float, float]:
    """The travel, or one turn of an axis that makes more: its errors repeat."""
    return travel if np.ptp(travel) <= 360 else (-180.0, 180.0)


def _periodic_or_wave(machine, axis, rng, waviness) -> Smooth:
    """Harmonics 1 to 3 (x waviness) for whole turns, otherwise a wave over the travel."""
    if np.ptp(machine.travel[axis]) < 360:
        return _wave(machine, axis, rng, waviness)
    order = np.unique(np.maximum(1, np.round(waviness * np.arange(1, 4))))
    phase = rng.uniform(0, 2 * np.pi, len(order))
    amplitude = rng.uniform(0.5, 1.0, len(order)) / np.sqrt(np.arange(1, len(order) + 1))
    return Smooth(amplitude, order / 360, phase, np.zeros(2), machine.reference[axis], 360.0)


def _location_errors(machine, axis, rng, scale) -> dict[str, float]:
    """Position and orientation of the axis line across its direction: four constants."""
    along = ROTARY.index(axis)
    position = {f"{COMPONENTS[k]}0{axis}": scale * _signed(rng, 5, 25) * MICROMETRE for k in range(3) if k != along}
    tilt = {f"{COMPONENTS[k + 3]}0{axis}": scale * _signed(rng, 20, 40) * MICRO for k in range(3) if k != along}
    return position | tilt


def _squareness_names(machine: ExactMachine, primary: str, secondary: str) -> list[str]:
    """Secondary axis: about the normal of the primary-secondary plane. Third axis: about primary and secondary."""
    third = next(a for a in LINEAR if a not in (primary, secondary))
    about = dict(zip(LINEAR, ROTARY, strict=True))
    names = [(third, secondary), (secondary, third), (primary, third)]
    return [f"E{about[r]}0{axis}" for r, axis in names if {primary, secondary, axis} <= set(machine.axes)]


# ----------------------------------------------------------------------------------------------- virtual campaign


@dataclass
class TrackerCampaign:
    """Distances of a virtual tracking interferometer, one row per reading, with everything that is true about them."""

    axes: tuple[str, ...]
    q: np.ndarray  # (m, axes), machine axis order [mm, degrees]
    tool: np.ndarray  # (m, 3) [mm]
    station: np.ndarray  # (m,) names
    segment: np.ndarray  # (m,) int, counted per station from 1
    distance: np.ndarray  # (m,) reading [mm]
    u: np.ndarray  # (m,) standard uncertainty of the reading, outliers not included [mm]
    direction: np.ndarray | None  # (m, axes) +1, -1; None when the machine has no reversal
    station_positions: dict[str, np.ndarray]  # true, workpiece frame [mm]
    dead_paths: dict[tuple[str, int], float]  # true, per (station, segment) [mm]
    outlier: np.ndarray  # (m,) bool
    u_constant: float
    u_proportional: float


def default_tools() -> np.ndarray:
    """Three tool vectors not on one line, two off the spindle axis. [mm]."""
    return np.array([[0.0, 0.0, -150.0], [80.0, 0.0, -250.0], [0.0, 90.0, -200.0]])


def default_stations(machine: ExactMachine) -> dict[str, np.ndarray]:
    """Six stations around and outside the volume of the nominal functional point, at many heights."""
    fraction = np.array(
        [
            [-0.3, -0.2, -0.1],
            [1.25, -0.3, 0.55],
            [1.3, 1.2, 0.0],
            [-0.2, 1.3, 0.9],
            [0.45, -0.4, 1.1],
            [0.55, 1.35, 0.3],
        ]
    )
    low, high = (np.array([machine.travel.get(a, (0.0, 0.0))[i] for a in LINEAR]) for i in (0, 1))
    clearance = 150.0 * (np.sign(fraction - 1) * (fraction > 1) - 1.0 * (fraction < 0))
    positions = default_tools().mean(axis=0) + low + fraction * (high - low) + clearance
    return {f"S{i + 1}": p for i, p in enumerate(positions)}


def spread_positions(machine: ExactMachine, n: int, rng: np.random.Generator, n_grid=None) -> np.ndarray:
    """n positions (n, axes), shuffled: a quarter corners (at most all), a quarter on faces, the rest inside.

    Inside, a Kronecker lattice: frac(shift + i / g^j), g the root of g^(d+1) = g + 1.
    `n_grid`: snap to so many positions per axis, ends included; an int or one per axis.
    """
    d = len(machine.axes)
    g = max(root.real for root in np.roots([1.0, *[0.0] * (d - 1), -1.0, -1.0]) if abs(root.imag) < 1e-12)
    x = (rng.random(d) + np.outer(np.arange(n), g ** -np.arange(1.0, d + 1))) % 1.0
    corners = np.array(list(itertools.product([0.0, 1.0], repeat=d)))
    n_corner = min(len(corners), n // 4)
    x[:n_corner] = rng.permutation(corners)[:n_corner]
    face = np.arange(n_corner, n_corner + n // 4)
    x[face, rng.integers(d, size=len(face))] = rng.integers(2, size=len(face))
    if n_grid is not None:
        intervals = np.broadcast_to(n_grid, d) - 1
        x = np.round(x * intervals) / intervals
    low, high = (np.array([machine.travel[a][i] for a in machine.axes]) for i in (0, 1))
    return rng.permutation(low + x * (high - low))


def approach_directions(q: np.ndarray) -> np.ndarray:
    """Direction (m, axes) of each axis's last move, the program `q` run again and again; +1 if it never moves."""
    direction = np.sign(q - np.roll(q, 1, axis=0))
    for _ in range(2):  # second round: the first rows take the direction left over from the previous run
        for i in range(len(q)):
            direction[i] = np.where(direction[i] == 0, direction[i - 1], direction[i])
    return np.where(direction == 0, 1, direction).astype(int)


def tracker_campaign(
    machine: ExactMachine,
    truth: Truth,
    rng: np.random.Generator,
    stations=None,
    tools=None,
    n_per_station: int = 100,
    u_constant: float = 0.0003,
    u_proportional: float = 3e-7,
    every_station_sees_every_tool: bool = False,
    segments: int = 1,
    outlier_fraction: float = 0.0,
    outlier_range: tuple[float, float] = (0.010, 0.500),
    n_grid=None,
) -> TrackerCampaign:
    """Virtual campaign: distance = |functional point - station| + dead path(station, segment) + noise.

    u^2 = u_constant^2 + (u_proportional |functional point - station|)^2. Each station uses one tool in turn, or all of
    them one after another; `segments` beams per station and tool. Outliers: +- log-uniform in `outlier_range`. [mm].
    Approach directions are those of the program, and recorded when the truth has reversal.
    """
    stations = default_stations(machine) if stations is None else stations
    if not isinstance(stations, Mapping):
        stations = {f"S{i + 1}": p for i, p in enumerate(stations)}
    stations = {name: np.asarray(p, float) for name, p in stations.items()}
    tools = default_tools() if tools is None else np.atleast_2d(np.asarray(tools, float))
    rows = {key: [] for key in ("q", "tool", "station", "segment", "direction")}
    for i, name in enumerate(stations):
        q = spread_positions(machine, n_per_station, rng, n_grid)
        used = tools if every_station_sees_every_tool else tools[[i % len(tools)]]
        block = np.arange(n_per_station) * len(used) * segments // n_per_station  # consecutive rows per beam
        rows["q"].append(q)
        rows["tool"].append(used[block // segments])
        rows["station"].append(np.full(n_per_station, name))
        rows["segment"].append(block + 1)
        rows["direction"].append(approach_directions(q))
    q, tool, station, segment, direction = (np.concatenate(rows[key]) for key in rows)
    if not truth.reversal:
        direction = None
    beams = dict.fromkeys(zip(station.tolist(), segment.tolist(), strict=True))
    dead_paths = {beam: float(rng.uniform(-300, 300)) for beam in beams}
    ray = machine.functional_point(q, tool, truth, direction) - np.array([stations[name] for name in station])
    length = np.linalg.norm(ray, axis=1)
    u = np.hypot(u_constant, u_proportional * length)
    dead = np.array([dead_paths[beam] for beam in zip(station.tolist(), segment.tolist(), strict=True)])
    distance = length + dead + u * rng.standard_normal(len(length))
    outlier = np.zeros(len(length), bool)
    outlier[rng.choice(len(length), round(outlier_fraction * len(length)), replace=False)] = True
    gross = np.exp(rng.uniform(*np.log(outlier_range), len(length))) * rng.choice([-1.0, 1.0], len(length))
    distance += np.where(outlier, gross, 0.0)
    return TrackerCampaign(
        machine.axes, q, tool, station, segment, distance, u, direction, stations, dead_paths, outlier,
        u_constant, u_proportional,
    )  # fmt: skip


def write_campaign(
    folder,
    campaign: TrackerCampaign,
    machine_toml_text: str,
    title: str,
    approximate_error: float | None = None,
    rng: np.random.Generator | None = None,
) -> Path:
    """Write manifest.toml, machine.toml, volume.csv; returns the manifest's path.

    Station positions are given off by `approximate_error` (standard deviation per coordinate, mm), or left out (None).
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "machine.toml").write_text(machine_toml_text, encoding="utf-8")
    rng = rng or np.random.default_rng(0)
    text = ['format = "volid-campaign/1"', 'machine = "machine.toml"', f"title = {json.dumps(title)}"]
    text += ["", "[conditions]", "ambient_temperature_C = 20.0"]
    for name, position in campaign.station_positions.items():
        text += ["", "[[station]]", f"name = {json.dumps(name)}", 'body = "workpiece"']
        if approximate_error is not None:
            text += [f"position = {_numbers(position + approximate_error * rng.standard_normal(3))}"]
    text += ["", "[[set]]", 'name = "volume"', 'kind = "distance"', 'file = "volume.csv"', "relative = true"]
    text += [f"u = {{ constant = {campaign.u_constant!r}, proportional = {campaign.u_proportional!r} }}"]
    (folder / "manifest.toml").write_text("\n".join(text) + "\n", encoding="utf-8")
    header = [*campaign.axes]
    if campaign.direction is not None:
        header += [f"{axis}_dir" for axis in campaign.axes]
    lines = [",".join([*header, "tool_x", "tool_y", "tool_z", "station", "segment", "distance"])]
    for i in range(len(campaign.q)):
        cells = [repr(float(v)) for v in campaign.q[i]]
        if campaign.direction is not None:
            cells += [str(v) for v in campaign.direction[i]]
        cells += [repr(float(v)) for v in campaign.tool[i]]
        cells += [str(campaign.station[i]), str(campaign.segment[i]), repr(float(campaign.distance[i]))]
        lines.append(",".join(cells))
    (folder / "volume.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return folder / "manifest.toml"


# ------------------------------------------------------------------------------------------------ field comparison


def gauge_free(
    difference,
    q,
    tool,
    covariance=None,
    tool_rotation: bool = True,
    *,
    tool_translation: bool = False,
    machine: ExactMachine | None = None,
) -> tuple[np.ndarray, np.ndarray | None]:
    """Difference of two translation fields (n, 3) without rigid workpiece motion and tool rotation: P d, P C P^T.

    P = I - Q Q^T, Q an orthonormal basis (by SVD rank) of e_k, e_k x p and, if asked for, e_k x tool and e_k of the
    tool frame; p the nominal functional points, fields in the machine frame. Without `machine`: three linear axes, q
    is (n, 3) in the order X, Y, Z. With it: q in machine axis order, any axes. `covariance` (3n, 3n): point by point.
    """
    difference = np.asarray(difference, float)
    n = len(difference)
    tool = np.broadcast_to(np.asarray(tool, float), (n, 3))
    identity = np.tile(np.eye(3), (n, 1, 1))
    if machine is None:
        to_machine, tool_to_machine, p = identity, identity, np.asarray(q, float) + tool
    else:
        to_machine = machine.table_rotation(q).transpose(0, 2, 1)
        tool_to_machine = to_machine @ machine.nominal_pose(q)[:, :3, :3]
        p = machine.functional_point(q, tool)
    columns = [to_machine, to_machine @ _lever(p - p.mean(axis=0))]
    if tool_rotation:
        columns.append(tool_to_machine @ _lever(tool))
    if tool_translation:
        columns.append(tool_to_machine)
    G = np.concatenate(columns, axis=2).reshape(3 * n, -1)
    size = np.linalg.norm(G, axis=0)
    U, s, _ = np.linalg.svd(G / np.where(size > 0, size, 1.0), full_matrices=False)
    Q = U[:, s > 1e-9 * s[0]]
    d = difference.reshape(-1)
    projected = (d - Q @ (Q.T @ d)).reshape(n, 3)
    if covariance is None:
        return projected, None
    half = covariance - Q @ (Q.T @ covariance)
    return projected, half - (half @ Q) @ Q.T


def _lever(points: np.ndarray) -> np.ndarray:
    """Matrices (n, 3, 3) whose column k is e_k x point."""
    return np.cross(np.eye(3)[None], points[:, None, :]).transpose(0, 2, 1)
