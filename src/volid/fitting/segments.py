"""How finely error functions are stored: as stated, or finely enough for whatever their smoothness allows.

With `segments = "auto"` a function has many segments, and a smoothness that is estimated decides how much of them is used
(`smoothness`). Twenty segments hold any function whose values stay alike over a fifth of the range; 14 to 30 gave the same fits.
"""

from __future__ import annotations

from math import prod
from typing import NamedTuple

from volid.backend.consent import ask_memory
from volid.exceptions import InputError
from volid.model.error_functions import motion_names, settings_for, spline_axes
from volid.model.machine import Machine

MATRICES = 6  # square ones of all coefficients, while a fit runs
FINE, FINE_TURN = 20, 24  # segments of a function of one axis: on a range, on a full turn
FINE_CROSS = (10, 6)  # of a function of two axes

Numbers = dict[str, tuple[int, ...]]


class Segments(NamedTuple):
    """`numbers`: segments of every error motion. `smooth`: the motions whose smoothness is estimated."""

    numbers: Numbers
    smooth: frozenset[str]


def segments_of(machine: Machine, given: Numbers) -> Segments:
    """Segments of every error motion of a machine; `given`: what an earlier solution has where segments were stated for it.

    Raises `InputError` for a wrong number of stated segments, or so many that nothing could be computed with them.
    """
    numbers, smooth = {}, set()
    for name in motion_names(machine):
        letters = spline_axes(machine, name)
        stated = given.get(name) or _stated(machine, name)
        if stated is None:
            smooth.add(name)
            turns = [machine.axis(a).is_full_turn for a in letters]
            alone = (FINE_TURN if turns[0] else FINE,)
            stated = FINE_CROSS if len(letters) > 1 else alone
        numbers[name] = stated
    _ask_size(machine, numbers)
    return Segments(numbers, frozenset(smooth))


def _ask_size(machine: Machine, numbers: Numbers) -> None:
    """Raises `InputError` for more coefficients than normal equations of two gigabytes hold."""
    sizes = {name: prod(float(n + machine.model.degree) for n in of_axes) for name, of_axes in numbers.items()}
    if not sizes:
        return
    total, largest = sum(sizes.values()), max(sizes, key=lambda name: sizes[name])
    stated = ", ".join(f"{n:,}" for n in numbers[largest])
    what = f"[model] of machine '{machine.name}': {total:,.0f} coefficients of error functions ({largest}: {stated} segments)"
    ask_memory(what, MATRICES * 8.0 * total**2, 'Take fewer segments, or "auto"')


def _stated(machine: Machine, name: str) -> tuple[int, ...] | None:
    """Segments stated in the machine file; None for "auto"."""
    settings, letters = settings_for(machine, name), spline_axes(machine, name)
    if settings.segments == "auto":
        return None
    if not isinstance(settings.segments, tuple):
        return (int(settings.segments or 1),) * len(letters)
    if len(settings.segments) != len(letters):
        raise InputError(
            f"[model.functions] {name}: segments = {list(settings.segments)} needs one number for each of {letters}"
        )
    return settings.segments
