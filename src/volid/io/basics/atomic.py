"""Outputs appear completely or not at all: they are written under a temporary name in the same folder, then renamed."""

from __future__ import annotations

import glob
import os
import platform
import shutil
import uuid
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from volid.exceptions import OutputError

HOST = platform.node()[:40] or "machine"


@contextmanager
def atomic_output(path: str | Path, overwrite: bool = False) -> Iterator[Path]:
    """A temporary path in the folder of `path`, to be written by the caller; renamed to `path` when the block succeeds.

    When the block fails, the temporary file is removed and an existing `path` is left as it was. Raises `OutputError`
    when `path` exists (unless `overwrite`), is a folder, or cannot be written.

    >>> with atomic_output(getfixture("tmp_path") / "out.csv") as temporary:
    ...     _ = temporary.write_text("X,u")
    """
    path = Path(path)
    _refuse_existing(path, overwrite)
    temporary = _temporary(path)
    try:
        yield temporary
        _refuse_existing(path, overwrite)
        os.replace(temporary, path)
    except OSError as error:
        raise _cannot_write(path, error) from error
    finally:
        with suppress(OSError):
            temporary.unlink()


@contextmanager
def atomic_folder(path: str | Path, overwrite: bool = False) -> Iterator[Path]:
    """A temporary folder beside `path`, to be filled by the caller; it becomes `path` when the block succeeds.

    With `overwrite`, files of the same name in an existing folder are replaced one by one and the others stay. Raises
    `OutputError` when `path` holds something (unless `overwrite`), is a file, or cannot be written.
    """
    path = Path(path)
    if path.is_dir():
        _refuse_existing(path, overwrite or not any(path.iterdir()), folder=True)
    elif os.path.lexists(path):
        raise OutputError(f"{path} is a file; name a folder")
    temporary = _temporary(path)
    try:
        temporary.mkdir()
        yield temporary
        _move(temporary, path)
    except OSError as error:
        raise _cannot_write(path, error) from error
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


@contextmanager
def atomic_with_companions(path: str | Path, companions: Sequence[str], overwrite: bool = False) -> Iterator[Path]:
    """A temporary folder for a file named as `path` and its `companions`; all are moved to the folder of `path`, that file last.

    Raises `OutputError` when one of them exists (unless `overwrite`), is a folder, or cannot be written.
    """
    path = Path(path)
    targets = [*(path.with_name(name) for name in companions), path]
    for target in targets:
        _refuse_existing(target, overwrite)
    temporary = _temporary(path)
    try:
        temporary.mkdir()
        yield temporary
        for target in targets:
            os.replace(temporary / target.name, target)
    except OSError as error:
        raise _cannot_write(path, error) from error
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def _move(temporary: Path, path: Path) -> None:
    if not path.is_dir():
        os.rename(temporary, path)
        return
    for item in temporary.iterdir():
        os.replace(item, path / item.name)


def _temporary(path: Path) -> Path:
    """A temporary name beside `path` for this process; files that killed processes of this machine left there are removed."""
    path = path.absolute()
    for leftover in path.parent.glob(f".{glob.escape(path.name)}.*.part"):
        host, _, process = leftover.name[len(path.name) + 2 : -len(".part")].rpartition(".")[0].rpartition(".")
        if host == HOST and process.isdigit() and not _runs(int(process)):
            if leftover.is_dir():
                shutil.rmtree(leftover, ignore_errors=True)
            else:
                with suppress(OSError):
                    leftover.unlink()
    return path.with_name(f".{path.name}.{HOST}.{os.getpid()}.{uuid.uuid4().hex[:8]}.part")


def _runs(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True
    return True


def _refuse_existing(path: Path, overwrite: bool, folder: bool = False) -> None:
    if os.path.isdir(path) and not folder:  # False for a name too long, which Path.is_dir raises for
        raise OutputError(f"{path} is a folder; name a file")
    if os.path.lexists(path) and not overwrite:
        raise OutputError(f"{path} exists; choose another name or pass `overwrite=True`")


def _cannot_write(path: Path, error: OSError) -> OutputError:
    """What is wrong with the place, in words; the errors of HDF5 and of the operating system state it differently."""
    folder = path.parent
    if not folder.exists():
        reason = f"the folder {folder} does not exist; create it or choose another"
    elif not folder.is_dir():
        reason = f"{folder} is not a folder; choose another place"
    else:
        reason = f"{error.strerror or error}; choose another place"
    return OutputError(f"{path} cannot be written: {reason}")
