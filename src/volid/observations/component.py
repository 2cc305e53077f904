"""`component`: one of the six components of the deviation (interferometer, level, autocollimator, straightedge, square).

value = component of the deviation + offset of the line, plus slope · (moving axis - its first position) when the
artefact's alignment is unknown. Lines on one artefact that was placed once share its `alignment` instead (see `alignments`):
two legs of a square then determine the squareness of two axes, which slopes of their own would take away.
CONVENTIONS 6; ISO 230-1 8, 9, 10.
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
from volid.observations.base import LIGHT, Group, Kind, NuisanceTable, Part, takes_large_errors
from volid.observations.placements import alignment_starts
from volid.observations.response import Linear, Remainder, remainder

SPREAD = {"mm": 0.01, "rad": 1e-4}  # of a line's offset; a virtual instrument draws from it
SLOPE_SPREAD = {"mm": 1e-4, "rad": 1e-7}  # per mm of travel
LARGEST_VALUE = {
    "mm": 1.0,
    "rad": 0.001,
}  # above, the user is asked: few machines are so bad, and many columns are in µm or arcseconds
_UNFOLLOWED = (
    "the new datum turns the workpiece frame, and the readings of line {line} of set '{name}' ({component}) would change by more "
    "than its offset{slope} can follow. {advice} fit in that datum: [datum] of the machine file"
)
_STRAIGHT = {
    False: "Set slope = true if the artefact's alignment is unknown, or",
    True: "Read along one linear axis, or",
}


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
    labels: Mapping[str, str | None] = {"component": None, "line": "1"}
    choices: Mapping[str, tuple[str, ...]] = {"component": tuple(DIRECTIONS)}
    options: Mapping[str, Any] = {"slope": False}
    optional: Mapping[str, Any] = {**OPTIONS, "interferometer": False}
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
        components, lines = observations.labels["component"], observations.labels["line"]
        wrong = np.flatnonzero(~np.isin(components, DIRECTIONS))
        if wrong.size:
            i = int(wrong[0])
            raise InputError(
                f"{observations.where(i)}: component '{components[i]}' is none of X, Y, Z (mm) and A, B, C (rad)"
            )
        if is_aligned(observations):
            return [aligned_group(observations, campaign, table)]
        slope = bool(observations.options.get("slope", False))
        result = []
        for component in dict.fromkeys(components):
            rows = np.flatnonzero(components == component)
            slots = np.zeros((2 if slope else 1, len(rows)), dtype=np.int64)
            arm = np.zeros((1, len(rows)))
            for line in dict.fromkeys(lines[rows]):
                here = np.flatnonzero(lines[rows] == line)
                this = _Line(observations, campaign.machine, rows[here], str(line), str(component), slope)
                slots[:, here] = np.array(this.slots(table))[:, None]
                arm[0, here] = this.arm if slope else 0.0
            settings = ComponentSettings(DIRECTIONS.index(component), slope)
            result.append(Group(rows, settings, slots, arm))
        return result

    def starts(self, campaign: Campaign) -> dict[Any, float]:
        """Placements of artefacts and offsets of their lines."""
        return alignment_starts(campaign)

    def check(self, observations: ObservationSet) -> None:
        """Raises `InputError` for options of an alignment that do not fit each other or the lines."""
        check_aligned(observations)

    def is_whole(self, observations: ObservationSet) -> bool:
        """Whether lines have the placement of an artefact or a path of light, which count from places of the whole line."""
        return is_aligned(observations) or bool(observations.options.get("interferometer", False))

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
        """Which lines have slopes of their own although one artefact may have held them all."""
        return [said for s in sets if (said := slopes_apart(s, campaign.machine))]

    def unit_at(self, observations: ObservationSet, row: int, i: int) -> str:
        """mm or rad, as the component of the row is."""
        return "rad" if observations.labels["component"][row] in ROTATIONS else "mm"

    def parts(self, observations: ObservationSet) -> Iterator[Part]:
        """Translations and rotations apart."""
        components = observations.labels["component"]
        for unit, letters in (("mm", DIRECTIONS[:3]), ("rad", ROTATIONS)):
            rows = np.isin(components, letters)
            if rows.any():
                yield Part(f"{self.name} {''.join(sorted(set(components[rows])))}", unit, rows)

    def check_values(self, observations: ObservationSet, campaign: Campaign) -> None:
        """Raises `InputError` when a value lies more than 1 mm or 1 mrad from the middle of its line, or a free slope.

        Not where the set says `large_errors`. An interferometer's component is along the axis that moves.
        """
        _check_travel(observations, campaign.machine)
        if takes_large_errors(observations):
            return
        components = observations.labels["component"]
        for line in np.unique(observations.labels["line"]):
            for component in np.unique(components):
                rows = np.flatnonzero((observations.labels["line"] == line) & (components == component))
                if len(rows):
                    _check_line(observations, rows, self._of(observations, campaign, rows))

    def _of(self, observations: ObservationSet, campaign: Campaign, rows: np.ndarray) -> _Line:
        labels, slope = observations.labels, bool(observations.options.get("slope", False))
        line, component = str(labels["line"][rows[0]]), str(labels["component"][rows[0]])
        return _Line(observations, campaign.machine, rows, line, component, slope)


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


class _Line:
    """Readings of one component along one line: its unknowns and how they answer a motion of the workpiece frame.

    A rigid motion (t, ω) of the workpiece frame, and a rotation h of the tool, change reading i by M_i · (t, ω, h). Offset a
    and slope b follow it as far as M_i = a + b · arm_i; what remains makes a transformation inexact.
    """

    def __init__(
        self, observations: ObservationSet, machine: Machine, rows: np.ndarray, line: str, component: str, slope: bool
    ) -> None:
        self.observations, self.machine, self.rows, self.slope = observations, machine, rows, slope
        self.line, self.component = line, component
        self.unit = "rad" if component in ROTATIONS else "mm"

    @property
    def arm(self) -> np.ndarray:
        """Position of the moving axis from its first value on the line, shape (m,)."""
        positions = self.observations.positions[self.rows]
        moving = int(np.argmax(np.ptp(positions, axis=0)))
        return np.asarray(positions[:, moving] - positions[0, moving])

    def slots(self, table: NuisanceTable) -> list[int]:
        """Numbers of the line's offset and, where it is unknown, slope."""
        name = f"{self.observations.name} line {self.line} {self.component}"
        (offset, slope), not_followed = self._responses()
        key = (self.observations.name, self.line, self.component)
        result = [
            table.index(
                ("offset", *key),
                f"offset {name}",
                self.unit,
                spread=SPREAD[self.unit],
                response=Linear(not_followed=not_followed, constant=offset),
            )
        ]
        if self.slope:
            response = Linear(constant=slope)
            spread = SLOPE_SPREAD[self.unit]
            result.append(
                table.index(("slope", *key), f"slope {name}", f"{self.unit}/mm", spread=spread, response=response)
            )
        return result

    def _responses(self) -> tuple[tuple[tuple[float, ...], tuple[float, ...]], Remainder | None]:
        """Rows of offset and slope by least squares over the line, and the change that they cannot follow."""
        positions, tool = self.observations.positions[self.rows], self.observations.tool[self.rows]
        k = DIRECTIONS.index(self.component)
        frame = rigid_motion_rows(self.machine, positions, tool)[:, k]
        change = np.hstack([frame, -tool_rotation_rows(self.machine, positions, tool)[:, k]])
        design = np.stack([np.ones(len(self.rows)), self.arm], axis=1)
        design = design if self.slope else design[:, :1]
        found = np.linalg.lstsq(design, change, rcond=1e-12)[0]
        reason = _UNFOLLOWED.format(
            line=self.line,
            name=self.observations.name,
            component=self.component,
            slope=" and slope" if self.slope else "",
            advice=_STRAIGHT[self.slope],
        )
        residual = change - design @ found
        residual[np.abs(residual) < 1e-9 * np.abs(change).max()] = 0.0
        rows = [tuple((-row).tolist()) for row in found] + [(0.0,) * 9]
        return (rows[0], rows[1]), remainder(residual, self.observations.u[self.rows, 0], reason)


def _check_line(observations: ObservationSet, rows: np.ndarray, line: _Line) -> None:
    values, unit = observations.readings[rows, 0], line.unit
    free = (line.slope or is_aligned(observations)) and np.ptp(line.arm) > 0.0
    straight = np.polyval(np.polyfit(line.arm, values, 1), line.arm) if free else 0.0
    offset = np.abs(values - straight - np.median(values - straight))
    i = int(np.argmax(offset))
    if offset[i] <= LARGEST_VALUE[unit]:
        return
    likely, limit = ("degrees, µrad or arcseconds", "1 mrad") if unit == "rad" else ("µm", "1 mm")
    raise InputError(
        f"{observations.where(int(rows[i]))}: value {values[i]:g} lies more than {limit} from the middle of its line; "
        f"is it in {likely}? Expected {unit}. If the machine's errors are that large, set large_errors = true in the [[set]], "
        "or pass `accept_large_errors=True`"
    )


COMPONENT = Component()
