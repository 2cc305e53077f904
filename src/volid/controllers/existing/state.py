"""Which state of the machine results refer to, where files of a control were active while measuring (ISO/TR 16907 10.4, 10.5).

Errors that were measured with a compensation A are those that remain with it. A compensation B made of them comes on top of A; it
does not replace it. And B corrects what remains only where its model can describe the machine with A: a table that jumps with the
direction needs a reversal in the model, a grid may bring what no functions of single axes describe.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from volid.campaign import Campaign
from volid.compensation.grids.grid import Grid
from volid.compensation.on_top import with_opposite
from volid.compensation.package import Compensation
from volid.compensation.tables.axis_table import AxisTable
from volid.compensation.tables.error_table import ErrorTable
from volid.controllers.existing.forms import sum_of_lines
from volid.controllers.existing.reading import ExistingCompensation
from volid.fitting.solution import Solution
from volid.model.iso230 import LINEAR_AXES, parse
from volid.plausibility.conditions import ACTIVE, active_compensations

NOT_ACTIVE = "by the record it was not active"
REPLACED = "REPLACE"
SEEN = 1e-4  # mm: 0.1 µm; what is smaller is not looked for


def active_types(campaign: Campaign) -> frozenset[str]:
    """Types of ISO/TR 16907 that were active while a campaign was measured, by its record."""
    texts = active_compensations(campaign.conditions)
    return frozenset(name.strip() for text in texts for name in text.split(":")[0].split("+") if name.strip())


def would_replace(campaign: Campaign, types: Iterable[str], cnc: str) -> list[str]:
    """Sentences where files of `types` for the control `cnc` replace what was active by what remained with it (10.5).

    Files of the same control stand in the place of those that were active as soon as both correct the same; of other controls,
    and of what the record states in words, only the same type counts, because both may well be loaded side by side.
    """
    named = {t for a in campaign.active_files if a.cnc == cnc for t in a.types}
    stated = active_types(campaign)
    again = [n for n in dict.fromkeys(types) if n in stated or any(meet(n, other) for other in named)]
    if not again:
        return []
    files = [a.text for a in campaign.active_files]
    way = (
        f"add these values to {'; '.join(files)}, which the campaign holds: `volid.recorded_compensations`"
        if files
        else "add these values to the files that the control holds: `add_to`"
    )
    return [
        f"{', '.join(again)}: such a compensation was active while the campaign was measured, and these values are what remained "
        f"with it. Loaded in its place they {REPLACED} it, and its errors come back; {way}"
    ]


_PARTS = {  # what a type corrects besides
    "L-VOL": ("L-POS", "L-STR", "L-SQU", "L-ANG"),
    "L-VOL+": ("L-VOL", "L-POS", "L-STR", "L-SQU", "L-ANG", "FOR"),
    "R-VOL": ("R-POS", "R-RAX", "R-POR", "R-ANG"),
    "R-VOL+": ("R-VOL", "R-POS", "R-RAX", "R-POR", "R-ANG", "FOR"),
    "L-SQU": ("L-STR",),  # squareness is a slope of a straightness table: files show L-STR
}


def meet(one: str, other: str) -> bool:
    """Whether two types correct the same."""
    return bool({one, *_PARTS.get(one, ())} & {other, *_PARTS.get(other, ())})


def not_recorded(campaign: Campaign, existing: Sequence[ExistingCompensation]) -> list[str]:
    """Sentences where files that new values are added to were, by the record, not active while the campaign was measured.

    The sum is right only where they were: the new values are what remained with them.
    """
    texts, types = active_compensations(campaign.conditions), active_types(campaign)
    found = []
    for e in existing:
        if e.words in texts:
            continue
        if ACTIVE not in campaign.conditions:
            found.append(
                f"{e.words}: the record does not say that it was active while measuring; the sum is right if it was"
            )
        elif not any(meet(a, b) for a in e.types for b in types):
            found.append(
                f"{e.words}: {NOT_ACTIVE} while the campaign was measured; then its errors are in the new values too, and the "
                "sum corrects them twice"
            )
    return found


def in_place(
    loaded: Compensation, held: Sequence[ExistingCompensation], active: Sequence[ExistingCompensation]
) -> tuple[Compensation, list[str]]:
    """What loaded files do to the machine in the state in which it was measured, for simulation, and sentences that say so.

    Args:
        loaded: The sum of what the files hold.
        held: The files.
        active: What was active while measuring. Files of the same control stand in its place; else the new ones come on top.
    """
    notes = []
    for e in active:
        if any(h.cnc == e.cnc for h in held):
            loaded = with_opposite(loaded, e.compensation)
            notes.append(f"the files stand in the place of {e.words}, which was active while measuring")
        else:
            notes.append(f"the files come on top of {e.words}, which was active while measuring")
    return loaded, notes


def not_described(solution: Solution, existing: Sequence[ExistingCompensation]) -> list[str]:
    """What of the machine with existing compensations the solution's model cannot describe, one sentence each.

    Looked at: tables whose direction matters, where the function has no reversal in the model; tables of functions that the
    model does not have; and grids that are no sum of functions of single axes. That the readings agree with the model is the
    chi-square test's to say; this says where to look.
    """
    return [text for e in existing for text in dict.fromkeys(_cannot(solution, e))]


def _cannot(solution: Solution, e: ExistingCompensation) -> Iterator[str]:
    parts = solution.model.by_name
    for moved in e.compensation.axis_tables:
        if moved.factor is not None:
            yield (
                f"{e.words}: the table of {moved.output} over {moved.argument} grows with {moved.factor.axis}; the model "
                "describes that by an angular error motion alone"
            )
    for name, table in _functions(e):
        if (name, "mean") not in parts and not _only_constant(table):
            yield f"{e.words}: acts like {name}, which the model does not have"
        elif (name, "reversal") not in parts and _jump(table) > SEEN:
            jump = f"{1e3 * _jump(table):.1f} µm" if parse(name).unit == "mm" else f"{1e6 * _jump(table):.1f} µrad"
            yield f"{e.words}: {name} jumps by up to {jump} with the direction, and the model has no reversal of {name}"
    for grid in e.compensation.grids:
        apart = sum_of_lines(grid)[1] if isinstance(grid, Grid) else 0.0
        if apart > SEEN and not _by_angles(solution):
            yield (
                f"{e.words}: the grid is up to {1e3 * apart:.1f} µm off any sum of functions of single axes, and the model has "
                "no angular error motions"
            )


def _functions(e: ExistingCompensation) -> list[tuple[str, ErrorTable | AxisTable]]:
    """Tables by the error function that they act like; products with lever arms act like none."""
    found: list[tuple[str, ErrorTable | AxisTable]] = [(t.function, t) for t in e.compensation.tables]
    tables = [t for t in e.compensation.axis_tables if t.factor is None]
    return [*found, *((f"E{t.output}{t.argument}", t) for t in tables)]


def table_unit(name: str) -> str:
    """Unit of the values of an error function."""
    return parse(name).unit


def _jump(table: ErrorTable | AxisTable) -> float:
    return float(np.abs(table.forward - table.reverse).max())


def _only_constant(table: ErrorTable | AxisTable) -> bool:
    """Whether a table only shifts the axis, which no function of the model needs to describe."""
    return bool(np.ptp(np.concatenate([table.forward, table.reverse])) <= SEEN)


def _by_angles(solution: Solution) -> bool:
    """Whether the model has angular error motions of linear axes, which bend a grid."""
    return any(name[1] in "ABC" and name[2:] in LINEAR_AXES for name, part in solution.model.by_name if part == "mean")
