"""To what the compensated motion is aligned (ISO/TR 16907 10.2): primary and secondary axis, or the spindle.

Alignment to axes is another datum of the same solution (`Solution.in_datum`). Alignment to the spindle turns the machine frame
about the datum's origin so that its Z lies along the spindle's axis at the reference position, with the rotary axes at 0. The
compensated Z motion (L-VOL) is then parallel to the spindle, and a longer tool cuts at the same X and Y. Neither of them changes
the squareness between the linear axes.

With rotary axes in the head, the spindle is that at their zeros, and the head's location errors are those in the turned frame.
With rotary axes in the table, Z follows the spindle at every position of the table. The table itself stays where it is, and its
location errors are stated in the turned frame. R-VOL then makes the table turn about lines parallel to that frame, so that L-VOL
and R-VOL together move the workpiece as in any other frame, with Z along the table's axis. When the spindle is not parallel to
the table's axis, Z cannot be parallel to both.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from volid.compensation.base import Base, model_errors
from volid.compensation.grids.sides import TABLE, rotary_letters
from volid.exceptions import InputError, NotDeterminedError
from volid.fitting.solution import Solution
from volid.model.iso230 import ROTARY_AXES
from volid.model.jacobian import influence


def spindle_turn(solution: Solution) -> np.ndarray:
    """Turn of the machine frame that puts its Z along the spindle, as linear map of θ, (3, n) [rad]; it has no turn about Z.

    It is the orientation error of the tool at the reference positions, with rotary axes at 0 and without the errors of the table.
    Raises `InputError` when the model has no tool-frame rotation, and `NotDeterminedError` when the data do not determine it,
    which is the case with one tool vector per station.
    """
    machine = solution.machine
    names = [n for n in ("EA0S", "EB0S") if n in solution.model.names]
    if len(names) < 2:
        raise InputError(
            "alignment to the spindle: the model leaves out EA0S or EB0S, the tilt of the spindle against the axes"
        )
    at = np.array([[a.reference if a.is_linear else 0.0 for a in machine.axes]])
    table = rotary_letters(machine, TABLE)
    errors = model_errors(solution, at, np.zeros_like(at), lambda e: e.axis not in table)[0]
    rows = np.asarray(influence(machine, at, np.zeros(3))[0, 3:] @ errors)
    rows[2] = 0.0
    fixed = [n for n in solution.held_tool_rotation if n in names]
    if fixed or solution.is_not_determined(rows[:2]).any():
        raise NotDeterminedError(
            f"alignment to the spindle: the data do not determine the tilt of the spindle ({', '.join(fixed or names)}). "
            f"{' '.join(solution.statements)} Measure with several tool vectors, or align by axes, in a datum with primary axis Z"
        )
    return rows


def aligned_to_spindle(solution: Solution, base: Base) -> Base:
    """The base with the machine frame turned to the spindle. See `spindle_turn` for what it raises."""
    return replace(base, turn=spindle_turn(solution))


def alignment_notes(solution: Solution, base: Base, letters: Iterable[str]) -> list[str]:
    """Notes about an alignment for the record of a table or grid of the axes `letters`; none without an alignment."""
    if base.turn is None:
        return []
    a, b, _ = 1e6 * (base.turn @ np.asarray(solution.parameters))
    restated = "; location errors are those in the turned frame" if set(letters) & set(ROTARY_AXES) else ""
    return [f"machine frame aligned to the spindle: turned by A {a:.3f} µrad, B {b:.3f} µrad from the datum{restated}"]
