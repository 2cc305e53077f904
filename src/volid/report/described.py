"""Symbols of ISO 230-1 in words of a language."""

from __future__ import annotations

from volid.model.iso230 import sort_of
from volid.report.language import Texts


def described(name: str, texts: Texts) -> str:
    """The symbol in words, in English as `volid.model.iso230.describe` has it.

    >>> described("EYX", Texts("de"))
    'Geradheitsabweichung von X in Y-Richtung'
    """
    sort, values = sort_of(name)
    return texts(f"functions.{sort}", **values)
