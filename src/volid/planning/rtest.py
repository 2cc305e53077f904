"""R-test plans: static indexing grids over both rotary axes, and the paths of ISO 10791-6 with linear axes following.

Which axes move in which test of ISO 10791-6:2014 follows the literature on R-tests, not the clauses of the standard; feed and
evaluation are not part of a plan. Weikert, R-test, CIRP Annals 53 (2004) 429; Bringmann, Knapp, CIRP Annals 55 (2006) 531.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from volid.campaign import Campaign, ObservationSet
from volid.exceptions import InputError
from volid.model.machine import Axis, Machine
from volid.observations.displacement import RANGE
from volid.planning.following import follow, one_turn, rotary_axes, with_rotary, within_travel
from volid.planning.places import spheres_and_tools

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
    """Plan of an R-test at all pairs of `n1` positions of the first rotary axis (workpiece to tool) and `n2` of the second.

    Evenly over the travel, over one turn of a longer one, ends included; every other line backwards. `spheres`: places on
    the workpiece by name, (x, y, z) [mm] with all axes at 0. `tools`: vectors to the nest (or to the sphere in the spindle)
    [mm], one for all spheres, one per sphere, or several for a single sphere. What is None is chosen (`spheres_and_tools`).
    The linear axes follow: without errors every displacement is 0. Positions outside a travel are left out and named in
    `warnings`. Raises `InputError` when nothing is left, or the machine has not one or two rotary axes. Not considered:
    collisions.

    >>> from volid.io import read_machine
    >>> plan = rtest_static_grid(read_machine("models/wCAYXbZt_trunnion.toml"), {"P1": (60, 0, 40)}, (0, 0, -120), 13, 7)
    >>> len(plan.sets[0]), plan.warnings
    (91, ())
    """
    axes = rotary_axes(machine)
    if len(axes) > 2:
        raise InputError(f"machine '{machine.name}' has {len(axes)} rotary axes; expected one or two for a grid")
    lines = [np.linspace(*one_turn(axis), _count(n, axis)) for axis, n in zip(axes, (n1, n2), strict=False)]
    pairs = [
        (a, b) for i, a in enumerate(lines[0]) for b in (lines[1][:: 1 - 2 * (i % 2)] if len(lines) > 1 else [0.0])
    ]
    grid = np.array(pairs)[:, : len(axes)].T
    positions = with_rotary(machine, **{axis.letter: q for axis, q in zip(axes, grid, strict=True)})
    return _plan(machine, positions, np.zeros_like(positions), "static grid", spheres, tools, sensor_on, u)


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
    """Plan of a kinematic test of ISO 10791-6, there and back, `n` readings each way; the sphere stays in the nest.

    `test`: K1, the tilting or swivelling axis turns (the second one, workpiece to tool) and the linear axes follow; K2, the
    other rotary axis turns; K4, both turn together. Before it stands the letter of the layout, A two rotary axes in the head, B
    two in the table, C one on each side: "BK1"; a letter that is not the machine's is an `InputError`. Angles run over the
    travel, over one turn of a longer one; the standing axis is at 0. Positions outside a travel are left out and named.
    A sphere or tool that is None is chosen (`spheres_and_tools`).
    """
    turning, standing = _axes_of(machine, test)
    there = {axis.letter: np.linspace(*one_turn(axis), n) for axis in turning}
    angles = {letter: np.concatenate([q, q[::-1]]) for letter, q in there.items()}
    positions = with_rotary(machine, **{**{axis.letter: np.zeros(2 * n) for axis in standing}, **angles})
    way = np.zeros_like(positions)
    for axis in turning:
        way[:, machine.index(axis.letter)] = np.repeat([1.0, -1.0], n)
    spheres = None if sphere is None else {"P1": sphere}
    return _plan(machine, positions, way, test, spheres, tool, sensor_on, u, runs=1)


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


def _paired(
    spheres: Mapping[str, Vector], tools: Vector | Sequence[Vector]
) -> list[tuple[str, np.ndarray, np.ndarray]]:
    """(name, sphere, tool) of every run."""
    vectors = np.atleast_2d(np.asarray(tools, dtype=float))
    places = {name: np.asarray(place, dtype=float) for name, place in spheres.items()}
    runs = max(len(vectors), len(places))
    if not places or any(p.shape != (3,) for p in places.values()) or vectors.shape[1:] != (3,):
        raise InputError("an R-test needs spheres {name: (x, y, z)} and tool vectors (x, y, z), in mm")
    if {len(vectors), len(places)} - {1, runs}:
        raise InputError(f"{len(places)} spheres and {len(vectors)} tool vectors; expected as many, or one of either")
    names = list(places) if len(places) == runs else list(places) * runs
    return [(name, places[name], vectors[i if len(vectors) == runs else 0]) for i, name in enumerate(names)]


def _plan(
    machine: Machine,
    positions: np.ndarray,
    directions: np.ndarray,
    name: str,
    spheres: Mapping[str, Vector] | None,
    tools: Vector | Sequence[Vector] | None,
    sensor_on: str,
    u: float,
    runs: int = 3,
) -> Campaign:
    """One displacement set: the rotary positions run through for every sphere and tool vector, `runs` when none is given."""
    if spheres is None or tools is None:
        spheres, tools = spheres_and_tools(machine, positions, spheres, tools, runs)
    q, way, tool, label = [], [], [], []
    warnings: tuple[str, ...] = ()
    for sphere, place, vector in _paired(spheres, tools):
        kept = within_travel(machine, follow(machine, positions, vector, place), f"{name}, sphere '{sphere}'")
        q.append(kept.positions)
        way.append(directions[kept.rows])
        tool.append(np.tile(vector, (len(kept.rows), 1)))
        label += [sphere] * len(kept.rows)
        warnings += kept.warnings
    unread = np.full((len(label), 3), np.nan)
    options = {"sensor_on": sensor_on, "sphere": {n: [float(c) for c in p] for n, p in spheres.items()}, "range": RANGE}
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
