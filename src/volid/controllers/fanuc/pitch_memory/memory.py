"""The pitch memory of one axis of a Fanuc control: its numbered values and its parameters, made from a table and read back.

The amount in the direction of the reference position return is 0 at the reference position. Against it, the control adds either
its backlash (parameter 1851), or the values of a second table, which begin with parameter 3627. With the reference return in +:

    one table:   a(+) = t(q),      a(-) = t(q) - backlash;        two tables:   a(+) = t(q),      a(-) = 3627 + t'(q).

Not modelled: where within a section its value is put out; amounts are taken as linear between the ends of the sections.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from volid.compensation.tables.axis_table import AxisTable
from volid.controllers.axis_values import of_axis, or_none, taken_off
from volid.controllers.base import Job
from volid.controllers.fanuc.pitch_memory.sections import (
    Numbering,
    Sections,
    numbered,
    sections_of,
    values_of,
)
from volid.controllers.tables.increments import Increments, increments
from volid.controllers.tables.resampling import at_nodes
from volid.exceptions import InputError

NAME = "fanuc-pitch"
MOST_LOST = 9999  # detection units, parameter 1851
MEANING = {
    "3605#0": "1: a table for each direction",
    "3620": "number of the reference position",
    "3621": "lowest number",
    "3622": "highest number",
    "3623": "magnification",
    "3624": "interval in mm or degrees",
    "3625": "travel per turn in degrees",
    "3626": "lowest number for motion in -",
    "3627": "amount at the reference position against the reference return in detection units",
    "1851": "backlash in detection units",
    "detection unit": "in mm or degrees",
    "reference position": "position in mm or degrees",
    "reference return": "its direction 1 or -1",
}


@dataclass(frozen=True)
class Form:
    """What is stated about one axis. `scale`: from mm or rad to the values of the list, sign included; others: the options."""

    axis: str
    scale: float
    unit: float
    magnification: int
    interval: float | None
    reference: float
    way: int
    both: bool
    numbers: int
    limit: int | None

    @classmethod
    def of(cls, job: Job, table: AxisTable) -> Form:
        """The options for the axis of a table. Raises `InputError` for a table of another axis, or options that do not fit."""
        letter = table.output
        if not table.is_pitch:
            raise InputError(
                f"{NAME}: the table of {table.source} moves {letter} over {table.argument}; expected one axis"
            )

        def stated(name: str) -> Any:
            return of_axis(job.options[name], letter, NAME, name)

        if job.options["bidirectional"] and stated("magnification") != 1:
            raise InputError(
                f"{NAME}: magnification of {letter} is {stated('magnification')}; with bidirectional=1 expected 1, because "
                "public sources do not say whether parameter 3627 is multiplied by it"
            )
        in_degrees = 1.0 if job.machine.axis(letter).is_linear else 180.0 / np.pi
        return cls(
            axis=letter,
            scale=job.factor * in_degrees,
            unit=stated("detection_unit"),
            magnification=stated("magnification"),
            interval=or_none(job.options["interval"], letter),
            reference=stated("reference_position"),
            way=1 if stated("reference_return") == "+" else -1,
            both=job.options["bidirectional"],
            numbers=stated("numbers"),
            limit=or_none(job.options["limit"], letter),
        )

    @property
    def quantum(self) -> float:
        """Step of a value [mm or °]."""
        return self.unit * self.magnification


def step_of(options: Mapping[str, Any], letter: str) -> float:
    """Step of the values of an axis [mm or °]."""
    unit, times = (of_axis(options[name], letter, NAME, name) for name in ("detection_unit", "magnification"))
    return float(unit * times)


@dataclass(frozen=True, eq=False)
class AxisMemory:
    """The values and parameters of one axis.

    Args:
        axis: Letter of the axis.
        table: Rows number, axis, direction, from, to, value, amount.
        rows: Parameters: name, axis, value.
        last: Highest number that it takes.
        loss: Largest change of a value by rounding and by a limit [mm or rad].
        notes: What a user should know of them.
        largest: Largest value of one section [mm or °].
    """

    axis: str
    table: tuple[tuple[Any, ...], ...]
    rows: tuple[tuple[str, str, float], ...]
    last: int
    loss: float
    notes: tuple[str, ...]
    largest: float


def memory_of(table: AxisTable, form: Form, first: int) -> AxisMemory:
    """Numbered values and parameters from a table of error values; `first`: the lowest number that is free.

    Raises `InputError` for what the memory cannot hold.
    """
    sections = sections_of(table, form.reference, form.interval, form.numbers)
    if sections.count > form.numbers:
        raise InputError(
            f"{NAME}: the table of {form.axis} needs {sections.count} position numbers; the control holds {form.numbers}. Take a "
            f"larger `step`, or `max_points={form.numbers}`"
        )
    curves, shift = _curves(table, form, sections)
    held = [
        increments(
            c, form.quantum, reference=sections.below, limit=form.limit, closed=bool(sections.turn), what=_what(form)
        )
        for c in curves
    ]
    numbers = [numbered(sections, first + i * sections.count) for i in range(len(held))]
    rows = tuple(
        row
        for way, h, n in zip(("+", "-") if form.both else ("both",), held, numbers, strict=True)
        for row in _rows(h, n, sections, way)
    )
    lost = 0 if form.both else _lost(table, form)
    loss = max(h.loss for h in held) / abs(form.scale)
    loss += 0.0 if form.both else abs(lost * form.unit / abs(form.scale) + table.reversal_value)
    settings = _settings(form, sections, numbers, held, lost)
    largest = max(int(np.abs(h.steps).max(initial=0)) for h in held) * form.quantum
    notes = _notes(table, form, sections, held, shift)
    return AxisMemory(form.axis, rows, settings, numbers[-1].highest, loss, notes, largest)


def _what(form: Form) -> str:
    return f"{NAME}: the table of {form.axis}"


def _curves(table: AxisTable, form: Form, sections: Sections) -> tuple[list[np.ndarray], float]:
    """Amounts wanted at the ends of the sections, one curve or those of + and -, and the error taken off all [mm or rad]."""
    q = sections.positions
    ways = (1.0, -1.0) if form.both else (0.0,)
    errors = [at_nodes(table, q, w) for w in ways]
    zero = float(errors[1 if form.both and form.way < 0 else 0][sections.below])
    return [form.scale * (e - zero) for e in errors], zero


def _lost(table: AxisTable, form: Form) -> int:
    """Parameter 1851: what the axis must move further after a reversal, minus B = E(+) - E(-) [detection units]."""
    lost = round(-table.reversal_value * abs(form.scale) / form.unit)
    if abs(lost) > MOST_LOST:
        raise InputError(
            f"{_what(form)} has a reversal of {lost} detection units; the control holds at most {MOST_LOST}"
        )
    return lost


def _rows(held: Increments, numbers: Numbering, sections: Sections, way: str) -> list[tuple[Any, ...]]:
    found = []
    for n, value in values_of(held.steps, sections, numbers).items():
        k = n - numbers.reference
        inside = -sections.below <= k <= sections.above
        amount = int(held.held[k + sections.below]) if inside else 0
        ends = (sections.reference + sections.interval * (k - 1), sections.reference + sections.interval * k)
        found.append((n, sections.axis, way, *map(float, ends), value, amount))
    return found


def _settings(
    form: Form, sections: Sections, numbers: list[Numbering], held: list[Increments], lost: int
) -> tuple[tuple[str, str, float], ...]:
    found: dict[str, float] = {
        "3605#0": int(form.both),
        "3620": numbers[0].reference,
        "3621": numbers[0].lowest,
        "3622": numbers[0].highest,
        "3623": form.magnification,
        "3624": sections.interval,
    }
    if sections.turn:
        found["3625"] = sections.turn
    if form.both:
        against = held[1 if form.way > 0 else 0]
        found |= {"3626": numbers[1].lowest, "3627": int(against.held[sections.below])}
    found |= {
        "1851": lost,
        "detection unit": form.unit,
        "reference position": form.reference,
        "reference return": form.way,
    }
    return tuple((name, form.axis, float(value)) for name, value in found.items())


def _notes(table: AxisTable, form: Form, sections: Sections, held: list[Increments], shift: float) -> tuple[str, ...]:
    unit = "mm" if abs(form.scale) == 1.0 else "°"
    off = abs(form.scale) * (shift + (0.0 if form.both else 0.5 * form.way * table.reversal_value))
    found = [*table.notes]
    if abs(off) > 1e-9:
        found.append(
            f"{form.axis}: {taken_off(off, unit == 'mm')} its error values everywhere, so that the reference is 0"
        )
    between = _resampled(table, form, sections)
    if between > 1e-9:
        found.append(f"{form.axis}: other positions than those of the table: up to {between:.3g} {unit} off at these")
    varies = abs(form.scale) * float(np.abs(table.forward - table.reverse - table.reversal_value).max()) / 2.0
    if not form.both and varies > 1e-9:
        found.append(
            f"{form.axis}: the reversal changes along the axis; one backlash (1851) leaves up to {varies:.3g} {unit} in each "
            "direction; bidirectional=1 holds both"
        )
    for h in held:
        if h.carried:
            found.append(
                f"{form.axis}: {len(h.carried)} sections need more than {form.limit}; {h.loss:.6g} {unit} are off there"
            )
    return tuple(found)


def _resampled(table: AxisTable, form: Form, sections: Sections) -> float:
    """What straight lines between the ends of the sections miss at the positions of the table [mm or °]."""
    q = sections.positions
    mean = at_nodes(table, q, 0.0)
    lines = AxisTable(table.output, table.argument, q, mean, mean, period=table.period)
    found = lines.of_argument(table.positions, np.zeros(len(table.positions)))
    return float(abs(form.scale) * np.abs(found - table.mean).max())
