"""What is asked of spatial grids, in one object, and how their values are evaluated."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from volid.compensation.base import Base
from volid.compensation.grids.sides import LINEAR, default_reference
from volid.compensation.tables.sampling import Sampling
from volid.compensation.types import GRID, TYPES, CompensationType
from volid.exceptions import InputError
from volid.model.machine import Machine

Rule = Callable[..., Any]
EXACT, LINEARISED = "exact", "linearised"
ENTIRE = ("L-VOL", "L-VOL+", "R-VOL", "R-VOL+")  # types that hold all errors of their axes


@dataclass(frozen=True, eq=False)
class GridRequest:
    """Grids of one compensation type.

    Args:
        type: Type of ISO/TR 16907; it must have the form of a grid.
        base: The specific lines, the tool vector and the alignment that the grids are based on.
        sampling: The step, the largest number of points per axis, or a bound on the interpolation error.
        points: Number of points per axis where the sampling does not state it; 21 by default, 37 for rotary axes.
        nodes: The nodes themselves by axis letter [mm or °], instead of a sampling.
        ranges: Lowest and highest node by axis letter [mm or °]; the travel by default.
        reference_point: Point for which the grids of rotary axes hold the translations, (3,) [mm], in the frame of
            the body that bears these axes, which coincides with the machine frame when the linear axes stand at 0; by default the
            `point` of the axis nearest the bed, for each side.
        rule: Function that computes what L-SPEC and R-SPEC correct; it is called as rule(solution, positions (m, n_axes),
            tool (m, 3)) and returns error values (m, 6) [mm, rad].
        zero: where the translations of a linear grid are 0 for its tool vector, by axis letter [mm], other axes at the lines'
            crossing; rotations stay, because their effect on other tools does not vanish.
        uncertainty: False leaves out u, which takes most of the time; it changes no value.
        evaluation: "exact": the deviation of the kinematic model with all products of errors; "linearised": the sum of the
            errors' influences at the nominal machine, products of errors left out (below 0.02 µm per metre at 100 µrad).
            Default: exact where it exists, for the types that hold all errors of their axes in the frame of the datum.

    Raises:
        InputError: the type has no grids, or an exact evaluation does not exist.
    """

    type: CompensationType
    base: Base
    sampling: Sampling = field(default_factory=Sampling)
    points: int | None = None
    nodes: Mapping[str, np.ndarray] | None = None
    ranges: Mapping[str, tuple[float, float]] | None = None
    reference_point: Sequence[float] | None = None
    rule: Rule | None = None
    zero: Mapping[str, float] | None = None
    uncertainty: bool = True
    evaluation: str | None = None

    def __post_init__(self) -> None:
        if GRID not in self.type.forms:
            raise InputError(f"{self.type.name} has no grid; it is a table of the axis itself")
        shifted = bool(self.zero) and self.type.is_linear
        possible = self.type.name in ENTIRE and not shifted and self.rule is None and self.base.turn is None
        chosen = self.evaluation or (EXACT if possible else LINEARISED)
        if chosen not in (EXACT, LINEARISED):
            raise InputError(f"evaluation '{chosen}'; expected '{EXACT}' or '{LINEARISED}'")
        if chosen == EXACT and not possible:
            raise InputError(
                f"evaluation '{EXACT}' exists for {', '.join(ENTIRE)} in the frame of the datum, without a stated zero; "
                f"{self.type.name} as asked for is evaluated '{LINEARISED}'"
            )
        object.__setattr__(self, "evaluation", chosen)

    def reference(self, machine: Machine, side: str) -> np.ndarray:
        """Where the translations of a side's grid hold (3,) [mm]: the base tool, or the reference point of the rotary axes."""
        if side == LINEAR:
            return self.base.tool
        if self.reference_point is None:
            return default_reference(machine, side)
        return np.asarray(self.reference_point, dtype=float)

    def for_orientation(self) -> GridRequest:
        """The FOR grids that go with a type that turns rotary axes."""
        return replace(self, type=TYPES["FOR"], zero=None, rule=None, evaluation=None)
