"""What rotations of the axes, and mirror and beam, leak into the nine functions of sequential step diagonals.

To first order a reading beyond the nominal one is

    d · e(q) + ((ω(q) - ω(q0)) × d) · Δ(q) + τ · Δ(q),

e and ω the deviation of position and orientation of the tool, linear in the error values (`volid.model.jacobian.influence`),
Δ how far the nominal functional point is beside the beam, τ ⊥ d the tilt of the mirror against its beam when it was adjusted,
at the first row q0. The nine functions are linear in the readings too, so that each cause has its own share in each of them. What
they should hold is the deviation of the functional point along three lines through the middle of the steps' box; what they hold
besides is the leak. Errors of position and squareness have none.

A rotation ω of an axis at arm r adds ω × r to the deviation, and r differs between the diagonals: the four equations of an
interval then speak of four different deviations. A beam that is turned by δ alone, its mirror staying square to the diagonal,
lengthens all readings by δ²/2 of themselves. Left out: products of errors, at most 0.1 % of what is found here for errors of
100 µrad. M. A. V. Chapman, Precision Engineering 27 (2003) 401, describes the causes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from volid.fitting.solution import Solution
from volid.model.iso230 import DIRECTIONS, LINEAR_AXES, SPINDLE, parse
from volid.model.jacobian import influence
from volid.model.kinematics import ROWS
from volid.model.machine import Machine
from volid.observations.base import NuisanceTable
from volid.observations.beam_unknowns import angle_slots
from volid.standards.results import Section
from volid.standards.shared_errors import tilt_columns
from volid.standards.step_diagonals.separation import NAMES, NineFunctions, separate
from volid.standards.step_diagonals.steps import Steps, middle_lines, steps_of
from volid.virtual.simulate import on_machine
from volid.virtual.truth import Truth

TILT = 1e-5  # rad: of every mirror, for the table
TURN = 1e-3  # rad: of every beam alone, for the table
NOTHING = 1e-6  # mm: a smaller leak is none
FEW = 5  # positions at which a function is looked at for whether the data determine it
MIRROR, BEAM = "mirror tilt", "beam alone"


@dataclass(frozen=True, eq=False)
class Leak:
    """Shares of causes in the nine functions.

    Args:
        nine: The nine functions.
        by_function: By symbol of a rotation, such as EAX, its leak at the nodes of X, Y and Z, shape (n + 1, 3) each [mm].
        tilt: What 1 rad of tilt of each diagonal's mirror about two directions adds, likewise with one more axis (n + 1, 3, 2 ·
            lines) [mm/rad].
        beam: What beams turned by 1 rad alone add, in second order, (n + 1, 3) each [mm/rad²].
        mirrors: What the mirrors' tilts add that a simulation recorded, (n + 1, 3) each [mm]; None where they are not known.
    """

    nine: NineFunctions
    by_function: Mapping[str, tuple[np.ndarray, ...]]
    tilt: tuple[np.ndarray, ...]
    beam: tuple[np.ndarray, ...]
    mirrors: tuple[np.ndarray, ...] | None = None

    @cached_property
    def rotations(self) -> tuple[np.ndarray, ...]:
        """The leak of all rotations together at the nodes of X, Y and Z, (n + 1, 3) each [mm]."""
        zero = [np.zeros_like(v) for v in self.nine.values]
        return tuple(sum((found[a] for found in self.by_function.values()), zero[a]) for a in range(3))

    @cached_property
    def total(self) -> tuple[np.ndarray, ...]:
        """The leak of all rotations and, where they are known, the mirrors' tilts, (n + 1, 3) each [mm]."""
        if self.mirrors is None:
            return self.rotations
        return tuple(r + m for r, m in zip(self.rotations, self.mirrors, strict=True))

    def section(self) -> Section:
        """Largest leak [mm] of each rotation, of all, of mirrors and beams, into each of the nine functions.

        A mirror's row is for 10 µrad of each mirror in both directions, independent of each other; a beam's for 1 mrad of all.
        """
        rows: list[tuple[str | float, ...]] = [(name, *_largest(found)) for name, found in self.by_function.items()]
        rows.append(("all rotations", *_largest(self.rotations)))
        if self.mirrors is not None:
            rows += [("mirrors as simulated", *_largest(self.mirrors)), ("all together", *_largest(self.total))]
        rows.append(
            (f"{MIRROR} {1e6 * TILT:g} µrad", *_largest(tuple(TILT * np.linalg.norm(t, axis=2) for t in self.tilt)))
        )
        rows.append((f"{BEAM} {1e3 * TURN:g} mrad", *_largest(tuple(TURN**2 * b for b in self.beam))))
        return Section("leak", "largest leak into the nine functions", ("cause", *NAMES), tuple(rows))


def _largest(found: tuple[np.ndarray, ...]) -> list[float]:
    return [float(x) for values in found for x in np.abs(values).max(axis=0)]


def leak_of(nine: NineFunctions, truth: Truth) -> Leak:
    """What the rotations of a machine leak into its nine functions, and what mirrors and beams would.

    Args:
        nine: The nine functions, as `separate` makes them; their readings do not count.
        truth: The errors of the machine: of a simulation, or of a solution by `volid.virtual.truth.truth_of_solution`. Tilts of
            the mirrors among its `instruments` are against the nominal beam; where it has none, every mirror is square to its
            beam at the first row, whatever the machine's rotations are there.

    Raises:
        InputError: the machine of `truth` has other axes.
    """
    nine = _on_machine(nine, truth.machine)
    steps = nine.steps
    own = steps.observations
    angles = _tilts(steps, truth)
    readings = _by_row(steps, truth.errors(own.positions, own.directions), adjusted=angles is None)
    lines = [_along_middle(steps, truth, axis) for axis in range(len(LINEAR_AXES))]
    found = {}
    for row, name in enumerate(_names(steps.machine)):
        if row % ROWS >= 3:
            shares = nine.from_readings(readings[:, row])
            shares = tuple(share - line[:, :, row] for share, line in zip(shares, lines, strict=True))
            if any(np.abs(share).max() > NOTHING for share in shares):
                found[name] = shares
    tilts = np.concatenate([tilt_columns(line) for line in steps.lines], axis=1)
    nominal = np.zeros(len(own))
    for line in steps.lines:
        nominal[line.rows] = line.nominal
    mirrors = None if angles is None else nine.from_readings(tilts @ angles)
    return Leak(nine, found, tuple(m @ tilts for m in nine.maps), nine.from_readings(0.5 * nominal), mirrors)


def _tilts(steps: Steps, truth: Truth) -> np.ndarray | None:
    """The mirrors' two angles, line after line, (2 · lines,) [rad], by the names that a simulation gives them; None without."""
    table, known = NuisanceTable(), truth.instruments
    for line in steps.lines:
        angle_slots(line, table)
    names = [entry.name for entry in table.entries]
    return np.array([known[n] for n in names]) if names and set(names) <= set(known) else None


def not_known(solution: Solution) -> tuple[str, ...]:
    """Rotations of linear axes that a solution does not determine, wholly or in part: they count as 0 in `leak_of`."""
    names = [row.name for row in solution.functions(points=FEW) if row.value != row.value]
    kept = [n for n in dict.fromkeys(names) if parse(n).is_rotation and parse(n).axis in LINEAR_AXES]
    return tuple(n for n in kept if not parse(n).location)


def _on_machine(nine: NineFunctions, machine: Machine) -> NineFunctions:
    """The nine functions of the same readings on the machine whose errors are known, with its chain of axes."""
    steps = nine.steps
    number = next(i for i, s in enumerate(steps.campaign.sets) if s is steps.observations)
    campaign = on_machine(steps.campaign, machine)
    return separate(steps_of(campaign.sets[number], campaign))


def _names(machine: Machine) -> list[str]:
    """Symbols of the rows of error values; constants of the tool frame as E…0S."""
    axes = [f"E{d}{a}" for a in machine.letters for d in DIRECTIONS]
    return axes + [f"E{d}0{SPINDLE}" for d in DIRECTIONS]


def _by_row(steps: Steps, errors: np.ndarray, adjusted: bool) -> np.ndarray:
    """Share of every row of error values (E, m) in every reading beyond the nominal one, (m, E) [mm].

    `adjusted`: every mirror is square to its beam at the first row.
    """
    own = steps.observations
    effect = influence(steps.machine, own.positions, own.tool) * errors.T[:, None, :]
    found = np.zeros((len(own), len(errors)))
    for line in steps.lines:
        along, rows = line.beam.along, effect[line.rows]
        found[line.rows] = np.einsum("i,mie->me", along, rows[:, :3])
        if line.mirrored:
            away = line.places - line.point
            turned = np.cross(along, away - np.outer(away @ along, along))  # (ω × d) · Δ = ω · (d × Δ)
            since = rows[:, 3:] - rows[:1, 3:] if adjusted else rows[:, 3:]
            found[line.rows] += np.einsum("mi,mie->me", turned, since)
    return found


def _along_middle(steps: Steps, truth: Truth, axis: int) -> np.ndarray:
    """Share of every row of error values in the deviation along a line through the middle, 0 at its first node, (n + 1, 3, E)."""
    machine, own, q = steps.machine, steps.observations, middle_lines(steps, axis)
    share = influence(machine, q, own.tool[:1].repeat(len(q), axis=0))[:, :3] * truth.errors(q).T[:, None, :]
    return np.asarray(share - share[:1])
