"""A control that smooths between the points of its tables: a moving average over a length of an axis (ISO/TR 16907 9.2.2).

    smooth(x) = ∫ f(t) dt / L   over   x - L/2 … x + L/2,

f the linear interpolation between the points with its end values outside them, or with its period. The integral is exact: f is
a sum of one hat function per point, and each hat has an integral of its own. Averages over several axes of a grid are taken one
after another. A filter in time, whose result depends on feed and direction, is not modelled.
"""

from __future__ import annotations

from itertools import product

import numpy as np

CHUNK = 16_384  # places at a time: every node of an axis has a share of each


def weights(nodes: np.ndarray, x: np.ndarray, length: float, period: float = 0.0) -> np.ndarray:
    """Share of each point in the value at each place, (m, n), rows of sum 1; with `length` 0 those of linear interpolation.

    `nodes`: rising positions (n,); `x`: places (m,); `length`: over which to average; `period`: 360 where the nodes close a
    circle [mm or °].

    >>> weights(np.array([0.0, 10.0, 20.0]), np.array([10.0]), 10.0).round(3).tolist()
    [[0.125, 0.75, 0.125]]
    """
    if length == 0.0:
        return _hats(nodes, _wrapped(nodes, x, period)[0])
    ends = [_integrals(nodes, x + sign * 0.5 * length, period) for sign in (1.0, -1.0)]
    return np.asarray((ends[0] - ends[1]) / length)


def smoothed(
    nodes: tuple[np.ndarray, ...],
    table: np.ndarray,
    positions: np.ndarray,
    lengths: tuple[float, ...],
    periods: tuple[float, ...],
) -> np.ndarray:
    """Averages at `positions` (m, k) of a `table` (n_1, …, n_k, c) over `nodes` (n_i,), (m, c); NaN where a blank node counts.

    `lengths`, `periods`: one for each axis, as in `weights`.
    """
    blank, parts = np.isnan(table), []
    for start in range(0, len(positions), CHUNK):
        rows = positions[start : start + CHUNK].T
        near = [_near(weights(*given)) for given in zip(nodes, rows, lengths, periods, strict=True)]
        values = _summed(np.where(blank, 0.0, table), near)
        if blank.any():
            values[_summed(blank.astype(float), near) > 1e-12] = np.nan
        parts.append(values)
    return np.concatenate(parts)


def _near(share: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Numbers (m, k) of the neighbouring nodes that count, and their shares (m, k), of shares (m, n)."""
    counts = share > 0.0
    first = np.argmax(counts, axis=1)
    last = share.shape[1] - 1 - np.argmax(counts[:, ::-1], axis=1)
    number = np.minimum(first[:, None] + np.arange(np.max(last - first) + 1), share.shape[1] - 1)
    within = first[:, None] + np.arange(number.shape[1]) < share.shape[1]
    return number, np.where(within, np.take_along_axis(share, number, axis=1), 0.0)


def _summed(table: np.ndarray, near: list[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
    """Sum over the nodes near each place of share by share times the value, (m, c)."""
    found = np.zeros((len(near[0][0]), table.shape[-1]))
    for picked in product(*(range(number.shape[1]) for number, _ in near)):
        at = tuple(number[:, k] for k, (number, _) in zip(picked, near, strict=True))
        share = np.prod([w[:, k] for k, (_, w) in zip(picked, near, strict=True)], axis=0)
        found += share[:, None] * table[at]
    return found


def _wrapped(nodes: np.ndarray, x: np.ndarray, period: float) -> tuple[np.ndarray, np.ndarray]:
    """Places within the nodes, (m,), and by how many periods they were moved there."""
    turns = np.floor((x - nodes[0]) / period) if period else np.zeros(len(x))
    return np.clip(x - turns * period, nodes[0], nodes[-1]), turns


def _cell(nodes: np.ndarray, inside: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Number of the interval of each place within the nodes, and its share of the interval's width."""
    cell = np.clip(np.searchsorted(nodes, inside, side="right") - 1, 0, max(len(nodes) - 2, 0))
    width = nodes[np.minimum(cell + 1, len(nodes) - 1)] - nodes[cell]
    return cell, (inside - nodes[cell]) / np.where(width > 0.0, width, 1.0)


def _hats(nodes: np.ndarray, inside: np.ndarray) -> np.ndarray:
    cell, share = _cell(nodes, inside)
    out, rows = np.zeros((len(inside), len(nodes))), np.arange(len(inside))
    out[rows, cell] = 1.0 - share
    out[rows, np.minimum(cell + 1, len(nodes) - 1)] += share
    return out


def _integrals(nodes: np.ndarray, x: np.ndarray, period: float) -> np.ndarray:
    """Integrals of every point's hat from the first node to each place, (m, n); outside, the end points' hats are 1."""
    inside, turns = _wrapped(nodes, x, period)
    cell, share = _cell(nodes, inside)
    width = np.diff(nodes, append=nodes[-1])
    whole = np.zeros((len(nodes), len(nodes)))  # up to node j, of hat i
    for j in range(1, len(nodes)):
        whole[j] = whole[j - 1]
        whole[j, [j - 1, j]] += 0.5 * width[j - 1]
    out, rows = whole[cell], np.arange(len(x))
    out[rows, cell] += width[cell] * (share - 0.5 * share**2)
    out[rows, np.minimum(cell + 1, len(nodes) - 1)] += width[cell] * 0.5 * share**2
    if period:
        return np.asarray(out + turns[:, None] * whole[-1])
    beyond = x - inside
    out[:, 0] += np.minimum(beyond, 0.0)
    out[:, -1] += np.maximum(beyond, 0.0)
    return out
