"""Truth: what a virtual machine really does, as functions of position; splines of the error model play no part in it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline

from volid.exceptions import InputError
from volid.fitting.solution import Solution
from volid.model.iso230 import DIRECTIONS, LINEAR_AXES, ROTATIONS, SPINDLE, parse
from volid.model.kinematics import ROWS, deviation
from volid.model.machine import Machine
from volid.model.splines import Spline, design_matrix

if TYPE_CHECKING:
    from jaxtyping import Float
    from numpy.typing import ArrayLike

POINTS = 401  # of a table over the travel: cubic interpolation of a wave of 0.45 travels is then good to 1e-8 of it
POINTS_ACROSS = 81  # over the second axis of a cross effect


@dataclass(frozen=True, eq=False)
class Table:
    """A function f(q) of one axis by interpolation in a table.

    Beyond an end, the polynomial of the last interval is continued.

    Attributes:
        positions: Array, shape (n,), increasing [mm or degrees].
        values: Array, shape (n,) [mm or rad].
        degree: 3 for the cubic spline through the points (not-a-knot ends), 1 for straight lines between them.

    Example:
        >>> straightness = Table(np.array([0.0, 500.0, 1000.0]), np.array([0.0, 0.004, 0.0]), degree=1)
        >>> straightness(np.array([250.0, 500.0]))
        array([0.002, 0.004])
    """

    positions: np.ndarray
    values: np.ndarray
    degree: int = 3

    @cached_property
    def _spline(self) -> BSpline:
        return make_interp_spline(self.positions, self.values, k=self.degree)

    def __call__(self, q: np.ndarray) -> np.ndarray:
        """Values at positions `q` [mm or degrees], of the same shape [mm or rad]."""
        return np.asarray(self._spline(np.asarray(q, dtype=float)))


@dataclass(frozen=True, eq=False)
class CrossTable:
    """A function f(own axis, other axis) by tensor-product interpolation in a table.

    Attributes:
        positions: Array, shape (n,), of the own axis, increasing [mm or degrees].
        across: Array, shape (p,), of the other axis, increasing [mm or degrees].
        values: Array, shape (n, p) [mm or rad].
        degree: As in `Table`, for both axes.

    Example:
        >>> roll = CrossTable(np.array([0.0, 500.0]), np.array([0.0, 800.0]), np.array([[0.0, 0.0], [0.0, 8e-6]]), degree=1)
        >>> roll(np.array([250.0]), np.array([400.0]))
        array([2.e-06])
    """

    positions: np.ndarray
    across: np.ndarray
    values: np.ndarray
    degree: int = 3

    @cached_property
    def _splines(self) -> tuple[BSpline, BSpline, np.ndarray]:
        along = make_interp_spline(self.positions, self.values, k=self.degree)
        other = make_interp_spline(self.across, along.c.T, k=self.degree)
        unit = [BSpline(s.t, np.eye(len(s.c)), s.k) for s in (along, other)]
        return unit[0], unit[1], other.c.T

    def __call__(self, q: np.ndarray, other: np.ndarray) -> np.ndarray:
        """Values at own positions `q` and positions `other` of the other axis, each of shape (m,) [mm or degrees]; shape (m,)."""
        along, across, coefficients = self._splines
        return np.asarray(np.einsum("mi,ij,mj->m", along(q), coefficients, across(other)))


@dataclass(frozen=True, eq=False)
class Truth:
    """The true errors of a machine and, once it was measured, the true values of everything else that was unknown.

    Every absent name is zero. Drift and thermal change of the machine are not modelled.

    Args:
        machine: The machine that has these errors.
        functions: Error motion by its ISO 230-1 symbol: any function of an array of positions of its own axis
            [mm or degrees -> mm or rad].
        cross: By symbol, the letter of a second axis and a function of own and other positions, added to `functions`.
        reversal: By symbol, a function B(q) with E(q, ±) = E(q) ± B(q)/2 for the direction of approach [mm or rad].
        constants: Squareness, location errors and constants of the tool frame by symbol [mm or rad], as parameters of the
            model: tool relative to workpiece. `volid.model.axis_lines.line_values` tells where the axis average lines stand.
        stations: True positions, (x, y, z) on the body of each station [mm].
        instruments: True dead paths, offsets and the like, by the names that they have in a solution.
        seed: Seed of the random numbers that the errors came from; None when they are not random.
        source: Where the truth comes from, for messages.

    Raises:
        InputError: a name that this machine does not have, or a table that does not cover the travel.

    Example:
        >>> from volid.io import read_machine
        >>> machine = read_machine("models/wYXbZt_vertical.toml")
        >>> truth = Truth(machine, functions={"EXX": lambda x: 1e-5 * x}, constants={"EC0Y": 2e-5})
        >>> position = machine.order(X=300.0, Y=100.0, Z=-200.0)  # the reference of Y is 300 mm
        >>> truth.deviation(position, (0.0, 0.0, -150.0))[0, :3].round(6)  # 1e-5 · 300 - 2e-5 · (100 - 300)
        array([0.007, 0.   , 0.   ])
    """

    machine: Machine
    functions: Mapping[str, Callable[[np.ndarray], Any]] = field(default_factory=dict)
    cross: Mapping[str, tuple[str, Callable[[np.ndarray, np.ndarray], Any]]] = field(default_factory=dict)
    reversal: Mapping[str, Callable[[np.ndarray], Any]] = field(default_factory=dict)
    constants: Mapping[str, float] = field(default_factory=dict)
    stations: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    instruments: Mapping[str, float] = field(default_factory=dict)
    seed: int | None = None
    source: str = ""

    def __post_init__(self) -> None:
        for name in {**self.functions, **self.cross, **self.reversal}:
            self._check_motion(name)
        for name in self.constants:
            self._check_constant(name)
        for name, (other, cross) in self.cross.items():
            self._check_range(name, parse(name).axis, getattr(cross, "positions", None))
            self._check_range(name, other, getattr(cross, "across", None))
        for tables in (self.functions, self.reversal):
            for name, function in tables.items():
                self._check_range(name, parse(name).axis, getattr(function, "positions", None))

    def errors(
        self, positions: Float[ArrayLike, "m axes"], directions: Float[ArrayLike, "m axes"] | None = None
    ) -> Float[np.ndarray, "errors m"]:
        """Error values in the order of the kinematic model, shape (6·(n_axes + 1), m) [mm, rad]. CONVENTIONS 3.

        Args:
            positions: Axis positions, machine axis order, shape (m, n_axes) [mm or degrees].
            directions: Directions of approach, shape (m, n_axes): +1, -1 or 0 (the mean of both); None: 0.
        """
        q = np.asarray(positions, dtype=float)
        way = np.zeros_like(q) if directions is None else np.broadcast_to(np.asarray(directions, dtype=float), q.shape)
        values = np.zeros((ROWS * (q.shape[1] + 1), len(q)))
        for name, function in self.functions.items():
            row, i = self._place(name)
            values[row] += function(q[:, i])
        for name, (other, cross) in self.cross.items():
            row, i = self._place(name)
            values[row] += cross(q[:, i], q[:, self.machine.index(other)])
        for name, function in self.reversal.items():
            row, i = self._place(name)
            values[row] += 0.5 * way[:, i] * function(q[:, i])
        for name, value in self.constants.items():
            self._add_constant(values, q, name, value)
        return values

    def deviation(
        self,
        positions: Float[ArrayLike, "*m axes"],
        tool: Float[ArrayLike, "*m 3"],
        directions: Float[ArrayLike, "*m axes"] | None = None,
    ) -> Float[np.ndarray, "m 6"]:
        """True deviation of the functional point and orientation, shape (m, 6) [mm, rad]. CONVENTIONS 5.

        Args:
            positions: Axis positions, machine axis order, shape (m, n_axes) or (n_axes,) [mm or degrees].
            tool: Tool vectors, shape (m, 3) or (3,) [mm].
            directions: Directions of approach, shape (m, n_axes): +1, -1 or 0 (the mean of both); None: 0.
        """
        q = np.atleast_2d(np.asarray(positions, dtype=float))
        tools = np.broadcast_to(np.asarray(tool, dtype=float), (len(q), 3)).T
        return np.asarray(deviation(self.machine, q.T, tuple(tools), self.errors(q, directions))).T  # type: ignore[arg-type]

    def tabulated(self) -> Truth:
        """The same truth with every function as a table over the travel of its axes, as files hold it."""

        def of(name: str, function: Any) -> Table:
            q = np.linspace(*self.machine.axis(parse(name).axis).travel, POINTS)
            return function if isinstance(function, Table) else Table(q, np.broadcast_to(function(q), q.shape))

        def across(name: str, other: str, function: Any) -> CrossTable:
            q = np.linspace(*self.machine.axis(parse(name).axis).travel, POINTS)
            p = np.linspace(*self.machine.axis(other).travel, POINTS_ACROSS)
            grid = np.meshgrid(q, p, indexing="ij")
            values = np.broadcast_to(function(*(g.ravel() for g in grid)), q.size * p.size).reshape(q.size, p.size)
            return CrossTable(q, p, values)

        return replace(
            self,
            functions={n: of(n, f) for n, f in self.functions.items()},
            reversal={n: of(n, f) for n, f in self.reversal.items()},
            cross={
                n: (other, f if isinstance(f, CrossTable) else across(n, other, f))
                for n, (other, f) in self.cross.items()
            },
        )

    def _place(self, name: str) -> tuple[int, int]:
        error = parse(name)
        i = self.machine.index(error.axis)
        return ROWS * i + error.component, i

    def _add_constant(self, values: np.ndarray, q: np.ndarray, name: str, value: float) -> None:
        """Tool frame and rotary axes: added as it is. Linear axes: direction + rotation × direction, from the reference."""
        error = parse(name)
        if error.axis == SPINDLE:
            values[ROWS * q.shape[1] + error.component] += value
            return
        row, i = self._place(name)
        axis = self.machine.axes[i]
        if not axis.is_linear:
            values[row] += value
            return
        slope = np.cross(np.eye(3)[ROTATIONS.index(error.direction)], np.eye(3)[LINEAR_AXES.index(axis.letter)])
        values[ROWS * i : ROWS * i + 3] += value * slope[:, None] * (q[:, i] - axis.reference)

    def _check_motion(self, name: str) -> None:
        error = parse(name)
        if error.location or error.axis not in self.machine.letters:
            raise InputError(self._unknown(name, "error motion", "E" + DIRECTIONS[0] + self.machine.letters[0]))

    def _check_constant(self, name: str) -> None:
        error = parse(name)
        linear = error.axis in LINEAR_AXES
        about_itself = linear and error.is_rotation and ROTATIONS.index(error.direction) == "XYZ".index(error.axis)
        here = error.axis == SPINDLE or error.axis in self.machine.letters
        if not error.location or not here or about_itself or (linear and not error.is_rotation):
            raise InputError(self._unknown(name, "squareness or location error", "EC0Y or EA0S"))

    def _unknown(self, name: str, what: str, example: str) -> str:
        where = f"{self.source}: " if self.source else ""
        axes = ", ".join(self.machine.letters)
        return f"{where}'{name}' is no {what} of machine '{self.machine.name}' with axes {axes}; expected such as {example}"

    def _check_range(self, name: str, letter: str, positions: np.ndarray | None) -> None:
        low, high = self.machine.axis(letter).travel
        slack = 1e-6 * (high - low)
        if positions is not None and (positions[0] > low + slack or positions[-1] < high - slack):
            where = f"{self.source}: " if self.source else ""
            raise InputError(
                f"{where}{name} is known for {letter} = {positions[0]:g} … {positions[-1]:g}, but axis {letter} of machine "
                f"'{self.machine.name}' travels {low:g} … {high:g}; use a truth that covers the travel"
            )


def truth_of_solution(solution: Solution) -> Truth:
    """The identified machine as a virtual one: mean functions, cross effects, reversal and constants of a solution.

    Combinations that are not determined are zero, as in the solution. Stations and dead paths are not stated.

    Example:
        >>> import volid
        >>> solution = volid.fit(volid.load_campaign("datasets/vertical_multilateration/campaign.toml"))
        >>> truth = truth_of_solution(solution)
        >>> abs(truth.constants["EC0Y"] - solution.location("EC0Y").value) < 1e-12
        True
    """
    if solution.datum != solution.machine.datum:
        solution = solution.in_datum(solution.machine.datum)
    functions: dict[str, Any] = {}
    cross: dict[str, Any] = {}
    reversal: dict[str, Any] = {}
    constants: dict[str, float] = {}
    for function, term in zip(solution.model.functions, solution.model.layout.terms, strict=True):
        block = solution.model.parametrisation[function.coefficients, function.parameters]
        c = block @ np.asarray(solution.parameters)[function.parameters]
        axes = solution.machine.axes
        tables = [_nodes(spline, axes[spline.axis].travel) for spline in term.basis.factors]
        values = [design_matrix(s, t) for s, t in zip(term.basis.factors, tables, strict=True)]
        degree = 1 if all(spline.degree == 1 for spline in term.basis.factors) else 3
        if function.part == "location":
            constants[function.name] = float(c[0])
        elif len(tables) == 2:
            shape = tuple(v.shape[1] for v in values)
            table = CrossTable(tables[0], tables[1], values[0] @ c.reshape(shape) @ values[1].T, degree)
            cross[function.name] = (solution.machine.letters[term.basis.factors[1].axis], table)
        elif function.part == "reversal":
            travel = np.array(solution.machine.axis(parse(function.name).axis).travel)
            reversal[function.name] = Table(tables[0], values[0] @ c, degree) if tables else Table(travel, c[[0, 0]], 1)
        else:
            functions[function.name] = Table(tables[0], values[0] @ c, degree)
    return Truth(solution.machine, functions, cross, reversal, constants)


def _nodes(spline: Spline, travel: tuple[float, float]) -> np.ndarray:
    """Positions of a table that reproduces a spline of degree 1 or 3 exactly: its knots, and some between them.

    Of a periodic spline, all knots over the travel, which may be several periods.
    """
    between = 1 if spline.degree == 1 else max(3, -(-(POINTS - 1) // spline.segments))
    if not spline.periodic:
        return np.linspace(spline.low, spline.high, spline.segments * between + 1)
    step = (spline.high - spline.low) / spline.segments
    first, last = np.floor((travel[0] - spline.low) / step), np.ceil((travel[1] - spline.low) / step)
    return np.linspace(spline.low + first * step, spline.low + last * step, int(last - first) * between + 1)
