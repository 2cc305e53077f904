"""Whether an HDF5 file may be opened: its checksum is right, or a process of its own has read it without harm.

A damaged file can make the HDF5 library loop for ever or end the process, and no message comes of that. A right checksum shows
that a file is what volid wrote. A file without one, of an earlier version or another program, is first read by a process with a
limit of time and memory, which takes a fifth of a second for small files. A checksum is no signature: it does not protect
from somebody who forges it.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

from volid.exceptions import InputError
from volid.io.basics import hdf5_structure
from volid.io.basics.hdf5_seal import check_seal, damaged

# Processor time allowed for any file [s], and for its size; reading takes a tenth of that
SECONDS, BYTES_PER_SECOND = 5, 20_000_000
READER = Path(hdf5_structure.__file__)
PATIENCE = 20  # times as long by the clock, on a busy machine or one that limits no processor time
_RIGHT: set[tuple[int, ...]] = set()  # files found right by this process, by what tells them from their changed selves
_REMEMBERED = 64
_SETTLED = 2.0  # s: a file that changed only now may change again within one tick of the clock of its times


def is_known(path: str | Path) -> bool:
    """Whether this process has found the file right already (`remember`); else its contents are still to be checked.

    Raises `InputError` when the file is damaged or cannot be read safely.
    """
    if _key(os.stat(path)) in _RIGHT:
        return True
    if not check_seal(path):
        _read_in_process(path, os.path.getsize(path))
    return False


def remember(path: str | Path) -> None:
    """The contents of the file have been checked (`hdf5_structure.check_structure`) and are right."""
    state = os.stat(path)
    if time.time() - max(state.st_mtime, state.st_ctime) > _SETTLED:
        if len(_RIGHT) >= _REMEMBERED:
            _RIGHT.clear()
        _RIGHT.add(_key(state))


def _key(state: os.stat_result) -> tuple[int, ...]:
    return state.st_dev, state.st_ino, state.st_size, state.st_mtime_ns, state.st_ctime_ns


def _read_in_process(path: str | Path, size: int) -> None:
    """Let a process of its own read the whole file. Raises `InputError` when it does not end well and in time."""
    seconds = SECONDS + size // BYTES_PER_SECOND
    one_thread = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
    environment = os.environ | one_thread | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    command = [sys.executable, "-P", os.fspath(READER), os.fspath(path), str(seconds)]
    try:
        done = subprocess.run(
            command,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=PATIENCE * seconds,
            env=environment,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise damaged(path, f"it cannot be read within {PATIENCE * seconds} s") from None
    except OSError:  # no process can be started here: its structure is checked, but nothing limits the time of that
        return
    verdict, _, what = done.stdout.decode("utf-8", "replace").strip().partition(" ")
    if verdict == "unfit":
        raise unfit(path, what)
    if verdict == "damaged" or done.returncode:
        raise damaged(path, what or f"the HDF5 library fails on it, or works for more than {seconds} s")


def unfit(path: str | Path, what: str) -> InputError:
    """The `InputError` for a file that holds what volid does not read: `what` says place, finding and expectation."""
    return InputError(f"{path}, {what}; copy or write the file again")
