"""Circular tests as tables (CSV), and as campaigns or evaluated files of other programs, whatever a file holds.

A table has the columns `angle` (degrees, from the plane's first axis towards its second) and `radius` or `deviation` (mm);
optional are `sense` (+, anticlockwise, ccw, 1; or -, clockwise, cw, -1; else as the angle grows or falls), `run`, `plane`,
`u` (mm). Rows stand in the order in which they were read. What holds for all rows may stand in lines "# plane: XY", "#
radius: 150", "# feed: 1000" (mm/min), "# u: 0.0005", "# length_u: 0.0005" (mm, of the bar's length; "unknown" where nothing
is known of it).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf, isfinite
from pathlib import Path

import numpy as np

from volid.exceptions import InputError
from volid.io.basics.csv_table import CsvTable, read_csv
from volid.io.campaign.files import is_campaign, load_campaign
from volid.io.evaluations.sizes import ask_size
from volid.io.instruments.base import EvaluatedFormat
from volid.io.instruments.base import Evaluation as Vendors
from volid.io.instruments.recognition import known_as, open_foreign
from volid.io.record import read_header
from volid.standards.circular.readings import CircularReadings, circular_readings
from volid.standards.circular.sets import circular_tests
from volid.standards.results import Evaluation, Quantity, Table

COLUMNS = ("angle", "radius", "deviation", "sense", "run", "plane", "u")
UNKNOWN = "unknown"
_SENSES = {
    1: ("+", "+1", "1", "1.0", "ccw", "anticlockwise", "counterclockwise"),
    -1: ("-", "-1", "-1.0", "cw", "clockwise"),
}
VENDORS = "the evaluation of the program that wrote the file, shown as it stands there: no readings are in it"


@dataclass(frozen=True)
class Stated:
    """What holds for all rows of a table, before what its own lines say; None: not stated.

    `plane`: two axes; `radius`: nominal [mm]; `feed` [mm/min]; `u` of a reading [mm]; `length_u`: of the bar's length [mm],
    infinite for unknown.
    """

    plane: str | None = None
    radius: float | None = None
    feed: float | None = None
    u: float | None = None
    length_u: float | None = None


def read_circular(
    path: str | Path, stated: Stated | None = None, sets: Sequence[str] | None = None, allow_outside: bool = False
) -> list[CircularReadings]:
    """The circular tests in a campaign or a table.

    Args:
        path: A campaign (manifest or HDF5), or a table (CSV).
        stated: What a table does not say itself.
        sets: Names of a campaign's sets; None: all that are circular tests.
        allow_outside: The manifest may name files outside its own folder.

    Raises:
        InputError: naming file and row, column or key, for what is missing, unknown or no number.

    >>> path = getfixture("tmp_path") / "circle.csv"
    >>> rows = [f"{a},{150.001}" for a in range(0, 361, 5)]
    >>> _ = path.write_text("\\n".join(["# plane: XY", "# radius: 150", "angle,radius", *rows, ""]))
    >>> read_circular(path)[0].deviation[:2].round(6).tolist()
    [0.001, 0.001]
    """
    if is_campaign(path):
        _only_of_tables(path, stated or Stated())
        return circular_tests(load_campaign(path, allow_outside=allow_outside), sets)
    if sets:
        raise InputError(f"{path}: a table has no sets; leave `set` out")
    return _read_table(Path(path), stated or Stated())


def _only_of_tables(path: str | Path, stated: Stated) -> None:
    """Raises `InputError` for what a campaign says itself."""
    for key in ("plane", "radius", "u", "length_u"):
        if getattr(stated, key) is not None:
            raise InputError(f"{path}: a campaign says itself what `{key}` is; leave it out, or change its set")


def vendors_evaluations(path: str | Path) -> list[Evaluation]:
    """What a vendor's program has evaluated of a ball-bar test, plane by plane; none for any other file.

    Values stand in the units of the file, and nothing is evaluated again.
    """
    if is_campaign(path):
        return []
    known = known_as(Path(path))
    if not isinstance(known, EvaluatedFormat):
        return []
    found = known.evaluation(open_foreign(Path(path)))
    planes = dict.fromkeys(str(row[1]) for row in found.rows)
    return [_vendors(found, plane, str(path)) for plane in planes]


def _vendors(found: Vendors, plane: str, source: str) -> Evaluation:
    rows = [row for row in found.rows if str(row[1]) == plane]
    quantities = [
        Quantity(str(name), value, unit, text="as the file has it")
        for name, _, value, unit, _ in rows
        if not isinstance(value, str)
    ]
    record = [f"{key}: {value}" for key, value in found.header.items()]
    return Evaluation(
        "as evaluated elsewhere",
        plane,
        tuple(quantities),
        (VENDORS, *record),
        table=Table(found.columns, tuple(rows)),
        source=source,
    )


def _read_table(path: Path, stated: Stated) -> list[CircularReadings]:
    table = read_csv(path).renamed({}, (), str(path))
    table.only(COLUMNS)
    table.require(("angle",), "every reading has an angle")
    known = _stated(path, stated)
    planes = np.array([known.plane or ""] * len(table)) if "plane" not in table else table.labels("plane", "a plane")
    found = []
    for plane in dict.fromkeys(planes.tolist()):
        if not plane:
            raise InputError(
                f"{path}: the plane is missing; add a line '# plane: XY', a column plane, or state `plane`"
            )
        found.append(_plane_of(table, np.flatnonzero(planes == plane), plane, known))
    return found


def _stated(path: Path, stated: Stated) -> Stated:
    """What was stated, or else stands in lines "# key: value" of the file."""
    header = read_header(path)
    numbers = {key: _number(path, key, header) for key in ("radius", "feed", "u", "length_u") if key in header}
    found = Stated(plane=header.get("plane", "").strip() or None, **numbers)
    given = {key: value for key, value in vars(stated).items() if value is not None}
    for key in ("radius", "feed", "u", "length_u"):
        value = given.get(key)
        if value is not None and not (value > 0.0 or (key == "length_u" and value >= 0.0)):
            raise InputError(f"`{key}={value:g}`: expected a positive number")
    return replace(found, **given)


def _number(path: Path, key: str, header: Mapping[str, str]) -> float:
    text = header[key].strip()
    if key == "length_u" and text == UNKNOWN:
        return inf
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not (isfinite(value) and value >= 0.0):
        raise InputError(f"{path}: {key} is '{text}'; expected a positive number")
    return value


def _plane_of(table: CsvTable, rows: np.ndarray, plane: str, known: Stated) -> CircularReadings:
    angle = table.numbers("angle", "degrees", "every reading has an angle")[rows]
    radius, deviation = _deviations(table, known)
    run = table.labels("run", "the run of a reading")[rows] if "run" in table else None
    sense = _senses(table)[rows] if "sense" in table else None
    test = circular_readings(
        plane, radius, angle, deviation[rows], sense, None if run is None else list(run), table.source
    )
    u = table.numbers("u", "mm", "standard uncertainty of a reading")[rows] if "u" in table else None
    if u is None and known.u is not None:
        u = np.full(len(test), known.u)
    if u is not None and not (u > 0.0).all():
        raise InputError(f"{table.where(int(rows[np.argmax(~(u > 0.0))]))}: u is not above 0; expected it in mm")
    return replace(test, u=u, length_u=known.length_u or 0.0, feed=known.feed)


def _deviations(table: CsvTable, known: Stated) -> tuple[float, np.ndarray]:
    """Nominal radius, and deviations from it of all rows, (m,)."""
    if ("radius" in table) == ("deviation" in table):
        raise InputError(f"{table.source}: expected one of the columns radius and deviation, in mm")
    if known.radius is None:
        raise InputError(
            f"{table.source}: the nominal radius is missing; add a line '# radius: 150', or state `radius`, in mm"
        )
    column = "deviation" if "deviation" in table else "radius"
    nominal = known.radius if column == "radius" else 0.0
    deviation = table.numbers(column, "mm", f"every reading has a {column}") - nominal
    ask_size(table.source, column, deviation)
    return known.radius, deviation


def _senses(table: CsvTable) -> np.ndarray:
    """+1 or -1 of every row, (m,)."""
    found = np.zeros(len(table), dtype=int)
    words = [text.strip().lower() for text in table.labels("sense", "the sense of a reading").tolist()]
    for sense, names in _SENSES.items():
        found[[word in names for word in words]] = sense
    if not found.all():
        i = int(np.argmin(np.abs(found)))
        raise InputError(f"{table.where(i)}: sense is '{words[i]}'; expected + or anticlockwise, - or clockwise")
    return found
