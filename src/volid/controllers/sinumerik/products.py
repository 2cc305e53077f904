"""Tables of axes as numbered tables of a SINUMERIK that can multiply one by another, and back.

The control adds the values of all tables of an output axis, and for a table k with MULT_BY_TABLE = n the product of its own value
with that of the table number n (index n - 1):

    correction = sum over tables of value_t(x_t)  +  sum over products of value_k(x_k) · value_(n-1)(x_(n-1)).

The product comes *in addition*: the two tables of a product act by themselves too. What they would add is taken out again in the
plain table of the same pair of axes, so that the product alone remains. A lever arm becomes a ramp, in units of UNIT, which all
products with this lever arm share; the angle is multiplied by UNIT, so that values of both stay below a few tenths of a
millimetre.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from volid.compensation.on_top import summed
from volid.compensation.tables.axis_table import AxisTable, Factor
from volid.controllers.tables.equal_steps import DIGITS, Lattice, lattice_of, on, widened
from volid.model.machine import Axis, Machine

UNIT = 10_000.0  # mm of lever arm that a ramp value of 1 stands for
STRAIGHT = 1e-6  # share of the largest value by which a ramp may be bent
NOTHING = 2e-9  # mm or °: two roundings of a file
ADDED = (
    "plain tables and tables of products were combined as the control adds them, with lever arms in mm, so that tables and "
    "values differ from the list in the file"
)
ALONE = (
    "the two tables of each product were read as one, with its lever arm in mm, so that tables and values differ from the "
    "list in the file"
)


@dataclass(frozen=True, eq=False)
class Entry:
    """One numbered table: `values` as in the file [mm or °], `direction` 0, 1 or -1, `times`: index of its factor's table."""

    index: int
    output: str
    argument: str
    direction: int
    lattice: Lattice
    values: np.ndarray
    times: int | None = None
    modulo: bool = False
    source: str = ""


@dataclass(frozen=True)
class Meaning:
    """What an entry does: `sense` of the values, +1 error; `added`: whether the tables of a product act by themselves too;
    `shared`: one ramp for all output axes; `mean`: no direction; `most`: points of a table."""

    sense: float = 1.0
    added: bool = True
    shared: bool = True
    mean: bool = False
    most: int | None = None
    first: int = 0


def in_degrees(axis: Axis) -> float:
    """What a value in mm or rad is multiplied by for the file."""
    return 1.0 if axis.is_linear else 180.0 / np.pi


@dataclass
class _Plan:
    """Tables on the way to entries: values (2, n) of both directions by output and argument; products; ramps by their factor."""

    machine: Machine
    meaning: Meaning
    lattices: dict[str, Lattice] = field(default_factory=dict)
    plain: dict[tuple[str, str], np.ndarray] = field(default_factory=dict)
    sources: dict[tuple[str, str], list[str]] = field(default_factory=dict)
    products: list[tuple[AxisTable, np.ndarray, tuple[object, ...]]] = field(default_factory=list)
    ramps: dict[tuple[object, ...], tuple[str, str, np.ndarray]] = field(default_factory=dict)
    turning: set[str] = field(default_factory=set)

    def add(self, output: str, argument: str, values: np.ndarray, source: str = "") -> None:
        """Adds values of both directions to the plain table of a pair of axes."""
        found = self.plain.setdefault((output, argument), np.zeros((2, self.lattices[argument].count)))
        found += values
        if source:
            self.sources.setdefault((output, argument), []).append(source)

    def both(self, table: AxisTable) -> np.ndarray:
        """Values of both directions on the lattice of the argument, as in the file, (2, n)."""
        there = on(table, self.lattices[table.argument])
        values = np.stack([there.mean, there.mean] if self.meaning.mean else [there.forward, there.reverse])
        return np.asarray(self.meaning.sense * in_degrees(self.machine.axis(table.output)) * values)


def entries_of(tables: Sequence[AxisTable], machine: Machine, meaning: Meaning) -> list[Entry]:
    """Numbered tables that together do what the tables of axes do: plain ones, ramps, products."""
    plan = _Plan(machine, meaning)
    each = summed(tables, say=False)
    _lattices(plan, each)
    plan.turning = {t.argument for t in each if t.period}
    for t in each:
        if t.factor is None:
            plan.add(t.output, t.argument, plan.both(t), t.source)
        else:
            _product(plan, t, t.factor)
    return _numbered(plan)


def _lattices(plan: _Plan, tables: Sequence[AxisTable]) -> None:
    """Equal steps of every argument: of all its tables together, over the whole travel where it is a lever arm."""
    factors = [t.factor for t in tables if t.factor is not None]
    for a in plan.machine.axes:
        places = [t.positions for t in tables if t.argument == a.letter]
        levers = [f for f in factors if f.axis == a.letter]
        places += [f.positions for f in levers if not (places and is_straight(f))]
        if places:
            found = lattice_of(np.unique(np.round(np.concatenate(places), DIGITS)), plan.meaning.most)
            plan.lattices[a.letter] = widened(found, a.travel) if levers else found


def _product(plan: _Plan, table: AxisTable, factor: Factor) -> None:
    """A product of an angle with a lever arm, and what its two tables would add by themselves taken out."""
    values = UNIT * plan.both(table)
    key = (factor.axis, factor.positions.tobytes(), factor.values.tobytes(), plan.meaning.shared or table.output)
    if key not in plan.ramps:
        ramp = along(factor, plan.lattices[factor.axis].positions) / UNIT
        plan.ramps[key] = (table.output, factor.axis, np.round(ramp, DIGITS))
        if plan.meaning.added:
            plan.add(table.output, factor.axis, -np.stack([ramp, ramp]))
    plan.products.append((table, np.round(values, DIGITS), key))
    if plan.meaning.added:
        plan.add(table.output, table.argument, -values)


def _numbered(plan: _Plan) -> list[Entry]:
    found: list[Entry] = []

    def put(output: str, argument: str, both: np.ndarray, times: int | None = None, source: str = "") -> int:
        way_by_way = np.abs(both[0] - both[1]).max() > NOTHING
        for way, values in ((1, both[0]), (-1, both[1])) if way_by_way else ((0, both[0]),):
            index = plan.meaning.first + len(found)
            lattice, modulo = plan.lattices[argument], argument in plan.turning
            found.append(Entry(index, output, argument, way, lattice, values, times, modulo, source))
        return found[-1].index

    for (output, argument), both in plan.plain.items():
        if np.abs(both).max() > NOTHING:
            put(output, argument, both, source=" + ".join(plan.sources.get((output, argument), ["takes out"])))
    ramps = {
        key: put(output, axis, np.stack([v, v]), source=f"lever arm {axis}")
        for key, (output, axis, v) in plan.ramps.items()
    }
    for table, both, key in plan.products:
        put(table.output, table.argument, both, ramps[key], f"({table.source}) times lever arm {key[0]}")
    return found


def tables_of(entries: Mapping[int, Entry], machine: Machine, meaning: Meaning) -> tuple[AxisTable, ...]:
    """Tables of axes, error values, that do what numbered tables do. `times` of an entry names another one of them."""
    factors = {e.times for e in entries.values() if e.times is not None}
    own, products = [], []
    for e in entries.values():
        acts = meaning.added or (e.times is None and e.index not in factors)
        if acts:
            own.append(_table(e, machine, meaning))
        if e.times is not None:
            products.append(_multiplied(_table(e, machine, meaning), entries[e.times]))
    plain = [
        t
        for t in summed(own, say=False)
        if in_degrees(machine.axis(t.output)) * max(np.abs(t.forward).max(), np.abs(t.reverse).max()) > NOTHING
    ]
    said = (ADDED if meaning.added else ALONE,)
    return (*plain, *(replace(t, notes=said) for t in summed(products, say=False)))


def _table(e: Entry, machine: Machine, meaning: Meaning) -> AxisTable:
    values = meaning.sense * e.values / in_degrees(machine.axis(e.output))
    none = np.zeros_like(values)
    up, down = (none if e.direction == -way else values for way in (1, -1))
    period = 360.0 if e.modulo else 0.0
    return AxisTable(e.output, e.argument, e.lattice.positions, up, down, period=period, source=e.source)


def _multiplied(table: AxisTable, by: Entry) -> AxisTable:
    """The product; a straight factor becomes a lever arm in mm, and the table an angle in rad."""
    factor = Factor(by.argument, by.lattice.positions, by.values)
    x, v = factor.positions, factor.values
    if is_straight(factor) and v[0] != v[-1]:
        slope = (v[-1] - v[0]) / (x[-1] - x[0])
        factor = Factor(by.argument, x[[0, -1]], v[[0, -1]] / slope)
        table = replace(table, forward=table.forward * slope, reverse=table.reverse * slope)
    return replace(table, factor=factor)


def is_straight(factor: Factor) -> bool:
    """Whether the factor is one straight line over its positions."""
    x, v = factor.positions, factor.values
    line = np.interp(x, x[[0, -1]], v[[0, -1]])
    return bool(np.abs(v - line).max() <= STRAIGHT * np.abs(v).max())


def along(factor: Factor, positions: np.ndarray) -> np.ndarray:
    """The factor at positions; a straight one goes on beyond its ends, so that the last step of a table keeps its slope."""
    x, v = factor.positions, factor.values
    if is_straight(factor) and len(x) > 1:
        return np.asarray(v[0] + (v[-1] - v[0]) / (x[-1] - x[0]) * (positions - x[0]))
    return factor.at(positions)
