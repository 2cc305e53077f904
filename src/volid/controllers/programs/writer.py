"""The corrected program as text: the blocks as they were, with new coordinates, and further blocks where a motion was cut.

What a block says besides its motion stands in the first block that comes of it, a stop or an end of the program in the last one.
Coordinates are rounded from the place where the machine stands after rounding, so that increments (G91) never add up their
rounding.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from volid.controllers.programs import codes
from volid.controllers.programs.lines import LETTERS
from volid.controllers.programs.motion import AS_IS, CUT, Motion
from volid.controllers.programs.setting import ProgramSetting
from volid.controllers.programs.words import Block, Word
from volid.exceptions import InputError

_ARC = (2.0, 3.0)
_SAME = 0.5000001  # of the last digit: a coordinate nearer to where the axis stands is not written again


class Cut(NamedTuple):
    """The lines of a motion, corrected. `first`, `last`: ends (k, 3) [mm]. `share`: of each in the length of the motion, (k,)."""

    first: np.ndarray
    last: np.ndarray
    share: np.ndarray
    length: float


class Writer:
    """Writes block after block, and knows where the machine stands.

    Args:
        setting: Digits, and the position before the program.
        name: Of the program, for messages.
    """

    def __init__(self, setting: ProgramSetting, name: str) -> None:
        self.setting, self.name = setting, name
        self.place = [float(v) for v in (setting.start if setting.start is not None else (np.nan,) * 3)]
        self.mode: int | None = None
        self.taken_up = 0

    def plain(self, block: Block, motion: Motion | None) -> list[str]:
        """A block whose coordinates stay as they are."""
        for w in block.words:
            if w.letter == "G" and w.value in (0.0, 1.0, 2.0, 3.0, 80.0):
                self.mode = int(w.value)
        if motion is not None:
            self._stand(motion)
        return [block.text.replace("/", " ", 1) if block.deleted else block.text]

    def skipped(self, block: Block) -> list[str]:
        """A block with / that the control leaves out, as a comment."""
        return [f"(left out: {block.text.strip().replace('(', ' ').replace(')', ' ')})"]

    def moved(self, block: Block, motion: Motion, cut: Cut) -> list[str]:
        """The blocks that a corrected motion becomes."""
        targets = self._targets(motion, cut)
        rows = [self._coordinates(motion, target, i == len(targets) - 1) for i, (target, _) in enumerate(targets)]
        self.taken_up += len(targets) - len(cut.last)
        feeds = [f" F{_plain_number(motion.inverse / share)}" if motion.inverse else "" for _, share in targets]
        kept = [(row, feed) for row, feed in zip(rows, feeds, strict=True) if row]
        if not kept:
            kept = [("", f" F{_plain_number(motion.inverse)}" if motion.inverse else "")]
        return self._lines(block, motion, kept)

    def _stand(self, motion: Motion) -> None:
        """Where the machine stands after a motion that was not corrected."""
        start, end = motion.points[0], motion.points[-1]
        for k in motion.named:
            incremental = motion.act == AS_IS and not motion.absolute
            self.place[k] = float(self.place[k] + end[k] - start[k] if incremental else end[k])

    def _targets(self, motion: Motion, cut: Cut) -> list[tuple[np.ndarray, float]]:
        """Places to which the blocks lead, with their shares of the length; also the corrected start of a line, where the machine
        stands somewhere else because an axis has turned, or a rapid has left it alone."""
        stands, found = np.array(self.place), []
        for first, last, share in zip(cut.first, cut.last, cut.share, strict=True):
            if motion.act == CUT and np.abs(first - stands).max() > self._near:
                way = float(np.linalg.norm(first - stands))
                found.append((first, way / max(cut.length, way)))
            found.append((last, share))
            stands = last
        return found

    @property
    def _near(self) -> float:
        """How near a start is taken as reached [mm]: a little more than half the last digit in mm."""
        return 0.6 * 10.0**-self.setting.digits

    def _tick(self, motion: Motion) -> float:
        return motion.unit * 10.0 ** -self.setting.digits_in(motion.unit)

    def _coordinates(self, motion: Motion, target: np.ndarray, is_last: bool) -> str:
        """Words of X, Y, Z that lead to a place; an axis that the program names is named in the last block at least."""
        digits, tick = self.setting.digits_in(motion.unit), self._tick(motion)
        words = []
        for k, letter in enumerate(LETTERS):
            named = k in motion.named
            if not named and k in motion.parked:
                continue
            stands, base = self.place[k], float(motion.base[k])
            if abs(target[k] - stands) < _SAME * tick and not (named and is_last):
                continue
            zero = base if motion.absolute else stands
            ticks = round((float(target[k]) - zero) / tick)
            words.append(letter + _number(ticks, digits))
            self.place[k] = zero + ticks * tick
        return " ".join(words)

    def _lines(self, block: Block, motion: Motion, rows: list[tuple[str, str]]) -> list[str]:
        """Text of the blocks: `rows` hold their coordinates, and F where each has its own."""
        begin, end = self._around(block, motion, len(rows) > 1)
        first, *others = rows
        text = [f"{begin.replace(_HERE, first[0]).strip()}{first[1]}"]
        text += [f"{row}{feed}" for row, feed in others]
        if end:
            text[-1] += f" {end}"
        if block.comments:
            text[0] += " " + " ".join(block.comments)
        return text

    def _around(self, block: Block, motion: Motion, several: bool) -> tuple[str, str]:
        """The words of a block with a place for the coordinates, and those that act after the motion."""
        wanted = 1 if motion.act == CUT else 0
        words, ends, placed, said = [], [], False, False
        for word in block.words:
            if _is_replaced(word, motion):
                words += [] if placed else [_HERE]
                placed = True
            elif word.letter == "G" and word.value in (0.0, 1.0, *_ARC):
                said = True
                words.append(f"G{wanted}")
            elif word.letter == "M" and word.value in codes.ENDS:
                ends.append(word.text)
            else:
                self._ask_whole(word, several, block)
                words.append(word.text)
        if not said and self.mode != wanted:
            words.insert(words.index(_HERE), f"G{wanted}")
        self.mode = wanted
        return " ".join(words), " ".join(ends)

    def _ask_whole(self, word: Word, several: bool, block: Block) -> None:
        """Raises `InputError` for an M code that acts before the motion on one control, after it on another."""
        if several and word.letter == "M" and word.value not in codes.BEFORE:
            raise InputError(
                f"{self.name}, line {block.number}: {word.text} stands in a block whose motion becomes several, and acts "
                "before it on one control, after it on another; write it in a block of its own"
            )


_HERE = "\0"  # where the coordinates of a block stand


def _is_replaced(word: Word, motion: Motion) -> bool:
    """Whether the new coordinates stand for a word."""
    return (
        word.letter in LETTERS
        or (motion.arc and word.letter in "IJKRP")
        or (motion.inverse > 0.0 and word.letter == "F")
    )


def _plain_number(value: float) -> str:
    """Six digits without an exponent, whose E would be a word of its own.

    >>> _plain_number(8538800.0), _plain_number(0.00001234567)
    ('8538800', '0.0000123457')
    """
    return np.format_float_positional(value, precision=6, unique=False, fractional=False, trim="-")


def _number(ticks: int, digits: int) -> str:
    """So many last digits as a number without needless zeros.

    >>> _number(-12500, 4), _number(0, 4), _number(20000, 4)
    ('-1.25', '0.', '2.')
    """
    if digits == 0:
        return str(ticks)
    whole, part = divmod(abs(ticks), 10**digits)
    return f"{'-' if ticks < 0 else ''}{whole}.{part:0{digits}d}".rstrip("0")
