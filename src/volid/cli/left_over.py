"""Files of controls that stand in a folder from before, beside what a command has just written into it."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path


def files_in(folder: str | Path) -> frozenset[str]:
    """Names of the files in a folder and its folders, relative to it; none where it does not exist yet."""
    place = Path(folder)
    return frozenset(p.relative_to(place).as_posix() for p in place.rglob("*") if p.is_file())


def left_over(folder: str | Path, before: Iterable[str], written: Iterable[str]) -> list[str]:
    """A sentence about those of the files `before` that a control would recognise and that were not `written` now."""
    from volid.controllers import CONTROLS
    from volid.exceptions import cut
    from volid.io.own_files import is_own

    place, found = Path(folder), []
    for name in sorted(set(before) - set(written)):
        content = (place / name).read_bytes()
        if any(c.recognises(name, content) for c in CONTROLS.values()) or is_own(place / name):
            found.append(name)
    if not found:
        return []
    return [
        f"{place} holds files of a control from before, which are not part of this export: {cut(', '.join(found), 200)}; remove "
        "them before the folder goes to the control"
    ]
