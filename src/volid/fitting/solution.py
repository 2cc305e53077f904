"""The solution of an identification: error model with numbers, covariance, and what the data say about it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from volid.backend.lazy import jnp
from volid.backend.pytrees import STATIC, register_dataclass
from volid.campaign import Campaign
from volid.fitting.datum import s_transformation
from volid.fitting.diagnosis.adequacy import Adequacy, SuspectReading
from volid.fitting.diagnosis.identifiability import NAMED, parameter_units
from volid.fitting.frames import check_exact, frames, unknown_rows
from volid.fitting.prediction.determination import known_deviations
from volid.fitting.prediction.deviations import ESTIMABLE, chain_of
from volid.fitting.prediction.spread import linear_uncertainty
from volid.model.error_functions import reference_of
from volid.model.error_model import ErrorModel, build_model, error_values, evaluate_bases
from volid.model.iso230 import describe, parse
from volid.model.kinematics import deviation
from volid.model.machine import Datum, Machine
from volid.model.splines import design_matrix
from volid.observations.base import Nuisance


class Deviations(NamedTuple):
    """Deviations at m points: `values` and `u`, (m, 6) [mm, rad], NaN where not determined; `determined` (m, 6);
    `outside`: (m,) True where a position lies outside what was measured;
    `rigid`: (m,) True where the value is known up to a rigid motion of the workpiece frame only (see `determination`)."""

    values: np.ndarray
    u: np.ndarray
    determined: np.ndarray
    outside: np.ndarray
    rigid: np.ndarray | None = None


class FunctionValue(NamedTuple):
    """One row of the table of error functions: location errors have position NaN; undetermined values are NaN."""

    name: str
    axis: str
    position: float
    direction: int
    value: float
    u: float


class Statistics(NamedTuple):
    """Numbers about the fit: readings used, parameters, residual RMS per set [reading's unit], iterations.

    `held_out_weight`: RMS of readings predicted without them over what is expected of it, in the search for the resolution; NaN
    where all resolutions are stated.
    """

    n_readings: int
    n_parameters: int
    residual_rms: Mapping[str, float]
    iterations: int
    converged: bool
    held_out_weight: float = float("nan")


@dataclass(frozen=True, eq=False)
class Residuals:
    """What the fit left of every reading, arrays (m, k) per set.

    `residuals`: reading - predicted. `normalised`: residual / (u sqrt(1 - h)). `outliers`: set aside by the robust fit, named
    in `outlier_readings`. `held_out`: reading - prediction by the fit to all other rotary positions, NaN where one of them
    alone carries something; empty without rotary axes.
    """

    residuals: tuple[np.ndarray, ...]
    normalised: tuple[np.ndarray, ...]
    outliers: tuple[np.ndarray, ...]
    outlier_readings: tuple[SuspectReading, ...] = ()
    held_out: tuple[np.ndarray, ...] = ()


def read_only(values: Any) -> np.ndarray:
    """As NumPy array that cannot be written to."""
    kept = np.array(values, dtype=float)
    kept.setflags(write=False)
    return kept


@register_dataclass
@dataclass(frozen=True, eq=False)
class Solution:
    """Result of `fit`: a JAX pytree whose leaves are parameters and covariance, NumPy arrays that cannot be written to.

    `parameters`: θ, shape (n,), error functions in `model`'s order. `nuisance`: ν, shape (k,): stations, dead paths.
    `covariance`: of (θ, ν), shape (n + k, n + k), from the stated uncertainties; zero along what is not determined.
    `null_space`: shape (n, d), undetermined combinations of θ. `readings`: residuals and outliers. `statements`: what is not
    determined, in words; `undetermined`: number of undetermined directions in each function; `held_directions`:
    shape (s, r), directions of the tool-frame constants that the data leave open, held at 0; `notes`: what else a user
    should know.
    """

    parameters: Any
    nuisance: Any
    covariance: Any
    null_space: Any
    held_directions: Any
    model: ErrorModel = field(metadata=STATIC)
    campaign: Campaign = field(metadata=STATIC)
    nuisance_table: tuple[Nuisance, ...] = field(metadata=STATIC)
    adequacy: Adequacy = field(metadata=STATIC)
    statistics: Statistics = field(metadata=STATIC)
    readings: Residuals = field(metadata=STATIC)
    statements: tuple[str, ...] = field(metadata=STATIC, default=())
    undetermined: Mapping[str, float] = field(metadata=STATIC, default_factory=dict)
    notes: tuple[str, ...] = field(metadata=STATIC, default=())
    options: Mapping[str, Any] = field(metadata=STATIC, default_factory=dict)
    provenance: Mapping[str, str] = field(metadata=STATIC, default_factory=dict)
    prior_root: Any = None
    samples: Any = field(metadata=STATIC, default=None)

    @property
    def machine(self) -> Machine:
        """The machine that was measured."""
        return self.campaign.machine

    @property
    def datum(self) -> Datum:
        """The datum that parameters, covariance and all outputs refer to."""
        return self.model.datum

    @property
    def fully_determined(self) -> bool:
        """True when the data determine every function of the model."""
        return self.null_space.shape[1] == 0

    @property
    def held_tool_rotation(self) -> tuple[str, ...]:
        """Tool-frame rotations that cannot be stated because a direction they share is held at 0."""
        names = [f.name for f in self.model.functions if f.name.endswith("0S")]
        return tuple(
            n for n, row in zip(names, np.asarray(self.held_directions), strict=False) if np.any(row**2 > NAMED)
        )

    @property
    def prior_rows(self) -> np.ndarray:
        """`prior_root`, shape (r, n), with no rows when no earlier solution was used."""
        return np.zeros((0, self.model.n_parameters)) if self.prior_root is None else np.asarray(self.prior_root)

    @property
    def parameter_covariance(self) -> np.ndarray:
        """Covariance of θ alone, shape (n, n)."""
        n = self.model.n_parameters
        return np.asarray(self.covariance)[:n, :n]

    def deviation(self, q: Any, tool: Any, direction: Any = 0.0) -> Any:
        """Deviation of the functional point and orientation, shape (..., 6) [mm, rad], machine frame.

        `q`: (..., n_axes), machine axis order (`machine.letters`). `tool`: (..., 3) or (3,) [mm]. `direction`: approach,
        +1, -1 or 0 (mean). Pure JAX: differentiate, `vmap` and `jit` it as you like.
        """
        q = jnp.asarray(q, dtype=float)
        shape = q.shape[:-1]
        flat = q.reshape(-1, q.shape[-1]).T
        tools = jnp.broadcast_to(jnp.asarray(tool, dtype=float), (*shape, 3)).reshape(-1, 3).T
        way = jnp.broadcast_to(jnp.asarray(direction, dtype=float), q.shape).reshape(-1, q.shape[-1]).T
        coefficients = jnp.asarray(self.model.parametrisation) @ self.parameters
        errors = error_values(self.model.layout, coefficients, evaluate_bases(self.model.layout, flat, way))
        values = deviation(chain_of(self.machine), flat, tuple(tools), errors)  # type: ignore[arg-type]
        return values.T.reshape(*shape, 6)

    def evaluate(self, positions: np.ndarray, tool: np.ndarray, direction: np.ndarray | None = None) -> Deviations:
        """Deviations with standard uncertainties at (m, n_axes) positions and (m, 3) or (3,) tool vectors, NumPy."""
        positions = np.atleast_2d(np.asarray(positions, dtype=float))
        tool = np.broadcast_to(np.asarray(tool, dtype=float), (len(positions), 3))
        direction = np.zeros_like(positions) if direction is None else np.asarray(direction, dtype=float)
        values, u, found = known_deviations(
            self.model,
            np.asarray(self.parameters),
            self.parameter_covariance,
            np.asarray(self.null_space),
            positions,
            tool,
            direction,
        )
        return Deviations(values, u, found.known, self.outside(positions), found.rigid)

    def measured_range(self) -> np.ndarray:
        """Lowest and highest measured position of every axis, shape (n_axes, 2)."""
        positions = np.concatenate([s.positions for s in self.campaign.sets])
        return np.stack([positions.min(axis=0), positions.max(axis=0)], axis=1)

    def outside(self, positions: np.ndarray, axes: Sequence[str] | None = None) -> np.ndarray:
        """True for positions (m, n_axes) outside what was measured, by more than 1 % of the travel, bool (m,).

        `axes`: letters that are judged, default all. A rotary axis measured over a whole turn is measured everywhere.
        """
        low, high = self.measured_range().T
        slack = 0.01 * np.array([axis.length for axis in self.machine.axes])
        round_about = np.array([a.is_full_turn for a in self.machine.axes]) & (high - low >= 360.0 - slack)
        out = ((positions < low - slack) | (positions > high + slack)) & ~round_about
        own = [self.machine.index(a) for a in (self.machine.letters if axes is None else axes)]
        return np.asarray(np.any(out[:, own], axis=1))

    def functions(self, step: float | None = None, points: int = 21) -> list[FunctionValue]:
        """All error functions tabulated, and location errors, each with standard uncertainty.

        `step`: spacing in mm or degrees, else `points` per travel. Functions with reversal are given for both approach
        directions, others for 0; cross effects along the line at the other axis's reference.
        """
        rows = []
        for name in self.model.names:
            if (name, "location") in self.model.by_name:
                rows.append(self.location(name))
            else:
                rows += self.motion(name, self._positions(name, step, points))
        return rows

    def _positions(self, name: str, step: float | None, points: int) -> np.ndarray:
        """Where a function is tabulated: `step`, else the knots of a polygon (degree 1), else `points` per travel."""
        axis = self.machine.axis(parse(name).axis)
        spline = self.model.by_name[name, "mean"].splines[0]
        if step is None:
            return np.linspace(*axis.travel, spline.segments + 1 if spline.degree == 1 else points)
        grid = np.arange(axis.travel[0], axis.travel[1] + 1e-9 * axis.length, step)
        return np.append(grid, axis.travel[1]) if axis.travel[1] - grid[-1] > 1e-6 * step else grid

    def location(self, name: str) -> FunctionValue:
        """A constant (squareness, location error, tool-frame rotation) with its standard uncertainty."""
        i = self.model.by_name[name, "location"].parameters.start
        held = name in self.held_tool_rotation
        lost = bool(self.is_lost(np.eye(self.model.n_parameters)[i : i + 1])[0]) or held
        value, u = float(np.asarray(self.parameters)[i]), float(np.sqrt(np.asarray(self.covariance)[i, i]))
        value, u = (np.nan, np.nan) if lost else (value, u)
        return FunctionValue(name, parse(name).axis, np.nan, 0, value, u)

    def motion_rows(self, name: str, positions: np.ndarray, direction: int) -> np.ndarray:
        """Rows a with E(position, direction) = a·θ, shape (m, n)."""
        rows = np.zeros((len(positions), self.model.n_parameters))
        for f in self.model.functions:
            if f.name != name or (f.part == "reversal" and direction == 0):
                continue
            terms = next(t for t in self.model.layout.terms if t.name == name and t.part == f.part)
            values = np.ones((len(positions), 1))
            for spline in terms.basis.factors:
                letter = self.machine.letters[spline.axis]
                own = letter == parse(name).axis
                x = positions if own else np.full(len(positions), reference_of(self.machine, self.datum, letter))
                values = (values[:, :, None] * design_matrix(spline, x)[:, None, :]).reshape(len(positions), -1)
            factor = 0.5 * direction if f.part == "reversal" else 1.0
            rows[:, f.parameters] = factor * values @ self.model.parametrisation[f.coefficients, f.parameters]
        return rows

    def motion(self, name: str, positions: np.ndarray) -> list[FunctionValue]:
        """An error motion tabulated at positions of its own axis."""
        axis = parse(name).axis
        result = []
        for direction in (1, -1) if (name, "reversal") in self.model.by_name else (0,):
            rows = self.motion_rows(name, positions, direction)
            values = rows @ np.asarray(self.parameters)
            u = linear_uncertainty(rows, self.parameter_covariance)
            lost = self.is_lost(rows)
            for x, v, s, gone in zip(positions, values, u, lost, strict=True):
                v, s = (np.nan, np.nan) if gone else (float(v), float(s))
                result.append(FunctionValue(name, axis, float(x), direction, v, s))
        return result

    def is_lost(self, rows: np.ndarray) -> np.ndarray:
        """Which functionals `rows` · θ, shape (m, n), change along an undetermined combination; bool (m,)."""
        units = parameter_units(self.model)
        if not self.null_space.shape[1]:
            return np.zeros(len(rows), dtype=bool)
        null, _ = np.linalg.qr(np.asarray(self.null_space) / units[:, None])
        along = np.linalg.norm((rows * units) @ null, axis=1)
        return np.asarray(along > ESTIMABLE * np.maximum(np.linalg.norm(rows * units, axis=1), 1e-12))

    def in_datum(self, datum: Datum) -> Solution:
        """The same solution in another datum: an S-transformation of parameters, unknowns, covariance and samples.

        Every unknown answers as its kind of observation declares, so that no predicted reading changes. Raises `InputError` when
        the model cannot be expressed in that datum, or when readings could not stay as they are (a straightedge whose slope is
        said to be known), with the reason and what to do.
        """
        machine = self.machine
        model = build_model(machine, self.model.segments, carrier=self.model.carrier, datum=datum)
        s, motion = s_transformation(self.model, model, self._hold_tool_rotation(model))
        n, k = self.model.n_parameters, len(self.nuisance_table)
        moved_frames = frames(self.model, model, s, motion)
        check_exact(machine, self.nuisance_table, moved_frames, np.asarray(self.parameters), self.parameter_covariance)
        full = np.zeros((model.n_parameters + k, n + k))
        full[: model.n_parameters, :n] = s
        full[model.n_parameters :, n:] = np.eye(k)
        full[model.n_parameters :, :n] = -unknown_rows(
            machine, self.nuisance_table, np.asarray(self.nuisance), moved_frames
        )
        start = np.concatenate([np.zeros(n), np.asarray(self.nuisance)])
        moved = full @ np.concatenate([np.asarray(self.parameters), np.zeros(k)]) + np.pad(
            start[n:], (model.n_parameters, 0)
        )
        return replace(
            self,
            parameters=read_only(moved[: model.n_parameters]),
            nuisance=read_only(moved[model.n_parameters :]),
            covariance=read_only(full @ np.asarray(self.covariance) @ full.T),
            null_space=read_only(s @ np.asarray(self.null_space)),
            model=model,
            samples=None if self.samples is None else self.samples.mapped(full),
            prior_root=None if self.prior_root is None else read_only(self.prior_rows @ np.linalg.pinv(s)),
        )

    def _hold_tool_rotation(self, model: ErrorModel) -> np.ndarray:
        """Projector that keeps undetermined directions of the constant tool rotation at 0 in the new datum too."""
        places = [f.parameters.start for f in model.functions if f.name.endswith("0S")]
        units = parameter_units(model)[places]
        projector = np.eye(model.n_parameters)
        held = np.asarray(self.held_directions @ self.held_directions.T) * units[:, None] / units
        projector[np.ix_(places, places)] -= held
        return projector

    def summary_functions(self) -> list[tuple[str, str, float, float]]:
        """For every function: symbol, words, range over the travel and largest u [mm or rad]; NaN if undetermined."""
        result = []
        for name in self.model.names:
            values = [r for r in self.functions() if r.name == name]
            numbers = np.array([v.value for v in values])
            spread = float(np.ptp(numbers)) if len(values) > 1 else float(numbers[0])
            result.append((name, describe(name), spread, float(max(v.u for v in values))))
        return result
