"""Lines on an artefact, as a set describes them and as its readings see them nominally (their use: `alignments`)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from volid.campaign import Alignment, Campaign, ObservationSet
from volid.exceptions import InputError
from volid.model.geometry import three_numbers
from volid.model.iso230 import TRANSLATIONS
from volid.model.jacobian import tool_rotation_rows
from volid.model.kinematics import nominal_point, nominal_rotation
from volid.model.machine import BED, Machine
from volid.observations.lines import lines_of_set, per_run
from volid.observations.response import MOTIONS, SEVERAL_TOOLS, GapOf, Key, as_rows, remainder

ACROSS = 0.5  # cosine of the angle between the component that is read and the normal of the surface, at least


class Described(NamedTuple):
    """A line as the set describes it: unit vectors along it and normal to its surface (3,), and a point of it, if stated."""

    along: np.ndarray
    normal: np.ndarray
    point: np.ndarray | None


def described(observations: ObservationSet, name: str) -> Described:
    """The line called `name`. Raises `InputError` when it is not described, or its directions are no right angle."""
    lines = observations.options.get("lines")
    lines = lines if isinstance(lines, Mapping) else {}
    where, given = f"set '{observations.name}', line '{name}'", lines.get(name)
    example = f"lines = {{ {name} = {{ along = [1, 0, 0], normal = [0, 1, 0] }} }}"
    if not isinstance(given, Mapping) or set(given) - {"along", "normal", "point"}:
        found = f"{given}" if given is not None else f"nothing among {', '.join(map(str, lines)) or 'no lines'}"
        raise InputError(f"{where}: found {found}; expected where it lies in the artefact, such as {example}")
    stated = {
        key: three_numbers(given.get(key)) for key in ("along", "normal", "point") if key != "point" or key in given
    }
    vectors = {key: None if v is None else np.array(v) for key, v in stated.items()}
    wrong = [key for key, v in vectors.items() if v is None or (key != "point" and not np.linalg.norm(v) > 0.0)]
    if wrong:
        raise InputError(f"{where}: {wrong[0]} is {given.get(wrong[0])}; expected three numbers, such as {example}")
    along, normal = (np.asarray(vectors[key]) / np.linalg.norm(vectors[key]) for key in ("along", "normal"))  # type: ignore[arg-type]
    if abs(along @ normal) > 1e-6:
        raise InputError(
            f"{where}: along and normal are not at right angles; expected the direction of the line and its surface's normal"
        )
    return Described(along, normal, vectors.get("point"))


@dataclass(frozen=True, eq=False)
class AlignedLine:
    """Readings of one component along one line of an artefact. `rows` (m,): their numbers in the set.

    `run`: the run to which they belong, where every run has an offset of its own, else "".
    """

    observations: ObservationSet
    machine: Machine
    alignment: Alignment
    name: str
    component: str
    rows: np.ndarray
    run: str = ""

    @property
    def offset_key(self) -> Key:
        """Key of the offset of the line, or of the run."""
        key = ("offset", self.observations.name, self.name, self.component)
        return (*key, self.run) if self.run else key

    @cached_property
    def seen(self) -> ObservationSet:
        """The readings."""
        return self.observations.rows_of(self.rows)

    @cached_property
    def line(self) -> Described:
        """As it is described; a point that is not stated is the nominal place of the reading that comes first along the line."""
        line = described(self.observations, self.name)
        if line.point is not None:
            return line
        every = self.observations.rows_of(np.flatnonzero(self.observations.labels["line"] == self.name))
        places = nominal_point(self.machine, every.positions, every.tool, self.body)
        return line._replace(point=places[int(np.argmin(places @ line.along))])

    @cached_property
    def body(self) -> int:
        """Number of the body that carries the artefact."""
        return self.machine.body_index(self.alignment.body)

    @cached_property
    def places(self) -> np.ndarray:
        """Nominal functional points in the frame of the artefact's body, from the line's point, (m, 3) [mm]."""
        return nominal_point(self.machine, self.seen.positions, self.seen.tool, self.body) - self.line.point

    @cached_property
    def read(self) -> np.ndarray:
        """Direction that is read, frame of the artefact's body, (m, 3). Raises `InputError` where it lies in the surface."""
        turned = nominal_rotation(self.machine, self.seen.positions, self.machine.body_index(BED), self.body)
        read = turned[:, :, TRANSLATIONS.index(self.component)]
        flat = np.abs(read @ self.line.normal) < ACROSS
        if flat.any():
            normal = ", ".join(f"{c:g}" for c in self.line.normal)
            raise InputError(
                f"{self.seen.where(int(np.argmax(flat)))}: component {self.component} lies in the surface of line '{self.name}', "
                f"whose normal is [{normal}]; expected the component along the normal"
            )
        return np.asarray(read)

    @cached_property
    def across(self) -> np.ndarray:
        """n·e, (m,)."""
        return np.asarray(self.read @ self.line.normal)

    @cached_property
    def along(self) -> np.ndarray:
        """s, (m,) [mm]."""
        return np.asarray(self.places @ self.line.along)

    @cached_property
    def levers(self) -> np.ndarray:
        """∂value/∂(rotation) about the line's point at the nominal placement, (m, 3) [mm]."""
        return np.cross(self.line.normal, self.places) / self.across[:, None]

    def constants(self, centre: np.ndarray | None) -> np.ndarray:
        """What the prediction needs of every row, (14, m): n, p0 - c, c, e, the nominal gap along e, and s."""
        point = np.asarray(self.line.point)
        c = point if centre is None else centre
        fixed = np.tile(np.concatenate([self.line.normal, point - c, c])[:, None], len(self.rows))
        nominal = self.places @ self.line.normal / self.across
        reference = self.name == next(iter(self.observations.options["lines"]))
        return np.vstack([fixed, self.read.T, nominal, 0.0 * self.along if reference else self.along])

    def offset_response(self) -> GapOf:
        """How the line's own offset answers a motion of the body and a constant rotation of the tool."""
        frame = nominal_rotation(self.machine, self.seen.positions, self.machine.body_index(BED), self.body)
        turned = frame @ tool_rotation_rows(self.machine, self.seen.positions, self.seen.tool)[:, :3]
        mean = turned.mean(axis=0)
        rows = np.zeros((len(self.rows), MOTIONS))
        rows[:, 6:] = np.einsum("i,mij->mj", self.line.normal, turned - mean) / self.across[:, None]
        rows[np.abs(rows) < 1e-9 * max(float(np.abs(turned).max()), 1.0)] = 0.0
        normal, point, read = (
            tuple(v.tolist()) for v in (self.line.normal, np.asarray(self.line.point), self.read.mean(axis=0))
        )
        keys = alignment_keys(self.alignment, "ABC")
        left = remainder(rows, self.seen.u[:, 0], SEVERAL_TOOLS)
        return GapOf(self.alignment.body, left, keys, normal, point, read, as_rows(mean))


def alignment_keys(alignment: Alignment, letters: str) -> tuple[Key, ...]:
    """Keys of three translations (XYZ) or rotations (ABC) of a placement."""
    return tuple(("alignment", alignment.name, c) for c in letters)


def lines_of(observations: ObservationSet, campaign: Campaign) -> Iterator[AlignedLine]:
    """The lines of a set, component by component, and run by run where each has an offset."""
    alignment = campaign.alignment(str(observations.options["alignment"]))
    runs = observations.labels["run"].astype(str) if per_run(observations) else np.full(len(observations), "")
    for rows in lines_of_set(observations):
        name, component = (str(observations.labels[label][rows[0]]) for label in ("line", "component"))
        for run in dict.fromkeys(runs[rows].tolist()):
            yield AlignedLine(observations, campaign.machine, alignment, name, component, rows[runs[rows] == run], run)
