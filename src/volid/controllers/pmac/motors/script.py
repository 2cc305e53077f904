"""The script of compensation tables of motors, as text and back: DEFINE COMP, DEFINE BLCOMP, Ixx86 of (Turbo) PMAC."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from math import prod

import numpy as np

from volid.exceptions import InputError

COMP, BLCOMP = "COMP", "BLCOMP"
_PER_LINE = 10
_MOST = 1_000_000  # entries of a table: more are a mistake in a file
_LARGEST = 10**12  # counts
_DEFINE = re.compile(r"DEF(?:INE)? (COMP|BLCOMP) ?(\d{1,7})(?:\.(\d{1,7}))? ?,(.*)")
_BACKLASH = re.compile(r"I(\d{1,2})86 ?= ?(\d{1,7})")
_LEFT_ALONE = re.compile(r"(DEL|DELETE|LIST|CLOSE|SAVE)( .*)?|I51 ?= ?[01]|I\d{1,2}8[57] ?= ?\d+")


@dataclass(frozen=True, eq=False)
class MotorTable:
    """One table as the control holds it.

    Args:
        command: "COMP" or "BLCOMP".
        owner: Motor that it belongs to.
        sources: One source motor, or the row motor and the column motor.
        target: Motor that it corrects.
        spans: Counts that it spans along each source motor.
        entries: Values from 0 on, that at zero included, shape (N + 1,), or (rows + 1, columns + 1) [1/16 count].
        words: What it is for, for a comment.
    """

    command: str
    owner: int
    sources: tuple[int, ...]
    target: int
    spans: tuple[int, ...]
    entries: np.ndarray
    words: str = ""


@dataclass(frozen=True)
class Script:
    """Tables, backlash at motor zero by motor [1/16 count], what a user should know, largest change by rounding [mm or rad]."""

    tables: tuple[MotorTable, ...]
    backlash: dict[int, int] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    rounding: float = 0.0


def script_text(script: Script, lines: Iterable[str]) -> str:
    """The script: COMP tables before BLCOMP tables, higher motors first, because the control refuses another order."""
    parts = [f"; {line}" for line in lines]
    for command in (COMP, BLCOMP):
        for table in sorted((t for t in script.tables if t.command == command), key=lambda t: -t.owner):
            parts += [
                f"#{table.owner}",
                f"{_define(table)} ; {table.words}",
                *_entries(table.entries.ravel()[1:].tolist()),
            ]
    parts += [f"I{motor}86={value}" for motor, value in sorted(script.backlash.items())]
    return "\n".join([*parts, "I51=1", ""])


def _define(table: MotorTable) -> str:
    size = ".".join(str(n - 1) for n in table.entries.shape)
    motors = [f"#{m}D" for m in table.sources] + [f"#{table.target}"] if table.command == COMP else []
    return f"DEFINE {table.command} {','.join([size, *motors, *map(str, table.spans)])}"


def _entries(values: Sequence[int]) -> list[str]:
    return [" ".join(map(str, values[i : i + _PER_LINE])) for i in range(0, len(values), _PER_LINE)]


class _Reader:
    """Goes through the lines of a script and collects its tables."""

    def __init__(self, name: str) -> None:
        self.name, self.addressed = name, 1
        self.tables: list[MotorTable] = []
        self.backlash: dict[int, int] = {}
        self.values: list[int] = []
        self.left = 0  # entries of the last table that are still to come

    def line(self, i: int, text: str) -> None:
        """One line without its comment, in capitals, single blanks."""
        place = f"{self.name}, line {i}"
        if match := re.match(r"#(\d{1,2})(?!\d) ?", text):
            self.addressed, text = int(match[1]), text[match.end() :]
        if not text:
            return
        if re.fullmatch(r"[+-]?\d+( [+-]?\d+)*", text):
            self._take(place, text.split())
        elif self.left:
            raise InputError(
                f"{place}: is '{text[:40]}'; expected {self.left} more entries of the table before, whole numbers"
            )
        elif match := _DEFINE.fullmatch(text):
            self._define(place, match)
        elif match := _BACKLASH.fullmatch(text):
            self.backlash[int(match[1])] = int(match[2])
        elif not _LEFT_ALONE.fullmatch(text):
            raise InputError(f"{place}: is '{text[:40]}'; expected DEFINE COMP, DEFINE BLCOMP, its entries, or I…86=…")

    def _take(self, place: str, words: list[str]) -> None:
        if len(words) > self.left or any(len(w) > 10 for w in words):
            raise InputError(
                f"{place}: {len(words)} numbers; expected {self.left} entries of a table, each of at most ten digits"
            )
        self.values += map(int, words)
        self.left -= len(words)
        if not self.left:
            self.tables[-1].entries.ravel()[1:] = self.values
            self.values = []

    def _define(self, place: str, match: re.Match[str]) -> None:
        command, sizes = match[1], [int(n) for n in match.group(2, 3) if n]
        given, spans = _motors_and_spans(match[4], 1 if command == BLCOMP else len(sizes))
        sound = spans is not None and prod(sizes) <= _MOST and min(sizes) > 0
        if not sound or spans is None or (command == BLCOMP and (given or len(sizes) > 1)):
            raise InputError(
                f"{place}: is '{match[0][:60]}'; expected DEFINE COMP entries,#source,#target,counts, or rows.columns,#row motor,"
                "#column motor,#target,counts,counts, or DEFINE BLCOMP entries,counts"
            )
        count = len(sizes)
        sources = [*given[:count], *[self.addressed] * (count - len(given))]
        target = given[count] if len(given) > count else self.addressed
        entries = np.zeros([n + 1 for n in sizes], dtype=np.int64)
        self.tables.append(MotorTable(command, self.addressed, tuple(sources), target, spans, entries))
        self.left = entries.size - 1


def _motors_and_spans(text: str, count: int) -> tuple[list[int], tuple[int, ...] | None]:
    """Motors and the `count` spans behind them; None instead of spans where the text is none."""
    words = [w.strip() for w in text.split(",")]
    motors = [re.fullmatch(r"#(\d{1,2}) ?D?", w) for w in words[:-count]]
    spans = words[-count:]
    sound = len(spans) == count and len(motors) <= count + 1 and all(motors)
    if not sound or not all(s.isdigit() and len(s) < 14 and 0 < int(s) < _LARGEST for s in spans):
        return [], None
    return [int(m[1]) for m in motors if m], tuple(map(int, spans))


def read_script(name: str, text: str) -> Script:
    """Tables and backlash of a script. Raises `InputError` naming file and line for anything else."""
    reader = _Reader(name)
    for i, line in enumerate(text.splitlines(), 1):
        reader.line(i, " ".join(line.split(";")[0].upper().split()))
    if reader.left:
        raise InputError(f"{name}: ends before the last table does; expected {reader.left} more entries")
    if not reader.tables and not reader.backlash:
        raise InputError(f"{name}: holds no table; expected DEFINE COMP or DEFINE BLCOMP")
    return Script(tuple(reader.tables), reader.backlash)
