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
from volid.model.geometry import best_rigid_motion, skew
from volid.model.kinematics import nominal_point
from volid.model.machine import TOOL, Machine
from volid.observations.base import NuisanceTable
from volid.observations.calibration import Calibration, calibration_of
from volid.observations.response import Key, PlaceOf, TurnOf
from volid.observations.stations import Seen

UNNAMED = "1"  # artefact of a set that names none: its own
TURN_SPREAD, SHIFT_SPREAD = 3e-4, 0.05  # rad, mm: how far a virtual artefact is off its nominal place
LEVER = 1e-6  # mm: what moves readings by less per unit, beside the other unknowns, moves none


def owner_of(observations: ObservationSet, artefact: str) -> tuple[str, str]:
    """What an artefact's unknowns belong to: an artefact without a name belongs to its set."""
    return ("set", observations.name) if artefact == UNNAMED else ("artefact", artefact)


def said_of(owner: tuple[str, str]) -> str:
    """An artefact in names of its unknowns: its own name, or that of its set."""
    return owner[1]


def body_of(observations: ObservationSet, machine: Machine) -> int:
    """Number of the body that the artefacts of a set stand on. Raises `InputError` for one that the machine has not."""
    body = str(observations.options.get("body", "workpiece"))
    known = ("workpiece", "bed", *machine.letters)
    if body not in known:
        raise InputError(
            f"set '{observations.name}': body is '{body}'; expected what the artefact stands on, one of {', '.join(known)}"
        )
    return machine.body_index(body)


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
        offset = np.nan_to_num(own.readings[self.rows]) if readings else 0.0
        body = body_of(own, self.machine)
        return nominal_point(self.machine, own.positions[self.rows], own.tool[self.rows] + offset, body)


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

    def key(self, what: str, letter: str) -> Key:
        """Key of one of its unknowns."""
        return (what, *self.owner, self.placement, letter)

    @cached_property
    def rotation(self) -> np.ndarray:
        """R0, from the frame of the artefact to that of the body, (3, 3)."""
        return np.asarray(self._motion(False).rotation)

    @cached_property
    def centre(self) -> np.ndarray:
        """Nominal place of the mean of the calibrated points, frame of the body, (3,) [mm]."""
        return np.asarray(self._motion(False).translation)

    def _motion(self, readings: bool) -> Any:
        arms = np.concatenate([part.arms for part in self.parts])
        return best_rigid_motion(arms, np.concatenate([part.nominal(readings) for part in self.parts]))

    @cached_property
    def moves(self) -> np.ndarray:
        """Which of three rotations and three shifts are unknown, bool (6,): those that do to readings what no other does.

        The others are held at 0: the roll of a beam, or the tilt of a plate whose holes were probed at any depth.
        """
        blocks = []
        for part in self.parts:
            seen = self.rotation @ np.diag(part.measured.astype(float)) @ self.rotation.T
            turned = skew(part.arms @ self.rotation.T).transpose(0, 2, 1)
            blocks.append(np.concatenate([seen @ turned, np.broadcast_to(seen, turned.shape)], axis=2).reshape(-1, 6))
        design = np.concatenate(blocks)
        sizes = np.linalg.norm(design, axis=0)
        moves, kept = np.zeros(6, dtype=bool), np.zeros((len(design), 0))
        for k in (*(3 + np.argsort(-sizes[3:], kind="stable")), *np.argsort(-sizes[:3], kind="stable")):
            left = design[:, k] - kept @ np.linalg.lstsq(kept, design[:, k], rcond=1e-9)[0]
            moves[k] = np.linalg.norm(left) > LEVER
            kept = np.column_stack([kept, design[:, k]]) if moves[k] else kept
        return moves

    def starts(self) -> dict[Any, float]:
        """Rotation and shift that the readings give by the same rigid motion."""
        found = self._motion(True)
        values, vectors = found.rotation @ self.rotation.T, np.zeros(6)
        turn = values - values.T  # Cayley's transform: o = 2 tan(θ/2) along the axis, (R - Rᵀ) / (1 + tr R) · 2
        vectors[:3] = 2.0 * np.array([turn[2, 1], turn[0, 2], turn[1, 0]]) / (1.0 + np.trace(values))
        vectors[3:] = found.translation - self.centre
        keys = [self.key("turn", c) for c in "ABC"] + [self.key("shift", c) for c in "XYZ"]
        return {key: float(v) for key, v, moved in zip(keys, vectors, self.moves, strict=True) if moved}

    def slots(self, part: ObservationSet, rows: np.ndarray, table: NuisanceTable) -> list[int]:
        """Numbers of its rotations and shifts, which a change of datum moves as the body that it stands on."""
        name = f"{said_of(self.owner)} placement {self.placement}"
        body = str(part.options.get("body", "workpiece"))
        turns, shifts = ([self.key(what, c) for c in letters] for what, letters in (("turn", "ABC"), ("shift", "XYZ")))
        unknown = np.where(self.moves, np.inf, 0.0)
        seen, centre = Seen(part, self.campaign, rows, body, TOOL), tuple(self.centre.tolist())
        found = []
        for i, c in enumerate("ABC"):
            response: Any = TurnOf(body, of=tuple(turns), component=i, sense=1.0)
            known: dict[str, Any] = {"prior_u": unknown[i], "spread": TURN_SPREAD, "response": response}
            found.append(table.index(turns[i], f"{name} {c}", "rad", **known))
        for i, c in enumerate("XYZ"):
            response = PlaceOf(body, seen.not_followed, tuple(shifts), i, centre, seen.tool, seen.u)
            known = {"prior_u": unknown[3 + i], "spread": SHIFT_SPREAD, "response": response}
            found.append(table.index(shifts[i], f"{name} {c}", **known))
        return found


def places_of(campaign: Campaign) -> list[Place]:
    """All placements of a campaign, each once."""
    found: dict[tuple[tuple[str, str], str], None] = {}
    for s in campaign.sets:
        if s.kind == "artefact":
            pairs = zip(s.labels["artefact"].tolist(), s.labels["placement"].tolist(), strict=True)
            found |= {(owner_of(s, artefact), placement): None for artefact, placement in pairs}
    return [Place(campaign, owner, placement) for owner, placement in found]
