"""The steps of sequential step diagonals: which axis moved between two readings of a beam, from where to where, which way."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from volid.campaign import Campaign, ObservationSet
from volid.exceptions import InputError
from volid.model.iso230 import LINEAR_AXES
from volid.model.kinematics import side_rotation
from volid.model.machine import WORKPIECE, Machine
from volid.observations.beam_lines import BeamLine, beams_of

if TYPE_CHECKING:
    from jaxtyping import Float

STILL = 1e-4  # mm: an axis that moves less has not moved; positions that differ by less are one
TURNED = 1e-6  # of a direction's parts


@dataclass(frozen=True, eq=False)
class Steps:
    """Steps of single axes: k of them in m readings.

    Args:
        campaign: The campaign, and `observations` the set that the steps are rows of.
        lines: The diagonals.
        axis: Number of the axis that moves, 0 to 2 of X, Y, Z, shape (k,).
        interval: Number of the interval of that axis, from its low end, shape (k,).
        sense: +1 where the position rises, else -1, shape (k,).
        along: Unit vector of the diagonal, shape (k, 3).
        first: Row before the step, shape (k,).
        last: Row after it, shape (k,).
        nodes: Positions of X, Y and Z between which steps go, rising [mm].
    """

    campaign: Campaign
    observations: ObservationSet
    lines: tuple[BeamLine, ...]
    axis: np.ndarray
    interval: np.ndarray
    sense: np.ndarray
    along: np.ndarray
    first: np.ndarray
    last: np.ndarray
    nodes: tuple[np.ndarray, ...]

    @property
    def machine(self) -> Machine:
        """The machine."""
        return self.campaign.machine

    @cached_property
    def beyond_nominal(self) -> Float[np.ndarray, " m"]:
        """Readings minus nominal displacements, shape (m,) [mm]."""
        found = self.observations.readings[:, 0].copy()
        for line in self.lines:
            found[line.rows] -= line.nominal
        return found

    @cached_property
    def both_senses(self) -> bool:
        """Whether every interval is crossed with rising and with falling position on every diagonal."""
        seen = {(a, i, s, tuple(d)) for a, i, s, d in self._keys()}
        return all((a, i, -s, d) in seen for a, i, s, d in seen)

    def _keys(self) -> Iterator[tuple[int, int, float, np.ndarray]]:
        yield from zip(
            self.axis.tolist(), self.interval.tolist(), self.sense.tolist(), self.along.round(9), strict=True
        )

    def of_axis(self, axis: int) -> Iterator[np.ndarray]:
        """Numbers of the steps in each interval of an axis."""
        for i in range(len(self.nodes[axis]) - 1):
            yield np.flatnonzero((self.axis == axis) & (self.interval == i))


def step_sets(campaign: Campaign, names: list[str] | None = None) -> list[ObservationSet]:
    """Sets of displacements along beams whose axes move one by one; `names`: only these."""
    found = [s for s in campaign.sets if "lines" in s.options and "line" in s.labels and _is_stepped(s, campaign)]
    return [s for s in found if names is None or s.name in names]


def _is_stepped(observations: ObservationSet, campaign: Campaign) -> bool:
    """Whether three lines or more go along X, Y and Z, one axis at a time."""
    places, stepped = _linear(observations, campaign.machine), 0
    for line in beams_of(observations, campaign):
        moves = [np.abs(np.diff(places[rows], axis=0)) > STILL for rows in _uninterrupted(line)]
        alone = all((m.sum(axis=1) <= 1).all() for m in moves)
        stepped += alone and bool(np.any(np.concatenate(moves), axis=0).all())
    return stepped > 2


def _uninterrupted(line: BeamLine) -> Iterator[np.ndarray]:
    """Rows of a line, run by run and beam by beam, in their order."""
    labels = [line.observations.labels[key][line.rows].tolist() for key in ("run", "segment")]
    keys = list(zip(*labels, strict=True))
    for key in dict.fromkeys(keys):
        yield line.rows[[k == key for k in keys]]


def _linear(observations: ObservationSet, machine: Machine) -> np.ndarray:
    """Positions of X, Y, Z, (m, 3). Raises `InputError` where the machine lacks one."""
    missing = [a for a in LINEAR_AXES if a not in machine.letters]
    if missing:
        raise InputError(f"machine '{machine.name}' has no axis {missing[0]}; step diagonals need X, Y and Z")
    return np.asarray(observations.positions[:, [machine.index(a) for a in LINEAR_AXES]])


def steps_of(observations: ObservationSet, campaign: Campaign) -> Steps:
    """The steps of a set of displacements along body diagonals.

    Args:
        observations: A set of kind `projection`, its beams on the workpiece.
        campaign: The campaign that it belongs to.

    Raises:
        InputError: the beams do not stand on the workpiece, or it is turned; two axes move in one step, or a step jumps over a
            position at which another one ended.

    >>> import volid
    >>> from volid.planning.diagonals import step_diagonals
    >>> plan = step_diagonals(volid.load_machine("models/wYXbZt_vertical.toml"), 10)
    >>> steps = steps_of(plan.sets[0], plan)
    >>> len(steps.axis), [len(positions) for positions in steps.nodes]
    (240, [11, 11, 11])
    """
    if observations.options.get("body", WORKPIECE) != WORKPIECE:
        raise InputError(
            f"set '{observations.name}': body is '{observations.options['body']}'; expected beams that stand on the workpiece"
        )
    places = _linear(observations, campaign.machine)
    _ask_still_table(observations, campaign.machine)
    nodes = tuple(_distinct(q) for q in places.T)
    lines = tuple(beams_of(observations, campaign))
    found = [step for line in lines for step in _steps_along(line, places, nodes)]
    if not found:
        raise InputError(f"set '{observations.name}': no axis moves; expected steps of X, Y and Z along body diagonals")
    axis, interval, sense, along, first, last = (np.array(column) for column in zip(*found, strict=True))
    return Steps(campaign, observations, lines, axis, interval, sense, along, first, last, nodes)


def _ask_still_table(observations: ObservationSet, machine: Machine) -> None:
    """Raises `InputError` where a rotary table has turned the workpiece, and the beams with it, from the axes' directions."""
    turned = np.abs(side_rotation(machine, observations.positions, True) - np.eye(3)).max(axis=(1, 2))
    i = int(np.argmax(turned))
    if turned[i] > TURNED:
        raise InputError(
            f"{observations.where(i)}: the rotary axes have turned the workpiece; expected them at 0, so that X, Y and Z "
            "move along its directions"
        )


def _distinct(positions: np.ndarray) -> np.ndarray:
    """Positions that differ by more than `STILL`, rising."""
    rising = np.sort(positions)
    return np.asarray(rising[np.concatenate([[True], np.diff(rising) > STILL])])


def _steps_along(line: BeamLine, places: np.ndarray, nodes: tuple[np.ndarray, ...]) -> Iterator[tuple]:
    """Axis, interval, sense, direction, row before and row after each step of an uninterrupted beam."""
    own = line.observations
    pairs = [pair for rows in _uninterrupted(line) for pair in pairwise(rows)]
    for first, last in pairs:
        moved = np.flatnonzero(np.abs(places[last] - places[first]) > STILL)
        if len(moved) > 1:
            letters = " and ".join(LINEAR_AXES[i] for i in moved)
            raise InputError(
                f"{own.where(int(last))}: {letters} move in one step of line '{line.name}'; expected one axis"
            )
        for axis in moved:  # none where the tool turns back
            ends = [int(np.argmin(np.abs(nodes[axis] - places[row, axis]))) for row in (first, last)]
            if abs(ends[1] - ends[0]) != 1:
                way = f"{places[first, axis]:g} to {places[last, axis]:g} past {nodes[axis][min(ends) + 1]:g} mm"
                raise InputError(
                    f"{own.where(int(last))}: {LINEAR_AXES[axis]} moves from {way}, where other steps end; "
                    "expected the same steps on every diagonal"
                )
            yield axis, min(ends), float(ends[1] - ends[0]), line.beam.along, first, last


def middle_lines(steps: Steps, axis: int) -> np.ndarray:
    """Positions of all axes at the nodes of one axis, the others in the middle of the steps' box, (n + 1, n_axes) [mm, °]."""
    q = np.tile(steps.observations.positions[0], (len(steps.nodes[axis]), 1))
    for other, letter in enumerate(LINEAR_AXES):
        nodes = steps.nodes[other]
        q[:, steps.machine.index(letter)] = nodes if other == axis else 0.5 * (nodes[0] + nodes[-1])
    return q
