"""Options of controls that may differ from axis to axis: one number for all, or X=2000,Y=2000,Z=4000."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from volid.controllers.base import Option
from volid.controllers.options import AXIS_LETTERS
from volid.exceptions import InputError

_ALL = ""  # key of the value of all axes that have none of their own


class ByAxis(dict[str, Any]):
    """The values of an option by axis letter, in words as a user states them."""

    def __str__(self) -> str:
        own = [f"{letter}={value}" for letter, value in self.items() if letter != _ALL]
        rest = "" if self.get(_ALL) is None else f"{'others ' if own else ''}{self[_ALL]}"
        return ", ".join([*own, *([rest] if rest else [])]) or "not stated"


def axis_option(name: str, meaning: str, convert: Callable[[str], Any], default: Any = None) -> Option:
    """An option with a value for each axis; `default`: that of axes of which nothing is stated, None: it must be stated."""
    return Option(name, meaning, ByAxis({_ALL: default}), by_axis(convert, default))


def by_axis(convert: Callable[[str], Any], default: Any = None) -> Callable[[str], ByAxis]:
    """A converter of the text of an option: `convert` for one value.

    Raises `ValueError` for a text that is neither one value nor pairs of an axis letter and a value.

    >>> print(by_axis(float)("0.001"))
    0.001
    >>> print(by_axis(float, 1.0)("X=4,Y=2"))
    X=4.0, Y=2.0, others 1.0
    """

    def values(text: str) -> ByAxis:
        found = ByAxis({_ALL: default})
        for part in text.split(","):
            letter, equals, value = (word.strip() for word in part.rpartition("="))
            if equals and letter.upper() not in tuple(AXIS_LETTERS):
                raise ValueError("expected one value, or pairs such as X=1,Y=2")
            found[letter.upper()] = convert(value)
        return found

    return values


def of_axis(option: Any, letter: str, control: str, name: str) -> Any:
    """The value of one axis. Raises `InputError` where the option must be stated and is not."""
    ask_axes(option, [letter], control, name)
    return or_none(option, letter)


def ask_axes(option: Any, letters: Iterable[str], control: str, name: str) -> None:
    """Raises `InputError` with all axes of which an option that must be stated is not."""
    missing = [letter for letter in letters if or_none(option, letter) is None]
    if missing:
        raise InputError(
            f"{control}: option {name} of {', '.join(missing)} is missing, and no public source can know it; state it, as in "
            f"{name}={','.join(f'{letter}=…' for letter in missing)}"
        )


def or_none(option: Any, letter: str) -> Any:
    """The value of one axis; None where nothing is stated."""
    return option.get(letter, option.get(_ALL)) if isinstance(option, Mapping) else option


def positive(text: str) -> float:
    """A number above 0. Raises `ValueError` for another one."""
    value = number(text)
    if value <= 0.0:
        raise ValueError("expected a number above 0")
    return value


def number(text: str) -> float:
    """A finite number. Raises `ValueError` for another one."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ValueError("expected a number")
    return value


def whole(text: str, least: int = 1) -> int:
    """A whole number. Raises `ValueError` for another one, or one below `least`."""
    if not (text.isascii() and text.isdigit() and len(text) < 10 and int(text) >= least):
        raise ValueError(f"expected a whole number from {least} on")
    return int(text)


def taken_off(amount: float, linear: bool) -> str:
    """What is taken off values, or added to them, in words [mm or °].

    >>> taken_off(-0.01265, True), taken_off(0.002, False)
    ('12.65 µm are added to', '0.002000° are taken off')
    """
    size = f"{1000.0 * abs(amount):.2f} µm" if linear else f"{abs(amount):.6f}°"
    return f"{size} are {'taken off' if amount > 0.0 else 'added to'}"


def way(text: str) -> str:
    """The direction + or -. Raises `ValueError` for another text."""
    if text not in ("+", "-"):
        raise ValueError("expected + or -")
    return text
