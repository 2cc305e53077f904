"""How an unknown of a campaign answers small rigid motions of the frame that it lives in: what a change of datum needs to know.

A change of datum moves the frame of every body of the machine, workpiece, bed and carriages, by a small rigid motion
x -> x - (t + ω × x), and may turn the tool vectors by a constant h (where a tool rotation is held at 0). An unknown ν becomes
ν - row · (t, ω, h), with the motion of its own body. Members are final; each has a plain form for files.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

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
    """What the readings of a set would change by, whatever the unknowns did: why a transformation may not be exact.

    `rows` (k, 9): |rows · (t, ω, h)| is the root mean square change of the readings in units of their u. `reason`: in words,
    with what to do about it.
    """

    rows: Rows
    reason: str


def remainder(rows: np.ndarray, u: np.ndarray | float, reason: str) -> Remainder | None:
    """`Remainder` of readings that change by `rows` (m, 9) [their unit]; None where that is rounding."""
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
    """How an unknown answers the motion of the frame of `body`; `left`: what it cannot follow."""

    body: str = "workpiece"
    left: Remainder | None = None

    @abstractmethod
    def row(self, value: Values) -> np.ndarray:
        """∂(what is taken off the unknown)/∂(t, ω, h), shape (9,); `value`: present value of an unknown by its key."""

    def joined(self, other: Response) -> Response:
        """The response to the readings of two sets that share the unknown: that of the first, unless a class knows better."""
        return self if self.left is not None or other.left is None else replace(self, left=other.left)


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
        turned = np.array([np.cross(axis, p)[self.component] for axis in np.eye(3)])
        return np.concatenate([np.eye(3)[self.component], turned, self.tool[self.component]])

    def joined(self, other: Response) -> Response:
        """Sets that see the point with other tool vectors leave a remainder."""
        if not isinstance(other, PlaceOf):
            return super().joined(other)
        change = np.array(other.tool) - np.array(self.tool)
        parts = [np.array(r.left.rows) for r in (self, other) if r.left is not None]
        reasons = [r.left.reason for r in (self, other) if r.left is not None]
        if np.abs(change).max() > 1e-9:
            parts.append(np.pad(change / other.u, ((0, 0), (6, 0))))
            reasons.append(SEVERAL_TOOLS)
        if not parts:
            return self
        return replace(self, left=remainder(np.concatenate(parts), np.sqrt(1.0 / sum(map(len, parts))), reasons[0]))


@dataclass(frozen=True)
class TurnOf(Response):
    """Component of the small rotation vector o of something that stands on the body.

    `sense` -1: it looks at the world from the body, x -> R(o) F x (an instrument); +1: it is carried, x -> R(o) x with F = 1 (a
    network of stations). `of`: keys of o; `frame`: F.
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
}


def to_plain(response: Response) -> dict[str, Any]:
    """The response as plain numbers, texts and lists, for files."""
    how = next(name for name, form in _FORMS.items() if type(response) is form)
    return {"how": how, **asdict(response)}


def from_plain(plain: dict[str, Any]) -> Response:
    """The response from what `to_plain` gave, read back from a file (KeyError for an unknown form)."""
    fields = {key: _tuples(value) for key, value in plain.items() if key != "how"}
    left = plain.get("left")
    fields["left"] = None if left is None else Remainder(_tuples(left["rows"]), left["reason"])
    return _FORMS[plain["how"]](**fields)


def _tuples(value: Any) -> Any:
    return tuple(_tuples(v) for v in value) if isinstance(value, list | tuple) else value
