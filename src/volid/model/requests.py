"""What is asked for, judged against the machine: tool vectors, positions and steps that look like another unit than mm.

- A tool vector longer than twice the machine's diagonal (and a metre), or shorter than 2 mm but not 0, is asked about, unless the
  campaign used such tools itself.
- Positions are asked about when all of them lie within a thousandth of the travels and would fill these as metres, or when one
  lies two travels and more outside.
- A step longer than every travel leaves only the ends.
The questions are `InputError`s, which `volid.accept_unusual` answers; numbers that are not finite are refused in any case.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from volid.backend.consent import ask, ask_memory, in_digits
from volid.exceptions import InputError
from volid.model.machine import Axis, Machine

_DIAGONALS = 2.0  # of the linear travels: a tool is not longer
_ORDINARY = 1000.0  # mm: nor is one on a small machine
_KNOWN = 2.0  # of the longest tool of the campaign
SHORT = 2.0  # mm: a tool vector in metres is no longer
_SAME = 1e-3  # mm
_FAR = 2.0  # travels outside a travel
_TURNS = 3600.0  # degrees outside the travel of a rotary axis
_METRE = 1000.0
_SLACK = 0.05  # of the travel: positions in metres may lie that far outside
_REACHED = 0.05  # of the travel, by positions in metres
_COARSE = 0.1  # mm, degrees: least increments of controls are finer, and errors that an interpolation may leave smaller
_U = (1e-6, 0.1)  # mm: standard uncertainties of readings lie between


LARGEST = 2**63 - 1  # an integer of a file has 64 bits
_ROW = 1000.0  # bytes of a row of a plan, while it is made and written
_BAR = (10.0, 3000.0)  # mm: lengths of ball bars lie between, or within the travels


def checked_number(name: str, value: float, least: float = -np.inf, above: float = -np.inf) -> float:
    """A finite number, not less than `least`, more than `above`. Raises `InputError` naming the parameter."""
    number = float(value)
    if np.isfinite(number) and number >= least and number > above:
        return number
    bound = f" > {above:g}" if np.isfinite(above) else f" >= {least:g}" if np.isfinite(least) else ""
    raise InputError(f"`{name}={number:g}`: expected a finite number{bound}")


def checked_count(name: str, value: int, least: int, most: int) -> int:
    """A whole number from `least` to `most`. Raises `InputError` naming the parameter."""
    if least <= value <= most:
        return value
    raise InputError(f"`{name}={_short(value)}`: expected a whole number from {least:,} to {most:,}")


def _short(value: int) -> str:
    """A whole number of any size, as text that fits a line."""
    text = str(value) if abs(value) < 10**30 else f"{'-' * (value < 0)}more than 10^30"
    return text


def ask_tools(machine: Machine, tools: Any, known: Callable[[], np.ndarray] | None = None, name: str = "tool") -> None:
    """Raises `InputError` for tool vectors that are none, or too long or short to be in mm.

    Args:
        machine: The machine that carries them.
        tools: Tool vectors, shape (..., 3) [mm].
        known: Gives the tool vectors that were used on the machine, shape (k, 3) [mm]: they are not asked about.
        name: Name of the parameter, or where they stand, for the message.
    """
    vectors = checked_vectors(name, tools)
    lengths = np.linalg.norm(vectors, axis=1)
    odd = ((lengths > 0.0) & (lengths < SHORT)) | (lengths > _longest_tool(machine))
    if not odd.any():
        return
    used = np.zeros((0, 3)) if known is None else known()
    longest = max(_longest_tool(machine), _KNOWN * float(np.linalg.norm(used, axis=1).max(initial=0.0)))
    for vector in np.unique(vectors[odd], axis=0):
        length = float(np.linalg.norm(vector))
        if not SHORT <= length <= longest and not _among(vector, used):
            ask(_about(name, vector, length, machine))


def checked_vectors(name: str, vectors: Any) -> np.ndarray:
    """Vectors of three finite numbers (k, 3). Raises `InputError`."""
    given = np.asarray(vectors, dtype=float)
    if given.shape[-1:] != (3,):
        raise InputError(f"`{name}`: an array of shape {given.shape}; expected vectors of three numbers in mm")
    flat = given.reshape(-1, 3)
    wrong = ~np.isfinite(flat).all(axis=1)
    if wrong.any():
        raise InputError(f"`{name}={_listed(flat[wrong][0])}`: expected three finite numbers in mm")
    return np.asarray(flat)


def _longest_tool(machine: Machine) -> float:
    """Length of a tool vector [mm] above which it is asked about."""
    return max(_ORDINARY, _DIAGONALS * float(np.linalg.norm([axis.length for axis in machine.linear])))


def _among(vector: np.ndarray, known: np.ndarray) -> bool:
    return bool((np.abs(known - vector) <= _SAME).all(axis=1).any())


def _listed(vector: np.ndarray) -> str:
    return ",".join(f"{v:g}" for v in vector)


def _about(name: str, vector: np.ndarray, length: float, machine: Machine) -> str:
    travels = ", ".join(f"{axis.length:g}" for axis in machine.linear)
    against = f"; the travels of the machine are {travels} mm" if travels else ""
    unit = "metres" if length < SHORT else "micrometres"
    shown = f"`{name}={_listed(vector)}`" if name.isidentifier() else f"{name} {_listed(vector)}"
    found = f"{shown} is a tool vector of {length:g} mm{against}"
    return f"{found}. Expected a vector in mm, such as 0,0,-150: is it in {unit}?"


def ask_place(machine: Machine, name: str, place: Sequence[float], near: bool = True) -> None:
    """Raises `InputError` for a place (3,) [mm] that is no such, or lies far outside the machine, or nearer than 2 mm to its
    origin where that cannot be meant (`near` False)."""
    vector = checked_vectors(name, place)[0]
    distance = float(np.linalg.norm(vector))
    reach = _DIAGONALS * float(np.linalg.norm([max(abs(a.travel[0]), abs(a.travel[1])) for a in machine.linear]))
    if distance > reach + _ORDINARY or (not near and 0.0 < distance < SHORT):
        unit = "metres" if distance < SHORT else "micrometres"
        found = f"`{name}={_listed(vector)}` lies {distance:g} mm from the origin of machine '{machine.name}'"
        ask(f"{found}. Expected a place in mm: is it in {unit}?")


def checked_columns(machine: Machine, positions: Any) -> np.ndarray:
    """Positions (m, n_axes) by axis, shape (n_axes, m). Raises `InputError` for another number of columns."""
    given = np.atleast_2d(np.asarray(positions, dtype=float))
    if given.ndim != 2 or given.shape[1] != len(machine.axes):
        letters = ", ".join(machine.letters)
        raise InputError(f"positions have the shape {given.shape}; expected one row per point with the axes {letters}")
    return given.T


def ask_positions(machine: Machine, positions: Mapping[str, Any], where: str = "positions") -> None:
    """Raises `InputError` for positions that are not finite, look like metres, or lie far outside the travels.

    Args:
        machine: The machine, with its whole travels.
        positions: Numbers or arrays by axis letter [mm or degrees].
        where: What they are, for the message: a file, or a parameter.
    """
    ask_metres(machine, positions, where)
    for letter, q in positions.items():
        _ask_far(machine.axis(letter), np.atleast_1d(np.asarray(q, dtype=float)), where)


def ask_metres(machine: Machine, positions: Mapping[str, Any], where: str = "positions") -> None:
    """The same for positions that lie within the travels in any case: finite, and not all of them in metres."""
    found = {machine.axis(a): np.atleast_1d(np.asarray(q, dtype=float)) for a, q in positions.items()}
    for axis, q in found.items():
        if not np.isfinite(q).all():
            raise InputError(f"{where}: {axis.letter} = {q[~np.isfinite(q)][0]:g}; expected a finite number")
    linear = {axis: q for axis, q in found.items() if axis.is_linear}
    if linear and all(_inside(_METRE * q, axis) for axis, q in linear.items()):
        reached = [np.abs(_METRE * q).max() >= _REACHED * axis.length for axis, q in linear.items()]
        if sum(reached) >= min(2, len(linear)):
            _say_metres(linear, where)


def _ask_far(axis: Axis, q: np.ndarray, where: str) -> None:
    lower, upper = axis.travel
    off = np.maximum(lower - q, q - upper)
    if off.size and off.max() > (_FAR * axis.length if axis.is_linear else max(_TURNS, _FAR * axis.length)):
        unit = "in mm: is it in micrometres, or the travel in metres?" if axis.is_linear else "in degrees."
        ask(
            f"{where}: {axis.letter} = {q[np.argmax(off)]:g} {axis.unit} lies far outside the travel {lower:g} … {upper:g}. "
            f"Expected a position {unit}"
        )


def _inside(q: np.ndarray, axis: Axis) -> bool:
    slack = _SLACK * axis.length
    return bool(q.size and q.min() >= axis.travel[0] - slack and q.max() <= axis.travel[1] + slack)


def _say_metres(linear: Mapping[Axis, np.ndarray], where: str) -> None:
    found = ", ".join(f"{a.letter} = {_span(q)}" for a, q in linear.items())
    travels = ", ".join(f"{a.letter} {a.travel[0]:g} … {a.travel[1]:g}" for a in linear)
    ask(f"{where}: {found} fill the travels, {travels} mm, as if they were in metres. Expected mm.")


def _span(q: np.ndarray) -> str:
    return f"{q.min():g}" if q.min() == q.max() else f"{q.min():g} … {q.max():g}"


def ask_step(step: float, reaches: Mapping[str, tuple[float, float]], name: str = "step") -> None:
    """Raises `InputError` for a step that is no distance, or is longer than all reaches, given by axis letter."""
    checked_number(name, step, above=0.0)
    if reaches and step > max(high - low for low, high in reaches.values()):
        spans = ", ".join(f"{a} {low:g} … {high:g}" for a, (low, high) in reaches.items())
        ask(
            f"`{name}={step:g}` is longer than every range ({spans}), which leaves the ends alone. Expected a shorter one."
        )


def ask_increments(increments: Iterable[tuple[str, bool, float | None]]) -> None:
    """Raises `InputError` for a least increment that is not positive, or coarser than any control has.

    Args:
        increments: For each, its name, whether it is a length [mm], else an angle [degrees], and its value.
    """
    for name, is_length, value in increments:
        if value is None:
            continue
        checked_number(name, value, above=0.0)
        if value >= _COARSE:
            unit = "mm" if is_length else "degrees"
            usual = f"least increments of controls are below {_COARSE:g} {unit}"
            ask(f"`{name}={value:g}`: {usual}. Expected {unit}, such as 0.0001.")


def ask_bound(name: str, bound: float) -> None:
    """Raises `InputError` for a bound on the error of an interpolation [mm] that is not positive, or larger than any error."""
    checked_number(name, bound, above=0.0)
    if bound >= _COARSE:
        ask(
            f"`{name}={bound:g}`: interpolation within {bound:g} mm. Expected mm, such as 0.0005: is it in micrometres?"
        )


def ask_plan(name: str, rows: int) -> None:
    """Raises `InputError` for a plan of more rows than two gigabytes hold."""
    ask_memory(f"{name}: {in_digits(rows)} rows", _ROW * rows, "Take fewer points")


def ask_bar(machine: Machine, length: float, name: str = "length") -> None:
    """Raises `InputError` for a length of a ball bar [mm] that is not positive, or looks like another unit."""
    checked_number(name, length, above=0.0)
    if not _BAR[0] <= length <= max([_BAR[1], *(axis.length for axis in machine.linear)]):
        unit = "metres" if length < _BAR[0] else "micrometres"
        ask(f"`{name}={length:g}`: a ball bar of {length:g} mm. Expected mm, such as 100: is it in {unit}?")


def ask_uncertainty(name: str, u: float) -> None:
    """Raises `InputError` for a standard uncertainty of a length [mm] that is not positive, or looks like another unit."""
    checked_number(name, u, above=0.0)
    if not _U[0] <= u <= _U[1]:
        unit = "micrometres" if u > _U[1] else "metres"
        ask(f"`{name}={u:g}`: a standard uncertainty of {u:g} mm. Expected mm, such as 0.0005: is it in {unit}?")
