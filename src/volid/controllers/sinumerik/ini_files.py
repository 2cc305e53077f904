"""What tables of SINUMERIK have in common: initialisation files of system variables, names of machine axes, equal steps.

A file is a list of assignments such as `$AA_ENC_COMP[0,1,X1]=0.010 ; comment`, which the control carries out one after the
other: what is assigned twice has its last value, and what is not assigned keeps what it was. Machine data that a person sets by
hand stand in comments of the form `; MD32450 $MA_BACKLASH[0,X1]=0.003`, and are read too, except where the files assign them:
the control carries out the assignment, whether it stands before or behind the comment.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from volid.controllers.base import Option, text_of
from volid.controllers.options import axis_names
from volid.controllers.tables.equal_steps import DIGITS, Lattice
from volid.exceptions import InputError
from volid.model.machine import Axis, Machine

_SETTING = re.compile(r"(?:N\d+\s+)?\$(\w+)\s*\[([^\[\]]*)\]\s*=\s*(\S.*)", re.IGNORECASE)
_PASSED = re.compile(r"%_N_\w+|CHANDATA\s*\(\s*\d+\s*\)|M0*(?:0|2|17|30)|NEWCONF|", re.IGNORECASE)
_BY_HAND = re.compile(r";\s*MD\d+\s+(\$.*)")
LARGEST_NUMBER, LARGEST_INDEX = 1e6, 5000
MANUAL = "Siemens, SINUMERIK Function Manual Extended Functions K3, 6FC5397-1BP40-3BA1 (03/2013)"


AXES = Option(
    "axes",
    "names of the machine axes (MD10000, or AX1 … by their number), such as X=X1,Y=Y1,Z=Z1; by default the letter and 1",
    {},
    axis_names,
)


@dataclass(frozen=True)
class Setting:
    """One assignment. `where`: file and line, for messages. `by_hand`: whether it is a comment for a person."""

    name: str
    index: tuple[str, ...]
    value: str
    where: str
    by_hand: bool = False

    @property
    def place(self) -> tuple[str, ...]:
        """Name and index, however they are written."""
        plain = (part.strip(" ()\"'") for part in self.index)
        return (self.name, *(str(int(part)) if part.isdecimal() else part for part in plain))

    @property
    def number(self) -> float:
        """The value as a number. Raises `InputError` for anything else."""
        try:
            found = float(self.value)
        except ValueError:
            found = float("nan")
        if not abs(found) < LARGEST_NUMBER:
            raise InputError(f"{self.where}: ${self.name} is '{self.value}'; expected a number in mm or °")
        return found

    def choice(self, *allowed: int) -> int:
        """The value as one of some whole numbers. Raises `InputError` for another."""
        if self.number not in allowed:
            raise InputError(f"{self.where}: ${self.name} is {self.value}; expected {', '.join(map(str, allowed))}")
        return int(self.number)

    def whole(self, place: int) -> int:
        """An index as a whole number. Raises `InputError` for anything else."""
        text = self.index[place] if place < len(self.index) else ""
        if not re.fullmatch(r"\d{1,6}", text) or int(text) > LARGEST_INDEX:
            raise InputError(
                f"{self.where}: ${self.name}[{','.join(self.index)}] has the index '{text}'; expected a whole number 0 … "
                f"{LARGEST_INDEX}"
            )
        return int(text)


def settings(files: Mapping[str, str | bytes]) -> list[Setting]:
    """All assignments of the files, in order; comments for a person where nothing assigns the same.

    Raises `InputError` for a line that is none, and for files without any.
    """
    found = [s for name, content in files.items() for s in _of_file(name, text_of(name, content))]
    if not found:
        raise InputError(
            f"{', '.join(files)}: no system variable is assigned; expected lines such as $AN_CEC[0,0]=0.01"
        )
    assigned = {s.place for s in found if not s.by_hand}
    return [s for s in found if not (s.by_hand and s.place in assigned)]


def _of_file(name: str, text: str) -> Iterable[Setting]:
    for number, line in enumerate(text.splitlines(), 1):
        by_hand = _BY_HAND.match(line.strip())
        body = (by_hand.group(1) if by_hand else line).partition(";")[0].strip()
        match = _SETTING.fullmatch(body)
        if match:
            index = tuple(part.strip().upper() for part in match.group(2).split(","))
            where = f"{name}, line {number}"
            yield Setting(match.group(1).upper(), index, match.group(3).strip(), where, by_hand is not None)
        elif not _PASSED.fullmatch(body):
            raise InputError(
                f"{name}, line {number}: '{body}' is no assignment of a system variable; expected a line such as "
                "$AN_CEC[0,0]=0.01, a comment after ;, CHANDATA(1) or M17"
            )


def name_of(letter: str, names: Mapping[str, str]) -> str:
    """Name of a machine axis at the control."""
    return names.get(letter, f"{letter}1")


def axis_of(name: str, where: str, names: Mapping[str, str], machine: Machine) -> Axis:
    """The axis of a machine that the control calls so. Raises `InputError` where none is."""
    wanted = name.strip(" ()\"'").upper()
    for axis in machine.axes:
        if wanted == name_of(axis.letter, names).upper():
            return axis
    known = ", ".join(f"{a.letter}={name_of(a.letter, names)}" for a in machine.axes)
    raise InputError(
        f"{where}: machine axis '{wanted}' belongs to no axis of the machine ({known}); state the option axes, such as "
        f"axes={machine.axes[0].letter}={wanted}"
    )


@dataclass
class Parts:
    """What the assignments to one table say: points, and the latest assignment of each further variable by its suffix."""

    points: dict[int, Setting]
    others: dict[str, Setting]

    def of(self, suffix: str, where: str) -> Setting:
        """One of the further variables. Raises `InputError` where it is missing."""
        if suffix not in self.others:
            raise InputError(f"{where}: {suffix} is not assigned; a table needs it")
        return self.others[suffix]

    def number(self, suffix: str, default: float) -> float:
        """The value of a variable that may be missing."""
        return self.others[suffix].number if suffix in self.others else default

    def choice(self, suffix: str, *allowed: int) -> int:
        """The value of a variable that may be missing, then 0: one of some whole numbers."""
        return self.others[suffix].choice(*allowed) if suffix in self.others else 0

    def curve(self, what: str) -> tuple[np.ndarray, np.ndarray]:
        """Positions and values of the points. Raises `InputError` for missing points, ends or step."""
        low, high, step = (self.of(suffix, what) for suffix in ("MIN", "MAX", "STEP"))
        if not (low.number < high.number and step.number > 0.0):
            raise InputError(
                f"{step.where}: {what} goes from {low.number:g} to {high.number:g} in steps of {step.number:g}; expected a "
                "step above 0 and a range that rises"
            )
        steps = (high.number - low.number) / step.number
        if not 0.5 < steps <= LARGEST_INDEX or abs(steps - round(steps)) > 1e-3:
            raise InputError(
                f"{step.where}: {what}: (MAX - MIN) / STEP = {steps:.6g}; expected a whole number 1 … {LARGEST_INDEX}"
            )
        missing = [n for n in range(round(steps) + 1) if n not in self.points]
        if missing:
            raise InputError(
                f"{step.where}: {what} has no value at point {missing[0]} of 0 … {round(steps)}; the control would keep what "
                "it held there before. Assign every point"
            )
        x = Lattice(low.number, high.number, round(steps) + 1).positions
        return x, np.array([self.points[n].number for n in range(len(x))])

    def period(self, axis: Axis, x: np.ndarray, what: str) -> float:
        """360 for a table that is repeated, else 0 [°]. Raises `InputError` for other periods."""
        if not self.choice("IS_MODULO", 0, 1):
            return 0.0
        if axis.is_linear or abs(x[-1] - x[0] - 360.0) > 1e-6:
            where = self.others["IS_MODULO"].where
            raise InputError(f"{where}: {what} repeats after {x[-1] - x[0]:g}; expected a rotary axis and 360°")
        return 360.0


def ask_plain(s: Setting) -> None:
    """Raises `InputError` for machine data by which a control takes tables otherwise than volid does: inches, or a weight.

    Other machine data are passed over.
    """
    if s.name in ("MA_CEC_SCALING_SYSTEM_METRIC", "MA_BACKLASH_FACTOR") and s.value.upper() not in ("TRUE", "1", "1.0"):
        raise InputError(
            f"{s.where}: ${s.name} is {s.value}; volid reads tables in millimetres, and backlash of weight 1: expected 1"
        )


def covers(lattice: Lattice, values: np.ndarray, axis: Axis, unit: str, period: float = 0.0) -> str:
    """A sentence where a table does not reach over the travel, else nothing. `values`: as in the file."""
    if period or (lattice.low <= axis.travel[0] + 1e-6 and lattice.high >= axis.travel[1] - 1e-6):
        return ""
    return (
        f"{axis.letter}: the table covers {lattice.low:g} … {lattice.high:g} {axis.unit} of the travel {axis.travel[0]:g} … "
        f"{axis.travel[1]:g}; beyond it the control holds the end values {values[0]:.6f} and {values[-1]:.6f} {unit}"
    )


def number(value: float) -> str:
    """A position or value as the file wants it; no minus before zero."""
    return f"{round(value, DIGITS) + 0.0:.{DIGITS}f}"
