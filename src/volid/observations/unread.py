"""What lines of readings alone leave unread: error functions that no line shows, squareness that no artefact holds.

For campaigns that consist of lines only; other instruments see everything at once.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple

import numpy as np

from volid.campaign import Campaign, ObservationSet
from volid.model.iso230 import DIRECTIONS, LINEAR_AXES, ROTATIONS, TRANSLATIONS
from volid.model.jacobian import influence
from volid.model.kinematics import ROWS
from volid.observations.lines import lines_of_set

APART = 1.0  # mm: lines nearer than this show the same
LABELS = {"component", "line"}
_GIVEN_BY = {
    "positions": "linear optics give positioning",
    "straightness": "a straightedge or a square gives straightness",
    "rotations": "levels in pairs give turns about horizontal axes, angular optics or two lines apart those about the vertical",
}


class Read(NamedTuple):
    """A component that was read along a linear axis, and on which artefact, if any. `arms` (3,): of the axis's rotations [mm]."""

    component: str
    axis: str
    arms: np.ndarray
    alignment: str


def unread(campaign: Campaign) -> list[str]:
    """Which error functions no line shows, and which squareness no artefact, in words; nothing where other kinds take part."""
    if not all(set(s.labels) >= LABELS for s in campaign.sets):
        return []
    found = _Found(campaign, tuple(read for s in campaign.sets for read in _reads(s, campaign)))
    return [*found.functions(), *found.slopes(), *found.squareness()]


def _reads(observations: ObservationSet, campaign: Campaign) -> Iterator[Read]:
    """What the lines of a set read, line by line; lines along no axis, or along several at once, are left out."""
    for rows in lines_of_set(observations):
        moving = np.flatnonzero(np.ptp(observations.positions[rows], axis=0) > 0.0)
        letters = [campaign.machine.letters[i] for i in moving]
        if len(letters) == 1 and letters[0] in LINEAR_AXES:
            component = str(observations.labels["component"][rows[0]])
            q = observations.positions[rows[:1]].copy()
            q[:, moving] = 0.0  # lines are compared at one place of their own axis
            seen = influence(campaign.machine, q, observations.tool[rows[:1]])[0, DIRECTIONS.index(component)]
            arms = seen[ROWS * moving[0] + 3 : ROWS * moving[0] + 6]
            yield Read(component, letters[0], arms, str(observations.options.get("alignment", "")))


@dataclass(frozen=True)
class _Found:
    """All lines of a campaign."""

    campaign: Campaign
    reads: tuple[Read, ...]

    @property
    def axes(self) -> list[str]:
        return [a for a in LINEAR_AXES if a in self.campaign.machine.letters]

    def _missing(self, axis: str) -> list[str]:
        read = {r.component for r in self.reads if r.axis == axis}
        return [c for c in DIRECTIONS if c not in read and not (c in ROTATIONS and self._apart(c, axis))]

    def _apart(self, rotation: str, axis: str) -> bool:
        """Whether two lines along an axis read one direction so far apart that a turn shows in their difference."""
        k, own = ROTATIONS.index(rotation), [r for r in self.reads if r.axis == axis and r.component in TRANSLATIONS]
        pairs = [(one, other) for one, other in combinations(own, 2) if one.component == other.component]
        return any(abs(one.arms[k] - other.arms[k]) > APART for one, other in pairs)

    def functions(self) -> list[str]:
        """Functions that no line shows, and what gives them."""
        kinds: dict[str, list[str]] = {}
        for axis in self.axes:
            for c in self._missing(axis):
                kind = "rotations" if c in ROTATIONS else "positions" if c == axis else "straightness"
                kinds.setdefault(kind, []).append(f"E{c}{axis}")
        return [f"no line reads {', '.join(names)}; {_GIVEN_BY[kind]}" for kind, names in kinds.items()]

    def slopes(self) -> list[str]:
        """Turns that are read by lines apart on artefacts whose tilts no level compares."""
        levelled = [
            s for s in self.campaign.sets if (s.labels.get("placement", np.array(["machine"])) != "machine").any()
        ]
        names = []
        for axis in self.axes:
            read = {r.component for r in self.reads if r.axis == axis}
            names += [f"E{c}{axis}" for c in ROTATIONS if c not in read and self._apart(c, axis)]
        if levelled or not names:
            return []
        return [
            f"{', '.join(names)}: read by lines apart on artefacts whose tilts are unknown; a level on the artefact in every "
            "place (kind level, column placement) tells them apart"
        ]

    def squareness(self) -> list[str]:
        """Pairs of axes along which no artefact was read in one place."""
        held: dict[str, set[str]] = {}
        for r in self.reads:
            held.setdefault(r.alignment, set()).add(r.axis)
        held.pop("", None)
        pairs = [
            f"{a} and {b}" for a, b in combinations(self.axes, 2) if not any({a, b} <= axes for axes in held.values())
        ]
        if not pairs:
            return []
        return [
            f"no artefact in one place has lines along {', along '.join(pairs)}; both legs of a square tell their squareness"
        ]
