"""Artefacts whose lengths were measured between places of the machine: their unknown offset and scale."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from volid.campaign import ObservationSet
from volid.exceptions import InputError
from volid.model.jacobian import side_rotation, tool_rotation_rows
from volid.model.kinematics import nominal_point
from volid.model.machine import Machine
from volid.observations.base import NuisanceTable
from volid.observations.response import MOTIONS, SEVERAL_TOOLS, Key, Linear, Remainder, remainder

SPREAD = 1.0  # mm, of an unknown offset of a virtual artefact
SCALE_SPREAD = 1e-3  # of an unknown scale
UNNAMED = "1"  # artefact of a set that names none: its own
SAME_PLACE = 1e-6  # mm: ends that are nearer are one place
INCLINED = 0.05  # of a length: a part along an axis, or a difference, that counts


def nominal_lengths(observations: ObservationSet, machine: Machine) -> np.ndarray:
    """Distances of the nominal functional points of both ends, (m,) [mm]."""
    return np.asarray(np.linalg.norm(_beams(observations, machine), axis=1))


def _beams(observations: ObservationSet, machine: Machine) -> np.ndarray:
    """From the first nominal functional point to the second, workpiece frame, (m, 3) [mm]."""
    first, second = (nominal_point(machine, end.positions, end.tool) for end in observations.ends)
    return np.asarray(second - first)


def artefacts_of(observations: ObservationSet) -> list[str]:
    """Names of the artefacts of a set, in the order of its rows."""
    return [str(name) for name in dict.fromkeys(observations.labels["artefact"].tolist())]


def artefact_key(what: str, observations: ObservationSet, name: str) -> Key:
    """Key of an unknown of an artefact; one without a name belongs to its set."""
    owner = ("set", observations.name) if name == UNNAMED else ("artefact", name)
    return (f"{what} of length", *owner)


class Artefact:
    """Rows of one artefact in a set: its unknowns, and how lengths answer a constant rotation h of the tool vectors.

    A motion of the workpiece frame changes no length. h does where tool vectors, or rotary axes of the head, differ at both ends;
    an unknown offset follows the mean of that.
    """

    def __init__(self, observations: ObservationSet, machine: Machine, name: str) -> None:
        self.observations, self.machine, self.name = observations, machine, name
        self.rows = np.flatnonzero(observations.labels["artefact"] == name)
        self.relative = bool(observations.options.get("relative", False))
        self.calibrated_u = float(observations.options.get("calibrated_u", 0.0))
        self.answer, self.not_followed = self._response()

    @property
    def has_offset(self) -> bool:
        """Whether there is an offset; one that is known to be 0 where something must tell what a change of datum leaves out."""
        return self.relative or self.calibrated_u > 0.0 or self.not_followed is not None

    def key(self, what: str) -> Key:
        """Key of an unknown of the artefact."""
        return artefact_key(what, self.observations, self.name)

    def slots(self, settings: Sequence[bool], table: NuisanceTable) -> list[int]:
        """Numbers of its offset and scale, as far as `settings` (offset, scale) of the set have them."""
        name = self.observations.name if self.name == UNNAMED else self.name
        found = []
        if settings[0]:
            u = np.inf if self.relative else self.calibrated_u
            response = Linear(not_followed=self.not_followed, constant=self.answer)
            number = table.index(
                self.key("offset"), f"offset of length {name}", prior_u=u, spread=SPREAD, response=response
            )
            found.append(self._agreeing(table, number, u, "relative or calibrated_u"))
        if settings[1]:
            u = float(self.observations.options["scale_u"])
            number = table.index(self.key("scale"), f"scale of length {name}", "1", prior_u=u, spread=SCALE_SPREAD)
            found.append(self._agreeing(table, number, u, "scale_u"))
        return found

    def _agreeing(self, table: NuisanceTable, number: int, u: float, what: str) -> int:
        if table.entries[number].prior_u != u:
            raise InputError(
                f"set '{self.observations.name}', artefact '{self.name}': {what} is stated otherwise in another set; expected "
                "the same in all sets, or another name for another artefact"
            )
        return number

    def _response(self) -> tuple[tuple[float, ...], Remainder | None]:
        """The answer of the offset to (t, ω, h), and what it does not follow."""
        own = self.observations.rows_of(self.rows)
        beams = _beams(own, self.machine)
        directions = beams / np.maximum(np.linalg.norm(beams, axis=1), SAME_PLACE)[:, None]
        turned = [
            side_rotation(self.machine, e.positions, True)
            @ tool_rotation_rows(self.machine, e.positions, e.tool)[:, :3]
            for e in own.ends
        ]
        rows = np.zeros((len(self.rows), MOTIONS))
        rows[:, 6:] = -np.einsum("mi,mij->mj", directions, turned[1] - turned[0])
        rows[np.abs(rows) < 1e-9] = 0.0  # mm/rad: rounding
        mean = rows.mean(axis=0) if self.relative else np.zeros(MOTIONS)
        left = rows - mean
        left[np.abs(left) < 1e-9] = 0.0
        return tuple((-mean).tolist()), remainder(left, own.u[:, 0], SEVERAL_TOOLS)


def fitted(keys: tuple[Key, Key], parts: Sequence[Artefact]) -> dict[Any, float]:
    """Start values of an artefact's unknown offset and scale."""
    nominal = np.concatenate([nominal_lengths(p.observations, p.machine)[p.rows] for p in parts])
    found = np.concatenate([p.observations.readings[p.rows, 0] for p in parts])
    scaled = any(np.isinf(float(p.observations.options.get("scale_u", 0.0))) for p in parts)
    open_ = [(keys[0], np.ones(len(nominal)))] if any(p.relative for p in parts) else []
    open_ += [(keys[1], nominal)] if scaled and (not open_ or np.ptp(nominal) > INCLINED * nominal.max()) else []
    seen = np.isfinite(found)
    if not open_ or not seen.any():
        return {}
    design = np.stack([column for _, column in open_], axis=1)[seen]
    values = np.linalg.lstsq(design, (found - nominal)[seen], rcond=None)[0]
    return {key: float(value) for (key, _), value in zip(open_, values, strict=True)}
