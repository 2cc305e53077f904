"""Outputs under way: a folder beside the output, locked while it is written, and removed when its process was killed.

The folder's name tells host and process. Both can be the same in two containers that share a disk, so a lock decides: a folder is
left alone while somebody holds it.
"""

from __future__ import annotations

import glob
import os
import platform
import shutil
import sys
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

if sys.platform == "win32":  # no containers of one name there; host and process decide
    fcntl = None
else:
    import fcntl

HOST = platform.node()[:40] or "machine"
_SHOWN = 20  # characters of the output's name; file systems allow 255 bytes


@contextmanager
def part_folder(path: Path) -> Iterator[Path]:
    """A folder beside `path` for files that will be moved to it, removed at the end. Raises `OSError` when there can be none.

    Those that killed processes of this machine left for the same output are removed.
    """
    path = path.absolute()
    stem = f".{path.name[:_SHOWN]}."
    for leftover in path.parent.glob(f"{glob.escape(stem)}*.part"):
        _remove_abandoned(leftover)
    unique = f"{stem}{HOST}.{os.getpid()}.{uuid.uuid4().hex[:8]}"
    fresh, folder = path.with_name(f"{unique}.new"), path.with_name(f"{unique}.part")
    fresh.mkdir(mode=0o700)
    lock = _locked(fresh)  # held before it has the name by which others look for leftovers
    try:
        os.rename(fresh, folder)
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        shutil.rmtree(fresh, ignore_errors=True)
        if lock is not None:
            os.close(lock)


def _remove_abandoned(leftover: Path) -> None:
    """Remove a folder of a process of this host that does not run and that nobody holds, in another container neither."""
    *_, process, _, _ = leftover.name.split(".")
    if f".{HOST}.{process}." not in leftover.name or not process.isdigit() or _runs(int(process)):
        return
    lock = _locked(leftover)
    if lock is not None or fcntl is None:
        shutil.rmtree(leftover, ignore_errors=True)
    if lock is not None:
        os.close(lock)


def _locked(folder: Path) -> int | None:
    """A descriptor that holds `folder`; None when somebody else does, or the disk knows no locks."""
    if fcntl is None:
        return None
    try:
        descriptor = os.open(folder, os.O_RDONLY)
    except OSError:
        return None
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(descriptor)
        return None
    return descriptor


def _runs(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):
        return True
    return True
