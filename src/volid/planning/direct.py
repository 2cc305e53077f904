"""Direct measurement of every error function of three linear axes: laser, levels, straightedge, square.

A horizontal machine with a cross bed is the classical example: levels in pairs give the rotations about the two horizontal axes,
angular optics those about the vertical one where the table moves, linear optics the positioning, a straightedge the straightness
of the horizontal axes, squares that of the vertical axis and all squareness. The roll of the vertical axis is what one square
shows at two places apart, read by two gauges as far apart on the head; a level on the square corrects its tilt.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from volid.campaign import Alignment, Campaign, ObservationSet
from volid.exceptions import InputError
from volid.model.iso230 import LINEAR_AXES, ROTATIONS
from volid.model.machine import Machine
from volid.model.requests import ask_plan, ask_positions, ask_tools, ask_uncertainty, checked_count, checked_number
from volid.planning.reading_lines import OTHER_RUNS, Places, Readings, Row

TOOL = (0.0, 0.0, -150.0)  # mm
LASER_RUNS = 5  # forward and back each
APART = 600.0  # mm: places of the square for the roll of the vertical axis
LEVEL_U, ANGLE_U = 1e-6, 2e-6  # rad: of levels and angular optics; of the right angle of a square, and how it leans
TIMES = 4  # how often the level on the square is read at each place


def direct_plan(
    machine: Machine,
    vertical: str | None = None,
    tool: Sequence[float] = TOOL,
    at: Mapping[str, float] | None = None,
    *,
    points: int = 11,
    u: float = 0.0005,
    form_u: float = 0.0005,
) -> Campaign:
    """Plan of the direct measurement of all 18 error functions and the three squareness errors of X, Y and Z.

    Every axis is read on one line over its travel, the others resting. Straightedges are read upright and turned over, so that
    their own form falls out; each square is placed once, and both of its legs are read. Whether the table holds the artefacts,
    and whether the gauges reach them, is not considered.

    Args:
        machine: A machine with the linear axes X, Y and Z.
        vertical: The axis that is vertical: levels see no turn about it.
        tool: Vector to the functional point, (x, y, z) [mm]; the gauges for the roll stand 300 mm to either side of it.
        at: Where axes rest while another is measured [mm]; the middle of their travel where it is not said.
        points: Positions along every line, both ends included.
        u: Standard uncertainty of a reading of a length [mm]; levels and angles have 1 µrad.
        form_u: Standard uncertainty of the form of straightedges and squares [mm]; 0: they are straight.

    Returns:
        A campaign without readings: sets of `component` and `level` and the placements of the artefacts.

    Raises:
        InputError: the machine has not three linear axes, or `vertical` is none of them, or a number is none.

    References:
        ISO 230-1, measurement of straightness, squareness and angular errors; ISO/TR 16907 9.

    Example:
        >>> from volid.io import read_machine
        >>> plan = direct_plan(read_machine("models/wXZbYt_cross_bed.toml"), "Y")
        >>> [s.name for s in plan.sets][:3], len(plan.alignments)
        (['levels', 'laser', 'angular optics'], 13)
    """
    _ask(machine, vertical, points)
    ask_tools(machine, tool)
    ask_uncertainty("u", u)
    checked_number("form_u", form_u, least=0.0)
    ask_positions(machine, {a: [float(v)] for a, v in (at or {}).items()}, "at")
    rest = Places(machine, str(vertical), np.asarray(tool, dtype=float), dict(at or {}), points)
    lines = _Lines(rest, u, form_u)
    sets = [lines.levels(), lines.laser(), lines.angular()]
    for make in (lines.straightedges, lines.squares, lines.roll):
        sets += make()
    return Campaign(
        machine,
        (),
        tuple(sets),
        "Direct measurement",
        conditions={"vertical_axis": str(vertical)},
        alignments=tuple(lines.alignments),
        source="direct plan",
    )


def _ask(machine: Machine, vertical: str | None, points: int) -> None:
    """Raises `InputError` for a machine without three linear axes, an axis that is not vertical, or too few points."""
    if {a.letter for a in machine.linear} != set(LINEAR_AXES):
        found = ", ".join(a.letter for a in machine.linear) or "none"
        raise InputError(f"machine '{machine.name}': direct measurement needs X, Y and Z; its linear axes are {found}")
    if vertical not in LINEAR_AXES:
        raise InputError(
            f"`vertical` is {vertical or 'not stated'}; expected X, Y or Z, the axis that is vertical (levels see no turn "
            "about it)"
        )
    checked_count("points", points, 3, 10_000)
    ask_plan("direct", 60 * points)


@dataclass
class _Lines:
    """The sets of the plan; `alignments` fill as artefacts are placed."""

    places: Places
    u: float
    form_u: float
    alignments: list[Alignment] = field(default_factory=list)

    def levels(self) -> ObservationSet:
        """Both horizontal rotations of every axis by levels in pairs."""
        letters = [_about(a) for a in self.places.horizontal]
        rows = [Row(c, axis, axis, 1) for axis in LINEAR_AXES for c in letters]
        return self._set("levels", rows, LEVEL_U, {"vertical": self.places.vertical}, levels=True)

    def laser(self) -> ObservationSet:
        """Positioning by linear optics."""
        return self._set("laser", [Row(a, a, a, LASER_RUNS) for a in LINEAR_AXES], self.u, {"slope": False})

    def angular(self) -> ObservationSet:
        """Rotations of the horizontal axes about the vertical by angular optics."""
        about = _about(self.places.vertical)
        return self._set(
            "angular optics", [Row(about, a, a) for a in self.places.horizontal], LEVEL_U, {"slope": False}
        )

    def straightedges(self) -> list[ObservationSet]:
        """Straightness of the horizontal axes, upright and, where the form of the edge is unknown, turned over."""
        sets = []
        for axis in self.places.horizontal:
            for across in (a for a in LINEAR_AXES if a != axis):
                for name, sense in (("upright", 1.0), ("turned over", -1.0))[: 2 if self.form_u else 1]:
                    line = {"edge": {"along": _unit(axis), "normal": _unit(across, sense)}}
                    place = self._place(f"edge {axis}{across} {name}", f"edge {axis}{across}")
                    sets.append(self._on_artefact(place, [Row(across, axis, "edge")], line))
        return sets

    def squares(self) -> list[ObservationSet]:
        """Both legs of a square in each of the three planes."""
        sets = []
        one, other = self.places.horizontal
        for first, second in ((one, self.places.vertical), (other, self.places.vertical), (one, other)):
            legs = {f"leg_{a}": _line(a, b) for a, b in ((first, second), (second, first))}
            rows = [Row(second, first, f"leg_{first}"), Row(first, second, f"leg_{second}")]
            place = self._place(f"square {first}{second}", f"square {first}{second}")
            sets.append(self._on_artefact(place, rows, legs, angle_u=ANGLE_U))
        return sets

    def roll(self) -> list[ObservationSet]:
        """Roll of the vertical axis: the upright leg of a square at two places apart, and a level on it in both."""
        (one, other), vertical = self.places.horizontal, self.places.vertical
        apart = min(APART, self.places.machine.axes[self.places.machine.index(one)].length)
        sets, names = [], []
        for name, sense in (("here", -0.5), ("there", 0.5)):
            offset = tuple(sense * apart * c for c in _unit(one))
            leg = {f"leg_{vertical}": _line(vertical, other)}
            names.append(self._place(f"square {name}", f"square {other}{vertical}"))
            row = Row(other, vertical, f"leg_{vertical}", OTHER_RUNS, (offset[0], offset[1], offset[2]))
            sets.append(self._on_artefact(names[-1], [row], leg))
        m = TIMES * len(names)
        q = np.tile(self.places.resting, (m, 1))
        labels = {"component": np.full(m, _about(one)), "placement": np.repeat(names, TIMES)}
        stood = Readings(
            q,
            np.zeros_like(q),
            np.zeros((m, 3)),
            {"line": np.full(m, "1"), "run": np.tile(np.arange(1, TIMES + 1).astype(str), len(names))} | labels,
        )
        return [*sets, stood.as_set("level on the square", "level", LEVEL_U, {"vertical": vertical})]

    def _place(self, name: str, artefact: str) -> str:
        self.alignments.append(Alignment(name, artefact=artefact))
        return name

    def _on_artefact(self, place: str, rows: list[Row], lines: Mapping[str, Any], **options: Any) -> ObservationSet:
        stated = {"slope": False, "alignment": place, "lines": dict(lines), **options}
        return self._set(place, rows, self.u, stated | ({"form_u": self.form_u} if self.form_u else {}))

    def _set(
        self, name: str, rows: list[Row], u: float, options: Mapping[str, Any], levels: bool = False
    ) -> ObservationSet:
        parts = [self._line(row, levels) for row in rows]
        joined = [np.concatenate(arrays) for arrays in zip(*(p.arrays for p in parts), strict=True)]
        labels = {key: np.concatenate([p.labels[key] for p in parts]) for key in parts[0].labels}
        return Readings(joined[0], joined[1], joined[2], labels).as_set(
            name, "level" if levels else "component", u, options
        )

    def _line(self, row: Row, levels: bool) -> Readings:
        q, directions, runs = self.places.along(row.axis, row.runs)
        m = len(q)
        labels = {"component": np.full(m, row.component), "line": np.full(m, row.line), "run": runs}
        labels |= {"placement": np.full(m, "machine")} if levels else {}
        tool = np.zeros(3) if levels else self.places.tool + np.array(row.offset)
        return Readings(q, directions, np.tile(tool, (m, 1)), labels)


def _about(axis: str) -> str:
    return ROTATIONS[LINEAR_AXES.index(axis)]


def _unit(axis: str, sense: float = 1.0) -> list[float]:
    return [sense * float(a == axis) for a in LINEAR_AXES]


def _line(axis: str, across: str) -> dict[str, list[float]]:
    return {"along": _unit(axis), "normal": _unit(across)}
