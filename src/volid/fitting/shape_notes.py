"""What a user should know of single functions after a fit: which are weakly determined, and which have short waves."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from volid.fitting.diagnosis.statements import Weak
from volid.fitting.prediction.spread import linear_uncertainty
from volid.fitting.solution import Solution
from volid.model.error_model import LOCATION, WAVES
from volid.model.iso230 import parse
from volid.model.splines import design_matrix

MANY = 80  # positions of an axis
POINTS = 21  # of a function, and of a wave


def shape_notes(solution: Solution, weak: Sequence[Weak]) -> Iterator[str]:
    """Sentences for the notes of a solution."""
    for found in weak:
        named = ", ".join(f"{n} ({_largest_u(solution, n)})" for n in found.names)
        yield f"weakly determined, with a large u: {named}: {found.reason}"
    yield from _equidistant(solution)
    waves = [f.name for f in solution.model.functions if f.part == WAVES]
    if waves:
        named = ", ".join(_wave(solution, name) for name in waves)
        yield f"short waves: {named}; tables and grids are without them, and their u contains them"


def _equidistant(solution: Solution) -> Iterator[str]:
    """That equidistant positions do not see waves of which whole numbers fit between them."""
    found, steps = [], []
    for i, axis in enumerate(solution.machine.axes):
        moves = any(s.axis == i for f in solution.model.functions for s in f.splines)
        x = np.unique(np.round(solution.campaign.positions[:, i], 3))
        gaps = np.diff(x)
        if moves and not axis.pitch and MANY > len(x) > 2 and np.ptp(gaps) < 0.02 * gaps.max():
            steps.append(float(gaps.mean()))
            found.append(f"{axis.letter} (every {gaps.mean():.4g} {axis.unit})")
    if found:
        step = min(steps)
        yield (
            f"positions of {', '.join(sorted(found))} are equidistant: errors that repeat every {step:.4g}, {step / 2:.4g}, "
            f"{step / 3:.4g} … (such as those of a screw's pitch) cannot be seen, and u does not contain them; measure some "
            "positions off these steps"
        )


def _largest_u(solution: Solution, name: str) -> str:
    """ "u up to 3 µm"; of a constant that has no value in the machine frame, such as that of a carried axis, only this."""
    if (name, LOCATION) in solution.model.by_name:
        u = solution.location(name).u
    else:
        travel = solution.machine.axis(parse(name).axis).travel
        rows = solution.motion_rows(name, np.linspace(*travel, POINTS), 0)
        u = float(linear_uncertainty(rows, solution.parameter_covariance).max())
    if not np.isfinite(u):
        return "no value in the machine frame"
    return f"u up to {1e6 * u:.3g} µrad" if parse(name).is_rotation else f"u up to {1e3 * u:.3g} µm"


def _wave(solution: Solution, name: str) -> str:
    f = solution.model.by_name[name, WAVES]
    (spline,) = f.splines
    rows = (
        design_matrix(spline, np.linspace(spline.low, spline.high, POINTS))
        @ solution.model.parametrisation[f.coefficients]
    )
    values, u = rows @ np.asarray(solution.parameters), linear_uncertainty(rows, solution.parameter_covariance)
    worst = int(np.argmax(np.abs(values)))
    if abs(values[worst]) < 2.0 * u[worst]:
        return f"{name} every {spline.high:g} mm not seen (u up to {1e3 * u.max():.2f} µm)"
    return f"{name} every {spline.high:g} mm up to {1e3 * abs(values[worst]):.2f} µm (u {1e3 * u[worst]:.2f} µm)"
