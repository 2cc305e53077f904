"""What no compensation removes: the machine's repeatability at every place, and the thermal limit that was stated.

Every approach to a place draws the scatter of each axis anew. It acts like that axis's error motions, through the same lever
arms: with s of E_kj at the direction of approach, the deviation scatters by s times the influence of E_kj; the repeatability of
the functional point acts on X, Y, Z alike. Which numbers are taken, in this order: those that the user states; those that the
readings show (`volid.fitting.repeatability`); those that the campaign states as effects of type "repeatability". Where every
axis of the machine has its own positioning repeatability, that of the functional point, which contains them, is not added.

Not modelled: repeatability that differs from place to place; correlation between approaches; components and axes without repeated
readings, which are named. ISO/TR 16907:2015 4 b and 8.4.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from volid.exceptions import InputError
from volid.fitting.prediction.largest import Places
from volid.fitting.repeatability import FUNCTIONAL_POINT, Repeatability, repeatability, stated_repeatability
from volid.fitting.solution import Solution
from volid.model.iso230 import motion, parse
from volid.model.jacobian import axis_rows, influence
from volid.model.kinematics import ROWS
from volid.model.machine import Machine
from volid.plausibility.conditions import thermal_limit

_NOT_KNOWN = (
    "repeatability: not known, because no reading came back to a place from the same direction with the same tool; it is not in "
    "these numbers (state it: `repeatability`)"
)


@dataclass(frozen=True)
class Repeats:
    """The repeatability that predictions contain, and what is not in them.

    Args:
        common: Standard deviation of the functional point, alike in X, Y and Z [mm]; 0 where axes have their own.
        motions: Standard deviation by ISO 230-1 symbol and direction of approach [mm, rad]; direction 0: any.
        positions: Standard deviation of positions by axis letter, as stated [mm or degrees].
        source: Where the numbers are from, in words.
        found: What the readings show, the numbers that are not used included.
        not_included: What is missing, in words.
        thermal: Thermal limit as [conditions] states it [mm]; None: not stated.

    >>> Repeats(common=4e-4, source="stated").is_known
    True
    """

    common: float = 0.0
    motions: Mapping[tuple[str, int], float] | None = None
    positions: Mapping[str, float] | None = None
    source: str = ""
    found: tuple[Repeatability, ...] = ()
    not_included: tuple[str, ...] = ()
    thermal: float | None = None

    @property
    def is_known(self) -> bool:
        """Whether there is any number."""
        return bool(self.source)

    def columns(self, machine: Machine, places: Places, tool: np.ndarray) -> np.ndarray:
        """Independent parts of the scatter at m places as columns of the deviation, (m, 6, k) [mm, rad]."""
        q = places.positions
        parts = [np.zeros((len(q), 6, 0))]
        if self.common:
            parts.append(np.tile(self.common * np.eye(6, 3), (len(q), 1, 1)))
        if self.positions:
            sizes = np.array([self.positions.get(a.letter, 0.0) for a in machine.axes])
            parts.append(axis_rows(machine, q, tool) * sizes)
        if self.motions:
            acting = influence(machine, q, tool)
            for name in dict.fromkeys(name for name, _ in self.motions):
                error = parse(name)
                axis = machine.index(error.axis)
                size = self._by_direction(name, places.directions[:, axis])
                parts.append((acting[:, :, ROWS * axis + error.component] * size[:, None])[:, :, None])
        return np.concatenate(parts, axis=2)

    def _by_direction(self, name: str, directions: np.ndarray) -> np.ndarray:
        """s of an error motion by direction of approach, (m,); of one that is not known the RMS of the others."""
        known = {way: s for (n, way), s in (self.motions or {}).items() if n == name}
        mean = math.sqrt(sum(s * s for s in known.values()) / len(known))
        up, down, still = (known.get(way, mean) for way in (1, -1, 0))
        return np.where(directions > 0, up, np.where(directions < 0, down, still))


def repeats_of(solution: Solution, stated: Mapping[str, float] | float | None = None) -> Repeats:
    """The repeatability that predictions from a solution contain.

    Args:
        solution: A solution, whose campaign shows or states it; readings that it sets aside say nothing.
        stated: Standard deviation in place of what the readings show: a number for the functional point [mm], or numbers by axis
            letter [mm or degrees]; 0: none.

    Raises:
        InputError: a stated number is negative or not finite, or the machine does not have an axis.
    """
    campaign = solution.campaign
    thermal = thermal_limit(campaign.conditions)
    found = repeatability(campaign, solution.readings.outliers)
    if stated is not None:
        return _as_stated(campaign.machine, stated, found, thermal)
    seen = [r for r in found if r.seen]
    own = {(r.what, r.direction): r.s for r in seen if r.what != FUNCTIONAL_POINT}
    without = [a.letter for a in campaign.machine.axes if not any(n == motion(a.letter, a.letter) for n, _ in own)]
    common = next((r.s for r in seen if r.what == FUNCTIONAL_POINT), 0.0)
    if common and without:
        return Repeats(common, source=_MEASURED, found=found, thermal=thermal)
    if own:
        missing = (f"repeatability of {', '.join(without)}: not known",) if without else ()
        return Repeats(motions=own, source=_MEASURED, found=found, not_included=missing, thermal=thermal)
    if effects := stated_repeatability(campaign):
        return Repeats(positions=effects, source="the campaign's own statement", found=found, thermal=thermal)
    missing = (_hidden(found),) if found else (_NOT_KNOWN,)
    return Repeats(found=found, not_included=missing, thermal=thermal)


_MEASURED = "readings that came back to a place"


def _hidden(found: Sequence[Repeatability]) -> str:
    limits = ", ".join(f"{r.label} {_micro(r.upper, r.unit)}" for r in found)
    return f"repeatability: not seen above the instruments' u; at most (95 %) {limits}; not in these numbers"


def _micro(value: float, unit: str) -> str:
    return f"{1e3 * value:.2f} µm" if unit == "mm" else f"{1e6 * value:.2f} µrad"


def _as_stated(
    machine: Machine, stated: Mapping[str, float] | float, found: tuple[Repeatability, ...], thermal: float | None
) -> Repeats:
    by_axis = stated if isinstance(stated, Mapping) else {}
    strange = [letter for letter in by_axis if letter not in machine.letters]
    if strange:
        raise InputError(
            f"`repeatability`: the machine has no axis {', '.join(strange)}; expected one of {', '.join(machine.letters)}"
        )
    numbers: Iterable[Any] = by_axis.values() if isinstance(stated, Mapping) else [stated]
    for value in numbers:
        if not (math.isfinite(value) and value >= 0.0):
            raise InputError(f"`repeatability` is {value:g}; expected a standard deviation, 0 or above, mm or degrees")
    given = dict(found=found, thermal=thermal, source="as stated")
    if isinstance(stated, Mapping):
        return Repeats(positions=dict(by_axis), **given)  # type: ignore[arg-type]
    return Repeats(float(stated), **given)  # type: ignore[arg-type]
