"""Lines on an artefact whose placement is unknown: a square, a granite, a straightedge, clamped once and read along lines.

The surface of a line has the direction `along` a, the normal n and a point p0, in the frame of the artefact's body. The placement
turns and moves it, R = R(o) and t, about the centre c. A gauge on the tool reads, along the direction e of its component, how far
the functional point f is from the surface; that of the nominal machine, f0, from the nominal surface is subtracted:

    value = ((R n)·(f - c - t - R (p0 - c)) - δ s - ε(s)) / (R n)·e - n·(f0 - p0) / n·e + offset,   s = a·(f0 - p0)

R is exact for rotations of any size. With an offset for each line (the default) c is p0, and t is left out. δ is the error of the
artefact's own angle at the line, which turns it from a towards n (0 for the line named first, prior `angle_u`), ε(s) the form
error of the line at s (prior `form_u`). Both belong to the artefact and are shared by its placements: reversal determines them.
Turns that no line shows are held at 0 and count in products only: a square that leans by a about one leg and by b about the other
seems a·b out of square, 1 µrad at 1 mrad each (part of `angle_u`). Form errors at different places are independent; what is
longer than the steps (a bow) is known too well, unless reversal removes it. Not modelled: the size of the gauge's tip, a gauge
that turns with the errors of the tool. CONVENTIONS 6; ISO 230-1 (straightness, squareness, reversal).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from volid.backend.elementary import in_rows
from volid.campaign import Campaign, ObservationSet
from volid.exceptions import InputError
from volid.model.geometry import Vector, dot, rotate_exactly, subtract
from volid.model.iso230 import ROTATIONS, TRANSLATIONS
from volid.model.kinematics import functional_point
from volid.model.machine import Machine
from volid.observations.aligned_lines import AlignedLine, described, lines_of
from volid.observations.base import Group, NuisanceTable
from volid.observations.placements import OFFSET_SPREAD, Placement

OPTIONS: Mapping[str, Any] = {"alignment": "", "lines": {}, "form_u": 0.0, "angle_u": 0.0, "offset": True}
SAME_PLACE = 3  # decimal places [mm] that tell places along a line apart


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
            f"{observations.where(i)}: component {observations.labels['component'][i]} of a set with an alignment; "
            "expected X, Y or Z (a surface is read along its normal)"
        )
    for name in dict.fromkeys(observations.labels["line"].tolist()):
        described(observations, str(name))


def aligned_group(observations: ObservationSet, campaign: Campaign, table: NuisanceTable) -> Group:
    """All rows of a set with an alignment, with the unknowns of the artefact's placement, angle and form, and of the lines."""
    options = {**OPTIONS, **observations.options}
    lines = list(lines_of(observations, campaign))
    offset, first = bool(options["offset"]), next(iter(options["lines"]))
    angle = float(options["angle_u"]) > 0.0 and any(line.name != first for line in lines)
    settings = AlignedSettings(lines[0].body, not offset, angle, float(options["form_u"]) > 0.0, offset)
    placement = Placement(campaign, lines[0].alignment)
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
        number = table.index(
            line.offset_key,
            f"offset {name} run {line.run}" if line.run else f"offset {name}",
            spread=OFFSET_SPREAD,
            response=line.offset_response(),
        )
        rows.append(np.full(len(line.rows), number))
    return rows


def slopes_apart(observations: ObservationSet, machine: Machine) -> str:
    """That lines of a set whose slopes are all unknown leave the squareness of axes open; "" where it is no such set."""
    if is_aligned(observations) or not observations.options.get("slope"):
        return ""
    moved = set()
    for line, component in {
        *zip(observations.labels["line"].tolist(), observations.labels["component"].tolist(), strict=True)
    }:
        rows = (observations.labels["line"] == line) & (observations.labels["component"] == component)
        travel = np.ptp(observations.positions[rows], axis=0)
        if travel.any() and component not in ROTATIONS:
            moved.add(machine.letters[int(np.argmax(travel))])
    if len(moved) < 2:
        return ""
    return (
        f"every line of set '{observations.name}' has a slope of its own (slope = true), which takes the squareness of "
        f"{', '.join(sorted(moved))} away; if lines were read on one artefact in one place, such as a square, add [[alignment]] "
        "with a name and a body, and alignment = that name and lines = { … } in the set, instead of slope"
    )
