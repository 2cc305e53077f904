"""Remarks that a careful colleague would make of a solution: numbers too large to be a machine's, and the sensor's part."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from volid.fitting.sensor_remarks import sensor_remarks
from volid.fitting.solution import Solution
from volid.fitting.tabulation import constant
from volid.model.axis_lines import carrier_of, constant_rows, is_of_a_line
from volid.model.iso230 import parse

# Machines are accepted with lines of rotary axes off by some 0.02 mm, and by 0.02 mm over 300 mm (order of the tolerances of
# ISO 10791-1 and -6): ten times that is no error of assembly, but a length that was not what it was said to be.
LARGEST_POSITION = 0.2  # mm
LARGEST_ORIENTATION = 7e-4  # rad
K = 2.0


def remarks(solution: Solution) -> tuple[str, ...]:
    """Sentences for the notes of a solution.

    >>> import volid
    >>> remarks(volid.fit(volid.load_campaign("datasets/five_axis_rtest/campaign.toml")))
    ()
    """
    return (*_large_location_errors(solution), *sensor_remarks(solution))


def _large_location_errors(solution: Solution) -> Iterator[str]:
    """Location errors that are larger than machines have, beyond their U, axis by axis; relative to the carrier of an axis."""
    for axis in (a for a in solution.machine.axes if not a.is_linear):
        carrier = carrier_of(solution.machine, axis.letter) or "machine"
        own = [
            constant(solution, line)
            for line in constant_rows(solution.model)
            if is_of_a_line(line.name) and parse(line.name).axis == axis.letter and line.relative_to == carrier
        ]
        large = [
            _said(row.name, row.value, row.u)
            for row in own
            if np.isfinite(row.u) and abs(row.value) - K * row.u > _limit(row.name)
        ]
        if large:
            yield (
                f"{', '.join(large)}: ten times what machines are accepted with; is a tool length, the place of a sphere or "
                f"station, or `point` of [axis.{axis.letter}] mistaken?"
            )


def _limit(symbol: str) -> float:
    return LARGEST_POSITION if symbol[1] in "XYZ" else LARGEST_ORIENTATION


def _said(symbol: str, value: float, u: float) -> str:
    if symbol[1] in "XYZ":
        return f"{symbol} = {value:.3g} mm (U = {1e3 * K * u:.2g} µm)"
    return f"{symbol} = {1e3 * value:.3g} mrad (U = {1e6 * K * u:.2g} µrad)"
