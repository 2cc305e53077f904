"""A line of laser readings: which axis moved, where the others stood, and what the file records beside the readings."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from volid.exceptions import InputError
from volid.io.basics.units import NAMES, conversion, spelled
from volid.io.instruments.base import Found, Request
from volid.io.instruments.numerals import decimal_of, number
from volid.io.instruments.runs import Runs
from volid.io.instruments.sections import ENVIRONMENT, USER, Sections
from volid.model.iso230 import TRANSLATIONS
from volid.model.machine import Axis

KEYS = ("axis", "at", "offset", "component", "unit")
_NO_SENSOR = -10.0  # °C, what programs write where no sensor is connected
_MEASURES = (  # beginning of a key in lower case, key of the record, factor by the size of the number
    ("air temp", "air_temperature_C"),
    ("air press", "pressure_hPa"),
    ("air humid", "humidity_percent"),
    ("mat temp 1", "material_1_C"),
    ("mat temp 2", "material_2_C"),
    ("mat temp 3", "material_3_C"),
    ("env factor", "environment_factor"),
    ("exp coeff", "expansion_ppm_per_K"),
)
_EXPANSION = (
    "it states an expansion of {:g} ppm/K, by which its program reduces readings to 20 °C: do not reduce them again"
)
_KILOPASCALS = (30.0, 120.0)  # a number in this range is a pressure in kPa; in 300 to 1200 in hPa
_MATERIAL = "material_"


class Line(NamedTuple):
    """`axis` moved, `at`: position of every other axis by letter; `component` of the deviation; `notes` how that was found.

    `offset`: what the axis showed where the file counts 0 [mm or degrees].
    """

    axis: Axis
    at: Mapping[str, float]
    offset: float
    component: str
    notes: tuple[str, ...]


def line_of(request: Request, sections: Sections, components: tuple[str, ...]) -> Line:
    """The line that the user and the file describe. `components`: those that the instrument can read.

    Raises `InputError` for an axis that is missing, unknown, or not of the kind, and for other axes without a position.
    """
    axis, notes = _axis(request, sections)
    own = axis.letter if axis.letter in components else None
    if own is None and "component" not in request.table.data:
        raise InputError(
            f"{request.table.where}: key 'component' is missing; add it, one of {', '.join(components)}: what was read while "
            f"{axis.letter} moved"
        )
    component = request.table.text("component", own, choices=components)
    return Line(axis, _others(request, axis), request.table.number("offset", 0.0), component, notes)


def _axis(request: Request, sections: Sections) -> tuple[Axis, tuple[str, ...]]:
    """The axis that the user names, or else the file."""
    axes = {a.letter: a for a in request.machine.axes}
    written = sections.pairs(USER).get("Axis", "")
    letters = [c for c in re.findall(r"[A-Z]+", written.upper()) if c in axes]
    if "axis" in request.table.data:
        axis = axes[request.table.text("axis", choices=axes)]
        other = letters and axis.letter not in letters
        return axis, ((f"it calls the axis '{written}', and {axis.letter} is taken as stated",) if other else ())
    if len(letters) != 1:
        found = f"the file calls it '{written}'" if written else "the file does not name it"
        raise InputError(
            f"{request.table.where}: key 'axis' is missing, and {found}; add it, one of {', '.join(axes)}: the axis that moved"
        )
    return axes[letters[0]], (f"axis {letters[0]} as the file says",)


def _others(request: Request, axis: Axis) -> dict[str, float]:
    """Position of every axis that stood still; one of the axis that moved counts for nothing.

    Raises `InputError` naming those that are missing.
    """
    given = request.table.table("at", {})
    others = [a.letter for a in request.machine.axes if a is not axis]
    missing = [letter for letter in others if letter not in given.data]
    if missing:
        example = ", ".join(f"{letter} = 0.0" for letter in missing)
        raise InputError(
            f"{given.where}: no position of {', '.join(missing)}; expected where every axis stood while {axis.letter} moved, "
            f"such as at = {{ {example} }}"
        )
    given.only(a.letter for a in request.machine.axes)  # one list may serve files of several axes
    return {letter: given.number(letter) for letter in others}


def check_linear(line: Line, request: Request) -> None:
    """Raises `InputError` for a rotary axis."""
    if not line.axis.is_linear:
        raise InputError(
            f"{request.table.where}: axis {line.axis.letter} is rotary; linear readings need a linear axis"
        )


def found_on(line: Line, runs: Runs, sections: Sections, unit: str) -> Found:
    """The readings as rows of kind `component`, `unit` being that of the deviations."""
    n = len(runs.value)
    environment, left_out = _environment(sections)
    columns: dict[str, Any] = {letter: [value] * n for letter, value in line.at.items()}
    columns |= {
        line.axis.letter: (runs.target + line.offset).tolist(),
        f"{line.axis.letter}_dir": runs.way.astype(int).tolist(),
    }
    columns |= {"component": [line.component] * n, "run": runs.run.tolist(), "value": runs.value.tolist()}
    if line.component in TRANSLATIONS and any(environment.get("expansion_ppm_per_K", [])):  # turns are not reduced
        left_out = (*left_out, _EXPANSION.format(environment["expansion_ppm_per_K"][0]))
    material = [t for key, values in environment.items() if key.startswith(_MATERIAL) for t in values]
    if material:
        columns["temperature"] = [float(np.mean(material))] * n
    conditions: dict[str, Any] = {"as_written": sections.pairs(USER), "environment": environment}
    if moments := _moments(sections):
        conditions["date_time"] = moments
    return Found(
        kind="component",
        columns=columns,
        rows=runs.rows.tolist(),
        units={"value": unit},
        conditions={key: value for key, value in conditions.items() if value},
        notes=(*line.notes, *runs.notes, *left_out),
    )


def unit_of(request: Request, default: str, wanted: str) -> str:
    """The unit of the deviations that the user states, or `default`. Raises `InputError` where it does not lead to `wanted`."""
    unit = spelled(request.table.text("unit", default))
    if unit is None or conversion(unit, wanted) is None:
        known = ", ".join(name for name in NAMES if conversion(name, wanted))
        raise request.table.wrong("unit", f"one of {known}")
    return unit


def _environment(sections: Sections) -> tuple[dict[str, list[float]], tuple[str, ...]]:
    """Measures at start and end of the test, as far as they are numbers; and what was left out, in words."""
    pairs = {
        key.casefold().replace("material", "mat").replace(".", ""): value
        for key, value in sections.pairs(ENVIRONMENT).items()
    }
    found: dict[str, list[float]] = {}
    notes: list[str] = []
    for beginning, name in _MEASURES:
        values = next((_numbers(value) for key, value in pairs.items() if key.startswith(beginning)), [])[:2]
        if name == "pressure_hPa":
            values = _in_hectopascals(values)
        if name.startswith(_MATERIAL) and _NO_SENSOR in values:
            notes.append(f"{name}: {_NO_SENSOR:g} °C was taken for a sensor that is not connected")
        elif values:
            found[name] = values
    return found, tuple(notes)


def _numbers(text: str) -> list[float]:
    """The numbers at the beginning of a text."""
    tokens = text.split()
    decimal = decimal_of(tokens)
    found: list[float] = []
    for token in tokens if decimal else []:
        value = number(token, decimal or ".")
        if value is None:
            break
        found.append(value)
    return found


def _in_hectopascals(values: list[float]) -> list[float]:
    low, high = _KILOPASCALS
    if values and all(low <= v <= high for v in values):
        return [10.0 * v for v in values]
    return values if all(10.0 * low <= v <= 10.0 * high for v in values) else []


def _moments(sections: Sections) -> list[str]:
    """When the test began and ended, as the file writes it."""
    pairs = {
        key.casefold().replace("material", "mat").replace(".", ""): value
        for key, value in sections.pairs(ENVIRONMENT).items()
    }
    return re.findall(r'"([^"]+)"', pairs.get("date time", ""))
