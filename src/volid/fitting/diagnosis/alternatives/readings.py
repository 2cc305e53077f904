"""Alternatives in the readings: the length of one tool, the scale of a station or of an interferometer without one, outliers."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.special import gammaln, ndtri

from volid.campaign import SAME_TOOL
from volid.effects.base import lengths_of
from volid.fitting.diagnosis.alternatives.base import Alternative
from volid.fitting.diagnosis.alternatives.shapes import span
from volid.fitting.diagnosis.around import Around
from volid.fitting.diagnosis.robust import spread
from volid.observations import KINDS
from volid.observations.base import STATION

TOOL, SCALE, RANGE, OUTLIERS = "tool length", "scale of a station", "error along the range", "outliers"
SCALE_OF_SET = "scale of a set"
DEGREES = 8  # of an error along the range
STEPS, NOISES = 64, 50.0  # of the range, in which lengths are told apart; u, which a step is at least
LEAST_LENGTHS = DEGREES + 1  # that differ
WHOLE, PART, NONE = "u as a whole", "u of a part of the readings", "none of these"
SCALE_CURE = (
    'campaign, [[set.effect]]: name = "scale", type = "scale", per = "{per}", u = {{size:.1e}}; and check the refractive index '
    "that the readings were corrected with"
)
MOST_TOOLS = 24
MOST_OUTLIERS = 60
LARGEST = 600.0  # logarithm of the number of choices that is counted
MANY = 0.1  # of the readings: so many are no outliers
CHANCE = 1e-3  # that a sound campaign has an outlier at all


def tools(around: Around) -> Iterator[Alternative]:
    """Every tool vector of several may be another one than stated."""
    rounded = np.round(around.tools, SAME_TOOL)
    found = np.unique(rounded[around.active], axis=0)
    for tool in found if 1 < len(found) <= MOST_TOOLS else ():
        own = around.seen.of_each(np.all(rounded == tool, axis=1))
        said = ", ".join(f"{c:g}" for c in tool)
        cure = f"measure the tool again, and correct its vector in the campaign (tool or tool_x, tool_y, tool_z of ({said}) mm)"
        columns = around.seen.summed((around.seen.tool * own).T)
        yield Alternative(TOOL, f"tool vector ({said}) mm has another length or offset", cure, columns)


def scales(around: Around) -> Iterator[Alternative]:
    """The lengths from one station, or from every one, have a scale error of their own, as wrong refraction gives it.

    Columns are lengths over their u [mm/mm], (n, stations); readings of kinds without stations are no lengths from somewhere.
    """
    sets = around.campaign.sets
    lengths = np.concatenate(
        [lengths_of(s).ravel() if STATION in KINDS[s.kind].labels else 0.0 * s.u.ravel() for s in sets]
    )
    columns, cure = [], SCALE_CURE.format(per="station")
    for name in sorted(set(around.standing[lengths != 0.0].tolist()) - {""}):
        columns.append(np.where(around.standing == name, around.weight * lengths, 0.0)[:, None])
        yield Alternative(SCALE, f"lengths from {name} have another scale", cure, columns[-1])
    if len(columns) > 1:
        yield Alternative(SCALE, "lengths from several stations have other scales", cure, np.hstack(columns))
    yield from _scales_of_sets(around)


def _scales_of_sets(around: Around) -> Iterator[Alternative]:
    """Displacements that an interferometer without a station counts have a scale error of their own."""
    for i, s in enumerate(around.campaign.sets):
        if STATION not in KINDS[s.kind].labels and KINDS[s.kind].runs_by(s):
            column = np.zeros(len(around.weight))
            own = np.flatnonzero(around.set_number == i)
            column[own] = around.weight[own] * lengths_of(s).ravel()
            cure = SCALE_CURE.format(per="set")
            yield Alternative(SCALE_OF_SET, f"lengths of set '{s.name}' have another scale", cure, column[:, None])


def ranges(around: Around) -> Iterator[Alternative]:
    """Lengths have an error that is a function of length, the same from every station: no straight scale.

    Columns: Legendre polynomials of degree 2 … `DEGREES` over the lengths' range, over u, (n, `DEGREES` - 1) [1/mm].
    """
    sets = around.campaign.sets
    lengths = np.concatenate(
        [lengths_of(s).ravel() if STATION in KINDS[s.kind].labels else 0.0 * s.u.ravel() for s in sets]
    )
    measured = (lengths != 0.0) & around.active
    if not measured.any():
        return
    lengths = _in_steps(lengths, measured, around.weight)
    if len(np.unique(lengths[measured])) < LEAST_LENGTHS:
        return
    x = np.where(measured, span(np.where(measured, lengths, np.mean(lengths[measured]))), 0.0)
    columns = [around.weight * measured * np.polynomial.legendre.Legendre.basis(d)(x) for d in range(2, DEGREES + 1)]
    cure = "calibrate the instrument over its range, and correct the readings"
    yield Alternative(RANGE, "readings have an error that depends on the length", cure, np.stack(columns, axis=1))


def _in_steps(lengths: np.ndarray, measured: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Lengths rounded to steps far above their noise: a function of a length would follow the noise of that very reading, most
    of all on a ball bar, whose lengths differ by little else."""
    noise = 1.0 / float(np.min(weight[measured]))
    step = max(float(np.ptp(lengths[measured])) / STEPS, NOISES * noise)
    return np.asarray(np.round(lengths / step) * step)


def outliers(around: Around) -> Iterator[Alternative]:
    """All readings that are too far off for a normal distribution, each with an unknown error."""
    redundancy = np.maximum(1.0 - np.sum(around.rows**2, axis=1), 1e-6)
    normalised = np.where(around.active, around.v / np.sqrt(redundancy), 0.0)
    limit = -float(ndtri(0.5 * CHANCE / max(int(around.active.sum()), 1))) * spread([normalised[around.active]])
    beyond = np.flatnonzero(np.abs(normalised) > limit)
    if not len(beyond) or len(beyond) > MANY * int(around.active.sum()):
        return
    worst = beyond[np.argsort(-np.abs(normalised[beyond]))][:MOST_OUTLIERS]
    columns = np.zeros((len(around.v), len(worst)))
    columns[worst, np.arange(len(worst))] = 1.0
    first = around.where(int(worst[0]))
    count = f"{len(beyond)} outlier{'s' if len(beyond) > 1 else ''}"
    active = int(around.active.sum())
    choices = gammaln(active + 1) - gammaln(len(worst) + 1) - gammaln(active - len(worst) + 1)
    cure = "fit with the option robust, which finds all of them and sets them aside"
    what = f"{count}, first {first}"
    yield Alternative(OUTLIERS, what, cure, columns, tried=float(np.exp(min(choices, LARGEST))))
