"""What an engine does: the numbers of a least-squares problem, computed by compiled programs or by NumPy.

One physics, two engines: `compiled.Compiled` (JAX) and `interpreted.Interpreted` (NumPy with recorded derivatives) share the
kinematic chain, the observation kinds and the bases, and agree to rounding. `choice` says which one serves a piece of work.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np

from volid.effects.prediction import Form
from volid.fitting.equations.system import Normal, System
from volid.model.error_model import Layout
from volid.model.machine import Machine

PointFunction = Callable[..., Any]
"""(machine, layout, coefficients, points, *extra) -> an array with points last; at module level, of any arrays."""

Calls = tuple[list[slice], Callable[[slice], np.ndarray]]
"""Slices of many points, and what carries a function out on one of them; calls may run in several threads."""


class Equations(Protocol):
    """The least-squares equations of one system, as an engine holds them: min |r(z)|²/2, whitened, priors included.

    What depends on positions alone (basis values, the order of the readings, arrays on a device) is made once and kept here.
    `z` (size,): unknowns. Results are NumPy arrays; of every block (n_chunks, …, chunk), in the order of `system.blocks`.
    """

    @property
    def engine(self) -> Engine:
        """What computes."""
        ...

    @property
    def system(self) -> System:
        """The unknowns and readings."""
        ...

    def changed(self, system: System) -> Equations:
        """The equations of `system`: the same rows with other readings, weights or prior knowledge; a weight of 0 stays 0."""
        ...

    def normal(self, z: np.ndarray, rough: bool = False) -> Normal:
        """Cost, gradient (size,) and JᵀJ (size, size). When `rough`, products of JᵀJ are formed in single precision: good enough
        for steps, not for a covariance; cost and gradient never are."""
        ...

    def slope(self, z: np.ndarray) -> tuple[float, np.ndarray]:
        """Cost and gradient alone: a sixth of the work of `normal` or less."""
        ...

    def nuisance(self, z: np.ndarray) -> Normal:
        """Cost, gradient and JᵀJ in the nuisance parameters alone, all others held: a small part of the work."""
        ...

    def predictions(self, z: np.ndarray) -> list[np.ndarray]:
        """Predicted readings of every block, each (n_chunks, k, chunk) [unit of the reading]."""
        ...

    def quadratic_forms(self, z: np.ndarray, factor: np.ndarray) -> list[np.ndarray]:
        """|F J_i|² for every whitened reading i, each (n_chunks, k, chunk), with `factor` F (r, size).

        With FᵀF the covariance of z these are the leverages h_ii.
        """
        ...

    def projected(self, z: np.ndarray, factor: np.ndarray) -> list[np.ndarray]:
        """F Jᵀ of every block, each (n_chunks, r, k · chunk), with `factor` F (r, size)."""
        ...

    def jacobian(self, z: np.ndarray) -> list[np.ndarray]:
        """Whitened Jᵀ of every block, each (n_chunks, size, k · chunk). For rank decisions only: it is large."""
        ...


class Engine(Protocol):
    """What computes residuals and derivatives."""

    @property
    def name(self) -> str:
        """ "compiled" or "interpreted"."""
        ...

    def equations(self, system: System) -> Equations:
        """The least-squares equations of a system."""
        ...

    def readings(
        self, machine: Machine, form: Form, q: Any, tool: Any, errors: Any, slots: Any, constants: Any
    ) -> np.ndarray:
        """Predicted readings (k, m) of one group from its numbers: `q` (n_axes, m), `tool` (3, m), error values `errors`
        (6 · (n_axes + 1), m), values of its nuisance parameters `slots` (n_slots, m), `constants` (n_constants, m). Of readings
        with two ends, `q`, `tool` and `errors` hold those of the second end behind those of the first."""
        ...

    def sensitivities(
        self, machine: Machine, form: Form, q: Any, tool: Any, slots: Any, constants: Any
    ) -> tuple[np.ndarray, np.ndarray]:
        """∂reading/∂q (n_axes, k, m) and ∂reading/∂tool (3, k, m) at the nominal machine."""
        ...

    def by_points(
        self, function: PointFunction, machine: Machine, layout: Layout, shared: tuple[Any, ...], points: Any
    ) -> Calls:
        """`function`(machine, layout, shared[0], points, *shared[1:]) slice by slice of the points.

        `points`: a named tuple of arrays (m, …) or None, which the function gets as (…, slice).
        """
        ...


def taken(points: Any, rows: Any) -> Any:
    """Some of the points, a named tuple like the given one, points last."""
    return type(points)(*(None if v is None else np.ascontiguousarray(v[rows].T) for v in points))


def slices(m: int, size: int) -> list[slice]:
    """0 … m - 1 in parts of at most `size`."""
    return [slice(start, min(start + size, m)) for start in range(0, m, size)]
