"""Text files in sections whose headings end in two colons, `TARGET DATA::`, with lines "Key : value" in them."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import lru_cache

HEADER, TARGETS, USER, RUNS = "HEADER", "TARGET DATA", "USER-TEXT", "RUNS"
DEVIATIONS, ENVIRONMENT, END = "DEVIATIONS", "ENVIRONMENT", "EOF"
RUN_DATA = re.compile(
    r"^[ \t]{0,40}Run[ \t]{1,9}Target[ \t]{1,9}Data[ \t]{0,9}:[ \t]{0,40}$", re.IGNORECASE | re.MULTILINE
)
_HEADING = re.compile(r"([A-Za-z][A-Za-z -]{0,40})::")
_PAIR = re.compile(r"([A-Za-z][\w .()/-]{0,60}):(?!:)(.*)")


@dataclass(frozen=True)
class Sections:
    """`lines`: by the name of a section in capitals, its lines with their numbers in the file, from 1."""

    lines: dict[str, list[tuple[int, str]]]

    def __contains__(self, name: str) -> bool:
        return name in self.lines

    def of(self, name: str) -> list[tuple[int, str]]:
        """The lines of a section; none where it is missing."""
        return self.lines.get(name, [])

    def pairs(self, name: str) -> dict[str, str]:
        """Keys and values of a section, without those that have no value; a key that stands twice has its first value."""
        found: dict[str, str] = {}
        for _, line in self.of(name):
            if (pair := pair_of(line)) and pair[1]:
                found.setdefault(*pair)
        return found

    @property
    def file_type(self) -> str:
        """What the header calls the file: "rtl"; nothing where it does not say."""
        named = {key.casefold(): value for key, value in self.pairs(HEADER).items()}
        return named.get("file type", "").casefold().lstrip(".")


def pair_of(line: str) -> tuple[str, str] | None:
    """Key and value of a line "Key : value"; None for another line."""
    found = _PAIR.fullmatch(line.strip())
    return (found[1].strip(), found[2].strip()) if found else None


@lru_cache(maxsize=8)
def sections_of(text: str) -> Sections:
    """The sections of a text; a section that stands twice goes on."""
    found: dict[str, list[tuple[int, str]]] = {}
    name = ""
    for number, line in enumerate(text.split("\n"), start=1):
        if heading := _HEADING.fullmatch(line.strip()):
            name = heading[1].strip().upper()
            found.setdefault(name, [])
        elif name and line.strip():
            found[name].append((number, line))
    return Sections(found)


def is_run_file(text: str) -> bool:
    """Whether a text has the sections of a file of runs with their targets."""
    if "::" not in text[: 1 << 16]:
        return False
    sections = sections_of(text)
    return TARGETS in sections and DEVIATIONS in sections and RUN_DATA.search(text) is not None
