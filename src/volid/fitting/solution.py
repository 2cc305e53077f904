"""The solution of an identification: error model with numbers, covariance, and what the data say about it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import volid  # the public names, each imported when it is first used: nothing above this layer is imported here
from volid.backend.lazy import jnp
from volid.backend.pytrees import STATIC, register_dataclass, register_if_imported
from volid.campaign import Campaign
from volid.fitting import short_waves, tabulation
from volid.fitting.change_of_datum import held_constants, in_datum, mapped
from volid.fitting.diagnosis.adequacy import Adequacy
from volid.fitting.diagnosis.identifiability import parameter_units, undetermined_directions
from volid.fitting.diagnosis.levels import SeenLength, levels_of, seen_lengths, unseen, unseen_phases
from volid.fitting.extrapolation import extrapolated
from volid.fitting.mixed.components import stated_u
from volid.fitting.mixed.records import VarianceComponent
from volid.fitting.prediction.determination import known_deviations
from volid.fitting.prediction.deviations import determined
from volid.fitting.results import Deviations, FunctionValue, Residuals, SmoothPrior, Statistics
from volid.model.error_functions import reference_of
from volid.model.error_model import ErrorModel
from volid.model.error_values import error_values, evaluate_bases
from volid.model.iso230 import parse
from volid.model.kinematics import chain_of, deviation
from volid.model.linear_maps import function_rows
from volid.model.machine import Datum, Machine
from volid.model.requests import ask_positions, ask_tools, checked_columns
from volid.observations.base import Nuisance
from volid.observations.used_tool import most_used_tool

if TYPE_CHECKING:
    from jaxtyping import Bool, Float
    from numpy.typing import ArrayLike


EARLIER_RANGES = "earlier_ranges"  # option of a solution: what its earlier solution had measured, by axis letter
EARLIER_LEVELS = "earlier_levels"  # the same: at which distance and how many positions


@register_dataclass
@dataclass(frozen=True, eq=False)
class Solution:
    """What `fit` finds: the error model with numbers, their covariance, and what the data say about them.

    A solution is a JAX pytree whose leaves are the first five fields, NumPy arrays that cannot be written to.
    `volid.backend.pytrees` says from when on JAX knows it as such.

    Args:
        parameters: The parameters θ of the error functions, shape (n,), in the order of `model` [mm, rad].
        nuisance: The other unknowns ν, shape (k,): stations, dead paths and other unknowns, as `nuisance_table` names them.
        covariance: Covariance of (θ, ν), shape (n + k, n + k), from the stated uncertainties, times `factor`²; zero along what is
            not determined.
        null_space: Combinations of θ that are not determined, as columns, shape (n, d).
        held_directions: Directions of the s tool-frame constants that are not determined and held at 0, as columns, shape (s, r).
        model: The error model, with its datum.
        campaign: The readings that were fitted, with their machine.
        nuisance_table: Name, unit and prior knowledge of every entry of `nuisance`.
        adequacy: Whether the residuals agree with the stated uncertainties.
        statistics: Numbers about the fit.
        readings: Residuals of every reading, and outliers.
        statements: What is not determined, in words.
        undetermined: For each function, the number of directions in which it is not determined.
        notes: What else a user should know.
        options: What was asked of the fit.
        provenance: Date, versions, command and inputs, by name.
        prior_root: Pseudo-readings of an earlier solution as rows on θ, shape (r, n); None without one.
        smooth: What was assumed of the smoothness of the functions; None where all segments are stated.
        samples: Samples of the parameters from Monte Carlo refits; None before `monte_carlo`.
        variance_components: By which factors the stated u were changed because the fit estimated them; () where it did not. The
            u of `campaign` hold these factors; `stated_u` gives back the u that were stated.

    Source: CONVENTIONS 3 to 5; ISO 230-1 for the symbols.

    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/published_positioning/campaign.toml"))
    >>> solution.deviation([100.0, 0.0, 0.0], [0.0, 0.0, 0.0]).shape
    (6,)
    >>> found = solution.evaluate([[100.0, 0.0, 0.0]], [0.0, 0.0, 0.0])
    >>> round(1e3 * float(found.values[0, 0]), 1), round(1e3 * float(found.u[0, 0]), 1)  # EXX at X = 100 mm, and its u [µm]
    (8.4, 0.4)
    >>> [(row.direction, round(1e3 * row.value, 1)) for row in solution.motion("EXX", np.array([100.0]))]
    [(1, 8.5), (-1, 8.3)]
    >>> solution.outside(np.array([[100.0, 100.0, 0.0], [100.0, 0.0, 0.0]])).tolist()  # Y was measured at 100 mm alone
    [False, True]
    """

    parameters: Float[Any, " n"]  # Any: a tracer or a placeholder while JAX transforms the tree
    nuisance: Float[Any, " k"]
    covariance: Float[Any, "n+k n+k"]
    null_space: Float[Any, "n d"]
    held_directions: Float[Any, "s r"]
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
    prior_root: Float[Any, "r n"] | None = None
    smooth: SmoothPrior | None = field(metadata=STATIC, default=None)
    samples: Any = field(metadata=STATIC, default=None)
    variance_components: tuple[VarianceComponent, ...] = field(metadata=STATIC, default=())

    def __post_init__(self) -> None:
        register_if_imported()

    @property
    def machine(self) -> Machine:
        """The machine that was measured, every travel cut to the measured range: what all outputs refer to.

        `campaign.machine` has the travels of the machine file.
        """
        return self.model.machine

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
        return held_constants(self.model, np.asarray(self.held_directions))

    @property
    def prior_rows(self) -> Float[np.ndarray, "r n"]:
        """All pseudo-readings as rows on θ: `prior_root` and those of the smoothness."""
        earlier = np.zeros((0, self.model.n_parameters)) if self.prior_root is None else np.asarray(self.prior_root)
        return np.vstack([earlier, self.smooth_rows])

    @property
    def smooth_rows(self) -> Float[np.ndarray, "r n"]:
        """Pseudo-readings of the smoothness as rows on θ."""
        return np.zeros((0, self.model.n_parameters)) if self.smooth is None else self.smooth.root

    @property
    def smooth_spread(self) -> Float[np.ndarray, "n+k h"]:
        """What the uncertainty of the estimated smoothness brings to the unknowns: its square is in `covariance`/`factor`²."""
        return np.zeros((len(self.covariance), 0)) if self.smooth is None else self.smooth.spread

    @property
    def smooth_functions(self) -> frozenset[str]:
        """The error motions whose smoothness was estimated."""
        return frozenset() if self.smooth is None else self.smooth.functions

    @property
    def stated_u(self) -> tuple[Float[np.ndarray, "m k"], ...]:
        """u of every reading as it was stated, one array (m, k) per set: those of `campaign` without estimated factors."""
        return stated_u(self.campaign, self.variance_components)

    @property
    def factor(self) -> float:
        """What every u is multiplied by because the residuals are larger than u says; it is part of `covariance`."""
        return self.adequacy.factor

    @property
    def bare_covariance(self) -> Float[np.ndarray, "n+k n+k"]:
        """Covariance of (θ, ν) from the readings' u and the smoothness as it was estimated alone: the inverse of JᵀJ."""
        return np.asarray(self.covariance) / self.factor**2 - self.smooth_spread @ self.smooth_spread.T

    @property
    def scatter(self) -> Mapping[str, float]:
        """Standard deviation of what is independent from position to position [mm]; `factor` times it is part of every u.

        By direction ("X"), since nothing tells which axis it comes from, or, of waves left out of the values, by error motion.
        """
        return {} if self.smooth is None else self.smooth.scatter

    def scatter_u(self, model: ErrorModel | None = None) -> Float[np.ndarray, " 6"]:
        """Standard deviation of what is independent from position to position, by component of a deviation [mm, rad].

        Args:
            model: The model with the errors of some axes alone; None: the solution's.
        """
        return short_waves.scatter_u(self, self.model if model is None else model)

    def scatter_of(self, name: str) -> float:
        """The same for one error motion: it may all be of that one [mm]."""
        own = [size for key, size in self.scatter.items() if short_waves.carries(name, key)]
        return self.factor * float(np.linalg.norm(own))

    def without_waves(self) -> Solution:
        """The solution whose short waves of a stated pitch are no part of the values, but of every u: for tables and grids.

        Nodes farther apart than the waves would take them at some phase or other.
        """
        return short_waves.without_waves(self)

    @property
    def seen_lengths(self) -> tuple[SeenLength, ...]:
        """How closely the positions of every axis follow one another, against the length of its functions."""
        if self.smooth is None:
            return ()
        return tuple(seen_lengths(self.levels(), self.model, self.smooth.names, self.smooth.values.tolist()))

    def levels(self) -> dict[str, tuple[float, int]]:
        """By axis letter, largest distance of neighbouring positions [mm or degrees] and their number, a prior's too."""
        return levels_of(self.campaign, self.machine, self.options.get(EARLIER_LEVELS, {}))

    @property
    def unseen(self) -> tuple[str, ...]:
        """Axes whose positions stand too far apart to tell what some function does between them, in words."""
        return (*unseen(self.seen_lengths), *unseen_phases(self.campaign, self.machine))

    @property
    def parameter_covariance(self) -> Float[np.ndarray, "n n"]:
        """Covariance of θ alone."""
        n = self.model.n_parameters
        return np.asarray(self.covariance)[:n, :n]

    def deviation(
        self, q: Float[Any, "... axes"], tool: Float[Any, "... 3"], direction: Float[Any, ...] | float = 0.0
    ) -> Float[Any, "... 6"]:
        """Deviation of the functional point and orientation, shape (..., 6) [mm, rad], machine frame, as a JAX array.

        Args:
            q: Axis positions, shape (..., n_axes), machine axis order (`machine.letters`) [mm or degrees].
            tool: Tool vectors, shape (..., 3) or (3,) [mm].
            direction: Direction of approach, +1, -1 or 0 (mean of both).

        Pure JAX: it can be differentiated, compiled (`jit`) and mapped (`vmap`). Values along combinations that are not
        determined are those with the combination at 0; `evaluate` says which these are.
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

    def evaluate(
        self,
        positions: Float[ArrayLike, "m axes"],
        tool: Float[ArrayLike, "*m 3"],
        direction: Float[ArrayLike, "m axes"] | None = None,
    ) -> Deviations:
        """Deviations with standard uncertainties, machine frame, as NumPy arrays; NaN where they are not determined.

        They are not determined outside the measured range of an axis whose errors are modelled: `extrapolated` goes on there.

        Args:
            positions: Axis positions, shape (m, n_axes), machine axis order [mm or degrees].
            tool: Tool vectors, shape (m, 3) or (3,) [mm].
            direction: Directions of approach, shape (m, n_axes), +1, -1 or 0; None: the mean of both.

        Returns:
            `values` and `u`, shape (m, 6) [mm, rad]; `outside`, shape (m,), where nothing was measured; see `Deviations`.

        Raises:
            InputError: numbers that are not finite, or that look like another unit, as `ask` describes it.
        """
        positions = np.atleast_2d(np.asarray(positions, dtype=float))
        self.ask(tool, positions)
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
        inside = self.model.holds(positions)[:, None]
        values, u = np.where(inside, values, np.nan), np.where(inside, np.hypot(u, self.scatter_u()), np.nan)
        return Deviations(values, u, found.known & inside, self.outside(positions), found.rigid)

    def ask(
        self, tool: Float[ArrayLike, "*k 3"], positions: Float[ArrayLike, "m axes"] | None = None, name: str = "tool"
    ) -> None:
        """Raises `InputError` for tool vectors and positions that look like another unit than mm; see `volid.accept_unusual`.

        Tool vectors that the campaign used are not asked about.

        Args:
            tool: Tool vectors, shape (..., 3) [mm].
            positions: Axis positions, shape (m, n_axes), machine axis order [mm or degrees]; None: there are none.
            name: Name of the parameter that the tool vectors come from.
        """
        ask_tools(self.campaign.machine, tool, self.campaign.tool_vectors, name)
        if positions is not None:
            columns = checked_columns(self.machine, positions)
            ask_positions(self.campaign.machine, dict(zip(self.machine.letters, columns, strict=True)))

    def measured_range(self) -> Float[np.ndarray, "axes 2"]:
        """Lowest and highest measured position of every axis, those of an earlier solution included [mm or degrees]."""
        found = self.campaign.measured_range()
        for letter, (low, high) in self.options.get(EARLIER_RANGES, {}).items():
            if letter in self.machine.letters:
                own = found[self.machine.index(letter)]
                own[:] = min(own[0], low), max(own[1], high)
        return found

    def most_used_tool(self) -> tuple[float, float, float]:
        """The tool vector of most rows that see the tool [mm]; of equally frequent ones the first."""
        return most_used_tool(self.campaign)

    def outside(
        self, positions: Float[np.ndarray, "m axes"], axes: Sequence[str] | None = None
    ) -> Bool[np.ndarray, " m"]:
        """True for positions outside what was measured, by more than 1 % of the travel, shape (m,).

        Args:
            positions: Axis positions, machine axis order, shape (m, n_axes) [mm or degrees].
            axes: Letters of the axes that are judged; None: all. A rotary axis measured over a full turn is measured everywhere.
        """
        low, high = self.measured_range().T
        slack = 0.01 * np.array([axis.length for axis in self.machine.axes])
        round_about = np.array([a.is_full_turn for a in self.machine.axes]) & (high - low >= 360.0 - slack)
        out = ((positions < low - slack) | (positions > high + slack)) & ~round_about
        columns = [self.machine.index(a) for a in (self.machine.letters if axes is None else axes)]
        return np.asarray(np.any(out[:, columns], axis=1))

    def functions(self, step: float | None = None, points: int = 21) -> list[FunctionValue]:
        """All error functions tabulated over the travels, and location errors, each with its standard uncertainty.

        Args:
            step: Spacing [mm or degrees]; None: `points` per travel.
            points: Number of points per travel. A function that is a polygon (degree 1) is tabulated at its knots instead.

        Functions with reversal are given for both approach directions, others for 0; functions of two axes along the line at
        the other axis's reference.
        """
        return tabulation.functions(self, step, points)

    def location(self, name: str) -> FunctionValue:
        """A constant (squareness, location error, tool-frame rotation) with its standard uncertainty.

        Args:
            name: ISO 230-1 symbol of a constant in the model, such as "EC0Y" (KeyError for another one).

        Returns:
            A row with `value` and `u` [mm or rad]; NaN when the data do not determine it.
        """
        return tabulation.location(self, name)

    def motion_rows(self, name: str, positions: Float[np.ndarray, " m"], direction: int) -> Float[np.ndarray, "m n"]:
        """Rows a with E(position, direction) = a·θ, shape (m, n) [mm or rad per parameter].

        Args:
            name: ISO 230-1 symbol of an error motion in the model, such as "EXX".
            positions: Positions of its axis, shape (m,) [mm or degrees]; the second axis of a cross effect stands at its
                reference.
            direction: Direction of approach, +1, -1 or 0 (mean of both).
        """
        references = [[reference_of(self.machine, self.datum, a.letter)] for a in self.machine.axes]
        q = np.tile(references, len(positions))
        q[self.machine.index(parse(name).axis)] = positions
        return function_rows(self.model, name, q, np.full_like(q, direction))

    def motion(self, name: str, positions: Float[np.ndarray, " m"]) -> list[FunctionValue]:
        """An error motion tabulated over its axis: one row per position, for each approach direction if it has reversal.

        Args:
            name: ISO 230-1 symbol of an error motion in the model, such as "EXX".
            positions: Positions of its axis, shape (m,) [mm or degrees]; the second axis of a cross effect stands at its
                reference.
        """
        return tabulation.motion(self, name, positions)

    def is_not_determined(self, rows: Float[np.ndarray, "m n"]) -> Bool[np.ndarray, " m"]:
        """Which linear functions of θ change along a combination that is not determined, shape (m,).

        Args:
            rows: The functions as rows on θ, shape (m, n).
        """
        units = parameter_units(self.model)
        if not self.null_space.shape[1]:
            return np.zeros(len(rows), dtype=bool)
        null = undetermined_directions(self.null_space, units)
        along = np.linalg.norm((rows * units) @ null, axis=1)
        return ~determined(along, np.maximum(np.linalg.norm(rows * units, axis=1), 1e-12))

    def save(self, path: str | Path, overwrite: bool = False) -> None:
        """Write the solution, its campaign and machine included, to one HDF5 file: `volid.save_solution`."""
        volid.save_solution(self, path, overwrite)

    def monte_carlo(self, trials: int | None = None, **keywords: Any) -> Solution:
        """The solution with `samples` of its parameters from Monte Carlo refits; keywords of `volid.monte_carlo`."""
        return volid.monte_carlo(self, trials, **keywords)

    def grid(self, **keywords: Any) -> volid.Grid:
        """The spatial grid of the linear axes; keywords (`step` or `points`, `tool`, …) of `volid.linear_grid`."""
        return volid.linear_grid(self, **keywords)

    def in_datum(self, datum: Datum) -> Solution:
        """The same solution in another datum, by an S-transformation of all unknowns, never by a new fit.

        Every unknown answers as its kind of observation declares, so that no predicted reading changes. Source: CONVENTIONS 4.

        Args:
            datum: The new datum, such as `volid.parse_datum` makes it.

        Raises:
            InputError: the model cannot be expressed in that datum, or predicted readings would have to change (for example those
                of a straightedge whose slope is stated to be known). The text gives the reason and what to do.
        """
        return in_datum(self, datum)

    def mapped(
        self,
        model: ErrorModel,
        mapping: Float[np.ndarray, "m n"],
        answer: Float[np.ndarray, "k n"] | None = None,
        inverse: Float[np.ndarray, "n m"] | None = None,
    ) -> Solution:
        """The solution with θ' = M θ and ν' = ν + A θ; covariance, null space and samples follow.

        Args:
            model: The error model that θ' belongs to.
            mapping: M, shape (m, n).
            answer: A, shape (k, n), change of the other unknowns; None: they stay.
            inverse: θ = `inverse` · θ', shape (n, m), for the pseudo-readings of an earlier solution and of the smoothness; None:
                the solution is left without them.
        """
        return mapped(self, model, mapping, answer, inverse)

    def extrapolated(self, ranges: Mapping[str, tuple[float, float]] | None = None) -> Solution:
        """The solution with functions that go on beyond the measured range, as smooth as they are, with the u that this leaves.

        Datum, values and u within the measured range stay as they are; `outside` still tells what was not measured. Monte Carlo,
        budgets and files are for the solution as it was fitted.

        Args:
            ranges: Lowest and highest position by axis letter [mm or degrees]; None: the travels of the machine.

        Raises:
            InputError: the machine does not have the axis, or a range does not rise.

        >>> import volid
        >>> solution = volid.fit(volid.load_campaign("datasets/vertical_multilateration/campaign.toml"))
        >>> further = solution.extrapolated({"X": (0.0, 1100.0)})
        >>> here, there = further.evaluate([[300.0, 1000.0, -250.0], [300.0, 1080.0, -250.0]], [0.0, 0.0, -150.0]).u[:, 0]
        >>> bool(there > 2 * here)
        True
        """
        return extrapolated(self, ranges)

    def summary_functions(self) -> list[tuple[str, str, float, float]]:
        """For every function: symbol, words, range over the travel and largest u [mm or rad]; NaN if not determined."""
        return tabulation.summary_functions(self)
