"""Numbers, counts and vectors of options, checked as they are parsed: finite, in range, with what was expected in the message."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from math import inf, isfinite
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from volid.fitting.solution import Solution
    from volid.io.functions_csv import Points

LARGEST_SEED = 2**63 - 1  # an integer of a file has 64 bits


def number(unit: str = "", *, least: float = -inf, above: float = -inf, most: float = inf) -> Callable[[str], float]:
    """A type for argparse: a finite number, from `least` or more than `above` on, up to `most`; `unit` is for the message."""

    def parsed(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = inf
        if isfinite(value) and value >= least and value > above and value <= most:
            return value
        raise argparse.ArgumentTypeError(
            f"'{_cut(text)}': expected {_range_of(least, above, most)}{unit and f' in {unit}'}"
        )

    return parsed


def _range_of(least: float, above: float, most: float) -> str:
    low = f" > {above:g}" if above > -inf else f" >= {least:g}" if least > -inf else ""
    high = f" up to {most:g}" if most < inf else ""
    return f"a finite number{low}{high}"


def count(least: int, most: int) -> Callable[[str], int]:
    """A type for argparse: a whole number from `least` to `most`."""

    def parsed(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            value = least - 1
        if least <= value <= most:
            return value
        raise argparse.ArgumentTypeError(f"'{_cut(text)}': expected a whole number from {least} to {most}")

    return parsed


seed = count(0, LARGEST_SEED)


def vector(what: str, example: str) -> Callable[[str], tuple[float, float, float]]:
    """A type for argparse: "0,0,-150" as three finite numbers [mm]; `what` it is and an `example` for the message."""

    def parsed(text: str) -> tuple[float, float, float]:
        try:
            x, y, z = (float(part) for part in text.split(","))
        except ValueError:
            x = y = z = inf
        if isfinite(x) and isfinite(y) and isfinite(z):
            return x, y, z
        raise argparse.ArgumentTypeError(f"'{_cut(text)}' is no {what}; expected x,y,z in mm, such as {example}")

    return parsed


tool_vector = vector("tool vector", "0,0,-150")
place = vector("place", "60,20,30")


def finite(text: str) -> float:
    """A finite number within a list of them. Raises `ValueError`."""
    value = float(text)
    if not isfinite(value):
        raise ValueError(text)
    return value


def _cut(text: str) -> str:
    """A text as it is shown in a message: not more than a line of it."""
    return text if len(text) <= 40 else f"{text[:40]}…"


def ask_points(solution: Solution, points: Points, path: str) -> None:
    """Raises `InputError`, naming the file, for positions or tool vectors that look like another unit than mm."""
    from volid.model.requests import ask_positions

    positions = dict(zip(solution.machine.letters, points.positions.T, strict=True))
    ask_positions(solution.campaign.machine, positions, path)
    solution.ask(points.tool, name=f"{path}: tool")


def add_unusual(parser: argparse.ArgumentParser) -> None:
    """--accept-unusual, which every verb has that asks about what looks like a slip."""
    parser.add_argument(
        "--accept-unusual",
        action="store_true",
        help="carry out what looks like a slip: tools of metres or micrometres, positions far outside, very large results",
    )
