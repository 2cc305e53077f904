"""Which type a file is of, by its content, and what it seems to be where it is the wrong one."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

from volid.exceptions import InputError
from volid.io.basics.encodings import decode, read_bytes
from volid.io.basics.toml_table import FILE_TYPES, nearest
from volid.io.instruments import FORMATS, Format
from volid.io.instruments.base import ForeignFile
from volid.io.instruments.sections import is_run_file

_BEGINNINGS = (
    (b"\x89HDF\r\n\x1a\n", "an HDF5 file, as volid writes campaigns and solutions"),
    (b"PK\x03\x04", "a workbook or archive (ZIP)"),
    (b"\xd0\xcf\x11\xe0", "a workbook of an old office program"),
    (b"%PDF", "a PDF document"),
    (b"\x1f\x8b", "a compressed file (gzip)"),
    (b"\x89PNG", "an image (PNG)"),
    (b"\xff\xd8\xff", "an image (JPEG)"),
    (b"GIF8", "an image (GIF)"),
    (b"BM", "an image (BMP)"),
)
_TEXT_AFTER = (b"BM",)  # what may also begin a text
_TAG = re.compile(r"""^[ \t]{0,40}(?:#[ \t]{0,9})?format[ \t]{0,9}[=:][ \t]{0,9}["']?(volid-[a-z-]+)/""", re.MULTILINE)
_HDF5 = b"\x89HDF\r\n\x1a\n"
_LOOKED_AT = 20000  # characters


def open_foreign(path: Path, encoding: str | None = None) -> ForeignFile:
    """A file as text. Raises `InputError` for one that is missing, empty, or no text, saying what it seems to be."""
    data = read_bytes(path)
    if what := _binary(data):
        raise InputError(f"{path}: this is {what}; expected {all_words()}")
    if not data.strip():
        raise InputError(f"{path}: the file is empty; expected {all_words()}")
    return ForeignFile(path, *decode(data, path, encoding))


def _binary(data: bytes) -> str:
    if data[512:520] == _HDF5:  # volid's own have a checksum before it
        return _BEGINNINGS[0][1]
    for beginning, what in _BEGINNINGS:
        if data.startswith(beginning) and not (beginning in _TEXT_AFTER and b"\0" not in data[:64]):
            return what
    return ""


def all_words() -> str:
    """Everything that is read, in words."""
    listed = "; ".join(f"{f.words} ({name})" for name, f in FORMATS.items())
    return f"{listed}; or a table with a map of its columns (text)"


def format_called(name: str, where: str) -> Format:
    """The format called `name`. Raises `InputError` listing those there are."""
    if name not in FORMATS:
        known = ", ".join([*FORMATS, "text"])
        raise InputError(f"{where}: as is '{name}'{nearest(name, FORMATS) or ';'} this version reads {known}")
    return FORMATS[name]


def fitting(file: ForeignFile) -> list[Format]:
    """The types that a file can be, by its content; where one content fits several, the ending of its name decides."""
    found = [f for f in FORMATS.values() if f.recognises(file.text)]
    ending = file.path.suffix.lower().lstrip(".")
    return [f for f in found if f.name == ending] or found


def known_as(path: Path) -> Format | None:
    """The type of a file of another program; None for any other file, also one that cannot be read."""
    try:
        found = fitting(open_foreign(path))
    except InputError:
        return None
    return found[0] if found else None


def recognised(file: ForeignFile) -> Format:
    """The type of a file, by its content. Raises `InputError` where it is none of them, or could be several."""
    found = fitting(file)
    if len(found) == 1:
        return found[0]
    if found:
        raise InputError(
            f"{file.path}: this could be {' or '.join(f.words for f in found)}; say which: as = "
            f"{' or '.join(repr(f.name) for f in found)}"
        )
    raise InputError(f"{file.path}: this seems to be {what_it_seems(file.text)}; expected {all_words()}")


def check_is(file: ForeignFile, wanted: Format) -> None:
    """Raises `InputError` for a file that is not of the type `wanted`, saying what it seems to be."""
    if not wanted.recognises(file.text):
        raise InputError(f"{file.path}: this seems to be {what_it_seems(file.text)}; expected {wanted.words}")


def what_it_seems(text: str) -> str:
    """What a text seems to be, in words."""
    if own := volids_own(text):
        return own
    for known in FORMATS.values():
        if known.recognises(text):
            return f'{known.words} (as = "{known.name}")'
    return next((words for words, is_it in _SEEMS if is_it(text[:_LOOKED_AT])), "a text of no known type")


def volids_own(text: str) -> str:
    """What a text file of volid's own is, in words, or nothing."""
    tag = _TAG.search(text[:_LOOKED_AT])
    if tag is None:
        return ""
    return f"{FILE_TYPES[tag[1]][0]} of volid" if tag[1] in FILE_TYPES else "a file of volid"


def _begins(*starts: str) -> Callable[[str], bool]:
    return lambda text: text.lstrip().lower().startswith(starts)


def _is_table(text: str) -> bool:
    lines = [line for line in text.splitlines()[:5] if line.strip() and not line.startswith("#")]
    return len(lines) > 1 and any(
        all(line.count(sign) == lines[0].count(sign) > 0 for line in lines) for sign in ",;\t"
    )


_SEEMS: tuple[tuple[str, Callable[[str], bool]], ...] = (
    ("runs of a laser interferometer in a file of another type", is_run_file),
    ("a web page (HTML)", _begins("<!doctype html", "<html")),
    ("an XML document of another type", _begins("<?xml", "<!doctype", "<")),
    ("a JSON document", _begins("{", "[{")),
    ("a table of delimited columns", _is_table),
)
