"""The machine: a chain of exact 4x4 factors in the order of its structural code."""

import re
from collections.abc import Iterable, Mapping

import numpy as np
from scipy.spatial.transform import Rotation

from exact_chain.motions import COMPONENTS, LINEAR, ROTARY, apply, rigid, unit
from exact_chain.truth import Truth


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
