"""Outputs appear completely or not at all: they are written under another name in the same folder, then renamed.

What is no regular file (standard output, a pipe, the null device) is written through when the work is done, and symbolic links
are followed (`volid.io.basics.targets`).
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from volid.exceptions import OutputError
from volid.io.basics.parts import part_folder
from volid.io.basics.targets import Target, find_target


def write_bytes(path: str | Path, data: bytes | memoryview, overwrite: bool = False) -> None:
    """Write `data` to `path` in one step. Raises `OutputError` as `atomic_output` does.

    >>> write_bytes(getfixture("tmp_path") / "out.bin", b"whole")
    """
    with atomic_output(path, overwrite) as temporary:
        temporary.write_bytes(data)


@contextmanager
def atomic_output(path: str | Path, overwrite: bool = False) -> Iterator[Path]:
    """A temporary path, to be written by the caller, which becomes `path` when the block succeeds.

    When the block fails, the temporary file is removed and an existing `path` is left as it was. Raises `OutputError`
    when `path` exists (unless `overwrite`), is a folder, or cannot be written.

    >>> with atomic_output(getfixture("tmp_path") / "out.csv") as temporary:
    ...     _ = temporary.write_text("X,u")
    """
    target = find_target(path, overwrite)
    with _reported(target.path), part_folder(_beside(target)) as folder:
        temporary = folder / target.path.name
        yield temporary
        target.receive(temporary, overwrite)


@contextmanager
def atomic_folder(path: str | Path, overwrite: bool = False) -> Iterator[Path]:
    """A temporary folder, to be filled by the caller with files and folders; it becomes `path` when the block succeeds.

    With `overwrite`, files of the same name in an existing folder are replaced one by one and the others stay. Raises
    `OutputError` when `path` holds something (unless `overwrite`), is a file, or cannot be written.
    """
    path = Path(path)
    if os.path.isdir(path):  # False for a name too long, which Path.is_dir raises for
        if any(path.iterdir()) and not overwrite:
            raise OutputError(
                f"{path} exists; choose another name or pass `overwrite=True`, which keeps its other files"
            )
    elif os.path.lexists(path):
        raise OutputError(f"{path} is no folder; name a folder")
    real = Path(os.path.realpath(path))
    with _reported(path), part_folder(real) as folder:
        temporary = folder / "filled"
        temporary.mkdir()
        yield temporary
        _move(temporary, path, real)


@contextmanager
def atomic_with_companions(path: str | Path, companions: Sequence[str], overwrite: bool = False) -> Iterator[Path]:
    """A temporary folder for a file named as `path` and its `companions`; all are moved to the folder of `path`, that file last.

    Raises `OutputError` when one of them exists (unless `overwrite`), is no file, or cannot be written.
    """
    path = Path(path)
    targets = [find_target(name, overwrite) for name in (*(path.with_name(n) for n in companions), path)]
    for target in targets:
        if target.file is None:
            raise OutputError(
                f"{target.path} is no file, and {len(targets)} files are written; name a file or a folder"
            )
    with _reported(path), part_folder(_beside(targets[-1])) as folder:
        yield folder
        for target in targets:
            target.receive(folder / target.path.name, overwrite)


def _beside(target: Target) -> Path:
    """Where the temporary folder stands: beside the file, on the same disk; for a stream among temporary files."""
    return target.file or Path(tempfile.gettempdir()) / "stream"


def _move(temporary: Path, path: Path, real: Path) -> None:
    if not real.is_dir():
        os.rename(temporary, real)
        return
    places = [(item, path / item.relative_to(temporary)) for item in sorted(temporary.rglob("*")) if not item.is_dir()]
    for _, place in places:
        place.parent.mkdir(parents=True, exist_ok=True)
    targets = [(item, find_target(place, overwrite=True)) for item, place in places]
    for item, target in targets:
        target.receive(item, overwrite=True)


@contextmanager
def _reported(path: Path) -> Iterator[None]:
    """Raises `OutputError` for an `OSError`. A reader who has seen enough of a stream is no failure: `BrokenPipeError` stays."""
    try:
        yield
    except BrokenPipeError:
        raise
    except OSError as error:
        raise _cannot_write(path, error) from error


def _cannot_write(path: Path, error: OSError) -> OutputError:
    """What is wrong with the place, in words; the errors of HDF5 and of the operating system state it differently."""
    folder = Path(os.path.realpath(path)).parent if os.path.islink(path) else path.parent
    if not os.path.exists(folder):
        reason = f"the folder {folder} does not exist; create it or choose another"
    elif not os.path.isdir(folder):
        reason = f"{folder} is not a folder; choose another place"
    elif isinstance(error, FileNotFoundError):  # what systems say of a folder such as /proc, where no file can be made
        reason = f"no file can be made in the folder {folder}; choose another place"
    else:
        reason = f"{error.strerror or error}; choose another place"
    return OutputError(f"{path} cannot be written: {reason}")
