"""Section "provenance" of the page: where every number comes from, with versions, commands and hashes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from volid.report.contents.contents import Contents
from volid.report.language import Texts
from volid.report.page.section import Section
from volid.report.page.templates import render

_HASH = "sha256 "
_ALONE = ("date", "command", "options")


class Part(NamedTuple):
    """A record of provenance in parts: date, command, options, versions by package, hashes by file."""

    date: str
    command: str
    options: str
    versions: dict[str, str]
    hashes: dict[str, str]


def part_of(record: Mapping[str, str]) -> Part:
    """The parts of a record as `provenance` makes it.

    >>> part_of({"date": "2026-01-01T00:00:00+00:00", "numpy": "2.0", "sha256 a.csv": "00ff"}).hashes
    {'a.csv': '00ff'}
    """
    hashes = {key.removeprefix(_HASH): text for key, text in record.items() if key.startswith(_HASH)}
    versions = {key: text for key, text in record.items() if key not in _ALONE and not key.startswith(_HASH)}
    date, command, options = (record.get(key, "") for key in _ALONE)
    return Part(date, command, options, versions, hashes)


def build(contents: Contents, texts: Texts) -> Section | None:
    """The provenance of the solution, and that of this report."""
    parts = [("fit", part_of(contents.summary["provenance"])), ("report", part_of(contents.made))]
    body = render("provenance.html", texts, parts=parts, samples=contents.solution.samples)
    return Section("provenance", texts("page.section_provenance"), body)
