"""Exports as folders: the files of the control, the commissioning sheet and the record; whole or not at all."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Sequence
from pathlib import Path

from volid.controllers.export import Export
from volid.controllers.handover.record import record_text
from volid.controllers.handover.sheet import commissioning_sheet
from volid.exceptions import shown
from volid.io.basics.atomic import atomic_folder
from volid.io.basics.provenance import provenance, sha256

SHEET, RECORD = "COMMISSIONING.md", "RECORD.md"


def save_export(
    made: Export,
    folder: str | Path,
    *,
    overwrite: bool = False,
    source: str | Path | None = None,
    command: Sequence[str] = (),
    predict: bool = True,
    words: Callable[[str], str] = str,
) -> None:
    """The files of an export in a folder, with the commissioning sheet and the record.

    Args:
        made: The export, as `volid.export` makes it.
        folder: A new folder, or with `overwrite` an existing one.
        overwrite: Whether files of an existing folder are replaced.
        source: File of the solution, for the record.
        command: Words of the command line, for the record.
        predict: Whether the record says what is expected to remain, which takes some seconds.
        words: How the sheet and the record name parameters; the command line turns them into its options.

    Raises:
        OutputError: the folder exists and `overwrite` is False, or it cannot be written.

    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/published_positioning/campaign.toml"))
    >>> folder = getfixture("tmp_path") / "control"
    >>> volid.save_export(volid.export(solution, "linuxcnc", ["L-POS"]), folder)
    >>> sorted(path.name for path in folder.iterdir() if path.suffix in (".comp", ".md"))
    ['COMMISSIONING.md', 'RECORD.md', 'x.comp', 'z.comp']
    """
    texts = {SHEET: commissioning_sheet(made), RECORD: record_text(made, _origin(source, command), predict)}
    contents = {f.name: f.content for f in made.written.files} | {name: words(text) for name, text in texts.items()}
    with atomic_folder(folder, overwrite) as place:
        for name, content in contents.items():
            (place / name).write_bytes(content.encode("utf-8") if isinstance(content, str) else content)


def _origin(source: str | Path | None, command: Sequence[str]) -> dict[str, str]:
    """Source and its hash, version, date, command."""
    every = provenance()
    found = {} if source is None else {"source": shown(str(source)), "source sha256": sha256(source)}
    found |= {"volid": every["volid"], "date": every["date"]}
    return found | ({"command": shlex.join(command)} if command else {})
