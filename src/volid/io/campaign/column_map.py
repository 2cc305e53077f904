"""A map of columns from a file: the keys by which delimited text is read, kept for the next file of its kind."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from volid.exceptions import InputError
from volid.io.basics.hdf5_values import is_hdf5
from volid.io.basics.toml_table import Table, format_value, read_toml
from volid.io.campaign.delimited import OF_THE_FILE, TEXT
from volid.io.campaign.foreign import AS, IMPORTED
from volid.io.campaign.hdf5 import read_campaign
from volid.io.campaign.rules import FORMAT

_RECORDED_ONLY = ("touches_fitted",)


class Map(NamedTuple):
    """Keys of a set, and the machine file that the same file names, or None."""

    keys: dict[str, Any]
    machine: Path | None


def read_map(path: str | Path) -> Map:
    """The map of columns that a file holds: a TOML file of the keys of a set, a manifest, or a campaign.

    Raises `InputError` where there is no map in it, or more than one.
    """
    path = Path(path)
    if is_hdf5(path):
        return Map(_remembered(read_campaign(path).conditions, str(path)), None)
    top = Table(read_toml(path), str(path))
    if "format" not in top.data:
        keys = {key: value for key, value in top.data.items() if key not in (*OF_THE_FILE, "machine")}
        return Map(keys | {AS: TEXT}, path.parent / top.text("machine") if "machine" in top.data else None)
    if top.text("format") != FORMAT:
        raise InputError(
            f"{path}: format is {format_value(top.text('format'))}; expected a map, or a campaign that holds one"
        )
    mapped = [t for t in top.tables("set") if "columns" in t.data]
    if not mapped:
        keys = _remembered(top.table("conditions", {}).data, str(path))
    else:
        keys = _only([dict(t.data) for t in mapped], [str(t.data.get("name", "")) for t in mapped], str(path))
        keys["csv"] = {**top.table("csv", {}).data, **keys.get("csv", {})}
    return Map(_map_of(keys), path.parent / top.text("machine"))


def _remembered(conditions: Mapping[str, Any], where: str) -> dict[str, Any]:
    """The map of the one set of delimited text that a campaign remembers."""
    imported = conditions.get(IMPORTED, {})
    found = {name: entry for name, entry in imported.items() if isinstance(entry, Mapping) and entry.get(AS) == TEXT}
    return _map_of(_only([dict(entry) for entry in found.values()], list(found), where))


def _only(found: list[dict[str, Any]], names: list[str], where: str) -> dict[str, Any]:
    if not found:
        raise InputError(f"{where}: no set of it states columns or was imported as text; expected a map of columns")
    if any(entry != found[0] for entry in found) and len(found) > 1:
        raise InputError(
            f"{where}: sets {', '.join(names)} have maps of their own; expected one map, as a file of the keys of a set"
        )
    return found[0]


def _map_of(keys: Mapping[str, Any]) -> dict[str, Any]:
    return {k: v for k, v in keys.items() if k not in (*OF_THE_FILE, *_RECORDED_ONLY, "effect")} | {AS: TEXT}
