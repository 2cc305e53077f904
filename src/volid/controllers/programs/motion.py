"""What one block of a program moves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from volid.controllers.programs.setting import Vector

RAPID, CUT, AS_IS, LOST = "rapid", "cut", "as it is", "lost"


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """What a block moves. `act`: RAPID, CUT, AS_IS (not corrected) or LOST (to a place that the program does not say).

    `index`: of its block. `points`: machine positions of its polyline, (k + 1, 3) [mm], NaN where unknown. `arc`: whether it is
    one; `bound`: distance of the polyline from it [mm]. `base`: machine position of the program's origin [mm]. `unit`: mm per
    unit. `absolute`: G90. `inverse`: F of G93 [1/min], or 0. `feed`: [mm/min], or 0. `parked`: axes that a rapid leaves alone
    unless it names them. `named`: axes that it names.
    """

    index: int
    act: str
    points: np.ndarray
    tool: Vector
    base: np.ndarray
    unit: float
    absolute: bool
    named: frozenset[int]
    parked: frozenset[int] = frozenset()
    arc: bool = False
    bound: float = 0.0
    inverse: float = 0.0
    feed: float = 0.0
