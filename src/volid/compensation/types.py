"""The fifteen compensation types of ISO/TR 16907, one small description each, and which of them go together.

A type is a set of *effects*. Each effect belongs to one place in a control: a table of an axis, a spatial grid, or the rotary
axes themselves. Types combine as long as no effect is corrected twice.

>>> import volid
>>> len(volid.COMPENSATION_TYPES), volid.COMPENSATION_TYPES["L-STR"].leaves
(15, 'positioning; roll elsewhere')
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from volid.exceptions import InputError
from volid.model.iso230 import LINEAR_AXES
from volid.model.machine import Machine

# effects: of linear axes, of rotary axes, and orientation turned by the rotary axes
POS, STR, SQU, ANG = "positioning", "straightness", "squareness", "angular"
ROTARY_POS, RAX, POR, ROTARY_ANG = "angular positioning", "radial and axial", "location", "tilt"
ORIENTATION = "orientation"
LINEAR_SPEC, ROTARY_SPEC = "own linear", "own rotary"
LINEAR_EFFECTS = (POS, STR, SQU, ANG)
ROTARY_EFFECTS = (ROTARY_POS, RAX, POR, ROTARY_ANG)

LINE, VOLUME, ELEVATION, AXIS = "line", "volume", "elevation or tool length", "axis"
TABLES, GRID = "tables", "grid"


@dataclass(frozen=True)
class CompensationType:
    """One type of ISO/TR 16907.

    `effects`: the parts of the error model that it corrects. `based_on`: where it holds: on the specific line through `at`, in
    all of the volume, at one elevation or tool length, or on the axis alone. `control`: what the control does with it. `leaves`:
    the errors that it does not correct. `forms`: table of an axis, or spatial grid. `needs_tool`: whether the control must know
    the tool vector.
    """

    name: str
    effects: tuple[str, ...]
    based_on: str
    control: str
    leaves: str
    forms: tuple[str, ...]
    needs_tool: bool = False

    @property
    def is_linear(self) -> bool:
        """True for the types of linear axes."""
        return bool({*LINEAR_EFFECTS, LINEAR_SPEC} & set(self.effects))

    @property
    def is_rotary(self) -> bool:
        """True for the types of rotary axes."""
        return bool({*ROTARY_EFFECTS, ROTARY_SPEC} & set(self.effects))

    @property
    def turns(self) -> bool:
        """True when rotary axes correct the orientation."""
        return ORIENTATION in self.effects

    @property
    def only_turns(self) -> bool:
        """True for FOR: orientation is all that it corrects."""
        return self.effects == (ORIENTATION,)

    @property
    def is_chosen(self) -> bool:
        """True for L-SPEC and R-SPEC, whose functions or rule the user chooses."""
        return bool({LINEAR_SPEC, ROTARY_SPEC} & set(self.effects))

    @property
    def by_axis_itself(self) -> bool:
        """True for R-POS: the rotary axis itself corrects its angle."""
        return self.based_on == AXIS


_MOVES = "adds to each linear axis by its own position"
_VOLUME = "moves X, Y, Z by position and tool vector"
_TURNS = "turns the rotary axes against the orientation error, outside kinematic poles"
TYPES: dict[str, CompensationType] = {
    t.name: t
    for t in (
        CompensationType("L-POS", (POS,), LINE, _MOVES, "straightness; pitch and yaw on other lines", (TABLES, GRID)),
        CompensationType(
            "L-STR",
            (STR,),
            LINE,
            "adds to the other axes by one's position",
            "positioning; roll elsewhere",
            (TABLES, GRID),
        ),
        CompensationType(
            "L-SQU", (SQU,), LINE, "adds to the other axes in proportion", "angular effects elsewhere", (TABLES, GRID)
        ),
        CompensationType("L-ANG", (ANG,), VOLUME, _VOLUME, "orientation; the specific lines", (GRID, TABLES), True),
        CompensationType("L-VOL", LINEAR_EFFECTS, VOLUME, _VOLUME, "orientation", (GRID, TABLES), True),
        CompensationType("FOR", (ORIENTATION,), VOLUME, _TURNS, "the component no rotary axis turns", (GRID,)),
        CompensationType(
            "L-VOL+",
            (*LINEAR_EFFECTS, ORIENTATION),
            VOLUME,
            f"{_VOLUME}, and {_TURNS}",
            "that component",
            (GRID,),
            True,
        ),
        CompensationType(
            "R-POS", (ROTARY_POS,), AXIS, "adds to the rotary axis itself", "radial, tilt, face", (TABLES,)
        ),
        CompensationType(
            "R-RAX", (RAX,), ELEVATION, "moves X, Y, Z by angle", "tilt effects elsewhere", (GRID, TABLES)
        ),
        CompensationType("R-POR", (POR,), VOLUME, _VOLUME, "error motions", (GRID, TABLES), True),
        CompensationType("R-ANG", (ROTARY_ANG,), VOLUME, _VOLUME, "orientation; one elevation", (GRID, TABLES), True),
        CompensationType("R-VOL", ROTARY_EFFECTS, VOLUME, _VOLUME, "orientation", (GRID, TABLES), True),
        CompensationType(
            "R-VOL+",
            (*ROTARY_EFFECTS, ORIENTATION),
            VOLUME,
            f"{_VOLUME}, and {_TURNS}",
            "that component",
            (GRID,),
            True,
        ),
        CompensationType("L-SPEC", (LINEAR_SPEC,), VOLUME, _VOLUME, "what is not selected", (GRID,), True),
        CompensationType("R-SPEC", (ROTARY_SPEC,), VOLUME, _VOLUME, "what is not selected", (GRID,), True),
    )
}

BY_COMPLETENESS = tuple(sorted(TYPES, key=lambda name: -len(TYPES[name].effects)))  # those with most effects first


def compensation_type(name: str) -> CompensationType:
    """The type of that name. Raises `InputError` for a name that ISO/TR 16907 does not have."""
    if name not in TYPES:
        raise InputError(f"`type={name}` is no compensation type of ISO/TR 16907; available: {', '.join(TYPES)}")
    return TYPES[name]


def select(names: Sequence[str], machine: Machine) -> tuple[CompensationType, ...]:
    """Types that one control can do together on this machine.

    Raises `InputError` for an unknown name, a type that the machine cannot have, or two types that correct one effect twice.
    """
    chosen = tuple(compensation_type(n) for n in dict.fromkeys(names))
    for t in chosen:
        _require_axes(t, machine)
    for i, one in enumerate(chosen):
        for other in chosen[i + 1 :]:
            _require_disjoint(one, other)
    return chosen


def _require_disjoint(one: CompensationType, other: CompensationType) -> None:
    twice = [e for e in one.effects if e in other.effects and e != ORIENTATION]
    if twice:
        raise InputError(
            f"{one.name} and {other.name} both correct {', '.join(twice)}; it would be corrected twice. Take one of them"
        )
    specific = {LINEAR_SPEC: LINEAR_EFFECTS, ROTARY_SPEC: ROTARY_EFFECTS}
    for a, b in ((one, other), (other, one)):
        if a.effects[0] in specific and set(b.effects) & set(specific[a.effects[0]]):
            raise InputError(f"{a.name} and {b.name} may correct the same errors twice; take one of them")
        if a.by_axis_itself and b.turns:
            raise InputError(f"{a.name} and {b.name} both turn the rotary axes, {b.name} for angular positioning too")


def _require_axes(t: CompensationType, machine: Machine) -> None:
    linear = [a for a in machine.axes if a.is_linear]
    rotary = [a for a in machine.axes if not a.is_linear]
    have = f"machine '{machine.name}' [{machine.structure.strip().strip('[]')}]"
    if t.is_rotary and not rotary:
        raise InputError(
            f"`type={t.name}`: {have} has no rotary axis; {t.name} is for rotary axes, L-VOL for linear ones"
        )
    if t.is_linear and not linear:
        raise InputError(f"`type={t.name}`: {have} has no linear axis; {t.name} is for linear axes")
    if t.name in ("L-STR", "L-SQU") and len(linear) < 2:
        raise InputError(
            f"`type={t.name}`: {have} has one linear axis; {t.name} moves another one, so expected two or three"
        )
    if t.turns and (len(linear) < len(LINEAR_AXES) or not _two_directions(machine)):
        raise InputError(
            f"`type={t.name}`: {have} cannot turn its tool into every direction; orientation is corrected by three linear and at "
            "least two rotary axes that are not parallel to each other"
        )


def _two_directions(machine: Machine) -> bool:
    """Whether the rotary axes span a plane of directions."""
    vectors = np.array([a.unit_vector for a in machine.axes if not a.is_linear])
    return len(vectors) >= 2 and int(np.linalg.matrix_rank(vectors, tol=0.05)) >= 2
