"""The text of a grid for LinuxCNC's HAL: corrections of X, Y, Z at the nodes of a regular grid.

    volid-hal-grid 1                  format and version
    type L-VOL                        what it corrects
    tool 0 0 -150                     tool vector that it holds for
    unit mm                           of everything: mm or inch, that of the machine
    sign compensation                 values are added to the commands
    nodes X 3 0 500 1000              number of nodes and their positions, rising, any spacing
    nodes Y 2 0 600
    nodes Z 2 -500 0
    values 12                         number of nodes in all, then for each node dX dY dZ;
    -0.000000000 0.000000000 …        X changes slowest, Z fastest (C order)
    end

It is a sequence of words; where lines end does not matter, and "#" begins a comment that ends with its line. Corrections do not
depend on an axis with a single node, as one that the machine does not have. At most two million nodes. The component
`examples/linuxcnc/volid_grid.comp` reads it by the same rules.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NoReturn

import numpy as np

from volid.exceptions import InputError, shown
from volid.model.iso230 import LINEAR_AXES

FORMAT, VERSION = "volid-hal-grid", "1"
UNITS = {"mm": 1.0, "inch": 25.4}  # mm
MOST = 2_000_000  # nodes, as the component
LARGEST = 1e6  # no position of a machine and no correction lies beyond
TYPES = ("L-VOL", "L-SQU", "L-POS", "L-STR", "L-ANG", "L-SPEC")  # that move X, Y, Z by their own positions alone
_WORD = re.compile(r"[^ \t\r\v\f]+")  # blanks as in C, no others
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)


@dataclass(frozen=True, eq=False)
class HalGrid:
    """What a file holds, in mm: `nodes` of X, Y, Z; `values` (nx, ny, nz, 3), what is added to the commands."""

    type: str
    tool: tuple[float, float, float]
    unit: str
    nodes: tuple[np.ndarray, np.ndarray, np.ndarray]
    values: np.ndarray


def write_grid(grid: HalGrid, comments: tuple[str, ...] = ()) -> str:
    """The text of a file, with comments before the numbers, each in one line whatever a name in it holds."""
    scale = UNITS[grid.unit]
    lines = [f"{FORMAT} {VERSION}", *(f"# {' '.join(shown(c).split())}" for c in comments), f"type {grid.type}"]
    lines += ["tool " + " ".join(_plain(v / scale) for v in grid.tool), f"unit {grid.unit}", "sign compensation"]
    for letter, nodes in zip(LINEAR_AXES, grid.nodes, strict=True):
        lines.append(f"nodes {letter} {len(nodes)} " + " ".join(_plain(v / scale) for v in nodes))
    rows = grid.values.reshape(-1, 3) / scale + 0.0  # no negative zero
    lines += [f"values {len(rows)}", "# dX dY dZ at each node; X changes slowest, Z fastest"]
    lines += [" ".join(f"{v:.9f}" for v in row) for row in np.round(rows, 9) + 0.0]
    return "\n".join([*lines, "end"]) + "\n"


def _plain(value: float) -> str:
    return f"{value + 0.0:.12g}"


class _Words:
    """The words of a file one after the other, with the line of each."""

    def __init__(self, name: str, text: str) -> None:
        self.name, self.line = name, 1
        self._words = _words(text)

    def next(self, expected: str) -> str:
        """The next word. Raises `InputError` at the end of the file."""
        try:
            self.line, word = next(self._words)
        except StopIteration:
            raise InputError(f"{self.name}, line {self.line}: the file ends, expected {expected}") from None
        return word

    def wrong(self, word: str, expected: str) -> NoReturn:
        """Raises `InputError`."""
        raise InputError(f"{self.name}, line {self.line}: found '{shown(word[:60])}', expected {expected}")

    def expect(self, *allowed: str) -> str:
        """The next word, one of those allowed."""
        expected = " or ".join(f"'{a}'" for a in allowed)
        word = self.next(expected)
        return word if word in allowed else self.wrong(word, expected)

    def number(self, what: str) -> float:
        """The next word as a number."""
        word = self.next(what)
        if not _NUMBER.fullmatch(word) or not abs(float(word)) <= LARGEST:
            self.wrong(word, f"{what}, a number of at most {LARGEST:g}")
        return float(word)

    def count(self, what: str) -> int:
        """The next word as a number of nodes."""
        word = self.next(what)
        if not re.fullmatch(r"\d{1,7}", word, re.ASCII) or not 1 <= int(word) <= MOST:
            self.wrong(word, f"{what}, 1 to {MOST}")
        return int(word)

    def ended(self) -> None:
        """Raises `InputError` if something follows."""
        following = next(self._words, None)
        if following is not None:
            self.line = following[0]
            self.wrong(following[1], "nothing after 'end'")


def _words(text: str) -> Iterator[tuple[int, str]]:
    for i, line in enumerate(text.split("\n"), 1):
        for word in _WORD.findall(line.split("#", 1)[0]):
            yield i, word


def read_grid(name: str, text: str) -> HalGrid:
    """What a file holds. Raises `InputError` that names its line, for what the component would refuse too."""
    words = _Words(name, text)
    words.expect(FORMAT)
    words.expect(VERSION)
    words.expect("type")
    kind = words.expect(*TYPES)
    words.expect("tool")
    tool = [words.number("a coordinate of the tool vector") for _ in range(3)]
    words.expect("unit")
    unit = words.expect(*UNITS)
    words.expect("sign")
    words.expect("compensation")
    scale = UNITS[unit]
    x, y, z = (_nodes(words, letter) * scale for letter in LINEAR_AXES)
    values = _values(words, (len(x), len(y), len(z))) * scale
    words.expect("end")
    words.ended()
    return HalGrid(kind, (tool[0] * scale, tool[1] * scale, tool[2] * scale), unit, (x, y, z), values)


def _nodes(words: _Words, letter: str) -> np.ndarray:
    words.expect("nodes")
    words.expect(letter)
    found: list[float] = []
    for _ in range(words.count(f"the number of nodes of {letter}")):
        found.append(words.number(f"a node of {letter}"))
        if len(found) > 1 and found[-1] <= found[-2]:
            words.wrong(f"{found[-1]:g}", f"nodes of {letter} that rise: after {found[-2]:g} a larger one")
    return np.array(found)


def _values(words: _Words, shape: tuple[int, int, int]) -> np.ndarray:
    words.expect("values")
    count, all_nodes = words.count("the number of nodes"), shape[0] * shape[1] * shape[2]
    if count != all_nodes:
        words.wrong(str(count), f"{all_nodes} nodes, {shape[0]} × {shape[1]} × {shape[2]}")
    numbers = [words.number("a correction") for _ in range(3 * count)]
    return np.array(numbers).reshape(*shape, 3)
