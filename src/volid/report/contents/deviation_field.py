"""The deviation field of a report: what a machine does without compensation, and what a control leaves of it, type by type.

Every value is that of the whole kinematic chain at the position to which the control sends the axes,

    left(q) = e(q') + what q' moves nominally against q,    q' the command that tables and grids alter,

of the estimate, mean of both approach directions, in the stated datum. u is that of the deviation without compensation; a control
does not change it, because tables and grids are made from the estimate. Not in it: repeatability, reversal, least increment,
heat.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from volid.compensation.base import Base, base_of
from volid.compensation.control import Control
from volid.compensation.package import Compensation, CompensationRequest, compensation_of
from volid.compensation.residual.fields import moved_by
from volid.compensation.residual.tools import campaign_tools
from volid.exceptions import InputError, NotDeterminedError
from volid.fitting.prediction.deviations import deviation_values
from volid.fitting.prediction.working_volume import spread_positions
from volid.fitting.solution import Solution
from volid.model.jacobian import rigid_motion_rows
from volid.model.kinematics import side_rotation
from volid.model.rigid_fields import WorkpieceMotion
from volid.report.contents.lattice import FEWEST, MOST, Lattice, lattice_of, rotary_places
from volid.report.contents.outlook import lists_of

if TYPE_CHECKING:
    from jaxtyping import Float

TABLES_ALONE = ("L-POS", "L-STR", "L-SQU")  # what a control does that has tables of single axes and nothing else
NONE: tuple[str, ...] = ()
MOST_TOOLS = 3
FEW = 64  # places over the volume, at which a control is asked whether it acts, and does anything
SPREAD = 256  # places over the volume, to which the rigid motion of the workpiece is fitted
BUDGET = 80_000  # nodes over all fields: 0.7 MB in a page
CROWDED = 400  # nodes: with more of them nothing is seen of the inner ones
NOTHING = 1e-8  # mm: a type that changes the field by less everywhere does nothing


@dataclass(frozen=True, eq=False)
class DeviationFields:
    """Deviation fields on a lattice, by tool vector, rotary position and compensation.

    Args:
        lattice: The nodes.
        tools: Tool vectors, shape (k, 3) [mm].
        places: Positions of the rotary axes by letter [degrees].
        states: What is compensated: names of types that act together, the first state without any.
        values: Deviations of the functional point, machine frame, shape (k, places, states, nodes, 3) [mm]; NaN where the data do
            not determine them, and where a state has grids that hold for another tool vector only.
        u: Their standard uncertainties, shape (k, places, nodes, 3) [mm].
        motions: The rigid motion of the workpiece in each field, as fitted over the whole volume: its deviation at X, Y, Z is
            M · (X, Y, Z, 1), M of shape (k, places, states, 3, 4) [mm].
        rigid: For which tool vectors the values are known up to a rigid motion of the workpiece only, shape (k,).
        idle: States that change nothing, because the model has no errors that they correct.
        lost: States that the data do not determine, each with the reason.
    """

    lattice: Lattice
    tools: Float[np.ndarray, "k 3"]
    places: tuple[dict[str, float], ...]
    states: tuple[tuple[str, ...], ...]
    values: Float[np.ndarray, "k p s m 3"]
    u: Float[np.ndarray, "k p m 3"]
    motions: Float[np.ndarray, "k p s 3 4"]
    rigid: np.ndarray
    idle: tuple[tuple[str, ...], ...] = ()
    lost: tuple[tuple[tuple[str, ...], str], ...] = ()

    @property
    def is_known(self) -> bool:
        """Whether any value is determined with the first tool vector, that which was asked for, at the first rotary place."""
        return bool(np.isfinite(self.values[0, 0, 0]).any())

    def largest(self, tool: int, place: int, state: int) -> int:
        """Number of the node at which a field is largest in length; -1 where nothing is determined."""
        size = np.linalg.norm(self.values[tool, place, state], axis=1)
        return int(np.nanargmax(size)) if np.isfinite(size).any() else -1


def deviation_fields(
    solution: Solution,
    tool: Sequence[float],
    states: Sequence[Sequence[str]] | None = None,
    most: int | None = None,
    made: Mapping[str, Compensation] | None = None,
) -> DeviationFields:
    """The deviation field of a solution, before and after each type of compensation.

    Args:
        solution: A solution, as `volid.fit` makes it.
        tool: Tool vector that compensations are based on, and the first one shown, shape (3,) [mm]; others are the campaign's.
        states: Names of types that act together, for each state beside that without any; None: all that the machine can have.
        most: Nodes along the longest axis; None: as many as a page has room for.
        made: Compensations for `tool` that were computed already, by their types joined by " + ".

    Raises:
        InputError: the machine cannot have a type of `states`.

    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/vertical_multilateration/campaign.toml"))
    >>> found = deviation_fields(solution, (0.0, 90.0, -200.0), [["L-VOL"]], most=5)
    >>> found.values.shape, found.states
    ((3, 1, 2, 45, 3), ((), ('L-VOL',)))
    >>> before, after = np.linalg.norm(found.values[0, 0], axis=2).max(axis=1)
    >>> bool(before > 0.05), bool(after < 0.002)
    (True, True)
    """
    base = base_of(solution, tool)
    tools = campaign_tools(solution, np.asarray(tool, dtype=float))[:MOST_TOOLS]
    asked = states_of(solution) if states is None else [tuple(s) for s in states]
    acting, lost = _controls(solution, asked, base, made or {})
    acting, idle = _without_idle(solution, acting, base.tool)
    places = rotary_places(solution.machine)
    lattice = lattice_of(solution.machine, most or _room(solution, len(tools) * len(places) * (1 + len(acting))))
    request = _Request(solution, [Control(solution.machine), *acting.values()], lattice, places)
    values, u, motions, rigid = zip(*(request.fields(t) for t in tools), strict=True)
    return DeviationFields(
        lattice, tools, tuple(places), (NONE, *acting), np.array(values), np.array(u), np.array(motions), np.array(rigid),
        idle, lost,
    )  # fmt: skip


class _Request(NamedTuple):
    """What fields are asked for, whatever the tool vector."""

    solution: Solution
    controls: Sequence[Control]
    lattice: Lattice
    places: Sequence[dict[str, float]]

    def fields(self, tool: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, bool]:
        """Values, u, motions and whether they are rigid, as `DeviationFields` has them, for one tool vector."""
        nodes = np.concatenate([self.lattice.positions(place) for place in self.places])
        volume = spread_positions(
            self.solution.machine, SPREAD
        )  # with the nodes: one long computation is quicker than many
        both = np.concatenate([nodes, volume])
        left = np.array([self._left_by(c, both, tool) for c in self.controls])
        shape = (len(self.places), -1)
        plain = self.solution.evaluate(nodes, tool)
        known = np.asarray(plain.determined[:, :3].all(axis=1))
        values = np.where(known[:, None], left[:, : len(nodes)], np.nan)
        values = np.moveaxis(values.reshape(len(self.controls), *shape, 3), 0, 1)
        motions = WorkpieceMotion(self.solution.machine, volume, tool).motions(np.nan_to_num(left[:, len(nodes) :]))
        rigid = plain.rigid is not None and bool(plain.rigid.any())
        return (
            values,
            plain.u[:, :3].reshape(*shape, 3),
            self._maps(motions, nodes.reshape(*shape, nodes.shape[1]), tool),
            rigid,
        )

    def _left_by(self, acting: Control, positions: np.ndarray, tool: np.ndarray) -> np.ndarray:
        """What a control leaves, (m, 3) [mm]; NaN where open rotations let its grids hold for another tool vector only."""
        try:
            return left_by(self.solution, acting, positions, tool)
        except InputError:
            return np.full((len(positions), 3), np.nan)

    def _maps(self, motions: np.ndarray, nodes: np.ndarray, tool: np.ndarray) -> np.ndarray:
        """M of `DeviationFields`, (places, states, 3, 4), of rigid motions (states, 6)."""
        at = np.column_stack([self.lattice.points, np.ones(nodes.shape[1])])
        maps = []
        for q in nodes:
            moved = np.einsum("mij,sj->msi", rigid_motion_rows(self.solution.machine, q, tool)[:, :3], motions)
            found = np.linalg.lstsq(at, moved.reshape(len(at), -1), rcond=None)[0]
            maps.append(found.T.reshape(len(motions), 3, 4))
        return np.array(maps)


def left_by(
    solution: Solution, acting: Control, positions: Float[np.ndarray, "m axes"], tool: Float[np.ndarray, " 3"]
) -> Float[np.ndarray, "m 3"]:
    """What a control leaves at commanded positions (m, n_axes) [mm or degrees], tool vector (3,): (m, 3) [mm], machine frame."""
    driven = acting.command(positions, tool)
    tools, still = np.broadcast_to(tool, (len(positions), 3)), np.zeros_like(driven)
    there = deviation_values(solution.model, np.asarray(solution.parameters), driven, tools, still)[:, :3]
    before, after = (
        side_rotation(solution.machine, x, True) for x in (positions, driven)
    )  # the table may have been turned
    there = np.einsum("mji,mjk,mk->mi", before, after, there)
    return np.asarray(there + moved_by(solution.machine, positions, driven, tools)[:, :3])


def states_of(solution: Solution) -> list[tuple[str, ...]]:
    """What is compensated in the states that are shown: every type that the machine can have, and types together."""
    single = lists_of(solution)
    together = [TABLES_ALONE] if all((name,) in single for name in TABLES_ALONE) else []
    place = 1 + single.index(TABLES_ALONE[-1:]) if together else 0
    return [*single[:place], *together, *single[place:]]


_Controls = dict[tuple[str, ...], Control]


def _controls(
    solution: Solution, states: Iterable[tuple[str, ...]], base: Base, made: Mapping[str, Compensation]
) -> tuple[_Controls, tuple[tuple[tuple[str, ...], str], ...]]:
    """A control for every state that the data determine; the other states, with the reason."""
    request, found, lost = CompensationRequest(base, uncertainty=False), {}, []
    for names in states:
        try:
            acting = made.get(" + ".join(names)) or compensation_of(solution, names, request)
        except NotDeterminedError as error:
            lost.append((names, str(error)))
            continue
        control = acting.control(solution.machine)
        reason = _refusal(control, base.tool)
        if reason:
            lost.append((names, reason))
        else:
            found[names] = control
    return found, tuple(lost)


def _refusal(acting: Control, tool: np.ndarray) -> str:
    """Why a control cannot act over the volume with a tool vector, values of its grids being blank; "" where it can."""
    try:
        acting.command(spread_positions(acting.machine, FEW), tool)
    except InputError as error:
        return str(error)
    return ""


def _without_idle(
    solution: Solution, acting: _Controls, tool: np.ndarray
) -> tuple[_Controls, tuple[tuple[str, ...], ...]]:
    """The controls that change any command over the volume, and the states of those that do not, or only as another one does."""
    q = spread_positions(solution.machine, FEW)
    kept: _Controls = {}
    commands: list[np.ndarray] = [q]
    for names, control in acting.items():
        command = control.command(q, tool)
        if all(np.abs(command - other).max() > NOTHING for other in commands):
            kept[names] = control
            commands.append(command)
    return kept, tuple(names for names in acting if names not in kept)


def _room(solution: Solution, fields: int) -> int:
    """Nodes along the longest axis, so few that they can be told from each other, and all fields fit into a page."""
    most = min(CROWDED, BUDGET // fields)
    sizes = range(MOST, FEWEST, -1)
    return next((n for n in sizes if np.prod(lattice_of(solution.machine, n).shape) <= most), FEWEST)
