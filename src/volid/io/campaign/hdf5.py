"""Campaigns in one self-contained HDF5 file, `volid-campaign/1`, readable with plain h5py.

The first 512 bytes, which HDF5 skips, hold a checksum of the others (`volid.io.basics.hdf5_seal`); a file without is read too.

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
- `environments/1`, … where there are any, with attributes `keys` (JSON text: what the manifest says of it), `source` and
  `columns`, and for every column of the log a dataset of its name: `time` [s], `air_temperature_C`, `pressure_hPa`,
`humidity_percent`, `…_C`. A set whose readings were corrected for air and temperature holds `as_read` (m, k) besides, the
readings before that. Root attribute `alignments` (JSON text), where there are any: placements that lines share.
- `active_files/1`, … where there are any: files of a control that were active while measuring, with attributes `text` (as
  `conditions` name them), `cnc`, `sign`, `options` (JSON text), and the datasets `names` and `content/1`, … (bytes).
"""

from __future__ import annotations

from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from volid.campaign import Campaign, Effect, End, ObservationSet, Station
from volid.exceptions import InputError
from volid.io.basics.hdf5_group import ALL, Group
from volid.io.basics.hdf5_structure import shown
from volid.io.basics.hdf5_values import check_format, reading, to_json, write_array, write_text
from volid.io.basics.hdf5_writing import hdf5_output
from volid.io.basics.toml_table import Table
from volid.io.campaign.active_files import read_active, write_active
from volid.io.campaign.effects import check_effect
from volid.io.campaign.environments import read_environments, write_environments
from volid.io.campaign.rules import FORMAT, alignments_of, check_consistent, find_kind
from volid.io.campaign.sets import check_option
from volid.io.machines import format_machine, parse_machine
from volid.model.machine import Machine
from volid.observations import KINDS, Kind

_EFFECT_KEYS = {field.name for field in fields(Effect)}

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
    with hdf5_output(path, overwrite) as file:
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
    if campaign.environments:
        write_environments(group.create_group("environments"), campaign.environments)
    if campaign.active_files:
        write_active(group.create_group("active_files"), campaign.active_files)
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
    if readings.as_read is not None:
        write_array(group, "as_read", readings.as_read)
    if readings.rows is not None:
        write_array(group, "rows", readings.rows, np.int64)


def read_campaign(path: str | Path) -> Campaign:
    """The campaign stored in an HDF5 file.

    Raises `InputError` when the file is missing, truncated, not HDF5, of another type or version, or incomplete.
    """
    with reading(path, "campaign", FORMAT) as file:
        return read_campaign_group(file)


def read_campaign_group(group: Group) -> Campaign:
    """The campaign in an open group. Raises `InputError` when it is wrong."""
    check_format(group, FORMAT)
    bare = read_outline(group)
    return check_consistent(
        replace(bare, sets=tuple(read_set(g, bare.machine) for g in group.group("sets").numbered()))
    )


def read_outline(group: Group) -> Campaign:
    """The campaign in an open group without its sets."""
    attributes = group.attributes
    warnings = attributes.json("warnings", list)
    if not all(isinstance(text, str) for text in warnings):
        raise InputError(f"{group.where}, attribute warnings: expected a list of texts")
    return Campaign(
        machine=parse_machine(group.text("machine"), f"{group.where}, machine"),
        stations=_read_stations(group.group("stations")),
        title=attributes.text("title"),
        conditions=attributes.json("conditions", dict),
        warnings=tuple(warnings),
        source=group.source,
        environments=read_environments(group.group("environments")) if "environments" in group else (),
        active_files=read_active(group.group("active_files")) if "active_files" in group else (),
        alignments=alignments_of(attributes.json("alignments", list, "[]"), f"{group.where}, attribute alignments"),
    )


def _read_stations(group: Group) -> tuple[Station, ...]:
    n = group.length("name")
    names, bodies, frames = (group.texts(name, (n,)).tolist() for name in ("name", "body", "frame"))
    known, positions = group.array("known", (n,), bool).tolist(), group.array("position", (n, 3))
    if np.isinf(positions).any():
        raise InputError(
            f"{group.place('position')}: holds an infinite value; expected mm, or NaN where nothing is known"
        )
    places = [None if np.isnan(p).any() else tuple(p.tolist()) for p in positions]
    return tuple(Station(*values) for values in zip(names, bodies, places, known, frames, strict=True))


def read_set(group: Group, machine: Machine, rows: slice = ALL) -> ObservationSet:
    """The set in an open group, or consecutive `rows` of it. Raises `InputError` when something in it is wrong."""
    attributes = group.attributes
    kind = find_kind(attributes.text("kind"), group.where)
    m, axes, k = group.length("positions", 2), len(machine.axes), len(kind.readings)
    labels, recorded = group.group("labels"), {name: name in group for name in ("time", "temperature")}
    return ObservationSet(
        name=attributes.text("name"),
        kind=kind.name,
        positions=group.array("positions", (m, axes), rows=rows, finite=True),
        directions=_directions(group, "directions", (m, axes), rows),
        tool=group.array("tool", (m, 3), rows=rows, finite=True),
        readings=group.array("readings", (m, k), rows=rows),
        u=_uncertainties(group, (m, k), rows),
        labels=_labels(labels, kind, m, rows),
        **{name: group.array(name, (m,), rows=rows) if there else None for name, there in recorded.items()},
        options=read_options(attributes.json("options", dict), kind, group.where),
        effects=_effects(attributes.json("effects", list), machine, group.where),
        source=attributes.text("source"),
        rows=group.array("rows", (m,), int, rows=rows) if "rows" in group else None,
        as_read=group.array("as_read", (m, k), rows=rows) if "as_read" in group else None,
        to=_second(group, (m, axes), rows) if kind.ends == 2 else None,
    )


def _labels(group: Group, kind: Kind, m: int, rows: slice) -> dict[str, np.ndarray]:
    """Labels of a kind; files of earlier versions lack those that came later, which have a default."""
    count = len(range(*rows.indices(m)))
    return {
        name: group.texts(name, (m,), rows=rows) if name in group or default is None else np.full(count, default)
        for name, default in kind.labels.items()
    }


def _second(group: Group, shape: tuple[int, int], rows: slice) -> End:
    """The second functional points of a set."""
    positions, directions, tool = SECOND
    return End(
        group.array(positions, shape, rows=rows, finite=True),
        _directions(group, directions, shape, rows),
        group.array(tool, (shape[0], 3), rows=rows, finite=True),
    )


def _directions(group: Group, name: str, shape: tuple[int, int], rows: slice) -> np.ndarray:
    found = group.array(name, shape, rows=rows)
    if not np.isin(found, (-1.0, 0.0, 1.0)).all():
        raise InputError(f"{group.place(name)}: expected +1, -1, or 0 for unknown")
    return found


def _uncertainties(group: Group, shape: tuple[int, int], rows: slice) -> np.ndarray:
    """Standard uncertainties; NaN where a plan has no reading yet to which a part of them is proportional."""
    found = group.array("u", shape, rows=rows)
    if (found <= 0.0).any() or np.isinf(found).any():
        raise InputError(f"{group.place('u')}: expected standard uncertainties > 0, or NaN in a plan")
    return found


def read_options(found: dict[str, Any], kind: Kind, where: str) -> dict[str, Any]:
    """The options of a set, those that the kind declares checked for their type."""
    table = Table(found, f"{where}, options")
    for name, default in {**kind.options, **kind.further}.items():
        if name in found:
            check_option(table, name, default)
    return found


def _effects(found: list[Any], machine: Machine, where: str) -> tuple[Effect, ...]:
    """The systematic effects, each held against what a manifest may say of one."""
    effects = []
    for i, entry in enumerate(found, start=1):
        place = f"{where}, effect {i}"
        if not isinstance(entry, dict) or set(entry) != _EFFECT_KEYS or not isinstance(entry["options"], dict):
            raise InputError(
                f"{place}: is {shown(str(entry))}; expected an object with {', '.join(sorted(_EFFECT_KEYS))}"
            )
        check_effect(entry, machine, place)
        effects.append(Effect(**entry))
    return tuple(effects)
