"""SINUMERIK: leadscrew and measuring system error compensation, system variables $AA_ENC_COMP.

One table for each measuring system of an axis, over the position of the axis itself, at equal steps. The value corrects the
actual value: a positive one makes the axis move in the negative direction, so that the table holds the error, actual - nominal.
It knows no direction; the reversal goes as one number into MD32450 $MA_BACKLASH:

    error in the control's sense:  e(x, ±) = table(x) -+ backlash / 2,   backlash = -(mean of E(+) - E(-)).

Not modelled: whether the control adds the backlash half to both directions or wholly to one, which shifts all positions by half
of it.
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
    DOCUMENTED,
    EQUAL,
    ERROR,
    HELD,
    INFERRED,
    ONE_VALUE,
    OPEN,
    Commissioning,
    ControlFile,
    Controller,
    Declaration,
    Fact,
    Job,
    Option,
    Written,
)
from volid.controllers.options import places, whole
from volid.controllers.sinumerik.ini_files import (
    AXES,
    MANUAL,
    Parts,
    Setting,
    ask_plain,
    axis_of,
    covers,
    name_of,
    number,
    settings,
)
from volid.controllers.tables.equal_steps import lattice_of, loss, on
from volid.exceptions import InputError
from volid.model.machine import Axis, Machine

SMALLEST_STEP_AT_ZERO = 1e-7  # mm or rad: a value at the reference point that is worth a sentence
_808D = "Siemens, SINUMERIK 808D ADVANCED Function Manual (01/2017) p. 106"


DECLARATION = Declaration(
    name="sinumerik-enc-comp",
    title="SINUMERIK, leadscrew and measuring system errors ($AA_ENC_COMP)",
    carries={"L-POS": TABLES, "R-POS": TABLES},
    nearest="$AA_ENC_COMP corrects an axis by its own position alone; sinumerik-cec carries cross, direction-dependent and "
    "lever-arm tables",
    sign=ERROR,
    units="mm, degrees for rotary axes",
    reversal=ONE_VALUE,
    outside=HELD,
    spacing=EQUAL,
    limits="as many as MD38000 allows (option max_points), 200 on an 808D; one table for each measuring system",
    zero="make the value 0 at the reference point (`zero`): the axis moves by what stands there when the compensation begins",
    switching="MD32700 $MA_ENC_COMP_ENABLE of each axis and measuring system, 1 on and 0 off; one file per axis",
    options=(
        AXES,
        Option(
            "encoder",
            "index of the measuring system: 0 the first, 1 the second",
            0,
            whole(0, 1, "the first or the second"),
        ),
        Option(
            "max_points",
            "MD38000 $MA_MM_ENC_COMP_MAX_POINTS, where it is set already; 200 on an 808D",
            None,
            whole(2, 5000, "a number of points"),
        ),
        Option(
            "reference",
            "machine positions of the reference points, such as X=0,Y=600; to say what stands there",
            {},
            places,
        ),
    ),
    commissioning=Commissioning(
        backup=("Back up the archive of the NC data, the compensation tables ($AA_ENC_COMP) and MD32450 with it.",),
        load=(
            "Set MD38000 of each axis to at least the number of points; changing it formats the static memory at the next "
            "start, so back up first and read the archive in again.",
            "Set MD32700 $MA_ENC_COMP_ENABLE of the axis to 0; a table can be loaded only then.",
            "Read the file in while the control works in millimetres (MD10240).",
            "Set MD32450 $MA_BACKLASH as the file states it, instead of what it was when the machine was measured.",
        ),
        activate=("Set MD32700 to 1, and reference the axis: backlash and table act from then on.",),
        remove=(
            "Set MD32700 to 0, read the former table from the backup, and set MD32450 and MD32700 to their former values.",
            "Where MD38000 was raised it can stay; to lower it again, format and read in the archive as for loading.",
        ),
        watch=("The service display of the axis shows the sum of leadscrew error and backlash compensation.",),
    ),
    facts=(
        Fact(
            "the value corrects the actual value of the axis, in the interpolation cycle; a positive value makes the axis move "
            "in the negative direction",
            DOCUMENTED,
            f"{MANUAL} p. 238; {_808D}",
        ),
        Fact("so the table holds the error, actual - nominal", INFERRED, "from the direction of motion, p. 238"),
        Fact(
            "equal steps, linear between them, end values held outside; modulo for a turn",
            DOCUMENTED,
            f"{MANUAL} pp. 237-242",
        ),
        Fact(
            "a table is loaded only while MD32700 is 0, and acts after referencing",
            DOCUMENTED,
            f"{MANUAL} p. 237; {_808D}",
        ),
        Fact("at most MD38000 points; 200 on an 808D", DOCUMENTED, f"{MANUAL} p. 242; {_808D}"),
        Fact("the value at the reference point should be 0", DOCUMENTED, f"{MANUAL} p. 238; {_808D}"),
        Fact("size and change of the values are neither limited nor monitored", DOCUMENTED, f"{MANUAL} p. 238"),
        Fact(
            "MD32450 is positive where the encoder leads the machine part; the part then lags behind in both directions, "
            "E(+) - E(-) is negative",
            DOCUMENTED,
            "Siemens, SINUMERIK 808D ADVANCED Parameter Manual, 6FC5397-8EP40-0BA0 (08/2013) p. 228; 840C, 6FC5197-AA50 p. 6-41",
        ),
        Fact("backlash is added half to each direction, or wholly to one: not stated by public sources", OPEN),
        Fact("machine axes are called X1, Y1, Z1 unless stated", INFERRED, f"examples of {MANUAL} pp. 242-252"),
    ),
)


class SinumerikEncComp(Controller):
    """Files of $AA_ENC_COMP, one per axis."""

    declaration = DECLARATION

    def declared_for(self, machine: Machine, options: Mapping[str, Any]) -> Declaration:
        """The declaration with the points that MD38000 allows, where it is stated."""
        return replace(DECLARATION, most_points=options["max_points"])

    def write(self, job: Job) -> Written:
        """One file per axis, the backlash in a comment, and the machine data. Raises `InputError` for what it cannot hold."""
        files, parameters, notes = [], [], []
        for table in job.axis_tables():
            if not table.is_pitch:
                what = f"the table of {table.output} over {table.argument} ({table.source})"
                raise InputError(f"{DECLARATION.name}: {what}: {DECLARATION.nearest}")
            one = _Axis(table, job)
            files.append(
                ControlFile(f"{table.output.lower()}_eec.ini", one.text(), f"{table.source} of {table.output}")
            )
            parameters += one.parameters()
            notes += one.notes()
        return Written(tuple(files), tuple(parameters), tuple(notes), 0.5e-9)

    def read(self, files: Mapping[str, str | bytes], machine: Machine, options: Mapping[str, Any]) -> Compensation:
        """Tables of the axes, with the backlash that the file states. Raises `InputError` that names file and line."""
        found: dict[str, Parts] = {}
        backlash: dict[str, float] = {}
        others: set[int] = set()
        for s in settings(files):
            ask_plain(s)
            if s.name == "MA_BACKLASH" and len(s.index) != 2:
                raise InputError(f"{s.where}: $MA_BACKLASH[{','.join(s.index)}]; expected $MA_BACKLASH[encoder,axis]")
            if s.name == "MA_BACKLASH" and s.whole(0) == options["encoder"]:
                backlash[axis_of(s.index[1], s.where, options["axes"], machine).letter] = s.number
            elif s.name.startswith("AA_ENC_COMP"):
                if s.whole(0) == options["encoder"]:
                    _take(s, found, machine, options["axes"])
                others.add(s.whole(0))
        if not found:
            raise InputError(
                f"{', '.join(files)}: no $AA_ENC_COMP of encoder {options['encoder']}; the files have encoders "
                f"{', '.join(map(str, sorted(others))) or 'none'}. State the option encoder, or the control that wrote them"
            )
        tables = [_read(machine.axis(a), parts, backlash.get(a, 0.0)) for a, parts in found.items()]
        return Compensation((), (), (), tuple(tables))

    def recognises(self, name: str, content: str | bytes) -> bool:
        """Whether $AA_ENC_COMP is assigned."""
        return "$AA_ENC_COMP" in (content if isinstance(content, str) else content.decode("latin-1")).upper()


class _Axis:
    """What is written for one axis."""

    def __init__(self, table: AxisTable, job: Job) -> None:
        self.table, self.axis, self.options = table, job.machine.axis(table.output), job.options
        self.scale = 1.0 if self.axis.is_linear else 180.0 / np.pi
        self.lattice = lattice_of(table.positions, self.options["max_points"])
        self._ask_points()
        self.values = self.scale * on(table, self.lattice).mean
        self.backlash = round(-self.scale * table.reversal_value, 9) + 0.0
        self.name = name_of(table.output, self.options["axes"])

    def _ask_points(self) -> None:
        most, count = self.options["max_points"], len(self.table.positions)
        if most is not None and count > most:
            raise InputError(
                f"{DECLARATION.name}: the table of {self.table.output} has {count} positions; MD38000 allows {most} "
                f"(option max_points). Take a larger `step`, or `max_points={most}`"
            )

    def text(self) -> str:
        """The file."""
        e, lattice = self.options["encoder"], self.lattice
        at = f"[{e},{self.name}]"
        modulo = int(self.table.period > 0.0)
        lines = ["%_N_AX_EEC_INI", "CHANDATA(1)", f"; MD32450 $MA_BACKLASH{at}={number(self.backlash)}"]
        lines += [f"$AA_ENC_COMP[{e},{n},{self.name}]={number(v)}" for n, v in enumerate(self.values)]
        ends = (("STEP", lattice.step), ("MIN", lattice.low), ("MAX", lattice.high))
        lines += [f"$AA_ENC_COMP_{suffix}{at}={number(value)}" for suffix, value in ends]
        return "\n".join([*lines, f"$AA_ENC_COMP_IS_MODULO{at}={modulo}", "M17", ""])

    def parameters(self) -> list[tuple[str, str, str]]:
        """Machine data of the axis."""
        e, axis = self.options["encoder"], self.name
        return [
            (f"MD38000 $MA_MM_ENC_COMP_MAX_POINTS[{e},{axis}]", f">= {self.lattice.count}", "points of the table"),
            (
                f"MD32450 $MA_BACKLASH[{e},{axis}]",
                number(self.backlash),
                f"backlash [{self.axis.unit}], instead of the former",
            ),
            (f"MD32700 $MA_ENC_COMP_ENABLE[{e},{axis}]", "0, then 1", "0 to load the table, 1 to activate it"),
        ]

    def notes(self) -> list[str]:
        """What the one table of the axis cannot hold, sentence by sentence."""
        table, unit = self.table, self.axis.unit
        lost = self.scale * np.abs(table.forward - table.reverse - table.reversal_value).max() / 2.0
        found = [covers(self.lattice, self.values, self.axis, unit, table.period)]
        if lost > 1e-7:
            size = f"{1000.0 * lost:.2f} µm" if self.axis.is_linear else f"{lost:.6f}°"
            found.append(
                f"{table.output}: the reversal changes along the axis; one backlash for all positions leaves up to {size}. "
                "sinumerik-cec holds both directions"
            )
        moved = self.scale * loss(replace(table, forward=table.mean, reverse=table.mean), self.lattice)
        if moved > 1e-7:
            found.append(f"{table.output}: equal steps change values by up to {moved:.6f} {unit}")
        place = self.options["reference"].get(table.output)
        if place is not None:
            there = float(np.interp(place, self.lattice.positions, self.values))
            if abs(there) > SMALLEST_STEP_AT_ZERO:
                found.append(
                    f"{table.output}: the table is {there:.6f} {unit} at the reference point {place:g}; the axis moves by it "
                    f"when the compensation begins. Export with `zero={table.output}={place:g}`"
                )
        return [sentence for sentence in found if sentence]


def _take(s: Setting, found: dict[str, Parts], machine: Machine, names: Mapping[str, str]) -> None:
    """Puts one assignment of $AA_ENC_COMP into the table of its axis."""
    suffix = s.name.removeprefix("AA_ENC_COMP").lstrip("_")
    if suffix not in ("", "STEP", "MIN", "MAX", "IS_MODULO") or len(s.index) != (2 if suffix else 3):
        raise InputError(
            f"{s.where}: ${s.name}[{','.join(s.index)}] is unknown; expected $AA_ENC_COMP[encoder,point,axis], or _STEP, _MIN, "
            "_MAX, _IS_MODULO[encoder,axis]"
        )
    parts = found.setdefault(axis_of(s.index[-1], s.where, names, machine).letter, Parts({}, {}))
    if suffix:
        parts.others[suffix] = s
    else:
        parts.points[s.whole(1)] = s


def _read(axis: Axis, parts: Parts, backlash: float) -> AxisTable:
    what = f"$AA_ENC_COMP of {axis.letter}"
    x, values = parts.curve(what)
    scale = 1.0 if axis.is_linear else 180.0 / np.pi
    up, down = ((values - way * 0.5 * backlash) / scale for way in (1.0, -1.0))
    return AxisTable(axis.letter, axis.letter, x, up, down, period=parts.period(axis, x, what))


SINUMERIK_ENC_COMP = SinumerikEncComp()
