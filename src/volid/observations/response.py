"""How an unknown of a campaign answers small rigid motions of the frame it belongs to, which a change of datum needs to know.

A change of datum moves the frame of every body of the machine, workpiece, bed and carriages, by a small rigid motion
x -> x - (t + ω × x), and may turn the tool vectors by a constant h (where a tool rotation is held at 0). An unknown ν becomes
ν - row · (t, ω, h), with the motion of its own body. The classes are final, and each has a plain form for files.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from volid.model.geometry import rotate_exactly, skew, turned_direction

TOOL_VECTORS = "tool vectors"  # the frame in which they are given, as a body
MOTIONS = 9  # t [mm], ω [rad] of the body's frame, and h [rad] of the tool
Key = tuple[str, ...]
Rows = tuple[tuple[float, ...], ...]
Values = Callable[[Key], float]
_NO_TURN: Rows = ((0.0,) * 3,) * 3


def as_rows(matrix: np.ndarray) -> Rows:
    """A matrix as nested tuples: values that can be compared, hashed and written as text."""
    return tuple(tuple(float(v) for v in row) for row in np.asarray(matrix))


@dataclass(frozen=True)
class Remainder:
    """The change of a set's readings that no change of the unknowns can follow: the reason why a transformation is not exact.

    `rows` (k, 9): |rows · (t, ω, h)| is the root mean square change of the readings in units of their u. `reason`: in words,
    with what to do about it.
    """

    rows: Rows
    reason: str


def remainder(rows: np.ndarray, u: np.ndarray | float, reason: str) -> Remainder | None:
    """`Remainder` of readings that change by `rows` (m, 9) [their unit]; None where the change is only rounding."""
    u = np.asarray(u, dtype=float)
    u = np.where(np.isfinite(u) & (u > 0.0), u, 1.0)  # a plan may leave it open
    rows = np.asarray(rows) / np.reshape(u, (-1, 1)) / np.sqrt(max(len(rows), 1))
    if len(rows) > MOTIONS:
        rows = np.asarray(np.linalg.qr(rows, mode="r"))
    _, sizes, vt = np.linalg.svd(rows, full_matrices=False)
    kept = sizes > 1e-12 * np.max(sizes, initial=1.0)
    return Remainder(as_rows(sizes[kept, None] * vt[kept]), reason) if kept.any() else None


@dataclass(frozen=True)
class Response(ABC):
    """How an unknown answers the motion of the frame of `body`. `not_followed`: the part that it cannot follow, if any."""

    body: str = "workpiece"
    not_followed: Remainder | None = None

    @abstractmethod
    def row(self, value: Values) -> np.ndarray:
        """∂(what is subtracted from the unknown)/∂(t, ω, h), shape (9,); `value`: present value of an unknown by its key."""

    def joined(self, other: Response) -> Response:
        """The response of an unknown that two sets share: by default that of the first set."""
        return self if self.not_followed is not None else replace(self, not_followed=other.not_followed)


@dataclass(frozen=True)
class Unmoved(Response):
    """No answer: a dead path, a sensor's scale, a systematic effect."""

    def row(self, value: Values) -> np.ndarray:
        """Zeros."""
        return np.zeros(MOTIONS)


@dataclass(frozen=True)
class Linear(Response):
    """A constant row: the offset or slope of a line of readings."""

    constant: tuple[float, ...] = (0.0,) * MOTIONS

    def row(self, value: Values) -> np.ndarray:
        """The constant row."""
        return np.array(self.constant)


@dataclass(frozen=True)
class PlaceOf(Response):
    """Coordinate number `component` of a point that stands on the body: t + ω × p.

    `of`: keys of its three coordinates, which count from `offset`. `tool` (3, 3): answer of the coordinates to the tool's
    rotation h, where all readings see the point with one tool vector. `u`: of the readings that see it.
    """

    of: tuple[Key, ...] = ()
    component: int = 0
    offset: tuple[float, ...] = (0.0, 0.0, 0.0)
    tool: Rows = _NO_TURN
    u: float = 1.0

    def row(self, value: Values) -> np.ndarray:
        """(e_i, rows of [·× p], of the tool)."""
        p = np.array([value(key) for key in self.of]) + np.array(self.offset)
        return np.concatenate([np.eye(3)[self.component], skew(-p)[self.component], self.tool[self.component]])

    def joined(self, other: Response) -> Response:
        """Sets that see the point with other tool vectors leave a remainder."""
        if not isinstance(other, PlaceOf):
            return super().joined(other)
        change = np.array(other.tool) - np.array(self.tool)
        parts = [np.array(r.not_followed.rows) for r in (self, other) if r.not_followed is not None]
        reasons = [r.not_followed.reason for r in (self, other) if r.not_followed is not None]
        if np.abs(change).max() > 1e-9:
            parts.append(np.pad(change / other.u, ((0, 0), (6, 0))))
            reasons.append(SEVERAL_TOOLS)
        if not parts:
            return self
        return replace(
            self, not_followed=remainder(np.concatenate(parts), np.sqrt(1.0 / sum(map(len, parts))), reasons[0])
        )


@dataclass(frozen=True)
class TurnOf(Response):
    """Component of the small rotation vector o of something that stands on the body.

    `sense` -1: the thing is an instrument, which sees points from its body, x -> R(o) F x. `sense` +1: the body carries it,
    x -> R(o) x with F = 1, as a network of stations. `of`: keys of o; `frame`: F.
    """

    of: tuple[Key, ...] = ()
    component: int = 0
    sense: float = -1.0
    frame: Rows = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))

    def row(self, value: Values) -> np.ndarray:
        """sense · (1 - sense/2 [o]×) F, exact to second order."""
        a, b, c = (value(key) for key in self.of)
        twist = np.array([[0.0, -c, b], [c, 0.0, -a], [-b, a, 0.0]])
        turned = self.sense * (np.eye(3) - 0.5 * self.sense * twist) @ np.array(self.frame)
        return np.concatenate([np.zeros(3), turned[self.component], np.zeros(3)])


@dataclass(frozen=True)
class TurnOfLine(Response):
    """Component of the rotation vector o of a straight thing that the body carries, x -> R(o) x, whose roll is not determined.

    `of`: keys of o. `along`: direction of the line where o = 0. `held`: the component of o that stays what it is, because a roll
    about the line makes up for what it would have to be.
    """

    of: tuple[Key, ...] = ()
    component: int = 0
    along: tuple[float, ...] = (1.0, 0.0, 0.0)
    held: int = 0

    def row(self, value: Values) -> np.ndarray:
        """L - r L_held / r_held with L = 1 - [o]×/2 for the motion, r = (1 + [o]×/2) along for a roll, to second order."""
        a, b, c = (value(key) for key in self.of)
        twist = np.array([[0.0, -c, b], [c, 0.0, -a], [-b, a, 0.0]])
        left, roll = np.eye(3) - 0.5 * twist, (np.eye(3) + 0.5 * twist) @ np.array(self.along)
        turned = left - np.outer(roll, left[self.held]) / roll[self.held]
        return np.concatenate([np.zeros(3), turned[self.component], np.zeros(3)])


@dataclass(frozen=True)
class GapOf(Response):
    """Offset of a surface on the body, whose normal R n turns with a rotation vector o and which is read along e.

    A motion changes the gap at point p of the surface by (R n)·(t + ω × p + T h) / (R n)·e. `of`: keys of o; `normal` n,
    `point` p, `read` e; `turned` T (3, 3): what a constant rotation h of the tool does to the functional point, in the frame of
    the body.
    """

    of: tuple[Key, ...] = ()
    normal: tuple[float, ...] = (0.0, 0.0, 1.0)
    point: tuple[float, ...] = (0.0, 0.0, 0.0)
    read: tuple[float, ...] = (0.0, 0.0, 1.0)
    turned: Rows = _NO_TURN

    def row(self, value: Values) -> np.ndarray:
        """-(R n, p × R n, -R n T) / (R n)·e."""
        a, b, c = (value(key) for key in self.of)
        normal = np.array(rotate_exactly((a, b, c), self.normal))  # type: ignore[arg-type]
        whole = np.concatenate([-normal, -np.cross(self.point, normal), normal @ np.array(self.turned)])
        return np.asarray(whole / (normal @ np.array(self.read)))


@dataclass(frozen=True)
class DirectionOf(Response):
    """Tangent number `component` of a direction d0 + β1 a + β2 b that the body carries. `of`: keys of β; `frame`: d0, a, b."""

    of: tuple[Key, ...] = ()
    component: int = 0
    frame: Rows = _NO_TURN

    def row(self, value: Values) -> np.ndarray:
        """v × e - β (v × d0) with v = d0 + β1 a + β2 b and e its own a or b: exact for β of any size."""
        along, *across = np.array(self.frame)
        angles = np.array([value(key) for key in self.of])
        v = along + angles @ np.array(across)
        turned = np.cross(v, across[self.component]) - angles[self.component] * np.cross(v, along)
        return np.concatenate([np.zeros(3), turned, np.zeros(3)])


@dataclass(frozen=True)
class ReachOf(Response):
    """Offset of a length along a direction d on the body, from `point` p to a reflector, or to a plane across d on the tool.

    A motion that beam and reflector follow changes the length by d·(t + ω × p + T h). `of`: keys of the angles of d in `frame`
    (rows: nominal direction and two across it); `turned` T (3, 3): as in `GapOf`.
    """

    of: tuple[Key, ...] = ()
    frame: Rows = _NO_TURN
    point: tuple[float, ...] = (0.0, 0.0, 0.0)
    turned: Rows = _NO_TURN

    def row(self, value: Values) -> np.ndarray:
        """-(d, p × d, -d T)."""
        d = np.array(turned_direction(self.frame, [value(key) for key in self.of]))
        return np.concatenate([-d, -np.cross(self.point, d), d @ np.array(self.turned)])


UNMOVED = Unmoved()
SEVERAL_TOOLS = (
    "the new datum turns the tool, whose rotation the model leaves out or holds at 0, and the readings see several tool vectors. "
    'Set "E?0S" = true in [model.functions] and fit again, or fit in that datum: [datum] of the machine file'
)
_FORMS: dict[str, type[Response]] = {
    "none": Unmoved,
    "row": Linear,
    "point": PlaceOf,
    "rotation": TurnOf,
    "rotation of a line": TurnOfLine,
    "gap": GapOf,
    "direction": DirectionOf,
    "reach": ReachOf,
}


def to_plain(response: Response) -> dict[str, Any]:
    """The response as plain numbers, texts and lists, for files."""
    how = next(name for name, form in _FORMS.items() if type(response) is form)
    plain = asdict(response)
    plain["left"] = plain.pop("not_followed")  # its name in files
    return {"how": how, **plain}


def from_plain(plain: dict[str, Any]) -> Response:
    """The response from what `to_plain` gave, read back from a file (KeyError for an unknown form)."""
    fields = {key: _tuples(value) for key, value in plain.items() if key not in ("how", "left")}
    kept = plain.get("left")
    fields["not_followed"] = None if kept is None else Remainder(_tuples(kept["rows"]), kept["reason"])
    return _FORMS[plain["how"]](**fields)


def _tuples(value: Any) -> Any:
    return tuple(_tuples(v) for v in value) if isinstance(value, list | tuple) else value
