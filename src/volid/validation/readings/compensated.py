"""What is left for the instruments to see when a control compensates: the prediction for a campaign after compensation.

The drives go to q + s instead of q. What a solution says of the machine there, seen from q, is that of a machine with other
errors (`volid.virtual.drives`); the readings of that one less those without control are what the compensation does to each
reading. The solution's own uncertainty is that at q: s is micrometres.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from volid.campaign import Campaign, ObservationSet
from volid.compensation.control import Control
from volid.effects.prediction import groups_of
from volid.fitting.equations.problem import Problem
from volid.model.error_model import ErrorModel
from volid.model.error_values import error_values, evaluate_bases
from volid.model.kinematics import chain_of
from volid.model.machine import Machine
from volid.observations.base import NuisanceTable
from volid.virtual.drives import Drives, driven_ends, with_steps


def parts_of(control: Control) -> Iterator[tuple[str, Control]]:
    """Every table and grid by its name, with the control that lacks it."""
    for i, table in enumerate(control.tables):
        yield f"table {table.function}", replace(control, tables=control.tables[:i] + control.tables[i + 1 :])
    for i, grid in enumerate(control.grids):
        yield f"grid {grid.type}", replace(control, grids=control.grids[:i] + control.grids[i + 1 :])


@dataclass(frozen=True, eq=False)
class OtherTool:
    """The drives of a control that uses tool vectors which are longer by `by` (3,) [mm] than it is said to use."""

    control: Control
    by: np.ndarray

    @property
    def machine(self) -> Machine:
        """The machine whose axes it moves."""
        return self.control.machine

    @property
    def active(self) -> tuple[str, ...]:
        """Its active compensations, in words."""
        return self.control.active

    def command(
        self, positions: np.ndarray, tool: np.ndarray | None, directions: np.ndarray | None = None
    ) -> np.ndarray:
        """Where the drives go, (m, n_axes)."""
        own = self.control.tool if self.control.tool is not None else tool
        used = None if own is None else np.broadcast_to(np.asarray(own) + self.by, (len(positions), 3))
        return np.asarray(replace(self.control, tool=None).command(positions, used, directions))


def shifts(problem: Problem, campaign: Campaign, z: np.ndarray, control: Drives) -> tuple[np.ndarray, ...]:
    """What the control does to every reading, one array (m, k) per set [unit of the reading]; z: unknowns of the problem."""
    n = problem.model.layout.n_coefficients
    table = NuisanceTable.of(problem.nuisance)
    found = []
    for s in campaign.sets:
        plain, moved = _errors(problem.model, z[:n], s, None), _errors(problem.model, z[:n], s, control)
        shift = np.zeros(s.readings.shape)
        for group in groups_of(s, campaign, table):
            seen = s.side_by_side.rows_of(group.rows)
            shared = seen.positions.T, seen.tool.T
            with_control, without = (
                problem.engine.readings(
                    chain_of(campaign.machine),
                    group.form,
                    *shared,
                    e[:, group.rows],
                    z[n + group.slots],
                    group.constants,
                )
                for e in (moved, plain)
            )
            shift[group.rows] = (with_control - without).T
        found.append(shift)
    return tuple(found)


def _errors(
    model: ErrorModel, coefficients: np.ndarray, readings: ObservationSet, control: Drives | None
) -> np.ndarray:
    """Error values at the programmed positions of a set, those of all ends below each other."""
    found = []
    driven = readings.ends if control is None else driven_ends(control, readings)
    for end, there in zip(readings.ends, driven, strict=True):
        q, way = there.positions.T, there.directions.T.astype(float)
        values = np.asarray(error_values(model.layout, coefficients, evaluate_bases(model.layout, q, way)))
        steps = there.positions - end.positions
        found.append(values if control is None else with_steps(model.machine, values, steps))
    return np.concatenate(found)


def without_control(campaign: Campaign, shift: tuple[np.ndarray, ...]) -> Campaign:
    """The readings as they would be without the control."""
    sets = (replace(s, readings=s.readings - d) for s, d in zip(campaign.sets, shift, strict=True))
    return replace(campaign, sets=tuple(sets))
