"""Displacements along body and face diagonals, sequential step diagonals, and parallel lines along the axes, as plans.

Lines lie in the box of the travels of the linear axes, between the same two corners there and back. Rotary axes stand at 0, or at
the end of their travel nearest to it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations, product
from typing import NamedTuple

import numpy as np

from volid.backend.even_points import round_position
from volid.campaign import Campaign, ObservationSet
from volid.exceptions import InputError
from volid.model.iso230 import LINEAR_AXES
from volid.model.kinematics import nominal_point
from volid.model.machine import Machine
from volid.model.requests import LARGEST, ask_plan, ask_tools, ask_uncertainty, checked_count, checked_number
from volid.observations.projection import PROJECTION

TOOL = (0.0, 0.0, -150.0)  # mm
U = 0.0005  # mm, of a laser interferometer over a metre
BODY = ("PPP", "NPP", "PNP", "PPN")  # ISO 230-6: the sense of X, Y and Z
BOTH = ("PP", "NP")  # of a face


class _Line(NamedTuple):
    """A line: its name, and positions there (m, n_axes)."""

    name: str
    positions: np.ndarray


class _Way(NamedTuple):
    """How lines are measured: tool vectors [mm], u of a reading [mm], runs there and back."""

    tools: Sequence[Sequence[float]]
    u: float
    runs: int


def diagonals(
    machine: Machine,
    n: int = 11,
    tool: Sequence[float] = TOOL,
    *,
    faces: bool = True,
    height: float = 0.5,
    runs: int = 1,
    u: float = U,
) -> Campaign:
    """Plan of displacements along the four body diagonals and the six face diagonals of the working volume, there and back.

    Body diagonals are named by the sense of X, Y and Z, P or N: NPP begins where X is largest and Y and Z are smallest. Face
    diagonals, two in each of the planes XY, XZ, YZ, are named by the plane and the sense of its axes, as in XY_NP. A
    retro-reflector moves with the tool; the interferometer stands on the workpiece. Of 72 coefficients of quartic functions of a
    bed-X-Y-Z-tool machine, body diagonals determine 19 combinations, with face diagonals in the middle 37, in outer planes 41.

    Args:
        machine: A machine with the linear axes X, Y, Z.
        n: Number of positions of a line, both ends included.
        tool: Tool vector to the apex of the reflector, (x, y, z) [mm].
        faces: Whether face diagonals are measured too.
        height: Where the third axis stands for a face diagonal, as a share of its travel, 0 to 1.
        runs: How often each line is measured there and back; ISO 230-6 asks for five, as ISO 230-2 does.
        u: Standard uncertainty of a displacement [mm].

    Returns:
        A campaign with one `projection` set without readings, of ten lines (four without faces) of 2 n rows a run.

    Raises:
        InputError: the machine lacks a linear axis, or a number is none.

    References:
        ISO 230-6:2002.

    Example:
        >>> from volid.io import read_machine
        >>> plan = diagonals(read_machine("models/wYXbZt_vertical.toml"), n=21)
        >>> plan.n_readings, list(plan.sets[0].options["lines"])[:5]
        (420, ['PPP', 'NPP', 'PNP', 'PPN', 'XY_PP'])
    """
    checked_count("n", n, 2, LARGEST)
    if checked_number("height", height, least=0.0) > 1.0:
        raise InputError(f"`height={height:g}`: expected a share of the travel, 0 to 1")
    checked_count("runs", runs, 1, LARGEST)
    ask_plan("diagonals", 20 * n * runs)
    share, corners = np.linspace(0.0, 1.0, n), _Corners(machine)
    lines = [_Line(name, corners.between(name, share)) for name in BODY]
    lines += [line for a, b in combinations(LINEAR_AXES, 2) if faces for line in corners.face(a + b, share, height)]
    return _plan(machine, "Diagonals", lines, _Way((tool,), u, runs))


def step_diagonals(
    machine: Machine, n: int = 10, tool: Sequence[float] = TOOL, *, runs: int = 1, u: float = U
) -> Campaign:
    """Plan of sequential step diagonals: along the four body diagonals in steps of X, then Y, then Z, each an n-th of its travel.

    The tool stops after each step, at 3 n positions after the first, and goes back the same way. A flat mirror on the tool, whose
    tilt against the beam is unknown (`misalignment = true`), stays in the beam beside the diagonal.

    Args:
        machine: A machine with the linear axes X, Y, Z.
        n: Number of steps of each axis.
        tool: Tool vector to the point of the mirror that the beam meets in the first row, (x, y, z) [mm].
        runs: How often each diagonal is measured there and back.
        u: Standard uncertainty of a displacement [mm].

    Returns:
        A campaign with one `projection` set without readings, of four lines of 2 (3 n + 1) rows a run.

    Raises:
        InputError: the machine lacks a linear axis, or a number is none.

    References:
        ISO 230-6:2002 (the diagonals); M. A. V. Chapman, Precision Engineering 27 (2003) 401 (what mirror and rotations do).

    Example:
        >>> from volid.io import read_machine
        >>> step_diagonals(read_machine("models/wYXbZt_vertical.toml"), n=10).n_readings
        248
    """
    checked_count("n", n, 1, LARGEST)
    checked_count("runs", runs, 1, LARGEST)
    ask_plan("step diagonals", 8 * (3 * n + 1) * runs)
    steps = np.arange(3 * n + 1)
    shares = np.stack([(steps + 2 - i) // 3 for i in range(3)], axis=1) / n  # of X, Y, Z
    corners = _Corners(machine)
    lines = [_Line(name, corners.between(name, shares)) for name in BODY]
    return _plan(machine, "Step diagonals", lines, _Way((tool,), u, runs), mirror="flat", misalignment=True)


def parallel_lines(
    machine: Machine,
    n: int = 11,
    tools: Sequence[Sequence[float]] = (TOOL,),
    *,
    lines: int = 4,
    runs: int = 1,
    u: float = U,
) -> Campaign:
    """Plan of displacements along every linear axis, on parallel lines at the corners of the face across it, there and back.

    Args:
        machine: A machine with the linear axes X, Y, Z.
        n: Number of positions of a line, both ends included.
        tools: Tool vectors to the apex of the reflector, each of which measures all lines, shape (k, 3) [mm].
        lines: Lines of every axis, 1 to 4; one goes through the middle of the other travels, more are corners of the face.
        runs: How often each line is measured there and back; ISO 230-2 asks for five.
        u: Standard uncertainty of a displacement [mm].

    Returns:
        A campaign with one `projection` set without readings, of 3 k · `lines` lines of 2 n rows a run.

    Raises:
        InputError: the machine lacks a linear axis, or a number is none.

    Example:
        >>> from volid.io import read_machine
        >>> plan = parallel_lines(read_machine("models/wYXbZt_vertical.toml"), n=11)
        >>> plan.n_readings, list(plan.sets[0].options["lines"])[:3]
        (264, ['X_1', 'X_2', 'X_3'])
    """
    checked_count("n", n, 2, LARGEST)
    checked_count("lines", lines, 1, 4)
    checked_count("runs", runs, 1, LARGEST)
    ask_plan("parallel lines", 24 * n * max(len(tools), 1) * runs)
    share, corners, found = np.linspace(0.0, 1.0, n), _Corners(machine), []
    places = np.array([(0.5, 0.5)] if lines == 1 else list(product((0.0, 1.0), repeat=2)))
    for axis in LINEAR_AXES:
        for number, place in enumerate(places[:lines], start=1):
            found.append(_Line(f"{axis}_{number}", corners.along(axis, place, share)))
    return _plan(machine, "Parallel lines", found, _Way(tools, u, runs))


class _Corners:
    """Positions in the box of the travels of X, Y, Z. Raises `InputError` for a machine that lacks one of them."""

    def __init__(self, machine: Machine) -> None:
        missing = [a for a in LINEAR_AXES if a not in machine.letters]
        if missing:
            raise InputError(f"machine '{machine.name}' has no axis {missing[0]}; diagonals need X, Y and Z")
        self.machine = machine
        self.columns = [machine.index(a) for a in LINEAR_AXES]
        self.low, self.high = np.array([machine.axes[i].travel for i in self.columns]).T

    def at(self, shares: np.ndarray) -> np.ndarray:
        """Positions (m, n_axes) at shares (m, 3) of the travels of X, Y, Z."""
        still = [0.0 if a.is_linear else min(max(0.0, a.travel[0]), a.travel[1]) for a in self.machine.axes]
        positions = np.tile(still, (len(shares), 1))
        positions[:, self.columns] = self.low + shares * (self.high - self.low)
        return round_position(positions)

    def between(self, senses: str, share: np.ndarray) -> np.ndarray:
        """Along a body diagonal: `senses` of X, Y, Z; `share` (m,) of the way, or (m, 3) axis by axis."""
        shares = np.broadcast_to(share[:, None] if share.ndim == 1 else share, (len(share), 3))
        return self.at(np.where([s == "P" for s in senses], shares, 1.0 - shares))

    def face(self, letters: str, share: np.ndarray, height: float) -> Iterator[_Line]:
        """The two diagonals of a plane, the third axis at `height` of its travel."""
        for senses in BOTH:
            shares = np.full((len(share), 3), height)
            for letter, sense in zip(letters, senses, strict=True):
                shares[:, LINEAR_AXES.index(letter)] = share if sense == "P" else 1.0 - share
            yield _Line(f"{letters}_{senses}", self.at(shares))

    def along(self, axis: str, place: np.ndarray, share: np.ndarray) -> np.ndarray:
        """Along an axis, the others at shares of their travels."""
        shares = np.empty((len(share), 3))
        own = LINEAR_AXES.index(axis)
        shares[:, own] = share
        shares[:, [i for i in range(3) if i != own]] = place
        return self.at(shares)


def _plan(machine: Machine, title: str, lines: Sequence[_Line], way: _Way, **options: object) -> Campaign:
    """The lines there and back, with every tool vector."""
    ask_tools(machine, way.tools)
    ask_uncertainty("u", way.u)
    vectors = np.asarray(way.tools, dtype=float).reshape(-1, 3)
    parts, described = [], {}
    for k, tool in enumerate(vectors):
        for line in lines:
            name = line.name if len(vectors) == 1 else f"{line.name}_T{k + 1}"
            ends = nominal_point(machine, line.positions[[0, -1]], tool)
            described[name] = [round(float(c), 9) for c in _unit(ends[1] - ends[0])]
            parts += [_readings(name, line.positions, tool, run) for run in range(1, way.runs + 1)]
    positions, directions, names, vectors, runs = (np.concatenate(p) for p in zip(*parts, strict=True))
    readings = ObservationSet(
        name=title.lower(),
        kind="projection",
        positions=positions,
        directions=directions,
        tool=vectors,
        readings=np.full((len(positions), 1), np.nan),
        u=np.full((len(positions), 1), way.u),
        labels={"line": names, "run": runs, "segment": np.full(len(names), "1")},
        options={**PROJECTION.options, "lines": described, "u": way.u, **options},
        source=f"{title.lower()} plan",
    )
    return Campaign(machine, (), (readings,), title, source=f"{title.lower()} plan")


def _unit(vector: np.ndarray) -> np.ndarray:
    return np.asarray(vector / np.linalg.norm(vector))


def _readings(name: str, there: np.ndarray, tool: np.ndarray, run: int) -> tuple[np.ndarray, ...]:
    """Positions, directions, names, tool vectors and runs of a line there and back; rows are approached as the line goes."""
    positions = np.concatenate([there, there[::-1]])
    senses = np.sign(there[-1] - there[0])
    directions = np.concatenate([np.tile(senses, (len(there), 1)), np.tile(-senses, (len(there), 1))])
    m = len(positions)
    return positions, directions, np.full(m, name), np.tile(tool, (m, 1)), np.full(m, str(run))
