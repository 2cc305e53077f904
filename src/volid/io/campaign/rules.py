"""Rules that every campaign obeys, whichever file it came from: stations, bodies and names agree with each other."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import fields
from typing import Any

import numpy as np

from volid.campaign import Alignment, Campaign, ObservationSet, Station
from volid.effects.environment.checks import check_environments
from volid.effects.prediction import check_effects
from volid.exceptions import InputError
from volid.io.basics.toml_table import nearest
from volid.model.machine import BED, TOOL, WORKPIECE, Machine
from volid.observations import KINDS, Kind

FORMAT = "volid-campaign/1"
LARGEST = 1e9  # mm, rad or degrees: a thousand kilometres
_LEAST_U = 1e-15  # mm or rad: far below what any instrument and the numbers themselves hold
STATION_FRAMES = ("stations", "machine")
_LEAST_CONSTANT = (
    1e-6  # mm: 1 nm; no length instrument of a machine shop is so good, but 0.1 to 1 µm written in metres are
)


def bodies(machine: Machine) -> tuple[str, ...]:
    """Names of the bodies of a machine: workpiece, bed, tool, and the axis letters."""
    return (WORKPIECE, BED, TOOL, *machine.letters)


def find_kind(name: str, where: str) -> Kind:
    """The observation kind called `name`. Raises `InputError` listing the kinds there are."""
    if name in KINDS:
        return KINDS[name]
    raise InputError(
        f"{where}: unknown kind '{name}'{nearest(name, [*KINDS]) or ';'} expected one of {', '.join(KINDS)}"
    )


def check_station(station: Station, machine: Machine, where: str) -> None:
    """Raises `InputError` for a body that the machine does not have, or a known station without position."""
    known = bodies(machine)
    if station.body not in known:
        raise InputError(
            f"{where}: body is '{station.body}'{nearest(station.body, known) or ';'} expected one of {', '.join(known)}"
        )
    if station.frame not in STATION_FRAMES:
        raise InputError(f"{where}: frame is '{station.frame}'; expected one of {', '.join(STATION_FRAMES)}")
    if station.position is not None and not np.all(np.abs(station.position) <= LARGEST):
        raise InputError(f"{where}: position is {station.position}; expected at most {LARGEST:g} mm in every direction")
    if station.known and station.position is None:
        raise InputError(f"{where}: known = true but there is no position; add position = [x, y, z] in mm")
    if station.frame == "machine" and not station.known:
        raise InputError(f'{where}: frame = "machine" is for known stations; add known = true or remove the frame')


def check_constant(constant: float, where: str) -> None:
    """Raises `InputError` for a constant part of the u of lengths [mm] between 0 and 1 nm: it must be in metres."""
    if 0.0 < constant < _LEAST_CONSTANT:
        raise InputError(
            f"{where}: the constant part of u is {constant:g} mm, less than 1 nm; is it in metres? Expected mm, such as "
            f"{1e3 * constant:g}, or 0 where there is only a proportional part"
        )


def check_unique(names: Iterable[str], what: str, where: str, how: str = "") -> None:
    """Raises `InputError` when a name stands twice; `how` a name is given."""
    seen: set[str] = set()
    for name in names:
        if name in seen:
            raise InputError(f"{where}: two {what}s are called '{name}'; give every {what} its own name{how}")
        seen.add(name)


def check_stations_of(readings: ObservationSet, stations: Iterable[Station]) -> None:
    """Raises `InputError` naming the first row whose station is not in the list of stations."""
    labels = KINDS[readings.kind].stations_of(readings)
    known = [station.name for station in stations]
    strange = ~np.isin(labels, known)
    if strange.any():
        i = int(np.argmax(strange))
        listed = ", ".join(known) or "none"
        raise InputError(
            f"{readings.where(i)}: station '{labels[i]}' is unknown{nearest(labels[i], known) or ';'} "
            f"stations: {listed}; add a [[station]] table or mend the name"
        )


def check_possible(readings: ObservationSet) -> None:
    """Raises `InputError` naming the first row with a number beyond anything that is measured, or a u of almost nothing."""
    names = KINDS[readings.kind].readings
    for what, values in (
        ("a position", readings.positions),
        ("the tool vector", readings.tool),
        (" or ".join(names), readings.readings),
        ("u", readings.u),
    ):
        far = np.abs(values) > LARGEST
        if far.any():
            i, j = np.argwhere(far)[0]
            raise InputError(
                f"{readings.where(int(i))}: {what} is {values[i, j]:g}; expected at most {LARGEST:g}, "
                "more than anything that is measured"
            )
    if (small := (readings.u > 0.0) & (readings.u < _LEAST_U)).any():
        i, j = np.argwhere(small)[0]
        raise InputError(
            f"{readings.where(int(i))}: u is {readings.u[i, j]:g}; expected a standard uncertainty of at least {_LEAST_U:g}"
        )


def check_target(readings: ObservationSet, campaign: Campaign) -> None:
    """Raises `InputError` for a target on a body that the machine has not, or on the body that its station stands on."""
    body = KINDS[readings.kind].target_body(readings.options)
    known = bodies(campaign.machine)
    if body not in known:
        raise InputError(
            f"{campaign.source}, set '{readings.name}': target_body is '{body}'{nearest(str(body), known) or ';'} expected one "
            f"of {', '.join(known)}"
        )
    for name in dict.fromkeys(KINDS[readings.kind].stations_of(readings).tolist()):
        body_of_station = campaign.station(name).body
        if campaign.machine.body_index(body_of_station) == campaign.machine.body_index(body):
            raise InputError(
                f"{campaign.source}, set '{readings.name}': station '{name}' and its target stand on the same body "
                f"({body_of_station}), so their distance never changes; expected two bodies that move against each other"
            )


def alignments_of(given: Any, where: str) -> tuple[Alignment, ...]:
    """Alignments from plain values, as a file holds them. Raises `InputError` for anything but a list of tables of texts."""
    keys = {f.name for f in fields(Alignment)}
    tables: list[Any] = given if isinstance(given, list) else [given]
    for a in tables:
        texts = isinstance(given, list) and isinstance(a, Mapping) and all(isinstance(t, str) for t in a.values())
        if not texts or "name" not in a or set(a) - keys:
            raise InputError(
                f"{where}: expected a list of tables with the texts name, body and artefact; write the file again"
            )
    return tuple(Alignment(**a) for a in tables)


def check_alignments(campaign: Campaign) -> None:
    """Raises `InputError` for an alignment that is not there, or stands on a body that carries no artefact."""
    check_unique((a.name for a in campaign.alignments), "alignment", campaign.source)
    known = [body for body in bodies(campaign.machine) if body != TOOL]
    for alignment in campaign.alignments:
        if alignment.body not in known:
            raise InputError(
                f"{campaign.source}, alignment '{alignment.name}': body is '{alignment.body}'"
                f"{nearest(alignment.body, known) or ';'} expected one of {', '.join(known)}"
            )
    names = [a.name for a in campaign.alignments]
    for readings in campaign.sets:
        name = str(readings.options.get("alignment", ""))
        if name and name not in names:
            raise InputError(
                f"{campaign.source}, set '{readings.name}': alignment '{name}' is unknown{nearest(name, names) or ';'} "
                f'alignments: {", ".join(names) or "none"}; add [[alignment]] with name = "{name}" or mend the name'
            )


def check_texts(campaign: Campaign) -> None:
    """Raises `InputError` for a name or title with the character U+0000, at which programs and files end a text."""
    texts = [("title", campaign.title), ("name of the machine", campaign.machine.name)]
    texts += [("name of a station", station.name) for station in campaign.stations]
    for readings in campaign.sets:
        texts += [("name of a set", readings.name), *(("name of an effect", e.name) for e in readings.effects)]
        texts += [(f"label '{name}'", "".join(np.unique(values))) for name, values in readings.labels.items()]
    for what, text in texts:
        if "\0" in text:
            shown = text.replace("\0", "\\u0000")[:80]
            raise InputError(f"{campaign.source}: the {what} is '{shown}'; expected text without the character U+0000")


def check_consistent(campaign: Campaign) -> Campaign:
    """The campaign itself when names are unique and every station that a reading names exists, else `InputError`."""
    check_texts(campaign)
    check_unique((s.name for s in campaign.stations), "station", campaign.source)
    check_unique((s.name for s in campaign.sets), "set", campaign.source)
    check_alignments(campaign)
    for station in campaign.stations:
        check_station(station, campaign.machine, f"{campaign.source}, station '{station.name}'")
    for readings in campaign.sets:
        check_stations_of(readings, campaign.stations)
        check_possible(readings)
        KINDS[readings.kind].check(readings)
        check_target(readings, campaign)
        check_effects(readings)
    check_environments(campaign)
    return campaign
