"""The path of a program in machine coordinates: block after block, with the modal state, to motions of X, Y and Z.

Refused is what cannot be followed from the text alone. Until X, Y and Z are all known, rapid motions pass as they are.
"""

from __future__ import annotations

import numpy as np

from volid.controllers.programs import codes
from volid.controllers.programs.arcs import AXES, CENTRE, Arc, arc_of, centre_by_radius, centre_by_words
from volid.controllers.programs.lines import LETTERS
from volid.controllers.programs.motion import AS_IS, CUT, LOST, RAPID, Motion
from volid.controllers.programs.setting import ARC_SHARE, RUN, SKIP, ProgramSetting
from volid.controllers.programs.state import Modal, check_words, codes_of
from volid.controllers.programs.words import Block, Word
from volid.exceptions import InputError

MADE_BY_VOLID = "CORRECTED BY VOLID"
DWELL, HOME, SECOND_HOME, IN_MACHINE = 40, 280, 300, 530
_FIRST_MANY = 1_000  # numbers of turns that P may have


class Reader:
    """Takes the blocks of a program one after the other, and says what each moves.

    Args:
        setting: What the program does not say.
        name: Of the program, for messages.
        quadrants: Whether arcs are cut where an axis changes its direction.
    """

    def __init__(self, setting: ProgramSetting, name: str, quadrants: bool) -> None:
        self.setting, self.name, self.quadrants = setting, name, quadrants
        self.state = Modal(setting)
        self.place = np.array(setting.start if setting.start is not None else [np.nan] * 3, dtype=float)
        self.ended = False
        self._begun = False

    def take(self, block: Block) -> Motion | None:
        """What a block moves; None where it moves nothing. Raises `InputError` for what cannot be followed."""
        if self._passes(block):
            return None
        where = f"{self.name}, line {block.number}"
        self._begun = True
        found = codes_of(block, where)
        check_words(block, {codes.MOTION: self.state.motion, **found}, where, self.setting.passing)
        self.state.take(block, found, where)
        motion = self._motion(block, found.get(codes.ALONE), where)
        stops = {w.value for w in block.words if w.letter == "M"}
        self.ended = bool(stops & {2.0, 30.0})
        if stops & codes.PAUSES:
            self.state.parked = {0, 1, 2}  # a person may have moved them since
        return motion

    def is_skipped(self, block: Block) -> bool:
        """Whether the control leaves a block out because of its /."""
        return block.deleted and self.setting.block_delete == SKIP

    def _passes(self, block: Block) -> bool:
        """Whether a block is outside the program, empty, or left out. Raises `InputError` where that is not known."""
        if block.percent:
            self.ended = self.ended or self._begun
        if any(MADE_BY_VOLID in c for c in block.comments):
            raise InputError(
                f"{self.name}, line {block.number}: the program is corrected already; correct the original instead"
            )
        if self.ended and block.first(LETTERS) is not None:
            raise InputError(
                f"{self.name}, line {block.number}: axes are named after the program's end, where LinuxCNC stops reading and "
                "grbl goes on; take out what follows the end"
            )
        if self.ended or not block.words or self.is_skipped(block):
            return True
        if block.deleted and self.setting.block_delete != RUN:
            raise InputError(
                f"{self.name}, line {block.number}: whether a block with / is carried out depends on a switch of the control; "
                "state `block_delete`, skip or run"
            )
        is_name = not self._begun and [w.letter for w in block.words] == ["O"]
        return is_name

    def _motion(self, block: Block, alone: int | None, where: str) -> Motion | None:
        named = frozenset(LETTERS.index(w.letter) for w in block.words if w.letter in LETTERS)
        if alone == DWELL:
            self._only(block, "GMNPSF", where, "a dwell, G4, has its time as P; X moves the axis on LinuxCNC and grbl")
            return None
        if alone in (HOME, SECOND_HOME):
            return self._home(block, named, where)
        moves_arc = self.state.motion in (20, 30) and block.first("IJKR") is not None
        if not named and not moves_arc:
            self._only(block, "GMNTSFHDPQ", where, "without a motion it means nothing")
            if alone == IN_MACHINE:
                raise InputError(f"{where}: G53 without X, Y or Z; write the place with it")
            return None
        if self.state.motion is None:
            raise InputError(f"{where}: axes are named, but no motion is in force; write G0, G1, G2 or G3 before")
        if alone == IN_MACHINE:
            return self._in_machine(block, named, where)
        return self._arc(block, named, where) if self.state.motion in (20, 30) else self._line(block, named, where)

    def _only(self, block: Block, letters: str, where: str, why: str) -> None:
        """Raises `InputError` where a block has a word with another letter."""
        strange = next((w for w in block.words if w.letter not in letters), None)
        if strange is not None:
            raise InputError(f"{where}: {strange.text} stands in this block; {why}")

    def _target(self, block: Block, base: np.ndarray, unit: float) -> np.ndarray:
        target = self.place.copy()
        for letter, value, _ in block.words:
            if letter in LETTERS:
                k = LETTERS.index(letter)
                target[k] = (base[k] if self.state.absolute else self.place[k]) + value * unit
        return target

    def _line(self, block: Block, named: frozenset[int], where: str) -> Motion:
        """G0 or G1."""
        self._only(block, "GMNXYZFSTHPQ", where, "a line has no such word")
        base, unit = self.state.base(where), self.state.unit_known(where)
        start, target = self.place, self._target(block, base, unit)
        if not self.state.absolute and np.isnan(target[list(named)]).any():
            raise InputError(
                f"{where}: {self._unknown(start)}, so an incremental motion (G91) cannot be followed; {_KNOW}"
            )
        if self.state.motion == 0:
            return self._rapid(block, named, target, where)
        self._ask_known(start, where)
        return self._made(block, CUT, np.stack([start, target]), named, where)

    def _rapid(self, block: Block, named: frozenset[int], target: np.ndarray, where: str) -> Motion:
        act = AS_IS if np.isnan(target).any() else RAPID
        self.state.parked -= named
        return self._made(block, act, np.stack([self.place, target]), named, where)

    def _arc(self, block: Block, named: frozenset[int], where: str) -> Motion:
        """G2 or G3."""
        self._only(block, "GMNXYZIJKRPFST", where, "an arc has no such word")
        base, unit = self.state.base(where), self.state.unit_known(where)
        self._ask_known(self.place, where)
        start, target, axes = self.place, self._target(block, base, unit), AXES[self.state.plane]
        arc = self._found_arc(block, start, target, where)
        if isinstance(arc, str):
            raise InputError(f"{where}: the arc cannot be made: {arc}")
        tolerance = ARC_SHARE * self.setting.curve_tolerance
        share = arc.shares(tolerance, self.quadrants)
        return self._made(block, CUT, arc.points(start, target, axes, share), named, where, arc.deviation(share))

    def _found_arc(self, block: Block, start: np.ndarray, target: np.ndarray, where: str) -> Arc | str:
        base, unit, axes = self.state.base(where), self.state.unit_known(where), AXES[self.state.plane]
        clockwise, words = self.state.motion == 20, block.values("IJKRP")
        first, last = start[list(axes[:2])], target[list(axes[:2])]
        turns = words.get("P", 1.0)
        if turns != int(turns) or not 1 <= turns < _FIRST_MANY:
            return f"P{turns:g} is no number of turns"
        if CENTRE[axes[2]] in words:
            return f"{CENTRE[axes[2]]} does not belong to the plane G{self.state.plane // 10}"
        centres = [w for w in words if w in CENTRE]
        if "R" in words:
            if centres or turns > 1:
                return "it has R and also I, J, K or P; write one of them"
            centre = centre_by_radius(first, last, unit * words["R"], clockwise)
            return centre if isinstance(centre, str) else arc_of(first, last, centre, clockwise)
        if not centres or (self.state.centres_absolute and len(centres) < 2):
            return f"its centre is not stated; write {' and '.join(CENTRE[a] for a in axes[:2])}, or R"
        origin = base if self.state.centres_absolute else None
        return arc_of(first, last, centre_by_words(words, first, origin, axes, unit), clockwise, int(turns))

    def _in_machine(self, block: Block, named: frozenset[int], where: str) -> Motion:
        """G53: a place in machine coordinates. A rapid there parks the axes, and is not corrected."""
        self._only(block, "GMNXYZFST", where, "a motion in machine coordinates has no such word")
        if self.state.motion != 0 or not self.state.absolute:
            raise InputError(f"{where}: G53 is followed as a rapid with absolute coordinates alone; write G90 G53 G0")
        unit, target = self.state.unit_known(where), self.place.copy()
        for letter, value, _ in block.words:
            if letter in LETTERS:
                target[LETTERS.index(letter)] = value * unit
        self.state.parked |= named
        return self._made(block, AS_IS, np.stack([self.place, target]), named, where, base=np.zeros(3))

    def _home(self, block: Block, named: frozenset[int], where: str) -> Motion:
        """G28, G30: to a place that the control keeps."""
        self._only(block, "GMNXYZPS", where, "a motion to the reference has no such word")
        words = block.values(LETTERS)
        if (self.state.absolute and words) or any(words.values()):
            raise InputError(
                f"{where}: a motion to the reference leads over a place between; write G91 G28 with X0, Y0 or Z0, or G28 alone"
            )
        gone = named or frozenset({0, 1, 2})
        target = self.place.copy()
        target[list(gone)] = np.nan
        self.state.parked |= gone
        return self._made(block, LOST, np.stack([self.place, target]), gone, where, base=np.zeros(3))

    def _made(
        self,
        block: Block,
        act: str,
        points: np.ndarray,
        named: frozenset[int],
        where: str,
        bound: float | None = None,
        base: np.ndarray | None = None,
    ) -> Motion:
        """The motion, after which the machine stands at its end."""
        state, inverse = self.state, 0.0
        corrected = act in (RAPID, CUT)
        if act == CUT and state.feed_mode == 930:
            inverse = _inverse(block.first("F"), where)
        parked = frozenset() if act == CUT else frozenset(state.parked)
        if act == CUT:
            state.parked.clear()
        self.place = points[-1].copy()
        return Motion(
            block.number - 1,
            act,
            points,
            state.tool(where) if corrected else (0.0, 0.0, 0.0),
            state.base(where) if base is None else base,
            state.unit or 1.0,
            state.absolute,
            named,
            parked,
            bound is not None,
            bound or 0.0,
            inverse,
            state.feed,
        )

    def _unknown(self, place: np.ndarray) -> str:
        letters = [LETTERS[k] for k in range(3) if np.isnan(place[k])]
        return f"the position of {', '.join(letters)} is not known here"

    def _ask_known(self, start: np.ndarray, where: str) -> None:
        """Raises `InputError` where a cut begins at a place that is not known."""
        if np.isnan(start).any():
            raise InputError(f"{where}: {self._unknown(start)}, and a motion in feed begins; {_KNOW}")


_KNOW = "write rapids (G0, G90) to X, Y and Z first, or state `start`, the machine position before the program"


def _inverse(word: Word | None, where: str) -> float:
    if word is None or word.value <= 0.0:
        raise InputError(f"{where}: in G93 every motion in feed has its own F above 0; write it")
    return word.value
