"""Sequential step diagonals: the nine displacement functions of three linear axes from steps along four body diagonals.

The tool goes along each diagonal in steps of X, then Y, then Z, and an interferometer with a flat mirror reads its displacement
along the diagonal, of unit vector d. A step of one axis, from q to q' in the sense s, changes the reading by

    Δreading - Δnominal = s d · (D(q') - D(q)),   D = (Dx, Dy, Dz) of this axis,

so every interval of an axis has three unknowns in one equation per diagonal, which least squares solve: the separation that was
published with this test. It is linear, D = M · readings, and u of D follows from u of the readings and of the set's effects
by M. Four equations for three unknowns leave one contradiction per interval,

    (PPP + NPP) - (PNP + PPN),

which errors of position and squareness do not touch: what it holds beyond noise comes from rotations of the axes or from a
mirror that is not square to its beam, and these leak into the nine functions too (`volid.standards.step_diagonals_leak`).

Dx(x) is positioning; Dy(x) and its like hold straightness, squareness and whatever rotations the readings saw. Reversal changes
readings where axes turn back, between the steps: the nine functions are those of the mean of both senses, and reversal values
cannot be separated. Not modelled: rotations of the axes, tilt of the mirror. REQUIREMENTS C; M. A. V. Chapman, Precision
Engineering 27 (2003) 401 (what is not modelled).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from volid.campaign import Campaign, ObservationSet
from volid.exceptions import InputError, NotDeterminedError
from volid.model.iso230 import LINEAR_AXES
from volid.model.kinematics import side_rotation
from volid.model.machine import WORKPIECE, Machine
from volid.observations.beam_lines import BeamLine, beams_of
from volid.standards.shared_errors import own_variance, shared_columns

if TYPE_CHECKING:
    from jaxtyping import Float

STILL = 1e-4  # mm: an axis that moves less has not moved; positions that differ by less are one
TURNED = 1e-6  # of a direction's parts
NAMES = tuple(f"D{c}({a})" for a in "xyz" for c in "xyz")


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


@dataclass(frozen=True, eq=False)
class NineFunctions:
    """The nine functions, by axis X, Y, Z.

    Args:
        steps: The steps that they were separated from.
        values: Values at the nodes of each axis, 0 at the first, shape (n + 1, 3) each [mm].
        maps: What each value takes from each reading, shape (n + 1, 3, m) each.
        contradictions: Root mean square of what the four diagonals leave of each interval, shape (n,) each [mm].
        expected: What noise alone would leave, likewise [mm].
    """

    steps: Steps
    values: tuple[Float[np.ndarray, "_ 3"], ...]
    maps: tuple[Float[np.ndarray, "_ 3 m"], ...]
    contradictions: tuple[Float[np.ndarray, " _"], ...]
    expected: tuple[Float[np.ndarray, " _"], ...]

    @cached_property
    def u(self) -> tuple[Float[np.ndarray, "_ 3"], ...]:
        """Standard uncertainties of `values` from those of the readings and the set's effects, (n + 1, 3) each [mm]."""
        return tuple(np.sqrt(self.variance(m)) for m in self.maps)

    def variance(self, rows: np.ndarray) -> np.ndarray:
        """Variance of linear combinations `rows` (…, m) of the readings, (…,) [mm²]."""
        own, shared = self._errors
        return np.asarray((rows**2) @ own + np.sum((rows @ shared) ** 2, axis=-1))

    @cached_property
    def _errors(self) -> tuple[np.ndarray, np.ndarray]:
        """Variance of each reading by itself, (m,), and errors that readings share, (m, k)."""
        given = self.steps.observations, self.steps.campaign
        return own_variance(*given), shared_columns(*given)

    def of(self, name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Positions, values and u of one function, such as "Dy(x)", (n + 1,) each [mm]."""
        axis, component = divmod(NAMES.index(name), 3)
        return self.steps.nodes[axis], self.values[axis][:, component], self.u[axis][:, component]

    def from_readings(self, readings: Float[np.ndarray, " m"]) -> tuple[np.ndarray, ...]:
        """The nine functions of other readings beyond the nominal ones (m,) of the same steps [mm]."""
        return tuple(rows @ readings for rows in self.maps)


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


def separate(steps: Steps) -> NineFunctions:
    """The nine functions by least squares, interval by interval.

    Raises:
        NotDeterminedError: fewer than three diagonals that lie differently cross an interval.

    >>> len(NAMES), NAMES[:4]
    (9, ('Dx(x)', 'Dy(x)', 'Dz(x)', 'Dx(y)'))
    """
    noise = own_variance(steps.observations, steps.campaign)
    parts = [_of_axis(steps, axis, noise) for axis in range(len(LINEAR_AXES))]
    values = tuple(rows @ steps.beyond_nominal for rows, _, _ in parts)
    maps, contradictions, expected = (tuple(p[i] for p in parts) for i in range(3))
    return NineFunctions(steps, values, maps, contradictions, expected)


def _of_axis(steps: Steps, axis: int, noise_of: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The map of one axis (n + 1, 3, m), the RMS contradiction of each interval, and that of noise alone, (n,) [mm]."""
    own = steps.observations
    increments = np.zeros((len(steps.nodes[axis]) - 1, 3, len(own)))
    found, noise = np.zeros(len(increments)), np.zeros(len(increments))
    for i, rows in enumerate(steps.of_axis(axis)):
        design = steps.sense[rows, None] * steps.along[rows]
        if np.linalg.matrix_rank(design, tol=1e-3) < 3:
            raise NotDeterminedError(
                f"set '{own.name}': {len(rows)} steps of {LINEAR_AXES[axis]} from {steps.nodes[axis][i]:g} to "
                f"{steps.nodes[axis][i + 1]:g} mm do not determine three functions; expected steps on all four body diagonals"
            )
        inverse = np.linalg.pinv(design)
        increments[i] = inverse @ (_picked(steps.last[rows], len(own)) - _picked(steps.first[rows], len(own)))
        left = np.eye(len(rows)) - design @ inverse
        change = steps.beyond_nominal[steps.last[rows]] - steps.beyond_nominal[steps.first[rows]]
        variance = noise_of[steps.last[rows]] + noise_of[steps.first[rows]]
        found[i] = np.sqrt(np.mean((left @ change) ** 2))
        noise[i] = np.sqrt(np.mean(left**2 @ variance))
    return np.concatenate([np.zeros((1, *increments.shape[1:])), np.cumsum(increments, axis=0)]), found, noise


def _picked(rows: np.ndarray, m: int) -> np.ndarray:
    """The matrix (k, m) that takes `rows` (k,) from m readings."""
    found = np.zeros((len(rows), m))
    found[np.arange(len(rows)), rows] = 1.0
    return found


def middle_lines(steps: Steps, axis: int) -> np.ndarray:
    """Positions of all axes at the nodes of one axis, the others in the middle of the steps' box, (n + 1, n_axes) [mm, °]."""
    q = np.tile(steps.observations.positions[0], (len(steps.nodes[axis]), 1))
    for other, letter in enumerate(LINEAR_AXES):
        nodes = steps.nodes[other]
        q[:, steps.machine.index(letter)] = nodes if other == axis else 0.5 * (nodes[0] + nodes[-1])
    return q
