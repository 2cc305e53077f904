"""The unknown placement of an artefact: which of its rotations and translations move readings, and start values of them."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from volid.campaign import Alignment, Campaign, ObservationSet
from volid.model.machine import TOOL
from volid.observations.aligned_lines import alignment_keys, lines_of
from volid.observations.base import NuisanceTable
from volid.observations.response import PlaceOf, TurnOf
from volid.observations.stations import Seen

ROTATION_SPREAD, OFFSET_SPREAD = 2e-3, 0.1  # rad, mm: how far a virtual artefact is off its nominal place
LEVER = 1e-6  # mm: a rotation with a shorter one moves no reading
ALIKE = 1e-9  # of what an unknown does to readings: if others do all of it but this, they stand for it


class Placement:
    """The unknown placement of an artefact, and which of its rotations and translations move any reading at all."""

    def __init__(self, campaign: Campaign, alignment: Alignment) -> None:
        self.campaign, self.alignment = campaign, alignment
        sets = [s for s in campaign.sets if s.options.get("alignment") == alignment.name and "component" in s.labels]
        self.lines = [line for s in sets for line in lines_of(s, campaign)]
        self.own_offset = [bool(line.observations.options.get("offset", True)) for line in self.lines]

    @cached_property
    def centre(self) -> np.ndarray:
        """Mean of the points of all lines, (3,) [mm]."""
        return np.mean([np.asarray(line.line.point) for line in self.lines], axis=0)

    @cached_property
    def design(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """∂value/∂(rotations, translations) of all readings at the nominal placement, (n, 6), readings (n,), and line numbers."""
        blocks = []
        for line, own in zip(self.lines, self.own_offset, strict=True):
            normal = np.tile(line.line.normal, (len(line.rows), 1)) / line.across[:, None]
            arm = line.levers if own else line.levers + np.cross(normal, np.asarray(line.line.point) - self.centre)
            blocks.append(np.hstack([arm, 0.0 * normal if own else -normal]))
        numbers = np.repeat(np.arange(len(self.lines)), [len(line.rows) for line in self.lines])
        return np.concatenate(blocks), np.concatenate([line.seen.readings[:, 0] for line in self.lines]), numbers

    @cached_property
    def moves(self) -> np.ndarray:
        """Which of the six are unknown, bool (6,): those that do to readings what no other does, translations before rotations.

        The others are held at 0: a rotation that only shifts lines which have offsets, or a placement, to follow it.
        """
        if not self.lines:
            return np.zeros(6, dtype=bool)
        design, _, numbers = self.design
        kept = [np.where(numbers == i, 1.0, 0.0) for i, own in enumerate(self.own_offset) if own]
        moves = np.zeros(6, dtype=bool)
        for k in (3, 4, 5, 0, 1, 2):
            column = design[:, k]
            others = np.stack(kept, axis=1) if kept else np.zeros((len(column), 0))
            left = column - others @ np.linalg.lstsq(others, column, rcond=1e-9)[0]
            moves[k] = np.linalg.norm(left) > ALIKE * max(float(np.linalg.norm(column)), LEVER)
            kept += [column] if moves[k] else []
        return moves

    def slots(self, observations: ObservationSet, table: NuisanceTable, translated: bool) -> list[int]:
        """Numbers of the rotations and, where lines have no offsets of their own, the translations."""
        name, body, moves = self.alignment.name, self.alignment.body, self.moves
        turns, shifts = (alignment_keys(self.alignment, letters) for letters in ("ABC", "XYZ"))
        found = [
            table.index(
                turns[i],
                f"alignment {name} {c}",
                "rad",
                prior_u=np.inf if moves[i] else 0.0,
                spread=ROTATION_SPREAD,
                response=TurnOf(body, of=turns, component=i, sense=1.0),
            )
            for i, c in enumerate("ABC")
        ]
        if not translated:
            return found
        seen = Seen(observations, self.campaign, np.arange(len(observations)), body, TOOL)
        offset = tuple(self.centre.tolist())
        return found + [
            table.index(
                shifts[i],
                f"alignment {name} {c}",
                prior_u=np.inf if moves[3 + i] else 0.0,
                spread=OFFSET_SPREAD,
                response=PlaceOf(body, seen.not_followed, shifts, i, offset, seen.tool, seen.u),
            )
            for i, c in enumerate("XYZ")
        ]


def alignment_starts(campaign: Campaign) -> dict[Any, float]:
    """Start values of all placements and their lines' offsets: a linear fit to readings of a machine without errors."""
    starts: dict[Any, float] = {}
    used = {str(s.options.get("alignment", "")) for s in campaign.sets if "component" in s.labels}
    for alignment in campaign.alignments if used else ():
        if alignment.name in used:
            starts |= _fitted(Placement(campaign, alignment))
    return starts


def _fitted(placement: Placement) -> dict[Any, float]:
    design, values, numbers = placement.design
    seen, own = np.isfinite(values), np.flatnonzero(placement.own_offset)
    if not seen.any():
        return {}
    columns = [np.flatnonzero(placement.moves), own]
    whole = np.hstack([design[:, columns[0]], numbers[:, None] == own])
    found = np.linalg.lstsq(whole[seen], values[seen], rcond=1e-9)[0]
    keys = alignment_keys(placement.alignment, "ABCXYZ")
    lines = [placement.lines[i] for i in own]
    names = [keys[i] for i in columns[0]]
    names += [line.offset_key for line in lines]
    return dict(zip(names, found.tolist(), strict=True))
