"""`level`: electronic levels, read in pairs, one on the body that moves and one for reference.

    value = tilt of the body `moving_on` - tilt of the body `reference_on` + zero of the line,   tilt = v · R F s,   s = v × c

v is the vertical, c the axis of the component, s the direction in which the level lies, F the placement of what it stands on,
and R the actual rotation from the frame of its body to that of the bed. A level counts positive when its body turns right-handed
about c; tilts of the whole machine on its ground are the same for both and fall out. R is exact. Signs follow from the bodies:
on a table that moves, the moving level sees minus the error motion, which is that of the tool relative to the workpiece. Where
neither body is stated, the moving level is on the side (workpiece or tool) whose axis moves, the reference on the other.
In a file, columns `moving` and `reference` may stand for `value`, and name this kind in a set of kind `component`; u is of their
difference.

A row may say that its moving level stands on an artefact, by the name of its alignment in the column `placement` (otherwise
"machine"): the level then sees the artefact's own turn, F = R(o), as well. That is how a square in two places is corrected for
its tilt (angle × height).

A level knows nothing of turns about the vertical, so the set states which axis that is. Not modelled: turns of a level with a
rotary axis under it, the sine of its angle for the angle itself (0.2 µrad at 10 mrad), the bending of a body under a weight.
CONVENTIONS 3, 6; ISO 230-1 (differential measurement of angular errors with levels).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from volid.backend.elementary import in_rows
from volid.campaign import Campaign, ObservationSet
from volid.exceptions import InputError
from volid.model.geometry import Vector, rotate_exactly
from volid.model.iso230 import LINEAR_AXES, ROTATIONS
from volid.model.kinematics import from_tool_frame, transform
from volid.model.machine import BED, TOOL, Machine
from volid.observations.base import Group, Kind, NuisanceTable
from volid.observations.level_bodies import MACHINE, LevelPart, LevelSettings, parts_of_line, parts_of_set
from volid.observations.lines import LINE, Line, check_components, check_lines, check_offset_per, lines_of_set
from volid.observations.placements import Placement
from volid.observations.response import MOTIONS
from volid.observations.unread import unread


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
        """Rows of a set by component, bodies and artefact, with the zero of every line. Raises `InputError` for a wrong row."""
        check_components(observations, ROTATIONS, "A, B and C (a level reads a rotation)")
        slots = np.zeros(len(observations), dtype=np.int64)
        for line in _lines(observations, campaign):
            slots[line.rows] = line.slots(table)[0]
        found: dict[LevelSettings, list[LevelPart]] = {}
        for part in parts_of_set(observations, campaign):
            found.setdefault(part.settings, []).append(part)
        return [_group(settings, own, slots, table) for settings, own in found.items()]

    def target_body(self, options: Mapping[str, Any]) -> str:
        """No tool takes part."""
        return BED

    def is_whole(self, observations: ObservationSet) -> bool:
        """Whether levels stand on artefacts, or the moving one is found from the axis that moves along its line."""
        stated = observations.options.get("moving_on") or observations.options.get("reference_on")
        return not stated or bool((observations.labels["placement"] != MACHINE).any())

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
                f"{observations.where(int(wrong[0]))}: component {about} is a turn about the vertical, {vertical}, which no "
                "level sees; expected the other two, or measure it with angular optics or a square in two places"
            )

    def check_values(self, observations: ObservationSet, campaign: Campaign) -> None:
        """Raises `InputError` when a value lies more than 1 mrad from the middle of its line, unless `large_errors`.

        On artefacts, from the middle of each: how far these tilt is open.
        """
        parts = parts_of_set(observations, campaign)
        check_lines(observations, [Line(observations, campaign.machine, p.rows, p.change) for p in parts])

    def advice(self, sets: Sequence[ObservationSet], campaign: Campaign) -> list[str]:
        """What no line reads."""
        return unread(campaign)


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


def _lines(observations: ObservationSet, campaign: Campaign) -> Iterator[Line]:
    """The lines of a set, each with what motions of the frames do to its readings."""
    for rows in lines_of_set(observations):
        change = np.zeros((len(rows), MOTIONS))
        for part in parts_of_line(observations, campaign, rows):
            change[np.isin(rows, part.rows)] = part.change
        yield Line(observations, campaign.machine, rows, change)


def _group(settings: LevelSettings, parts: list[LevelPart], zeros: np.ndarray, table: NuisanceTable) -> Group:
    """The rows of all parts with the same settings."""
    rows = np.concatenate([part.rows for part in parts])
    order = np.argsort(rows, kind="stable")
    slots, constants = zeros[rows][None], np.hstack([part.lying for part in parts])
    if settings.carried:
        placed = [np.tile(np.array(_turns(part, table))[:, None], (1, len(part.rows))) for part in parts]
        slots = np.vstack([slots, np.hstack(placed)])
    return Group(rows[order], settings, slots[:, order], constants[:, order])


def _turns(part: LevelPart, table: NuisanceTable) -> list[int]:
    """Numbers of the three rotations of the artefact. Raises `InputError` where no line tells the one that is read."""
    placement = Placement(part.campaign, part.campaign.alignment(part.placement))
    if not placement.moves[part.component]:
        letter = ROTATIONS[part.component]
        raise InputError(
            f"{part.where}: no line that is read on '{part.placement}' tells its turn about {LINEAR_AXES[part.component]}, which "
            f"the level gives ({letter}); leave these rows out"
        )
    return placement.slots(part.observations, table, translated=False)


LEVEL = Level()
