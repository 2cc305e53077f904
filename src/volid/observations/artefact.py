"""`artefact`: calibrated points that the functional point is brought to (ball plate, hole plate, ball beam, probed ball bar).

In the frame of the body that the artefact stands on, its point i in placement k stands at

    a = c_k + t_k + R(o_k) [(1 + s) R_k (P_i - P̄) + R_k δ_i],

P_i the calibrated coordinates, P̄ their mean, δ_i their deviation (`volid.observations.calibration`), s the deviation of the
calibrated scale. c_k and R_k are the nominal place, of any orientation; shift t_k and rotation o_k are unknown. The readings are

    d = Q (a - p),

p the actual functional point in that frame, Q the nominal rotation to the machine frame: how far the point lies from where the
axes were sent, in the machine's directions, as found minus commanded position. Centres that a probe found are d = 0 at the axis
positions that it reports (`centres = true`), which is exact; readings d are so to products of d and of angles between the actual
and the nominal directions of the axes, 0.03 µm for 0.3 mm at 100 µrad. Simulated readings are d at the positions of the plan.

With `components = "XY"` only these calibrated coordinates count, in the frame of the artefact: a hole was probed at a depth that
is unknown, one unknown for every row. The tilt of such a plate is that of the places where its holes were probed, so probe them
at one depth. What moves no reading, such as the roll of a beam, is held. Not modelled: bending of the artefact under its weight,
thermal expansion, form errors of balls and the probe. CONVENTIONS 6; ISO 10360-2; ISO/TR 16907:2015, 7.

Options of a set: `points` and `covariance` name CSV files of the calibration, `scale_u` is the prior u of its scale, a ratio (inf
when unknown), shared by all placements: the traceable length. `body` is what the artefact stands on. An artefact of the same name
in several sets is the same one, and so is its placement of the same name.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from volid.backend.elementary import in_rows
from volid.campaign import Campaign, ObservationSet
from volid.exceptions import InputError
from volid.model.geometry import Vector, add, rotate_exactly, subtract
from volid.model.kinematics import functional_point, transform
from volid.model.machine import BED, Machine
from volid.observations.artefact_places import UNNAMED, body_of, found_places, places_of
from volid.observations.artefact_slips import check_placement
from volid.observations.artefact_unknowns import Unknowns
from volid.observations.base import Group, Kind, NuisanceTable, takes_large_errors
from volid.observations.calibration import artefacts_of, check_points

ALL = "XYZ"


class ArtefactSettings(NamedTuple):
    """Static part: the body, how many calibration unknowns a row has, whether there is a scale, how many depths a row has."""

    body: int
    factors: int
    scale: bool
    depths: int


class Artefact(Kind):
    """Points of calibrated artefacts, as the docstring of the module describes them."""

    name = "artefact"
    readings = ("x", "y", "z")
    doc = "calibrated point as seen from the functional point, machine frame [mm]"
    labels: Mapping[str, str | None] = {"artefact": UNNAMED, "point": None, "placement": "1", "run": "1"}
    options: Mapping[str, Any] = {"points": {}, "scale_u": 0.0, "components": ALL, "body": "workpiece"}
    optional: Mapping[str, Any] = {"covariance": {}}
    scopes: Mapping[str, tuple[str, ...]] = {"artefact": ("artefact",), "placement": ("artefact", "placement")}
    tested_by = ("placement",)
    named_by = ("artefact", "point", "placement")
    takes_centres = True
    calibrated = True

    @staticmethod
    def predict(
        machine: Machine, settings: ArtefactSettings, q: Any, tool: Vector, errors: Any, slots: Any, constants: Any
    ) -> Any:
        """Predicted readings x, y, z in the machine frame, shape (3, m) [mm]."""
        arm, used = _three(constants, 3), 6
        if settings.scale:
            factor = 1.0 + slots[used]
            arm, used = (factor * arm[0], factor * arm[1], factor * arm[2]), used + 1
        for j in range(settings.factors + settings.depths):
            effect = _three(constants, 6 + 3 * j)
            size = slots[used + j]
            arm = add(arm, (size * effect[0], size * effect[1], size * effect[2]))
        place = add(rotate_exactly(_three(slots, 0), arm), add(_three(constants, 0), _three(slots, 3)))
        gap = subtract(place, functional_point(machine, q, tool, errors, settings.body))
        bed = machine.body_index(BED)
        return in_rows(transform(machine, q, None, gap, start=settings.body, stop=bed, is_vector=True), np.shape(q[0]))

    def groups(self, observations: ObservationSet, campaign: Campaign, table: NuisanceTable) -> list[Group]:
        """All rows of a set as one group: placements, scale, calibration and depths."""
        body = body_of(observations, campaign.machine)
        scale = float(observations.options.get("scale_u", 0.0)) > 0.0
        parts = [
            Unknowns(observations, campaign, artefact, placement)
            for artefact in artefacts_of(observations)
            for placement in _placements(observations, artefact)
        ]
        factors = max((part.n_factors for part in parts), default=0)
        depths = int(np.count_nonzero(~parts[0].rows.measured)) if parts else 0
        settings = ArtefactSettings(body, factors, scale, depths)
        slots = np.zeros((6 + scale + factors + depths, len(observations)), dtype=np.int64)
        constants = np.zeros((6 + 3 * (factors + depths), len(observations)))
        for part in parts:
            part.fill(table, scale, slots, constants)
        return [Group(np.arange(len(observations)), settings, slots, constants)]

    def starts(self, campaign: Campaign) -> dict[Any, float]:
        """Placements, as the readings give them on the nominal chain."""
        found: dict[Any, float] = {}
        for place in places_of(campaign):
            if not any(np.isnan(part.observations.readings).any() for part in place.parts):
                found |= place.starts()
        return found

    def is_whole(self, observations: ObservationSet) -> bool:
        """Always: a placement counts from the places of all its rows."""
        return True

    def is_pinned(self, observations: ObservationSet) -> bool:
        """Whether every row has unknown depths of its own."""
        return len(_components(observations)) < len(ALL)

    def check(self, observations: ObservationSet) -> None:
        """Raises `InputError` for rows without a calibrated point, or components that are none."""
        _components(observations)
        check_points(observations)

    def check_values(self, observations: ObservationSet, campaign: Campaign) -> None:
        """Raises `InputError` for points that the calibration does not explain: exchanged, mirrored, in another unit, moved."""
        if takes_large_errors(observations):
            return
        for place in places_of(campaign):
            if any(part.observations is observations for part in place.parts):
                check_placement(place, observations)

    def places(
        self, observations: ObservationSet, machine: Machine, positions: np.ndarray | None = None
    ) -> np.ndarray | None:
        """Place of every point on its body, (m, 3) [mm]."""
        return found_places(observations, machine, positions)

    def advice(self, sets: Sequence[ObservationSet], campaign: Campaign) -> list[str]:
        """How many placements there are, in which planes, and with which tool vectors."""
        reasons = []
        places = [p for p in places_of(campaign) if any(part.observations in sets for part in p.parts)]
        normals = np.stack([place.rotation[:, 2] for place in places])
        if np.linalg.matrix_rank(normals, tol=0.1) < 2:
            reasons.append(
                "every placement of the artefact is parallel to the others; place it upright or inclined, too"
            )
        tools = np.unique(np.round(np.concatenate([s.tool for s in sets]), 3), axis=0)
        if len(tools) == 1:
            single = ", ".join(f"{x:g}" for x in tools[0])
            reasons.append(f"a single tool vector ({single}) mm was used; use three that do not lie on one line")
        unknown = [s.name for s in sets if np.isinf(float(s.options.get("scale_u", 0.0)))]
        if unknown:
            reasons.append(f"the scale of the artefact of set {', '.join(unknown)} is unknown (scale_u = inf)")
        return reasons


def _three(rows: Any, first: int) -> Vector:
    return rows[first], rows[first + 1], rows[first + 2]


def _placements(observations: ObservationSet, artefact: str) -> list[str]:
    own = observations.labels["placement"][observations.labels["artefact"] == artefact]
    return [str(name) for name in dict.fromkeys(own.tolist())]


def _components(observations: ObservationSet) -> str:
    """Calibrated coordinates that count. Raises `InputError` for others than those of X, Y, Z."""
    given = observations.options.get("components", ALL)
    if not isinstance(given, str) or not given or sorted(given) != sorted(set(given) & set(ALL)):
        raise InputError(
            f"set '{observations.name}': components is {given!r}; expected the calibrated coordinates that count, such as \"XY\" "
            'for a plate with holes, or "XYZ"'
        )
    return given


ARTEFACT = Artefact()
