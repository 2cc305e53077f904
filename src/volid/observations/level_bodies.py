"""The two bodies that levels stand on, row by row, and what motions of the bodies' frames do to their readings (see `level`)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from volid.campaign import Campaign, ObservationSet
from volid.exceptions import InputError
from volid.model.iso230 import LINEAR_AXES, ROTATIONS
from volid.model.jacobian import tool_rotation_rows
from volid.model.kinematics import nominal_rotation
from volid.model.machine import BED, TOOL, WORKPIECE, Machine
from volid.observations.lines import lines_of_set
from volid.observations.response import MOTIONS

MACHINE = "machine"  # what a level stands on that is on no artefact


class LevelSettings(NamedTuple):
    """Static part: numbers of the rotation and of the vertical, bodies of both levels, whether the first is on an artefact."""

    component: int
    vertical: int
    moving: str
    reference: str
    carried: bool


@dataclass(frozen=True, eq=False)
class LevelPart:
    """Rows of one line whose levels stand on the same two bodies, and on the same artefact, if any.

    `rows` (m,): their numbers in the set; `line`: those of the whole line.
    """

    observations: ObservationSet
    campaign: Campaign
    rows: np.ndarray
    line: np.ndarray

    @property
    def component(self) -> int:
        """Number of the rotation that is read."""
        return ROTATIONS.index(str(self.observations.labels["component"][self.rows[0]]))

    @property
    def placement(self) -> str:
        """Name of the artefact's alignment, "" for none."""
        name = str(self.observations.labels["placement"][self.rows[0]])
        return "" if name == MACHINE else name

    @property
    def where(self) -> str:
        """The first row, in messages."""
        return self.observations.where(int(self.rows[0]))

    @cached_property
    def settings(self) -> LevelSettings:
        """Raises `InputError` for bodies that are unknown, or one and the same, or are not said."""
        machine, stated = self.campaign.machine, dict(self.observations.options)
        moving, reference = str(stated.get("moving_on", "")), str(stated.get("reference_on", ""))
        if self.placement:
            moving = self._alignment_body()
        moving = moving or self._moving_side(reference)
        reference = reference or opposite_end(machine, moving)
        known = (WORKPIECE, BED, TOOL, *machine.letters)
        for key, body in (("moving_on", moving), ("reference_on", reference)):
            if body not in known:
                raise InputError(
                    f"set '{self.observations.name}': {key} is '{body}'; expected one of {', '.join(known)}"
                )
        if machine.body_index(moving) == machine.body_index(reference):
            raise InputError(
                f"{self.where}: both levels stand on one body ({moving}), so that nothing is read; state moving_on and "
                "reference_on in the [[set]]"
            )
        vertical = LINEAR_AXES.index(stated["vertical"])
        return LevelSettings(self.component, vertical, moving, reference, bool(self.placement))

    def _alignment_body(self) -> str:
        names = [a.name for a in self.campaign.alignments]
        if self.placement not in names:
            raise InputError(
                f"{self.where}: placement '{self.placement}' is no [[alignment]]; there are {', '.join(names) or 'none'}; mend "
                "the name, or write machine where the level stands on the machine itself"
            )
        return self.campaign.alignment(self.placement).body

    def _moving_side(self, reference: str) -> str:
        """Workpiece or tool: the side whose axis moves along the line, or that of which the reference is not."""
        machine, positions = self.campaign.machine, self.observations.positions[self.line]
        if reference:
            return opposite_end(machine, reference)
        sides = {a.primed for i, a in enumerate(machine.axes) if np.ptp(positions[:, i]) > 0.0}
        if len(sides) != 1:
            found = "axes of the workpiece side and of the tool side move" if sides else "no axis moves"
            raise InputError(
                f"{self.where}: {found} along the line, so that it is open which level moves; state moving_on in the [[set]]: "
                "workpiece, tool or an axis letter"
            )
        return WORKPIECE if sides.pop() else TOOL

    @cached_property
    def lying(self) -> np.ndarray:
        """Nominal directions in which both levels lie, in the frames of their bodies, (6, m)."""
        settings = self.settings
        across = np.cross(np.eye(3)[settings.vertical], np.eye(3)[settings.component])
        frames = [self._turned(body) for body in (settings.moving, settings.reference)]
        return np.concatenate([np.einsum("mij,i->jm", frame, across) for frame in frames])

    @cached_property
    def change(self) -> np.ndarray:
        """What motions of the bodies' frames and a rotation of the tool do to the readings, (m, 9).

        All frames turn by ω, seen as ω at a level on an artefact or the tool, which do not turn along, and as ω - R ω at one on
        another body, R its nominal rotation.
        """
        settings, m = self.settings, len(self.rows)
        rows = np.zeros((m, MOTIONS))
        fixed = (1.0, settings.carried or settings.moving == TOOL), (-1.0, settings.reference == TOOL)
        for (sense, whole), body in zip(fixed, (settings.moving, settings.reference), strict=True):
            rows[:, 3 + self.component] += sense
            if not whole:
                rows[:, 3:6] -= sense * self._turned(body)[:, self.component]
            if body == TOOL:
                positions, tool = self.observations.positions[self.rows], self.observations.tool[self.rows]
                turn = tool_rotation_rows(self.campaign.machine, positions, tool)[:, 3 + self.component]
                rows[:, 6:] -= sense * turn
        return rows

    def _turned(self, body: str) -> np.ndarray:
        """Nominal rotation from the frame of a body to that of the bed, (m, 3, 3)."""
        machine, positions = self.campaign.machine, self.observations.positions[self.rows]
        return nominal_rotation(machine, positions, machine.body_index(body), machine.body_index(BED))


def opposite_end(machine: Machine, body: str) -> str:
    """The end of the chain on the other side of the bed; "" where `body` is the bed, or none of the machine's."""
    if body == BED or body not in (WORKPIECE, TOOL, *machine.letters):
        return ""
    on_tool = body == TOOL or (body != WORKPIECE and not machine.axes[machine.index(body)].primed)
    return WORKPIECE if on_tool else TOOL


def parts_of_line(observations: ObservationSet, campaign: Campaign, rows: np.ndarray) -> Iterator[LevelPart]:
    """The rows of a line by the artefact on which the moving level stands."""
    names = observations.labels["placement"][rows]
    for name in dict.fromkeys(names.tolist()):
        yield LevelPart(observations, campaign, rows[names == name], rows)


def parts_of_set(observations: ObservationSet, campaign: Campaign) -> list[LevelPart]:
    """The rows of a set by line and artefact."""
    return [part for rows in lines_of_set(observations) for part in parts_of_line(observations, campaign, rows)]
