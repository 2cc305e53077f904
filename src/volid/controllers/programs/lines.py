"""Lines of a polyline, cut into parts, and where they pass nodes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

LETTERS = "XYZ"


class Lines(NamedTuple):
    """Lines of a polyline. `owner`: index of its motion, (m,). `start`, `end`: (m, 3) [mm]. `tool`: (m, 3) [mm]. `way`:
    directions of X, Y, Z, +1, -1 or 0, (m, 3). `tolerance`: of the correction along it, inf for none (m,) [mm]. `origin`: where
    the correction counts as 0, NaN for nowhere, (m, 3) [mm]."""

    owner: np.ndarray
    start: np.ndarray
    end: np.ndarray
    tool: np.ndarray
    way: np.ndarray
    tolerance: np.ndarray
    origin: np.ndarray

    def rows(self, which: np.ndarray | slice) -> Lines:
        """Some of them."""
        return Lines(*(a[which] for a in self))


class Places(NamedTuple):
    """Where lines lie on those of which they are parts: `line`, the share `at` which they begin, and their `length` of it."""

    line: np.ndarray
    at: np.ndarray
    length: np.ndarray


def divided(lines: Lines, places: Places, parts: np.ndarray, node: np.ndarray) -> tuple[Lines, Places]:
    """Every line in so many equal parts (m,), or in two at the share `node` (m,) where that is a number."""
    row = np.repeat(np.arange(len(parts)), parts)
    k = np.arange(len(row)) - np.repeat(np.cumsum(parts) - parts, parts)
    even = np.isnan(node[row])
    low = np.where(even | (k == 0), k / parts[row], node[row])
    high = np.where(even | (k == 1), (k + 1) / parts[row], node[row])
    span = (lines.end - lines.start)[row]
    last = (k + 1 == parts[row])[:, None]
    begin = lines.start[row] + low[:, None] * span
    end = np.where(last, lines.end[row], lines.start[row] + high[:, None] * span)
    at, length = places.at[row] + low * places.length[row], (high - low) * places.length[row]
    return lines.rows(row)._replace(start=begin, end=end), Places(places.line[row], at, length)


def crossings(start: np.ndarray, end: np.ndarray, nodes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lines and shares of them at which one coordinate, from `start` to `end` (m,), passes nodes (n,)."""
    first = np.searchsorted(nodes, np.minimum(start, end), side="right")
    count = np.maximum(np.searchsorted(nodes, np.maximum(start, end), side="left") - first, 0)
    line = np.repeat(np.arange(len(start)), count)
    which = np.arange(len(line)) - np.repeat(np.cumsum(count) - count, count) + first[line]
    return line, (nodes[which] - start[line]) / (end - start)[line]
