"""Text of files that other programs wrote: which encoding they have, by byte order mark, by form, or as stated.

Spreadsheets and instruments write UTF-8 with and without a mark, UTF-16 (Windows, "Unicode text"), Windows-1252 and Latin-1. A
mark tells; two-byte text without one has zero bytes at every other place; what is no UTF-8 is Windows-1252, or Latin-1 where
that leaves a byte undefined. Numbers are the same in all of them, so that at worst a name is spelt wrongly.
"""

from __future__ import annotations

import codecs
import os
import re
import stat
from pathlib import Path

from volid.exceptions import InputError

UTF8, UTF16, WINDOWS = "UTF-8", "UTF-16", "Windows-1252"
_MARKS = ((codecs.BOM_UTF8, "utf-8-sig"), (codecs.BOM_UTF16_LE, "utf-16"), (codecs.BOM_UTF16_BE, "utf-16"))
_LARGEST = 1 << 30  # bytes: its cells as text would need some ten times as much memory
_LOOKED_AT = 4096  # bytes
_NO_TEXT = re.compile(r"[\x00-\x08\x0e-\x19\x1b-\x1f]")  # DOS programs end a text with 0x1a


def read_bytes(path: Path) -> bytes:
    """The content of a file. Raises `InputError` when it is missing, no file that ends, too large, or cannot be read."""
    try:
        with open(path, "rb", opener=_without_waiting) as file:
            size = _size(path, os.fstat(file.fileno()))
            os.set_blocking(file.fileno(), True)
            data = file.read(_LARGEST + 1)
    except FileNotFoundError:
        raise InputError(f"{path}: there is no such file; check the name and the folder") from None
    except IsADirectoryError:
        raise InputError(f"{path}: it is a folder; name a file in it") from None
    except (OSError, ValueError) as error:
        why = error.strerror if isinstance(error, OSError) else str(error)
        raise InputError(f"{path}: cannot be read: {why}; expected a readable file") from None
    if max(size, len(data)) > _LARGEST:
        raise InputError(f"{path}: larger than {_LARGEST >> 20} MiB; split it into several sets")
    return data


def _without_waiting(path: str, flags: int) -> int:
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))


def _size(path: Path, found: os.stat_result) -> int:
    """Size of a file [bytes]; 0 for a pipe that the shell opened. Raises `InputError` for what may never end."""
    piped = stat.S_ISFIFO(found.st_mode) and str(path).startswith(("/dev/fd/", "/dev/stdin", "/proc/self/fd/"))
    if not (stat.S_ISREG(found.st_mode) or piped):
        raise InputError(f"{path}: is a device or a named pipe, which may never end; expected a file")
    return found.st_size


def decode(data: bytes, path: Path, stated: str | None = None) -> tuple[str, str]:
    """Text with plain line ends and without byte order mark, and the name of its encoding.

    `stated`: the encoding as Python names it; None: recognised. Raises `InputError` for an encoding that does not exist or does
    not fit, and for bytes that are no text.
    """
    text, name = (_by_form(data) if stated is None else _as_stated(data, path, stated)) if data else ("", UTF8)
    text = text.removeprefix("\ufeff").replace("\r\n", "\n").replace("\r", "\n").rstrip("\x1a")
    if found := _NO_TEXT.search(text):
        line = text.count("\n", 0, found.start()) + 1
        raise InputError(
            f"{path}, line {line}: byte 0x{ord(found[0]):02x} stands in no text; expected a text file, such as CSV"
        )
    return text, name


def _as_stated(data: bytes, path: Path, stated: str) -> tuple[str, str]:
    try:
        codecs.lookup(stated)
        return data.decode(stated), stated
    except LookupError:
        raise InputError(
            f"{path}: encoding '{stated}' is unknown; expected such as utf-8, utf-16, cp1252 or latin-1"
        ) from None
    except UnicodeError as error:
        start = getattr(error, "start", 0)
        line = data.count(b"\n", 0, start) + 1
        raise InputError(
            f"{path}, line {line}: byte 0x{data[min(start, len(data) - 1)]:02x} is not {stated} text; state another encoding"
        ) from None


def _by_form(data: bytes) -> tuple[str, str]:
    """Text and encoding by mark, by zero bytes, or by what its bytes can be."""
    for mark, codec in _MARKS:
        if data.startswith(mark):
            return data.decode(codec, errors="replace"), UTF8 if mark == codecs.BOM_UTF8 else UTF16
    head = data[:_LOOKED_AT]
    for offset, codec in ((1, "utf-16-le"), (0, "utf-16-be")):
        places = head[offset::2]
        if places.count(0) > 0.5 * len(places) > 0 and head[1 - offset :: 2].count(0) < 0.1 * len(places):
            return data.decode(codec, errors="replace"), UTF16
    for codec, name in (("utf-8", UTF8), ("cp1252", WINDOWS)):
        try:
            return data.decode(codec), name
        except UnicodeDecodeError:
            pass
    return data.decode("latin-1"), "Latin-1"
