"""Lists of parameters of the ISG kernel (also sold as TwinCAT CNC): lines of a key and a value, comments `#` and `/* … */`.

Keys such as `kw.crosscomp2.table[ 0][ 12].correction` may hold blanks within their brackets. Letters may be small or capital: the
vendor's pages write the same keys both ways.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from math import isfinite

import numpy as np

from volid.exceptions import InputError
from volid.model.machine import Axis, Machine

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


# ------------------------------------------------------------------------------------------------ lists of axes

STEPS = 10000.0  # in one mm or degree: positions and values are counted in 0.1 µm or 0.0001°


def one_of(*words: str) -> Callable[[str], str]:
    """Converter of an option that is one of some words."""

    def convert(text: str) -> str:
        if text not in words:
            raise ValueError(f"expected {' or '.join(repr(w) for w in words)}")
        return text

    return convert


def axis_numbers(text: str) -> dict[str, int]:
    """Logical axis numbers by letter, from a text such as "X=1 Y=2 Z=3". Raises `ValueError`."""
    pairs = re.findall(r"([XYZABC])=(\d{1,5})", text)
    if not pairs or " ".join(f"{a}={n}" for a, n in pairs) != " ".join(text.split()):
        raise ValueError("expected the logical axis numbers, such as 'X=1 Y=2 Z=3'")
    return {a: int(n) for a, n in pairs}


def unit_of(axis: Axis) -> float:
    """One unit of a value of an axis in mm or rad: 0.1 µm, or 0.0001° as an angle."""
    return 1.0 / STEPS if axis.is_linear else float(np.deg2rad(1.0 / STEPS))


def number_of(letter: str, numbers: Mapping[str, int]) -> int:
    """Logical number of an axis. Raises `InputError` where the option does not state it."""
    if letter not in numbers:
        raise InputError(f"option axes states no logical axis number of {letter}; expected it, such as '{letter}=1'")
    return numbers[letter]


def header(axis: Axis, numbers: Mapping[str, int]) -> list[tuple[str, object]]:
    """The lines kopf of the list of an axis."""
    return [("kopf.achs_nr", number_of(axis.letter, numbers)), ("kopf.log_achs_name", axis.letter)]


def numbered_axis(name: str, found: dict[str, Entry], machine: Machine, numbers: Mapping[str, int]) -> Axis:
    """The axis whose list it is: by a letter that stands alone in its name (Y-ACHSE, X1), else by its number.

    Raises `InputError` where the list says neither, and where name and number are those of two axes.
    """
    number = found.get("kopf.achs_nr", found.get("kopf.log_achs_nr"))
    named = found.get("kopf.log_achs_name", Entry("", ""))
    words = (re.fullmatch(r"([XYZABC])\d*", word) for word in re.split(r"[\W_]+", named.value.upper()))
    letters = [word[1] for word in words if word is not None and word[1] in machine.letters]
    by_number = [
        a for a, n in numbers.items() if number is not None and number.value == str(n) and a in machine.letters
    ]
    if number is None and len(letters) != 1:
        raise InputError(f"{name}: kopf.achs_nr is missing; it says whose list this is")
    if number is not None and (len(letters) != 1 or by_number == letters):
        return axis_of(number, machine, numbers)
    if number is not None and by_number:
        raise InputError(
            f"{named.where} is {named.value}, but its number {number.value} is that of {by_number[0]} by the option axes; state "
            f"the numbers as they are at the control, such as '{letters[0]}={number.value}'"
        )
    return machine.axis(letters[0])


def axis_of(number: Entry, machine: Machine, numbers: Mapping[str, int]) -> Axis:
    """The axis of a logical axis number. Raises `InputError`."""
    letters = [a for a, n in numbers.items() if n == number.whole(0, 10**5) and a in machine.letters]
    if not letters:
        stated = ", ".join(f"{a}={n}" for a, n in numbers.items())
        raise InputError(
            f"{number.where} is {number.value}; option axes states {stated}, and the machine has "
            f"{', '.join(machine.letters)}"
        )
    return machine.axis(letters[0])


def refuse_increments(name: str, found: dict[str, Entry], key: str) -> None:
    """Raises `InputError` for a list in increments of the encoder, whose size stands elsewhere."""
    unit = needed(name, found, key)
    if unit.value.upper() not in ("1", "TRUE"):
        raise InputError(f"{unit.where} is {unit.value}: increments of the encoder; expected 1, 0.1 µm or 0.0001°")
