"""Readings of a circular test in one plane: radii over the angle, in runs of one sense each.

The angle counts from the plane's first axis towards its second one: XY from +X to +Y, YZ from +Y to +Z, ZX from +Z to +X. A run
in this sense is anticlockwise (+1) as seen against the third axis, one in the other is clockwise (-1).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from volid.exceptions import InputError

if TYPE_CHECKING:
    from jaxtyping import Float, Int

PLANES = ("XY", "YZ", "ZX")
FEWEST = 8  # readings of a run: three unknowns of a circle, and something to judge
_FULL = 2.0  # steps: a gap that is smaller leaves a full circle
_JUMP = 4.0  # steps: where the angle jumps farther, another run begins
_LARGEST = 0.05  # of the radius: a deviation that is larger is another length or unit
_OTHER = 0.02  # of the radius: readings whose middle differs more are of another circle, or no deviations
_SAME = 1e-9  # degrees


@dataclass(frozen=True)
class CircularReadings:
    """What a ball bar read in one plane.

    Args:
        plane: Two axes, "XY", "YZ" or "ZX".
        radius: Nominal radius [mm].
        angle: Commanded angle, shape (m,) [degrees].
        deviation: Radius that was read minus `radius`, shape (m,) [mm].
        sense: +1 anticlockwise, -1 clockwise, shape (m,).
        run: Number of the run, shape (m,).
        u: Standard uncertainty of each reading, shape (m,) [mm]; None where it is not known.
        length_u: Standard uncertainty of the bar's length [mm]; infinite where the length is unknown.
        part: Number of the part whose unknown length the reading shares, shape (m,); one part unless the bar was set anew.
        feed: Feed along the path [mm/min]; None where it is not known.
        source: File or set.

    Source: ISO 230-4, circular tests.

    >>> angle = np.concatenate([np.arange(0.0, 361.0, 30.0), np.arange(360.0, -1.0, -30.0)])
    >>> test = circular_readings("XY", 150.0, angle, 0.0 * angle)
    >>> test.senses, test.arc, len(test.runs)
    ((1, -1), 360.0, 2)
    """

    plane: str
    radius: float
    angle: Float[np.ndarray, " m"]
    deviation: Float[np.ndarray, " m"]
    sense: Int[np.ndarray, " m"]
    run: Int[np.ndarray, " m"]
    u: Float[np.ndarray, " m"] | None = None
    length_u: float = 0.0
    part: Int[np.ndarray, " m"] | None = None
    feed: float | None = None
    source: str = ""

    def __len__(self) -> int:
        return len(self.angle)

    @property
    def direction(self) -> np.ndarray:
        """Unit vectors from the centre to the commanded points, (m, 2)."""
        phi = np.deg2rad(self.angle)
        return np.stack([np.cos(phi), np.sin(phi)], axis=1)

    @property
    def parts(self) -> np.ndarray:
        """Number of the part with one unknown length, (m,)."""
        return np.zeros(len(self), dtype=int) if self.part is None else self.part

    @property
    def is_calibrated(self) -> bool:
        """Whether the length of the bar is known."""
        return bool(np.isfinite(self.length_u))

    @property
    def senses(self) -> tuple[int, ...]:
        """The senses that were run, anticlockwise first."""
        return tuple(s for s in (1, -1) if (self.sense == s).any())

    @property
    def runs(self) -> list[np.ndarray]:
        """Rows of every run."""
        return [np.flatnonzero(self.run == r) for r in dict.fromkeys(self.run.tolist())]

    @property
    def step(self) -> float:
        """Usual step of the angle within a run [degrees]."""
        steps = np.concatenate([np.abs(_wrapped(np.diff(self.angle[rows]))) for rows in self.runs])
        return float(np.median(steps[steps > _SAME])) if (steps > _SAME).any() else 360.0

    @property
    def share(self) -> np.ndarray:
        """Part of its run that each reading stands for, (m,): half the angle to either neighbour, in usual steps.

        A full circle whose last reading is at the angle of the first counts both by half.
        """
        found = np.ones(len(self))
        for rows in self.runs:
            turned = np.mod(self.angle[rows], 360.0)
            order = np.argsort(turned, kind="stable")
            gaps = np.diff(turned[order], append=turned[order[0]] + 360.0)
            gaps = np.where(gaps < _FULL * self.step, gaps, self.step)
            found[rows[order]] = 0.5 * (gaps + np.roll(gaps, 1)) / self.step
        return found

    @property
    def arc(self) -> float:
        """Angle that was run over [degrees]; 360 for full circles."""
        places = np.unique(np.round(self.angle % 360.0, 9))
        gaps = np.diff(places, append=places[0] + 360.0)
        return 360.0 if gaps.max() < _FULL * self.step else float(360.0 - gaps.max())

    @property
    def is_full(self) -> bool:
        """Whether full circles were run."""
        return self.arc == 360.0

    def name(self, sense: int) -> str:
        """The sense as the index of the standard's symbols: XY from X to Y, anticlockwise, and YX."""
        return self.plane if sense > 0 else self.plane[::-1]


def circular_readings(
    plane: str,
    radius: float,
    angle: np.ndarray,
    deviation: np.ndarray,
    sense: np.ndarray | None = None,
    run: Sequence[object] | None = None,
    source: str = "",
) -> CircularReadings:
    """Readings in the order in which they were taken, cut into runs.

    A run ends where the sense changes, the angle jumps, a label changes, or a turn is complete.

    Args:
        plane: Two axes, such as "XY", from the first of which towards the second the angle counts. Of "YX", "ZY" and "XZ"
            angles and senses are turned into those of XY, YZ and ZX.
        radius: Nominal radius [mm].
        angle: Commanded angle, shape (m,) [degrees].
        deviation: Radius that was read minus `radius`, shape (m,) [mm].
        sense: +1 anticlockwise, -1 clockwise, shape (m,); None: as the angle grows or falls from row to row.
        run: Labels of the runs, m of them; None: none.
        source: File or set, for messages.

    Raises:
        InputError: no such plane, a run of fewer than 8 readings, deviations of more than a twentieth of the radius from their
            middle, or a middle of more than a fiftieth of it.

    >>> turned = circular_readings("XZ", 100.0, np.arange(0.0, 360.0, 10.0), np.zeros(36))
    >>> turned.plane, turned.senses, turned.angle[:3].tolist()
    ('ZX', (-1,), [90.0, 80.0, 70.0])
    """
    found, where = _plane(plane, source), f"{source}: " if source else ""
    angle, deviation = np.asarray(angle, dtype=float), np.asarray(deviation, dtype=float)
    if plane.upper() != found:
        angle, sense = 90.0 - angle, None if sense is None else -np.asarray(sense)
    if not radius > 0.0:
        raise InputError(f"{where}radius is {radius:g}; expected the nominal radius of the circle in mm")
    _check_size(deviation, radius, where)
    labels = np.zeros(len(angle), dtype=int) if run is None else np.unique(np.asarray(run), return_inverse=True)[1]
    senses, number = _runs(angle, np.asarray(labels).ravel(), None if sense is None else np.asarray(sense))
    result = CircularReadings(found, float(radius), angle, deviation, senses, number, source=source)
    for rows in result.runs:
        if len(rows) < FEWEST:
            raise InputError(
                f"{where}the run that begins at {angle[rows[0]]:g}° has {len(rows)} readings; expected at least {FEWEST}, in the "
                "order in which they were taken"
            )
    return result


def _check_size(deviation: np.ndarray, radius: float, where: str) -> None:
    """Raises `InputError` for deviations that a ball bar on a circle of this radius cannot read."""
    middle = float(np.median(deviation)) if len(deviation) else 0.0
    largest = float(np.abs(deviation - middle).max(initial=0.0))
    if largest > _LARGEST * radius:
        raise InputError(
            f"{where}deviations of the radius reach {largest:.4g} mm on a circle of {radius:g} mm; expected the "
            "readings of a ball bar in mm, and the nominal radius of the circle that was run"
        )
    if abs(middle) > _OTHER * radius:
        raise InputError(
            f"{where}radii of about {radius + middle:.6g} mm on a circle of {radius:g} mm; expected the nominal radius of the "
            "circle that was run, in mm (no diameter), lengths under radius, and lengths less the nominal one under deviation"
        )


def merged(tests: Sequence[CircularReadings]) -> CircularReadings:
    """Several tests of one plane, centre and radius as one; those of unknown length each keep their own."""
    first = tests[0]
    if len(tests) == 1:
        return first
    runs = np.cumsum([0, *(int(t.run.max()) + 1 for t in tests)])
    parts = np.cumsum([0, *(0 if t.is_calibrated else int(t.parts.max()) + 1 for t in tests)])
    known = [t.u for t in tests if t.u is not None]
    return replace(
        first,
        angle=np.concatenate([t.angle for t in tests]),
        deviation=np.concatenate([t.deviation for t in tests]),
        sense=np.concatenate([t.sense for t in tests]),
        run=np.concatenate([t.run + n for t, n in zip(tests, runs, strict=False)]),
        u=np.concatenate(known) if len(known) == len(tests) else None,
        length_u=max(t.length_u for t in tests),
        part=np.concatenate([t.parts + n for t, n in zip(tests, parts, strict=False)]),
        source=", ".join(dict.fromkeys(t.source for t in tests)),
    )


def _plane(plane: str, source: str) -> str:
    for name in PLANES:
        if sorted(plane.upper()) == sorted(name):
            return name
    raise InputError(f"{f'{source}: ' if source else ''}plane is '{plane}'; expected one of {', '.join(PLANES)}")


def _wrapped(step: np.ndarray) -> np.ndarray:
    """Steps of an angle between -180 and 180 degrees."""
    return (step + 180.0) % 360.0 - 180.0


def _runs(angle: np.ndarray, label: np.ndarray, sense: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
    """Sense and number of the run, row by row."""
    step = np.concatenate([[0.0], _wrapped(np.diff(angle))])
    usual = np.median(np.abs(step[np.abs(step) > _SAME])) if (np.abs(step) > _SAME).any() else 0.0
    jump = np.abs(step) > max(_JUMP * usual, _SAME)
    new = np.concatenate([[True], np.diff(label) != 0]) | jump
    way = np.where(new | (np.abs(step) <= _SAME), 0, np.sign(step)).astype(int)
    for i in range(len(way) - 2, -1, -1):  # a first row, and one at a turning point, go as the next row does
        if way[i] == 0:
            way[i] = way[i + 1]
    for i in range(1, len(way)):
        way[i] = way[i] or way[i - 1]
    senses = np.where(way == 0, 1, way) if sense is None else sense.astype(int)
    new |= np.concatenate([[True], np.diff(senses) != 0])
    start = np.flatnonzero(new)[np.cumsum(new) - 1]
    swept = np.cumsum(np.where(new, 0.0, np.abs(step)))
    turn = np.floor(np.maximum(swept - swept[start] - _SAME, 0.0) / 360.0)
    new |= np.concatenate([[False], np.diff(turn) > 0])
    return senses, np.cumsum(new) - 1
