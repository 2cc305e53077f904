"""Spheres fitted to groups of touches, as columns of a table of sphere centres, with what has to be said of them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from volid.exceptions import InputError, NotDeterminedError
from volid.io.campaign.touch_groups import Touches, same_spheres
from volid.model.kinematics import side_rotation
from volid.model.machine import Machine
from volid.multilateration.sphere import Sphere
from volid.multilateration.sphere_scatter import SphereFits, fit_spheres
from volid.observations import Kind
from volid.planning.following import follow

_LARGEST_SCATTER = 0.1  # mm, unless `touch_u` says otherwise: a hundred times that of a touch probe
_SAID = 10  # remarks of one sort
_MOST_OUTLIERS = 0.1  # share of all touches
_RADIUS_SLACK = 0.5  # mm: pre-travel of a probe, form and wear stay far below


@dataclass(frozen=True)
class Probe:
    """What is known of sphere and probe.

    Args:
        radius: Expected radius of the fitted spheres, of sphere and stylus ball together, or None. [mm]
        fixed: Whether the fit takes it as known.
        touch_u: Standard uncertainty of a touch, or None: the scatter. [mm]
    """

    radius: float | None = None
    fixed: bool = False
    touch_u: float | None = None


@dataclass(frozen=True, eq=False)
class Fitted:
    """Touches, their groups, and the spheres fitted to them."""

    touches: Touches
    groups: list[np.ndarray]
    fits: SphereFits

    @cached_property
    def kept(self) -> list[tuple[np.ndarray, Sphere]]:
        """Groups that a sphere was fitted to."""
        return [(g, s) for g, s in zip(self.groups, self.fits.spheres, strict=True) if s is not None]

    @property
    def first(self) -> np.ndarray:
        """Place of the first touch of every sphere."""
        return np.array([g[0] for g, _ in self.kept])

    def means(self, values: np.ndarray) -> tuple[str, ...]:
        """Mean over the touches of each sphere, as cells."""
        return _cells(np.array([np.mean(values[g], axis=0) for g, _ in self.kept]))

    def columns(self, machine: Machine, kind: Kind, extra: float) -> dict[str, tuple[str, ...]]:
        """Axis positions, tool vectors, u and labels of every centre, as cells by column; `extra`: u besides the touches [mm]."""
        tool, centres = self.touches.tool[self.first], np.array([s.centre for _, s in self.kept])
        positions = np.zeros((len(centres), len(machine.axes)))
        rotary = np.array([self.touches.rotary[g].mean(axis=0) for g, _ in self.kept])
        positions[:, [i for i, a in enumerate(machine.axes) if not a.is_linear]] = rotary
        positions = follow(machine, positions, tool, centres)
        u = self._uncertainties(_turns(machine, positions, kind.centres_in), extra)
        columns = {a.letter: _cells(positions[:, i]) for i, a in enumerate(machine.axes)}
        columns |= {f"tool_{c}": _cells(tool[:, i]) for i, c in enumerate("xyz")}
        columns |= {f"u_{c}": _cells(u[:, i]) for i, c in enumerate("xyz")}
        for name in kind.labels:
            if name in self.touches.labels:
                columns[name] = tuple(map(str, self.touches.labels[name][self.first]))
            elif name == kind.standing:
                columns[name] = tuple(self._names(centres))
        return columns

    def _uncertainties(self, turns: np.ndarray, extra: float) -> np.ndarray:
        """Standard uncertainties (m, 3) [mm] of the centres in frames that `turns` (m, 3, 3) lead to the workpiece from."""
        covariances = np.array([s.covariance(self.fits.u) for _, s in self.kept])
        turned = np.swapaxes(turns, 1, 2) @ covariances @ turns
        return np.sqrt(np.diagonal(turned, axis1=1, axis2=2) + extra**2)

    def _names(self, centres: np.ndarray) -> list[str]:
        """Names of the spheres, "P1", "P2" … in the order of their appearance, by their places on the workpiece.

        Raises `InputError` where the rotary axes move and no place occurs twice: then the places are those of no sphere.
        """
        reach = float(np.median([s.radius for _, s in self.kept])) / 2.0
        numbers = same_spheres(centres, reach)
        poses = np.unique(np.round(self.touches.rotary[self.first], 2), axis=0)
        if len(poses) > 1 and len(numbers) > 1 and numbers.max() + 1 == len(numbers):
            raise InputError(
                f"{self.touches.source}: the {len(numbers)} spheres in {len(poses)} poses of the rotary axes all "
                "stand at different "
                f"places on the workpiece, {np.ptp(centres, axis=0).max():.3g} mm apart; expected the places of a "
                "sphere to agree. "
                "Check tool, origin, the meaning of the coordinates and the rotary axes, or name the spheres in a column sphere"
            )
        return [f"P{i + 1}" for i in numbers]

    def said(self) -> list[str]:
        """What was made of the touches, in words, with the touches and spheres that were left out."""
        radii = [s.radius for _, s in self.kept]
        text = f"{sum(int(s.used.sum()) for _, s in self.kept)} touches as {len(radii)} sphere centres, radius {min(radii):.4f}"
        text += f" … {max(radii):.4f} mm" if len(radii) > 1 else " mm"
        if freedom := self.fits.degrees_of_freedom:
            text += f", scatter of a touch {1e3 * self.fits.scatter:.2g} µm with {freedom} degrees of freedom"
        lost = [f"a centre left out, {reason}" for reason in self.lost()]
        return [text, *_first(self._outliers(), "touches"), *_first(lost, "centres")]

    def record(self) -> dict[str, Any]:
        """What the fits say: u and scatter of a touch, and of every sphere its radius and the residuals of its touches. [mm]"""
        return {
            "touch_u": self.fits.u,
            "scatter": self.fits.scatter if self.fits.degrees_of_freedom else 0.0,
            "degrees_of_freedom": self.fits.degrees_of_freedom,
            "radius": [s.radius for _, s in self.kept],
            "residuals": [np.round(s.residuals, 7).tolist() for _, s in self.kept],
        }

    def _outliers(self) -> list[str]:
        found = [(self.groups[i][j], self.fits.spheres[i], j) for i, j in self.fits.outliers]
        return [
            f"the touch in row {self.touches.rows[place]} left out, {1e3 * sphere.residuals[j]:+.3g} µm beside "
            "the others' sphere"
            for place, sphere, j in found
            if sphere is not None
        ]

    def lost(self) -> list[str]:
        """Where no sphere was fitted, and why."""
        found = zip(self.groups, self.fits.spheres, self.fits.reasons, strict=True)
        return [f"{self.place(group)}: {reason}" for group, sphere, reason in found if sphere is None]

    def place(self, group: np.ndarray) -> str:
        """The file's rows of a group, with its label."""
        first, last = self.touches.rows[group[0]], self.touches.rows[group[-1]]
        label = next((f", {name} '{values[group[0]]}'" for name, values in self.touches.labels.items()), "")
        return f"rows {first} to {last}{label}"


def fitted(touches: Touches, groups: list[np.ndarray], probe: Probe) -> Fitted:
    """Spheres fitted to groups of touches.

    Raises `InputError` where none can be fitted, where touches lie far beside their spheres, or a radius is not the expected one.
    """
    radius = probe.radius if probe.fixed else None
    try:
        fits = fit_spheres([touches.points[g] for g in groups], radius, probe.touch_u)
    except NotDeterminedError as error:
        raise InputError(f"{touches.source}: {error}") from None
    found = Fitted(touches, groups, fits)
    _check_agreement(found, probe.touch_u)
    if not found.kept:
        raise InputError(f"{touches.source}, {found.lost()[0]}")
    if probe.radius is not None:
        _check_radii(found, probe.radius)
    return found


def _check_agreement(found: Fitted, touch_u: float | None) -> None:
    """Raises `InputError` where so many touches contradict each other, or by so much, that they are not those of the spheres."""
    fits, n, source = found.fits, len(found.groups), found.touches.source
    lost = n - len(found.kept)
    cure = (
        "do groups hold touches of several spheres, or of something else? Tell spheres apart by a column path or sphere, by "
        "count = … or gap = … (mm)"
    )
    if len(fits.outliers) + lost > max(3, _MOST_OUTLIERS * len(found.touches), 0.5 * n):
        raise InputError(
            f"{source}: {len(fits.outliers)} of {len(found.touches)} touches contradict the others, and {lost} of "
            f"{n} spheres are "
            f"contradicted or not determined, such as {next(iter(found.lost()), 'none')}; is touch_u too small, or {cure}"
        )
    if fits.scatter > max(_LARGEST_SCATTER, 10.0 * (touch_u or 0.0)):
        raise InputError(
            f"{source}: the touches lie {fits.scatter:.3g} mm (rms) beside the spheres that fit them best; {cure}"
        )


def _turns(machine: Machine, positions: np.ndarray, frame: str) -> np.ndarray:
    """Nominal rotations (m, 3, 3) from the machine or tool frame to the workpiece's."""
    table = side_rotation(machine, positions, True)
    return table @ side_rotation(machine, positions, False) if frame == "tool" else table


def _check_radii(found: Fitted, expected: float) -> None:
    """Raises `InputError` for a sphere of another radius than expected: other units, groups, or a probe not as stated."""
    for group, sphere in found.kept:
        u = found.fits.u * float(np.sqrt(sphere.cofactor[3, 3])) if len(sphere.cofactor) == 4 else 0.0
        if abs(sphere.radius - expected) > _RADIUS_SLACK + 4.0 * u:
            raise InputError(
                f"{found.touches.source}, {found.place(group)}: the fitted radius is {sphere.radius:.3f} mm; expected "
                f"{expected:.3f} mm, that of sphere and stylus ball. Check unit, diameters and which touches belong together"
            )


def _first(said: list[str], what: str) -> list[str]:
    """The first of many remarks, and how many more there are."""
    more = [f"{len(said) - _SAID} more {what} left out"] if len(said) > _SAID else []
    return said[:_SAID] + more


def _cells(values: np.ndarray) -> tuple[str, ...]:
    return tuple(repr(float(v)) for v in values)
