"""Files of other programs as a campaign, or as the table of what they have evaluated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from volid.campaign import Campaign
from volid.exceptions import shown
from volid.io.basics.toml_table import Table
from volid.io.campaign.delimited import TEXT
from volid.io.campaign.foreign import AS, RECOGNISE
from volid.io.campaign.manifest import campaign_of
from volid.io.campaign.rules import FORMAT
from volid.io.instruments.base import EvaluatedFormat, Evaluation
from volid.io.instruments.recognition import check_is, format_called, open_foreign, recognised


def import_files(files: Sequence[str | Path], machine: str | Path, keys: Mapping[str, Any] | None = None) -> Campaign:
    """A campaign from files that instruments and other programs wrote, each one set.

    Args:
        files: The files; a set is called as its file without the ending.
        machine: The machine file.
        keys: Keys of every set, as a `[[set]]` of a manifest has them: `as` (recognised by content when it is absent), `u`,
            `tool`, and those of the format, such as `axis` and `at`.

    Raises:
        InputError: naming file and line, or key.
    """
    where = ", ".join(shown(str(file)) for file in files)
    names = _names(files)
    sets = [
        {"name": name, "file": str(file), AS: RECOGNISE, **(keys or {})}
        for name, file in zip(names, files, strict=True)
    ]
    top = Table({"format": FORMAT, "machine": str(machine), "set": sets}, where)
    return campaign_of(top, Path(), allow_outside=True)


def evaluation_of(file: str | Path, name: str = RECOGNISE, encoding: str | None = None) -> Evaluation | None:
    """What another program has evaluated, as its file holds it; None for a file of readings.

    `name`: the type of the file, "auto" by content. Raises `InputError` where it is not of that type, or of none.
    """
    if name == TEXT:
        return None
    opened = open_foreign(Path(file), encoding)
    known = recognised(opened) if name == RECOGNISE else format_called(name, str(file))
    check_is(opened, known)
    return known.evaluation(opened) if isinstance(known, EvaluatedFormat) else None


def _names(files: Sequence[str | Path]) -> list[str]:
    """Names of the sets: those of the files, with a number where one stands twice."""
    found: list[str] = []
    for i, file in enumerate(files, start=1):
        stem = shown(Path(file).stem)
        found.append(stem if stem not in found else f"{stem} {i}")
    return found
