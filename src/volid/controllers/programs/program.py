"""A program of G-code corrected in advance, for a control that holds no table: LinuxCNC, grbl and the like.

The program's path is followed in machine coordinates, its arcs become lines, and its lines are cut where the correction bends;
the ends of all lines then go to where a simulated control (`volid.Control`) would send the axes. What the machine does with the
new program is what a control with the tables and grids would do with the old one, up to the chord tolerance.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from volid.backend.steps import Step
from volid.compensation.control import Control
from volid.compensation.grids.grid import Grid
from volid.controllers.programs.correction import Corrected, Corrector
from volid.controllers.programs.counts import Counted, counted
from volid.controllers.programs.lines import LETTERS, Lines
from volid.controllers.programs.motion import AS_IS, CUT, LOST, RAPID, Motion
from volid.controllers.programs.path import MADE_BY_VOLID, Reader
from volid.controllers.programs.setting import ARC_SHARE, ProgramSetting
from volid.controllers.programs.words import Block, blocks
from volid.controllers.programs.writer import Cut, Writer
from volid.exceptions import InputError
from volid.model.machine import Axis, Machine

REPORTED = 20_000  # blocks between two words about the progress


@dataclass(frozen=True, eq=False)
class CorrectedProgram:
    """A corrected program.

    Args:
        text: The new program, with plain line ends.
        counted: What has been done, in numbers.
        nominal: Programmed ends of all lines in feed, (m, 2, 3) [mm], machine coordinates.
        corrected: Where they are sent, (m, 2, 3) [mm].

    >>> import numpy as np
    >>> import volid
    >>> x, values = np.array([0.0, 1000.0]), np.array([[0.0] * 6, [0.010] + [0.0] * 5])
    >>> grid = volid.Grid("L-POS", ("X",), (x,), x[:, None], values, values, x > 1e4, (0.0, 0.0, 0.0), "machine", "")
    >>> setting = volid.ProgramSetting(offsets={"G54": (100.0, 0.0, 0.0)}, tool=(0.0, 0.0, 0.0))
    >>> made = volid.apply_to_program(grid, "G21 G90 G0 X0 Y0 Z5" + chr(10) + "G1 X400 F500", setting)
    >>> made.counted.lines, round(1e3 * made.counted.largest[0], 6), made.nominal.shape
    (1, 5.0, (1, 2, 3))
    """

    text: str
    counted: Counted
    nominal: np.ndarray
    corrected: np.ndarray


def apply_to_program(
    control: Control | Grid,
    text: str,
    setting: ProgramSetting | None = None,
    *,
    name: str = "program",
    header: Sequence[str] = (),
    progress: Callable[[Step], None] | None = None,
) -> CorrectedProgram:
    """A program of G-code whose coordinates carry the compensation: X, Y, Z are sent to `Control.command` of each point.

    Along every motion in feed, the new path departs from the corrected path by at most `setting.chord`, rounding included. Not
    modelled: what the control does at corners (G64), its dynamics. Rapids are corrected at their ends.

    Args:
        control: The compensation, as a simulated control of three linear axes or as a grid over them.
        text: The program. RS274/NGC as LinuxCNC and grbl read it: G0 to G3 in any plane, G90 and G91, inches and mm, work
            offsets, G43, G53, G28, G93; what cannot be followed is refused with its line.
        setting: Work offsets, tools, tolerance; see `ProgramSetting`.
        name: Of the program, for messages.
        header: Lines that the new program says first, as comments.
        progress: Is told how far it is.

    Raises:
        InputError: the program has something that is not followed, or needs something that `setting` does not state; the message
            names the line.

    Source: NISTIR 6556 (2000), The NIST RS274/NGC Interpreter; ISO/TR 16907 7.5 for the grid.

    >>> import numpy as np
    >>> import volid
    >>> x, values = np.array([0.0, 1000.0]), np.array([[0.0] * 6, [0.010] + [0.0] * 5])
    >>> grid = volid.Grid("L-POS", ("X",), (x,), x[:, None], values, values, x > 1e4, (0.0, 0.0, 0.0), "machine", "")
    >>> setting = volid.ProgramSetting(offsets={"G54": (100.0, 0.0, 0.0)}, tool=(0.0, 0.0, 0.0))
    >>> made = volid.apply_to_program(grid, "G21 G90 G0 X0 Y0 Z5" + chr(10) + "G1 X400 F500", setting)
    >>> print(made.text)  # 5 µm are taken off at the machine position 500
    (CORRECTED BY VOLID)
    G21 G90 G0 X-0.001 Y0. Z5.
    G1 X399.995 F500
    <BLANKLINE>
    """
    setting = setting or ProgramSetting()
    corrector = Corrector(_control(control))
    quadrants = _has_reversal(corrector.control)
    program = list(blocks(text, name))
    reader = Reader(setting, name, quadrants)
    motions = []
    for i, block in enumerate(program):
        if progress is not None and i % REPORTED == 0:
            progress(Step(i, len(program), "lines", of="reading"))
        motions.append(reader.take(block))
    moving = [m for m in motions if m is not None]
    found = _corrected(corrector, _lines(moving, setting), [f"{name}, line {m.index + 1}" for m in moving], progress)
    writer, cuts = Writer(setting, name), _cuts(found, moving)
    lines: list[str] = []
    for block, motion in zip(program, motions, strict=True):
        if reader.is_skipped(block):
            lines += writer.skipped(block)
        elif motion is None or motion.act in (AS_IS, LOST):
            lines += writer.plain(block, motion)
        else:
            lines += writer.moved(block, motion, cuts[motion.index])
    lines = _with_header(lines, program, header)
    counts = counted((len(program), len(lines)), moving, found, writer, setting)
    cutting = np.array([moving[i].act == CUT for i in found.lines.owner], dtype=bool)
    nominal = np.stack([found.lines.start, found.lines.end], axis=1)[cutting]
    return CorrectedProgram(
        "\n".join(lines) + "\n", counts, nominal, np.stack([found.first, found.last], axis=1)[cutting]
    )


def _corrected(
    corrector: Corrector, lines: Lines, places: Sequence[str], progress: Callable[[Step], None] | None
) -> Corrected:
    """The lines corrected. Raises `InputError` with the line of the program where the control cannot."""
    try:
        return corrector.correct(lines, progress)
    except InputError as error:
        owner = corrector.first_refused(lines)
        if owner < 0:
            raise
        raise InputError(f"{places[owner]}: {error}") from None


def _control(control: Control | Grid) -> Control:
    """The control, or one with a grid alone: linear axes that need no kinematic chain."""
    if isinstance(control, Control):
        return control
    return Control(plain_machine(), grids=(control,))


def plain_machine() -> Machine:
    """Three linear axes and nothing else: all that a grid needs, which holds the whole chain's deviation already.

    >>> plain_machine().letters
    ('X', 'Y', 'Z')
    """
    axes = tuple(Axis(a, False, (-1e5, 1e5), 0.0) for a in LETTERS)
    return Machine("of the grid", "w b X Y Z t", axes)


def _has_reversal(control: Control) -> bool:
    of_functions = any(bool(np.any(t.forward != t.reverse)) for t in control.tables)
    return of_functions or any(t.has_reversal for t in control.axis_tables)


def _lines(motions: Sequence[Motion], setting: ProgramSetting) -> Lines:
    """All lines of the corrected motions, with the directions in which the axes last moved."""
    counts = np.array([len(m.points) - 1 for m in motions], dtype=int)
    owner = np.repeat(np.arange(len(motions)), counts)
    empty = np.zeros((0, 3))
    start = np.concatenate([empty, *(m.points[:-1] for m in motions)])
    end = np.concatenate([empty, *(m.points[1:] for m in motions)])
    tool = np.array([m.tool for m in motions]).reshape(-1, 3)[owner]
    tolerance = np.array([_tolerance(m, setting) for m in motions])[owner]
    acts = np.array([m.act in (RAPID, CUT) for m in motions], dtype=bool)[owner]
    way = _directions(start, end)
    start = np.where(np.isnan(start), end, start)
    base = np.array([m.base if setting.touched else (np.nan,) * 3 for m in motions]).reshape(-1, 3)
    return Lines(owner, start, end, tool, way, tolerance, base[owner]).rows(acts)


def _tolerance(motion: Motion, setting: ProgramSetting) -> float:
    if motion.act == CUT:
        return setting.curve_tolerance * (1.0 - ARC_SHARE if motion.arc else 1.0)
    known = not np.isnan(motion.points).any()
    return setting.curve_tolerance if setting.straight_rapids and known and motion.act == RAPID else np.inf


def _directions(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Signs of the motion of each axis, (m, 3); an axis at rest keeps its last one, 0 before it moves and where it comes from or
    goes to a place that is not known."""
    moved = end - start
    sign = np.where(np.abs(moved) > 1e-9, np.sign(moved), 0.0)
    at = np.where((sign != 0.0) | np.isnan(moved), np.arange(len(sign))[:, None], 0)
    return np.asarray(np.take_along_axis(sign, np.maximum.accumulate(at, axis=0), axis=0)) if len(sign) else sign


def _cuts(found: Corrected, motions: Sequence[Motion]) -> dict[int, Cut]:
    """The corrected lines of each motion by the index of its block."""
    ends = np.searchsorted(found.lines.owner, np.arange(len(motions) + 1))
    length = np.linalg.norm(found.lines.end - found.lines.start, axis=1)
    made = {}
    for i, motion in enumerate(motions):
        rows = slice(ends[i], ends[i + 1])
        if rows.start < rows.stop:
            total = float(length[rows].sum())
            share = length[rows] / total if total > 0.0 else np.full(rows.stop - rows.start, 1.0)
            made[motion.index] = Cut(found.first[rows], found.last[rows], share, total)
    return made


def _with_header(lines: list[str], program: Sequence[Block], header: Sequence[str]) -> list[str]:
    """The lines with comments behind the mark and the name at the program's beginning."""
    at = 0
    while at < len(program) and (program[at].percent or [w.letter for w in program[at].words] == ["O"]) and at < 2:
        at += 1
    said = [f"({_plain(text)})" for text in (MADE_BY_VOLID, *header)]
    return [*lines[:at], *said, *lines[at:]]


def _plain(text: str) -> str:
    """A text as it may stand in a comment of any control: no brackets, no letters beyond ASCII."""
    found = text.replace("(", "[").replace(")", "]").replace("µ", "u").replace("°", "deg")
    return "".join(c if " " <= c <= "~" else "?" for c in found)
