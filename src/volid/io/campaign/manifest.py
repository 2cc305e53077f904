"""Campaigns as plain text: a TOML manifest, `volid-campaign/1`, with one CSV file per set of readings."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from volid.campaign import TIME, Alignment, Campaign, End, ObservationSet, Station, standard_uncertainty
from volid.effects.environment.reduction import as_read
from volid.exceptions import InputError, OutputError
from volid.io.basics.atomic import atomic_folder, atomic_with_companions
from volid.io.basics.cells import CellWriter
from volid.io.basics.csv_form import CsvForm
from volid.io.basics.toml_table import Table, check_format, format_lines, read_toml
from volid.io.campaign import calibration
from volid.io.campaign.active_files import file_names, find_active, with_files, write_files
from volid.io.campaign.environments import environment_lines, read_environment, resolved, write_log
from volid.io.campaign.foreign import IMPORTED
from volid.io.campaign.named_stations import with_named
from volid.io.campaign.reach import read_machine_of, refuse_other_types, refuse_outside
from volid.io.campaign.rules import FORMAT, STATION_FRAMES, check_consistent
from volid.io.campaign.sets import TO, TOOL_COLUMNS, ReadSet, read_set, uncertainty_key_of
from volid.io.machines import format_machine
from volid.model.machine import Machine
from volid.observations import KINDS

MANIFEST = "campaign.toml"
MACHINE = "machine.toml"


def read_manifest(path: str | Path, *, plan: bool = False, allow_outside: bool = False) -> Campaign:
    """The campaign described by a TOML manifest and the CSV files that it names.

    With `plan`, a set whose CSV lacks the columns of the readings is accepted: its readings are NaN (for simulation).
    Files of readings stand below the manifest's folder unless `allow_outside`.
    Raises `InputError` naming file and row or key for anything that is missing, misspelt or wrong.
    """
    path = Path(path)
    top = Table(read_toml(path), str(path))
    return campaign_of(top, path.parent, plan=plan, allow_outside=allow_outside)


def campaign_of(top: Table, folder: Path, *, plan: bool = False, allow_outside: bool = False) -> Campaign:
    """The campaign that a manifest's `top` table describes, with its files in `folder`. Raises `InputError`."""
    check_format(top, FORMAT)
    top.only(
        ("format", "machine", "title", "warnings", "conditions", "csv", "station", "alignment", "environment", "set")
    )
    refuse_other_types(top)
    if not allow_outside:
        refuse_outside(top, folder)
    machine = read_machine_of(top, folder)
    active = find_active(top, folder, machine, allow_outside)
    sets = top.tables("set")
    if not sets:
        raise InputError(f"{top.where}: there is no [[set]]; add one for each file of readings")
    form = CsvForm().with_stated(top)
    read = [read_set(table, folder, machine, plan=plan, form=form) for table in sets]
    logs = [read_environment(table, folder, form) for table in top.tables("environment")]
    form.check_units(top)
    readings = tuple(found.readings for found in read)
    stations, remarks = with_named(tuple(_station(table, machine) for table in top.tables("station")), readings)
    found = check_consistent(
        Campaign(
            machine=machine,
            stations=stations,
            alignments=tuple(_alignment(table) for table in top.tables("alignment")),
            sets=readings,
            title=top.text("title", "", one_line=False),
            conditions=active.in_words(_conditions(top, read)),
            active_files=active.files,
            environments=tuple(environment for environment, _ in logs),
            warnings=(
                *_warnings(top),
                *(note for found in read for note in found.notes),
                *(note for _, notes in logs for note in notes),
                *remarks,
            ),
            source=top.where,
        )
    )
    return resolved(found)


def _conditions(top: Table, read: Sequence[ReadSet]) -> dict[str, Any]:
    """The record of conditions, with that of imported files under their sets' names."""
    given = dict(top.table("conditions", {}).data)
    imported = {found.readings.name: dict(found.record) for found in read if found.record}
    if not imported:
        return given
    earlier = top.table("conditions", {}).table(IMPORTED, {}).data
    return {**given, IMPORTED: {**earlier, **imported}}


def _warnings(top: Table) -> tuple[str, ...]:
    given = top.get("warnings", [])
    if not isinstance(given, list) or not all(isinstance(text, str) for text in given):
        raise top.wrong("warnings", "a list of texts")
    return tuple(given)


def _station(table: Table, machine: Machine) -> Station:
    table.only(("name", "body", "position", "known", "frame"))
    return Station(
        name=table.text("name"),
        body=table.text("body", "workpiece"),
        position=table.vector("position", 3, None),
        known=table.flag("known", False),
        frame=table.text("frame", "stations", choices=STATION_FRAMES),
    )


def _alignment(table: Table) -> Alignment:
    table.only(("name", "body", "artefact"))
    return Alignment(table.text("name"), table.text("body", "workpiece"), table.text("artefact", ""))


def write_manifest(campaign: Campaign, place: str | Path, *, overwrite: bool = False) -> Path:
    """Write a manifest, the machine file and one CSV file per set of readings; returns the manifest's path.

    `place` is a folder for `campaign.toml`, `machine.toml` and the sets; or, ending in .toml, the manifest itself: the others
    then stand beside it and begin with its name, PLAN.toml, PLAN.machine.toml, PLAN.volume.csv. Numbers keep all their
    digits; readings that were corrected for air and temperature are written as they were read. Not kept: the line numbers and
    file names of the readings' first source. Raises `OutputError` when a file or a filled
    folder exists (unless `overwrite`), cannot be written, or a value has no text form.
    """
    place, campaign = Path(place), as_read(campaign)
    if place.suffix.lower() == ".toml":
        machine, *names = [f"{place.stem}.{name}" for name in (MACHINE, *_file_names(campaign))]
        companions = [machine, *names, *(n for files in _calibrations(campaign, names) for n in files.values())]
        companions += [n for files in file_names(campaign, f"{place.stem}.") for n in files.values()]
        with atomic_with_companions(place, companions, overwrite) as temporary:
            _write(campaign, temporary, place.name, machine, names)
        return place
    with atomic_folder(place, overwrite) as temporary:
        _write(campaign, temporary, MANIFEST, MACHINE, _file_names(campaign))
    return place / MANIFEST


def _write(campaign: Campaign, folder: Path, manifest: str, machine: str, names: list[str]) -> None:
    try:
        (folder / manifest).write_text(_manifest(campaign, manifest, machine, names), encoding="utf-8")
        (folder / machine).write_text(format_machine(campaign.machine), encoding="utf-8")
        for readings, name in zip(campaign.sets, names, strict=False):
            _write_csv(readings, campaign.machine, folder / name)
        for readings, files in zip(campaign.sets, _calibrations(campaign, names), strict=True):
            for key, name in files.items():
                calibration.write_file(key, readings.options, folder / name)
        write_files(campaign, folder, _before(manifest))
        for environment, name in zip(campaign.environments, names[len(campaign.sets) :], strict=True):
            if TIME in environment.log:
                write_log(environment, folder / name)
    except TypeError as error:
        raise OutputError(f"{manifest} cannot be written: {error}; keep the campaign in HDF5") from None


def _file_names(campaign: Campaign) -> list[str]:
    """A file name for each set, then each environment: its name, with anything unusual in a file name replaced."""
    names: list[str] = []
    entries = [entry.name for entry in campaign.sets] + [entry.name for entry in campaign.environments]
    for i, entry in enumerate(entries, start=1):
        stem = re.sub(r"[^\w.-]+", "_", entry).strip("._") or "set"
        taken = {name.casefold() for name in names}
        names.append(f"{stem}.csv" if f"{stem}.csv".casefold() not in taken else f"{stem}_{i}.csv")
    return names


def _calibrations(campaign: Campaign, names: list[str]) -> list[dict[str, str]]:
    """Names of the files that hold calibrated points, of every set by key."""
    pairs = zip(campaign.sets, names, strict=False)  # behind them stand those of logs
    return [calibration.files_of(s.options, name, names) if KINDS[s.kind].calibrated else {} for s, name in pairs]


def _before(manifest: str) -> str:
    """How the names of files beside a manifest begin: PLAN. for PLAN.toml, nothing in a folder of its own."""
    return "" if manifest == MANIFEST else f"{Path(manifest).stem}."


def _manifest(campaign: Campaign, manifest: str, machine: str, names: list[str]) -> str:
    head = {"format": FORMAT, "machine": machine, "title": campaign.title or None}
    lines = format_lines(head | {"warnings": campaign.warnings or None})
    if campaign.conditions:
        lines += ["", "[conditions]", *format_lines(with_files(campaign, _before(manifest)))]
    for station in campaign.stations:
        keys = {key: getattr(station, key) for key in ("name", "body", "position", "known", "frame")}
        lines += ["", "[[station]]", *format_lines(keys)]
    for alignment in campaign.alignments:
        lines += ["", "[[alignment]]", *format_lines({k: v or None for k, v in asdict(alignment).items()})]
    for environment, name in zip(campaign.environments, names[len(campaign.sets) :], strict=True):
        lines += environment_lines(environment, name)
    for readings, name, files in zip(campaign.sets, names, _calibrations(campaign, names), strict=False):
        keys = {"name": readings.name, "kind": KINDS[readings.kind].file_kind or readings.kind, "file": name}
        lines += ["", "[[set]]", *format_lines(keys | dict(readings.options) | files)]
        for effect in readings.effects:
            keys = {"name": effect.name, "type": effect.type, "u": effect.u, "per": effect.per}
            lines += ["[[set.effect]]", *format_lines(keys | dict(effect.options))]
    return "\n".join(lines) + "\n"


def _write_csv(readings: ObservationSet, machine: Machine, path: Path) -> None:
    columns = _columns(readings, machine)
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = CellWriter(file)
        writer.writerow(columns)
        writer.writerows(zip(*columns.values(), strict=True))


def _follows_from_options(readings: ObservationSet, i: int) -> bool:
    """Whether the set's own keys give the u of reading column `i` again, to the last digit; NaN where a plan has none."""
    names = KINDS[readings.kind].readings
    key = next((k for k in uncertainty_key_of(names, i) if k in readings.options), None)
    if key is None:
        return False
    return np.array_equal(
        standard_uncertainty(readings.options[key], readings.readings[:, i]), readings.u[:, i], equal_nan=True
    )


def _known(readings: ObservationSet, i: int) -> np.ndarray:
    if np.isnan(readings.u[:, i]).any():
        raise TypeError(f"u of set '{readings.name}' is not known for every row, and no key tells how it follows")
    return readings.u[:, i]


def _end_columns(end: End, machine: Machine, start: str) -> dict[str, list[Any]]:
    """Columns of one functional point, whose names begin with `start`."""
    columns: dict[str, list[Any]] = {}
    for i, letter in enumerate(machine.letters):
        columns[f"{start}{letter}"] = end.positions[:, i].tolist()
    for i, letter in enumerate(machine.letters):
        if end.directions[:, i].any():
            columns[f"{start}{letter}_dir"] = end.directions[:, i].astype(int).tolist()
    for i, name in enumerate(TOOL_COLUMNS):
        columns[f"{start}{name}"] = end.tool[:, i].tolist()
    return columns


def _columns(readings: ObservationSet, machine: Machine) -> dict[str, list[Any]]:
    """Columns of the CSV file, in the order in which people read them."""
    columns: dict[str, list[Any]] = {}
    for start, end in zip(("", TO), readings.ends, strict=False):
        columns |= _end_columns(end, machine, start)
    for name, labels in readings.labels.items():
        columns[name] = labels.tolist()
    names = KINDS[readings.kind].readings
    planned = bool(np.isnan(readings.readings).all())
    for i, name in enumerate(names):
        if not planned:
            columns[name] = readings.readings[:, i].tolist()
    for i, name in enumerate(names):
        if not _follows_from_options(readings, i):
            columns[f"u_{name}" if len(names) > 1 else "u"] = _known(readings, i).tolist()
    for name in ("time", "temperature"):
        values = getattr(readings, name)
        if values is not None:
            columns[name] = ["" if np.isnan(v) else v for v in values.tolist()]
    return columns
