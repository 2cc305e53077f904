"""Circular tests out of a campaign: sets of distances from one ball, along commanded circles of two linear axes.

The circle is the least-squares one through the commanded positions of the two axes that move; angle and nominal radius
follow from it. Where the ball of the socket stands out of the plane on purpose (a bar on a cone), the radius in the plane
is sqrt(L² - h²), with L the length that was read and h the nominal height.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from itertools import groupby

import numpy as np

from volid.campaign import Campaign, ObservationSet
from volid.effects import TYPES
from volid.effects.environment.reduction import reduced
from volid.effects.prediction import is_random
from volid.exceptions import InputError
from volid.model.iso230 import LINEAR_AXES
from volid.model.kinematics import nominal_point
from volid.observations import KINDS
from volid.observations.base import NuisanceTable
from volid.standards.circular.readings import PLANES, CircularReadings, circular_readings, merged

_FEED = re.compile(r"\s*(\d{1,9}(?:\.\d{1,9})?)\s*(mm|m)/min")
_DIGITS = 4  # of angles in degrees: a quarter of a micrometre on a circle of 150 mm
_ROUND = 0.01  # mm: commanded points are no farther from their circle
_STILL = 1e-3  # mm, degrees: an axis that moves less stands still
_ALIKE = 0.05  # mm: centres and radii that are nearer are the same
_CONE = 0.05  # of the radius: a ball farther from the plane stands there on purpose
_OTHER = 0.02  # of the radius: lengths that differ more are of another bar, or from a ball out of the plane


def circular_tests(campaign: Campaign, names: Sequence[str] | None = None) -> list[CircularReadings]:
    """The circular tests of a campaign; sets of one plane, centre, radius and station are one test.

    Readings are reduced to 20 °C, and divided by the refractive index, where the campaign has an environment that says so.

    Args:
        campaign: A campaign with sets of kind `distance`, such as `volid.planning.circles` plans them.
        names: Names of sets; None: all in which two linear axes run a circle.

    Raises:
        InputError: no set is a circular test, or one that was named is none, with the reason.

    >>> import volid
    >>> campaign = volid.load_campaign("datasets/ball_bar_circles/campaign.toml")
    >>> [(t.plane, t.radius, round(t.arc)) for t in circular_tests(campaign)]
    [('XY', 150.0, 360), ('YZ', 150.0, 220), ('ZX', 150.0, 220)]
    """
    campaign = reduced(campaign)
    unknown = set(names or ()) - {s.name for s in campaign.sets}
    if unknown:
        listed = ", ".join(s.name for s in campaign.sets)
        raise InputError(f"{campaign.source}: set '{min(unknown)}' is not there; expected one of {listed}")
    reasons, found = {}, []
    for observations in (s for s in campaign.sets if names is None or s.name in names):
        reason = _no_circle(observations, campaign)
        reasons[observations.name] = reason
        if not reason:
            found += _tests(observations, campaign)
        elif names is not None:
            raise InputError(f"{observations.file_and_set}: {reason}")
    if not found:
        why = "; ".join(f"set '{name}': {reason}" for name, reason in reasons.items())
        raise InputError(f"{campaign.source}: no set is a circular test ({why})")
    ordered = sorted(found, key=lambda item: item[0])
    return [merged([test for _, test in group]) for _, group in groupby(ordered, key=lambda item: item[0])]


_Place = tuple[int, str, int, int, int]  # number of the plane, station, radius and centre in multiples of `_ALIKE`


def _no_circle(observations: ObservationSet, campaign: Campaign) -> str:
    """Why a set is no circular test; empty where it is one."""
    kind = KINDS[observations.kind]
    if kind.readings != ("distance",) or not kind.sees_tool(observations):
        return f"kind '{observations.kind}'; expected distances from a ball to the functional point"
    moving = _moving(observations, campaign)
    if len(moving) != 2 or not set(moving) <= set(LINEAR_AXES):
        named = ", ".join(moving) or "no axis"
        return f"{named} moved; expected two linear axes on a circle, and a fit (`volid.fit`) for what moves more"
    if np.ptp(observations.tool, axis=0).max() > _STILL:
        return "tool vectors differ; expected one on the whole circle"
    if not np.isfinite(observations.readings).all():
        return "readings are missing, as in a plan"
    a, b = tuple(_plane(moving))
    _, radius, off = _circle(observations.positions[:, [campaign.machine.index(a), campaign.machine.index(b)]])
    if not off <= _ROUND:
        return f"the commanded points lie up to {off:.3g} mm off a circle of {radius:.6g} mm"
    return ""


def _moving(observations: ObservationSet, campaign: Campaign) -> list[str]:
    range_ = np.ptp(observations.positions, axis=0)
    return [letter for letter, r in zip(campaign.machine.letters, range_, strict=True) if r > _STILL]


def _plane(moving: Sequence[str]) -> str:
    return next(plane for plane in PLANES if set(plane) == set(moving))


def _circle(points: np.ndarray) -> tuple[np.ndarray, float, float]:
    """Centre (2,), radius and largest distance of points (m, 2) from their least-squares circle [mm]."""
    middle = points.mean(axis=0)
    x = points - middle
    A = np.column_stack([2.0 * x, np.ones(len(x))])
    solved = np.linalg.lstsq(A, (x**2).sum(axis=1), rcond=None)[0]
    radius = float(np.sqrt(max(solved[2] + solved[:2] @ solved[:2], 0.0)))
    off = np.abs(np.linalg.norm(x - solved[:2], axis=1) - radius)
    return middle + solved[:2], radius, float(off.max())


def _tests(observations: ObservationSet, campaign: Campaign) -> list[tuple[_Place, CircularReadings]]:
    """The tests of a set, one per station, each with what makes it the same as another set's."""
    found = []
    for name in dict.fromkeys(observations.labels["station"].tolist()):
        rows = np.flatnonzero(observations.labels["station"] == name)
        found.append(_test(observations.rows_of(rows), campaign, str(name)))
    return found


def _test(observations: ObservationSet, campaign: Campaign, station: str) -> tuple[_Place, CircularReadings]:
    plane = _plane(_moving(observations, campaign))
    columns = [campaign.machine.index(letter) for letter in plane]
    centre, radius, _ = _circle(observations.positions[:, columns])
    away = observations.positions[:, columns] - centre
    angle = np.round(np.rad2deg(np.arctan2(away[:, 1], away[:, 0])), _DIGITS)
    radius = round(radius, 4) if abs(radius - round(radius, 4)) < 1e-5 else radius
    read, u = observations.readings[:, 0], observations.u[:, 0]
    relative, height = bool(observations.options.get("relative", True)), _height(observations, campaign, station)
    length = float(np.hypot(radius, height))
    lengths = read - np.mean(read) + length if relative else read
    if abs(float(np.mean(lengths)) - length) > _OTHER * radius:
        raise InputError(
            f"{observations.file_and_set}: the readings are {np.mean(read):.6g} mm in the mean, on a circle of {radius:.6g} mm; "
            f"expected lengths from the ball of station '{station}'; say where it stands (position) if it is out of the plane"
        )
    own, part = np.unique(observations.labels["segment"], return_inverse=True)
    labels = [str(own[k]) for k in np.ravel(part)]
    deviation = np.sqrt(lengths**2 - height**2) - radius
    test = circular_readings(plane, radius, angle, deviation, run=labels, source=observations.name)
    test = replace(
        test,
        u=u * length / radius,
        length_u=np.inf if relative else length / radius * _length_u(observations, campaign, height),
        part=np.ravel(part) if relative else None,
        feed=_feed(campaign),
    )
    key = (PLANES.index(plane), station, *(round(v / _ALIKE) for v in (radius, *centre)))
    return key, test


def _feed(campaign: Campaign) -> float | None:
    """The feed along the path that the conditions record, as "1000 mm/min" or "2 m/min" [mm/min]; None for none."""
    found = _FEED.match(str(campaign.conditions.get("feed", "")))
    return float(found[1]) * (1000.0 if found[2] == "m" else 1.0) if found else None


def _height(observations: ObservationSet, campaign: Campaign, station: str) -> float:
    """Nominal height of the ball over the plane of the circle [mm]; 0 where it is no cone on purpose."""
    ball = campaign.station(station)
    if ball.position is None or ball.body != "workpiece":
        return 0.0
    points = nominal_point(campaign.machine, observations.positions, observations.tool)
    middle = points.mean(axis=0)
    normal = np.linalg.svd(points - middle, full_matrices=False)[2][2]
    height = float((np.asarray(ball.position) - middle) @ normal)
    return height if abs(height) > _CONE * float(np.ptp(points, axis=0).max()) / 2.0 else 0.0


def _length_u(observations: ObservationSet, campaign: Campaign, height: float) -> float:
    """Standard uncertainty of the length that all readings share: its calibration, and effects that last [mm].

    On a cone the height is as uncertain as the place of the ball, which nobody states: then it is infinite.
    """
    if height and not campaign.station(str(observations.labels["station"][0])).known:
        return np.inf
    square = float(observations.options.get("calibrated_u", 0.0)) ** 2
    for effect in observations.effects:
        if not is_random(effect):
            terms = TYPES[effect.type].terms(effect, observations, campaign, NuisanceTable())
            square += sum((effect.u * float(np.mean(term.factor))) ** 2 for term in terms)
    return float(np.sqrt(square))
