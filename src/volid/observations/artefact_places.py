"""Where an artefact stands: its nominal place from the axis positions, and what of its placement is unknown.

The nominal place is the rigid motion that best carries the calibrated points onto the nominal functional points (Kabsch, Acta
Cryst. A32 (1976) 922), turned by any angle; the unknown rotation and shift count from there.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from volid.campaign import Campaign, ObservationSet
from volid.exceptions import InputError
from volid.model.geometry import RigidMotion, best_rigid_motion, skew
from volid.model.kinematics import nominal_point, nominal_rotation
from volid.model.machine import BED, TOOL, WORKPIECE, Machine
from volid.observations.base import NuisanceTable
from volid.observations.calibration import Calibration, calibration_of
from volid.observations.response import (
    MOTIONS,
    Key,
    Linear,
    PlaceOf,
    Remainder,
    Response,
    TurnOf,
    TurnOfLine,
    remainder,
)
from volid.observations.stations import Seen

UNNAMED = "1"  # artefact of a set that names none: its own
TURN_SPREAD, SHIFT_SPREAD = (
    1e-4,
    0.02,
)  # rad, mm: how far a virtual artefact is off its nominal place once it is aligned
_TURNS = (
    "the new datum turns what the artefact of set '{name}' stands on, and its readings are deviations along the machine's "
    "nominal directions. Give the axis positions at which the centres were found instead (centres = true), or fit in that datum: "
    "[datum] of the machine file"
)
UNKNOWNS = (("turn", "ABC"), ("shift", "XYZ"))
LEVER = 1e-6  # mm: what moves readings by less per unit, beside the other unknowns, moves none
SAME_DEPTH = (
    0.05  # mm: places in holes that differ by less do not tell the tilt of a plate; 1 mrad of it is then 0.05 µm
)


def owner_of(observations: ObservationSet, artefact: str) -> tuple[str, str]:
    """What an artefact's unknowns belong to: an artefact without a name belongs to its set."""
    return ("set", observations.name) if artefact == UNNAMED else ("artefact", artefact)


def body_name(observations: ObservationSet) -> str:
    """What the artefacts of a set stand on."""
    return str(observations.options.get("body", WORKPIECE))


def body_of(observations: ObservationSet, machine: Machine) -> int:
    """Number of the body that the artefacts of a set stand on. Raises `InputError` for one that the machine has not."""
    body = body_name(observations)
    known = (WORKPIECE, BED, *machine.letters)
    if body not in known:
        raise InputError(
            f"set '{observations.name}': body is '{body}'; expected what the artefact stands on, one of {', '.join(known)}"
        )
    return machine.body_index(body)


def found_places(observations: ObservationSet, machine: Machine, positions: np.ndarray | None = None) -> np.ndarray:
    """Nominal functional points moved by the readings, in the frame of the body, (m, 3) [mm]; `positions` instead of its own."""
    positions, body = observations.positions if positions is None else positions, body_of(observations, machine)
    return nominal_point(machine, positions, observations.tool, body) + readings_on_body(
        observations, machine, positions
    )


def readings_on_body(observations: ObservationSet, machine: Machine, positions: np.ndarray) -> np.ndarray:
    """Readings in the frame of the body, (m, 3) [mm]; 0 in a plan."""
    turn = nominal_rotation(machine, positions, machine.body_index(BED), body_of(observations, machine))
    return np.einsum("mij,mj->mi", turn, np.nan_to_num(observations.readings))


class Rows:
    """Rows of one set that belong to one placement of one artefact."""

    def __init__(self, observations: ObservationSet, machine: Machine, artefact: str, placement: str) -> None:
        self.observations, self.machine = observations, machine
        self.calibration: Calibration = calibration_of(observations, artefact)
        labels = observations.labels
        self.rows = np.flatnonzero((labels["artefact"] == artefact) & (labels["placement"] == placement))
        self.points = self.calibration.numbers(labels["point"][self.rows])

    @property
    def measured(self) -> np.ndarray:
        """Calibrated coordinates that count, bool (3,)."""
        return np.array([c in str(self.observations.options.get("components", "XYZ")) for c in "XYZ"])

    @property
    def arms(self) -> np.ndarray:
        """Calibrated points from the mean of all of them, frame of the artefact, (m, 3) [mm]."""
        return self.centred[self.points]

    @property
    def centred(self) -> np.ndarray:
        """All calibrated points from their mean, (n, 3) [mm]."""
        return np.asarray(self.calibration.coordinates - self.calibration.coordinates.mean(axis=0))

    def nominal(self, readings: bool) -> np.ndarray:
        """Nominal functional points in the frame of the body, (m, 3) [mm]; with `readings`, the places found."""
        own = self.observations
        if readings:
            return found_places(own, self.machine)[self.rows]
        return nominal_point(self.machine, own.positions[self.rows], own.tool[self.rows], body_of(own, self.machine))


class Place:
    """One placement of an artefact, with the rows of all sets of a campaign that name it."""

    def __init__(self, campaign: Campaign, owner: tuple[str, str], placement: str) -> None:
        self.campaign, self.owner, self.placement = campaign, owner, placement
        self.parts = [
            Rows(s, campaign.machine, artefact, placement)
            for s in campaign.sets
            if s.kind == "artefact"
            for artefact in dict.fromkeys(s.labels["artefact"].tolist())
            if owner_of(s, artefact) == owner and placement in s.labels["placement"][s.labels["artefact"] == artefact]
        ]
        self._check()

    def _check(self) -> None:
        """Raises `InputError` where sets contradict each other."""
        first = self.parts[0]
        for other in self.parts[1:]:
            where = f"set '{other.observations.name}': artefact '{self.owner[1]}'"
            of, own = other.calibration, first.calibration
            if of.points != own.points or not np.array_equal(of.coordinates, own.coordinates):
                raise InputError(
                    f"{where} has other calibrated points than in set '{first.observations.name}'; expected the same, or another "
                    "name for another artefact"
                )
            if [f.u for f in of.factors] != [f.u for f in own.factors]:
                raise InputError(
                    f"{where} has another calibration uncertainty than in set '{first.observations.name}'; expected the same"
                )
            if body_of(other.observations, self.campaign.machine) != body_of(first.observations, self.campaign.machine):
                raise InputError(
                    f"{where} stands on another body than in set '{first.observations.name}'; give the placement another name"
                )

    @property
    def _keys(self) -> tuple[Key, ...]:
        """Keys of its rotations and shifts."""
        return tuple((what, *self.owner, self.placement, c) for what, letters in UNKNOWNS for c in letters)

    @cached_property
    def rotation(self) -> np.ndarray:
        """R0, from the frame of the artefact to that of the body, (3, 3)."""
        return np.asarray(self._motion(False).rotation)

    @cached_property
    def centre(self) -> np.ndarray:
        """Nominal place of the mean of the calibrated points, frame of the body, (3,) [mm]."""
        return np.asarray(self._motion(False).translation)

    def _motion(self, readings: bool) -> RigidMotion:
        return best_rigid_motion(self._arms, np.concatenate([part.nominal(readings) for part in self.parts]))

    @property
    def whole(self) -> bool:
        """Whether all calibrated coordinates count."""
        return all(bool(part.measured.all()) for part in self.parts)

    @cached_property
    def _arms(self) -> np.ndarray:
        return np.concatenate([part.arms for part in self.parts])

    @cached_property
    def _design(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """∂(measured places)/∂(rotations, shifts) (3m, 6), what is measured of each (m, 3, 3), and the sizes of the columns."""
        r = self.rotation
        seen = np.concatenate(
            [np.tile(r @ np.diag(part.measured.astype(float)) @ r.T, (len(part.rows), 1, 1)) for part in self.parts]
        )
        turned = seen @ skew(self._arms @ r.T).transpose(0, 2, 1)
        design = np.concatenate([turned, seen], axis=2).reshape(-1, 6)
        return design, seen, np.linalg.norm(design, axis=0)

    @cached_property
    def moves(self) -> np.ndarray:
        """Which of three rotations and three shifts are unknown, bool (6,): those that do to readings what no other does.

        The others are held at 0: the roll of a beam, or the tilt of a plate whose holes were probed at any depth.
        """
        design, _, sizes = self._design
        least = LEVER if self.whole else SAME_DEPTH * np.sqrt(len(self._arms))
        moves, kept = np.zeros(6, dtype=bool), np.zeros((len(design), 0))
        for k in (*(3 + np.argsort(-sizes[3:], kind="stable")), *np.argsort(-sizes[:3], kind="stable")):
            left = design[:, k] - kept @ np.linalg.lstsq(kept, design[:, k], rcond=1e-9)[0]
            moves[k] = np.linalg.norm(left) > least
            kept = np.column_stack([kept, design[:, k]]) if moves[k] else kept
        return moves

    def starts(self) -> dict[Any, float]:
        """Rotation and shift that the readings give by the same rigid motion."""
        found = self._motion(True)
        values = found.rotation @ self.rotation.T
        turn = values - values.T  # Cayley's transform: o = 2 tan(θ/2) along the axis, (R - Rᵀ) / (1 + tr R) · 2
        rotation = 2.0 * np.array([turn[2, 1], turn[0, 2], turn[1, 0]]) / (1.0 + np.trace(values))
        vectors = np.concatenate([rotation, found.translation - self.centre])
        return {key: float(v) for key, v, moved in zip(self._keys, vectors, self.moves, strict=True) if moved}

    def slots(self, part: ObservationSet, rows: np.ndarray, table: NuisanceTable) -> list[int]:
        """Numbers of its rotations and shifts, which a change of datum moves as the body that it stands on."""
        name, responses = f"{self.owner[1]} placement {self.placement}", self._responses(part, rows)
        found = []
        for i, c in enumerate("ABCXYZ"):
            unit, spread = ("rad", TURN_SPREAD) if i < 3 else ("mm", SHIFT_SPREAD)
            known: dict[str, Any] = {"spread": spread, "response": responses[i]}
            prior = np.inf if self.moves[i] else 0.0
            found.append(table.index(self._keys[i], f"{name} {c}", unit, prior_u=prior, **known))
        return found

    def _responses(self, part: ObservationSet, rows: np.ndarray) -> list[Response]:
        """A beam does not roll when the datum changes, a plate with holes does not tilt; all else moves with its body."""
        body, turns, shifts = body_name(part), self._keys[:3], self._keys[3:]
        seen, centre = Seen(part, self.campaign, rows, body, TOOL), tuple(self.centre.tolist())
        if not self.whole:
            left = [seen.not_followed, self._remainder(part, rows), *[None] * 4]
            answers = self.answers(np.array(seen.tool))
            return [Linear(body, left[i], tuple(row.tolist())) for i, row in enumerate(answers)]
        held = np.flatnonzero(~self.moves[:3])
        along = tuple((self.rotation @ np.linalg.svd(self._arms)[2][0]).tolist())
        kept = self._remainder(part, rows)
        found: list[Response] = [TurnOf(body, kept, turns, i, sense=1.0) for i in range(3)]
        if len(held) == 1:
            found = [TurnOfLine(body, kept, turns, i, along, int(held[0])) for i in range(3)]
        return found + [PlaceOf(body, seen.not_followed, shifts, i, centre, seen.tool, seen.u) for i in range(3)]

    def _remainder(self, part: ObservationSet, rows: np.ndarray) -> Remainder | None:
        """Readings keep the nominal directions of the machine when the body turns: ω × d."""
        gaps = readings_on_body(part, self.campaign.machine, part.positions)[rows]
        change = np.zeros((len(gaps), 3, MOTIONS))
        change[:, :, 3:6] = skew(-gaps)
        return remainder(change.reshape(-1, MOTIONS), part.u[rows].ravel(), _TURNS.format(name=part.name))

    def answers(self, tool: np.ndarray) -> np.ndarray:
        """How rotations and shifts follow motions (t, ω, h) of their body as far as depths do not, first order, (6, 9).

        `tool` (3, 3): what a constant rotation of the tool vectors does to the places found.
        """
        design, seen, _ = self._design
        points = self._arms @ self.rotation.T + self.centre
        moved = np.einsum("mij,mjk->mik", seen, motions(points, tool)).reshape(-1, MOTIONS)
        result = np.zeros((6, MOTIONS))
        result[self.moves] = np.linalg.lstsq(design[:, self.moves], moved, rcond=1e-9)[0]
        return result


def motions(points: np.ndarray, tool: np.ndarray) -> np.ndarray:
    """∂(place)/∂(t, ω, h) of points (m, 3) of a body; `tool` (3, 3): what h does to them, (m, 3, 9)."""
    levers = skew(points).transpose(0, 2, 1)
    return np.concatenate([np.broadcast_to(part, levers.shape) for part in (np.eye(3), levers, tool)], axis=2)


def places_of(campaign: Campaign) -> list[Place]:
    """All placements of a campaign, each once."""
    found: dict[tuple[tuple[str, str], str], None] = {}
    for s in campaign.sets:
        if s.kind == "artefact":
            pairs = zip(s.labels["artefact"].tolist(), s.labels["placement"].tolist(), strict=True)
            found |= {(owner_of(s, artefact), placement): None for artefact, placement in pairs}
    return [Place(campaign, owner, placement) for owner, placement in found]
