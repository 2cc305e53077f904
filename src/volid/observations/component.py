"""`component`: one of the six components of the deviation (interferometer, level, autocollimator, straightedge, square).

value = component of the deviation + offset of the line, plus slope · (moving axis - its first position) when the
artefact's alignment is unknown. All runs of a line share its offset, or each has its own with `offset_per = "run"`, where the
instrument was zeroed before every run. Lines on one artefact that was placed once share its `alignment` instead (see
`alignments`): two legs of a square then determine the squareness of two axes, which slopes of their own would take away. Levels
that are read in pairs are the kind `level`. CONVENTIONS 6; ISO 230-1 8, 9, 10.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from volid.backend.elementary import in_rows
from volid.campaign import Campaign, ObservationSet
from volid.exceptions import InputError
from volid.model.geometry import Vector
from volid.model.iso230 import DIRECTIONS, ROTATIONS
from volid.model.jacobian import rigid_motion_rows, tool_rotation_rows
from volid.model.kinematics import deviation
from volid.model.machine import Machine
from volid.observations.alignments import (
    OPTIONS,
    AlignedSettings,
    aligned_group,
    check_aligned,
    is_aligned,
    predict_aligned,
    slopes_apart,
)
from volid.observations.base import LIGHT, Group, Kind, NuisanceTable, Part, Positioning
from volid.observations.lines import LINE, Line, check_components, check_lines, check_offset_per, lines_of_set
from volid.observations.one_axis import by_component
from volid.observations.placements import alignment_starts
from volid.observations.unread import unread


class ComponentSettings(NamedTuple):
    """Static part: the row of the deviation that is read, and whether the artefact's slope is unknown."""

    component: int
    slope: bool


class Component(Kind):
    """One component of the deviation, as the docstring of the module describes it."""

    name = "component"
    readings = ("value",)
    doc = "component of the deviation + offset of the line (+ slope of the artefact) [mm or rad]"
    unit = "mm or rad"
    labels: Mapping[str, str | None] = {"component": None, "line": "1", "run": "1"}
    choices: Mapping[str, tuple[str, ...]] = {"component": tuple(DIRECTIONS)}
    options: Mapping[str, Any] = {"slope": False}
    optional: Mapping[str, Any] = {**OPTIONS, "offset_per": LINE, "interferometer": False}
    still_by = ("line",)
    tested_by = ("line", "component")
    named_by = ("component", "line")

    @staticmethod
    def predict(
        machine: Machine,
        settings: ComponentSettings | AlignedSettings,
        q: Any,
        tool: Vector,
        errors: Any,
        slots: Any,
        constants: Any,
    ) -> Any:
        """Predicted values, shape (1, m) [mm or rad]."""
        if isinstance(settings, AlignedSettings):
            return predict_aligned(machine, settings, q, tool, errors, slots, constants)
        value = deviation(machine, q, tool, errors)[settings.component] + slots[0]
        if settings.slope:
            value = value + slots[1] * constants[0]
        return in_rows([value], np.shape(q[0]))

    def groups(self, observations: ObservationSet, campaign: Campaign, table: NuisanceTable) -> list[Group]:
        """Rows of a set by component, with one offset (and slope) per line. Raises `InputError` for an unknown component."""
        check_components(observations, DIRECTIONS, "X, Y, Z (mm) and A, B, C (rad)")
        if is_aligned(observations):
            return [aligned_group(observations, campaign, table)]
        found: dict[str, list[Line]] = {}
        for rows in lines_of_set(observations):
            line = _line(observations, campaign, rows)
            found.setdefault(line.component, []).append(line)
        return [_group(component, lines, table) for component, lines in found.items()]

    def starts(self, campaign: Campaign) -> dict[Any, float]:
        """Placements of artefacts and offsets of their lines."""
        return alignment_starts(campaign)

    def components(self, observations: ObservationSet) -> np.ndarray | None:
        """Row of the deviation that every reading is."""
        return np.array([DIRECTIONS.index(str(c)) for c in observations.labels["component"]], dtype=np.int64)

    def positioning(self, observations: ObservationSet, campaign: Campaign) -> Iterator[Positioning]:
        """Lines that read the component along or about the axis that moves."""
        components = self.components(observations)
        return iter(()) if components is None else by_component(observations, campaign, components)

    def check(self, observations: ObservationSet) -> None:
        """Raises `InputError` for options that do not fit each other or the lines."""
        check_offset_per(observations)
        check_aligned(observations)

    def is_whole(self, observations: ObservationSet) -> bool:
        """Whether lines have an artefact's placement, a slope or a path of light, which count from places of the whole line."""
        options = observations.options
        return is_aligned(observations) or bool(options.get("slope", False) or options.get("interferometer", False))

    def is_pinned(self, observations: ObservationSet) -> bool:
        """Whether there is a form error at every place of an artefact."""
        return is_aligned(observations) and float(observations.options.get("form_u", 0.0)) > 0.0

    def lengths(self, observations: ObservationSet) -> np.ndarray:
        """The values; with `interferometer` what it counts, the travel from the first reading of the line plus the value."""
        if not observations.options.get("interferometer", False):
            return super().lengths(observations)
        return observations.readings + _travelled(observations)[:, None]

    def lengths_of(self, observations: ObservationSet) -> str:
        """Paths in light, where an interferometer counts them."""
        return LIGHT if observations.options.get("interferometer", False) else ""

    def advice(self, sets: Sequence[ObservationSet], campaign: Campaign) -> list[str]:
        """Which lines have slopes of their own although one artefact may have held them all, and what no line reads."""
        return [*(said for s in sets if (said := slopes_apart(s, campaign.machine))), *unread(campaign)]

    def unit_at(self, observations: ObservationSet, row: int, i: int) -> str:
        """mm or rad, as the component of the row is."""
        return "rad" if observations.labels["component"][row] in ROTATIONS else "mm"

    def parts(self, observations: ObservationSet) -> Iterator[Part]:
        """Translations and rotations apart."""
        components = observations.labels["component"]
        for unit, letters in (("mm", DIRECTIONS[:3]), ("rad", ROTATIONS)):
            rows = np.isin(components, letters)
            if rows.any():
                found = tuple(sorted(set(components[rows].tolist())))
                yield Part(f"{self.name} {''.join(found)}", unit, rows, found)

    def check_values(self, observations: ObservationSet, campaign: Campaign) -> None:
        """Raises `InputError` when a value lies more than 1 mm or 1 mrad from the middle of its line, or a free slope.

        Not where the set says `large_errors`. An interferometer's component is along the axis that moves.
        """
        _check_travel(observations, campaign.machine)
        lines = [_line(observations, campaign, rows) for rows in lines_of_set(observations)]
        check_lines(observations, lines, aligned=is_aligned(observations))


def _line(observations: ObservationSet, campaign: Campaign, rows: np.ndarray) -> Line:
    """Readings of one component along one line, with what motions of the frames do to them."""
    machine, k = campaign.machine, DIRECTIONS.index(str(observations.labels["component"][rows[0]]))
    positions, tool = observations.positions[rows], observations.tool[rows]
    frame = rigid_motion_rows(machine, positions, tool)[:, k]
    change = np.hstack([frame, -tool_rotation_rows(machine, positions, tool)[:, k]])
    return Line(observations, machine, rows, change, bool(observations.options.get("slope", False)))


def _group(component: str, lines: list[Line], table: NuisanceTable) -> Group:
    """All rows that read one component, with an offset (and slope) per line."""
    slope = lines[0].slope
    rows = np.concatenate([line.rows for line in lines])
    slots = np.hstack([line.slots(table) for line in lines])
    arm = np.concatenate([line.arm if slope else np.zeros(len(line.rows)) for line in lines])[None]
    order = np.argsort(rows, kind="stable")
    settings = ComponentSettings(DIRECTIONS.index(component), slope)
    return Group(rows[order], settings, slots[:, order], arm[:, order])


def _check_travel(observations: ObservationSet, machine: Machine) -> None:
    """Raises `InputError` for a path of light that is not along the axis that moves."""
    if not observations.options.get("interferometer", False):
        return
    labels, letters = observations.labels, np.array(machine.letters)
    for line in dict.fromkeys(labels["line"]):
        rows = np.flatnonzero(labels["line"] == line)
        moving = letters[np.ptp(observations.positions[rows], axis=0) > 0.0].tolist()
        wrong = rows[labels["component"][rows] != (moving[0] if len(moving) == 1 else "")]
        if wrong.size:
            i = int(wrong[0])
            raise InputError(
                f"{observations.where(i)}: component {labels['component'][i]} on a line along {', '.join(moving) or 'no axis'}, "
                "and the set says interferometer = true, a path of light along the one axis that moves; leave it out for "
                "straightness, angles, and other instruments"
            )


def _travelled(observations: ObservationSet) -> np.ndarray:
    """Travel of the axis that a component is along, from the first reading of the line, (m,) [mm]; the sign is the axis's."""
    positions, labels = observations.positions, observations.labels
    result = np.zeros(len(observations))
    names = np.char.add(np.char.add(labels["line"].astype(str), " "), labels["component"].astype(str))
    for name in dict.fromkeys(names):
        rows = np.flatnonzero(names == name)
        span = np.ptp(positions[rows], axis=0)
        moving = int(np.argmax(span))
        result[rows] = positions[rows, moving] - positions[rows[0], moving]
    return result


COMPONENT = Component()
