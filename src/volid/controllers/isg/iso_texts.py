"""Two texts that hold error parameters under their names of ISO 230: ISG_CSV, and the exchange text of ETALON.

ISG_CSV: columns with a header of arguments (X, Y, Z in mm, A, B, C in degrees) and parameters (mm, rad), `//` before a comment,
a line `#` before a new header. The exchange text: `[C0Y]` and `VALUE = …` for a constant, `[EXX]` and `Gridpoints = { … }` with
lines of argument and value for a function of the axis's own position. Source: Beckhoff TF5280, 296426379, 296429067, 296430091.

Numbers are written with as many digits as give the same double-precision number again.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from volid.controllers.tables.lists import number
from volid.exceptions import InputError

ARGUMENTS = ("X", "Y", "Z", "A", "B", "C")
_FUNCTION = re.compile(r"E[XYZABC][XYZABC]")
_PLACE = re.compile(r"[XYZABC]|P0?[XYZ][ABC]?")
_CONSTANT = re.compile(r"[XYZABC]0[XYZABC]|[PN]0[XYZ]|P[XYZ][ABC]|V[XYZ][XYZABC]")
LARGEST, LARGEST_ERROR = (
    1e6,
    100.0,
)  # of a position [mm or °], of an error [mm or rad]: beyond, it is another unit or damage


@dataclass(frozen=True, eq=False)
class Block:
    """Parameters over the same arguments.

    Args:
        arguments: Letters of the axes, as they stand in the file.
        names: Parameters, such as "EXX" or "C0Y".
        at: Arguments, shape (n, number of arguments) [mm or °].
        values: Parameters, shape (n, number of names) [mm or rad].
        where: File and line, for messages.
    """

    arguments: tuple[str, ...]
    names: tuple[str, ...]
    at: np.ndarray
    values: np.ndarray
    where: str

    @property
    def is_constant(self) -> bool:
        """Whether it has no argument."""
        return not self.arguments


def isg_csv(blocks: Sequence[Block], comment: str) -> str:
    """Text of the format ISG_CSV."""
    parts = []
    for block in blocks:
        table = np.column_stack([block.at, block.values])
        rows = "".join(" ".join(number(v) for v in row) + "\n" for row in table)
        parts.append(" ".join((*block.arguments, *block.names)) + "\n" + rows)
    return f"// {comment}\n" + "#\n".join(parts)


def etalon(blocks: Sequence[Block], comment: str) -> str:
    """Exchange text of ETALON, one section per parameter."""
    parts = [f"// {comment}\n"]
    for block in blocks:
        for name, column in zip(block.names, block.values.T, strict=True):
            if block.is_constant:
                parts.append(f"[{name}]\nVALUE = {number(column[0])}\n")
            else:
                rows = "".join(f"{number(x)} {number(v)}\n" for x, v in zip(block.at[:, 0], column, strict=True))
                parts.append(f"[{name}]\nGridpoints = {{\n{rows}}}  // end of {name}\n")
    return "".join(parts)


def _lines(text: str) -> Iterator[tuple[int, str]]:
    for i, line in enumerate(text.splitlines(), 1):
        content = line.split("//", 1)[0].strip()
        if content:
            yield i, content


def _number(text: str, where: str, column: str) -> float:
    where, most = f"{where}, {column}", LARGEST if _PLACE.fullmatch(column) else LARGEST_ERROR
    try:
        found = float(text)
    except ValueError:
        found = float("nan")
    if not abs(found) <= most:  # NaN too
        raise InputError(f"{where}: '{text[:40]}'; expected a number in mm, rad or degrees, at most {most:g}")
    return found


def begins_as_isg_csv(text: str) -> bool:
    """Whether the first line that is no comment names arguments and parameters."""
    words = next((line.split() for _, line in _lines(text)), [])
    known = [w for w in words if w in ARGUMENTS or _FUNCTION.fullmatch(w) or _CONSTANT.fullmatch(w)]
    return len(known) == len(words) and any(w not in ARGUMENTS for w in words)


def read_isg_csv(name: str, text: str) -> list[Block]:
    """Blocks of a file of the format ISG_CSV. Raises `InputError` that names file and line."""
    blocks: list[Block] = []
    header: tuple[int, list[str]] | None = None
    rows: list[list[float]] = []
    for i, line in _lines(text):
        if line.startswith("#"):
            blocks += _block(name, header, rows)
            header, rows = None, []
        elif header is None:
            header = i, line.split()
            _check_header(f"{name}, line {i}", header[1])
        else:
            rows.append(_row(f"{name}, line {i}", line.split(), header[1]))
    blocks += _block(name, header, rows)
    if not blocks:
        raise InputError(f"{name}: no error parameters; expected a header such as 'X EXX EYX' and rows of numbers")
    return blocks


def _check_header(where: str, columns: list[str]) -> None:
    for c in columns:
        if c not in ARGUMENTS and not _FUNCTION.fullmatch(c) and not _CONSTANT.fullmatch(c):
            raise InputError(
                f"{where}: '{c[:40]}' is no argument and no parameter; expected X … C, names such as EXX, C0Y, "
                f"PXC, and blanks "
                "between them"
            )
    if len(set(columns)) < len(columns):
        raise InputError(f"{where}: a column stands twice; expected each once")
    if all(c in ARGUMENTS for c in columns):
        raise InputError(f"{where}: arguments alone; expected a parameter, such as EXX")


def _row(where: str, words: list[str], columns: list[str]) -> list[float]:
    if len(words) != len(columns):
        raise InputError(f"{where}: {len(words)} numbers; expected {len(columns)}: {' '.join(columns)}")
    return [_number(w, where, c) for w, c in zip(words, columns, strict=True)]


def _block(name: str, header: tuple[int, list[str]] | None, rows: list[list[float]]) -> list[Block]:
    if header is None:
        return []
    i, columns = header
    where = f"{name}, line {i}"
    if not rows:
        raise InputError(f"{where}: a header without rows; expected numbers for {' '.join(columns)}")
    table = np.array(rows)
    arguments = [k for k, c in enumerate(columns) if c in ARGUMENTS]
    others = [k for k, c in enumerate(columns) if c not in ARGUMENTS]
    if not arguments and len(rows) > 1:
        raise InputError(f"{where}: {len(rows)} rows without an argument; expected one row of constants")
    letters, names = (tuple(columns[k] for k in which) for which in (arguments, others))
    return [Block(letters, names, table[:, arguments], table[:, others], where)]


_SECTION = re.compile(r"\[\s*(\w+)\s*\]")
_VALUE = re.compile(r"VALUE\s*=\s*(\S+)", re.IGNORECASE)
_POINTS = re.compile(r"Gridpoints\s*=\s*\{", re.IGNORECASE)


def read_etalon(name: str, text: str) -> list[Block]:
    """Blocks of an exchange text of ETALON, one for each section. Raises `InputError` that names file and line."""
    found: list[Block] = []
    lines, seen = _lines(text), set()
    for i, line in lines:
        match, where = _SECTION.fullmatch(line), f"{name}, line {i}"
        if match is None:
            raise InputError(f"{where}: '{line[:60]}'; expected the name of a parameter in brackets, such as [EXX]")
        parameter = match[1]
        if parameter in seen:
            raise InputError(f"{where}: [{parameter}] stands twice; expected it once")
        seen.add(parameter)
        found.append(_section(where, parameter, lines))
    if not found:
        raise InputError(
            f"{name}: no error parameters; expected sections such as [EXX] with Gridpoints, or [C0Y] with VALUE"
        )
    return found


def _section(where: str, parameter: str, lines: Iterator[tuple[int, str]]) -> Block:
    """What stands below a name in brackets."""
    _, line = next(lines, (0, ""))
    value = _VALUE.fullmatch(line)
    if value is not None and _CONSTANT.fullmatch(parameter):
        constant = _number(value[1], where, parameter)
        return Block((), (parameter,), np.zeros((1, 0)), np.array([[constant]]), where)
    if not _POINTS.fullmatch(line) or not _FUNCTION.fullmatch(parameter):
        raise InputError(
            f"{where}: [{parameter}] is followed by '{line[:60]}'; expected 'VALUE = …' for a constant such as C0Y, "
            "'Gridpoints = {' for a function such as EXX"
        )
    rows = list(_points(where, parameter, lines))
    if not rows:
        raise InputError(f"{where}: [{parameter}] has no points; expected lines of argument and value")
    table = np.array(rows)
    return Block((parameter[2],), (parameter,), table[:, :1], table[:, 1:], where)


def _points(where: str, parameter: str, lines: Iterator[tuple[int, str]]) -> Iterator[list[float]]:
    """Lines of argument and value up to the closing brace."""
    for i, line in lines:
        if line == "}":
            return
        place = f"{where.rsplit(',', 1)[0]}, line {i}"
        yield _row(place, line.split(), [parameter[2], parameter])
    raise InputError(f"{where}: [{parameter}] is not closed; expected a line with }}")
