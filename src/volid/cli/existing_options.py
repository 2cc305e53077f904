"""What a control holds already, as options of `tables`, `grid` and `export`: --add-to and --add-active (ISO/TR 16907 10.5)."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from volid.cli.control_options import add_files_of, in_words_of

if TYPE_CHECKING:
    from volid.compensation.grids.grid import AnyGrid
    from volid.compensation.tables.error_table import ErrorTable
    from volid.controllers.existing.reading import ExistingCompensation
    from volid.fitting.solution import Solution
    from volid.model.machine import Machine


def add_existing(parser: argparse.ArgumentParser) -> None:
    """--add-to, its control, and --add-active."""
    parser.add_argument(
        "--add-to",
        metavar="OLD",
        action="append",
        default=[],
        help="existing tables, grids or files of a control, or a folder of them, to which the new values are added; repeat it",
    )
    add_files_of(parser, "add-to-", "of --add-to ")
    parser.add_argument(
        "--add-active",
        action="store_true",
        help="add the new values to the files that the campaign names as active, and holds",
    )


def existing_from(solution: Solution, args: argparse.Namespace) -> tuple[ExistingCompensation, ...]:
    """The existing compensations that are asked for. Raises `InputError`, also where the campaign names no file."""
    from volid.exceptions import InputError
    from volid.io.control_files import existing_of, recorded_compensations

    machine = solution.machine
    found: tuple[ExistingCompensation, ...] = ()
    if args.add_to:
        options = dict(args.add_to_option)
        with in_words_of(cnc="add_to_cnc", sign="add_to_sign"):
            found = existing_of(machine, args.add_to, args.add_to_cnc, sign=args.add_to_sign, options=options)
    if not args.add_active:
        return found
    recorded = recorded_compensations(solution.campaign)
    if not recorded:
        raise InputError(
            "--add-active: the campaign names no file of a control as active; name the files with --add-to, or in [conditions] "
            'as active_compensations = [{ file = "x.comp", cnc = "linuxcnc" }]'
        )
    return (*found, *recorded)


def existing_notes(solution: Solution, existing: tuple[ExistingCompensation, ...]) -> list[str]:
    """What a sum holds, and what of the old compensation the model cannot describe."""
    from volid.controllers.existing.state import not_described, not_recorded

    return [
        *(f"sum with {e.words}" for e in existing),
        *not_recorded(solution.campaign, existing),
        *not_described(solution, existing),
    ]


def old_tables(machine: Machine, existing: tuple[ExistingCompensation, ...]) -> tuple[ErrorTable, ...]:
    """Existing compensations as tables of error functions. Raises `InputError` for grids, and for what no function stands for."""
    from volid.compensation.superposition import add_tables
    from volid.controllers.existing.forms import as_functions
    from volid.exceptions import InputError

    found: tuple[ErrorTable, ...] = ()
    for e in existing:
        if e.compensation.grids:
            raise InputError(f"{e.words}: a grid cannot be added to tables; volid grid --add-to adds it to a grid")
        found = add_tables(found, as_functions(e.compensation, machine).tables)
    return found


def old_grids(
    new: Sequence[AnyGrid], existing: tuple[ExistingCompensation, ...], notes: list[str]
) -> Iterator[tuple[AnyGrid, str]]:
    """Existing grids, and tables as grids for the tool vector of the new one, with their words; a note for lost directions."""
    import numpy as np

    from volid.controllers.existing.forms import as_grid

    linear = [g for g in new if g.side == "linear"]
    for e in existing:
        made = e.compensation
        yield from ((g, e.words) for g in made.grids)
        if made.tables or made.axis_tables:
            if any(t.has_reversal for t in made.tables) or any(t.has_reversal for t in made.axis_tables):
                notes.append(
                    f"{e.words}: its tables differ by direction; a grid holds the mean, keep them for the reversal"
                )
            tool = linear[0].reference if linear else np.zeros(3)
            yield from ((g, e.words) for g in as_grid(replace(made, grids=()), e.machine, tool))
