"""Files of controls in a folder that are no part of what a command has just written into it, or read from it."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from volid.controllers.existing.reading import ExistingCompensation


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


def left_out(named: Iterable[str], found: Iterable[ExistingCompensation]) -> list[str]:
    """A sentence for each folder among those `named` with files that `found` does not hold, of its kinds or of any control."""
    from volid.controllers.existing.reading import OWN
    from volid.io.exports import RECORD, SHEET

    held = [(e.cnc, {Path(name).resolve() for name in e.files}) for e in found]
    sentences = []
    for folder in (Path(n) for n in named if Path(n).is_dir()):
        inside = {p.resolve() for p in folder.iterdir() if p.is_file() and p.name not in (RECORD, SHEET)}
        here = [(cnc, read & inside) for cnc, read in held if read & inside]
        names = _like_them(inside, {p for _, read in here for p in read})
        if here and names:
            readers = " and ".join(cnc for cnc, _ in here)
            why = "beside volid's own tables and grids" if readers == OWN else f"because {readers} does not know them"
            sentences.append(f"{folder}: left out, {why}: {names}")
    return sentences


def _like_them(inside: set[Path], read: set[Path]) -> str:
    """Names of the files that were not read, as far as they have the ending of one that was, or a control recognises them."""
    from volid.controllers import CONTROLS
    from volid.exceptions import cut

    kinds = {p.suffix.lower() for p in read}
    names = [
        p.name
        for p in sorted(inside - read)
        if not p.name.startswith(".")
        and (p.suffix.lower() in kinds or any(c.recognises(p.name, p.read_bytes()) for c in CONTROLS.values()))
    ]
    return cut(", ".join(names), 200)
