"""Lines along which one axis moves alone, and reads its own positioning: what ISO 230-2 evaluates."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from volid.campaign import SAME_PLACE, Campaign, ObservationSet
from volid.model.iso230 import DIRECTIONS
from volid.model.machine import Machine
from volid.observations.base import Positioning
from volid.observations.beam_lines import BeamLine, beams_of
from volid.observations.beam_unknowns import uninterrupted
from volid.observations.lines import lines_of_set, per_run

ALONG = 1e-4  # rad: a beam that is turned by less, squared, is along the axis to 1e-8 of the length


def moving_axis(machine: Machine, positions: np.ndarray) -> int | None:
    """Number of the only axis that moves among positions (m, n_axes) [mm or degrees]; None where none or several do."""
    limits = np.array([SAME_PLACE * axis.length for axis in machine.axes])
    moving = np.flatnonzero(np.ptp(positions, axis=0) > limits)
    return int(moving[0]) if len(moving) == 1 else None


def by_component(observations: ObservationSet, campaign: Campaign, components: np.ndarray) -> Iterator[Positioning]:
    """Lines of a set whose component, rows 0 … 5 of the deviation (m,), is along or about the axis that moves."""
    machine = campaign.machine
    for rows in lines_of_set(observations):
        axis = moving_axis(machine, observations.positions[rows])
        if axis is None or machine.axes[axis].letter != DIRECTIONS[int(components[rows[0]])]:
            continue
        factor = 1.0 if machine.axes[axis].is_linear else float(np.rad2deg(1.0))
        runs = len(set(observations.labels["run"][rows].tolist())) if per_run(observations) else 1
        deviations = factor * observations.readings[rows, 0]
        yield Positioning(str(observations.labels["line"][rows[0]]), axis, rows, deviations, factor, runs)


def by_beam(observations: ObservationSet, campaign: Campaign) -> Iterator[Positioning]:
    """Beams of a set along the one linear axis that moves: displacement less the nominal one, counted with the axis."""
    for line in beams_of(observations, campaign):
        axis = moving_axis(campaign.machine, line.seen.positions)
        if axis is not None and (sense := _sense(line, axis)):
            deviations = sense * (line.seen.readings[:, 0] - line.nominal)
            yield Positioning(line.name, axis, line.rows, deviations, sense, len(uninterrupted(line)))


def _sense(line: BeamLine, axis: int) -> float:
    """+1 where the beam is along the motion of an axis, -1 where it is against it, 0 where it is neither."""
    travelled = line.seen.positions[:, axis] - line.seen.positions[0, axis]
    moved = line.places - line.places[0]
    along = float(moved.ravel() @ np.outer(travelled, line.beam.along).ravel()) / float(travelled @ travelled)
    return float(np.sign(along)) if abs(abs(along) - 1.0) < ALONG**2 else 0.0
