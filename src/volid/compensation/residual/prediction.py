"""What a control leaves of a deviation field: largest, RMS and more, with intervals from draws of the parameters.

    remaining = e(draw) + what the altered command moves + repeatability,    the command from tables and grids of the estimate.

The largest values are those over the whole working volume: over places spread evenly, corners, edges and faces, and where a
search finds what the solution itself leaves to be largest. RMS, 95 % quantile and the rigid motion of the workpiece frame, which
is taken out, refer to the places spread evenly.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from volid.compensation.control import Control
from volid.compensation.residual.fields import (
    LENGTHS,
    Field,
    angles_known,
    moved_by,
    quantities,
    sizes,
    tool_axes,
)
from volid.compensation.residual.repeats import Repeats
from volid.fitting.prediction.deviations import deviation_values
from volid.fitting.prediction.largest import Places, axes_with_reversal, largest_places_of_all
from volid.fitting.prediction.spread import covariance_root
from volid.fitting.solution import Solution
from volid.model.jacobian import rigid_motion_rows
from volid.uncertainty.coverage import coverage_intervals

DRAWS = 400
MOST_SAMPLES = 2000
AT_ONCE = 100  # draws
PLACES_AT_ONCE = 8192  # few enough that no program is compiled for searches that happen to go side by side


class Prediction(NamedTuple):
    """What one compensation leaves for one tool vector, each (10,) in the order of `QUANTITIES` [mm, rad].

    `value`: mean over the draws of the largest and RMS length, the length that 95 % of the points keep, the largest |X|, |Y|,
    |Z| and the largest |A|, |B|, |C| of the orientation and the largest tilt of the tool axis, which is what a turning tool
    feels; `low`, `high`: 95 % coverage interval; `exact`: if the solution were exact and the machine repeated perfectly. NaN: not
    determined by the data.
    """

    value: np.ndarray
    low: np.ndarray
    high: np.ndarray
    exact: np.ndarray


def parameter_draws(solution: Solution, seed: int = 0, most: int = MOST_SAMPLES) -> tuple[np.ndarray, str]:
    """Draws of θ less its estimate, (s, n), and from where they are; at most so many of the solution's samples."""
    theta = np.asarray(solution.parameters)
    if solution.samples is not None:
        values = solution.samples.outputs(lambda x: x[:, : len(theta)])[:most]
        return values - theta, "Monte Carlo samples of the solution"
    root = covariance_root(solution.parameter_covariance)
    return np.random.default_rng(seed).standard_normal(
        (min(DRAWS, most), root.shape[1])
    ) @ root.T, "the covariance of the solution"


def left_by(field: Field, acting: Control) -> np.ndarray:
    """What a control leaves of the field that the solution itself has, (m, 6) [mm, rad]."""
    return field.estimate + _moved(field, acting, field.places)


def mean_left_by(field: Field, acting: Control) -> np.ndarray:
    """The same of the mean of both approach directions, (m, 6) [mm, rad]."""
    q = field.places.positions
    still, tool = np.zeros_like(q), np.broadcast_to(field.tool, (len(q), 3))
    theta = np.asarray(field.solution.parameters)
    return deviation_values(field.solution.model, theta, q, tool, still) + _moved(field, acting, Places(q, still))


def _moved(field: Field, acting: Control, places: Places) -> np.ndarray:
    altered = acting.command(places.positions, field.tool, places.directions)
    return moved_by(field.machine, places.positions, altered, field.tool)


def with_worst_places(field: Field, controls: Sequence[Control]) -> list[Field]:
    """For each of some controls, the field over the places too where what it leaves, rigid motion taken out, is largest by any
    of `sizes`."""
    fitted, places = field.motion(), field.places
    moved = [_moved(field, acting, places) for acting in controls]
    motions = [fitted.motions((field.estimate + change)[None])[0] for change in moved]
    deviations, axes = _deviations(field, places), tool_axes(field.machine, places.positions)
    found = [
        sizes((deviations + change - fitted.rows @ motion)[None], axes)[0]
        for change, motion in zip(moved, motions, strict=True)
    ]
    values, directed = _Remaining(field, controls, motions).at, axes_with_reversal(field.solution.model)
    return [field.and_also(worst) for worst in largest_places_of_all(field.machine, values, places, found, directed)]


def _deviations(field: Field, places: Places) -> np.ndarray:
    """The deviation that the solution itself has at some places, (m, 6) [mm, rad]."""
    model, theta = field.solution.model, np.asarray(field.solution.parameters)
    parts = []
    for start in range(0, len(places.positions), PLACES_AT_ONCE):
        q, way = (a[start : start + PLACES_AT_ONCE] for a in (places.positions, places.directions))
        parts.append(deviation_values(model, theta, q, np.broadcast_to(field.tool, (len(q), 3)), way))
    return np.concatenate(parts)


class _Remaining(NamedTuple):
    """What each of some controls leaves of a field, less a rigid motion of its own, by all of `sizes`."""

    field: Field
    controls: Sequence[Control]
    motions: Sequence[np.ndarray]

    def at(self, asked: Sequence[Places | None]) -> list[np.ndarray | None]:
        """All controls at once, each at places of its own, None where there are none."""
        parts = [(i, places) for i, places in enumerate(asked) if places is not None]
        q, way = (np.concatenate([places[k] for _, places in parts]) for k in (0, 1))
        counts = [(i, len(places.positions)) for i, places in parts]
        places = Places(q, way)
        values = self._sizes(places, counts)
        result: list[np.ndarray | None] = [None] * len(asked)
        for (i, _), own in zip(counts, np.split(values, np.cumsum([n for _, n in counts])[:-1]), strict=True):
            result[i] = own
        return result

    def _sizes(self, places: Places, counts: Sequence[tuple[int, int]]) -> np.ndarray:
        """Sizes at places of which, one control after the other, the first so many belong to one."""
        machine, tool, start = self.field.machine, self.field.tool, 0
        altered, motion = np.empty_like(places.positions), np.empty((len(places.positions), 6))
        for i, n in counts:
            part = slice(start, start := start + n)
            altered[part] = self.controls[i].command(places.positions[part], tool, places.directions[part])
            motion[part] = self.motions[i]
        left = _deviations(self.field, places) + moved_by(machine, places.positions, altered, tool)
        left -= np.einsum("mij,mj->mi", rigid_motion_rows(machine, places.positions, tool), motion)
        return np.asarray(sizes(left[None], tool_axes(machine, places.positions))[0])


def prediction(field: Field, acting: Control, draws: np.ndarray, repeats: Repeats) -> Prediction:
    """What a control leaves over the places of a field, one approach to each; `draws`: of θ less its estimate, (s, n)."""
    shared = field if field.head is None else field.head
    return predictions(shared, [(field, acting)], draws, repeats)[0]


def predictions(
    shared: Field, tasks: Sequence[tuple[Field, Control]], draws: np.ndarray, repeats: Repeats
) -> list[Prediction]:
    """What each of several controls leaves, over `shared` or a field that continues it.

    What the draws (s, n) of θ less its estimate do at the shared places is computed once for all of them.
    """
    m = len(shared.places.positions)
    running = [_Running(field, acting, repeats, len(draws)) for field, acting in tasks]
    rows = shared.gradient.reshape(-1, draws.shape[1]).T
    for start in range(0, len(draws), AT_ONCE):
        part = draws[start : start + AT_ONCE]
        common = (part @ rows).reshape(len(part), m, 6)
        for one in running:
            one.add(part, common)
    return [one.result() for one in running]


class _Running:
    """A control under way through the draws: what the draws do at places of its `own`, it computes itself."""

    def __init__(self, field: Field, acting: Control, repeats: Repeats, n_draws: int) -> None:
        self.field, self.own = field, field.own if field.head is not None else field.own[:0]
        self.scattering = repeats.columns(field.machine, field.places, field.tool)
        self.centre, self.even = left_by(field, acting)[None], field.places.even
        self.axis, self.without = tool_axes(field.machine, field.places.positions), field.motion().removed_from
        self.scatter = field.solution.scatter_u()
        self.rng, self.found = np.random.default_rng(n_draws), list[np.ndarray]()

    def add(self, part: np.ndarray, common: np.ndarray) -> None:
        """Some draws (s, n), and what they do at the shared places (s, m, 6)."""
        own = self.own.reshape(-1, part.shape[1])
        spread = np.concatenate([common, (part @ own.T).reshape(len(part), -1, 6)], axis=1)
        if self.scatter.any():
            spread += self.scatter * self.rng.standard_normal(spread.shape)
        if self.scattering.shape[2]:
            drawn = self.rng.standard_normal((len(part), len(self.scattering), self.scattering.shape[2]))
            spread += np.einsum("mck,smk->smc", self.scattering, drawn)
        self.found.append(quantities(self.without(self.centre + spread), self.axis, self.even))

    def result(self) -> Prediction:
        """Mean and interval over all draws."""
        values = np.concatenate(self.found)
        bounds = coverage_intervals(values)
        exact = quantities(self.without(self.centre), self.axis, self.even)[0]
        result = [values.mean(axis=0), bounds.low, bounds.high, exact]
        if not angles_known(self.field):
            for numbers in result:
                numbers[len(LENGTHS) :] = np.nan
        return Prediction(*result)
