"""What has been done to a program, in numbers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from volid.controllers.programs.correction import Corrected
from volid.controllers.programs.lines import Lines
from volid.controllers.programs.motion import AS_IS, CUT, RAPID, Motion
from volid.controllers.programs.setting import ProgramSetting
from volid.controllers.programs.writer import Writer


class Counted(NamedTuple):
    """What has been done to a program, in numbers.

    `blocks`: lines before and after. `arcs`, `lines`, `rapids`: motions that were corrected. `as_they_are`: numbers of the lines
    whose rapid was not. `taken_up`: blocks that lead to the corrected start, after reversal or a rapid. `largest`: largest
    |correction| of X, Y, Z [mm]. `chord`: bound of the distance of the new path from the corrected path [mm]. `outside`:
    numbers of the lines with a point outside the tables and grids. `length`: of motions in feed [mm]. `minutes`: time of those
    whose feed is known. `shortest`: time of the shortest block in feed [s], NaN where no feed is known.
    """

    blocks: tuple[int, int]
    arcs: int
    lines: int
    rapids: int
    as_they_are: tuple[int, ...]
    taken_up: int
    largest: tuple[float, float, float]
    chord: float
    outside: tuple[int, ...]
    length: float
    minutes: float
    shortest: float


def counted(
    count: tuple[int, int], motions: Sequence[Motion], found: Corrected, writer: Writer, setting: ProgramSetting
) -> Counted:
    """The numbers of a corrected program; `count`: its blocks before and after."""
    lines = found.lines
    moved = np.abs(found.last - lines.end).max(axis=0) if len(lines.owner) else np.zeros(3)
    arc_bound = np.array([m.bound for m in motions])[lines.owner] if len(lines.owner) else np.zeros(0)
    bound = (found.bound + arc_bound).max(initial=0.0) + setting.rounding
    cutting = np.array([m.act == CUT for m in motions], dtype=bool)[lines.owner] if motions else np.zeros(0, dtype=bool)
    length, minutes = np.linalg.norm(lines.end - lines.start, axis=1)[cutting], _minutes(motions, lines)[cutting]
    numbers = sorted({motions[i].index + 1 for i in lines.owner[found.outside]})
    acts = [m.act for m in motions]
    arcs = sum(m.arc for m in motions)
    known = minutes[np.isfinite(minutes) & (length > 0.0)]
    x, y, z = moved.tolist()
    return Counted(
        count, arcs, acts.count(CUT) - arcs, acts.count(RAPID), tuple(m.index + 1 for m in motions if m.act == AS_IS),
        writer.taken_up, (x, y, z), float(bound), tuple(numbers), float(length.sum()), float(known.sum()),
        60.0 * float(known.min()) if len(known) else float("nan"),
    )  # fmt: skip


def _minutes(motions: Sequence[Motion], lines: Lines) -> np.ndarray:
    """Time of each line at its feed, NaN where the feed is not known [min]."""
    length = np.linalg.norm(lines.end - lines.start, axis=1)
    feed = np.array([m.feed if m.feed > 0.0 else np.nan for m in motions])
    total = np.bincount(lines.owner, length, minlength=len(motions)) if len(lines.owner) else np.zeros(len(motions))
    inverse = np.array([m.inverse if m.inverse > 0.0 else np.nan for m in motions])
    by_time = length / np.where(total > 0.0, total, 1.0)[lines.owner] / inverse[lines.owner]
    return np.asarray(np.where(np.isnan(by_time), length / feed[lines.owner], by_time))
