"""The machine: structural code, axes and nominal chain (CONVENTIONS 2)."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from volid.backend.pytrees import STATIC, register_dataclass, register_if_imported
from volid.exceptions import InputError
from volid.model.geometry import skew
from volid.model.iso230 import LINEAR_AXES, ROTARY_AXES

if TYPE_CHECKING:
    from jaxtyping import Float

BED = "bed"
WORKPIECE = "workpiece"
TOOL = "tool"


@register_dataclass
@dataclass(frozen=True)
class Axis:
    """One numerically controlled axis.

    `letter`: X, Y, Z (mm) or A, B, C (degrees). `primed`: it carries the workpiece. `travel`: commanded end positions.
    `reference`: where its error functions are zero. `error_point`: shape (3,) [mm], the point that its rotations turn
    about; by default the machine origin, for a rotary axis `point`.
    `point`: shape (3,) [mm], on the nominal axis line of a rotary axis. `direction`: shape (3,), unit vector, (0, 0, 0)
    for the letter's own. `axis_frame`: True when the six error components of a rotary axis refer to a frame turned so that
    the letter's own direction lies along `direction`, False for the machine frame. `pitch`: period of short waves in the
    translations of a linear axis, such as the pitch of its screw [mm]; 0 for none.
    """

    letter: str = field(metadata=STATIC)
    primed: bool = field(metadata=STATIC)
    travel: tuple[float, float] = field(metadata=STATIC)
    reference: float = field(metadata=STATIC)
    error_point: tuple[float, float, float] = field(metadata=STATIC, default=None)  # type: ignore[assignment]
    point: tuple[float, float, float] = field(metadata=STATIC, default=(0.0, 0.0, 0.0))
    direction: tuple[float, float, float] = field(metadata=STATIC, default=(0.0, 0.0, 0.0))
    axis_frame: bool = field(metadata=STATIC, default=False)
    pitch: float = field(metadata=STATIC, default=0.0)

    def __post_init__(self) -> None:
        if self.error_point is None:
            object.__setattr__(self, "error_point", (0.0, 0.0, 0.0) if self.is_linear else self.point)

    @property
    def is_linear(self) -> bool:
        """True for X, Y, Z."""
        return self.letter in LINEAR_AXES

    @property
    def unit(self) -> str:
        """Unit of the commanded position."""
        return "mm" if self.is_linear else "°"

    @property
    def unit_vector(self) -> tuple[float, float, float]:
        """Direction of a linear axis, or of a rotary axis's line, machine frame."""
        if any(self.direction):
            return self.direction
        letters = LINEAR_AXES if self.is_linear else ROTARY_AXES
        x, y, z = (float(self.letter == letter) for letter in letters)
        return x, y, z

    @property
    def frame(self) -> np.ndarray:
        """Columns: directions of the six components' frame in the machine frame, shape (3, 3); identity unless `axis_frame`.

        The smallest rotation that carries the letter's own direction to `direction` (Rodrigues).
        """
        if self.is_linear or not self.axis_frame:
            return np.eye(3)
        nominal = np.eye(3)[ROTARY_AXES.index(self.letter)]
        target = np.asarray(self.unit_vector)
        v, c = np.cross(nominal, target), float(nominal @ target)
        if c < -1.0 + 1e-12:  # opposite: half a turn about the next direction
            other = np.roll(nominal, 1)
            return 2.0 * np.outer(other, other) - np.eye(3)
        k = skew(v)
        return np.eye(3) + k + k @ k / (1.0 + c)

    @property
    def is_full_turn(self) -> bool:
        """True for a rotary axis that travels 360° or more: its functions have period 360°."""
        return not self.is_linear and self.length >= 360.0 - 1e-9

    @property
    def length(self) -> float:
        """Travel from end to end [mm or degrees]."""
        return self.travel[1] - self.travel[0]


@dataclass(frozen=True)
class Datum:
    """The machine coordinate system after the fit.

    Args:
        primary: letter of the linear axis that gives the first direction.
        secondary: letter of the linear axis that gives the plane.
        line: reference line of the straightness functions: "least_squares" over the measured range, or "end_point".
        reference: pairs of axis letter and position [mm or degrees] where the functions are zero, in place of the axis's own.

    Source: CONVENTIONS 4; ISO 230-1.

    >>> Datum(primary="Z", secondary="X").line
    'least_squares'
    """

    primary: str = "X"
    secondary: str = "Y"
    line: str = "least_squares"
    reference: tuple[tuple[str, float], ...] = ()


@dataclass(frozen=True)
class FunctionSettings:
    """How one error function is modelled; None means the model's default.

    `use`: True (a function of position), "constant" or False (left out). `segments`: spline intervals, "auto" (many, with a
    smoothness that the readings decide) or one number per axis of `over`. `reversal`: False, "constant" or True (function of
    position). `over`: (own axis, second axis) for a cross effect.
    """

    use: bool | str = True
    segments: int | str | tuple[int, ...] | None = None
    degree: int | None = None
    reversal: bool | str = False
    over: tuple[str, str] | None = None


@dataclass(frozen=True)
class ModelSettings:
    """The `[model]` table of a machine file: defaults, then settings by function name or pattern, later ones winning."""

    degree: int = 3
    segments: int | str = "auto"
    functions: Mapping[str, FunctionSettings] = field(default_factory=dict, hash=False)


@register_dataclass
@dataclass(frozen=True)
class Machine:
    """A machine tool's kinematic chain, its datum and the settings of its error model.

    Args:
        name: The name of the machine, in words.
        structure: structural code of ISO 10791-6, such as "w Y' X' b Z (C) t".
        axes: The axes from the workpiece to the tool, as in `structure`; arrays of axis positions follow this order.
        datum: the coordinate system that results refer to.
        model: which error functions exist, and how they are modelled.
        text: Text of the file that it was read from.

    Source: CONVENTIONS 2.

    >>> import volid
    >>> machine = volid.load_machine("models/wYXbZt_vertical.toml")
    >>> machine.order(X=300.0, Y=200.0, Z=-100.0).tolist()  # machine axis order: Y', X', Z
    [200.0, 300.0, -100.0]
    """

    name: str = field(metadata=STATIC)
    structure: str = field(metadata=STATIC)
    axes: tuple[Axis, ...]
    datum: Datum = field(metadata=STATIC, default=Datum())
    model: ModelSettings = field(metadata=STATIC, default=ModelSettings())
    text: str = field(metadata=STATIC, default="", repr=False)

    def __post_init__(self) -> None:
        register_if_imported()

    @property
    def letters(self) -> tuple[str, ...]:
        """Axis letters from workpiece to tool: the column order of position arrays."""
        return tuple(axis.letter for axis in self.axes)

    @property
    def linear(self) -> tuple[Axis, ...]:
        """The linear axes, workpiece to tool."""
        return tuple(axis for axis in self.axes if axis.is_linear)

    def index(self, letter: str) -> int:
        """Column of axis `letter`. Raises `InputError` when the machine has no such axis."""
        if letter not in self.letters:
            raise InputError(f"machine '{self.name}' has no axis {letter}; its axes are {', '.join(self.letters)}")
        return self.letters.index(letter)

    def axis(self, letter: str) -> Axis:
        """The axis named `letter`. Raises `InputError` when the machine has no such axis."""
        return self.axes[self.index(letter)]

    def body_index(self, body: str) -> int:
        """How many axes lie between the workpiece and `body` ("workpiece", "bed", "tool" or an axis letter).

        An axis letter names the body that this axis moves: its carriage, or its table when primed.
        """
        if body == WORKPIECE:
            return 0
        if body == TOOL:
            return len(self.axes)
        if body == BED:
            return sum(axis.primed for axis in self.axes)
        i = self.index(body)
        return i if self.axes[i].primed else i + 1

    def over(self, ranges: Mapping[str, tuple[float, float]]) -> Machine:
        """The machine with the travels of some axes cut to, or widened to, stated ranges: where its error functions live.

        Args:
            ranges: Lowest and highest position by axis letter [mm or degrees]; other axes keep their travel. A reference outside
                its range moves to the nearest end (CONVENTIONS 4).

        >>> import volid
        >>> machine = volid.load_machine("models/wYXbZt_vertical.toml").over({"X": (600.0, 900.0)})
        >>> machine.axis("X").travel, machine.axis("X").reference
        ((600.0, 900.0), 600.0)
        """
        axes = tuple(
            replace(a, travel=ranges[a.letter], reference=float(np.clip(a.reference, *ranges[a.letter])))
            if a.letter in ranges
            else a
            for a in self.axes
        )
        return replace(self, axes=axes)

    def order(self, **positions: Float[np.ndarray, ...] | float) -> Float[np.ndarray, "... axes"]:
        """Positions in the machine's axis order, shape (..., n_axes) [mm or degrees].

        Args:
            positions: one number or array (...) for every axis, by its letter: X=…, Y=…, Z=… [mm or degrees].
        """
        return np.stack(np.broadcast_arrays(*(np.asarray(positions[a], dtype=float) for a in self.letters)), axis=-1)


def parse_structure(code: str, where: str = "structure") -> tuple[tuple[str, bool], ...]:
    """Axes of a structural code, (letter, primed) from workpiece to tool.

    `code`: such as "[w Y' X' b Z (C) t]"; the square brackets are optional, a letter in round brackets is a spindle
    without numerical control and no axis. Raises `InputError` naming the offending part. ISO 10791-6, CONVENTIONS 2.

    >>> parse_structure("[w X' b Z (C) t]")
    (('X', True), ('Z', False))
    """
    tokens = code.strip().removeprefix("[").removesuffix("]").split()
    if tokens[:1] != ["w"] or tokens[-1:] != ["t"]:
        raise InputError(f"{where}: '{code}' must run from w (workpiece) to t (tool), such as \"w Y' X' b Z (C) t\"")
    if tokens.count("b") != 1:
        raise InputError(f"{where}: '{code}' must hold b (bed) exactly once, such as \"w Y' X' b Z (C) t\"")
    bed = tokens.index("b")
    axes: list[tuple[str, bool]] = []
    for i, token in enumerate(tokens[1:-1], start=1):
        if token == "b" or re.fullmatch(r"\([A-Z]\)", token):
            continue
        letter = token.rstrip("'")
        if letter not in LINEAR_AXES + ROTARY_AXES or len(token) - len(letter) > 1:
            raise InputError(f"{where}: '{token}' in '{code}' is no axis; expected X, Y, Z, A, B, C, primed left of b")
        if token.endswith("'") != (i < bed):
            side = "left" if i < bed else "right"
            raise InputError(
                f"{where}: '{token}' stands {side} of b in '{code}'; axes left of b carry the workpiece and are primed, "
                "axes right of b carry the tool and are not"
            )
        if letter in [a for a, _ in axes]:
            raise InputError(f"{where}: axis {letter} stands twice in '{code}'")
        axes.append((letter, i < bed))
    if not axes:
        raise InputError(f"{where}: '{code}' has no axis; expected at least one of X, Y, Z, A, B, C")
    return tuple(axes)
