"""The notes that go with a grid, and the error when there is no grid because the data do not determine it."""

from __future__ import annotations

import numpy as np

from volid.compensation.alignment import alignment_notes
from volid.compensation.grids.evaluation import Evaluated
from volid.compensation.grids.parts import part_notes
from volid.compensation.grids.places import Place
from volid.compensation.grids.request import ENTIRE, EXACT, GridRequest
from volid.compensation.grids.sides import LINEAR
from volid.compensation.types import LINE
from volid.exceptions import NotDeterminedError
from volid.fitting.solution import Solution
from volid.model.iso230 import DIRECTIONS
from volid.plausibility.repeats import SAME_POSITION


def require_determined(solution: Solution, request: GridRequest, side: str, found: Evaluated) -> None:
    """Raises `NotDeterminedError` when the data do not determine the translations, or the rotations of a FOR grid."""
    needed = slice(3, 6) if request.type.only_turns else slice(0, 3)
    blank = _blank(found.determined, needed)
    if not blank:
        return
    what, advice = f"of {request.type.name}", "Measure what is missing, or take another type."
    if request.type.name in ENTIRE and side == LINEAR:
        what = f"for tool vector ({', '.join(f'{v:g}' for v in request.base.tool)}) mm"
        advice = f"{_advice(solution, request.base.tool)} what is missing."
    elif request.type.name in ENTIRE:
        what = f"of the rotary axes of the {side}"
        advice = "Measure what is missing, or switch the named functions off."
    raise NotDeterminedError(
        f"grid: the data do not determine {', '.join(blank)} {what}. {' '.join(solution.statements)} {advice}"
    )


def _blank(determined: np.ndarray, components: slice) -> list[str]:
    """Components that are not determined at some node: dX … dC."""
    columns = zip(DIRECTIONS[components], determined[:, components].T, strict=True)
    return [f"d{c}" for c, known in columns if not known.all()]


def _advice(solution: Solution, tool: np.ndarray) -> str:
    tools = solution.campaign.tool_vectors()
    measured = bool((np.abs(tools - tool).max(axis=1) < SAME_POSITION[True]).any())
    return "Measure" if measured else "Ask for a measured tool vector (`tool`), or measure"


def grid_notes(
    solution: Solution, request: GridRequest, side: str, place: Place, found: Evaluated, zero: Place | None
) -> tuple[str, ...]:
    """Sentences for the record of a grid (ISO/TR 16907 12)."""
    notes = part_notes(solution, place.letters)
    notes += _type_notes(solution, request) if request.evaluation != EXACT or request.rule else []
    notes += alignment_notes(solution, request.base, place.letters)
    notes += _determination_notes(solution, request, side, found)
    outside = solution.outside(place.full, place.axes)
    if outside.any():
        notes.append(f"{int(outside.sum())} of {len(outside)} nodes lie outside the measured positions: extrapolated")
    if solution.adequacy.rejected:
        notes.append("MODEL REJECTED BY THE DATA: " + solution.adequacy.verdict)
    if zero is not None:
        at = ", ".join(f"{a} = {zero.full[0, solution.machine.index(a)]:g}" for a in zero.axes)
        notes.append(f"dX, dY, dZ are zero at {at} mm with the tool vector above; rotations are not shifted")
    return tuple(notes)


def _type_notes(solution: Solution, request: GridRequest) -> list[str]:
    """What the type leaves, on which lines it is based, and which functions or rule it uses."""
    t, base, rule = request.type, request.base, request.rule
    notes = [f"{t.name} leaves: {t.leaves}"]
    if t.based_on == LINE or t.name == "L-ANG":
        at = ", ".join(f"{a} = {v:g}" for a, v in zip(solution.machine.letters, base.at, strict=True))
        notes.append(f"specific lines through {at} with the tool vector above")
    if t.name in ("R-RAX", "R-ANG"):
        tool = ", ".join(f"{v:g}" for v in base.tool)
        notes.append(
            f"elevation {base.elevation:g} mm above each table axis's point; tip of the tool ({tool}) mm for a head"
        )
    if rule is not None:
        source = f"{getattr(rule, '__module__', '')}:{getattr(rule, '__name__', '')}"
        notes.append(f"values from the user's rule {source}; no uncertainty")
    elif base.functions and t.is_chosen:
        notes.append(f"functions used: {', '.join(base.functions)}")
    return notes


def _determination_notes(solution: Solution, request: GridRequest, side: str, found: Evaluated) -> list[str]:
    """What the data do not determine: blank rotations, the frame of the field, a constant rotation of the tool."""
    notes = []
    blank = _blank(found.determined, slice(3, 6))
    if blank:
        use = "use no other tool vector" if side == LINEAR else "use no lever arm but 0"
        notes.append(f"{', '.join(blank)} are not determined by the data and left blank; {use}")
    if found.rigid:
        notes.append(
            "known for this tool vector up to a rigid motion of the workpiece frame; what is not determined is held at 0, "
            "the same for all tool vectors and positions"
        )
    if side == LINEAR and request.evaluation == EXACT and solution.held_tool_rotation:
        notes.append(
            f"{', '.join(solution.held_tool_rotation)} are not determined and held at 0: rotations, and other tool vectors, "
            "up to a constant rotation of the tool"
        )
    return notes
