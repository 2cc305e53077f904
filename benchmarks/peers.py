"""Other ways to the same minimum: scipy and optimistix on the residuals of a case, in free parameters scaled by their size."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from scipy.optimize import least_squares

from benchmarks.cases import Case
from volid.effects.prediction import predict_readings
from volid.fitting.equations.compiled import Compiled
from volid.fitting.equations.programs import jacobian, predictions
from volid.fitting.equations.system import System
from volid.model.error_values import error_values, evaluate_bases

TOLERANCE = 1e-10  # relative, of scipy, which then ends as near to the minimum as volid does
STOCK = 1e-7  # of optimistix, which then does so, too; below 1e-9 rounding keeps Gauss-Newton going for ever


class Scaled:
    """A case in y with z = start + free · (scale y), scale: conditional standard uncertainties, so that one tolerance suits all.

    `origin`: y is 10⁴ at the start, not 0: scipy's trust region would begin with a radius of 1 and creep. A relative tolerance of
    1e-7 is 1e-3 of a scale.
    """

    def __init__(self, case: Case, start: np.ndarray | None = None) -> None:
        self.system: System = jax.tree.map(jnp.asarray, case.problem.system)
        self.z0 = case.problem.start if start is None else start
        free = case.problem.free
        matrix = free.T @ Compiled().equations(case.problem.system).normal(self.z0).matrix @ free
        self.free = free / np.sqrt(np.diagonal(matrix))
        self.origin = np.full(free.shape[1], 1e4)

    def z(self, y: Any) -> Any:
        """Unknowns of the problem."""
        return self.z0 + self.free @ (y - self.origin)

    def residual(self, y: np.ndarray) -> np.ndarray:
        """Whitened residuals, priors included, (m,)."""
        z = self.z(y)
        values = predictions(self.system, z)
        parts = [
            ((np.asarray(v) - b.reading) * b.weight).ravel() for v, b in zip(values, self.system.blocks, strict=True)
        ]
        return np.concatenate([*parts, np.asarray(self.system.prior_residual(z))])

    def rows(self, y: np.ndarray) -> np.ndarray:
        """The structured Jacobian that volid has, (m, n)."""
        blocks = jacobian(self.system, self.z(y))
        parts = [np.asarray(b).transpose(0, 2, 1).reshape(-1, b.shape[1]) for b in blocks]
        return np.concatenate([*parts, np.asarray(self.system.prior_root)]) @ self.free


def scipy_fit(scaled: Scaled, method: str) -> np.ndarray:
    """scipy's trust-region methods with the structured Jacobian; z."""
    found = least_squares(
        scaled.residual, scaled.origin, scaled.rows, method=method, xtol=TOLERANCE, ftol=TOLERANCE, gtol=TOLERANCE
    )
    return np.asarray(scaled.z(found.x))


def _one(system: System, form: Any, z: Any, q: Any, way: Any, tool: Any, slots: Any, constants: Any) -> Any:
    """Prediction of one reading from its own numbers: what one writes first."""
    n = system.layout.n_coefficients
    errors = error_values(system.layout, z[:n], evaluate_bases(system.layout, q[:, None], way[:, None]))
    values = predict_readings(
        system.machine, form, q[:, None], tuple(tool[:, None]), errors, z[n + slots][:, None], constants[:, None]
    )
    return values[:, 0]


def _by_reading(a: Any) -> Any:
    """(chunks, width, rows) -> (readings, width)."""
    return jnp.moveaxis(a, 1, 2).reshape(a.shape[0] * a.shape[2], a.shape[1])


def plain_residual(y: Any, args: tuple[System, Any, Any, Any]) -> Any:
    """Whitened residuals, reading by reading under `vmap`."""
    system, z0, free, origin = args
    z = z0 + free @ (y - origin)
    parts = []
    for b in system.blocks:
        flat = [_by_reading(a) for a in (b.q, b.direction, b.tool, b.slots, b.constants)]
        values = jax.vmap(partial(_one, system, b.form, z))(*flat)
        parts.append(((values - _by_reading(b.reading)) * _by_reading(b.weight)).ravel())
    return jnp.concatenate([*parts, system.prior_residual(z)])


def optimistix_fit(scaled: Scaled, solver: str) -> Callable[[], np.ndarray]:
    """Stock Gauss-Newton or Levenberg-Marquardt, compiled on first use; z. Raises when it does not converge."""
    kind = {"GN": optx.GaussNewton, "LM": optx.LevenbergMarquardt}[solver]
    own = kind(rtol=STOCK, atol=STOCK)
    fixed = (jnp.asarray(scaled.z0), jnp.asarray(scaled.free), jnp.asarray(scaled.origin))

    def run() -> np.ndarray:
        args = (scaled.system, *fixed)
        found = optx.least_squares(plain_residual, own, jnp.asarray(scaled.origin), args, max_steps=100)
        return np.asarray(scaled.z(np.asarray(found.value)))

    return run
