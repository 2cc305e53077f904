"""Programs of G-code as files: read whatever their line ends and encoding, written with the same."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from volid.exceptions import InputError
from volid.io.basics.atomic import atomic_output
from volid.io.basics.encodings import UTF8, UTF16, decode, read_bytes

_CODECS = {UTF8: "utf-8", UTF16: "utf-8", "Windows-1252": "cp1252"}  # what is written for what was read


class Program(NamedTuple):
    """A program as a file holds it. `text`: with plain line ends. `line_end`: "\\n" or "\\r\\n". `encoding`: its name."""

    text: str
    line_end: str
    encoding: str


def read_program(path: str | Path) -> Program:
    """A program with its line ends and encoding.

    Args:
        path: Path of the file.

    Raises:
        InputError: it cannot be read, is no text, or is empty.

    >>> path = getfixture("tmp_path") / "part.nc"
    >>> _ = path.write_bytes(b"G21" + bytes([13, 10]) + b"G0 X1" + bytes([13, 10]))
    >>> read_program(path).text, read_program(path).line_end
    ('G21\\nG0 X1\\n', '\\r\\n')
    """
    data = read_bytes(Path(path))
    text, encoding = decode(data, Path(path))
    if not text.strip():
        raise InputError(f"{path}: the file is empty; expected a program of G-code")
    return Program(text, "\r\n" if b"\r\n" in data[:4096] else "\n", encoding)


def save_program(text: str, path: str | Path, like: Program, *, overwrite: bool = False) -> None:
    """A program in a file, whole or not at all.

    Args:
        text: The program, with plain line ends.
        path: Path of the file.
        like: The program whose line ends and encoding it takes.
        overwrite: Whether an existing file is replaced.

    Raises:
        OutputError: the file exists and `overwrite` is False, or it cannot be written.

    >>> path = getfixture("tmp_path") / "out.nc"
    >>> save_program("G0 X1" + chr(10), path, Program("", chr(13) + chr(10), "UTF-8"))
    >>> path.read_bytes()
    b'G0 X1\\r\\n'
    """
    data = text.replace("\n", like.line_end).encode(_CODECS.get(like.encoding, "latin-1"), errors="replace")
    with atomic_output(path, overwrite) as temporary:
        temporary.write_bytes(data)
