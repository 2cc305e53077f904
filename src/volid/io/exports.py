"""Exports as folders: the files of the control, the commissioning sheet and the record; whole or not at all."""

from __future__ import annotations

from pathlib import Path

from volid.controllers.export import Export
from volid.io.basics.atomic import atomic_folder


def save_export(made: Export, folder: str | Path, *, overwrite: bool = False) -> None:
    """The files of an export in a folder.

    Args:
        made: The export, as `volid.export` makes it.
        folder: A new folder, or with `overwrite` an existing one.
        overwrite: Whether files of an existing folder are replaced.

    Raises:
        OutputError: the folder exists and `overwrite` is False, or it cannot be written.

    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/published_positioning/campaign.toml"))
    >>> folder = getfixture("tmp_path") / "control"
    >>> volid.save_export(volid.export(solution, "linuxcnc", ["L-POS"]), folder)
    >>> sorted(path.name for path in folder.iterdir())
    ['linuxcnc.ini', 'x.comp', 'z.comp']
    """
    with atomic_folder(folder, overwrite) as place:
        for file in made.written.files:
            content = file.content.encode("utf-8") if isinstance(file.content, str) else file.content
            (place / file.name).write_bytes(content)
