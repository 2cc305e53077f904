"""Blocks of a program: the words of each line, its comments and its block delete, as RS274 and ISO 6983-1 write them.

Blanks mean nothing outside comments and lower case is upper case, as in RS274/NGC. A number is counted in the program's unit,
with or without a decimal point; controls that count a number without a point in increments of a micrometre are not meant.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import NamedTuple

from volid.exceptions import InputError

_LARGEST = 1e9  # of a number: beyond any machine, and within what coordinates can be rounded to
_COMMENT = re.compile(r"\([^()]*\)|;.*")
_WORD = re.compile(r"([A-Z])([+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+))")
_STRANGE = {
    "#": "a variable, whose value is known only while the program runs",
    "=": "an assignment, whose value is known only while the program runs",
    "[": "an expression, whose value is known only while the program runs",
    "<": "a named variable, whose value is known only while the program runs",
    "*": "a check sum or a product",
    "$": "a command of the control's firmware",
    "(": "a comment that is not closed",
    ")": "a bracket that no comment opened",
    "%": "a mark of the program's ends within a line",
    "/": "a block delete that does not begin the line",
}
_DO = {
    "(": "close it",
    ")": "put the comment between ( and )",
    "$": "leave it out of the program",
    "*": "write the program without check sums",
    "/": "put / first",
}


class Word(NamedTuple):
    """A letter with its number, such as X10.5. `text`: as it was written, without blanks."""

    letter: str
    value: float
    text: str


class Block(NamedTuple):
    """One line. `number`: of the line, from 1. `text`: as written. `deleted`: whether it begins with /, the block delete.
    `percent`: whether it is %, which begins and ends a program."""

    number: int
    text: str
    words: tuple[Word, ...] = ()
    comments: tuple[str, ...] = ()
    deleted: bool = False
    percent: bool = False

    def first(self, letters: str) -> Word | None:
        """The first word with one of the letters; None where there is none."""
        return next((w for w in self.words if w.letter in letters), None)

    def values(self, letters: str) -> dict[str, float]:
        """Numbers of the words with these letters."""
        return {w.letter: w.value for w in self.words if w.letter in letters}


def blocks(text: str, name: str) -> Iterator[Block]:
    """All lines of a program.

    Args:
        text: The program, whatever its line ends.
        name: Of the program, for messages.

    Raises:
        InputError: a line is no sequence of words: it has variables, expressions or signs that no word has.

    >>> [word.text for word in next(blocks("n10 g1x1. y-.5 (side) f100 ; end", "part.nc")).words]
    ['N10', 'G1', 'X1.', 'Y-.5', 'F100']
    """
    for i, line in enumerate(text.replace("\r\n", "\n").replace("\r", "\n").removesuffix("\n").split("\n"), start=1):
        yield parsed(line.rstrip("\x1a"), i, name)


def parsed(line: str, number: int, name: str) -> Block:
    """One line as a block. Raises `InputError`, see `blocks`."""
    comments: tuple[str, ...] = ()
    code = line
    if "(" in line or ";" in line:
        comments = tuple(_COMMENT.findall(line))
        code = _COMMENT.sub(" ", line)
    code = "".join(code.split())
    if not code.isascii():
        sign = next(c for c in code if not c.isascii())
        raise InputError(
            f"{name}, line {number}: '{sign}' is no sign of G-code outside a comment; expected plain letters and digits, such "
            "as X10.5"
        )
    code = code.upper()
    if code == "%":
        return Block(number, line, (), comments, percent=True)
    deleted = code.startswith("/")
    code = code.removeprefix("/")
    found = _WORD.findall(code)
    if sum(map(len, map("".join, found))) != len(code):
        raise InputError(f"{name}, line {number}: {_what_is_strange(code)}")
    words = tuple(Word(a, float(v), a + v) for a, v in found)
    huge = next((w for w in words if abs(w.value) > _LARGEST), None)
    if huge is not None:
        raise InputError(
            f"{name}, line {number}: {huge.text[:20]} is a larger number than {_LARGEST:g}; write a smaller one"
        )
    return Block(number, line, words, comments, deleted)


def _what_is_strange(code: str) -> str:
    """The first sign that is part of no word, and what to do about it."""
    rest = _WORD.sub(" ", code).strip()
    sign = next((c for c in rest if c in _STRANGE), rest.split(" ")[0][:1])
    if sign in _STRANGE:
        do = _DO.get(sign, "let the post-processor write plain numbers")
        return f"'{sign}' is {_STRANGE[sign]}; {do}"
    if "O" in code[:1]:
        return "'O' calls or ends a subroutine or a loop; let the post-processor write the motions themselves"
    return f"'{rest.split(' ')[0][:20]}' is no word; expected a letter with a number, such as X10.5"
