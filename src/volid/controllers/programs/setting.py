"""What a program does not say and a correction has to know: work offsets, tools, units, where the machine stands."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from volid.exceptions import InputError
from volid.model.requests import checked_number

Vector = tuple[float, float, float]
INCH = 25.4  # mm
SKIP, RUN = "skip", "run"
SYSTEM = re.compile(r"G5[4-9]|G59\.[123]")
ARC_SHARE = 0.75  # of the tolerance of an arc: what its chords may take
_LEAST = 4.0  # a chord tolerance below this many roundings of a coordinate is mostly rounding


@dataclass(frozen=True)
class ProgramSetting:
    """How the control on which a program runs is set up, and how closely the corrected path is followed.

    Args:
        offsets: Machine position of the origin of each work offset that the program uses, such as {"G54": (400, 200, -300)},
            each (3,) [mm].
        tool: Tool vector, (3,) [mm]; None: from `tools`, or (0, 0, -length) while G43 is active.
        tools: Tool vectors by number of the tool (T … M6), each (3,) [mm].
        lengths: Tool length offsets by number, of H or of the tool, as the control's tool table holds them [mm].
        units: "mm" or "inch" until the program says G21 or G20; None: the program says it before it moves.
        start: Machine position before the program, (3,) [mm]; None: unknown.
        chord: Largest distance of the new path from the corrected path [mm].
        digits: Decimals of a coordinate in mm; in inches two more.
        block_delete: What the control does with blocks that begin with /: "skip" or "run"; None: such blocks are refused.
        passing: Further M codes that move no axis, such as (100, 101); they pass through.
        straight_rapids: Whether rapid motions are split as well; else their ends alone are corrected.
        touched: Whether the origins were touched on the machine as it is, with the tools of the program: then corrections are
            counted from the correction at the origin, because what was touched lies beside the position that the control shows.

    Raises:
        InputError: the chord tolerance is not above four roundings of a coordinate, or a value is no finite number.

    >>> ProgramSetting(offsets={"G54": (400.0, 200.0, -300.0)}, tool=(0.0, 0.0, -150.0)).chord
    0.001
    """

    offsets: Mapping[str, Vector] = field(default_factory=dict)
    tool: Vector | None = None
    tools: Mapping[int, Vector] = field(default_factory=dict)
    lengths: Mapping[int, float] = field(default_factory=dict)
    units: str | None = None
    start: Vector | None = None
    chord: float = 0.001
    digits: int = 4
    block_delete: str | None = None
    passing: tuple[float, ...] = ()
    straight_rapids: bool = False
    touched: bool = False

    def __post_init__(self) -> None:
        checked_number("chord", self.chord, above=0.0)
        if self.units not in (None, "mm", "inch"):
            raise InputError(f"`units` is '{self.units}'; expected mm or inch")
        if self.block_delete not in (None, SKIP, RUN):
            raise InputError(f"`block_delete` is '{self.block_delete}'; expected {SKIP} or {RUN}")
        if not 0 <= self.digits <= 9:
            raise InputError(f"`digits` is {self.digits}; expected a number of decimals from 0 to 9")
        if self.chord < _LEAST * self.rounding:
            raise InputError(
                f"`chord` is {self.chord:g} mm, and coordinates are rounded by up to {self.rounding:.2g} mm; allow at least "
                f"{_LEAST * self.rounding:.2g} mm, or more `digits`"
            )
        for name, vector in (*self.offsets.items(), *((f"T{n}", v) for n, v in self.tools.items())):
            if np.shape(vector) != (3,) or not np.isfinite(vector).all():
                raise InputError(f"{name}: {vector} is no place; expected three numbers in mm")
        if wrong := [name for name in self.offsets if not SYSTEM.fullmatch(name)]:
            raise InputError(
                f"`offset={wrong[0]}`: there is no such work offset; expected G54 … G59, G59.1, G59.2 or G59.3"
            )

    @property
    def rounding(self) -> float:
        """Largest distance [mm] by which rounded coordinates move a point: half the last digit of X, Y and Z."""
        return float(np.sqrt(3.0) * 0.5 * 10.0**-self.digits)

    @property
    def curve_tolerance(self) -> float:
        """What of `chord` is left for curves, rounding taken off [mm]. Lines spend it on the correction's own curvature; arcs
        give `ARC_SHARE` of it to their chords, the rest to the correction, which bends less."""
        return self.chord - self.rounding

    def digits_in(self, unit: float) -> int:
        """Decimals of a coordinate in a unit of so many mm."""
        return self.digits + (2 if unit == INCH else 0)
