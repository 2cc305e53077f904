"""Readings against their predictions one by one and in groups: E_n, root mean squares, where a disagreement is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from volid.fitting.diagnosis.groups import groupings
from volid.observations import KINDS
from volid.validation.readings.whitened import Whitened

K = 2.0
LEAST = 1e-9  # of u²: a residual whose variance is smaller is taken up by the campaign's own unknowns


@dataclass(frozen=True, eq=False)
class Compared:
    """Readings of one set, (m, k) each, in the reading's unit.

    Args:
        set: Name of the set.
        kind: Its kind.
        rows: Numbers of its rows in the campaign, from 0, (m,).
        predicted: Predicted readings, with the campaign's own unknowns at their best.
        reading: The readings.
        residual: reading - predicted.
        u: Standard uncertainty of the residual: of the reading and of its prediction, less what the campaign's own unknowns take
            up, u² = diag(C - B (Bᵀ C⁻¹ B)⁻¹ Bᵀ).
        e_n: |residual| / (2 u); NaN where the campaign's own unknowns take up all of it.
    """

    set: str
    kind: str
    rows: np.ndarray
    predicted: np.ndarray
    reading: np.ndarray
    residual: np.ndarray
    u: np.ndarray
    e_n: np.ndarray


@dataclass(frozen=True)
class Group:
    """A group of readings: `sort` ("set", "station", "region", …), `what` it is, number of readings `n`, root mean square of the
    residual and what it should be, `rms` and `expected` [`unit`; NaN where units differ], `e_n_above_1`: share of readings with
    E_n > 1, about 5 % on average if the solution is right, and `ratio`: root mean square of residual over u, about 1."""

    sort: str
    what: str
    n: int
    rms: float
    expected: float
    e_n_above_1: float
    ratio: float
    unit: str = "mm"


def compared(whitened: Whitened, rows: tuple[np.ndarray, ...]) -> tuple[Compared, ...]:
    """Every reading with its prediction. `rows`: numbers of the rows of every set in the campaign that was given."""
    linear = whitened.linear
    variance = np.where(whitened.variance > LEAST, whitened.variance, np.nan)
    residuals = linear.by_set(whitened.residual * linear.u)
    uncertainties = linear.by_set(np.sqrt(variance) * linear.u)
    found = []
    for s, own, residual, u in zip(linear.campaign.sets, rows, residuals, uncertainties, strict=True):
        e_n = np.abs(residual) / (K * u)
        found.append(Compared(s.name, s.kind, own, s.readings - residual, s.readings, residual, u, e_n))
    return tuple(found)


def groups(whitened: Whitened, sets: tuple[Compared, ...]) -> tuple[Group, ...]:
    """All groups, those with the largest ratio first: sets, stations, tools, ranges of axes, regions, directions."""
    campaign, found = whitened.linear.campaign, []
    for s, one in zip(campaign.sets, sets, strict=True):
        for group in groupings(campaign, s, s):
            sort, what, rows = group.sort, group.what, group.rows
            inside = np.broadcast_to(_wide(rows), one.residual.shape)
            inside = inside & np.isfinite(one.u)
            if inside.any():
                named = what if sort == "set" or len(campaign.sets) == 1 else f"{what} (set '{one.set}')"
                units = {p.unit for p in KINDS[s.kind].parts(s) if np.any(inside & _wide(p.rows))}
                found.append(_group(sort, named, one, inside, units))
    return tuple(sorted(found, key=lambda g: -g.ratio))


def _wide(rows: np.ndarray) -> np.ndarray:
    """Rows (m,) or rows and columns (m, k) as the latter."""
    return rows if rows.ndim == 2 else rows[:, None]


def _group(sort: str, what: str, one: Compared, inside: np.ndarray, units: set[str]) -> Group:
    residual, u, e_n = one.residual[inside], one.u[inside], one.e_n[inside]
    one_unit = 1.0 if len(units) == 1 else np.nan
    return Group(
        sort,
        what,
        int(inside.sum()),
        float(np.sqrt(np.mean(residual**2))) * one_unit,
        float(np.sqrt(np.mean(u**2))) * one_unit,
        float(np.mean(e_n > 1.0)),
        float(np.sqrt(np.mean((residual / u) ** 2))),
        ", ".join(sorted(units)),
    )
