"""Beyond the measured range: what the smoothness of the functions says there, with its own u.

With the Matérn process that the fit has estimated, the coefficients c' of a spline beyond the measured range follow from those
within, c, and scatter around that: Q the precision of all of them, parted into those within (i) and beyond (o),

    c' = -Q_oo⁻¹ Q_oi c,   covariance Q_oo⁻¹.

So a function goes on along its own line with a u that grows with the distance. A function with stated segments has no smoothness
that was estimated: its end polynomials go on. The datum refers to the measured range as before. Rasmussen and Williams, Gaussian
Processes for Machine Learning, 2006, 2.7.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.linalg import block_diag

from volid.exceptions import InputError
from volid.fitting.change_of_datum import EXTRAPOLATED
from volid.fitting.results import read_only
from volid.fitting.smoothness.processes import processes_of, rows_of
from volid.model.datum_constraints import Reach, range_of
from volid.model.error_model import ErrorModel, Function, build_model
from volid.model.requests import ask_positions
from volid.model.splines import Spline, design_matrix, segments_within

if TYPE_CHECKING:
    from volid.fitting.solution import Solution


class _Carried(NamedTuple):
    """Coefficients of one function on the longer spline from those on the shorter, (n', n), and root of their own covariance."""

    matrix: np.ndarray
    root: np.ndarray


def extrapolated(solution: Solution, ranges: Reach | None = None) -> Solution:
    """`Solution.extrapolated`, which describes it."""
    full = {a.letter: a.travel for a in solution.campaign.machine.axes}
    reach = full if ranges is None else dict(ranges)
    for letter, (low, high) in reach.items():
        axis = solution.machine.axis(letter)
        ask_positions(solution.campaign.machine, {letter: (low, high)}, "extrapolated, `ranges`")
        if not low < high:
            raise InputError(f"extrapolated: range {low:g} … {high:g} of axis {letter}; expected one that rises")
        reach[letter] = (min(low, axis.travel[0]), max(high, axis.travel[1]))
    old = solution.model
    model = build_model(solution.machine, old.segments, carrier=old.carrier, datum=old.datum, reach=reach)
    if model.layout == old.layout:
        return solution
    carried = _carried(solution, model)
    inverse = np.linalg.pinv(model.parametrisation)
    mapping = inverse @ block_diag(*(c.matrix for c in carried)) @ old.parametrisation
    root = inverse @ block_diag(*(c.root for c in carried))
    found = solution.mapped(model, mapping)
    covariance = np.array(found.covariance)
    covariance[: len(root), : len(root)] += solution.factor**2 * root @ root.T
    samples = None if found.samples is None else found.samples.scattered(solution.factor * root)
    options = {**solution.options, EXTRAPOLATED: {a: list(r) for a, r in reach.items()}}
    stated = sorted({f.name for f in old.functions if f.splines and f.name not in solution.smooth_functions})
    notes = (
        [f"extrapolated with their end polynomials, u not made larger for that: {', '.join(stated)}"] if stated else []
    )
    notes = [*found.notes, *notes]
    return replace(found, covariance=read_only(covariance), samples=samples, options=options, notes=tuple(notes))


def _carried(solution: Solution, model: ErrorModel) -> list[_Carried]:
    """One entry per function of the model, in the order of the coefficients."""
    smooth = {} if solution.smooth is None else _smoothness(solution)
    result = []
    for old, new in zip(solution.model.functions, model.functions, strict=True):
        if old.splines == new.splines:
            size = old.coefficients.stop - old.coefficients.start
            result.append(_Carried(np.eye(size), np.zeros((size, 0))))
        elif (old.name, old.part) in smooth:
            result.append(_by_smoothness(old, new, smooth[old.name, old.part], model))
        else:
            result.append(_by_polynomials(old, new))
    return result


def _smoothness(solution: Solution) -> dict[tuple[str, str], np.ndarray]:
    """φ of every function whose smoothness was estimated; of a function that lost its second axis since, what it still needs."""
    assert solution.smooth is not None
    found: dict[tuple[str, str], np.ndarray] = {}
    for process in processes_of(solution.model, solution.smooth_functions):
        own = solution.smooth.of(process.label)
        if len(own) >= len(process.median):
            found |= {(name, process.part): own[: len(process.median)] for name in process.names}
    return found


def _by_smoothness(old: Function, new: Function, phi: np.ndarray, model: ErrorModel) -> _Carried:
    within = np.arange(int(np.prod([s.size for s in new.splines]))).reshape([s.size for s in new.splines])
    for k, (a, b) in enumerate(zip(old.splines, new.splines, strict=True)):
        first = round((a.low - b.low) / (b.high - b.low) * b.segments)
        within = within.take(np.arange(first, first + a.size), axis=k)
    inner = within.ravel()
    outer = np.setdiff1d(np.arange(int(np.prod([s.size for s in new.splines]))), inner)
    own = phi.copy()
    for k, spline in enumerate(new.splines):  # lengths are in measured ranges, those of the longer spline in its own
        own[1 + 2 * k] += np.log(segments_within(spline, *range_of(model.machine, spline)) / spline.segments)
    rows = rows_of(new.splines, own) / np.exp(phi[0])
    matrix = np.zeros((len(inner) + len(outer), len(inner)))
    matrix[inner] = np.eye(len(inner))
    _, triangle = np.linalg.qr(rows[:, outer])
    back = np.linalg.inv(triangle)
    matrix[outer] = -back @ (back.T @ (rows[:, outer].T @ rows[:, inner]))
    root = np.zeros((len(matrix), len(outer)))
    root[outer] = back
    return _Carried(matrix, root)


def _by_polynomials(old: Function, new: Function) -> _Carried:
    matrix = np.ones((1, 1))
    for a, b in zip(old.splines, new.splines, strict=True):
        matrix = np.kron(matrix, _continued(a, b))
    return _Carried(matrix, np.zeros((len(matrix), 0)))


def _continued(old: Spline, new: Spline) -> np.ndarray:
    x = np.linspace(new.low, new.high, 4 * new.size)
    return np.asarray(np.linalg.lstsq(design_matrix(new, x), design_matrix(old, x), rcond=None)[0])
