"""Which touches of a probe belong to one sphere in one pose of the machine, and which groups are the same sphere.

A group ends where a label changes (the tool path, the name of the sphere), where a rotary axis moves or another tool is used,
after a stated number of touches, or where the next touch is farther than a stated gap from all touches of the group. Groups
whose centres nearly coincide on the workpiece are one sphere: two spheres cannot be nearer than their diameters allow."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from volid.campaign import SAME_ANGLE
from volid.exceptions import InputError

SAME_TOOL = 1e-6  # mm
_LATEST = 200  # touches of a group by which a gap is judged: a file of a million touches takes no time that grows with the square


@dataclass(frozen=True, eq=False)
class Touches:
    """Touches as they were read, in their order.

    Args:
        source: The file.
        points: Nominal centres of the stylus ball on the workpiece, shape (n, 3). [mm]
        rotary: Positions of the rotary axes in machine order, shape (n, r). [°]
        tool: Tool vectors, shape (n, 3). [mm]
        labels: Text columns that tell groups apart, each of shape (n,).
        rows: Line numbers, shape (n,).
    """

    source: str
    points: np.ndarray
    rotary: np.ndarray
    tool: np.ndarray
    labels: dict[str, np.ndarray]
    rows: np.ndarray

    def __len__(self) -> int:
        return len(self.rows)


def groups_of(touches: Touches, count: int | None, gap: float | None) -> list[np.ndarray]:
    """Places of the touches of every group, in their order: `count` of them in each, or none farther than `gap` [mm] off.

    Raises `InputError` where the touches are no multiple of `count`, or a group of `count` holds two labels or poses.
    """
    parts = np.split(np.arange(len(touches)), np.flatnonzero(_changes(touches)) + 1)
    if count is not None:
        return [piece for part in parts for piece in _counted(touches, part, count)]
    return [piece for part in parts for piece in (_apart(touches.points, part, gap) if gap else [part])]


def _changes(touches: Touches) -> np.ndarray:
    """Where the next touch has another label, pose or tool, shape (n - 1,)."""
    moved = (np.abs(np.diff(touches.rotary, axis=0)) > SAME_ANGLE).any(axis=1)
    moved |= (np.abs(np.diff(touches.tool, axis=0)) > SAME_TOOL).any(axis=1)
    for values in touches.labels.values():
        moved |= values[1:] != values[:-1]
    return np.asarray(moved)


def _counted(touches: Touches, part: np.ndarray, count: int) -> list[np.ndarray]:
    if len(part) % count:
        first, last = touches.rows[part[0]], touches.rows[part[-1]]
        raise InputError(
            f"{touches.source}, rows {first} to {last}: {len(part)} touches with one label, pose and tool; expected a multiple "
            f"of count = {count}. Remove the touches that belong to no sphere, or tell spheres apart by a label"
        )
    return np.split(part, len(part) // count)


def _apart(points: np.ndarray, part: np.ndarray, gap: float) -> list[np.ndarray]:
    found: list[list[int]] = [[int(part[0])]]
    for i in part[1:]:
        near = np.linalg.norm(points[found[-1][-_LATEST:]] - points[i], axis=1).min() <= gap
        if near:
            found[-1].append(int(i))
        else:
            found.append([int(i)])
    return [np.array(places) for places in found]


def same_spheres(centres: np.ndarray, reach: float) -> np.ndarray:
    """Number of the sphere, from 0, of every centre (n, 3) [mm]: those in a chain of steps up to `reach` [mm] are one."""
    numbers = np.full(len(centres), -1)
    for i in range(len(centres)):
        near = np.flatnonzero((numbers >= 0) & (np.linalg.norm(centres - centres[i], axis=1) <= reach))
        found = np.unique(numbers[near])
        numbers[i] = found[0] if found.size else numbers.max() + 1
        numbers[np.isin(numbers, found)] = numbers[i]
    return np.unique(numbers, return_inverse=True)[1] if len(numbers) else numbers
