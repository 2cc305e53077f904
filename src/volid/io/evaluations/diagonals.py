"""Diagonals as a table: `diagonal,target,direction,run,deviation`, one row per reading, lengths in mm.

`diagonal`: PPP, NPP, PNP, PPN, or XY_PP, XY_NP …; `target`: distance from its start; `direction`: +1 on the way on, -1 on the way
back; `run`: any name, where a target was read several times; `deviation`, or instead `displacement`, from the start. A line
"# u: 0.0005" states the standard uncertainty of a reading.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from volid.exceptions import InputError
from volid.io.basics.csv_table import CsvTable, read_csv
from volid.io.evaluations.sizes import ask_size
from volid.io.record import read_header
from volid.standards.diagonals.evaluation import contributions_from
from volid.standards.diagonals.lines import BODY_NAMES, FACE_NAMES, Diagonal
from volid.standards.positioning.runs import Approaches, arranged, run_numbers

COLUMNS = ("diagonal", "target", "direction")
READINGS = ("deviation", "displacement")


def is_diagonals(path: str | Path) -> bool:
    """Whether a CSV file is a table of diagonals."""
    return COLUMNS[0] in read_csv(path).renamed({}, (), str(path))


def read_diagonals(path: str | Path) -> list[Diagonal]:
    """The diagonals of a table.

    Raises `InputError` naming the row or column that is missing or wrong.

    >>> path = getfixture("tmp_path") / "d.csv"
    >>> rows = ["diagonal,target,direction,deviation", "PPP,0,1,0", "PPP,500,1,0.004", "PPP,500,-1,0.003", "PPP,0,-1,0.001"]
    >>> _ = path.write_text(chr(10).join(rows))
    >>> [d.name for d in read_diagonals(path)]
    ['PPP']
    """
    table = read_csv(path).renamed({}, (), str(path))
    table.only((*COLUMNS, "run", *READINGS))
    table.require(COLUMNS, "every reading needs it")
    given = [name for name in READINGS if name in table]
    if len(given) != 1:
        raise InputError(
            f"{path}: {' and '.join(given) or 'neither deviation nor displacement'} given; expected one of them"
        )
    names = table.labels("diagonal", "expected the name of a diagonal")
    for i, name in enumerate(names.tolist()):
        if name not in BODY_NAMES + FACE_NAMES:
            raise InputError(f"{table.where(i)}: diagonal is '{name}'; expected {', '.join(BODY_NAMES + FACE_NAMES)}")
    u = _u(path)
    return [
        _with_u(_one(table, str(name), np.flatnonzero(names == name), given[0]), u)
        for name in dict.fromkeys(names.tolist())
    ]


def _one(table: CsvTable, name: str, rows: np.ndarray, reading: str) -> Diagonal:
    target, direction, values = (
        table.numbers(column, unit, "every reading needs it")[rows]
        for column, unit in (("target", "mm"), ("direction", "steps of one"), (reading, "mm"))
    )
    values = values - target if reading == READINGS[1] else values
    ask_size(table.source, reading, values)
    run = (
        table.labels("run", "expected a name")[rows].tolist()
        if "run" in table
        else run_numbers(target, direction, "mm")
    )
    found = Approaches(target, direction, run, values, [table.where(int(i)) for i in rows])
    return Diagonal(name, name in BODY_NAMES, arranged(name, found, source=f"{table.source}, {name}"))


def _u(path: str | Path) -> float:
    text = read_header(path).get("u")
    if text is None:
        return 0.0
    try:
        value = float(text.split()[0])
    except (ValueError, IndexError):
        value = np.nan
    if not 0.0 < value < np.inf:
        raise InputError(f"{path}: the line u is '{text}'; expected a positive number in mm, such as '# u: 0.0005'")
    return value


def _with_u(diagonal: Diagonal, u: float) -> Diagonal:
    return diagonal._replace(contributions=(contributions_from(u, diagonal),)) if u else diagonal
