"""Unknowns of rows of one set in one placement of an artefact: placement, scale, calibration and depths, with their constants.

The rows of `slots` are three rotations, three shifts, the scale where there is one, calibration unknowns and depths; those of
`constants` the nominal centre (3), the point from there (3), and what every calibration unknown and depth does (3 each).
"""

from __future__ import annotations

import numpy as np

from volid.campaign import Campaign, ObservationSet
from volid.exceptions import InputError
from volid.model.machine import TOOL
from volid.observations.artefact_places import Place, Rows, body_name, motions, owner_of
from volid.observations.base import NuisanceTable
from volid.observations.response import Linear
from volid.observations.stations import Seen

SCALE_SPREAD = 1e-5  # of a virtual artefact whose scale is unknown
DEPTH_SPREAD = 0.01  # mm, of the depth at which a virtual probe finds a hole


class Unknowns:
    """Rows of one set in one placement, with the numbers and constants of their unknowns."""

    def __init__(self, observations: ObservationSet, campaign: Campaign, artefact: str, placement: str) -> None:
        self.observations = observations
        self.rows = Rows(observations, campaign.machine, artefact, placement)
        self.owner = owner_of(observations, artefact)
        self.place = Place(campaign, self.owner, placement)
        effects = [f.effect for f in self.rows.calibration.factors]
        self.effects = np.stack(effects) if effects else np.zeros((0, len(self.rows.centred), 3))
        self.acting = [np.flatnonzero(self.effects[:, i].any(axis=1)) for i in range(len(self.rows.centred))]

    @property
    def n_factors(self) -> int:
        """The largest number of calibration unknowns that act on one point."""
        return max(map(len, self.acting), default=0)

    def fill(self, table: NuisanceTable, scale: bool, slots: np.ndarray, constants: np.ndarray) -> None:
        """Write the columns of these rows."""
        at, turn = self.rows.rows, self.place.rotation
        slots[:6, at] = np.array(self.place.slots(self.observations, at, table))[:, None]
        constants[:3, at] = self.place.centre[:, None]
        constants[3:6, at] = (self.rows.arms @ turn.T).T
        if scale:
            slots[6, at] = self._scale(table)
        self._fill_factors(table, slots[6 + scale :], constants[6:])
        depths = int(np.count_nonzero(~self.rows.measured))
        if depths:
            self._fill_depths(table, slots[-depths:], constants[-3 * depths :])

    def _fill_factors(self, table: NuisanceTable, slots: np.ndarray, constants: np.ndarray) -> None:
        """Calibration unknowns of every point; where a point has fewer than others, one of the placement times 0."""
        turn = self.place.rotation
        slots[:, self.rows.rows] = self.place.slots(self.observations, self.rows.rows, table)[0]
        own = {
            k: self._factor(k, table) for k in sorted({k for i in self.rows.points for k in self.acting[i].tolist()})
        }
        for row, point in zip(self.rows.rows, self.rows.points, strict=True):
            for j, k in enumerate(self.acting[point].tolist()):
                slots[j, row] = own[k]
                constants[3 * j : 3 * j + 3, row] = turn @ self.effects[k, point]

    def _fill_depths(self, table: NuisanceTable, slots: np.ndarray, constants: np.ndarray) -> None:
        """Unknown depths along the calibrated coordinates that do not count."""
        own, at, answers = self.observations, self.rows.rows, self._depth_answers()
        for j, axis in enumerate(np.flatnonzero(~self.rows.measured)):
            constants[3 * j : 3 * j + 3, at] = self.place.rotation[:, axis, None]
            for i, row in enumerate(at):
                number, letter = int(row) + 1 if own.rows is None else int(own.rows[row]), "XYZ"[axis]
                key, name = ("depth", own.name, str(number), letter), f"depth {own.name} row {number} {letter}"
                response = Linear(body_name(own), constant=tuple(answers[i, axis].tolist()))
                slots[j, row] = table.index(key, name, spread=DEPTH_SPREAD, response=response)

    def _depth_answers(self) -> np.ndarray:
        """How depths follow a motion of the body as far as the placement does not, along the axes of the artefact, (m, 3, 9)."""
        own, place, at = self.observations, self.place, self.rows.rows
        tool = np.array(Seen(own, place.campaign, at, body_name(own), TOOL).tool)
        arms = self.rows.arms @ place.rotation.T
        follows = motions(arms, np.eye(3))[:, :, [3, 4, 5, 0, 1, 2]] @ place.answers(tool)
        return np.einsum("ji,mjk->mik", place.rotation, motions(arms + place.centre, tool) - follows)

    def _scale(self, table: NuisanceTable) -> int:
        u = float(self.observations.options["scale_u"])
        key, name = ("scale of artefact", *self.owner), f"scale of artefact {self.owner[1]}"
        return _agreeing(self.observations, table, table.index(key, name, "1", prior_u=u, spread=SCALE_SPREAD), u)

    def _factor(self, k: int, table: NuisanceTable) -> int:
        factor = self.rows.calibration.factors[k]
        key = ("calibration", *self.owner, str(k + 1))
        name = factor.name if self.owner[0] == "artefact" else f"{factor.name} of {self.owner[1]}"
        return _agreeing(self.observations, table, table.index(key, name, prior_u=factor.u), factor.u)


def _agreeing(observations: ObservationSet, table: NuisanceTable, number: int, u: float) -> int:
    """The number of an unknown. Raises `InputError` where another set states another u of it."""
    entry = table.entries[number]
    if entry.prior_u != u:
        raise InputError(
            f"set '{observations.name}': u of '{entry.name}' is {u:g} here and {entry.prior_u:g} in another set; expected the "
            "same in all sets, or another name for another artefact"
        )
    return number
