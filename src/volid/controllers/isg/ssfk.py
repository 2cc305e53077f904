"""Leadscrew error compensation of the ISG kernel (TwinCAT CNC), entries kw.ssfk of the compensation list of an axis.

The list holds, at positions of the axis, the position error actual - setpoint for motion in + and in -, in 0.1 µm (linear axes)
or 0.0001° (rotary ones): where 19866.7 µm were commanded and 19856.5 µm measured, the value is -102. Positions are listed one by
one, or, where they are equally spaced, by start and interval.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from volid.compensation.package import Compensation
from volid.compensation.tables.axis_table import AxisTable
from volid.compensation.types import TABLES
from volid.controllers.base import (
    COLUMNS,
    DOCUMENTED,
    ERROR,
    FREE,
    INFERRED,
    NOT_KNOWN,
    OPEN,
    Commissioning,
    ControlFile,
    Controller,
    Declaration,
    Fact,
    Job,
    Option,
    Written,
    refuse_grids,
    refuse_points,
    text_of,
)
from volid.controllers.isg.kernel_lists import (
    STEPS,
    Entry,
    axis_numbers,
    entries,
    header,
    lines,
    needed,
    numbered_axis,
    one_of,
    refuse_increments,
    unit_of,
)
from volid.exceptions import InputError
from volid.model.machine import Axis, Machine

_DOCS = "Beckhoff TF5200 axis compensation (infosys.beckhoff.com, tf5200_axis_compensation)"
_PARAMETERS = "tf5200_axis_compensation_parameters"
MOST = 1499
ALL, REVERSAL = "all", "reversal"

DECLARATION = Declaration(
    name="isg-ssfk",
    title="ISG kernel and TwinCAT CNC, leadscrew error compensation (kw.ssfk)",
    carries={"L-POS": TABLES, "R-POS": TABLES},
    nearest="kw.ssfk corrects an axis by its own position alone; isg-crosscomp carries straightness and squareness, "
    "isg-volcomp all that "
    "moves the functional point",
    sign=ERROR,
    units="0.1 µm, 0.0001° for rotary axes, positions and values",
    reversal=COLUMNS,
    outside=NOT_KNOWN,
    spacing=FREE,
    quantum=(1.0 / STEPS, float(np.deg2rad(1.0 / STEPS))),
    most_points=MOST,
    zero="make the value 0 at the reference position: the compensation acts once the axis is referenced",
    switching="lr_param.ssfk of the axis, and X [COMP OFF LEAD] in the NC program, for each axis",
    options=(
        Option(
            "axes",
            "logical axis numbers of the control, such as 'X=1 Y=2 Z=3'",
            "X=1 Y=2 Z=3 A=4 B=5 C=6",
            axis_numbers,
        ),
        Option(
            "values",
            "all: positioning errors of both directions; reversal: half the reversal alone, beside "
            "isg-volcomp, which corrects the mean",
            ALL,
            one_of(ALL, REVERSAL),
        ),
    ),
    commissioning=Commissioning(
        backup=("Copy the compensation list and the parameter list of each axis.",),
        load=(
            "Put the lines of the file into the compensation list of the axis, instead of its lines kw.ssfk; "
            "compare kopf.achs_nr with the "
            "number of the axis.",
            "Take backlash out of the other places where it is compensated: the two columns contain it.",
        ),
        activate=(
            "Set lr_param.ssfk to 1 in the parameter list of the axis, and lr_param.n_backlash_cyc to the "
            "cycles over which a "
            "reversal is spread.",
            "Start the control again, or read the lists again, and reference the axis.",
        ),
        remove=("Set lr_param.ssfk to 0, or put the copied lists back.",),
    ),
    facts=(
        Fact(
            "values are actual - setpoint: 19866.7 µm commanded, 19856.5 µm reached in + and 19874.7 µm in - "
            "are -102 and 80",
            DOCUMENTED,
            f"{_PARAMETERS}, 113439115",
        ),
        Fact(
            "values are absolute position errors, in 0.1 µm or 0.0001° with unit 1",
            DOCUMENTED,
            f"{_PARAMETERS}, 113432971, 113434507",
        ),
        Fact(
            "the setpoint is changed, and taken off the feedback again, so that the display does not show it",
            DOCUMENTED,
            f"{_DOCS}, 308683659",
        ),
        Fact(
            "linear between the positions; a change of direction is spread over lr_param.n_backlash_cyc cycles (sin²)",
            DOCUMENTED,
            f"{_DOCS}, 308683659, 308693899",
        ),
        Fact(
            "kw_nr_max must be smaller than max_points, 1500 by default: at most 1499 positions",
            DOCUMENTED,
            f"{_PARAMETERS}, 654582667",
        ),
        Fact("interval 0: positions are listed; else equal steps from kw_startpos", DOCUMENTED, f"{_DOCS}, 308687883"),
        Fact("with bilateral 0 the column pos holds for both directions", INFERRED, f"{_DOCS}, 308683659"),
        Fact(
            "modulo 1: at the modulo transition of the axis the table begins again; 0 where it is not stated; the first and the "
            "last entry are the same place",
            DOCUMENTED,
            f"{_PARAMETERS}, 113428363; tccncaxiscompensation, 15274022795 (P-COMP-00022)",
        ),
        Fact(
            "so the modulo range of the axis begins where its list begins, such as -180 … 180",
            INFERRED,
            f"{_PARAMETERS}, P-COMP-00022",
        ),
        Fact("what happens beyond the first and last position", OPEN),
    ),
)


class IsgSsfk(Controller):
    """One list per axis."""

    declaration = DECLARATION

    def write(self, job: Job) -> Written:
        """The lines kw.ssfk of each axis, one file per axis."""
        refuse_grids(DECLARATION, job.compensation, "isg-volcomp")
        tables = tuple(_wanted(t, job.options["values"]) for t in job.axis_tables())
        files, rounding = [], 0.0
        for table in tables:
            axis = job.machine.axis(table.output)
            if not table.is_pitch:
                raise InputError(
                    f"isg-ssfk: {table.source or 'a table'} moves {table.output} by the position of another "
                    f"axis; isg-crosscomp carries it"
                )
            refuse_points(DECLARATION, f"the table of {table.output}", len(table.positions))
            text, lost = _list(axis, table, job.options["axes"])
            files.append(ControlFile(f"{table.output.lower()}_ssfk.lis", text, f"kw.ssfk of {table.output}"))
            rounding = max(rounding, lost)
        if not files:
            raise InputError("isg-ssfk: nothing to write; expected tables of positioning")
        parameters = tuple(
            (f"lr_param.ssfk of {t.output}", "1", "leadscrew error compensation on (P-AXIS-00175)") for t in tables
        )
        return Written(tuple(files), parameters, (), rounding)

    def read(self, files: Mapping[str, str | bytes], machine: Machine, options: Mapping[str, Any]) -> Compensation:
        """Tables of the axes; the header of a list says which axis."""
        found = [_table(name, entries(name, text_of(name, c)), machine, options["axes"]) for name, c in files.items()]
        letters = [t.output for t in found]
        for letter in letters:
            if letters.count(letter) > 1:
                raise InputError(f"{', '.join(files)}: axis {letter} has several lists; expected one")
        return Compensation((), (), (), tuple(found))

    def recognises(self, name: str, content: str | bytes) -> bool:
        """A line that begins with kw.ssfk."""
        return any(line.lstrip().lower().startswith("kw.ssfk.") for line in text_of(name, content)[:20000].splitlines())


def _wanted(table: AxisTable, values: str) -> AxisTable:
    """The table, or half its reversal alone: what is left where something else corrects the mean of both directions."""
    if values == ALL:
        return table
    half = 0.5 * (table.forward - table.reverse)
    return replace(table, forward=half, reverse=-half)


def _list(axis: Axis, table: AxisTable, numbers: Mapping[str, int]) -> tuple[str, float]:
    """The text of an axis, and the largest change of a value by rounding [mm or rad]."""
    unit = unit_of(axis)
    at = np.rint(table.positions * STEPS).astype(int)
    if np.any(np.diff(at) <= 0):
        raise InputError(
            f"isg-ssfk: positions of {axis.letter} closer than 1/{STEPS:g} {axis.unit}; take a larger `step`"
        )
    exact = [table.of_argument(at / STEPS, np.full(len(at), way)) / unit for way in (1.0, -1.0)]
    up, down = (np.rint(v).astype(int) for v in exact)
    lost = float(max(np.abs(r - v).max() for r, v in zip((up, down), exact, strict=True))) * unit
    steps, both = np.unique(np.diff(at)), bool(np.any(up != down))
    equal = len(steps) == 1
    head = [
        *header(axis, numbers),
        ("kw.ssfk.interval", steps[0] if equal else 0),
        ("kw.ssfk.kw_startpos", at[0]),
        ("kw.ssfk.kw_nr_max", len(at)),
        ("kw.ssfk.unit", 1),
        ("kw.ssfk.bilateral", int(both)),
        ("kw.ssfk.modulo", int(bool(table.period))),
    ]
    columns = [("setpoint", at)] * (not equal) + [("pos", up)] + [("neg", down)] * both
    rows = [(f"kw.ssfk.table[{i}].{name}", values[i]) for i in range(len(at)) for name, values in columns]
    return lines([*head, *rows]), lost


def _table(name: str, found: dict[str, Entry], machine: Machine, numbers: Mapping[str, int]) -> AxisTable:
    """The table of one list. Raises `InputError` that names file and line."""
    axis = numbered_axis(name, found, machine, numbers)
    refuse_increments(name, found, "kw.ssfk.unit")
    count = needed(name, found, "kw.ssfk.kw_nr_max").whole(1, 100_000)
    interval = needed(name, found, "kw.ssfk.interval").whole(0)
    if interval:
        at = needed(name, found, "kw.ssfk.kw_startpos").number + interval * np.arange(count)
    else:
        at = _column(name, found, "setpoint", count)
    if np.any(np.diff(at) <= 0):
        i = int(np.argmax(np.diff(at) <= 0)) + 1
        raise InputError(f"{name}: kw.ssfk.table[{i}].setpoint does not rise; expected rising positions")
    unit = unit_of(axis)
    up = _column(name, found, "pos", count) * unit
    both = found.get("kw.ssfk.bilateral", Entry("0", "")).value.upper() not in ("0", "FALSE")
    down = _column(name, found, "neg", count) * unit if both else up.copy()
    _refuse_more(name, found, count)
    positions = at / STEPS
    period = _period(found, axis, positions)
    others = any(k.startswith("kw.crosscomp") for k in found)
    notes = (f"{name} has lines kw.crosscomp too, which isg-crosscomp reads.",) if others else ()
    return AxisTable(axis.letter, axis.letter, positions, up, down, period=period, notes=notes)


def _period(found: dict[str, Entry], axis: Axis, positions: np.ndarray) -> float:
    """360 for a list that repeats with the axis, else 0 [°].

    Raises `InputError` where it repeats, but not after a turn: what the control does in the gap is not stated.
    """
    modulo = found.get("kw.ssfk.modulo", Entry("0", ""))
    if modulo.value.upper() in ("0", "FALSE"):
        return 0.0
    if axis.is_linear or abs(positions[-1] - positions[0] - 360.0) > 1.0 / STEPS:
        raise InputError(
            f"{modulo.where} is {modulo.value}, and the positions of {axis.letter} go from {positions[0]:g} to "
            f"{positions[-1]:g}; expected a full turn of a rotary axis, with its first position again at the end"
        )
    return 360.0


def _column(name: str, found: dict[str, Entry], column: str, count: int) -> np.ndarray:
    """One column of the table. Raises `InputError` for a value that is missing."""
    return np.array([needed(name, found, f"kw.ssfk.table[{i}].{column}").number for i in range(count)])


def _refuse_more(name: str, found: dict[str, Entry], count: int) -> None:
    """Raises `InputError` where the list has more rows than it says."""
    if any(f"kw.ssfk.table[{count}].{column}" in found for column in ("pos", "neg", "setpoint")):
        raise InputError(
            f"{name}: kw.ssfk.kw_nr_max is {count}, but table[{count}] stands in the list; expected as many "
            f"rows as it says"
        )


ISG_SSFK = IsgSsfk()
