"""A field measured point by point, as spatial grids without any kinematic hypothesis (ISO/TR 16907 9.3.1).

The deviations of `measured_points`, interpolated by `process` with the u of readings and interpolation, at the nodes of one grid
for each measured tool vector. Frame: the machine's, with the rigid motion that fits all measured places of all tool vectors best
taken out once. So what a rotation of the whole takes up, such as a part of squareness errors, is not in the values; what differs
between tool vectors is. Rotations are not measured and blank: a grid holds for its tool vector and no other. Nodes outside what
was measured (the convex hull of the places) are blank.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from volid.backend.even_points import evenly, every_step
from volid.campaign import Campaign
from volid.compensation.grids.grid import Grid
from volid.compensation.grids.interpolation import grid_positions
from volid.compensation.measured.points import MeasuredPoints, measured_points
from volid.compensation.measured.process import FEWEST, Process, Scale, smoothness_of
from volid.exceptions import InputError
from volid.model.iso230 import LINEAR_AXES
from volid.model.jacobian import rigid_motion_rows

if TYPE_CHECKING:
    from jaxtyping import Bool, Float

POINTS = 11  # nodes per axis
MOST_NODES = 200_000
SLACK = 1e-6  # ranges: nodes on the border of the hull are in it
AT_ONCE = 1000  # nodes
TYPE = "L-VOL"
FRAME = (
    "machine; the workpiece frame placed by least squares on all {places} measured places of all tool vectors: what a rigid "
    "motion of the workpiece takes up is not in the values"
)
NOTES = (
    "a measured field without kinematic model: rotations are blank, valid for this tool vector only",
    "u contains readings and interpolation; the mean of both approach directions where both were measured",
)


@dataclass(frozen=True, eq=False)
class MeasuredField:
    """Deviations of the functional point at any place among the measured ones, with u; `measured_field` makes it.

    Args:
        points: The measured places.
        title: Title of the campaign.

    >>> import numpy as np
    >>> import volid
    >>> machine = volid.load_machine("models/wYXbZt_vertical.toml")
    >>> q, tool = np.random.default_rng(1).uniform(0.0, 300.0, (20, 3)), np.tile([0.0, 0.0, -150.0], (20, 1))
    >>> points = MeasuredPoints(machine, q, tool, np.zeros((20, 3)), 1e-6 * np.eye(60), np.zeros(20, dtype=int), ("T",))
    >>> MeasuredField(points).tools.tolist()
    [[0.0, 0.0, -150.0]]
    """

    points: MeasuredPoints
    title: str = ""

    @cached_property
    def scale(self) -> Scale:
        """The axes that vary, and their ranges."""
        return Scale.of(self.points.positions)

    @cached_property
    def process(self) -> Process:
        """The interpolation."""
        return Process(self.points, self.scale, smoothness_of(self.points, self.scale))

    @property
    def tools(self) -> Float[np.ndarray, "t 3"]:
        """Tool vectors with enough places for a field, that of most places first [mm]."""
        return np.array([t for t in self.points.tools if len(self.points.with_tool(t)) >= FEWEST]).reshape(-1, 3)

    @property
    def frame(self) -> str:
        """The frame of the values, in words."""
        return FRAME.format(places=len(self.points))

    @property
    def attention(self) -> tuple[str, ...]:
        """Axes and components whose interpolation is not to be relied upon because positions stand too far apart, in words."""
        letters = [self.points.machine.letters[i] for i in self.scale.columns]
        ends = [a for a, x in zip(letters, self.process.x.T, strict=True) if np.ptp(np.abs(x)) < SLACK]
        blind = tuple(
            f"{a} was measured at two positions only: between them the field is not seen, and values and u follow from how large "
            "the functions of the other axes are; measure more positions"
            for a in ends
        )
        return blind + tuple(
            f"between the positions of {letters[s.axis]} the field is not seen: {name} of positions held out is missed by "
            f"{s.factor:.1f} times its u, by which u is enlarged; measure more positions, or scattered ones"
            for name, s in zip("XYZ", self.process.smooth, strict=True)
            if s.factor > 1.0
        )

    def inside(self, positions: Float[np.ndarray, "k axes"], tool: Sequence[float]) -> Bool[np.ndarray, " k"]:
        """Whether places lie within the convex hull of those that were measured with a tool vector, (k,)."""
        from scipy.spatial import ConvexHull

        own = self.scale(self.points.positions[self.points.with_tool(np.asarray(tool, dtype=float))])
        x = self.scale(np.asarray(positions, dtype=float))
        still = [i for i in range(self.points.positions.shape[1]) if i not in self.scale.columns]
        at = np.abs(np.asarray(positions)[:, still] - self.points.positions[0, still]).max(axis=1, initial=0.0) < 1e-3
        if own.shape[1] == 1:
            return np.asarray(at & (x[:, 0] >= own.min() - SLACK) & (x[:, 0] <= own.max() + SLACK))
        faces = ConvexHull(own, qhull_options="QJ").equations
        return np.asarray(at & (x @ faces[:, :-1].T + faces[:, -1] <= 10.0 * SLACK).all(axis=1))

    def at(
        self, positions: Float[np.ndarray, "k axes"], tool: Sequence[float]
    ) -> tuple[Float[np.ndarray, "k 3"], Float[np.ndarray, "k 3"]]:
        """Deviations and their standard uncertainty (k, 3) [mm], also outside what was measured.

        Args:
            positions: Axis positions, machine axis order, shape (k, n_axes) [mm or degrees].
            tool: A measured tool vector, (3,) [mm].

        Raises:
            InputError: nothing, or too little, was measured with this tool vector.
        """
        vector, q = self._asked(tool), np.atleast_2d(np.asarray(positions, dtype=float))
        parts = [np.zeros((2, 0, 3))]
        for start in range(0, len(q), AT_ONCE):
            chunk = q[start : start + AT_ONCE]
            rows = rigid_motion_rows(self.points.machine, chunk, vector)[:, :3]
            parts.append(np.array(self.process.at(chunk, vector, rows)))
        values, u = np.concatenate(parts, axis=1)
        return values, u

    def _asked(self, tool: Sequence[float]) -> np.ndarray:
        vector = np.asarray(tool, dtype=float)
        if len(self.points.with_tool(vector)) < FEWEST:
            named = "; ".join(", ".join(f"{c:g}" for c in t) for t in self.tools) or "none"
            raise InputError(
                f"`tool={','.join(f'{c:g}' for c in vector)}`: {len(self.points.with_tool(vector))} places were measured with "
                "it; "
                f"expected a tool vector with at least {FEWEST} places: {named}"
            )
        return vector

    def grid(
        self,
        tool: Sequence[float] | None = None,
        *,
        step: float | None = None,
        points: int | None = None,
        keep_outside: bool = False,
    ) -> Grid:
        """The field of one tool vector as a spatial grid over the axes that were moved, between their measured ends.

        Args:
            tool: A measured tool vector, (3,) [mm]; the one with most places by default.
            step: Distance between the nodes of an axis [mm].
            points: Nodes per axis where no step is given; 11 by default.
            keep_outside: Whether nodes outside what was measured hold extrapolated values, flagged, instead of being blank.

        Raises:
            InputError: nothing was measured with the tool vector, or the nodes make no grid.
        """
        vector = self._asked(self.tools[0] if tool is None and len(self.tools) else tool or (0.0, 0.0, 0.0))
        machine, own = self.points.machine, self.points.positions[self.points.with_tool(vector)]
        axes = tuple(a for a in LINEAR_AXES if a in machine.letters and machine.index(a) in self.scale.columns)
        nodes = tuple(_nodes(own[:, machine.index(a)], step, points) for a in axes)
        if np.prod([float(len(n)) for n in nodes]) > MOST_NODES:
            raise InputError(f"more than {MOST_NODES} nodes; take a larger step or fewer points")
        places = grid_positions(nodes)
        q = np.tile(own[0], (len(places), 1))
        q[:, [machine.index(a) for a in axes]] = places
        inside = self.inside(q, vector.tolist())
        values, u = (np.full((len(q), 6), np.nan) for _ in range(2))
        asked = np.ones(len(q), dtype=bool) if keep_outside else inside
        values[asked, :3], u[asked, :3] = self.at(q[asked], vector.tolist())
        x, y, z = vector.tolist()
        held = [f"{a.letter} = {own[0, i]:g}" for i, a in enumerate(machine.axes) if a.letter not in axes]
        notes = (*NOTES, *([f"measured at {', '.join(held)}"] if held else []))
        return Grid(TYPE, axes, nodes, places, values, u, ~inside, (x, y, z), "machine", self.frame, notes)


def _nodes(positions: np.ndarray, step: float | None, points: int | None) -> np.ndarray:
    low, high = float(positions.min()), float(positions.max())
    if step is not None:
        if not step > 0.0:
            raise InputError(f"`step={step:g}`: expected a distance above 0")
        return every_step(low, high, step)
    if points is not None and points < 2:
        raise InputError(f"`points={points}`: expected at least 2 per axis")
    return evenly(low, high, points or POINTS)


def measured_field(campaign: Campaign) -> MeasuredField:
    """The field of a campaign's measured places: tracker points, or distances from at least four stations to the same places.

    Args:
        campaign: A campaign with sets of kind `point` (also polar) or `distance`.

    Raises:
        InputError: nothing gives coordinates, no tool vector has enough places, or the places lie on one line.

    Source: ISO/TR 16907:2015 9.3.1.

    >>> import numpy as np
    >>> import volid
    >>> machine = volid.load_machine("models/wYXbZt_vertical.toml")  # axes Y, X, Z
    >>> q = np.random.default_rng(1).uniform([0, 0, -400], [400, 500, 0], (30, 3))
    >>> tool, still = np.tile([0.0, 0.0, -150.0], (30, 1)), np.zeros((30, 3))
    >>> read, labels = q[:, [1, 0, 2]] + tool, {"station": np.full(30, "T")}
    >>> points = volid.ObservationSet("tracker", "point", q, still, tool, read, still + 0.001, labels)
    >>> field = measured_field(volid.Campaign(machine, (volid.Station("T"),), (points,)))
    >>> values, u = field.at(q[:5], (0.0, 0.0, -150.0))
    >>> bool(np.abs(values).max() < 1e-6), bool((u < 0.001).all())
    (True, True)
    """
    found = MeasuredField(measured_points(campaign), campaign.title)
    if not len(found.tools):
        most = len(found.points.with_tool(found.points.tools[0]))
        raise InputError(
            f"{campaign.source or 'campaign'}: at most {most} places were measured with one tool vector; a field needs {FEWEST}"
        )
    return found
