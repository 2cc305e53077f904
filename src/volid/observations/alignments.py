"""Lines on an artefact whose placement is unknown: a square, a granite, a straightedge, clamped once and read along several lines.

The surface of a line has the direction `along` a, the normal n and a point p0 in the frame of the body that the artefact stands on.
The placement turns and moves it, R = R(o) and t, about the centre c. A gauge on the tool reads, along the direction e of its
component, how far the functional point f is from the surface; that of the nominal machine from the nominal surface is subtracted:

    value = (R n)·(f - c - t - R (p0 - c) - (δ s + ε(s)) R n) / (R n)·e - n·(f0 - p0) / n·e + offset,   s = a·(f0 - p0)

R is exact for rotations of any size. With an offset for each line (the default) c is p0, and t is left out. δ is the error of the
artefact's own angle at the line, which turns it from a towards n (0 for the line named first, prior `angle_u`), ε(s) the form error
of the line at s (prior `form_u`); both belong to the artefact and are shared by its placements, whose reversal determines them. Not
modelled: the size of the gauge's tip, and a gauge that turns with the errors of the tool. CONVENTIONS 6; ISO 230-1 (straightness by a
straightedge, squareness by a square, reversal).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from volid.backend.elementary import in_rows
from volid.campaign import Alignment, Campaign, ObservationSet
from volid.exceptions import InputError
from volid.model.geometry import Vector, dot, rotate_exactly, subtract
from volid.model.iso230 import TRANSLATIONS
from volid.model.jacobian import tool_rotation_rows
from volid.model.kinematics import functional_point, nominal_point, nominal_rotation
from volid.model.machine import BED, TOOL, Machine
from volid.observations.base import Group, NuisanceTable
from volid.observations.response import MOTIONS, SEVERAL_TOOLS, GapOf, Key, PlaceOf, TurnOf, as_rows, remainder
from volid.observations.stations import Seen

OPTIONS: Mapping[str, Any] = {"alignment": "", "lines": {}, "form_u": 0.0, "angle_u": 0.0, "offset": True}
ROTATION_SPREAD, OFFSET_SPREAD = 2e-3, 0.1  # rad, mm: how far a virtual artefact is off its nominal place
SAME_PLACE = 3  # decimal places [mm] that tell places along a line apart
ACROSS = 0.5  # cosine of the angle between the component that is read and the normal of the surface, at least
LEVER = 1e-6  # mm: a rotation with a shorter one moves no reading
ALIKE = 1e-9  # of what an unknown does to readings: if others do all of it but this, they stand for it


class AlignedSettings(NamedTuple):
    """Static part: the artefact's body, and whether it is placed as a whole, has an angle, a form, and an offset per line."""

    body: int
    placed: bool
    angle: bool
    form: bool
    offset: bool


def predict_aligned(
    machine: Machine, settings: AlignedSettings, q: Any, tool: Vector, errors: Any, slots: Any, constants: Any
) -> Any:
    """Predicted values of lines on an artefact, shape (1, m) [mm]."""
    rotation, used = (slots[0], slots[1], slots[2]), 3
    normal, point, centre, read = (_three(constants, 3 * i) for i in range(4))
    nominal, along = constants[12], constants[13]
    turned = rotate_exactly(rotation, normal)
    place = subtract(functional_point(machine, q, tool, errors, settings.body), centre)
    if settings.placed:
        place = subtract(subtract(place, _three(slots, used)), rotate_exactly(rotation, point))
        used += 3
    gap = dot(turned, place)
    if settings.angle:
        gap = gap - slots[used] * along
        used += 1
    if settings.form:
        gap = gap - slots[used]
        used += 1
    value = gap / dot(turned, read) - nominal
    return in_rows([value + slots[used] if settings.offset else value], np.shape(q[0]))


def _three(rows: Any, first: int) -> Vector:
    return rows[first], rows[first + 1], rows[first + 2]


def is_aligned(observations: ObservationSet) -> bool:
    """Whether a set names an alignment."""
    return bool(observations.options.get("alignment"))


def check_aligned(observations: ObservationSet) -> None:
    """Raises `InputError` for options of a set that do not fit each other, or a line that is not described."""
    where = f"set '{observations.name}'"
    stated = [key for key in OPTIONS if observations.options.get(key, OPTIONS[key]) != OPTIONS[key]]
    if not is_aligned(observations):
        if stated:
            raise InputError(f'{where}: {", ".join(stated)} belong to an alignment; add alignment = "…" or remove them')
        return
    if observations.options.get("slope"):
        raise InputError(
            f"{where}: slope = true beside alignment; the alignment holds the slopes of all its lines, remove slope"
        )
    wrong = ~np.isin(observations.labels["component"], TRANSLATIONS)
    if wrong.any():
        i = int(np.argmax(wrong))
        raise InputError(
            f"{observations.where(i)}: component {observations.labels['component'][i]} of a set with an alignment; expected X, Y or "
            "Z (a surface is read along its normal)"
        )
    for name in dict.fromkeys(observations.labels["line"].tolist()):
        _described(observations, str(name))


class _Described(NamedTuple):
    """A line as the set describes it: unit vectors along it and normal to its surface (3,), and a point of it, if stated."""

    along: np.ndarray
    normal: np.ndarray
    point: np.ndarray | None


def _described(observations: ObservationSet, name: str) -> _Described:
    """The line called `name`. Raises `InputError` when it is not described, or its directions are no right angle."""
    lines = observations.options.get("lines")
    lines = lines if isinstance(lines, Mapping) else {}
    where, given = f"set '{observations.name}', line '{name}'", lines.get(name)
    example = f"lines = {{ {name} = {{ along = [1, 0, 0], normal = [0, 1, 0] }} }}"
    if not isinstance(given, Mapping) or set(given) - {"along", "normal", "point"}:
        found = f"{given}" if given is not None else f"nothing among {', '.join(map(str, lines)) or 'no lines'}"
        raise InputError(f"{where}: found {found}; expected where it lies in the artefact, such as {example}")
    vectors = {key: _vector(given.get(key)) for key in ("along", "normal", "point") if key != "point" or key in given}
    wrong = [key for key, v in vectors.items() if v is None or (key != "point" and not np.linalg.norm(v) > 0.0)]
    if wrong:
        raise InputError(f"{where}: {wrong[0]} is {given.get(wrong[0])}; expected three numbers, such as {example}")
    along, normal = (np.asarray(vectors[key]) / np.linalg.norm(vectors[key]) for key in ("along", "normal"))  # type: ignore[arg-type]
    if abs(along @ normal) > 1e-6:
        raise InputError(
            f"{where}: along and normal are not at right angles; expected the direction of the line and its surface's normal"
        )
    return _Described(along, normal, vectors.get("point"))


def _vector(given: Any) -> np.ndarray | None:
    try:
        x, y, z = (float(v) for v in given)
    except (TypeError, ValueError):
        return None
    return np.array([x, y, z]) if np.all(np.isfinite([x, y, z])) else None


@dataclass(frozen=True, eq=False)
class AlignedLine:
    """Readings of one component along one line of an artefact. `rows` (m,): their numbers in the set."""

    observations: ObservationSet
    machine: Machine
    alignment: Alignment
    name: str
    component: str
    rows: np.ndarray

    @cached_property
    def seen(self) -> ObservationSet:
        """The readings."""
        return self.observations.rows_of(self.rows)

    @cached_property
    def line(self) -> _Described:
        """As it is described; a point that is not stated is the nominal place of the reading that comes first along the line."""
        line = _described(self.observations, self.name)
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
        """Direction that is read, in the frame of the artefact's body, (m, 3). Raises `InputError` where it lies in the surface."""
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
        return GapOf(
            self.alignment.body,
            remainder(rows, self.seen.u[:, 0], SEVERAL_TOOLS),
            alignment_keys(self.alignment, "ABC"),
            *(tuple(v.tolist()) for v in (self.line.normal, np.asarray(self.line.point), self.read.mean(axis=0))),
            turned=as_rows(mean),
        )


def alignment_keys(alignment: Alignment, letters: str) -> tuple[Key, ...]:
    """Keys of three translations (XYZ) or rotations (ABC) of a placement."""
    return tuple(("alignment", alignment.name, c) for c in letters)


def lines_of(observations: ObservationSet, campaign: Campaign) -> Iterator[AlignedLine]:
    """The lines of a set, component by component."""
    alignment = campaign.alignment(str(observations.options["alignment"]))
    lines, components = observations.labels["line"], observations.labels["component"]
    for name in dict.fromkeys(lines.tolist()):
        for component in dict.fromkeys(components[lines == name].tolist()):
            rows = np.flatnonzero((lines == name) & (components == component))
            yield AlignedLine(observations, campaign.machine, alignment, str(name), str(component), rows)


def aligned_group(observations: ObservationSet, campaign: Campaign, table: NuisanceTable) -> Group:
    """All rows of a set with an alignment, with the unknowns of the artefact's placement, angle and form, and of the lines."""
    options = {**OPTIONS, **observations.options}
    lines = list(lines_of(observations, campaign))
    offset, first = bool(options["offset"]), next(iter(options["lines"]))
    angle = float(options["angle_u"]) > 0.0 and any(line.name != first for line in lines)
    settings = AlignedSettings(lines[0].body, not offset, angle, float(options["form_u"]) > 0.0, offset)
    placement = _Placement(campaign, lines[0].alignment)
    shared = placement.slots(observations, table, translated=not offset)
    slots = np.zeros(
        (len(shared) + settings.angle + settings.form + settings.offset, len(observations)), dtype=np.int64
    )
    constants = np.zeros((14, len(observations)))
    slots[: len(shared)] = np.array(shared)[:, None]
    for line in lines:
        constants[:, line.rows] = line.constants(None if offset else placement.centre)
        own = _own_slots(line, settings, options, table)
        slots[len(shared) :, line.rows] = np.array(own, dtype=np.int64).reshape(len(own), len(line.rows))
    return Group(np.arange(len(observations)), settings, slots, constants)


def _own_slots(
    line: AlignedLine, settings: AlignedSettings, options: Mapping[str, Any], table: NuisanceTable
) -> list[np.ndarray]:
    """Numbers of the unknowns of one line by row: angle, form, offset, as far as there are any."""
    artefact, rows = line.alignment.artefact_name, []
    if settings.angle:
        first, *others = options["lines"]
        name = line.name if line.name != first else str(others[0])  # its factor is 0 on the line named first
        key = ("angle of artefact", artefact, name)
        number = table.index(key, f"angle {artefact} line {name}", "rad", prior_u=float(options["angle_u"]))
        rows.append(np.full(len(line.rows), number))
    if settings.form:
        u, at = float(options["form_u"]), [f"{s + 0.0:.{SAME_PLACE}f}" for s in np.round(line.along, SAME_PLACE)]
        keys = [("form of artefact", artefact, line.name, place) for place in at]
        words = [f"form {artefact} line {line.name} at {place} mm" for place in at]
        rows.append(np.array([table.index(k, w, prior_u=u) for k, w in zip(keys, words, strict=True)]))
    if settings.offset:
        name = f"{line.observations.name} line {line.name} {line.component}"
        key = ("offset", line.observations.name, line.name, line.component)
        number = table.index(key, f"offset {name}", spread=OFFSET_SPREAD, response=line.offset_response())
        rows.append(np.full(len(line.rows), number))
    return rows


class _Placement:
    """The unknown placement of an artefact, and which of its rotations and translations move any reading at all."""

    def __init__(self, campaign: Campaign, alignment: Alignment) -> None:
        self.campaign, self.alignment = campaign, alignment
        sets = [s for s in campaign.sets if s.options.get("alignment") == alignment.name]
        self.lines = [line for s in sets for line in lines_of(s, campaign)]
        self.own_offset = [bool(line.observations.options.get("offset", True)) for line in self.lines]

    @cached_property
    def centre(self) -> np.ndarray:
        """Mean of the points of all lines, (3,) [mm]."""
        return np.mean([line.line.point for line in self.lines], axis=0)

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
    used = {str(s.options.get("alignment", "")) for s in campaign.sets}
    for alignment in campaign.alignments if used else ():
        if alignment.name in used:
            starts |= _fitted(_Placement(campaign, alignment))
    return starts


def _fitted(placement: _Placement) -> dict[Any, float]:
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
    names += [("offset", line.observations.name, line.name, line.component) for line in lines]
    return dict(zip(names, found.tolist(), strict=True))
