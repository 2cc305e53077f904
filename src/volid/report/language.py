"""The texts of figures and pages in English and German: one table, in `texts/`, a file for each part of the report.

A file holds entries such as `[verdict_accepted]` with `en = "…"` and `de = "…"`; the key of this one is "FILE.verdict_accepted".
Values stand in braces: `"{count} readings"`.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

from volid.exceptions import InputError

LANGUAGES = ("en", "de")


@cache
def table() -> dict[str, dict[str, str]]:
    """Every text by its key, with its wording by language."""
    found: dict[str, dict[str, str]] = {}
    for file in sorted(files("volid.report.texts").iterdir(), key=lambda f: f.name):
        if file.name.endswith(".toml"):
            part = tomllib.loads(file.read_text(encoding="utf-8"))
            found |= {f"{file.name.removesuffix('.toml')}.{key}": words for key, words in part.items()}
    return found


@dataclass(frozen=True)
class Texts:
    """The texts of one language.

    Args:
        language: "en" or "de".

    Raises `InputError` for another language, and `KeyError` for a key that the table does not have.

    >>> Texts("de")("page.readings", count=12)
    '12 Messwerte'
    """

    language: str = "en"

    def __post_init__(self) -> None:
        if self.language not in LANGUAGES:
            raise InputError(f"`lang`: there are no texts in '{self.language}'; choose one of {', '.join(LANGUAGES)}")

    def __call__(self, key: str, **values: Any) -> str:
        words = table()[key][self.language]
        return words.format(**values) if values else words


ENGLISH = Texts()
