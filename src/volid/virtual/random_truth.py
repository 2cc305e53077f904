"""Random truth: smooth errors of a good machine, sines and a cubic, never splines, in the datum of CONVENTIONS 4.

This module draws the errors of linear axes; `random_rotary` brings those of rotary axes into the datum.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from typing import Any
from zlib import crc32

import numpy as np

from volid.exceptions import InputError
from volid.model.error_functions import (
    location_names,
    motion_groups,
    motion_names,
    settings_for,
    spindle_names,
    spline_axes,
    squareness_names,
)
from volid.model.iso230 import parse
from volid.model.machine import Axis, Machine
from volid.model.splines import gauss_legendre
from volid.virtual.random_rotary import in_datum, periodic_wave
from volid.virtual.truth import POINTS, POINTS_ACROSS, CrossTable, Table, Truth

MICROMETRE, MICRORADIAN = 1e-3, 1e-6  # in mm, rad
Function = Callable[[np.ndarray], np.ndarray]


def generator(seed: int, *what: str) -> np.random.Generator:
    """Random numbers for one purpose: they do not change when something else is added to machine or plan."""
    if seed < 0:
        raise InputError(f"seed is {seed}; expected a whole number >= 0")
    return np.random.default_rng([seed, *(crc32(text.encode()) for text in what)])


def random_truth(
    machine: Machine,
    seed: int = 0,
    *,
    scale: float = 1.0,
    waviness: float = 1.0,
    reversal: Collection[str] | None = None,
    cross: Mapping[str, str] | None = None,
) -> Truth:
    """A random virtual machine, reproducible by `seed`: smooth errors as a good machine has them.

    Largest value over the travel: translations 3 … 15 µm, plus a slope up to 30 µm/m for positioning; rotations
    10 … 30 µrad; cross effects 3 … 8 µm or 5 … 15 µrad; reversal 1 … 4 µm or 2 … 6 µrad. Squareness 20 … 40 µrad, tool
    frame 30 … 70 µrad and 5 … 25 µm. Rotary axes: translations 2 … 8 µm, location errors 5 … 25 µm and 20 … 40 µrad.
    Functions that the machine file leaves out are zero.

    Args:
        machine: The machine.
        seed: Seed of the random numbers, an integer from 0.
        scale: Multiplies every error.
        waviness: The shortest wave is 0.45 travels / `waviness`; on a full turn the harmonics are 1 … 3 times `waviness`.
        reversal: Symbols of the error motions that depend on the direction of approach; None: those that the machine file models.
        cross: By symbol, the letter of a second axis that an error motion depends on; None: those that the machine file models.

    Raises:
        InputError: a negative seed, or a symbol that the machine does not have.

    Example:
        >>> from volid.io import read_machine
        >>> truth = random_truth(read_machine("models/wYXbZt_vertical.toml"), seed=1)
        >>> sorted(truth.constants)
        ['EA0S', 'EA0Z', 'EB0S', 'EB0Z', 'EC0S', 'EC0Y']
    """
    names = motion_names(machine)
    if reversal is None:
        reversal = [name for name in names if settings_for(machine, name).reversal]
    if cross is None:
        cross = {n: spline_axes(machine, n)[1] for n in names if settings_for(machine, n).over}
    draw = _Draw(machine, seed, scale, waviness)
    constants = {name: draw.constant(name, 20.0, 40.0) for name in squareness_names(machine, machine.datum)}
    constants |= {name: draw.constant(name, 20.0, 40.0) for name in location_names(machine)}
    constants |= {name: draw.constant(name, 30.0, 70.0) for name in spindle_names(machine)}
    return Truth(
        machine,
        functions={name: table for group in motion_groups(machine) for name, table in draw.motions(group).items()},
        cross={name: (other, draw.cross(name, other)) for name, other in cross.items()},
        reversal={name: draw.reversal(name) for name in reversal},
        constants={name: value for name, value in constants.items() if settings_for(machine, name).use},
        seed=seed,
        source=f"random truth with seed {seed}",
    )


class _Draw:
    """Draws every error from its own random numbers."""

    def __init__(self, machine: Machine, seed: int, scale: float, waviness: float) -> None:
        self.machine, self.seed, self.scale, self.waviness = machine, seed, scale, waviness

    def motions(self, group: tuple[str, ...]) -> dict[str, Table]:
        """Error motions whose datum is coupled."""
        return {group[0]: self.motion(group[0])} if self._axis(group[0]).is_linear else self.rotary(group)

    def rotary(self, group: tuple[str, ...]) -> dict[str, Table]:
        """Zero mean, no co-rotating part, angular positioning zero at the reference; one factor keeps the pair so."""
        axis, rng = self._axis(group[0]), generator(self.seed, group[0], "size")
        waves = [self.wave(generator(self.seed, name), axis) for name in group]
        functions = in_datum(self.machine, group, waves)
        q = np.linspace(*axis.travel, _points(axis))
        values = np.stack([f(q) for f in functions])
        size = (10.0, 30.0, MICRORADIAN) if parse(group[0]).is_rotation else (2.0, 8.0, MICROMETRE)
        values = values * self._size(rng, *size, values)
        return {name: Table(q, v) for name, v in zip(group, values, strict=True)}

    def wave(self, rng: np.random.Generator, axis: Axis) -> Function:
        """A smooth function over the travel, of period 360° on a full turn."""
        return periodic_wave(rng, self.waviness) if axis.is_full_turn else _wave(rng, axis, self.waviness)

    def motion(self, name: str) -> Table:
        """Zero at the reference; straightness without slope; positioning with one."""
        rng, axis, error = generator(self.seed, name), self._axis(name), parse(name)
        f = _wave(rng, axis, self.waviness)
        q = np.linspace(*axis.travel, POINTS)
        if error.is_rotation:
            values = f(q) - f(np.array(axis.reference))
            return Table(q, values * self._size(rng, 10.0, 30.0, MICRORADIAN, values))
        slope = _slope(f, axis.travel, self.machine.datum.line)
        values = f(q) - f(np.array(axis.reference)) - slope * (q - axis.reference)
        values = values * self._size(rng, 3.0, 15.0, MICROMETRE, values)
        if error.direction == axis.letter:
            values = values + self.scale * rng.uniform(-30.0, 30.0) * MICRORADIAN * (q - axis.reference)
        return Table(q, values)

    def cross(self, name: str, other: str) -> CrossTable:
        """A product own(q) · across(p), zero at both references; of a rotary axis own(q) has zero mean where it must."""
        rng, axes = generator(self.seed, name, other), (self._axis(name), self.machine.axis(other))
        waves = [self.wave(rng, axis) for axis in axes]
        places = [np.linspace(*a.travel, n) for a, n in zip(axes, (_points(axes[0]), POINTS_ACROSS), strict=True)]
        along, across = (f(x) - f(np.array(a.reference)) for f, x, a in zip(waves, places, axes, strict=True))
        if not axes[0].is_linear:
            along = in_datum(self.machine, (name,), waves[:1])[0](places[0])
        size = (5.0, 15.0, MICRORADIAN) if parse(name).is_rotation else (3.0, 8.0, MICROMETRE)
        values = np.outer(along, across)
        return CrossTable(places[0], places[1], values * self._size(rng, *size, values))

    def reversal(self, name: str) -> Table:
        """A constant with a ripple of a fifth of it; without ripple where the machine file models a constant."""
        rng, axis = generator(self.seed, name, "reversal"), self._axis(name)
        q = np.linspace(*axis.travel, POINTS)
        ripple = self.wave(rng, axis)(q)
        low, high, unit = (2.0, 6.0, MICRORADIAN) if parse(name).is_rotation else (1.0, 4.0, MICROMETRE)
        depth = 0.0 if settings_for(self.machine, name).reversal == "constant" else 0.2
        values = 1.0 + depth * ripple / np.abs(ripple).max()
        return Table(q, self.scale * _signed(rng, low, high) * unit * values)

    def constant(self, name: str, low: float, high: float) -> float:
        """A constant rotation between `low` and `high` µrad, or a translation of 5 … 25 µm, of either sign."""
        rng = generator(self.seed, name)
        if not parse(name).is_rotation:
            return self.scale * _signed(rng, 5.0, 25.0) * MICROMETRE
        return self.scale * _signed(rng, low, high) * MICRORADIAN

    def _axis(self, name: str) -> Axis:
        return self.machine.axis(parse(name).axis)

    def _size(self, rng: np.random.Generator, low: float, high: float, unit: float, values: Any) -> float:
        return float(self.scale * rng.uniform(low, high) * unit / np.abs(values).max())


def _points(axis: Axis) -> int:
    """Points of a table over the travel; as many for every turn of a rotary axis."""
    return POINTS if axis.is_linear else POINTS * max(1, int(np.ceil(axis.length / 360.0 - 1e-9)))


def _signed(rng: np.random.Generator, low: float, high: float) -> float:
    return float(rng.uniform(low, high) * rng.choice([-1.0, 1.0]))


def _wave(rng: np.random.Generator, axis: Axis, waviness: float) -> Function:
    """Four sines, periods log-uniform in 0.45 … 2 travels / waviness, power falling with frequency, plus a cubic."""
    period = axis.length / waviness * np.exp(rng.uniform(np.log(0.45), np.log(2.0), 4))
    amplitude = rng.uniform(0.5, 1.0, 4) * np.sqrt(period / period.max())
    phase = rng.uniform(0.0, 2.0 * np.pi, 4)
    cubic = np.concatenate([[0.0], rng.normal(0.0, 0.7, 3)])

    def f(q: np.ndarray) -> np.ndarray:
        waves = np.sin(2.0 * np.pi * np.asarray(q)[..., None] / period + phase) @ amplitude
        return waves + np.polynomial.polynomial.polyval((q - axis.reference) / axis.length, cubic)

    return f


def _slope(f: Function, travel: tuple[float, float], line: str) -> float:
    """Slope of the reference line: least squares over the travel, uniform weight, or through the end points."""
    low, high = travel
    if line == "end_point":
        return float((f(np.array(high)) - f(np.array(low))) / (high - low))
    node, weight = gauss_legendre(100)
    arm = 0.5 * (high - low) * node
    return float(np.sum(weight * arm * f(0.5 * (low + high) + arm)) / np.sum(weight * arm**2))
