"""Readings of one component along one line: their offsets and slope as unknowns, and how these answer a motion of the frames.

A rigid motion (t, ω) of the bodies' frames, and a rotation h of the tool, change reading i by M_i · (t, ω, h). Offset a, of the
line or of each of its runs, and slope b of the line follow it as far as M_i = a + b · arm_i; what remains makes a transformation
inexact.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from volid.campaign import ObservationSet
from volid.exceptions import InputError
from volid.model.iso230 import ROTATIONS
from volid.model.machine import Machine
from volid.observations.base import NuisanceTable, takes_large_errors
from volid.observations.response import Key, Linear, Remainder, remainder

SPREAD = {"mm": 0.01, "rad": 1e-4}  # of a line's offset; a virtual instrument draws from it
SLOPE_SPREAD = {"mm": 1e-4, "rad": 1e-7}  # per mm of travel
LARGEST_VALUE = {
    "mm": 1.0,
    "rad": 0.001,
}  # above, the user is asked: few machines are so bad, and many columns are in µm or arcseconds
RUN, LINE = "run", "line"  # what has an offset of its own
_UNFOLLOWED = (
    "the new datum turns the workpiece frame, and the readings of line {line} of set '{name}' ({component}) would change by more "
    "than its offset{slope} can follow. {advice} fit in that datum: [datum] of the machine file"
)
_STRAIGHT = {
    False: "Set slope = true if the artefact's alignment is unknown, or",
    True: "Read along one linear axis, or",
}


def per_run(observations: ObservationSet) -> bool:
    """Whether every run of a line has an offset of its own, because the instrument was zeroed before it."""
    return observations.options.get("offset_per", LINE) == RUN


@dataclass(frozen=True, eq=False)
class Line:
    """Readings of one component along one line.

    `rows` (m,): their numbers in the set. `change` (m, 9): M. `slope`: whether the line's slope is unknown.
    """

    observations: ObservationSet
    machine: Machine
    rows: np.ndarray
    change: np.ndarray
    slope: bool = False

    @property
    def name(self) -> str:
        """The line's name in the file."""
        return str(self.observations.labels["line"][self.rows[0]])

    @property
    def component(self) -> str:
        """The component that is read."""
        return str(self.observations.labels["component"][self.rows[0]])

    @property
    def unit(self) -> str:
        """mm or rad."""
        return "rad" if self.component in ROTATIONS else "mm"

    @cached_property
    def runs(self) -> np.ndarray:
        """Name of the run to whose offset each reading belongs, "" for that of the whole line, (m,)."""
        if per_run(self.observations):
            return self.observations.labels["run"][self.rows].astype(str)
        return np.full(len(self.rows), "")

    @cached_property
    def arm(self) -> np.ndarray:
        """Position of the moving axis from its first value on the line, shape (m,)."""
        positions = self.observations.positions[self.rows]
        moving = int(np.argmax(np.ptp(positions, axis=0)))
        return np.asarray(positions[:, moving] - positions[0, moving])

    def slots(self, table: NuisanceTable) -> np.ndarray:
        """Numbers of offset and, where it is unknown, slope for every reading, (1 or 2, m)."""
        rows, not_followed = self._responses
        name = f"{self.observations.name} line {self.name} {self.component}"
        key: Key = (self.observations.name, self.name, self.component)
        result = np.zeros((1 + self.slope, len(self.rows)), dtype=np.int64)
        for run, row in rows.items():
            result[0, self.runs == run] = table.index(
                ("offset", *key, run) if run else ("offset", *key),
                f"offset {name} run {run}" if run else f"offset {name}",
                self.unit,
                spread=SPREAD[self.unit],
                response=Linear(not_followed=not_followed, constant=row),
            )
            not_followed = None  # once is enough
        if self.slope:
            response = Linear(constant=self._slope_row)
            spread = SLOPE_SPREAD[self.unit]
            result[1] = table.index(
                ("slope", *key), f"slope {name}", f"{self.unit}/mm", spread=spread, response=response
            )
        return result

    @cached_property
    def _followed(self) -> tuple[np.ndarray, np.ndarray]:
        """Rows of the offsets and the slope by least squares over the line, and the change that is left, (m, 9)."""
        columns = [(self.runs == run).astype(float) for run in dict.fromkeys(self.runs)]
        design = np.stack([*columns, *([self.arm] if self.slope else [])], axis=1)
        found = np.linalg.lstsq(design, self.change, rcond=1e-12)[0]
        left = self.change - design @ found
        left[np.abs(left) < 1e-9 * np.abs(self.change).max()] = 0.0
        return found, left

    @property
    def _slope_row(self) -> tuple[float, ...]:
        return tuple((-self._followed[0][-1]).tolist())

    @property
    def _responses(self) -> tuple[dict[str, tuple[float, ...]], Remainder | None]:
        """Row of every offset by its run, and the change that offsets and slope cannot follow."""
        found, left = self._followed
        reason = _UNFOLLOWED.format(
            line=self.name,
            name=self.observations.name,
            component=self.component,
            slope=" and slope" if self.slope else "",
            advice=_STRAIGHT[self.slope],
        )
        rows = {run: tuple((-found[i]).tolist()) for i, run in enumerate(dict.fromkeys(self.runs.tolist()))}
        return rows, remainder(left, self.observations.u[self.rows, 0], reason)


def check_components(observations: ObservationSet, allowed: Sequence[str], words: str) -> None:
    """Raises `InputError` for the first row whose component is none of those allowed, `words`."""
    components = observations.labels["component"]
    wrong = np.flatnonzero(~np.isin(components, list(allowed)))
    if wrong.size:
        i = int(wrong[0])
        raise InputError(f"{observations.where(i)}: component '{components[i]}' is none of {words}")


def check_offset_per(observations: ObservationSet) -> None:
    """Raises `InputError` for an offset of anything but a line or a run."""
    given = observations.options.get("offset_per", LINE)
    if given not in (LINE, RUN):
        raise InputError(
            f"set '{observations.name}': offset_per is '{given}'; expected \"line\" (all runs of a line share its offset) or "
            '"run" (the instrument was zeroed before every run)'
        )


def lines_of_set(observations: ObservationSet) -> list[np.ndarray]:
    """Numbers of the rows of every line of one component, component by component."""
    components, lines = observations.labels["component"], observations.labels["line"]
    found = []
    for component in dict.fromkeys(components.tolist()):
        for line in dict.fromkeys(lines[components == component].tolist()):
            found.append(np.flatnonzero((components == component) & (lines == line)))
    return found


def check_lines(observations: ObservationSet, lines: Iterable[Line], aligned: bool = False) -> None:
    """Raises `InputError` when a value lies more than 1 mm or 1 mrad from the middle of its line, or a free slope.

    `aligned`: slopes are free though the lines have none of their own. Not where the set says `large_errors`.
    """
    for line in () if takes_large_errors(observations) else lines:
        unit, away = line.unit, _from_the_middle(line, line.slope or aligned)
        i = int(np.argmax(away))
        if away[i] > LARGEST_VALUE[unit]:
            likely, limit = ("degrees, µrad or arcseconds", "1 mrad") if unit == "rad" else ("µm", "1 mm")
            raise InputError(
                f"{observations.where(int(line.rows[i]))}: value {observations.readings[line.rows[i], 0]:g} lies more than "
                f"{limit} from the middle of its line; is it in {likely}? Expected {unit}. If the machine's errors are that "
                "large, set large_errors = true in the [[set]], or pass `accept_large_errors=True`"
            )


def _from_the_middle(line: Line, free: bool) -> np.ndarray:
    """How far readings lie from the middle of their line, or of their run where it has an offset, or of a free slope, (m,)."""
    values = line.observations.readings[line.rows, 0].copy()
    for run in dict.fromkeys(line.runs.tolist()):
        own = line.runs == run
        values[own] -= np.median(values[own])
    if free and np.ptp(line.arm) > 0.0:
        values -= np.polyval(np.polyfit(line.arm, values, 1), line.arm)
    return np.abs(values - np.median(values))
