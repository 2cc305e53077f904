"""What TOML can hold and volid cannot: endless nesting, whole numbers beyond 64 bits, control characters in names.

Everything is looked at once, where a file is parsed, so that no reader of a key has to expect it.
"""

from __future__ import annotations

import datetime
import re
from typing import Any

from volid.exceptions import InputError, cut

DEEPEST = 32  # tables and lists within each other; volid's own files have 5
_WHOLE = 2**63  # TOML 1.0: whole numbers have 64 bits
# Of control characters a text may hold tab and line ends. ESC and its like command a terminal, and HDF5 ends texts at NUL.
_CONTROL = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f]")
_DOTS = 200  # of one key, with which a parser still takes a moment
_PART = re.compile(r"[\w\"'][ \t]*\.")
_IN_NAMES = re.compile("[\x00-\x1f\x7f-\x9f]")


def refuse_long_keys(text: str, source: str) -> None:
    """Raises `InputError` for a key of hundreds of parts, a.a.a…, on which a parser takes minutes."""
    for number, line in enumerate(text.split("\n"), start=1):
        suspect = line.count(".") > _DOTS and not line.lstrip().startswith("#")
        if suspect and max(len(_PART.findall(piece)) for piece in re.split("[,=]", line)) > _DOTS:
            raise too_deep(f"{source}, line {number}")


def checked(value: Any, source: str, keys: tuple[str, ...] = ()) -> Any:
    """The value, with dates as ISO 8601 text. Raises `InputError` naming file and key for what volid cannot hold."""
    if len(keys) > DEEPEST:
        raise too_deep(f"{source}, {cut('.'.join(keys))}")
    if isinstance(value, dict):
        for key in value:
            refuse_control(key, f"{source}: a key", one_line=True)
        return {key: checked(item, source, (*keys, key)) for key, item in value.items()}
    if isinstance(value, list):
        return [checked(item, source, (*keys, str(i))) for i, item in enumerate(value, start=1)]
    if isinstance(value, str):
        refuse_control(value, f"{source}: {cut('.'.join(keys))}")
    if isinstance(value, int) and not -_WHOLE <= value < _WHOLE:
        digits = len(str(abs(value)))
        raise InputError(
            f"{source}: {cut('.'.join(keys))} is a whole number of {digits} digits; expected less than 19 digits"
        )
    return value.isoformat() if isinstance(value, datetime.date | datetime.time) else value


def refuse_control(text: str, what: str, one_line: bool = False) -> None:
    """Raises `InputError` for a control character, with `one_line` for a tab or line end too; `what`: place and key."""
    found = (_IN_NAMES if one_line else _CONTROL).search(text)
    if found:
        raise InputError(
            f"{what} is '{text}', with the control character U+{ord(found.group()):04X}; expected printable text, remove it"
        )


def too_deep(where: str) -> InputError:
    """The `InputError` for tables and lists nested without sense."""
    return InputError(f"{where}: nested more than {DEEPEST} deep; expected plain tables, remove the brackets or dots")
