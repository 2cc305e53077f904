"""Which error functions a machine has: names by axis, squareness by datum, location errors, and their settings."""

from __future__ import annotations

from fnmatch import fnmatchcase

import numpy as np

from volid.exceptions import InputError
from volid.model.iso230 import DIRECTIONS, LINEAR_AXES, ROTARY_AXES, ROTATIONS, SPINDLE, TRANSLATIONS, motion, parse
from volid.model.machine import Axis, Datum, FunctionSettings, Machine


def squareness_names(machine: Machine, datum: Datum) -> tuple[str, ...]:
    """Squareness parameters in a datum: one for the secondary axis, two for the third (CONVENTIONS 3)."""
    letters = [a for a in LINEAR_AXES if a in machine.letters]
    about = dict(zip(LINEAR_AXES, ROTATIONS, strict=True))
    others = [a for a in letters if a not in (datum.primary, datum.secondary)]
    names = []
    if datum.secondary in letters and datum.primary in letters:
        normal = next(a for a in LINEAR_AXES if a not in (datum.primary, datum.secondary))
        names.append(f"E{about[normal]}0{datum.secondary}")
    names += [f"E{about[a]}0{third}" for third in others for a in LINEAR_AXES if a != third]
    return tuple(names)


def squareness_effect(name: str) -> tuple[str, float]:
    """Straightness that a squareness parameter adds to and its sign: direction + rotation × direction.

    EC0Y: ("EXY", -1.0), i.e. EXY gains -EC0Y·(y - y_ref).
    """
    error = parse(name)
    rotation = np.eye(3)[ROTATIONS.index(error.direction)]
    effect = np.cross(rotation, np.eye(3)[LINEAR_AXES.index(error.axis)])
    k = int(np.argmax(np.abs(effect)))
    return motion(LINEAR_AXES[k], error.axis), float(effect[k])


def settings_for(machine: Machine, name: str) -> FunctionSettings:
    """Settings of function `name`: defaults of `[model]`, then every matching entry of `[model.functions]` in order."""
    result = FunctionSettings(segments=machine.model.segments, degree=machine.model.degree)
    for pattern, new in machine.model.functions.items():
        if fnmatchcase(name, pattern):
            result = FunctionSettings(
                use=new.use,
                segments=result.segments if new.segments is None else new.segments,
                degree=result.degree if new.degree is None else new.degree,
                reversal=new.reversal or result.reversal,
                over=new.over or result.over,
            )
    return result


def reference_of(machine: Machine, datum: Datum, letter: str) -> float:
    """Position of `letter` where its functions are zero; one outside the travel stands for the nearest end."""
    axis = machine.axis(letter)
    return float(np.clip(dict(datum.reference).get(letter, axis.reference), *axis.travel))


def describe_datum(machine: Machine, datum: Datum) -> str:
    """A datum in words, for headers and reports.

    >>> from volid.io import read_machine
    >>> machine = read_machine("models/wYXbZt_vertical.toml")
    >>> describe_datum(machine, machine.datum)
    'primary axis X, secondary axis Y; zero at X = 500, Y = 300, Z = -250 mm; least-squares reference lines'
    """
    lines = {"least_squares": "least-squares reference lines", "end_point": "end-point reference lines"}[datum.line]
    at = {a.letter: f"{a.letter} = {reference_of(machine, datum, a.letter):g}" for a in machine.axes}
    axes = [f"{rank} axis {a}" for rank, a in (("primary", datum.primary), ("secondary", datum.secondary)) if a]
    origin = ", ".join(at[a] for a in sorted(at) if a in LINEAR_AXES)
    rotary = ", ".join(f"{at[a]}°" for a in sorted(at) if a not in LINEAR_AXES)
    zero = [f"zero at {origin} mm"] if origin else []
    zero += [f"angular positioning {'' if origin else 'zero '}at {rotary}"] if rotary else []
    means = ["other rotary error motions have zero mean"] if rotary else []
    return "; ".join([*([", ".join(axes)] if axes else []), *([", ".join(zero)] if zero else []), *means, lines])


def motion_names(machine: Machine) -> tuple[str, ...]:
    """Error motions that the machine file leaves switched on, axis by axis from the workpiece."""
    names = [motion(d, axis.letter) for axis in machine.axes for d in DIRECTIONS]
    return tuple(n for n in names if settings_for(machine, n).use)


def motion_groups(machine: Machine) -> tuple[tuple[str, ...], ...]:
    """Error motions whose datum constraints are coupled stand together; all others alone.

    The co-rotating rule (CONVENTIONS 4) couples the two radial motions of a rotary axis, and its two tilt motions; on an
    inclined axis with components in the machine frame it couples all three.
    """
    names = motion_names(machine)
    groups: list[tuple[str, ...]] = []
    for axis in machine.axes:
        for triple in (TRANSLATIONS, ROTATIONS):
            present = [motion(d, axis.letter) for d in triple if motion(d, axis.letter) in names]
            if axis.is_linear:
                groups += [(n,) for n in present]
            elif _is_inclined(axis):
                groups += [tuple(present)] if present else []
            else:
                along = triple[ROTARY_AXES.index(axis.letter)]
                groups += [(n,) for n in present if parse(n).direction == along]
                pair = tuple(n for n in present if parse(n).direction != along)
                groups += [pair] if pair else []
    return tuple(groups)


def _is_inclined(axis: Axis) -> bool:
    """True when a rotary axis's components do not stand along and across its line."""
    local = axis.frame.T @ np.asarray(axis.unit_vector)
    return bool(abs(abs(local[ROTARY_AXES.index(axis.letter)]) - 1.0) > 1e-9)


def location_names(machine: Machine) -> tuple[str, ...]:
    """Location errors of the rotary axes that are switched on: two positions, two orientations, and the zero if stated."""
    names = []
    for axis in machine.axes:
        if not axis.is_linear:
            along = ROTARY_AXES.index(axis.letter)
            across = [d for triple in (TRANSLATIONS, ROTATIONS) for k, d in enumerate(triple) if k != along]
            names += [f"E{d}0{axis.letter}" for d in across if settings_for(machine, f"E{d}0{axis.letter}").use]
            zero = f"E{axis.letter}0{axis.letter}"
            names += [zero] if _asked_for(machine, zero) and settings_for(machine, zero).use else []
    return tuple(names)


def _asked_for(machine: Machine, zero: str) -> bool:
    """Whether an entry for constants (a name or pattern that contains 0) says true; "E[ABC]*" = { segments = 6 } does not."""
    return any("0" in p and s.use is True and fnmatchcase(zero, p) for p, s in machine.model.functions.items())


def spindle_names(machine: Machine) -> tuple[str, ...]:
    """Constants of the tool frame that are switched on: rotations, and translations with rotary axes on the tool side."""
    head = any(not axis.is_linear and not axis.primed for axis in machine.axes)
    directions = (*ROTATIONS, *TRANSLATIONS) if head else ROTATIONS
    return tuple(n for n in (f"E{d}0{SPINDLE}" for d in directions) if settings_for(machine, n).use)


def spline_axes(machine: Machine, name: str) -> tuple[str, ...]:
    """Letters of the axes that an error motion depends on, its own first."""
    first = parse(name).axis
    over = settings_for(machine, name).over
    if over is None:
        return (first,)
    if first not in over or len(set(over)) != 2:
        raise InputError(f"[model.functions] {name}: over = {list(over)} must name {first} and one other axis")
    return (first, next(a for a in over if a != first))
