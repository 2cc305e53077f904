"""What users state for a control, from text: one of some words, a whole number, names or positions of axes.

Each raises `ValueError`, which `volid.controllers.base.options_of` turns into a message with the name of the option.
"""

from __future__ import annotations

import re
from collections.abc import Callable

AXIS_LETTERS = "XYZABCUVW"


def one_of(*allowed: str) -> Callable[[str], str]:
    """One of some words, in small letters.

    >>> one_of("both", "mean")("Mean")
    'mean'
    """

    def convert(text: str) -> str:
        if text.lower() not in allowed:
            raise ValueError(f"expected one of {', '.join(allowed)}")
        return text.lower()

    return convert


def whole(low: int, high: int, meaning: str) -> Callable[[str], int]:
    """A whole number from `low` to `high`.

    >>> whole(0, 1, "a measuring system")("1")
    1
    """

    def convert(text: str) -> int:
        if not re.fullmatch(r"\d{1,6}", text) or not low <= int(text) <= high:
            raise ValueError(f"expected {meaning}, {low} … {high}")
        return int(text)

    return convert


def axis_names(text: str) -> dict[str, str]:
    """Names of axes at the control by letter, in capitals.

    >>> axis_names("X=X1, Y=ax2")
    {'X': 'X1', 'Y': 'AX2'}
    """
    found = dict(_pairs(text))
    if not all(re.fullmatch(r"\w{1,32}", name) for name in found.values()):
        raise ValueError("expected letters and names of axes, such as X=X1,Y=Y1,Z=Z1")
    return found


def places(text: str) -> dict[str, float]:
    """Positions by axis letter [mm or °].

    >>> places("X=0,Y=600")
    {'X': 0.0, 'Y': 600.0}
    """
    return {letter: float(value) for letter, value in _pairs(text)}


def _pairs(text: str) -> list[tuple[str, str]]:
    """Letters and what stands behind the sign of equality."""
    parts = [part.partition("=") for part in re.sub(r"\s", "", text).upper().split(",") if part]
    if any(len(letter) != 1 or letter not in AXIS_LETTERS or not value for letter, _, value in parts):
        raise ValueError(
            f"expected letters of axes ({', '.join(AXIS_LETTERS)}) and what belongs to each, such as X=…,Y=…"
        )
    return [(letter, value) for letter, _, value in parts]
