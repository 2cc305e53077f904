"""Which types of ISO/TR 16907 a control is given: those asked for, or the most that it carries and the data determine."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from volid.compensation.package import Compensation
from volid.compensation.types import compensation_type, select
from volid.controllers.base import Declaration
from volid.exceptions import InputError, NotDeterminedError
from volid.model.machine import Machine

BLANK = "the data do not determine its values everywhere"
NOTHING = "the model has no function that it corrects"


class Choice(NamedTuple):
    """The types, and one sentence for each that was left out."""

    types: tuple[str, ...]
    notes: tuple[str, ...] = ()


def asked_types(declared: Declaration, types: Sequence[str], machine: Machine) -> Choice:
    """The types asked for. Raises `InputError` for one that the control or the machine cannot have, naming the nearest."""
    for name in types:
        compensation_type(name)
        if name not in declared.carries:
            can = ", ".join(declared.carries)
            raise InputError(
                f"`type={name}`: {declared.name} cannot carry {name}: {declared.nearest}. It carries {can}"
            )
    select(types, machine)
    return Choice(tuple(dict.fromkeys(types)))


def most_types(
    declared: Declaration,
    machine: Machine,
    functions: Sequence[str],
    make: Callable[[Sequence[str]], Compensation],
) -> Choice:
    """The most complete types that the control carries on this machine and the data determine.

    Args:
        declared: What the control declares; its types stand in the order of completeness.
        machine: The machine.
        functions: Functions that L-SPEC and R-SPEC use; without them these types are left out.
        make: Makes and writes types, coarsely, to see whether the data determine them and the control holds them together.

    Raises:
        NotDeterminedError: the data determine none of them.
        InputError: the machine has no axis for any of them, or the control refuses all.
    """
    found: list[str] = []
    left: list[str] = []
    refused = False
    for name in declared.carries:
        if not _fits(name, found, machine) or (compensation_type(name).is_chosen and not functions):
            continue
        why = _obstacle([*found, name], make)
        if why:
            left.append(f"{name} is left out: {why.text}")
            refused = refused or not why.of_the_data
        else:
            found.append(name)
    if found:
        return Choice(tuple(found), tuple(left))
    if left:
        kind = InputError if refused else NotDeterminedError
        raise kind(f"{declared.name}: nothing that it carries can be made. {'. '.join(left)}")
    raise InputError(
        f"{declared.name} carries {', '.join(declared.carries)}, and machine '{machine.name}' has no axis for any of them"
    )


def _fits(name: str, found: Sequence[str], machine: Machine) -> bool:
    """Whether the machine can have the type, and no effect would be corrected twice."""
    try:
        select([*found, name], machine)
    except InputError:
        return False
    return True


class _Obstacle(NamedTuple):
    text: str
    of_the_data: bool = True


def _obstacle(names: Sequence[str], make: Callable[[Sequence[str]], Compensation]) -> _Obstacle | None:
    """Why the last of some types cannot be made beside the others; None where it can."""
    try:
        made = make(names)
    except (NotDeterminedError, InputError) as error:
        return _Obstacle(str(error).rstrip(".").removeprefix("tables: "), isinstance(error, NotDeterminedError))
    held = [n for t in made.tables for n in t.type.split(" + ")] + [g.type for g in made.grids]
    if names[-1].rstrip("+") not in (n.rstrip("+") for n in held):  # beside FOR, L-VOL becomes L-VOL+
        return _Obstacle(NOTHING)
    blank = any(np.isnan(g.values[:, :3]).any() for g in made.grids)
    return _Obstacle(BLANK) if blank else None
