"""Fanuc: stored pitch error compensation, increments of each axis in one memory of numbered positions.

Public sources name the parameters but show no file of the memory; therefore two neutral lists are written, the numbered values
and the parameters, which a person types in or a program sends, and on request the lines N…P… as well.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import radians
from typing import Any

from volid.compensation.package import Compensation
from volid.compensation.tables.axis_table import AxisTable
from volid.compensation.types import TABLES
from volid.controllers.axis_values import axis_option, number, of_axis, positive, way, whole
from volid.controllers.base import (
    DOCUMENTED,
    EQUAL,
    INCREMENTAL,
    INFERRED,
    NOT_KNOWN,
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
    text_of,
)
from volid.controllers.fanuc.pitch_memory.held import table_of
from volid.controllers.fanuc.pitch_memory.memory import MEANING, AxisMemory, Form, memory_of, step_of
from volid.controllers.tables.lists import list_text, read_list, same_sign, the_list
from volid.exceptions import InputError
from volid.model.machine import Machine

VALUES, SETTINGS = "fanuc_pitch.csv", "fanuc_parameters.csv"
COLUMNS = ("number", "axis", "direction", "from", "to", "value", "amount")
_LINE = re.compile(r"N(\d{1,6})P([+-]?\d{1,6});?")
_REPORT, _0I_PB, _0I_C, _TOOL, _GUIDE = (
    "technical report A-77810E",
    "Series 0i-PB parameter manual B-63980EN, p. 100",
    "Series 0i-C parameter manual B-64120EN, p. 116",
    "a public program for pitch tables",
    "cnc.wiki, Fanuc pitch error compensation",
)


def _switch(text: str) -> bool:
    if text not in ("0", "1"):
        raise ValueError("expected 0 or 1")
    return text == "1"


DECLARATION = Declaration(
    name="fanuc-pitch",
    title="Fanuc, stored pitch error compensation",
    carries={"L-POS": TABLES, "R-POS": TABLES},
    nearest="it corrects each axis by its own position alone; fanuc-3d carries spatial grids",
    sign=OPEN,
    rows=INCREMENTAL,
    units="positions mm or °; values in detection units × magnification",
    reversal=ONE_VALUE,
    outside=NOT_KNOWN,
    spacing=EQUAL,
    quantum=(0.001, radians(0.001)),
    most_points=128,
    zero="the amount at the reference position is 0; the table is shifted as a whole so that it is",
    zero_fixed=True,
    switching="axis by axis: with 0 at all its position numbers and in 1851 an axis has no compensation",
    options=(
        axis_option("detection_unit", "detection unit of an axis, mm or °", positive, 0.001),
        axis_option("magnification", "parameter 3623 of an axis", whole, 1),
        axis_option("interval", "parameter 3624 of an axis, mm or °; that of the table by default", positive),
        axis_option("reference_position", "where the reference position of an axis is, mm or °", number, 0.0),
        axis_option("reference_return", "direction of the reference position return, + or -", way, "+"),
        Option("bidirectional", "1: a table for each direction, 3605#0; 0: mean and backlash, 1851", False, _switch),
        axis_option("numbers", "position numbers that the control holds for an axis", whole, 128),
        Option("first_number", "first position number that is free", 0, lambda text: whole(text, 0)),
        axis_option("limit", "largest value of one position; none is checked without it", whole),
        Option("data_number", "number of position 0 in a file N…P…; without it no such file is written", None, whole),
    ),
    commissioning=Commissioning(
        backup=("Punch out the parameters and the pitch error compensation data of the control.",),
        load=(
            "Enter the parameters of fanuc_parameters.csv for each axis.",
            "Enter the values of fanuc_pitch.csv at their position numbers; all other numbers of the axis are 0.",
        ),
        activate=("Switch the control off and on again, and return all axes to the reference position.",),
        remove=(
            "Restore the parameters and the data that were punched out, switch off and on, return to the reference.",
        ),
    ),
    facts=(
        Fact("3620 … 3625: reference, lowest, highest number, magnification, interval, turn", DOCUMENTED, _REPORT),
        Fact(
            "3605#0, 3626, 3627: a second table for motion in -, and its amount at the reference", DOCUMENTED, _REPORT
        ),
        Fact(
            "values are increments, seen from the negative side; one is put out within each section", DOCUMENTED, _0I_PB
        ),
        Fact("section n ends n - 3620 intervals from the reference", INFERRED, f"{_0I_PB}: the two examples"),
        Fact("rotary: the values of a turn add up to 0, and number 3620 repeats the last one", DOCUMENTED, _0I_PB),
        Fact("1851: backlash in detection units, -9999 … 9999, positive in the direction of motion", DOCUMENTED, _0I_C),
        Fact("detection unit 0.001 mm or 0.001° where none is stated", INFERRED, _TOOL),
        Fact("at most 128 position numbers per axis", INFERRED, _GUIDE),
        Fact("active after power-on and return to the reference position", INFERRED, _GUIDE),
        Fact("the sign of the values", OPEN),
        Fact("the largest value of one position number (option limit)", OPEN),
        Fact("whether 3627 is multiplied by the magnification; with 3605#0 only magnification 1 is written", OPEN),
        Fact("the data numbers of position values in a file N…P… (option data_number)", OPEN),
    ),
)


class FanucPitch(Controller):
    """The lists of the pitch memory and of its parameters."""

    declaration = DECLARATION

    def declared_for(self, machine: Machine, options: Mapping[str, Any]) -> Declaration:
        """The declaration with the steps and position numbers that are stated for the axes."""
        units = {a.letter: step_of(options, a.letter) for a in machine.axes}
        length = max((u for a, u in units.items() if machine.axis(a).is_linear), default=None)
        angle = max((u for a, u in units.items() if not machine.axis(a).is_linear), default=None)
        most = min(of_axis(options["numbers"], a, DECLARATION.name, "numbers") for a in machine.letters)
        return replace(DECLARATION, quantum=(length, angle and radians(angle)), most_points=most)

    def write(self, job: Job) -> Written:
        """Both lists, and with `data_number` the lines N…P…. Raises `InputError` for what the memory cannot hold."""
        made: list[AxisMemory] = []
        first = job.options["first_number"]
        for table in job.axis_tables():
            made.append(memory_of(table, Form.of(job, table), first))
            first = made[-1].last + 1
        files = [
            ControlFile(VALUES, _values_text(made, job.sign), "values of the pitch memory, by position number"),
            ControlFile(SETTINGS, _settings_text(made, job.sign), "parameters of the pitch memory, by axis"),
        ]
        if job.options["data_number"] is not None:
            program = _program_text(made, job.options["data_number"])
            files.append(ControlFile("fanuc_pitch.nc", program, "the same values as lines N…P…"))
        parameters = tuple((n, f"{a}: {v:g}", MEANING[n]) for m in made for n, a, v in m.rows)
        units = {a.letter: "mm" if a.is_linear else "°" for a in job.machine.axes}
        sizes = ", ".join(f"{m.axis} {m.largest:.6g} {units[m.axis]}" for m in made)
        put_out = (
            f"each value is put out at one place of its section, so that up to all of it is off there; largest: {sizes}"
        )
        notes = (*(note for m in made for note in m.notes), put_out)
        return Written(tuple(files), parameters, notes, max((m.loss for m in made), default=0.0))

    def without_reversal_value(self, table: AxisTable, options: Mapping[str, Any]) -> AxisTable:
        """1851 acts only against the direction of the return to the reference position; at 0 both are as in this direction."""
        ahead = of_axis(options["reference_return"], table.output, "fanuc-pitch", "reference_return") == "+"
        one = table.forward if ahead else table.reverse
        return table if options["bidirectional"] else replace(table, forward=one, reverse=one)

    def read(self, files: Mapping[str, str | bytes], machine: Machine, options: Mapping[str, Any]) -> Compensation:
        """Tables of the axes from both lists, or from the parameters and lines N…P…."""
        name = the_list(files, "parameters.csv", DECLARATION.name)
        text = text_of(name, files[name])
        same_sign(name, text, options["sign"])
        settings: dict[str, dict[str, float]] = {}
        for row in read_list(name, text, ("parameter", "axis", "value")):
            axis, parameter = row.cells["axis"], row.cells["parameter"]
            if axis not in machine.letters or parameter not in MEANING:
                raise InputError(
                    f"{row.place}: parameter '{parameter}' of axis '{axis}' is none of the machine's; see {SETTINGS}"
                )
            if parameter in settings.setdefault(axis, {}):
                raise InputError(
                    f"{row.place}: parameter {parameter} of {axis} stands there a second time; expected each once"
                )
            settings[axis][parameter] = row.number("value")
        values = _values(files, options)
        found = [table_of(machine.axis(a), s, values, options) for a, s in settings.items()]
        if not found:
            raise InputError(f"{name}: holds no parameters; expected those of at least one axis")
        return Compensation((), (), (), tuple(found))

    def recognises(self, name: str, content: str | bytes) -> bool:
        """Lists whose columns are those of the pitch memory or of its parameters."""
        head = [line for line in text_of(name, content[:4000]).splitlines() if not line.startswith("#")][:1]
        return head in ([",".join(COLUMNS)], ["parameter,axis,value,meaning"])


def _values_text(made: Sequence[AxisMemory], sign: str) -> str:
    lines = (
        f"values: {sign}",
        "value: increment of the section from … to, seen from the negative side; amount: their sum from the reference position",
    )
    return list_text(lines, COLUMNS, (row for m in made for row in m.table))


def _settings_text(made: Sequence[AxisMemory], sign: str) -> str:
    rows = ((n, a, float(v), MEANING[n]) for m in made for n, a, v in m.rows)
    return list_text((f"values: {sign}",), ("parameter", "axis", "value", "meaning"), rows)


def _program_text(made: Sequence[AxisMemory], zero: int) -> str:
    lines = [f"N{zero + row[0]}P{row[5]}" for m in made for row in m.table]
    return "\n".join(["%", *lines, "%", ""])


def _values(files: Mapping[str, str | bytes], options: Mapping[str, Any]) -> dict[int, int]:
    """Values by position number, from the list, or from lines N…P…."""
    if any(name.lower().endswith("pitch.csv") for name in files):
        name = the_list(files, "pitch.csv", DECLARATION.name)
        rows = read_list(name, text_of(name, files[name]), ("number", "value"))
        same_sign(name, text_of(name, files[name]), options["sign"])
        return _once((row.place, row.whole("number"), row.whole("value")) for row in rows)
    name = the_list(files, ".nc", DECLARATION.name)
    zero = options["data_number"]
    if zero is None:
        raise InputError(f"{name}: option data_number is missing; state the number of position 0 in this file")
    return _once(_program(name, text_of(name, files[name]), zero))


def _program(name: str, text: str, zero: int) -> list[tuple[str, int, int]]:
    found = []
    for i, line in enumerate(text.splitlines(), 1):
        bare = re.sub(r"\s", "", line).upper()
        match = _LINE.fullmatch(bare)
        if match:
            found.append((f"{name}, line {i}", int(match[1]) - zero, int(match[2])))
        elif bare not in ("", "%", "%;"):
            raise InputError(f"{name}, line {i}: is '{line.strip()[:40]}'; expected N…P… such as N{zero}P0")
    return found


def _once(rows: Any) -> dict[int, int]:
    found: dict[int, int] = {}
    for place, n, value in rows:
        if n in found:
            raise InputError(f"{place}: position number {n} stands there a second time; expected each once")
        found[n] = value
    return found


FANUC_PITCH = FanucPitch()
