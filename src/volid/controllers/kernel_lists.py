"""Lists of parameters of the ISG kernel (also sold as TwinCAT CNC): lines of a key and a value, comments `#` and `/* … */`.

Keys such as `kw.crosscomp2.table[ 0][ 12].correction` may hold blanks within their brackets. Letters may be small or capital: the
vendor's pages write the same keys both ways.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from math import isfinite

from volid.exceptions import InputError

_KEY = re.compile(r"([A-Za-z_][\w.]*(?:\[\s*\d+\s*\][\w.]*)*)\s+(\S.*)")
_COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)
LARGEST = 1e12  # of a number: 100 km in units of 0.1 µm


@dataclass(frozen=True)
class Entry:
    """A value of a list as text, with the place where it stands, such as "x.lis, line 4: kw.ssfk.unit"."""

    value: str
    where: str

    @property
    def number(self) -> float:
        """The value as a number. Raises `InputError`."""
        try:
            found = float(self.value)
        except ValueError:
            found = float("nan")
        if not isfinite(found) or abs(found) > LARGEST:
            raise InputError(f"{self.where} is '{self.value}'; expected a number")
        return found

    def whole(self, least: int = 0, most: int = 10**9) -> int:
        """The value as a whole number in a range. Raises `InputError`."""
        found = self.number
        if found != int(found) or not least <= found <= most:
            raise InputError(f"{self.where} is '{self.value}'; expected a whole number, {least} … {most}")
        return int(found)


def entries(name: str, text: str) -> dict[str, Entry]:
    """Values by key, in small letters and without blanks in brackets.

    Raises `InputError` for a line that is no key with a value, and for a key that stands twice.
    """
    found: dict[str, Entry] = {}
    plain = _COMMENT.sub(lambda m: re.sub(r"[^\n]", " ", m[0]), text)  # line numbers stay
    for number, line in enumerate(plain.splitlines(), 1):
        content = line.split("#", 1)[0].strip()
        if not content or content.lower() == "end":
            continue
        match = _KEY.fullmatch(content)
        if match is None:
            raise InputError(
                f"{name}, line {number}: '{content[:60]}'; expected a key and a value, such as 'chain XYZ'"
            )
        key = re.sub(r"\s", "", match[1]).lower()
        if key in found:
            raise InputError(f"{name}, line {number}: {key} stands twice; expected it once")
        found[key] = Entry(match[2].strip(), f"{name}, line {number}: {key}")
    return found


def needed(name: str, found: dict[str, Entry], key: str) -> Entry:
    """The value of a key. Raises `InputError` where the list does not have it."""
    if key not in found:
        raise InputError(f"{name}: {key} is missing; without it the list cannot be understood")
    return found[key]


def lines(pairs: Iterable[tuple[str, object]]) -> str:
    """Text of keys and values, one per line."""
    return "".join(f"{key:<34} {value}\n" for key, value in pairs)
