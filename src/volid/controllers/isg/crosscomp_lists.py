"""Lines kw.crosscomp and kw.crosscomp2 of the ISG kernel: what each axis needs, written, and read as tables of axes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from volid.compensation.grids.interpolation import interpolate
from volid.compensation.tables.axis_table import AxisTable, Factor
from volid.controllers.base import Job
from volid.controllers.isg.kernel_lists import STEPS, Entry, axis_of, needed, number_of, refuse_increments, unit_of
from volid.controllers.tables.equal_steps import lattice_of
from volid.exceptions import InputError
from volid.model.machine import Axis, Machine

MOST_OF_PLANE = 101
FINEST = 8  # parts of the shortest step that are tried for common equal steps

# ------------------------------------------------------------------------------------------------ writing


@dataclass(frozen=True)
class Parts:
    """What one slave needs: tables over one master, and tables and products over a pair of masters."""

    cross: tuple[AxisTable, ...]
    plane: tuple[AxisTable, ...]
    masters: tuple[str, str]


@dataclass(frozen=True)
class Rows:
    """Lines of one kind of compensation, and what belongs to them."""

    rows: list[tuple[str, object]]
    switch: str
    parameter: str
    words: str
    rounding: float
    notes: tuple[str, ...] = ()


def parts_of(tables: Sequence[AxisTable], slave: str) -> Parts:
    """Tables of a slave, each in the table of the control that can hold it. Raises `InputError` where there are too few."""
    pairs = list(dict.fromkeys(_pair(t.argument, t.factor.axis) for t in tables if t.factor is not None))
    singles = list(dict.fromkeys(t.argument for t in tables if t.factor is None))
    pair = pairs[0] if pairs else None
    outside = sorted((a for a in singles if pair is None or a not in pair), key=lambda a: a == slave)
    if pair is None and len(outside) == 2:  # the second one as a plane that is level along the first
        pair, outside = (outside[1], outside[0]), outside[:1]
    if len(pairs) > 1 or len(outside) > 1:
        masters = [" and ".join(p) for p in pairs] + outside
        raise InputError(
            f"isg-crosscomp: {slave} would move by {', by '.join(masters)}; the control has one table over one "
            "axis and one over two for each axis. isg-volcomp carries this"
        )
    if outside == [slave]:
        raise InputError(f"isg-crosscomp: {slave} corrects itself by its own position; isg-ssfk carries that")
    within = tuple(t for t in tables if t.factor is not None or t.argument not in outside)
    return Parts(tuple(t for t in tables if t not in within), within, pair or ("", ""))


def _pair(one: str, other: str) -> tuple[str, str]:
    return (one, other) if one < other else (other, one)


def cross(job: Job, axis: Axis, tables: Sequence[AxisTable]) -> Rows:
    (table,) = tables  # of one argument, without factors, summed
    at = np.unique(np.rint(table.positions * STEPS).astype(int))
    exact = job.factor * table.of_argument(at / STEPS, np.zeros(len(at))) / unit_of(axis)
    values = np.rint(exact).astype(int)
    rows: list[tuple[str, object]] = [
        ("kw.crosscomp.unit", 1),
        ("kw.crosscomp.master_ax_nr", number_of(table.argument, job.options["axes"])),
        ("kw.crosscomp.last_index", len(at) - 1),
    ]
    for i, (x, v) in enumerate(zip(at, values, strict=True)):
        rows += [(f"kw.crosscomp.table[{i}].setpoint", x), (f"kw.crosscomp.table[{i}].correction", v)]
    lost = float(np.abs(values - exact).max()) * unit_of(axis)
    return Rows(rows, "lr_param.crosscomp", "P-AXIS-00047", "cross compensation", lost)


def plane(job: Job, axis: Axis, parts: Parts) -> Rows:
    nodes = [_positions(parts.plane, m) for m in parts.masters]
    step, counts = _common_steps(nodes)
    starts = [round(float(n[0]) * STEPS) if len(n) else 0 for n in nodes]
    at = [(s + step * np.arange(c)) / STEPS for s, c in zip(starts, counts, strict=True)]
    first, second = np.meshgrid(*at)  # [j, i]: j along master 2
    exact = job.factor * _sum(parts, first, second) / unit_of(axis)
    values = np.rint(exact).astype(int)
    numbers = [number_of(m, job.options["axes"]) for m in parts.masters]
    rows: list[tuple[str, object]] = [("kw.crosscomp2.unit", 1), ("kw.crosscomp2.interval", step)]
    for k in (1, 2):
        rows += [
            (f"kw.crosscomp2.master{k}_ax_nr", numbers[k - 1]),
            (f"kw.crosscomp2.last_index_master{k}", counts[k - 1] - 1),
            (f"kw.crosscomp2.start_position_master{k}", starts[k - 1]),
        ]
    rows += [(f"kw.crosscomp2.table[{j}][{i}].correction", v) for (j, i), v in np.ndenumerate(values)]
    missed = _missed(parts, at)
    notes = (
        (f"{axis.letter}: equal steps of {step / STEPS:g} mm miss at most {1e3 * missed:.2g} µm of the tables.",)
        if missed > 1e-6
        else ()
    )
    lost = float(np.abs(values - exact).max()) * unit_of(axis)
    return Rows(rows, "lr_param.crosscomp2", "P-AXIS-00174", "plane compensation", lost, notes)


def _positions(tables: Sequence[AxisTable], master: str) -> np.ndarray:
    """All positions at which tables over a master have their points, or its factors; none where the plane is level along it."""
    own = [t.positions for t in tables if t.argument == master]
    own += [t.factor.positions for t in tables if t.factor is not None and t.factor.axis == master]
    return np.unique(np.concatenate(own)) if own else np.zeros(0)


def _common_steps(nodes: Sequence[np.ndarray]) -> tuple[int, list[int]]:
    """One step [0.1 µm] for both masters, and how many positions each has: two where the plane is level."""
    steep = [n for n in nodes if len(n)]
    spans = [float(n[-1] - n[0]) * STEPS for n in steep]
    steps = [round(lattice_of(n, MOST_OF_PLANE).step * STEPS) for n in steep]
    for part in range(1, FINEST + 1):
        step = max(1, min(steps) // part)
        if all(s % step == 0 and span / step <= MOST_OF_PLANE - 1 for s, span in zip(steps, spans, strict=True)):
            break
    else:
        step = int(np.ceil(max(spans) / (MOST_OF_PLANE - 1)))
    return step, [int(np.ceil((n[-1] - n[0]) * STEPS / step - 1e-6)) + 1 if len(n) else 2 for n in nodes]


def _sum(parts: Parts, first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """The sum of tables and products at positions of both masters, same shape."""
    at = {m: v.ravel() for m, v in zip(parts.masters, (first, second), strict=True)}
    still = {m: np.zeros(first.size) for m in parts.masters}
    return np.asarray(sum(t.at(at, still) for t in parts.plane)).reshape(first.shape)


def _missed(parts: Parts, at: Sequence[np.ndarray]) -> float:
    """Largest difference from the tables at all their own positions, by linear interpolation between the nodes [mm]."""
    nodes = _sum(parts, *np.meshgrid(*at))
    found = [(_positions(parts.plane, m), x) for m, x in zip(parts.masters, at, strict=True)]
    own = [np.clip(p, x[0], x[-1]) if len(p) else x for p, x in found]
    first, second = np.meshgrid(*own)
    places = np.column_stack([second.ravel(), first.ravel()])
    between = interpolate((at[1], at[0]), nodes[:, :, None], places)[:, 0]
    return float(np.abs(between - _sum(parts, first, second).ravel()).max())


# ------------------------------------------------------------------------------------------------ reading


def read_cross(
    name: str, stated: dict[str, Entry], machine: Machine, numbers: Mapping[str, int], owner: Axis
) -> Iterator[AxisTable]:
    """The table over one master, if the list has one. An old list stands with the master and names the slave."""
    if not any(k.startswith("kw.crosscomp.") for k in stated):
        return
    refuse_increments(name, stated, "kw.crosscomp.unit")
    slave, master = owner, owner
    if "kw.crosscomp.slave_ax_nr" in stated:
        slave = axis_of(stated["kw.crosscomp.slave_ax_nr"], machine, numbers)
    else:
        master = axis_of(needed(name, stated, "kw.crosscomp.master_ax_nr"), machine, numbers)
    count = needed(name, stated, "kw.crosscomp.last_index").whole(0, 100_000) + 1
    at, values = (
        np.array([needed(name, stated, f"kw.crosscomp.table[{i}].{c}").number for i in range(count)])
        for c in ("setpoint", "correction")
    )
    if np.any(np.diff(at) <= 0):
        i = int(np.argmax(np.diff(at) <= 0)) + 1
        raise InputError(f"{name}: kw.crosscomp.table[{i}].setpoint does not rise; expected rising positions")
    values = values * unit_of(slave)
    yield AxisTable(slave.letter, master.letter, at / STEPS, values, values.copy())


def read_plane(
    name: str, stated: dict[str, Entry], machine: Machine, numbers: Mapping[str, int], slave: Axis
) -> Iterator[AxisTable]:
    """The table over two masters as a sum of products, if the list has one."""
    if not any(k.startswith("kw.crosscomp2.") for k in stated):
        return
    refuse_increments(name, stated, "kw.crosscomp2.unit")
    step = needed(name, stated, "kw.crosscomp2.interval").whole(1)
    letters, at = [], []
    for k in (1, 2):
        letters.append(axis_of(needed(name, stated, f"kw.crosscomp2.master{k}_ax_nr"), machine, numbers).letter)
        count = needed(name, stated, f"kw.crosscomp2.last_index_master{k}").whole(0, 10_000) + 1
        start = needed(name, stated, f"kw.crosscomp2.start_position_master{k}").number
        at.append((start + step * np.arange(count)) / STEPS)
    if letters[0] == letters[1]:
        raise InputError(f"{name}: both masters of kw.crosscomp2 are {letters[0]}; expected two axes")
    table = np.empty((len(at[1]), len(at[0])))
    for j, i in np.ndindex(table.shape):
        table[j, i] = needed(name, stated, f"kw.crosscomp2.table[{j}][{i}].correction").number
    table *= unit_of(slave)
    yield from _of_plane(slave, letters, at, table)


def _of_plane(slave: Axis, masters: Sequence[str], at: Sequence[np.ndarray], table: np.ndarray) -> Iterator[AxisTable]:
    """A surface [j, i] as a table over one master where it is level along the other, else as a sum of products."""
    for k, rows in enumerate((table, table.T)):
        if (rows == rows[0]).all():
            yield AxisTable(slave.letter, masters[k], at[k], rows[0].copy(), rows[0].copy())
            return
    for j, row in enumerate(table):
        if row.any():
            factor = Factor(masters[1], at[1], np.eye(len(at[1]))[j])
            yield AxisTable(slave.letter, masters[0], at[0], row, row.copy(), factor)
