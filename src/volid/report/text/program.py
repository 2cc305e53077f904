"""What was done to a program of G-code, in words and as data."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from volid.controllers.programs.counts import Counted
from volid.controllers.programs.program import CorrectedProgram

_NAMED = 5  # lines that are named


def program_text(made: CorrectedProgram) -> list[str]:
    """Blocks before and after, the largest correction, the bound of the path, times; a line for each.

    Args:
        made: As `volid.apply_to_program` gives it.
    """
    found = made.counted
    before, after = found.blocks
    each = ", ".join(f"{letter} {1e3 * v:.2f}" for letter, v in zip("XYZ", found.largest, strict=True))
    lines = [
        f"blocks: {before} before, {after} after; corrected: {found.lines} lines, "
        f"{found.arcs} arcs, {found.rapids} rapids at their ends",
        f"largest correction: {each} µm",
        f"the new path lies within {1e3 * found.chord:.2f} µm of the corrected path, rounding included",
        f"in feed: {found.length:.0f} mm{_time(found)}",
    ]
    if found.taken_up:
        lines.append(f"blocks that lead to a corrected start, after reversal or after a rapid: {found.taken_up}")
    if found.as_they_are:
        lines.append(
            f"rapids that stay as they are, since a position was not known or in machine coordinates: "
            f"{line_words(found.as_they_are)}"
        )
    return lines


def _time(found: Counted) -> str:
    if not found.minutes:
        return "; the time is not known without feeds per minute"
    return f", {found.minutes:.2f} min without accelerations; the shortest block takes {1e3 * found.shortest:.2g} ms"


def line_words(numbers: Sequence[int]) -> str:
    """Such as "lines 3, 5, 9 and 12 more".

    >>> line_words([3]), line_words(range(1, 9))
    ('line 3', 'lines 1, 2, 3, 4, 5 and 3 more')
    """
    named = ", ".join(map(str, numbers[:_NAMED]))
    more = f" and {len(numbers) - _NAMED} more" if len(numbers) > _NAMED else ""
    return f"line{'s' if len(numbers) > 1 else ''} {named}{more}"


def program_data(made: CorrectedProgram) -> dict[str, Any]:
    """The same as data: mm, minutes, s.

    Args:
        made: As `volid.apply_to_program` gives it.
    """
    found = made.counted
    return {
        **found._asdict(),
        "blocks": {"before": found.blocks[0], "after": found.blocks[1]},
        "largest": dict(zip("XYZ", found.largest, strict=True)),
        "as_they_are": list(found.as_they_are),
        "outside": list(found.outside),
        "largest_length": _largest(made),
    }


def _largest(made: CorrectedProgram) -> float:
    return float(np.linalg.norm(made.corrected - made.nominal, axis=2).max(initial=0.0))
