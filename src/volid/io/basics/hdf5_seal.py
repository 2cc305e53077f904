"""A checksum before every HDF5 file of volid: damage is noticed before the HDF5 library sees it.

The first 512 bytes of a file, its user block in the words of HDF5, are text: the number of bytes that follow and their SHA-256.
One changed bit anywhere is noticed, whether it lies in numbers, texts or what holds them together. HDF5 skips the block, so every
program that reads HDF5 reads the file. Files of earlier versions have no such block and begin with the signature of HDF5.
A file that was changed on purpose is read once its checksum is cut off: `tail -c +513 campaign.h5 > changed.h5`.
"""

from __future__ import annotations

import hashlib
from io import BufferedRandom, FileIO
from pathlib import Path

from volid.exceptions import InputError

SIGNATURE = b"\x89HDF\r\n\x1a\n"
BLOCK = 512  # bytes, the smallest user block
_MARK = b"volid: HDF5 "
_AGAIN = "copy or write it again"


def begins_like_hdf5(start: bytes) -> bool:
    """Whether a file with these first bytes, at least 520 of them if it has so many, is HDF5, even if it is damaged."""
    return start.startswith((SIGNATURE, _MARK)) or start[BLOCK : BLOCK + len(SIGNATURE)] == SIGNATURE


def seal(file: FileIO | BufferedRandom) -> None:
    """Write the checksum of what follows the first 512 bytes of `file` into them."""
    file.seek(BLOCK)
    digest = hashlib.file_digest(file, "sha256").hexdigest()
    block = _block(digest, file.seek(0, 2) - BLOCK)
    file.seek(0)
    file.write(block)


def _block(digest: str, size: int) -> bytes:
    text = _MARK.decode() + f"from byte {BLOCK} on\nbytes: {size}\nsha256: {digest}\n"
    return text.encode().ljust(BLOCK, b"\n")


def check_seal(path: str | Path) -> bool:
    """Whether the file has a checksum; a file of an earlier version has none.

    Raises `InputError` when the file is not what was written.
    """
    with open(path, "rb") as file:
        block = file.read(BLOCK)
        if block.startswith(SIGNATURE):
            return False
        digest = hashlib.file_digest(file, "sha256").hexdigest()
        size = max(file.tell() - BLOCK, 0)
    if block == _block(digest, size):
        return True
    stated = block.partition(b"\nbytes: ")[2].partition(b"\n")[0]
    if stated.isdigit() and len(stated) < 16 and int(stated) > size:
        raise damaged(path, f"{size + BLOCK} of {int(stated) + BLOCK} bytes are there")
    raise InputError(
        f"{path}: the HDF5 file is truncated or damaged (its SHA-256 is not that in its first {BLOCK} bytes); {_AGAIN}. "
        f"If it was changed on purpose, cut off these {BLOCK} bytes and it is read without a checksum"
    )


def damaged(path: str | Path, how: str) -> InputError:
    """The `InputError` for a file that cannot be read, and how that showed."""
    return InputError(f"{path}: the HDF5 file is truncated or damaged ({how}); {_AGAIN}")
