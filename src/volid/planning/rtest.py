"""R-test plans: static indexing grids over both rotary axes, and the paths of ISO 10791-6 with linear axes following.

Which axes move in which test of ISO 10791-6:2014 follows the literature on R-tests, not the clauses of the standard; feed and
evaluation are not part of a plan. Weikert, R-test, CIRP Annals 53 (2004) 429; Bringmann, Knapp, CIRP Annals 55 (2006) 531.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from volid.backend.even_points import evenly
from volid.campaign import Campaign, ObservationSet
from volid.exceptions import InputError
from volid.model.machine import Axis, Machine
from volid.model.requests import LARGEST, ask_place, ask_plan, ask_tools, ask_uncertainty, checked_count
from volid.observations.displacement import RANGE
from volid.planning.following import follow, one_turn, rotary_axes, with_rotary, within_travel
from volid.planning.places import Places, spheres_and_tools

Vector = Sequence[float]
U = 0.0005  # mm, of one coordinate of the sensor nest
TESTS = ("K1", "K2", "K4")


def rtest_static_grid(
    machine: Machine,
    spheres: Mapping[str, Vector] | None = None,
    tools: Vector | Sequence[Vector] | None = None,
    n1: int = 13,
    n2: int = 13,
    *,
    sensor_on: str = "tool",
    u: float = U,
) -> Campaign:
    """Plan of an R-test at all pairs of positions of two rotary axes, or at the positions of one.

    Positions are spaced evenly over the travel, or over one turn of a longer travel, ends included. Every second line is run
    backwards. The linear axes follow, so that without errors every displacement is 0. Positions outside a travel are left out and
    named in `warnings`. Collisions are not considered.

    Args:
        machine: A machine with X, Y, Z and one or two rotary axes.
        spheres: Places on the workpiece by name, (x, y, z) with all axes at 0 [mm]; None: as far apart as the travels let.
        tools: Vectors to the nest (or to the sphere in the spindle), (x, y, z) [mm]: one for all spheres, one per sphere, or
            several for a single sphere; None: vectors that lie on no line under a head, else one along the spindle.
        n1: Number of positions of the first rotary axis, counted from workpiece to tool; at least 2.
        n2: Number of positions of the second one.
        sensor_on: Which body carries the sensor nest, "tool" or "workpiece".
        u: Standard uncertainty of one coordinate of a displacement [mm].

    Returns:
        A campaign with one `displacement` set without readings.

    Raises:
        InputError: the machine has not one or two rotary axes; spheres and tools do not go together; no position is left.

    Example:
        >>> from volid.io import read_machine
        >>> plan = rtest_static_grid(read_machine("models/wCAYXbZt_trunnion.toml"), {"P1": (60, 0, 40)}, (0, 0, -120), 13, 7)
        >>> len(plan.sets[0]), plan.warnings
        (91, ())
    """
    axes = rotary_axes(machine)
    if len(axes) > 2:
        raise InputError(f"machine '{machine.name}' has {len(axes)} rotary axes; expected one or two for a grid")
    _ask(machine, spheres, tools, u)
    ask_plan("static grid", n1 * (n2 if len(axes) > 1 else 1))
    lines = [evenly(*one_turn(axis), _count(n, axis)) for axis, n in zip(axes, (n1, n2), strict=False)]
    pairs = [
        (a, b) for i, a in enumerate(lines[0]) for b in (lines[1][:: 1 - 2 * (i % 2)] if len(lines) > 1 else [0.0])
    ]
    grid = np.array(pairs)[:, : len(axes)].T
    positions = with_rotary(machine, **{axis.letter: q for axis, q in zip(axes, grid, strict=True)})
    places = spheres_and_tools(machine, positions, spheres, tools)
    return displacement_plan(machine, positions, np.zeros_like(positions), "static grid", places, sensor_on, u)


def iso10791_path(
    machine: Machine,
    test: str,
    sphere: Vector | None = None,
    tool: Vector | None = None,
    n: int = 73,
    *,
    sensor_on: str = "tool",
    u: float = U,
) -> Campaign:
    """Plan of a kinematic test of ISO 10791-6, there and back; the linear axes follow so that the sphere stays in the nest.

    In K1 the tilting or swivelling axis turns (the second one, counted from workpiece to tool), in K2 the other rotary axis, in
    K4 both together; an axis that stands is at 0. Angles run over the travel, or over one turn of a longer travel. Positions
    outside a travel are left out and named in `warnings`. Feed, evaluation and collisions are not considered.

    Args:
        machine: A machine with X, Y, Z and two rotary axes.
        test: "K1", "K2" or "K4", also with the letter of the layout before it: A two rotary axes in the head, B two in the
            table, C one on each side, such as "BK1".
        sphere: Place on the workpiece, (x, y, z) with all axes at 0 [mm]; None: one that the travels reach.
        tool: Vector to the nest (or to the sphere in the spindle), (x, y, z) [mm]; None: one along the spindle.
        n: Number of readings each way.
        sensor_on: Which body carries the sensor nest, "tool" or "workpiece".
        u: Standard uncertainty of one coordinate of a displacement [mm].

    Returns:
        A campaign with one `displacement` set without readings, with the direction of every axis that turns.

    Raises:
        InputError: the machine has not two rotary axes, or not the layout that the test names; no position is left.

    Reference:
        ISO 10791-6:2014, tests AK1 … CK4.

    Example:
        >>> from volid.io import read_machine
        >>> plan = iso10791_path(read_machine("models/wCAYXbZt_trunnion.toml"), "BK2", (60, 0, 40), (0, 0, -120), n=37)
        >>> len(plan.sets[0]), plan.title
        (74, 'R-test, BK2')
    """
    turning, standing = _axes_of(machine, test)
    _ask(machine, None if sphere is None else {"P1": sphere}, tool, u)
    checked_count("n", n, 2, LARGEST)
    ask_plan(test, 2 * n)
    there = {axis.letter: evenly(*one_turn(axis), n) for axis in turning}
    angles = {letter: np.concatenate([q, q[::-1]]) for letter, q in there.items()}
    positions = with_rotary(machine, **{**{axis.letter: np.zeros(2 * n) for axis in standing}, **angles})
    way = np.zeros_like(positions)
    for axis in turning:
        way[:, machine.index(axis.letter)] = np.repeat([1.0, -1.0], n)
    spheres = None if sphere is None else {"P1": sphere}
    places = spheres_and_tools(machine, positions, spheres, tool, n=1)
    return displacement_plan(machine, positions, way, test, places, sensor_on, u)


def _ask(machine: Machine, spheres: Any, tools: Any, u: float) -> None:
    """Raises `InputError` for places, tool vectors or a u that are none, or look like another unit than mm."""
    for place in (spheres or {}).values():
        ask_place(machine, "sphere", place, near=False)
    if tools is not None:
        ask_tools(machine, tools)
    ask_uncertainty("u", u)


def _axes_of(machine: Machine, test: str) -> tuple[list[Axis], list[Axis]]:
    """Rotary axes that turn in a test, and those that stand."""
    axes = list(rotary_axes(machine))
    if len(axes) != 2:
        raise InputError(f"machine '{machine.name}' has {len(axes)} rotary axes; {test} of ISO 10791-6 needs two")
    layout = "CAB"[0 if axes[0].primed != axes[1].primed else 1 + axes[0].primed]
    if test[-2:] not in TESTS or test[:-2] not in ("", layout):
        expected = ", ".join(layout + t for t in TESTS)
        raise InputError(f"test '{test}' is not for machine '{machine.name}', {machine.structure}; expected {expected}")
    chosen = {"K1": [1], "K2": [0], "K4": [0, 1]}[test[-2:]]
    return [axes[i] for i in chosen], [axes[i] for i in (0, 1) if i not in chosen]


def _count(n: int, axis: Axis) -> int:
    if n < 2:
        raise InputError(f"{n} positions of axis {axis.letter}; expected at least 2")
    return n


def _paired(places: Places) -> list[tuple[str, np.ndarray, np.ndarray]]:
    """(name, sphere, tool) of every run."""
    vectors = np.atleast_2d(np.asarray(places.tools, dtype=float))
    spheres = {name: np.asarray(place, dtype=float) for name, place in places.spheres.items()}
    runs = max(len(vectors), len(spheres))
    if not spheres or any(p.shape != (3,) for p in spheres.values()) or vectors.shape[1:] != (3,):
        raise InputError("an R-test needs spheres {name: (x, y, z)} and tool vectors (x, y, z), in mm")
    if {len(vectors), len(spheres)} - {1, runs}:
        raise InputError(f"{len(spheres)} spheres and {len(vectors)} tool vectors; expected as many, or one of either")
    names = list(spheres) if len(spheres) == runs else list(spheres) * runs
    return [(name, spheres[name], vectors[i if len(vectors) == runs else 0]) for i, name in enumerate(names)]


def displacement_plan(
    machine: Machine,
    positions: np.ndarray,
    directions: np.ndarray,
    name: str,
    places: Places,
    sensor_on: str,
    u: float,
) -> Campaign:
    """One displacement set: the rotary positions run through for every sphere and tool vector."""
    q, way, tool, label = [], [], [], []
    warnings: tuple[str, ...] = ()
    for sphere, place, vector in _paired(places):
        kept = within_travel(machine, follow(machine, positions, vector, place), f"{name}, sphere '{sphere}'")
        q.append(kept.positions)
        way.append(directions[kept.rows])
        tool.append(np.tile(vector, (len(kept.rows), 1)))
        label += [sphere] * len(kept.rows)
        warnings += kept.warnings
    unread = np.full((len(label), 3), np.nan)
    options = {
        "sensor_on": sensor_on,
        "sphere": {n: [float(c) for c in p] for n, p in places.spheres.items()},
        "range": RANGE,
    }
    planned = ObservationSet(
        name=name,
        kind="displacement",
        positions=np.concatenate(q),
        directions=np.concatenate(way),
        tool=np.concatenate(tool),
        readings=unread,
        u=np.full_like(unread, u),
        labels={"sphere": np.array(label)},
        options={**options, "nest_u": 0.0, "rotation_u": 0.0, "scale_u": 0.0, "u": u},
        source=f"{name} plan",
    )
    return Campaign(machine, (), (planned,), title=f"R-test, {name}", warnings=warnings, source=f"{name} plan")
