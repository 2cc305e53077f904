"""What the name of an output leads to: a file to be replaced, links followed, or a stream to be written through.

A stream is what is no regular file: standard output and other open descriptors (`/dev/stdout`, the `/dev/fd/63` of a process
substitution), pipes, and character devices such as the null device. Such a thing is never replaced. A symbolic link stays; the
file that it leads to is replaced in its own folder.
"""

from __future__ import annotations

import os
import posixpath
import re
import shutil
import stat
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from volid.exceptions import OutputError

_DESCRIPTOR = re.compile(r"/(?:dev|proc/self)/fd/(\d+)")
_STANDARD = {"/dev/stdin": 0, "/dev/stdout": 1, "/dev/stderr": 2}


@dataclass(frozen=True)
class Target:
    """Where an output goes. `path`: as it was named; `file`: the file to be replaced, None for a stream."""

    path: Path
    file: Path | None

    def receive(self, temporary: Path, overwrite: bool) -> None:
        """Put the file `temporary` in this place, in one step where the place is a file.

        Raises `OutputError` when something stands there now that may not be replaced, `OSError` when the system refuses.
        """
        now = find_target(self.path, overwrite)  # once more: something may have come since
        if now.file is None:
            with _opened(self.path) as stream, temporary.open("rb") as source:
                shutil.copyfileobj(source, stream)
            return
        with suppress(OSError):  # a file that is replaced keeps who may read it
            shutil.copymode(now.file, temporary)
        os.replace(temporary, now.file)


def find_target(path: str | Path, overwrite: bool = False) -> Target:
    """What `path` leads to. Raises `OutputError` for an existing file (unless `overwrite`), a folder, a disk or a socket.

    >>> find_target("/dev/null").file is None, find_target("README.md", overwrite=True).file.name
    (True, 'README.md')
    """
    path = Path(path)
    if _descriptor(path) is not None:
        return Target(path, None)
    mode = _mode(path)
    if stat.S_ISDIR(mode):
        raise OutputError(f"{path} is a folder; name a file")
    if stat.S_ISBLK(mode) or stat.S_ISSOCK(mode):
        raise OutputError(f"{path} is a {'disk' if stat.S_ISBLK(mode) else 'socket'}; name a file")
    if stat.S_ISCHR(mode) or stat.S_ISFIFO(mode):
        return Target(path, None)
    if os.path.lexists(path) and not overwrite:
        raise OutputError(f"{path} exists; choose another name or pass `overwrite=True`")
    file = Path(os.path.realpath(path))
    if os.path.islink(file):
        raise OutputError(f"{path} is a link that leads back to itself; name a file")
    return Target(path, file)


def _mode(path: Path) -> int:
    """Type of what `path` leads to, 0 when there is nothing or it cannot be told."""
    try:
        return os.stat(path).st_mode
    except (OSError, ValueError):
        return 0


def _descriptor(path: Path) -> int | None:
    """The open descriptor of this process that `path` names."""
    name = posixpath.normpath(path.as_posix())
    match = _DESCRIPTOR.fullmatch(name)
    return int(match[1]) if match else _STANDARD.get(name)


def _opened(path: Path) -> BinaryIO:
    """A stream to write to. A descriptor is used as it is, so that what was written to it before stays."""
    number = _descriptor(path)
    return open(path, "wb") if number is None else os.fdopen(os.dup(number), "wb")
