"""Which types of ISO/TR 16907 a control is given: those asked for, or the most that it carries and the data determine."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from volid.compensation.package import Compensation
from volid.compensation.types import (
    ANG,
    ORIENTATION,
    POR,
    POS,
    RAX,
    ROTARY_ANG,
    ROTARY_POS,
    SQU,
    STR,
    TYPES,
    compensation_type,
    select,
)
from volid.controllers import CONTROLS
from volid.controllers.base import Declaration
from volid.exceptions import InputError, NotDeterminedError
from volid.fitting.solution import Solution
from volid.model.iso230 import LINEAR_AXES, SPINDLE, ErrorName, parse
from volid.model.machine import Machine

BLANK = "the data do not determine its values everywhere"
TURNING = "they would turn rotary axes against the orientation error, which is done where they are asked for by name"
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
            raise InputError(
                f"`type={name}`: {declared.name} cannot carry {name}: {declared.nearest}. {instead_of(declared, name)}"
            )
    select(types, machine)
    return Choice(tuple(dict.fromkeys(types)))


def instead_of(declared: Declaration, name: str) -> str:
    """What of a type the control can carry, and which controls carry all of it."""
    own, effects = declared.carries, set(TYPES[name].effects)
    parts = [n for n in own if set(TYPES[n].effects) < effects]
    nearest = [n for n in parts if not any(set(TYPES[n].effects) < set(TYPES[m].effects) for m in parts)]
    here = f"The nearest that it carries: {', '.join(nearest)}" if nearest else f"It carries {', '.join(own)}"
    others = ", ".join(n for n, c in CONTROLS.items() if name in c.declaration.carries)
    return f"{here}. {name} itself is carried by {others}" if others else here


def most_types(
    declared: Declaration,
    solution: Solution,
    functions: Sequence[str],
    make: Callable[[Sequence[str]], Compensation],
) -> Choice:
    """The most complete types that the control carries on this machine and the data determine.

    A type whose effects are partly not in the model at all, such as L-VOL where nothing but positioning was measured, gives way
    to smaller ones that say what there is.

    Args:
        declared: What the control declares; its types stand in the order of completeness.
        solution: The solution.
        functions: Functions that L-SPEC and R-SPEC use; without them these types are left out.
        make: Makes and writes types, coarsely, to see whether the data determine them and the control holds them together.

    Raises:
        NotDeterminedError: the data determine none of them.
        InputError: the machine has no axis for any of them, or the control refuses all.
    """
    found: list[str] = []
    why_not: dict[str, list[str]] = {}
    machine, refused, present = solution.machine, False, effects_in(solution.model.names)
    for name in declared.carries:
        if not _fits(name, found, machine) or (compensation_type(name).is_chosen and not functions):
            continue
        why = _in_model(name, declared, present) or _obstacle([*found, name], make)
        if why:
            why_not.setdefault(why.text.removeprefix(f"{declared.name}: "), []).append(name)
            refused = refused or not why.of_the_data
        else:
            found.append(name)
    left = tuple(f"{', '.join(names)} left out: {text}" for text, names in why_not.items())
    if found:
        return Choice(tuple(found), left)
    if left:
        kind = InputError if refused else NotDeterminedError
        raise kind(f"{declared.name}: nothing that it carries can be made. {_each_once('. '.join(left))}")
    raise InputError(
        f"{declared.name} carries {', '.join(declared.carries)}, and machine '{machine.name}' has no axis for any of them"
    )


def _each_once(text: str) -> str:
    """The text without the sentences that it has already had: types left out have reasons in common.

    >>> _each_once("A is left out. Measure more. B is left out. Measure more")
    'A is left out. Measure more. B is left out'
    """
    return ". ".join(dict.fromkeys(text.split(". ")))


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


def effects_in(names: Sequence[str]) -> set[str]:
    """The effects of ISO/TR 16907 of which a model has functions; `names`: ISO 230-1 symbols.

    >>> sorted(effects_in(["EXX", "EC0Y", "EA0S"]))
    ['positioning', 'squareness']
    """
    found = {_effect(error) for error in map(parse, names) if error.axis != SPINDLE}
    return found | ({ORIENTATION} if found & {ANG, ROTARY_ANG} else set())


def _effect(error: ErrorName) -> str:
    """The effect that an error function belongs to."""
    linear, own = error.axis in LINEAR_AXES, error.direction == error.axis
    if linear:
        return SQU if error.location else POS if own else ANG if error.is_rotation else STR
    return ROTARY_POS if own else POR if error.location else ROTARY_ANG if error.is_rotation else RAX


def _in_model(name: str, declared: Declaration, present: set[str]) -> _Obstacle | None:
    """Why a type is not taken by default: it turns rotary axes, or the model has nothing of it or too little.

    Too little is less than all effects, where smaller types of the control hold those that the model has.
    """
    effects = set(TYPES[name].effects)
    if TYPES[name].turns:
        return _Obstacle(TURNING)
    if not TYPES[name].is_chosen and not effects & present:
        return _Obstacle(NOTHING)
    lacking = [e for e in TYPES[name].effects if e not in present]
    smaller = [set(TYPES[n].effects) for n in declared.carries if set(TYPES[n].effects) < effects]
    covered = set().union(*(s for s in smaller if s <= present))
    if not lacking or TYPES[name].is_chosen or not covered or not effects & present <= covered:
        return None
    return _Obstacle(f"the model has no function of {', '.join(lacking)}; smaller types hold the rest")


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
