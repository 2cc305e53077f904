"""Alternatives in the readings: the length of one tool, the scale of a station, outliers, u wrong as a whole."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.special import ndtri

from volid.campaign import SAME_TOOL
from volid.effects.base import lengths_of
from volid.fitting.diagnosis.alternatives.base import Alternative
from volid.fitting.diagnosis.around import Around
from volid.fitting.diagnosis.robust import spread

TOOL, SCALE, OUTLIERS = "tool length", "scale of a station", "outliers"
WHOLE, NONE = "u as a whole", "none of these"
MOST_TOOLS = 24
MOST_OUTLIERS = 60
MANY = 0.1  # of the readings: so many are no outliers
CHANCE = 1e-3  # that a sound campaign has an outlier at all


def tools(around: Around) -> Iterator[Alternative]:
    """Every tool vector of several may be another one than stated."""
    rounded = np.round(around.tools, SAME_TOOL)
    found = np.unique(rounded[around.active], axis=0)
    for tool in found if 1 < len(found) <= MOST_TOOLS else ():
        own = np.all(rounded == tool, axis=1)
        said = ", ".join(f"{c:g}" for c in tool)
        cure = f"measure the tool again, and correct its vector in the campaign (tool or tool_x, tool_y, tool_z of ({said}) mm)"
        yield Alternative(
            TOOL, f"tool vector ({said}) mm has another length or offset", cure, (around.seen.tool * own).T
        )


def scales(around: Around) -> Iterator[Alternative]:
    """The lengths from one station, or from every one, have a scale error of their own, as wrong refraction gives it."""
    lengths = np.concatenate([lengths_of(s).ravel() for s in around.campaign.sets])
    columns = []
    for name in sorted(set(around.standing.tolist()) - {""}):
        columns.append(np.where(around.standing == name, around.weight * lengths, 0.0)[:, None])
        yield Alternative(SCALE, f"lengths from {name} have another scale", _scale_cure(name), columns[-1])
    if len(columns) > 1:
        cure = _scale_cure(next(n for n in around.standing.tolist() if n))
        yield Alternative(SCALE, "lengths from several stations have other scales", cure, np.hstack(columns))


def _scale_cure(name: str) -> str:
    kind = name.split(" ", 1)[0]
    return f'campaign, [[set.effect]]: type = "scale", per = "{kind}"; and check the refractive index of the readings'


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
    yield Alternative(
        OUTLIERS, f"{count}, first {first}", "fit robustly (`robust=True`), or take the rows out", columns
    )
