"""Beams of an interferometer, as a set describes them and as its readings see them nominally (their use: `projection`)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from volid.campaign import Campaign, ObservationSet
from volid.exceptions import InputError
from volid.model.geometry import across_pair, three_numbers
from volid.model.jacobian import tool_rotation_rows
from volid.model.kinematics import nominal_point, nominal_rotation
from volid.model.machine import BED, Machine
from volid.observations.response import MOTIONS, SEVERAL_TOOLS, Key, ReachOf, Remainder, Rows, as_rows, remainder

RETRO, FLAT = "retro", "flat"
MIRRORS, SIDES = (RETRO, FLAT), ("tool", "body")
_TURNS = (
    "the new datum turns the frame of the body '{body}', in which the beam of line {line} of set '{name}' is said to have its "
    "nominal direction, and readings lie beside the beam. Set misalignment = true and fit again, or fit in that datum: [datum] "
    "of the machine file"
)


class Beam(NamedTuple):
    """A beam as the set describes it: its unit vector (3,), and a point of it, if stated."""

    along: np.ndarray
    point: np.ndarray | None


def described_beam(observations: ObservationSet, name: str) -> Beam:
    """The beam of the line called `name`. Raises `InputError` when it is not described."""
    lines = observations.options.get("lines")
    lines = lines if isinstance(lines, Mapping) else {}
    where, given = f"set '{observations.name}', line '{name}'", lines.get(name)
    example = f"lines = {{ {name} = [1, 0, 0] }}, or {name} = {{ along = [1, 0, 0], point = [0, 300, -200] }} (mm)"
    parts = given if isinstance(given, Mapping) else {"along": given}
    stated = {key: three_numbers(value) for key, value in parts.items() if key in ("along", "point")}
    found = {key: None if v is None else np.array(v) for key, v in stated.items()}
    along = found.get("along")
    if given is None or len(found) < len(parts) or along is None or not np.linalg.norm(along) > 0.0:
        said = f"found {given}" if given is not None else f"nothing among {', '.join(map(str, lines)) or 'no lines'}"
        raise InputError(f"{where}: {said}; expected the direction of the beam, such as {example}")
    if "point" in found and found["point"] is None:
        raise InputError(f"{where}: point is {parts['point']}; expected three numbers, such as {example}")
    return Beam(along / np.linalg.norm(along), found.get("point"))


@dataclass(frozen=True, eq=False)
class BeamLine:
    """Readings along one beam. `rows` (m,): their numbers in the set; `on`: the body that carries the beam."""

    observations: ObservationSet
    machine: Machine
    on: str
    name: str
    rows: np.ndarray

    @cached_property
    def beam(self) -> Beam:
        """The beam as it is described."""
        return described_beam(self.observations, self.name)

    @cached_property
    def seen(self) -> ObservationSet:
        """The readings."""
        return self.observations.rows_of(self.rows)

    @cached_property
    def body(self) -> int:
        """Number of the body that carries the beam."""
        return self.machine.body_index(self.on)

    @cached_property
    def mirrored(self) -> bool:
        """Whether a flat mirror moves with the tool."""
        options = self.observations.options
        return options.get("mirror", RETRO) == FLAT and options.get("mirror_on", "tool") == "tool"

    @cached_property
    def places(self) -> np.ndarray:
        """Nominal functional points in the frame of the body, (m, 3) [mm]."""
        return np.asarray(nominal_point(self.machine, self.seen.positions, self.seen.tool, self.body))

    @cached_property
    def point(self) -> np.ndarray:
        """A point of the beam, (3,) [mm]: the stated one, or the nominal functional point of the first row."""
        return self.places[0] if self.beam.point is None else self.beam.point

    @cached_property
    def nominal(self) -> np.ndarray:
        """Nominal displacements from the first row, (m,) [mm]."""
        return np.asarray((self.places - self.places[0]) @ self.beam.along)

    @cached_property
    def beside(self) -> np.ndarray:
        """How far beside the beam the nominal functional points are, (m,) [mm]."""
        away = self.places - self.point
        return np.asarray(np.linalg.norm(away - np.outer(away @ self.beam.along, self.beam.along), axis=1))

    @cached_property
    def frame(self) -> np.ndarray:
        """The direction of the beam and two directions across it, rows of (3, 3), frame of the body."""
        return np.stack([self.beam.along, *across_pair(self.beam.along)])

    @cached_property
    def turned(self) -> np.ndarray:
        """Nominal rotation from the tool's frame to that of the body, (m, 3, 3)."""
        ends = len(self.machine.axes), self.body
        return nominal_rotation(self.machine, self.seen.positions, *ends)

    @cached_property
    def normals(self) -> np.ndarray:
        """The mirror's nominal normal, along the beam in the first row, and two directions across it, rows, frame of the tool."""
        return np.asarray(self.frame @ self.turned[0])

    def constants(self) -> np.ndarray:
        """What the prediction needs of every row, (12 or 21, m): frame of the beam, point, frame of the mirror."""
        parts = [self.frame.ravel(), self.point, *([self.normals.ravel()] if self.mirrored else [])]
        return np.tile(np.concatenate(parts)[:, None], len(self.rows))

    def offset_response(self, angles: tuple[Key, ...]) -> ReachOf:
        """How the offset answers a motion of the body and a constant rotation of the tool; `angles`: keys of those unknown."""
        follows = bool(angles) or self.mirrored
        point = self.point if follows else self.places.mean(axis=0)
        answer, left = self._answer(bool(angles), point)
        return ReachOf(self.on, left, angles, as_rows(self.frame), tuple(point.tolist()), answer)

    def _answer(self, turns: bool, point: np.ndarray) -> tuple[Rows, Remainder | None]:
        """What a rotation h of the tool does to the functional point, (3, 3), and what of h and ω the unknowns do not follow.

        A motion that turns neither beam nor mirror is followed by the offset alone. One that does is also followed by their
        angles; where these are known, readings at Δ beside the beam change by ω·(d × Δ), or with the mirror by h·Rᵀ(d × Δ).
        """
        along = self.beam.along
        frame = nominal_rotation(self.machine, self.seen.positions, self.machine.body_index(BED), self.body)
        moved = frame @ tool_rotation_rows(self.machine, self.seen.positions, self.seen.tool)[:, :3]
        across = np.cross(along, self.places - point)
        if self.mirrored and not turns:
            moved = moved + along[:, None] * np.einsum("mji,mj->mi", self.turned, across)[:, None, :]
        mean = moved.mean(axis=0)
        rows = np.zeros((len(self.rows), MOTIONS))
        rows[:, 6:] = np.einsum("i,mij->mj", along, moved - mean)
        if not self.mirrored and not turns:
            rows[:, 3:6] = across
        rows[np.abs(rows) < 1e-9 * max(float(np.abs(self.places).max()), 1.0)] = 0.0
        said = _TURNS.format(body=self.on, line=self.name, name=self.observations.name)
        reason = said if rows[:, 3:6].any() else SEVERAL_TOOLS
        return as_rows(mean), remainder(rows, self.seen.u[:, 0], reason)


def beams_of(observations: ObservationSet, campaign: Campaign) -> Iterator[BeamLine]:
    """The lines of a set."""
    alignment = str(observations.options.get("alignment", ""))
    on = campaign.alignment(alignment).body if alignment else str(observations.options.get("body", "workpiece"))
    labels = observations.labels["line"]
    for name in dict.fromkeys(labels.tolist()):
        yield BeamLine(observations, campaign.machine, on, str(name), np.flatnonzero(labels == name))
