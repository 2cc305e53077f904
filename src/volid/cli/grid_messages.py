"""What `volid grid` says about the grids that it wrote."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from volid.report.text.basics import vector

if TYPE_CHECKING:
    from volid.compensation.grids.grid import AnyGrid
    from volid.fitting.solution import Solution

LINEAR, ROTARY = "L-VOL", "R-VOL"


def described(grid: AnyGrid, args: argparse.Namespace) -> str:
    """Size, type and values of a grid, and where it holds."""
    counts = " × ".join(str(len(nodes)) for nodes in grid.nodes)
    values = "error" if args.errors else "compensation"
    kind = "" if grid.type in (LINEAR, ROTARY) else f"{grid.type} "
    what = f"{counts} nodes of {kind}{values} values"
    if grid.side == "linear":
        return f"{what} for tool vector {vector(grid.reference.tolist())} mm"
    where = vector(grid.reference.tolist())
    return f"{what} of {', '.join(grid.axes)} in the {grid.side}, reference point {where} mm,"


def messages_of(grid: AnyGrid, args: argparse.Namespace, several: bool) -> list[str]:
    """What of a grid needs attention."""
    from volid.compensation.grids.parts import LEFT_OUT

    messages = [note for note in grid.notes if note.startswith(LEFT_OUT)]
    unknown = [f"d{c}" for k, c in enumerate("XYZABC") if (grid.values[:, k] != grid.values[:, k]).any()]
    if unknown:
        advice = "no other tool vector" if grid.side == "linear" else "no lever arm"
        messages.append(f"{', '.join(unknown)} not determined by the data and left blank; use {advice}")
    outside = int(grid.outside.sum())
    if outside and not args.extrapolate:
        messages.append(
            f"{outside} of {len(grid.outside)} nodes lie outside the measured positions: extrapolated (outside = 1). Measure "
            "there, or accept with --extrapolate"
        )
    return [f"{grid.side}: {message}" if several else message for message in messages]


def reversal_lines(solution: Solution, grids: tuple[AnyGrid, ...]) -> list[str]:
    """What the grids leave of the reversal, one line per side."""
    from volid.compensation.grids.sides import part_letters
    from volid.compensation.reversal import left_reversal, reversal_text

    with_reversal = [g for g in grids if left_reversal(solution, part_letters(solution.machine, g.side))]
    return list(dict.fromkeys(f"reversal, {g.side} grid: {reversal_text(solution, g)}" for g in with_reversal))
