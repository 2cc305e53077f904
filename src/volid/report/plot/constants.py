"""The constants of a solution as figures need them: value and U by symbol, and as text."""

from __future__ import annotations

import math
from typing import NamedTuple

from volid.fitting.solution import Solution
from volid.fitting.tabulation import constant
from volid.model.axis_lines import MACHINE, constant_rows
from volid.model.iso230 import DIRECTIONS, LINEAR_AXES, SPINDLE, parse
from volid.report.language import Texts
from volid.report.plot.panels import signs

K = 2.0


class Constant(NamedTuple):
    """A constant: ISO 230-1 symbol, value and expanded uncertainty [mm or rad]; NaN where it is not determined."""

    name: str
    value: float
    expanded: float

    @property
    def is_known(self) -> bool:
        """Whether the readings determine it."""
        return math.isfinite(self.value) and math.isfinite(self.expanded)

    @property
    def scale(self) -> float:
        """From the library's unit to µm, µrad or µm/m."""
        return 1e6 if parse(self.name).is_rotation else 1e3

    @property
    def unit(self) -> str:
        """Unit in figures: a tilt of a line is µm per m of it, which is the same number as µrad."""
        if not parse(self.name).is_rotation:
            return "µm"
        return "µm/m" if parse(self.name).axis in LINEAR_AXES else "µrad"


def constants_of(solution: Solution) -> list[Constant]:
    """Every constant relative to the machine frame, axis by axis in the order X, Y, Z, A, B, C, tool frame."""
    order = (*DIRECTIONS, SPINDLE)
    lines = [line for line in constant_rows(solution.model) if line.relative_to == MACHINE]
    lines.sort(key=lambda line: (order.index(parse(line.name).axis), parse(line.name).component))
    values = [constant(solution, line) for line in lines]
    return [Constant(line.name, found.value, K * found.u) for line, found in zip(lines, values, strict=True)]


def with_u(found: Constant, texts: Texts) -> str:
    """Value ± U with two significant digits of U (GUM 7.2.6), or that it is not determined.

    >>> from volid.report.language import ENGLISH
    >>> with_u(Constant("EC0Y", 21.34e-6, 2.06e-6), ENGLISH)
    '21.3 ± 2.1 µm/m'
    """
    if not found.is_known:
        return texts("constants.unknown")
    value, expanded = found.scale * found.value, found.scale * found.expanded
    places = max(0, 1 - math.floor(math.log10(float(f"{expanded:.1e}")))) if expanded > 0.0 else 1
    numbers = f"{round(value, places) + 0.0:.{places}f} ± {expanded:.{places}f}"
    return f"{signs(numbers, texts)} {found.unit}"
