"""The nine numbers of matrixkins: as an option, as parameters, as setp lines of a HAL file, and read from these."""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np

from volid.controllers.linuxcnc.joints.comp_file import plain
from volid.exceptions import InputError

LETTERS = "XYZ"
DIGITS = 12  # decimals: 1e-9 mm over a metre
SMALL = 0.1  # a machine whose matrix is further from the identity is no machine of this kind
_SETP = re.compile(r"\s*setp\s+matrixkins\.C_([xyz])([xyz])\s*=?\s*(\S+)")


def nine(text: str) -> np.ndarray:
    """Nine numbers, row after row, shape (3, 3). Raises `ValueError` for anything else."""
    values = [plain(v) for v in text.replace(",", " ").split()]
    if len(values) != 9 or None in values:
        raise ValueError("expected nine numbers, xx xy xz yx yy yz zx zy zz")
    found = np.array(values, dtype=float).reshape(3, 3)
    if np.abs(found - np.eye(3)).max() > SMALL:
        raise ValueError(f"expected a matrix that differs from the identity by at most {SMALL}")
    return found


def parameters_of(matrix: np.ndarray) -> tuple[tuple[str, str, str], ...]:
    """Name, value and meaning of each number."""
    pairs = [(a, b) for a in LETTERS for b in LETTERS]
    return tuple(
        (f"matrixkins.C_{a.lower()}{b.lower()}", f"{round(v, DIGITS) + 0.0:.{DIGITS}f}", f"{a} joint over {b} axis")
        for (a, b), v in zip(pairs, matrix.ravel(), strict=True)
    )


def lines_of(matrix: np.ndarray) -> str:
    """The setp lines."""
    return "".join(f"setp {name} {value}\n" for name, value, _ in parameters_of(matrix))


def has_lines(text: str) -> bool:
    """Whether a text sets one of the numbers."""
    return any(_SETP.match(line) for line in text.splitlines())


def matrix_of(texts: Mapping[str, str]) -> np.ndarray:
    """The matrix after all setp lines; those that are not set are of the identity. Raises `InputError` where there is none."""
    found, count = np.eye(3), 0
    for name, text in texts.items():
        for number, line in enumerate(text.splitlines(), 1):
            match = _SETP.match(line)
            if match:
                found["xyz".index(match[1]), "xyz".index(match[2])] = _value(f"{name}, line {number}", match[3])
                count += 1
    names = ", ".join(texts) or "no file"
    if not count:
        raise InputError(f"{names}: no line 'setp matrixkins.C_xx …'; expected the nine numbers")
    if np.abs(found - np.eye(3)).max() > SMALL:
        raise InputError(f"{names}: the matrix differs from the identity by more than {SMALL}; expected small errors")
    return found


def _value(where: str, text: str) -> float:
    value = plain(text)
    if value is None:
        raise InputError(f"{where}: '{text}'; expected a number with a decimal point")
    return value
