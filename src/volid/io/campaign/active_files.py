"""Files of a control that were active while a campaign was measured, as its record names them (ISO/TR 16907 9.1, 10.5).

```toml
[conditions]
active_compensations = [
    { file = "x.comp", cnc = "linuxcnc" },                              # further keys: sign, options = { … }
    { file = ["vol.lis", "vol.csv"], cnc = "isg-volcomp" },             # files that belong together
    "thermal compensation",                                             # what is no file is a text, as ever
]
```
`name` says under which name the control knows a file, where that is not its own. What stands in `[conditions]` in memory is a
text for each entry: types, names, control and hash; the files themselves go with the campaign.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np

from volid.campaign import ActiveFiles, Campaign
from volid.exceptions import InputError
from volid.io.basics.encodings import read_bytes
from volid.io.basics.hdf5_group import Group
from volid.io.basics.hdf5_values import to_json, write_array, write_text
from volid.io.basics.toml_table import Table
from volid.io.campaign.reach import refuse_far
from volid.model.machine import Machine
from volid.plausibility.conditions import ACTIVE

if TYPE_CHECKING:  # controls take a fifth of a second to import, and few campaigns name their files
    from volid.compensation.control import Control
    from volid.controllers.existing.reading import ExistingCompensation

_KEYS = ("file", "name", "cnc", "sign", "options")


@dataclass(frozen=True)
class Active:
    """What a manifest names: the files, and for each entry of its record the text that stands for it."""

    files: tuple[ActiveFiles, ...]
    texts: Mapping[int, str]  # id of the entry in the manifest's table: its text

    def in_words(self, conditions: Mapping[str, Any]) -> dict[str, Any]:
        """The record with texts in place of the entries that name files."""
        found = dict(conditions)
        for key, value in conditions.items():
            if key == ACTIVE:
                entries = value if isinstance(value, list) else [value]
                found[key] = [self.texts.get(id(e), e) for e in entries] if _name_files(entries) else value
            elif isinstance(value, Mapping):
                found[key] = self.in_words(value)
        return found


def find_active(top: Table, folder: Path, machine: Machine, allow_outside: bool) -> Active:
    """The files that `[conditions]` of a manifest name as active. Raises `InputError` that names the manifest and the file."""
    files: dict[str, ActiveFiles] = {}
    texts = {}
    for i, entry in enumerate(_entries(top.get("conditions", {})), start=1):
        table = Table(entry, f"{top.where}, [conditions] {ACTIVE}, entry {i}")
        found = _read(table, folder, machine, allow_outside)
        files[found.text] = found
        texts[id(entry)] = found.text
    return Active(tuple(files.values()), texts)


def _name_files(entries: Sequence[Any]) -> bool:
    return any(isinstance(e, Mapping) for e in entries)


def _entries(conditions: Any) -> list[Mapping[str, Any]]:
    """All entries that name files, those of the records of single files included."""
    if not isinstance(conditions, Mapping):
        return []
    stated = conditions.get(ACTIVE, [])
    found = [e for e in (stated if isinstance(stated, list) else [stated]) if isinstance(e, Mapping)]
    for key, value in conditions.items():
        found += _entries(value) if key != ACTIVE else []
    return found


def _read(table: Table, folder: Path, machine: Machine, allow_outside: bool) -> ActiveFiles:
    from volid.io.control_files import read_contents

    table.only(_KEYS)
    files = _texts(table, "file")
    names = _texts(table, "name") if "name" in table.data else [PurePosixPath(f).name for f in files]
    _refuse_folders(table.where, names)
    if len(names) != len(files) or len({n.casefold() for n in names}) < len(names):
        raise table.wrong("name" if "name" in table.data else "file", f"{len(files)} different names of files")
    for name in files:
        if not allow_outside:
            refuse_far(table.where, "file", name, folder)
    contents = {n: read_bytes(folder / f) for n, f in zip(names, files, strict=True)}
    options = table.table("options", {}).data
    try:
        found = read_contents(
            contents, machine, table.text("cnc", None), sign=table.text("sign", None), options=options
        )
    except InputError as error:
        raise InputError(f"{table.where}: {error}") from None
    return as_active(found)


def as_active(found: ExistingCompensation) -> ActiveFiles:
    """Files of a control as a campaign holds them."""
    files = {PurePosixPath(name).name: content for name, content in found.files.items()}
    return ActiveFiles(found.words, found.cnc, files, found.sign or "", dict(found.options))


def with_loaded(campaign: Campaign, control: Control, held: Sequence[ExistingCompensation]) -> Campaign:
    """A simulated campaign whose record names the files of controls that were loaded, `held`, and that holds them.

    `control`: the simulated control that had them loaded; `volid.simulate` has recorded it in words.
    """
    from volid.controllers.existing.reading import OWN

    foreign = [e for e in held if e.cnc != OWN]
    if not foreign:
        return campaign
    stated = campaign.conditions[ACTIVE]
    before = stated[: len(stated) - len(control.active)]
    own = replace(control, tables=(), grids=(), axis_tables=())
    words = [w for e in held for w in ([e.words] if e in foreign else e.control().active)]
    files = {f.text: f for f in (*campaign.active_files, *map(as_active, foreign))}
    listed = list(dict.fromkeys((*before, *words, *own.active)))
    return replace(campaign, conditions={**campaign.conditions, ACTIVE: listed}, active_files=tuple(files.values()))


def _refuse_folders(where: str, names: Sequence[str]) -> None:
    """Raises `InputError` for a name with folders: a campaign that was sent must not say where files are written."""
    for name in names:
        if name != PurePosixPath(name).name or "\\" in name:
            raise InputError(f"{where}: '{name}' is no plain name of a file; expected one without folders")


def _texts(table: Table, key: str) -> list[str]:
    """One text, or a list of them."""
    value = table.get(key)
    found = value if isinstance(value, list) else [value]
    if not found or not all(isinstance(v, str) and v for v in found):
        raise table.wrong(key, "the name of a file, or a list of them")
    return found


def file_names(campaign: Campaign, before: str) -> list[dict[str, str]]:
    """Under which names a manifest writes the files of each entry, by the names under which the control knows them.

    `before`: how the names begin.
    """
    entries = enumerate(campaign.active_files, start=1)
    return [{n: f"{before}active_{i}_{n}" for n in entry.files} for i, entry in entries]


def write_files(campaign: Campaign, folder: Path, before: str) -> None:
    """The files beside the manifest."""
    for entry, names in zip(campaign.active_files, file_names(campaign, before), strict=True):
        for known, name in names.items():
            (folder / name).write_bytes(entry.files[known])


def with_files(campaign: Campaign, before: str) -> dict[str, Any]:
    """The record with entries that name files in place of their texts."""
    named = {e.text: _entry(e, n) for e, n in zip(campaign.active_files, file_names(campaign, before), strict=True)}
    return _with_entries(campaign.conditions, named)


def _with_entries(conditions: Mapping[str, Any], named: Mapping[str, Any]) -> dict[str, Any]:
    found = dict(conditions)
    for key, value in conditions.items():
        if key == ACTIVE:
            entries = list(value) if isinstance(value, list | tuple) else [value]
            found[key] = [named.get(e, e) for e in entries] if any(e in named for e in entries) else value
        elif isinstance(value, Mapping):
            found[key] = _with_entries(value, named)
    return found


def _entry(entry: ActiveFiles, names: Mapping[str, str]) -> dict[str, Any]:
    found = {"file": list(names.values()), "name": list(names), "cnc": entry.cnc}
    found |= {"sign": entry.sign} if entry.sign else {}
    return found | ({"options": dict(entry.options)} if entry.options else {})


def write_active(group: h5py.Group, files: Sequence[ActiveFiles]) -> None:
    """Write the files of a campaign into an open group, one group for each entry."""
    for i, entry in enumerate(files, start=1):
        here = group.create_group(str(i))
        for key in ("text", "cnc", "sign"):
            here.attrs[key] = getattr(entry, key)
        here.attrs["options"] = to_json(entry.options)
        write_text(here, "names", list(entry.files))
        contents = here.create_group("content")
        for k, content in enumerate(entry.files.values(), start=1):
            write_array(contents, str(k), np.frombuffer(content, np.uint8), np.uint8)


def read_active(group: Group) -> tuple[ActiveFiles, ...]:
    """The files in an open group. Raises `InputError` when something in them is wrong."""
    found = []
    for here in group.numbered():
        attributes, contents = here.attributes, here.group("content")
        names = here.texts("names").tolist()
        files = {n: _bytes(contents, str(k)) for k, n in enumerate(names, start=1)}
        text, cnc, sign = (attributes.text(key) for key in ("text", "cnc", "sign"))
        _refuse_folders(here.where, names)
        found.append(ActiveFiles(text, cnc, files, sign, attributes.json("options", dict)))
    return tuple(found)


def _bytes(group: Group, name: str) -> bytes:
    values = group.array(name, (None,), int)
    if values.size and (values.min() < 0 or values.max() > 255):
        raise InputError(f"{group.place(name)}: holds numbers beyond 0 to 255; expected the bytes of a file")
    return values.astype(np.uint8).tobytes()
