"""`length`: distance between two functional points that the machine visited (step gauge, probed bar, diagonals of a test piece).

    reading = (1 + s) · |p(q2, tool2) - p(q1, tool1)| + a

with p the actual functional point in workpiece coordinates, so that both ends carry the machine's errors. For every artefact, a
is its unknown offset when `relative`, else the deviation of its calibrated length (prior `calibrated_u` [mm]); s is the deviation
of its scale, a ratio (prior `scale_u`, inf when unknown). Sets that name the same artefact share both. Not modelled: bending of
an artefact, and probing in another direction than along the length. CONVENTIONS 2, 6; ISO 10360-2 (calibrated test lengths).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np

from volid.backend.elementary import in_rows
from volid.campaign import Campaign, ObservationSet
from volid.exceptions import InputError
from volid.model.geometry import Vector, norm, subtract
from volid.model.iso230 import LINEAR_AXES
from volid.model.kinematics import ROWS, functional_point
from volid.model.machine import Machine
from volid.observations.artefact_lengths import (
    INCLINED,
    SAME_PLACE,
    UNNAMED,
    Artefact,
    artefact_key,
    artefacts_of,
    fitted,
    nominal_lengths,
)
from volid.observations.base import ARTEFACT, Group, Kind, NuisanceTable, takes_large_errors
from volid.observations.response import Key

UNITS = {1e-3: "metres", 1e3: "micrometres", 1.0 / 25.4: "inches"}
FITS = 0.1  # of a length: how near readings in another unit come to the commanded ones


class LengthSettings(NamedTuple):
    """Static part: whether the artefacts have an offset, and a scale."""

    offset: bool
    scale: bool


class Length(Kind):
    """Lengths between two functional points, as the docstring of the module describes them."""

    name = "length"
    readings = ("length",)
    doc = "|second functional point - first functional point| + offset of the artefact [mm]"
    ends = 2
    labels: Mapping[str, str | None] = {"artefact": UNNAMED}
    options: Mapping[str, Any] = {"relative": False, "calibrated_u": 0.0, "scale_u": 0.0}
    scopes: Mapping[str, tuple[str, ...]] = {"artefact": ("artefact",)}
    tested_by = ("artefact",)
    named_by = ("artefact",)

    @staticmethod
    def predict(
        machine: Machine,
        settings: LengthSettings,
        q: Any,
        tool: Vector,
        errors: Any,
        slots: Any,
        constants: Any,
    ) -> Any:
        """Predicted lengths, shape (1, m) [mm]; q, tool and errors hold those of the second end behind those of the first."""
        n, rows = len(machine.axes), ROWS * (len(machine.axes) + 1)
        tools: Any = tool
        first = functional_point(machine, q[:n], tuple(tools[:3]), errors[:rows])  # type: ignore[arg-type]
        second = functional_point(machine, q[n:], tuple(tools[3:]), errors[rows:])  # type: ignore[arg-type]
        value = norm(subtract(second, first))
        if settings.scale:
            value = value * (1.0 + slots[int(settings.offset)])
        if settings.offset:
            value = value + slots[0]
        return in_rows([value], np.shape(q[0]))

    def groups(self, observations: ObservationSet, campaign: Campaign, table: NuisanceTable) -> list[Group]:
        """All rows of a set as one group, with offset and scale of every artefact as far as they are open."""
        own = [Artefact(observations, campaign.machine, name) for name in artefacts_of(observations)]
        settings = LengthSettings(any(a.has_offset for a in own), float(observations.options.get("scale_u", 0.0)) > 0.0)
        slots = np.zeros((sum(settings), len(observations)), dtype=np.int64)
        for artefact in own:
            slots[:, artefact.rows] = np.array(artefact.slots(settings, table), dtype=np.int64)[:, None]
        return [Group(np.arange(len(observations)), settings, slots, np.zeros((0, len(observations))))]

    def starts(self, campaign: Campaign) -> dict[Any, float]:
        """Unknown offsets and scales, as nominal lengths give them by least squares over all sets of an artefact."""
        found: dict[tuple[Key, Key], list[Artefact]] = {}
        for s in campaign.sets if not all(np.isnan(s.readings).all() for s in campaign.sets) else ():
            for name in artefacts_of(s) if s.kind == self.name else ():
                artefact = Artefact(s, campaign.machine, name)
                found.setdefault((artefact.key("offset"), artefact.key("scale")), []).append(artefact)
        starts: dict[Any, float] = {}
        for keys, parts in found.items():
            starts |= fitted(keys, parts)
        return starts

    def check(self, observations: ObservationSet) -> None:
        """Raises `InputError` for a length that is said to be both calibrated and unknown, or rows without a second end."""
        if observations.options.get("relative") and float(observations.options.get("calibrated_u", 0.0)) > 0.0:
            raise InputError(
                f"set '{observations.name}': relative = true (the offset of every artefact is unknown) beside calibrated_u "
                "(it is known to within that u); keep one of them"
            )
        if observations.to is None:
            raise InputError(f"set '{observations.name}': there is no second end; a length needs two functional points")

    def check_values(self, observations: ObservationSet, campaign: Campaign) -> None:
        """Raises `InputError` for ends at one place, lengths that are not positive, or lengths in another unit."""
        nominal, found = nominal_lengths(observations, campaign.machine), observations.readings[:, 0]
        self._check_row(
            observations, nominal < SAME_PLACE, "both ends are one place; expected two places of the machine"
        )
        if not observations.options.get("relative"):
            said = "expected a length > 0 (relative = true for lengths with an unknown offset)"
            self._check_row(observations, found <= 0.0, f"length is not positive; {said}")
        for name in () if takes_large_errors(observations) else artefacts_of(observations):
            artefact = Artefact(observations, campaign.machine, name)
            scale = _scale(nominal[artefact.rows], found[artefact.rows], bool(observations.options.get("relative")))
            for factor, unit in UNITS.items():
                if scale is not None and abs(scale / factor - 1.0) < FITS:
                    raise InputError(
                        f"{observations.file_and_set}: lengths seem to be in {unit}, {scale:.3g} times the distances of the "
                        "commanded positions; expected mm"
                    )

    def _check_row(self, observations: ObservationSet, wrong: np.ndarray, said: str) -> None:
        if wrong.any():
            more = f" and {wrong.sum() - 1} more such rows" if wrong.sum() > 1 else ""
            raise InputError(f"{observations.where(int(np.argmax(wrong)))}{more}: {said}")

    def lengths_of(self, observations: ObservationSet) -> str:
        """Lengths of an artefact."""
        return ARTEFACT

    def dead_paths(self, observations: ObservationSet, starts: Mapping[Any, float]) -> np.ndarray:
        """Start values of the artefacts' offsets, (m, 1) [mm]."""
        names = observations.labels["artefact"]
        by_name = {n: starts.get(artefact_key("offset", observations, n), 0.0) for n in artefacts_of(observations)}
        return np.array([[by_name[str(n)]] for n in names])

    def advice(self, sets: Sequence[ObservationSet], campaign: Campaign) -> list[str]:
        """Which planes no inclined length lies in, which artefacts were measured once, and how many tool vectors there are."""
        reasons = [*_planes(sets, campaign.machine), *_unknown_lengths(sets)]
        tools = np.unique(np.round(np.concatenate([s.all_ends.tool for s in sets]), 3), axis=0)
        if len(tools) == 1:
            single = ", ".join(f"{x:g}" for x in tools[0])
            reasons.append(
                f"lengths were measured with a single tool vector ({single}) mm; use three that do not lie on one line"
            )
        return reasons


def _scale(nominal: np.ndarray, found: np.ndarray, relative: bool) -> float | None:
    """Readings over nominal lengths: their median, or with an unknown offset the slope; None where it cannot be told."""
    if not relative:
        return float(np.median(found / np.maximum(nominal, SAME_PLACE)))
    centred = nominal - nominal.mean()
    square = float(centred @ centred)
    return float(centred @ found) / square if np.ptp(nominal) > INCLINED * nominal.max() else None


def _planes(sets: Sequence[ObservationSet], machine: Machine) -> Iterator[str]:
    """Pairs of linear axes that no length spans together."""
    linear = [axis.letter for axis in machine.axes if axis.is_linear]
    moved = np.concatenate([s.ends[1].positions - s.ends[0].positions for s in sets])
    length = np.concatenate([nominal_lengths(s, machine) for s in sets])
    for a, b in combinations(sorted(linear, key=LINEAR_AXES.index), 2):
        parts = np.abs(moved[:, [machine.index(a), machine.index(b)]])
        if not np.any(np.all(parts > INCLINED * length[:, None], axis=1)):
            yield f"no length is inclined in the plane of {a} and {b}; measure both diagonals of a rectangle there"


def _unknown_lengths(sets: Sequence[ObservationSet]) -> Iterator[str]:
    """Artefacts of unknown length that were measured once."""
    for s in sets:
        names = s.labels["artefact"].tolist()
        once = [n for n in artefacts_of(s) if names.count(n) == 1] if s.options.get("relative") else []
        if once:
            yield f"the offset of {', '.join(once)} is unknown and was measured once; measure it at several places"


LENGTH = Length()
