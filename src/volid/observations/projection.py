"""`projection`: displacement along a beam (interferometer along an axis, a face or body diagonal, sequential step diagonals).

With d the direction of the beam, o a point of it, and f the actual functional point, all in the frame of the body that carries
the interferometer (the workpiece unless the set says otherwise),

    mirror = "retro":  reading = d · (f - o) + offset
    mirror = "flat":   reading = n · (f - o) / (n · d) + offset

A displacement is the whole way and not a deviation; it grows where the tool moves along `lines`. The interferometer stands on
`body`, the mirror on the tool; with a retro-reflector the two may be exchanged, and its apex (or the interferometer's reference
point) is the tool vector. A flat mirror on the tool has the tool vector as a point of its plane. Its normal n, nominally along
the beam, turns with all rotations of the tool: the length that is read ends where the beam, which stays, meets the plane.
At Δ beside the beam a tilt δn of the machine or the mirror adds δn·Δ: what leaks into step diagonals. The beam goes through the
`point` of its line, or the nominal functional point of its first row. With mirror_on = "body" the flat mirror stands on the body
and the beam leaves the tool: d is then the mirror's normal, and the first formula holds.

misalignment = true: two angles of every beam against its nominal direction are unknown, tangents of any size; `misalignment_u`
is their prior u [rad] where it is stated. A flat mirror on the tool is taken to be adjusted across its beam, so that both have
the same two angles; being δ off that would act by δ²/2 of the displacement, and is not modelled. Beams that share an
`alignment`, such as those of one laser and its optical squares, are turned together by its three rotations. Angles are found
from readings beside the beam. Where there are none they act by the cosine error alone, 0.5 µm/m for 1 mrad: state that as an
effect of type "scale" per "line", whose u is 5e-7 then.

`segment` is the uninterrupted beam, with one unknown offset per line, as for distances: where it was lost another one begins. All
runs of a line share its offset, unless offset_per = "run" says that the interferometer was zeroed before every run. Not modelled:
a mirror that is not flat, a second pass of the beam (10 nm for 100 µrad and 1 m). An [[environment]] acts on the way since the
first reading of an uninterrupted beam; the path in air up to there is its `dead_path`. CONVENTIONS 6; ISO 230-6; ISO 230-2; on
step diagonals M. A. V. Chapman, Precision Engineering 27 (2003) 401.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from volid.backend.elementary import in_rows
from volid.campaign import Campaign, ObservationSet
from volid.exceptions import InputError
from volid.model.geometry import Vector, dot, subtract, turned_direction
from volid.model.kinematics import from_tool_frame, functional_point, transform
from volid.model.machine import BED, WORKPIECE, Machine
from volid.observations.base import LIGHT, Group, Kind, NuisanceTable, Positioning, takes_large_errors
from volid.observations.beam_advice import advice
from volid.observations.beam_checks import check_beam, check_beside, check_direction, check_displacements
from volid.observations.beam_lines import FLAT, MIRRORS, RETRO, SIDES, beams_of, described_beam
from volid.observations.beam_unknowns import (
    LINE,
    RUN,
    angle_keys,
    angle_slots,
    counted_by,
    offset_keys,
    offset_slots,
    uninterrupted,
)
from volid.observations.one_axis import by_beam


class ProjectionSettings(NamedTuple):
    """Static part: the beam's body, how many angles a beam has, and whether it ends at a flat mirror on the tool."""

    body: int
    angles: int
    mirror: bool


class Projection(Kind):
    """Displacements along beams, as the docstring of the module describes them."""

    name = "projection"
    readings = ("displacement",)
    doc = "displacement of the functional point along a beam + offset of the line [mm]"
    labels: Mapping[str, str | None] = {"line": None, "run": "1", "segment": "1"}
    options: Mapping[str, Any] = {
        "lines": None,
        "mirror": RETRO,
        "mirror_on": "tool",
        "misalignment": False,
        "misalignment_u": np.inf,
        "body": WORKPIECE,
    }
    optional: Mapping[str, Any] = {"alignment": "", "offset_per": LINE}
    scopes: Mapping[str, tuple[str, ...]] = {"line": ("line",), "run": ("line", "run"), "segment": ("line", "segment")}
    tested_by = ("line",)
    named_by = ("line",)
    still_by = ("line",)

    @staticmethod
    def predict(
        machine: Machine,
        settings: ProjectionSettings,
        q: Any,
        tool: Vector,
        errors: Any,
        slots: Any,
        constants: Any,
    ) -> Any:
        """Predicted displacements, shape (1, m) [mm]."""
        angles = [slots[i] for i in range(1, 1 + settings.angles)]
        beam = turned_direction(_frame(constants, 0), angles)
        way = subtract(functional_point(machine, q, tool, errors, settings.body), _three(constants, 9))
        if not settings.mirror:
            return in_rows([dot(beam, way) + slots[0]], np.shape(q[0]))
        normal = from_tool_frame(machine, errors, turned_direction(_frame(constants, 12), angles), True)
        n = len(machine.axes)
        normal = transform(machine, q, errors, normal, start=n, stop=settings.body, is_vector=True)
        return in_rows([dot(normal, way) / dot(normal, beam) + slots[0]], np.shape(q[0]))

    def groups(self, observations: ObservationSet, campaign: Campaign, table: NuisanceTable) -> list[Group]:
        """All rows of a set as one group: an offset per line and segment, and angles where they are unknown."""
        _check_shared(observations, campaign)
        lines = list(beams_of(observations, campaign))
        settings = ProjectionSettings(lines[0].body, len(angle_keys(lines[0])), lines[0].mirrored)
        slots = np.zeros((1 + settings.angles, len(observations)), dtype=np.int64)
        constants = np.zeros((21 if settings.mirror else 12, len(observations)))
        for line in lines:
            slots[0, line.rows] = offset_slots(line, table)
            slots[1:, line.rows] = np.array(angle_slots(line, table), dtype=np.int64)[:, None]
            constants[:, line.rows] = line.constants()
        return [Group(np.arange(len(observations)), settings, slots, constants)]

    def starts(self, campaign: Campaign) -> dict[Any, float]:
        """Offsets: how far displacements are from the nominal ones, the mean of their line and segment."""
        found: dict[Any, float] = {}
        for s in campaign.sets:
            for line in beams_of(s, campaign) if s.kind == self.name else ():
                along = (line.places - line.point) @ line.beam.along
                for key, own in uninterrupted(line):
                    left = (line.seen.readings[:, 0] - along)[own]
                    found[key] = float(np.mean(left)) if np.isfinite(left).all() else 0.0
        return found

    def positioning(self, observations: ObservationSet, campaign: Campaign) -> Iterator[Positioning]:
        """Beams along the axis that moves."""
        return by_beam(observations, campaign)

    def check(self, observations: ObservationSet) -> None:
        """Raises `InputError` for options that are none or do not go together, or a line without direction."""
        where, options = f"set '{observations.name}'", observations.options
        stated = {**self.optional, **options}
        for key, known in (("mirror", MIRRORS), ("mirror_on", SIDES), ("offset_per", (LINE, RUN))):
            if stated[key] not in known:
                raise InputError(f"{where}: {key} is '{stated[key]}'; expected {' or '.join(known)}")
        if options["mirror"] == RETRO and options["mirror_on"] != "tool":
            raise InputError(
                f"{where}: mirror_on = 'body' is for a flat mirror; where a retro-reflector stands makes no difference, remove it"
            )
        self._check_alignment(observations, where)
        for name in dict.fromkeys(observations.labels["line"].tolist()):
            described_beam(observations, str(name))

    def _check_alignment(self, observations: ObservationSet, where: str) -> None:
        options = observations.options
        if not options.get("alignment"):
            return
        wrong = {
            "body": (options["body"] != WORKPIECE, "the alignment says on which body the beams stand"),
            "misalignment": (options["misalignment"], "the alignment holds the angles of all its beams"),
            "mirror": (
                (options["mirror"], options["mirror_on"]) == (FLAT, "tool"),
                "a flat mirror on the tool shows its own angles",
            ),
        }
        for key, (stands, why) in wrong.items():
            if stands:
                raise InputError(f"{where}: {key} = {options[key]} beside alignment; {why}, remove one of them")

    def check_values(self, observations: ObservationSet, campaign: Campaign) -> None:
        """Raises `InputError` for beams that the tool leaves, and displacements of another sign or unit, or deviations."""
        machine = campaign.machine
        known = [b for b in (WORKPIECE, BED, *machine.letters) if machine.body_index(b) < len(machine.axes)]
        if observations.options["body"] not in known:
            raise InputError(
                f"set '{observations.name}': body is '{observations.options['body']}'; expected one that the tool moves against, "
                f"{', '.join(known)}"
            )
        for line in beams_of(observations, campaign):
            check_beam(line)
            if angle_keys(line) and np.isinf(float(observations.options["misalignment_u"])):
                check_beside(line)
            if not takes_large_errors(observations):
                if not angle_keys(line):
                    check_direction(line)
                for _, own in uninterrupted(line):
                    check_displacements(line, own)

    def is_whole(self, observations: ObservationSet) -> bool:
        """A line counts from its first row."""
        return True

    def lengths_of(self, observations: ObservationSet) -> str:
        """Paths in light."""
        return LIGHT

    def dead_paths(self, observations: ObservationSet, starts: Mapping[Any, float]) -> np.ndarray:
        """The first reading of every uninterrupted beam, (m, 1) [mm]: an offset of the display, whatever the line counts from."""
        first: dict[Any, float] = {}
        rows = zip(offset_keys(observations), observations.readings[:, 0].tolist(), strict=True)
        return np.array([[first.setdefault(key, reading)] for key, reading in rows])

    def runs_by(self, observations: ObservationSet) -> tuple[str, ...]:
        """A segment of a line, or of a run along it, has one offset."""
        return counted_by(observations)

    def advice(self, sets: Sequence[ObservationSet], campaign: Campaign) -> list[str]:
        """Which planes no beam is inclined in, and how many tool vectors there are."""
        return advice([list(beams_of(s, campaign)) for s in sets])


def _three(rows: Any, first: int) -> Vector:
    return rows[first], rows[first + 1], rows[first + 2]


def _frame(rows: Any, first: int) -> tuple[Vector, Vector, Vector]:
    return _three(rows, first), _three(rows, first + 3), _three(rows, first + 6)


def _check_shared(observations: ObservationSet, campaign: Campaign) -> None:
    """Raises `InputError` for an alignment that lines of another kind of readings share."""
    name = observations.options.get("alignment", "")
    others = [s for s in campaign.sets if name and s.options.get("alignment") == name and s.kind != observations.kind]
    if others:
        raise InputError(
            f"set '{observations.name}': the alignment '{name}' is that of set '{others[0].name}' too, of kind {others[0].kind}; "
            "expected an [[alignment]] of its own for beams"
        )


PROJECTION = Projection()
