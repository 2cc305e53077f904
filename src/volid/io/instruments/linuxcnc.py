"""`linuxcnc`: the log of touches that LinuxCNC writes between (PROBEOPEN file) and (PROBECLOSE); spheres are fitted to them.

Nine numbers a line, X Y Z A B C U V W, or in old versions three, X Y Z, with six decimals and in the units of the program.
They are the controlled point in the work coordinate system, tool offset taken off: its zero is what `origin` says."""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from volid.campaign import SAME_ANGLE
from volid.exceptions import InputError
from volid.io.instruments.base import ForeignFile, Format, Found, ReadingsFormat, Request
from volid.io.instruments.laser_line import unit_of
from volid.io.instruments.numerals import number

_NUMBER = r"-?\d{1,9}\.\d{6}"
_LINE = re.compile(rf"{_NUMBER}(?: {_NUMBER}){{2}}(?:(?: {_NUMBER}){{6}})?")
_LETTERS = "XYZABCUVW"
_COORDINATES = ("tip", "axes")
_LOOKED_AT = 200  # lines


class LinuxCnc(ReadingsFormat):
    """Touches of spheres in the order in which they were made."""

    name = "linuxcnc"
    words = "a log of touches by LinuxCNC (PROBEOPEN)"
    about = (
        "coordinates = tip (work coordinates of the tool's point; with rotary axes under kinematics that keep "
        "it) or axes (axis "
        "positions), both plus origin; unit = inch for programs in G20; a sphere ends where a rotary axis moves, "
        "at a gap or after "
        "count touches. The layout is that of LinuxCNC's source; no log of a real machine was at hand."
    )
    keys = ("coordinates", "unit")

    def recognises(self, text: str) -> bool:
        """Lines of nine or three numbers with six decimals."""
        lines = [line.strip() for line in text[: 100 * _LOOKED_AT].split("\n")[:_LOOKED_AT]]
        lines = [line for line in lines if line]
        return len(lines) > 3 and sum(bool(_LINE.fullmatch(line)) for line in lines) > 0.8 * len(lines)

    def read(self, file: ForeignFile, request: Request) -> Found:
        """Every touch. Raises `InputError`."""
        rows, values = _numbers(file)
        _check_axes(values, file, request)
        names = _names(request)
        columns: dict[str, Any] = {name: values[:, i].tolist() for i, name in enumerate(names)}
        for i, letter in enumerate(_LETTERS[3:6], start=3):
            if letter in request.machine.letters:
                columns[letter] = values[:, i].tolist()
        unit = unit_of(request, "mm", "mm")
        note = f"coordinates in {unit}, {'of the tool tip' if names[0] == 'x' else 'of the axes'}"
        return Found(
            request.table.text("kind", "displacement"),
            columns,
            rows,
            dict.fromkeys(names, unit),
            {"touches": True},
            notes=(note,),
        )


def _numbers(file: ForeignFile) -> tuple[list[int], np.ndarray]:
    """Line numbers and the numbers of each line. Raises `InputError` for a line that is damaged."""
    rows: list[int] = []
    found: list[list[float]] = []
    for line, text in enumerate(file.text.split("\n"), start=1):
        tokens = text.split()
        values = [value for token in tokens if (value := number(token, ".")) is not None]
        if tokens and (
            len(values) != len(tokens) or len(tokens) not in (3, 9) or (found and len(tokens) != len(found[0]))
        ):
            wanted = f"{len(found[0])} numbers" if found else "three or nine numbers"
            raise file.wrong(
                line, f"'{text.strip()[:60]}' is damaged", f"{wanted} with decimal points, parted by blanks"
            )
        if tokens:
            rows.append(line)
            found.append(values)
    return rows, np.array(found)


def _names(request: Request) -> str:
    """Columns of the three coordinates: "xyz" of the tool tip, "XYZ" of the axes. Raises `InputError` where it is not said."""
    if "coordinates" not in request.table.data:
        raise InputError(
            f"{request.table.where}: key 'coordinates' is missing; add \"tip\" where the log holds coordinates of "
            "the tool's point "
            '(tool length active; with rotary axes, kinematics that keep the point), "axes" where it holds axis positions'
        )
    return "xyz" if request.table.text("coordinates", choices=_COORDINATES) == "tip" else "XYZ"


def _check_axes(values: np.ndarray, file: ForeignFile, request: Request) -> None:
    """Raises `InputError` where the log lacks a rotary axis of the machine, or holds a further axis that moves."""
    rotary = [a.letter for a in request.machine.axes if not a.is_linear]
    if values.shape[1] == 3:
        if rotary:
            raise InputError(
                f"{file.path}: three numbers a line, without positions of {', '.join(rotary)}; expected nine "
                "numbers, as LinuxCNC "
                "writes since 2.4, or a table with columns for all axes"
            )
        return
    for i, letter in enumerate(_LETTERS[3:], start=3):
        if letter not in request.machine.letters and np.ptp(values[:, i]) > SAME_ANGLE:
            raise InputError(
                f"{file.path}: {letter} moves from {values[:, i].min():g} to {values[:, i].max():g}, and the machine "
                f"'{request.machine.name}' has no axis {letter}; choose the machine that was measured"
            )


LINUXCNC: Format = LinuxCnc()
