"""What a file of another program's making declares, so that it can be recognised, read, and refused where it is the wrong one.

A reader of readings gives the columns that a CSV of the set would have; from there a foreign file goes the same way as a CSV,
with the same checks and messages. A reader of results that a program has already evaluated gives a table of them, not readings.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

from volid.exceptions import InputError
from volid.io.basics.toml_table import Table
from volid.model.machine import Machine

FROM_DESCRIPTIONS = "Read from public descriptions; no vendor file was at hand."


class ForeignFile(NamedTuple):
    """A file as text: its path, the text with plain line ends, and the encoding that it was in."""

    path: Path
    text: str
    encoding: str

    def where(self, line: int) -> str:
        """File and line, for messages: "x.rtl, row 12"; lines count from 1."""
        return f"{self.path}, row {line}"

    def wrong(self, line: int, found: str, expected: str) -> InputError:
        """The `InputError` for a line of the file."""
        return InputError(f"{self.where(line)}: {found}; expected {expected}")


class Request(NamedTuple):
    """What the user says of a file: the machine, and the keys of its `[[set]]`, `table`, with the place they came from.

    `folder`: where files stand that a key names.
    """

    machine: Machine
    table: Table
    folder: Path = Path()


@dataclass(frozen=True)
class Found:
    """What a foreign file holds, as one set.

    `kind`: the observation kind. `columns`: by the names that a CSV of that kind has, each (m,), numbers or texts; NaN where
    nothing was recorded. `rows`: (m,) line numbers in the file. `units`: unit by column, where it is not volid's. `keys`: keys of
    the set that follow from the file; those that the user states go before them. `conditions`: what the file records beside the
    readings. `notes`: how it was read and what was left out, in whole sentences without the file's name.
    """

    kind: str
    columns: Mapping[str, Sequence[Any]]
    rows: Sequence[int]
    units: Mapping[str, str] = field(default_factory=dict)
    keys: Mapping[str, Any] = field(default_factory=dict)
    conditions: Mapping[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def with_notes(self, *notes: str) -> Found:
        """The same with further notes."""
        return replace(self, notes=(*self.notes, *notes))


class Format(ABC):
    """One type of file. Each has one final class with one instance, in a module of its own.

    `name`: what `as` calls it. `words`: what it is, with an article, for messages. `about`: what is read and what is assumed, for
    the help. `keys`: keys of a `[[set]]` that its reader takes beside those that every set has.
    """

    name: str
    words: str
    about: str
    keys: tuple[str, ...] = ()

    @abstractmethod
    def recognises(self, text: str) -> bool:
        """Whether a text is such a file: by its content, without an error for anything."""


class ReadingsFormat(Format):
    """Files that hold readings."""

    @abstractmethod
    def read(self, file: ForeignFile, request: Request) -> Found:
        """The readings of a file. Raises `InputError` naming file and line, or key."""


class Evaluation(NamedTuple):
    """Results that another program has evaluated: `header` describes them; every row of `rows` fills the `columns`."""

    header: Mapping[str, str]
    columns: tuple[str, ...]
    rows: list[tuple[Any, ...]]


class EvaluatedFormat(Format):
    """Files that hold another program's results, and not the readings that they come from."""

    @abstractmethod
    def evaluation(self, file: ForeignFile) -> Evaluation:
        """The results as they stand in the file. Raises `InputError` naming file and line."""
