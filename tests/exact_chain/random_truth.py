"""Random errors of a whole machine, of the size that good machines have."""

from collections.abc import Iterable, Mapping

import numpy as np

from exact_chain.machine import ExactMachine
from exact_chain.motions import COMPONENTS, LINEAR, MICRO, MICROMETRE, ROTARY
from exact_chain.random_rotary import location_errors, rotary_functions
from exact_chain.truth import Product, Smooth, Truth
from exact_chain.waves import signed, unit_peak, wave, without_slope


def random_truth(
    machine: ExactMachine,
    rng: np.random.Generator,
    *,
    waviness: float = 1.0,
    scale: float = 1.0,
    reversal: bool | Iterable[str] = False,
    cross: Mapping[str, str] | None = None,
    tool_rotation: bool = True,
    primary: str = "X",
    secondary: str = "Y",
) -> Truth:
    """Smooth non-spline errors of a good machine, in the datum of CONVENTIONS 4.

    Largest value over the travel: translations 3-15 µm (plus a slope up to 30 µm/m for positioning), rotations
    10-30 µrad; squareness 20-40 µrad, tool rotation 30-70 µrad, rotary location errors 5-25 µm and 20-40 µrad.
    The shortest wave is 0.45 travels / waviness. `scale` multiplies everything. `reversal`: names of functions, or True
    for the positioning functions. `cross`: e.g. {"EAZ": "X"} adds own(z) across(x), zero at both references.
    """
    truth = Truth()
    for axis in machine.axes:
        draw = _linear_functions if axis in LINEAR else rotary_functions
        truth.functions.update(draw(machine, axis, rng, waviness, scale))
    for axis in machine.axes:
        if axis in ROTARY:
            truth.constants.update(location_errors(machine, axis, rng, scale))
    for name in _squareness_names(machine, primary, secondary):
        truth.constants[name] = scale * signed(rng, 20, 40) * MICRO
    if tool_rotation:
        truth.constants.update({f"{component}0S": scale * signed(rng, 30, 70) * MICRO for component in COMPONENTS[3:]})
    for name, other in (cross or {}).items():
        waves = [wave(machine, axis, rng, waviness) for axis in (name[2], other)]
        own, across = (
            unit_peak(f.plus(-f(f.centre)), machine.travel[axis])
            for f, axis in zip(waves, (name[2], other), strict=True)
        )
        size = rng.uniform(3, 8) * MICROMETRE if name[1] in LINEAR else rng.uniform(5, 15) * MICRO
        truth.cross[name] = (other, Product(own.times(scale * size), across))
    if reversal is True:
        reversal = [("E" + axis + axis) for axis in machine.axes]
    for name in reversal or ():
        size = signed(rng, 1, 4) * MICROMETRE if name[1] in LINEAR else signed(rng, 2, 6) * MICRO
        ripple = unit_peak(wave(machine, name[2], rng, waviness), machine.travel[name[2]])
        truth.reversal[name] = ripple.times(0.2).plus(1.0).times(scale * size)
    return truth


def _linear_functions(machine, axis, rng, waviness, scale) -> dict[str, Smooth]:
    """Six functions of a linear axis: zero at the reference; straightness without slope, positioning with."""
    functions, travel = {}, machine.travel[axis]
    for component in COMPONENTS:
        f = wave(machine, axis, rng, waviness)
        if component[1] in LINEAR:
            f = unit_peak(without_slope(f, travel), travel).times(rng.uniform(3, 15) * MICROMETRE)
            if component[1] == axis:
                f = f.plus(slope=rng.uniform(-30, 30) * MICRO)  # µm/m
        else:
            f = unit_peak(f.plus(-f(f.centre)), travel).times(rng.uniform(10, 30) * MICRO)
        functions[component + axis] = f.times(scale)
    return functions


def _squareness_names(machine: ExactMachine, primary: str, secondary: str) -> list[str]:
    """Secondary axis: about the normal of the primary-secondary plane. Third axis: about primary and secondary."""
    third = next(a for a in LINEAR if a not in (primary, secondary))
    about = dict(zip(LINEAR, ROTARY, strict=True))
    names = [(third, secondary), (secondary, third), (primary, third)]
    return [f"E{about[r]}0{axis}" for r, axis in names if {primary, secondary, axis} <= set(machine.axes)]
