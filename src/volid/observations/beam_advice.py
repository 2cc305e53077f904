"""What beams leave open: planes in which none is inclined, and a single tool vector."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np

from volid.model.iso230 import LINEAR_AXES
from volid.observations.beam_lines import BeamLine

INCLINED = 0.05  # of a displacement: a part along an axis that counts


def advice(sets: Sequence[Sequence[BeamLine]]) -> list[str]:
    """Facts about the beams of all sets because of which error functions are often not determined."""
    lines = [line for beams in sets for line in beams]
    reasons = [*_planes(lines)]
    tools = np.unique(np.round(np.concatenate([line.seen.tool for line in lines]), 3), axis=0)
    if len(tools) == 1:
        single = ", ".join(f"{x:g}" for x in tools[0])
        reasons.append(
            f"displacements were measured with a single tool vector ({single}) mm; use three that do not lie on one line"
        )
    if reasons:
        reasons.append("displacements along beams show no movement across them; distances or positions in space do")
    return reasons


def _planes(lines: Sequence[BeamLine]) -> Iterator[str]:
    """Pairs of linear axes whose plane holds no beam that both move along."""
    machine = lines[0].machine
    moved = np.array([np.ptp(line.seen.positions, axis=0) for line in lines])
    linear = [axis.letter for axis in machine.axes if axis.is_linear]
    for a, b in combinations(sorted(linear, key=LINEAR_AXES.index), 2):
        parts = moved[:, [machine.index(a), machine.index(b)]]
        if not np.any(np.all(parts > INCLINED * np.linalg.norm(moved, axis=1)[:, None], axis=1)):
            yield f"no beam is inclined in the plane of {a} and {b}; measure both diagonals of that plane"
