"""HDF5 files of volid changed on purpose, as a user would with h5py: without the checksum, which the change would belie."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py

from volid.io.basics.hdf5_seal import BLOCK, SIGNATURE


def without_checksum(path: str | Path) -> Path:
    """The file itself, now as versions without checksums wrote it."""
    path = Path(path)
    data = path.read_bytes()
    if not data.startswith(SIGNATURE):
        path.write_bytes(data[BLOCK:])
    return path


@contextmanager
def changed(path: str | Path) -> Iterator[h5py.File]:
    """The file without its checksum, open to be changed."""
    with h5py.File(without_checksum(path), "r+") as file:
        yield file
