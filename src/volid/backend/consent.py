"""Guards ask, they do not forbid: what looks like a slip is a question, which a caller who means it answers once.

What looks wrong (a tool vector of a kilometre, positions in metres, a table beyond memory) raises `InputError` with what was
found, what was expected, and how to insist. Within `accept_unusual` the same request is carried out.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from volid.exceptions import InputError

INSIST = "If that is meant, insist with `volid.accept_unusual`"
LARGEST = 2e9  # bytes that a request may need without a question
_UNITS = ("bytes", "kB", "MB", "GB", "TB", "PB", "EB", "ZB", "YB")
_accepted: ContextVar[bool] = ContextVar("accept_unusual", default=False)


@contextmanager
def accept_unusual(accept: bool = True) -> Iterator[None]:
    """Within it, requests that look like a slip are carried out: long tools, far positions, large tables.

    What cannot be right in any case, such as a number that is not finite, or a table beyond the computer's memory, is refused
    there too.

    Args:
        accept: False asks again, within an outer one.

    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/published_positioning/campaign.toml"))
    >>> solution.evaluate([[100.0, 0.0, 0.0]], [0.0, 0.0, 1e6])
    Traceback (most recent call last):
    ...
    volid.exceptions.InputError: `tool=0,0,1e+06` is a tool vector of 1e+06 mm; the travels of the machine are 500, 200, 325 mm. \
Expected a vector in mm, such as 0,0,-150: is it in micrometres? If that is meant, insist with `volid.accept_unusual`
    >>> with volid.accept_unusual():
    ...     found = solution.evaluate([[100.0, 0.0, 0.0]], [0.0, 0.0, 1e6])
    """
    token = _accepted.set(accept)
    try:
        yield
    finally:
        _accepted.reset(token)


def ask(question: str) -> None:
    """Raises `InputError` with the question and how to insist, outside `accept_unusual`."""
    if not _accepted.get():
        raise InputError(f"{question} {INSIST}")


def ask_memory(what: str, size: float, advice: str) -> None:
    """Raises `InputError` for what would need more than two gigabytes, and always for more than the computer has.

    Args:
        what: What is asked for, with its numbers: "`step=1e-06` makes 1,000,000,001 positions of X".
        size: Memory that it would need, in bytes.
        advice: What to do, such as "Take a larger step".
    """
    if size <= LARGEST:
        return
    needed = f"{what}; that needs {in_bytes(size)} of memory"
    available = memory()
    if size > available:
        raise InputError(f"{needed}; this computer has {in_bytes(available)}. {advice}")
    ask(f"{needed}; up to {in_bytes(LARGEST)} are taken without a question. {advice}.")


def in_bytes(size: float) -> str:
    """A number of bytes in words.

    >>> in_bytes(9.4e9), in_bytes(512)
    ('9.4 GB', '512 bytes')
    """
    if size >= 1e24:
        return f"more than 1 {_UNITS[-1]}"
    k = 0
    while size >= 1000.0 and k < len(_UNITS) - 1:
        size, k = size / 1000.0, k + 1
    return f"{size:.3g} {_UNITS[k]}"


def in_digits(number: float) -> str:
    """A count with its digits in groups, or as a power of ten where nobody would read them.

    >>> in_digits(8e6), in_digits(1.5e26)
    ('8,000,000', '1.5e+26')
    """
    return f"{number:,.0f}" if number < 1e15 else f"{number:.3g}"


def memory() -> float:
    """Bytes of memory of this computer; 64 GB where the system does not tell."""
    try:
        return float(os.sysconf("SC_PHYS_PAGES")) * float(os.sysconf("SC_PAGE_SIZE"))
    except (AttributeError, OSError, ValueError):
        return 64e9
