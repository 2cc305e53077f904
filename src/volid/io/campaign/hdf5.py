"""Campaigns in one self-contained HDF5 file, `volid-campaign/1`, readable with plain h5py.

Root attributes: `format`; `title`; `conditions` and `warnings` (JSON texts); `axes` (axis letters, the column order).
- `machine`: the text of the machine file, scalar.
- `stations/`: `name`, `body`, `frame`, `known`, each (n,); `position` (n, 3) [mm], NaN where nothing is known.
- `sets/1`, `sets/2`, …, one group per set of m rows, with attributes `name`, `kind`, `source` (file that the rows came
  from), `options` and `effects` (JSON texts), and the datasets
  - `positions` (m, n_axes) [mm or degrees], `directions` (m, n_axes): +1, -1, 0 for unknown; `tool` (m, 3) [mm];
  - `readings` and `u` (m, k), their attribute `columns` naming the k readings and `unit` their unit; NaN in a plan;
  - `labels/<column>` (m,) text; `rows` (m,) line numbers in `source`; where recorded `time` (m,) [s] and
    `temperature` (m,) [°C], NaN where not recorded; for kinds that see two functional points `to_positions`, `to_directions`,
    `to_tool`, of the second.
Root attribute `alignments` (JSON text), where there are any: placements that lines share.
"""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path

import h5py
import numpy as np

from volid.campaign import Campaign, Effect, End, ObservationSet, Station
from volid.exceptions import InputError
from volid.io.basics.atomic import atomic_output
from volid.io.basics.hdf5_values import check_format, read_text, reading, to_json, write_array, write_text
from volid.io.campaign.rules import FORMAT, alignments_of, check_consistent, find_kind
from volid.io.machines import format_machine, parse_machine
from volid.model.machine import Machine
from volid.observations import KINDS

TO = "to_"
SECOND = tuple(f"{TO}{name}" for name in End._fields)  # datasets of second functional points


def write_campaign(campaign: Campaign, path: str | Path, *, overwrite: bool = False) -> None:
    """Write a campaign, its machine included, to one HDF5 file.

    Args:
        campaign: A campaign with readings, or a plan.
        path: Path of the file, ending in .h5.
        overwrite: Whether an existing file is replaced.

    Raises:
        OutputError: `path` exists, or cannot be written; then nothing is written.

    >>> import volid
    >>> from pathlib import Path
    >>> from tempfile import mkdtemp
    >>> path = Path(mkdtemp()) / "campaign.h5"
    >>> volid.save_campaign(volid.load_campaign("datasets/published_positioning/campaign.toml"), path)
    >>> volid.load_campaign(path).n_readings
    70
    """
    with atomic_output(path, overwrite) as temporary, h5py.File(temporary, "w") as file:
        write_campaign_group(campaign, file)


def write_campaign_group(campaign: Campaign, group: h5py.Group) -> None:
    """Write a campaign, its machine included, into an open group (a file's root, or a group of another file)."""
    group.attrs["format"] = FORMAT
    group.attrs["title"] = campaign.title
    group.attrs["conditions"] = to_json(campaign.conditions)
    group.attrs["warnings"] = to_json(campaign.warnings)
    group.attrs["axes"] = list(campaign.machine.letters)
    if campaign.alignments:
        group.attrs["alignments"] = to_json([asdict(alignment) for alignment in campaign.alignments])
    group["machine"] = format_machine(campaign.machine)
    _write_stations(group.create_group("stations"), campaign.stations)
    sets = group.create_group("sets")
    for i, readings in enumerate(campaign.sets, start=1):
        _write_set(sets.create_group(str(i)), readings)


def _write_stations(group: h5py.Group, stations: tuple[Station, ...]) -> None:
    nowhere = (np.nan, np.nan, np.nan)
    for name in ("name", "body", "frame"):
        write_text(group, name, [getattr(s, name) for s in stations])
    write_array(group, "known", np.array([s.known for s in stations]), bool)
    positions = [nowhere if s.position is None else s.position for s in stations]
    write_array(group, "position", np.array(positions, dtype=float).reshape(-1, 3)).attrs["unit"] = "mm"


def _write_set(group: h5py.Group, readings: ObservationSet) -> None:
    for name in ("name", "kind", "source"):
        group.attrs[name] = getattr(readings, name)
    group.attrs["options"] = to_json(readings.options)
    group.attrs["effects"] = to_json([asdict(effect) for effect in readings.effects])
    write_array(group, "positions", readings.positions)
    write_array(group, "directions", readings.directions, np.int8)
    write_array(group, "tool", readings.tool).attrs["unit"] = "mm"
    for name, values in zip(SECOND, readings.to or (), strict=False):
        write_array(group, name, values)
    kind = KINDS[readings.kind]
    for name in ("readings", "u"):
        dataset = write_array(group, name, getattr(readings, name))
        dataset.attrs["columns"] = list(kind.readings)
        dataset.attrs["unit"] = kind.unit_words
    labels = group.create_group("labels")
    for name, values in readings.labels.items():
        write_text(labels, name, values)
    for name, unit in (("time", "s"), ("temperature", "°C")):
        if getattr(readings, name) is not None:
            write_array(group, name, getattr(readings, name)).attrs["unit"] = unit
    if readings.rows is not None:
        write_array(group, "rows", readings.rows, np.int64)


def read_campaign(path: str | Path) -> Campaign:
    """The campaign stored in an HDF5 file.

    Raises `InputError` when the file is missing, truncated, not HDF5, of another type or version, or incomplete.
    """
    with reading(path, "campaign", FORMAT) as file:
        return read_campaign_group(file, str(path))


def read_campaign_group(group: h5py.Group, source: str) -> Campaign:
    """The campaign in an open group; `source` names the file in messages. Raises `InputError` when it is wrong."""
    check_format(group, source, FORMAT)
    return check_consistent(_read(group, source))


def _read(file: h5py.Group, path: str) -> Campaign:
    bare = read_outline(file, path)
    return replace(bare, sets=tuple(read_set(g, bare.machine, f"{path}, {g.name}") for g in set_groups(file)))


def set_groups(file: h5py.Group) -> list[h5py.Group]:
    """The groups of the sets, in their order."""
    return [file["sets"][name] for name in sorted(file["sets"], key=int)]


def read_outline(file: h5py.Group, path: str) -> Campaign:
    """The campaign in an open group without its sets."""
    return Campaign(
        machine=parse_machine(file["machine"].asstr()[()], f"{path}, machine"),
        stations=_read_stations(file["stations"]),
        title=file.attrs["title"],
        conditions=json.loads(file.attrs["conditions"]),
        warnings=tuple(json.loads(file.attrs["warnings"])),
        source=path,
        alignments=alignments_of(json.loads(file.attrs.get("alignments", "[]")), f"{path}, attribute alignments"),
    )


def _read_stations(group: h5py.Group) -> tuple[Station, ...]:
    names, bodies, frames = (read_text(group[name]).tolist() for name in ("name", "body", "frame"))
    known, positions = group["known"][()].tolist(), group["position"][()]
    places = [None if np.isnan(p).any() else tuple(p.tolist()) for p in positions]
    return tuple(Station(*values) for values in zip(names, bodies, places, known, frames, strict=True))


def read_set(group: h5py.Group, machine: Machine, where: str, rows: slice = slice(None)) -> ObservationSet:
    """The set in an open group, or consecutive `rows` of it. Raises `InputError` when an array has a wrong shape."""
    kind = find_kind(group.attrs["kind"], where)
    second = SECOND if kind.ends == 2 else ()
    names = ("positions", "directions", "tool", "readings", "u", *second)
    arrays = {name: group[name][rows].astype(float) for name in names}
    m = len(arrays["positions"])
    expected = {"positions": len(machine.axes), "directions": len(machine.axes), "tool": 3}
    for name, array in arrays.items():
        shape = (m, expected.get(name.removeprefix(TO), len(kind.readings)))
        if array.shape != shape:
            raise InputError(f"{where}/{name}: shape is {array.shape}; expected {shape}")
    return ObservationSet(
        name=group.attrs["name"],
        kind=kind.name,
        labels={name: read_text(group["labels"][name], rows) for name in kind.labels},
        time=group["time"][rows] if "time" in group else None,
        temperature=group["temperature"][rows] if "temperature" in group else None,
        options=json.loads(group.attrs["options"]),
        effects=tuple(Effect(**effect) for effect in json.loads(group.attrs["effects"])),
        source=group.attrs["source"],
        rows=group["rows"][rows] if "rows" in group else None,
        to=End(*(arrays.pop(name) for name in second)) if second else None,
        **arrays,
    )
