"""HDF5 files appear completely or not at all, also when the disk is full.

HDF5 cannot close a file whose last bytes find no room, and ends the process. So it writes through a file of Python that remembers
the first error and goes on as if all were well; once HDF5 has closed, the error is raised and nothing is left. The checksum is
written last (`volid.io.basics.hdf5_seal`). What is written is not held in memory.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from io import FileIO
from pathlib import Path

import h5py

from volid.exceptions import OutputError
from volid.io.basics.atomic import atomic_output
from volid.io.basics.hdf5_seal import BLOCK, seal


@contextmanager
def hdf5_output(path: str | Path, overwrite: bool = False) -> Iterator[h5py.File]:
    """An HDF5 file to be filled; it appears as `path`, with its checksum, when the block succeeds.

    Raises `OutputError` when `path` exists (unless `overwrite`), or cannot be written, or a text holds the character U+0000,
    which HDF5 cannot store; then nothing is written.
    """
    with atomic_output(path, overwrite) as temporary, temporary.open("w+b", buffering=0) as raw:
        patient = _PatientFile(raw)
        try:
            with h5py.File(patient, "w", userblock_size=BLOCK) as file:
                yield file
        except (OSError, RuntimeError) as error:
            raise patient.error or error from None
        except ValueError as error:
            if "NULL" not in str(error):
                raise
            raise OutputError(
                f"{path} cannot be written: a text holds the character U+0000, which HDF5 cannot store; remove it"
            ) from None
        if patient.error is not None:
            raise patient.error
        seal(raw)


class _PatientFile:
    """A file for h5py that keeps its first error of writing in `error` and says that everything was written."""

    def __init__(self, raw: FileIO) -> None:
        self.raw = raw
        self.error: OSError | None = None

    def seek(self, offset: int, whence: int = 0) -> int:
        """As for every file."""
        return self.raw.seek(offset, whence)

    def tell(self) -> int:
        """As for every file."""
        return self.raw.tell()

    def write(self, data: bytes | memoryview) -> int:
        """Write all of `data`, or remember why not."""
        rest = memoryview(data)
        length = rest.nbytes
        try:
            while self.error is None and rest.nbytes:
                rest = rest[self.raw.write(rest) :]
        except OSError as error:
            self.error = error
        return length

    def truncate(self, size: int | None = None) -> int:
        """Set the size, or remember why not."""
        try:
            if self.error is None:
                self.raw.truncate(size)
        except OSError as error:
            self.error = error
        return self.raw.tell() if size is None else size

    def readinto(self, buffer: memoryview) -> int:
        """Read what was written; zeros stand for what found no room."""
        rest = memoryview(buffer)
        done = self.raw.readinto(rest) or 0
        rest[done:] = bytes(rest.nbytes - done)
        return rest.nbytes

    def read(self, size: int = -1) -> bytes:
        """As for every file; h5py asks for it to see that this is one."""
        return self.raw.read(size)

    def flush(self) -> None:
        """Nothing is held back."""
