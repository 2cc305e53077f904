"""Machine files (TOML, `volid-machine/1`): read strictly, and written for machines that were made in Python."""

from __future__ import annotations

import math
from fnmatch import fnmatchcase
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from volid.exceptions import InputError
from volid.io.basics.toml_table import (
    LARGEST_TOML,
    Table,
    check_format,
    format_lines,
    nearest,
    parse_toml,
    read_text,
)
from volid.model.iso230 import DIRECTIONS, LINEAR_AXES, ROTARY_AXES, SPINDLE
from volid.model.machine import Axis, Datum, FunctionSettings, Machine, ModelSettings, parse_structure

FORMAT = "volid-machine/1"
LINES = ("least_squares", "end_point")
AXIS_FRAMES = ("machine", "axis")
_LINEAR_KEYS = ("travel", "reference", "error_point")
_WAVE_KEYS = ("pitch",)  # of linear axes
_ROTARY_KEYS = (*_LINEAR_KEYS, "point", "direction", "axis_frame")
_FUNCTION_KEYS = ("segments", "degree", "reversal", "over")
_LARGEST_DEGREE = 5
MOST_SEGMENTS = 1000  # of one function: 10 mm of 10 m; shorter waves are what `pitch` is for
SHORTEST_PITCH = 0.1  # mm
PITCHES = 0.1  # of the travel: longer waves are what the functions themselves are for
_ORIGIN = (0.0, 0.0, 0.0)
_PARALLEL = 1e-3  # sine of the angle between two directions


def read_machine(path: str | Path) -> Machine:
    """The machine described by a TOML file, as `models/README.md` describes it.

    Args:
        path: Path of the TOML file.

    Raises:
        InputError: naming file and key, for a missing file, an unknown or missing key, or a wrong value.

    >>> import volid
    >>> machine = volid.load_machine("models/wCAYXbZt_trunnion.toml")
    >>> machine.letters, machine.axis("A").travel
    (('C', 'A', 'Y', 'X', 'Z'), (-120.0, 30.0))
    """
    return parse_machine(read_text(path, LARGEST_TOML), str(path))


def parse_machine(text: str, source: str) -> Machine:
    """The machine described by TOML `text`, which it keeps; `source` names the text in messages.

    Raises `InputError` for an unknown, missing or misspelt key, a wrong value, or axes that do not match the structure.
    """
    top = Table(parse_toml(text, source), source)
    check_format(top, FORMAT)
    top.only(("format", "name", "structure", "axis", "datum", "model"))
    structure = top.text("structure")
    chain = parse_structure(structure, f"{source}: structure")
    axes = _axes(top.table("axis"), chain, structure)
    letters = tuple(axis.letter for axis in axes)
    datum = _datum(top.table("datum", {}), letters)
    model = _model(top.table("model", {}), letters)
    return Machine(top.text("name"), structure, axes, datum, model, text)


def _axes(table: Table, chain: tuple[tuple[str, bool], ...], structure: str) -> tuple[Axis, ...]:
    """One axis per letter of the structural code, and no other table."""
    letters = [letter for letter, _ in chain]
    for letter in table.data:
        if letter not in letters:
            raise InputError(
                f'{table.where}: [axis.{letter}] is not in the structure "{structure}"; '
                f"its axes are {', '.join(letters)}"
            )
    for letter in letters:
        if letter not in table.data:
            raise InputError(
                f'{table.where}: table [axis.{letter}] is missing; the structure "{structure}" has axis {letter}, '
                "so add the table with its travel"
            )
    file = table.where.removesuffix(", [axis]")
    axes = tuple(_axis(Table(table.table(a).data, f"{file}, [axis.{a}]"), a, primed) for a, primed in chain)
    _check_parallel(axes, file)
    return axes


def _check_parallel(axes: tuple[Axis, ...], file: str) -> None:
    """Two rotary axes that follow each other must not have one direction: only their sum would matter."""
    for first, second in pairwise(axes):
        if first.is_linear or second.is_linear:
            continue
        if np.linalg.norm(np.cross(first.unit_vector, second.unit_vector)) < _PARALLEL:
            x, y, z = (f"{c:g}" for c in second.unit_vector)
            raise InputError(
                f"{file}, [axis.{second.letter}]: direction [{x}, {y}, {z}] is parallel to that of axis {first.letter} and no "
                "axis lies between them; no measurement could tell them apart. Mend `direction`, or the order in `structure`"
            )


def _axis(table: Table, letter: str, primed: bool) -> Axis:
    linear = letter in LINEAR_AXES
    if linear:
        for key in set(_ROTARY_KEYS) - set(_LINEAR_KEYS):
            if key in table.data:
                raise InputError(f"{table.where}: {key} is for rotary axes; {letter} is linear, so remove it")
    if not linear and "pitch" in table.data:
        raise InputError(f"{table.where}: pitch is for linear axes; {letter} is rotary, so remove it")
    table.only((*_LINEAR_KEYS, *_WAVE_KEYS) if linear else _ROTARY_KEYS)
    travel = table.vector("travel", 2)
    if travel[0] >= travel[1]:
        raise table.wrong("travel", "two increasing end positions, [lower, upper]")
    point = _ORIGIN if linear else _rotary_point(table, letter)
    return Axis(
        letter=letter,
        primed=primed,
        travel=travel,
        reference=_reference(table, travel, linear),
        error_point=table.vector("error_point", 3, point),
        point=point,
        direction=_direction(table, letter),
        axis_frame=table.text("axis_frame", "machine", choices=AXIS_FRAMES) == "axis",
        pitch=_pitch(table, travel),
    )


def _pitch(table: Table, travel: tuple[float, float]) -> float:
    """Period of short waves [mm]; 0 for none."""
    pitch = table.number("pitch", 0.0)
    if "pitch" in table.data and not SHORTEST_PITCH <= pitch <= PITCHES * (travel[1] - travel[0]):
        raise table.wrong(
            "pitch",
            f"a length in mm of at most {PITCHES:g} of the travel and at least {SHORTEST_PITCH:g} mm, such as 10.0",
        )
    return pitch


def _reference(table: Table, travel: tuple[float, float], linear: bool) -> float:
    """Position of zero error: mid-travel for a linear axis, 0 for a rotary one, unless stated."""
    reference = table.number("reference", sum(travel) / 2 if linear else 0.0)
    if not travel[0] <= reference <= travel[1]:
        found = f"reference is {reference:g}" + ("" if "reference" in table.data else " by default")
        raise InputError(f"{table.where}: {found}; expected a position within the travel {travel[0]:g} … {travel[1]:g}")
    return reference


def _rotary_point(table: Table, letter: str) -> tuple[float, float, float]:
    if "point" not in table.data:
        raise InputError(
            f"{table.where}: key 'point' is missing; a rotary axis needs a point on its nominal axis line, "
            f"point = [x, y, z] in mm, machine frame, all axes at 0 ({letter} turns about that line)"
        )
    return table.vector("point", 3)


def _direction(table: Table, letter: str) -> tuple[float, float, float]:
    """Unit vector of the axis; the letter's own unless stated."""
    index = LINEAR_AXES.index(letter) if letter in LINEAR_AXES else ROTARY_AXES.index(letter)
    vector = np.array(table.vector("direction", 3, tuple(np.eye(3)[index])))
    length = np.linalg.norm(vector)
    if length == 0.0:
        raise table.wrong("direction", "a vector other than zero")
    if abs(length - 1.0) > 4.0 * np.finfo(float).eps:  # so that what was written reads back unchanged
        vector = vector / length
    x, y, z = vector.tolist()
    return x, y, z


def _datum(table: Table, letters: tuple[str, ...]) -> Datum:
    """Primary and secondary axis; by default the first two linear axes of the machine in the order X, Y, Z."""
    table.only(("primary", "secondary", "line"))
    linear = [a for a in LINEAR_AXES if a in letters]
    primary = table.text("primary", linear[0] if linear else "", choices=linear)
    others = [a for a in linear if a != primary]
    secondary = table.text("secondary", others[0] if others else "", choices=linear)
    if primary and primary == secondary:
        raise table.wrong("secondary", f"another linear axis than the primary one, {' or '.join(others)}")
    return Datum(primary, secondary, table.text("line", "least_squares", choices=LINES))


def _model(table: Table, letters: tuple[str, ...]) -> ModelSettings:
    table.only(("degree", "segments", "functions"))
    functions = table.table("functions", {})
    possible = possible_names(letters)
    settings = {}
    for name in functions.data:
        _check_name(functions, name, possible)
        settings[name] = _function(functions, name, letters)
    return ModelSettings(_degree(table, 3), _segments(table, "auto", None), settings)


def possible_names(letters: tuple[str, ...]) -> tuple[str, ...]:
    """Symbols that a machine with these axes can have: error motions, squareness, location errors, tool frame."""
    motions = [f"E{d}{a}" for a in letters for d in DIRECTIONS]
    squareness = [f"E{d}0{a}" for a in letters if a in LINEAR_AXES for d in ROTARY_AXES]
    squareness = [n for n in squareness if ROTARY_AXES.index(n[1]) != LINEAR_AXES.index(n[3])]
    locations = [f"E{d}0{a}" for a in letters if a in ROTARY_AXES for d in DIRECTIONS]
    return tuple(motions + squareness + locations + [f"E{d}0{SPINDLE}" for d in DIRECTIONS])


def _check_name(table: Table, name: str, possible: tuple[str, ...]) -> None:
    """`name` is the symbol of an error that this machine can have, or a pattern that matches one."""
    if any(fnmatchcase(known, name) for known in possible):
        return
    if set(name) & set("*?["):
        raise InputError(f"{table.where}: pattern '{name}' matches no error of this machine; expected such as 'E*X'")
    examples = ", ".join(possible[:2])
    raise InputError(
        f"{table.where}: '{name}' is no error of this machine{nearest(name, possible)}; expected an ISO 230-1 symbol "
        f"with one of its axes, such as {examples}, EA0S, or a pattern"
    )


def _function(functions: Table, name: str, letters: tuple[str, ...]) -> FunctionSettings:
    """Settings of one entry of [model.functions]: true, false, "constant" or an inline table."""
    value = functions.data[name]
    if isinstance(value, bool) or value == "constant":
        return FunctionSettings(use=value)
    if not isinstance(value, dict):
        raise functions.wrong(name, 'true, false, "constant" or { segments = …, degree = …, reversal = …, over = … }')
    table = Table(value, f"{functions.where}, {name}")
    if "0" in name:
        raise InputError(f"{table.where} is a constant; expected true or false")
    table.only(_FUNCTION_KEYS)
    over = _over(table, name, letters)
    degree = _degree(table, None)
    return FunctionSettings(True, _segments(table, None, over), degree, _reversal(table), over)


def _degree(table: Table, default: Any) -> Any:
    value = table.get("degree", default)
    if "degree" in table.data and (type(value) is not int or not 1 <= value <= _LARGEST_DEGREE):
        raise table.wrong("degree", f"a whole number from 1 to {_LARGEST_DEGREE}")
    return value


def _segments(table: Table, default: Any, over: tuple[str, str] | None) -> Any:
    value = table.get("segments", default)
    if "segments" not in table.data or value == "auto":
        return value
    several = over and isinstance(value, list) and len(value) == len(over)
    numbers = value if several else [value]
    if all(type(v) is int and v >= 1 for v in numbers):
        if math.prod(numbers) > MOST_SEGMENTS:
            raise table.wrong("segments", f"at most {MOST_SEGMENTS} of one function, each of which is an unknown")
        return tuple(value) if several else value
    extra = " or one such number per axis of `over`" if over else ""
    raise table.wrong("segments", f'"auto" or a whole number >= 1{extra}')


def _reversal(table: Table) -> bool | str:
    value = table.get("reversal", False)
    if isinstance(value, bool) or value == "constant":
        return value
    raise table.wrong("reversal", 'true, false or "constant"')


def _over(table: Table, name: str, letters: tuple[str, ...]) -> tuple[str, str] | None:
    """(own axis, second axis) of a cross effect."""
    value = table.get("over", None)
    if value is None:
        return None
    if not isinstance(value, list) or len(value) != 2 or not set(value) <= set(letters) or value[0] == value[1]:
        raise table.wrong("over", f"two different axes of this machine ({', '.join(letters)}), its own first")
    if not fnmatchcase(value[0], name[-1:]) and name[-1:] in letters:
        raise table.wrong("over", f"the function's own axis {name[-1:]} first")
    return value[0], value[1]


def format_machine(machine: Machine) -> str:
    """Text of a machine file for `machine`: the text it was read from while that still describes it, else a new one."""
    if _describes(machine.text, machine):
        return machine.text
    lines = format_lines({"format": FORMAT, "name": machine.name, "structure": machine.structure})
    for axis in machine.axes:
        values = {key: getattr(axis, key) for key in _LINEAR_KEYS}
        values |= {"pitch": axis.pitch} if axis.pitch else {}
        if not axis.is_linear:
            values |= {"point": axis.point, "direction": axis.unit_vector}
            values |= {"axis_frame": AXIS_FRAMES[axis.axis_frame]}
        lines += ["", f"[axis.{axis.letter}]", *format_lines(values)]
    datum = {key: getattr(machine.datum, key) or None for key in ("primary", "secondary", "line")}
    lines += ["", "[datum]", *format_lines(datum)]
    lines += ["", "[model]", *format_lines({"degree": machine.model.degree, "segments": machine.model.segments})]
    functions = {name: _function_value(s) for name, s in machine.model.functions.items()}
    lines += ["", "[model.functions]", *format_lines(functions)] if functions else []
    return "\n".join(lines) + "\n"


def _describes(text: str, machine: Machine) -> bool:
    try:
        return bool(text) and bool(parse_machine(text, machine.name) == machine)
    except InputError:
        return False


def _function_value(settings: FunctionSettings) -> Any:
    values = {key: getattr(settings, key) for key in _FUNCTION_KEYS}
    given = {key: value for key, value in values.items() if value not in (None, False)}
    return given if given else settings.use
