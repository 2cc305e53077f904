"""What is in force at a block: the modal state of RS274/NGC, changed by the words of one block after the other."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from volid.controllers.programs import codes
from volid.controllers.programs.codes import FEED, GROUPS, LENGTH, REFUSED
from volid.controllers.programs.setting import INCH, ProgramSetting, Vector
from volid.controllers.programs.words import Block
from volid.exceptions import InputError

_WANTED = {"P": (40, 640, 20, 30), "Q": (640,), "H": (430,)}  # codes with which a word may stand
_NUMBERS = {"T": "a tool", "H": "a tool length"}  # whole ones
_Q_M, _CHANGE = 61.0, 6.0  # M61 Q: the tool in the spindle; M6: change of tools


def codes_of(block: Block, where: str) -> dict[str, int]:
    """The G codes of a block by their group, ten times their number.

    Raises:
        InputError: a code or a letter is refused or unknown, or two codes of a group contradict each other.
    """
    found: dict[str, int] = {}
    for letter, value, text in block.words:
        if letter != "G":
            continue
        code = round(10 * value)
        group = GROUPS.get(code)
        if group is None or abs(10 * value - code) > 1e-6:
            raise InputError(
                f"{where}: {text} {REFUSED.get(code, 'is not known, so nobody knows what it moves; leave it out')}"
            )
        if group in found and group != codes.NOTHING:
            raise InputError(
                f"{where}: {text} and G{found[group] / 10:g} are both codes of one group ({group}); write one"
            )
        found[group] = code
    return found


def check_words(block: Block, found: Mapping[str, int | None], where: str, passing: tuple[float, ...]) -> None:
    """Raises `InputError` for a letter or an M code that is refused or unknown, and for a letter that stands twice."""
    seen = set()
    for letter, value, text in block.words:
        if letter in codes.LETTERS:
            raise InputError(f"{where}: {text} {codes.LETTERS[letter]}")
        if letter == "M":
            if value not in codes.PASSING and value not in passing:
                why = codes.M_REFUSED.get(value, "is not known; if it moves no axis, name it in `passing`")
                raise InputError(f"{where}: {text} {why}")
        elif letter != "G" and letter in seen:
            raise InputError(f"{where}: there are two words {letter}; write one")
        seen.add(letter)
    _check_whole(block, where)
    if not any(w.letter == "M" and w.value in passing for w in block.words):
        _check_company(block, found, where)


def _check_whole(block: Block, where: str) -> None:
    """Raises `InputError` for the number of a tool or of its length that is not whole, or negative."""
    changed = any(w.letter == "M" and w.value == _Q_M for w in block.words)
    numbers = {**_NUMBERS, "Q": "a tool"} if changed else _NUMBERS
    for letter, value, text in block.words:
        if letter in numbers and (value != int(value) or value < 0):
            raise InputError(
                f"{where}: {text} is no number of {numbers[letter]}; expected a whole one, such as {letter}1"
            )


def _check_company(block: Block, found: Mapping[str, int | None], where: str) -> None:
    """Raises `InputError` for a word that means nothing without a code."""
    for letter, wanted in _WANTED.items():
        word = block.first(letter)
        if word is None or set(found.values()) & set(wanted):
            continue
        if letter == "Q" and any(w.letter == "M" and w.value == _Q_M for w in block.words):
            continue
        company = ", ".join(f"G{c / 10:g}" for c in wanted)
        raise InputError(f"{where}: {word.text} stands without {company}, and is not followed then; write it with one")


@dataclass
class Modal:
    """What is in force. `unit`: mm per unit of the program, None before it is known. `length`: offset of G43 [mm]. `feed`:
    mm/min, 0 where not known. `loaded`, `selected`: numbers of tools."""

    setting: ProgramSetting
    unit: float | None = None
    motion: int | None = None
    plane: int = 170
    absolute: bool = True
    centres_absolute: bool = False
    feed_mode: int = 940
    system: str = "G54"
    offset_on: bool = False
    length: float = 0.0
    feed: float = 0.0
    loaded: int | None = None
    selected: int | None = None
    parked: set[int] = field(default_factory=set)

    def __post_init__(self) -> None:
        if self.setting.units is not None:
            self.unit = INCH if self.setting.units == "inch" else 1.0

    def take(self, block: Block, found: Mapping[str, int], where: str) -> None:
        """The changes of a block, in the order in which they act. Raises `InputError` for an unknown tool length."""
        if code := found.get(codes.UNITS):
            self.unit = INCH if code == 200 else 1.0
        self.feed_mode = found.get(FEED, self.feed_mode)
        if word := block.first("F"):
            self.feed = word.value * (self.unit or 1.0) if self.feed_mode == 940 else 0.0
        self._tools(block)
        if code := found.get(LENGTH):
            self._length_offset(code == 430, block, where)
        self.plane = found.get(codes.PLANE, self.plane)
        if code := found.get(codes.SYSTEM):
            self.system = f"G{code / 10:g}"
        self.absolute = found.get(codes.DISTANCE, 900 if self.absolute else 910) == 900
        self.centres_absolute = found.get(codes.CENTRES, 901 if self.centres_absolute else 911) == 901
        if codes.MOTION in found:
            self.motion = None if found[codes.MOTION] == 800 else found[codes.MOTION]

    def _tools(self, block: Block) -> None:
        """T acts before M6 wherever it stands in the block; Q is a tool with M61 alone."""
        codes_m = {w.value for w in block.words if w.letter == "M"}
        if word := block.first("T"):
            self.selected = int(word.value)
        if _CHANGE in codes_m:
            self.loaded = self.selected
            self.parked = {0, 1, 2}  # a change of tools may have moved them
        if _Q_M in codes_m and (word := block.first("Q")):
            self.loaded = int(word.value)

    def _length_offset(self, on: bool, block: Block, where: str) -> None:
        self.offset_on = on
        if not on:
            self.length = 0.0
            return
        word = block.first("H")
        number = self.loaded if word is None else int(word.value)
        if number == 0:
            raise InputError(
                f"{where}: the length of number 0 is none on one control, that of the loaded tool on another (LinuxCNC); write "
                "G49, or G43 with the number of the length"
            )
        if number is None or number not in self.setting.lengths:
            named = (
                "G43 without H, and no tool is loaded" if number is None else f"G43 takes the length of number {number}"
            )
            raise InputError(f"{where}: {named}; state it as `length`, such as H{number or 1}=150 in mm")
        self.length = float(self.setting.lengths[number])

    def base(self, where: str) -> np.ndarray:
        """Machine position of the program's origin: work offset and tool length, (3,) [mm]. Raises `InputError`."""
        if self.system not in self.setting.offsets:
            raise InputError(
                f"{where}: work offset {self.system} is active, and where it lies is not stated; state it as `offset`, such as "
                f"{self.system}=400,200,-300: the machine position in mm of its origin, as the control shows it"
            )
        return np.asarray(self.setting.offsets[self.system], dtype=float) + np.array([0.0, 0.0, self.length])

    def tool(self, where: str) -> Vector:
        """Tool vector in force, (3,) [mm]. Raises `InputError` where none is known."""
        if self.loaded in self.setting.tools:
            return self.setting.tools[self.loaded]  # type: ignore[index]
        if self.setting.tool is not None:
            return self.setting.tool
        if self.offset_on:
            return 0.0, 0.0, -self.length
        number = "" if self.loaded is None else f" (T{self.loaded})"
        raise InputError(
            f"{where}: the tool vector is not known{number}, and rotations act through it; state `tool`, such as 0,0,-150 in mm, "
            "or the lengths of tools for G43"
        )

    def unit_known(self, where: str) -> float:
        """mm per unit. Raises `InputError` where the program has not said it."""
        if self.unit is None:
            raise InputError(f"{where}: the axes move before G20 or G21 says whether in inches or mm; state `units`")
        return self.unit
