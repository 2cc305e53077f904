"""The tool vectors of a campaign that predictions are made for, so that the largest deviation is that of all of them."""

from __future__ import annotations

import numpy as np

from volid.campaign import SAME_TOOL
from volid.fitting.solution import Solution
from volid.observations import KINDS

MOST = 8  # tool vectors


def campaign_tools(solution: Solution, first: np.ndarray) -> np.ndarray:
    """`first` (3,) [mm] and the other tool vectors with which readings see the tool, (k, 3) [mm].

    Of more than `MOST` those farthest from each other: a deviation grows with the distance between tool vectors.
    """
    seen = [s.tool for s in solution.campaign.sets if KINDS[s.kind].sees_tool(s)]
    chosen = [np.asarray(first, dtype=float)]
    if not seen:
        return np.array(chosen)
    others = np.unique(np.round(np.concatenate(seen), SAME_TOOL), axis=0)
    while len(chosen) < MOST:
        apart = np.min([np.linalg.norm(others - t, axis=1) for t in chosen], axis=0)
        if apart.max() <= 10.0**-SAME_TOOL:
            break
        chosen.append(others[int(np.argmax(apart))])
    return np.array(chosen)
