"""What every control declares about the compensation that it takes, and what is written for it and read back from it.

A control is one file: a `Declaration` (sign, unit, quantum, reference, ends, reversal, limits, types, and the facts with their
source), `write`, which turns the tables and grids of a `Job` into files, and `read`, which turns files into tables and grids of
error values again. Everything else, such as the sign check, the commissioning sheet and the record, follows from these
(`volid.controllers.export`). Inside volid there is one convention: error values, actual - nominal, in mm and rad.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from volid.compensation.on_top import summed
from volid.compensation.package import Compensation
from volid.compensation.tables.axis_table import AxisTable
from volid.compensation.tables.by_axis import axis_tables
from volid.exceptions import InputError
from volid.model.machine import Machine

# sense of the values in a control's files
ERROR, COMPENSATION, POSITION = "error", "compensation", "actual position"
OPEN = "open"  # public sources leave it open: the user states it
ABSOLUTE, INCREMENTAL = "absolute", "incremental"
# what becomes of the direction of approach
COLUMNS, ONE_VALUE, NO_REVERSAL = "both directions", "one value for the axis", "mean of both directions"
# what the control does beyond the first and last position
HELD, ROLLS_OVER, NOT_KNOWN = "end value held", "rolls over", "not stated by public sources"
CONTINUES = "goes on in a straight line"
EQUAL, FREE = "equal", "free"
# on what a fact rests
DOCUMENTED, RUN, INFERRED = "documented by the vendor", "run on the control", "inferred"


@dataclass(frozen=True)
class Fact:
    """One fact about a control. `basis`: DOCUMENTED, RUN, INFERRED or OPEN; `source`: where it can be checked."""

    text: str
    basis: str
    source: str = ""


@dataclass(frozen=True)
class Option:
    """Something that a user may state for a control. `convert`: from text, raises `ValueError`; `default` None: none needed."""

    name: str
    meaning: str
    default: Any = None
    convert: Callable[[str], Any] = str


@dataclass(frozen=True)
class Commissioning:
    """What a person does at the control, in order, one sentence each; what depends on the values stands in `Written`.

    `watch`: where the control shows the correction of an axis, besides an indicator; () where public sources name no place.
    """

    backup: tuple[str, ...]
    load: tuple[str, ...]
    activate: tuple[str, ...]
    remove: tuple[str, ...] = ()
    watch: tuple[str, ...] = ()


@dataclass(frozen=True)
class Declaration:
    """What a control takes.

    Args:
        name: Its name on the command line.
        title: Its name in words.
        carries: Types of ISO/TR 16907 that it can carry, the most complete first, and the form of each: "tables" or "grid".
        nearest: What to say to somebody who asks for another type: the reason, and the nearest that it or a neighbour can.
        sign: Sense of its values: ERROR, COMPENSATION, POSITION, or OPEN where the user must state it.
        rows: ABSOLUTE or INCREMENTAL values.
        units: Units of arguments and values in words.
        reversal: COLUMNS, ONE_VALUE or NO_REVERSAL.
        outside: HELD, ROLLS_OVER, CONTINUES or NOT_KNOWN.
        spacing: EQUAL or FREE positions.
        quantum: Steps in which it holds lengths [mm] and angles [rad]; None: as many digits as are written.
        most_points: Most positions of a table, or None.
        limits: What else bounds the number of positions, tables or files, in words; "" where `most_points` says it all.
        products: Whether it multiplies two tables, so that rotations act through lever arms.
        model: Whether it has a kinematic model, so that tables of error functions go in as they are.
        linear: Whether it holds straight lines through the origin alone, so that only this part of a table goes in.
        zero: Where values must be 0, in words.
        switching: How each compensation is switched on and off.
        options: What the user may state.
        zero_fixed: Whether the control itself makes the value 0 at its own zero, so that each axis is shifted as a whole.
        commissioning: What a person does at the control.
        facts: What is known about it, with its basis and source.
    """

    name: str
    title: str
    carries: Mapping[str, str]
    nearest: str
    sign: str
    units: str
    reversal: str
    outside: str
    zero: str
    switching: str
    commissioning: Commissioning
    facts: tuple[Fact, ...]
    rows: str = ABSOLUTE
    spacing: str = FREE
    quantum: tuple[float | None, float | None] = (None, None)
    most_points: int | None = None
    limits: str = ""
    products: bool = False
    model: bool = False
    linear: bool = False
    options: tuple[Option, ...] = ()
    zero_fixed: bool = False


@dataclass(frozen=True, eq=False)
class Job:
    """What is to be written for a control.

    Args:
        machine: The machine whose axes move.
        compensation: Tables and grids, error values.
        at: Positions of the specific lines, machine axis order, shape (n_axes,) [mm or °].
        tool: Tool vector of the lever arms, shape (3,) [mm].
        sign: Sense of the values in the files: that of the declaration, or what the user states where it is open.
        options: Values of all options of the declaration.
    """

    machine: Machine
    compensation: Compensation
    at: np.ndarray
    tool: np.ndarray
    sign: str
    options: Mapping[str, Any] = field(default_factory=dict)

    @property
    def factor(self) -> float:
        """What error values are multiplied by for the file: +1 for an error table, -1 for a compensation table."""
        return -1.0 if self.sign == COMPENSATION else 1.0

    def axis_tables(self, *, products: bool = False) -> tuple[AxisTable, ...]:
        """All tables as tables of axes, for a control without a kinematic model."""
        made = axis_tables(self.machine, self.compensation.tables, self.at, self.tool, products=products)
        return summed((*made, *self.compensation.axis_tables))


@dataclass(frozen=True)
class ControlFile:
    """A file for the control: name, content, and what it is in a few words."""

    name: str
    content: str | bytes
    what: str


@dataclass(frozen=True)
class Written:
    """What `write` makes.

    Args:
        files: The files for the control.
        parameters: Parameters to set at the control: name, value and meaning.
        notes: What a user should know of these files, one sentence each, such as the loss by rounding.
        rounding: Largest change of a value by the quantum [mm or rad].
    """

    files: tuple[ControlFile, ...]
    parameters: tuple[tuple[str, str, str], ...] = ()
    notes: tuple[str, ...] = ()
    rounding: float = 0.0


class Controller(ABC):
    """A control; one subclass and one file each."""

    declaration: Declaration

    def declared_for(self, machine: Machine, options: Mapping[str, Any]) -> Declaration:
        """The declaration for a machine and options, where the form of a type depends on them."""
        return self.declaration

    @abstractmethod
    def write(self, job: Job) -> Written:
        """The files for a job. Raises `InputError` for what the control cannot hold."""

    @abstractmethod
    def read(self, files: Mapping[str, str | bytes], machine: Machine, options: Mapping[str, Any]) -> Compensation:
        """Files of the control, content by name, as tables and grids of error values.

        `options`: those of the declaration, and "sign" where it is open. Raises `InputError` that names file and line.
        """

    def of_these_files(self, options: Mapping[str, Any]) -> Mapping[str, str]:
        """What options decide of the declaration, in words: "sign", "units" or another property of the sheet."""
        return {}

    def without_reversal_value(self, table: AxisTable, options: Mapping[str, Any]) -> AxisTable:
        """What a table does where the reversal value beside it is set to 0; in the mean of both directions by default."""
        return table

    def only_together(self, table: AxisTable, held: Compensation, options: Mapping[str, Any]) -> bool:
        """Whether what a table does is seen with all others loaded alone, as where it is multiplied by another one."""
        return table.factor is not None

    def recognises(self, name: str, content: str | bytes) -> bool:
        """Whether a file looks like one of this control; used where no control is named."""
        return False


def options_of(declaration: Declaration, stated: Mapping[str, Any]) -> dict[str, Any]:
    """All options of a control with their values. Raises `InputError` for an unknown option or a value that it cannot have."""
    known = {o.name: o for o in declaration.options}
    for name in stated:
        if name not in known:
            have = ", ".join(known) or "none"
            raise InputError(f"{declaration.name}: option '{name}' is unknown; expected one of: {have}")
    found = {}
    for name, option in known.items():
        value = stated.get(name, option.default)
        try:
            found[name] = option.convert(value) if isinstance(value, str) else value
        except ValueError as error:
            raise InputError(f"{declaration.name}: option {name} is '{value}'; {error}") from None
    return found


def sign_of(declaration: Declaration, stated: str | None) -> str:
    """Sense of the values. Raises `InputError` where it is open and not stated, or stated where it is fixed."""
    if declaration.sign != OPEN:
        if stated is not None and stated != declaration.sign:
            raise InputError(
                f"{declaration.name}: `sign={stated}`, but its values are {declaration.sign} values; leave it out"
            )
        return declaration.sign
    if stated not in (ERROR, COMPENSATION):
        raise InputError(
            f"{declaration.name}: public sources do not say which sign its values have; state `sign={ERROR}` (actual - nominal) "
            f"or `sign={COMPENSATION}` (minus that), and prove it with the one-point check of the commissioning sheet"
        )
    return stated


def text_of(name: str, content: str | bytes) -> str:
    """The text of a file. Raises `InputError` for bytes that are none."""
    if isinstance(content, str):
        return content
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("cp1252", errors="replace")


def refuse_points(declaration: Declaration, what: str, count: int) -> None:
    """Raises `InputError` for more positions than the control holds."""
    most = declaration.most_points
    if most is not None and count > most:
        raise InputError(
            f"{declaration.name}: {what} has {count} positions; the control holds {most}. Take a larger `step`, "
            f"or `max_points={most}`"
        )


def refuse_grids(declaration: Declaration, made: Compensation, nearest: str) -> None:
    """Raises `InputError` for spatial grids, which a control of tables of single axes cannot hold."""
    if made.grids:
        over = ", ".join(made.grids[0].axes)
        raise InputError(
            f"{declaration.name}: it holds tables of single axes, no grid over {over}; {nearest} carries grids"
        )


def outputs(tables: Sequence[AxisTable]) -> tuple[str, ...]:
    """Axes that the tables move, in order, each once."""
    return tuple(dict.fromkeys(t.output for t in tables))
