"""`level`: electronic levels, read in pairs, one on the body that moves and one for reference.

    value = tilt of the body `moving_on` - tilt of the body `reference_on` + zero of the line,   tilt = v · R F s,   s = v × c

v is the vertical, c the axis of the component, s the direction in which the level lies, F the placement of what it stands on, and R
the actual rotation from the frame of its body to that of the bed. A level counts positive when its body turns right-handed about
c; tilts of the whole machine on its ground are the same for both and fall out. R is exact. The signs follow from the bodies: on a table that moves, the moving level sees minus the error motion, which is that of the tool relative to the
workpiece. Where neither body is stated, the moving level is on the side (workpiece or tool) whose axis moves, the reference on the
other. In a file, columns `moving` and `reference` may stand for `value`, and name this kind in a set of kind `component`.

A row may say that its moving level stands on an artefact, by the name of its alignment in the column `placement` (otherwise
"machine"): the level then sees the artefact's own turn, F = R(o), as well. That is how a square in two places is corrected for
its tilt (angle × height).

A level knows nothing of turns about the vertical, so the set states which axis that is. Not modelled: turns of a level with a
rotary axis under it, the sine of its angle for the angle itself (0.2 µrad at 10 mrad), the bending of a body under a weight. CONVENTIONS 3, 6; ISO 230-1
(differential measurement of angular errors with levels).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from volid.backend.elementary import in_rows
from volid.campaign import Campaign, ObservationSet
from volid.exceptions import InputError
from volid.model.geometry import Vector, rotate_exactly
from volid.model.iso230 import LINEAR_AXES, ROTATIONS
from volid.model.jacobian import tool_rotation_rows
from volid.model.kinematics import from_tool_frame, nominal_rotation, transform
from volid.model.machine import BED, TOOL, WORKPIECE, Machine
from volid.observations.base import Group, Kind, NuisanceTable
from volid.observations.lines import LINE, Line, check_components, check_lines, check_offset_per, lines_of_set
from volid.observations.placements import Placement
from volid.observations.response import MOTIONS
from volid.observations.unread import unread


MACHINE = "machine"  # what a level stands on that is on no artefact


class LevelSettings(NamedTuple):
    """Static part: numbers of the rotation and of the vertical, bodies of both levels, whether the first is on an artefact."""

    component: int
    vertical: int
    moving: str
    reference: str
    carried: bool


class Level(Kind):
    """Two levels, as the docstring of the module describes them."""

    name = "level"
    readings = ("value",)
    pair = ("moving", "reference")
    pair_in = "component"
    doc = "rotation of one body - rotation of another + zero of the levels [rad]"
    unit = "rad"
    labels: Mapping[str, str | None] = {"component": None, "line": "1", "run": "1", "placement": MACHINE}
    choices: Mapping[str, tuple[str, ...]] = {"component": tuple(ROTATIONS)}
    options: Mapping[str, Any] = {"vertical": None}
    optional: Mapping[str, Any] = {"moving_on": "", "reference_on": "", "offset_per": LINE}
    still_by = ("line",)
    tested_by = ("line", "component")
    named_by = ("component", "line")

    @staticmethod
    def predict(
        machine: Machine, settings: LevelSettings, q: Any, tool: Vector, errors: Any, slots: Any, constants: Any
    ) -> Any:
        """Predicted values, shape (1, m) [rad]."""
        placed = slots[1:4] if settings.carried else None
        moving = _tilt(machine, settings, settings.moving, q, errors, constants[:3], placed)
        reference = _tilt(machine, settings, settings.reference, q, errors, constants[3:6], None)
        return in_rows([moving - reference + slots[0]], np.shape(q[0]))

    def groups(self, observations: ObservationSet, campaign: Campaign, table: NuisanceTable) -> list[Group]:
        """Rows of a set by component, bodies and artefact, with the zero of every line. Raises `InputError` naming a wrong row."""
        check_components(observations, ROTATIONS, "A, B and C (a level reads a rotation)")
        slots = np.zeros(len(observations), dtype=np.int64)
        for line in _lines(observations, campaign):
            slots[line.rows] = line.slots(table)[0]
        parts = [part for rows in lines_of_set(observations) for part in _parts(observations, campaign, rows)]
        found: dict[LevelSettings, list[_Part]] = {}
        for part in parts:
            found.setdefault(part.settings, []).append(part)
        return [_group(settings, own, slots, table) for settings, own in found.items()]

    def target_body(self, options: Mapping[str, Any]) -> str:
        """No tool takes part."""
        return BED

    def check(self, observations: ObservationSet) -> None:
        """Raises `InputError` for options that do not fit each other, or a turn about the vertical."""
        check_offset_per(observations)
        vertical = observations.options.get("vertical")
        if vertical not in LINEAR_AXES:
            raise InputError(
                f"set '{observations.name}': vertical is {vertical!r}; expected the axis that is vertical: X, Y or Z"
            )
        about = ROTATIONS[LINEAR_AXES.index(vertical)]
        wrong = np.flatnonzero(observations.labels["component"] == about)
        if wrong.size:
            raise InputError(
                f"{observations.where(int(wrong[0]))}: component {about} is a turn about the vertical, {vertical}, which no level "
                "sees; expected the other two, or measure it with angular optics or a square in two places"
            )

    def check_values(self, observations: ObservationSet, campaign: Campaign) -> None:
        """Raises `InputError` when a value lies more than 1 mrad from the middle of its line, unless `large_errors`.

        On artefacts, from the middle of each: how far these tilt is open.
        """
        parts = [part for rows in lines_of_set(observations) for part in _parts(observations, campaign, rows)]
        check_lines(observations, [Line(observations, campaign.machine, p.rows, p.change) for p in parts])

    def advice(self, sets: Sequence[ObservationSet], campaign: Campaign) -> list[str]:
        """What no line reads."""
        return unread(campaign)


@dataclass(frozen=True, eq=False)
class _Part:
    """Rows of one line whose levels stand on the same two bodies, and on the same artefact, if any."""

    observations: ObservationSet
    campaign: Campaign
    rows: np.ndarray
    line: np.ndarray

    @property
    def component(self) -> int:
        return ROTATIONS.index(str(self.observations.labels["component"][self.rows[0]]))

    @property
    def placement(self) -> str:
        """Name of the artefact's alignment, "" for none."""
        name = str(self.observations.labels["placement"][self.rows[0]])
        return "" if name == MACHINE else name

    @property
    def where(self) -> str:
        return self.observations.where(int(self.rows[0]))

    @cached_property
    def settings(self) -> LevelSettings:
        """Raises `InputError` for bodies that are unknown, or one and the same, or are not said."""
        machine, stated = self.campaign.machine, dict(self.observations.options)
        moving, reference = str(stated.get("moving_on", "")), str(stated.get("reference_on", ""))
        if self.placement:
            moving = self._alignment_body()
        moving = moving or self._moving_side(reference)
        reference = reference or _opposite(machine, moving)
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
                f"{self.where}: placement '{self.placement}' is no [[alignment]]; there are {', '.join(names) or 'none'}; mend the "
                "name, or write machine where the level stands on the machine itself"
            )
        return self.campaign.alignment(self.placement).body

    def _moving_side(self, reference: str) -> str:
        """Workpiece or tool: the side whose axis moves along the line, or that of which the reference is not."""
        machine, positions = self.campaign.machine, self.observations.positions[self.line]
        if reference:
            return _opposite(machine, reference)
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


def _tilt(
    machine: Machine, settings: LevelSettings, body: str, q: Any, errors: Any, lying: Any, placed: Any | None
) -> Any:
    """v · R F s of a level on a body, (m,); `lying`: s; `placed`: the rotation vector of F, if any."""
    x: Vector = lying[0], lying[1], lying[2]
    if placed is not None:
        x = rotate_exactly((placed[0], placed[1], placed[2]), x)
    if body == TOOL:
        x = from_tool_frame(machine, errors, x, True)
    start, bed = machine.body_index(body), machine.body_index(BED)
    return transform(machine, q, errors, x, start=start, stop=bed, is_vector=True)[settings.vertical]


def _opposite(machine: Machine, body: str) -> str:
    """The end of the chain on the other side of the bed; "" where `body` is the bed, or none of the machine's."""
    if body == BED or body not in (WORKPIECE, TOOL, *machine.letters):
        return ""
    on_tool = body == TOOL or (body != WORKPIECE and not machine.axes[machine.index(body)].primed)
    return WORKPIECE if on_tool else TOOL


def _parts(observations: ObservationSet, campaign: Campaign, rows: np.ndarray) -> Iterator[_Part]:
    """The rows of a line by the artefact on which the moving level stands."""
    names = observations.labels["placement"][rows]
    for name in dict.fromkeys(names.tolist()):
        yield _Part(observations, campaign, rows[names == name], rows)


def _lines(observations: ObservationSet, campaign: Campaign) -> Iterator[Line]:
    """The lines of a set, each with what motions of the frames do to its readings."""
    for rows in lines_of_set(observations):
        change = np.zeros((len(rows), MOTIONS))
        for part in _parts(observations, campaign, rows):
            change[np.isin(rows, part.rows)] = part.change
        yield Line(observations, campaign.machine, rows, change)


def _group(settings: LevelSettings, parts: list[_Part], zeros: np.ndarray, table: NuisanceTable) -> Group:
    """The rows of all parts with the same settings."""
    rows = np.concatenate([part.rows for part in parts])
    order = np.argsort(rows, kind="stable")
    slots, constants = zeros[rows][None], np.hstack([part.lying for part in parts])
    if settings.carried:
        placed = [np.tile(np.array(_turns(part, table))[:, None], (1, len(part.rows))) for part in parts]
        slots = np.vstack([slots, np.hstack(placed)])
    return Group(rows[order], settings, slots[:, order], constants[:, order])


def _turns(part: _Part, table: NuisanceTable) -> list[int]:
    """Numbers of the three rotations of the artefact. Raises `InputError` where no line is read that tells the one of the level."""
    placement = Placement(part.campaign, part.campaign.alignment(part.placement))
    if not placement.moves[part.component]:
        letter = ROTATIONS[part.component]
        raise InputError(
            f"{part.where}: no line that is read on '{part.placement}' tells its turn about {LINEAR_AXES[part.component]}, which the "
            f"level gives ({letter}); leave these rows out"
        )
    return placement.slots(part.observations, table, translated=False)


LEVEL = Level()
