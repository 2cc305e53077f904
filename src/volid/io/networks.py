"""Distance networks as CSV: distances `from,to,distance,u`, coordinates `point,x,y,z,fixed`.

All lengths are in one unit of any kind. Without a column `z` the network is plane. In the coordinates, the column `fixed` is
optional (1, true or yes: the point keeps its coordinates). Points may be missing or have empty cells; their start values are then
found from the data. In the distances, the columns `relative` (1, true or yes: the distance has an unknown offset, a dead path)
and `segment` (a name) are optional: relative distances from one point share one offset in each segment.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from volid.exceptions import InputError
from volid.io.basics.csv_table import CsvTable, read_csv
from volid.multilateration import NetworkSolution, adjust_network, starting_coordinates

if TYPE_CHECKING:
    from jaxtyping import Float, Int

DISTANCES = ("from", "to", "distance", "u")
_OPTIONAL = ("relative", "segment")
_COORDINATES = ("point", "x", "y", "z", "fixed")
_YES_OR_NO = {"1": True, "true": True, "yes": True, "0": False, "false": False, "no": False, "": False}
_LARGEST = 1e15  # of distances and u: above, it is a slip whatever the unit
UNIT = "the network's unit of length"


class Group(NamedTuple):
    """What relative distances with one offset have in common: the point they are measured from, and the segment."""

    station: str
    segment: str


@dataclass(frozen=True)
class Network:
    """A distance network as read: `known` are the given coordinates, `rows` the line numbers of the observations.

    `groups`: of each observation, None for an absolute distance.
    """

    points: tuple[str, ...]
    fixed: tuple[str, ...]
    observations: tuple[tuple[str, str, float], ...]
    u: Float[np.ndarray, " m"]
    known: dict[str, Float[np.ndarray, " d"]]
    dimension: int
    rows: Int[np.ndarray, " m"]
    groups: tuple[Group | None, ...]

    def adjust(self, robust: bool = False) -> NetworkSolution:
        """Least-squares solution (`adjust_network`); coordinates not given are first found from the distances."""
        approximate, groups = self.known, self.groups if any(self.groups) else None
        missing = [name for name in self.points if name not in self.known]
        if missing:
            u = float(np.median(self.u))
            approximate = starting_coordinates(
                self.points, self.observations, u, self.known, self.dimension, either_side=True, groups=groups
            )
        return adjust_network(
            self.points,
            self.fixed,
            self.observations,
            self.u,
            approximate,
            self.dimension,
            robust=robust,
            groups=groups,
            guessed=missing if self.known else (),
        )


def network_from_csv(
    path: str | Path, approximate: str | Path | None = None, dimension: int | None = None, relative: bool = False
) -> Network:
    """Read distances, and coordinates where there are some.

    `dimension` is needed only without coordinates and is then 3 unless given. `relative`: so are the distances, where no column
    says otherwise. Raises `InputError` naming file, row and column.
    """
    table = read_csv(path)
    table.only((*DISTANCES, *_OPTIONAL))
    table.require(DISTANCES, "a distance network needs from, to, distance and u", (*DISTANCES, *_OPTIONAL))
    start, end = (table.labels(name, "expected the name of a point") for name in ("from", "to"))
    groups = _groups(table, start.tolist(), relative)
    distances = table.numbers("distance", UNIT, "every row needs one")
    _check_positive(table, "distance", distances, np.array([group is None for group in groups]))
    u = table.numbers("u", UNIT, "every row needs one")
    _check_positive(table, "u", u, np.ones(u.size, bool))
    if (same := start == end).any():
        where = table.where(int(np.argmax(same)))
        raise InputError(f"{where}: from and to are both '{start[same][0]}'; expected two points")
    known, fixed, dimension = _coordinates(approximate, dimension)
    return Network(
        points=tuple(dict.fromkeys([*known, *start.tolist(), *end.tolist()])),
        fixed=fixed,
        observations=tuple(zip(start.tolist(), end.tolist(), distances.tolist(), strict=True)),
        u=u,
        known={name: x for name, x in known.items() if np.isfinite(x).all()},
        dimension=dimension,
        rows=table.rows,
        groups=groups,
    )


def _groups(table: CsvTable, stations: Sequence[str], relative: bool) -> tuple[Group | None, ...]:
    """Station and segment of each relative distance, None for absolute ones."""
    if "relative" in table:
        marks = [_yes(table, i, "relative") for i in range(len(table))]
    else:
        marks = [relative] * len(table)
    segments = [cell.strip() for cell in table.columns["segment"]] if "segment" in table else [""] * len(table)
    if "segment" in table and not any(marks):
        raise InputError(
            f"{table.source}, header: a column segment, but no distance is relative; expected a column relative with 1 in some "
            "rows, or `relative=True`"
        )
    rows = zip(marks, stations, segments, strict=True)
    return tuple(Group(station, segment) if mark else None for mark, station, segment in rows)


def _yes(table: CsvTable, i: int, column: str) -> bool:
    """A cell that says yes or no."""
    cell = table.columns[column][i].strip()
    if cell.lower() not in _YES_OR_NO:
        raise InputError(f"{table.where(i)}: {column} is '{cell}'; expected 1 or 0 (or true, false, yes, no)")
    return _YES_OR_NO[cell.lower()]


def _check_positive(table: CsvTable, name: str, values: Float[np.ndarray, " m"], wanted: np.ndarray) -> None:
    """Raises `InputError` for a value that is not above 0 where that is wanted, or no length at all."""
    if (absurd := np.abs(values) > _LARGEST).any():
        i = int(np.argmax(absurd))
        raise InputError(f"{table.where(i)}: {name} is {values[i]:g}; expected a length in {UNIT}")
    if (wrong := wanted & (values <= 0)).any():
        i = int(np.argmax(wrong))
        hint = "; relative distances are marked by 1 in a column relative" if name == "distance" else ""
        raise InputError(f"{table.where(i)}: {name} is {values[i]:g}; expected a number above 0 in {UNIT}{hint}")


def _coordinates(path: str | Path | None, dimension: int | None):
    """Coordinates by point (NaN where empty), names of the fixed points, and the dimension."""
    if path is None:
        return {}, (), dimension or 3
    table = read_csv(path)
    table.only(_COORDINATES)
    table.require(("point", "x", "y"), "coordinates need point, x, y and, in space, z", _COORDINATES)
    axes = [axis for axis in "xyz" if axis in table]
    if dimension not in (None, len(axes)):
        raise InputError(
            f"{path}, header: coordinates {', '.join(axes)}; expected {dimension} of them (`dimension={dimension}`)"
        )
    names = table.labels("point", "expected its name").tolist()
    for i, name in enumerate(names):
        if name in names[:i]:
            raise InputError(f"{table.where(i)}: point '{name}' stands twice; expected each point once")
    x = np.column_stack([table.numbers(axis, UNIT, "leave all empty if unknown", gaps=True) for axis in axes])
    gaps = np.isnan(x)
    if (partly := gaps.any(axis=1) & ~gaps.all(axis=1)).any():
        i = int(np.argmax(partly))
        empty = axes[int(np.argmax(gaps[i]))]
        raise InputError(f"{table.where(i)}: {empty} is empty; expected all coordinates or none")
    return dict(zip(names, x, strict=True)), _fixed(table, names, x), len(axes)


def _fixed(table: CsvTable, names: Sequence[str], x: Float[np.ndarray, "p d"]) -> tuple[str, ...]:
    """Names of the points marked fixed, which need coordinates."""
    if "fixed" not in table:
        return ()
    fixed = []
    for i, name in enumerate(names):
        if _yes(table, i, "fixed"):
            if np.isnan(x[i]).any():
                raise InputError(f"{table.where(i)}: fixed point '{name}' has no coordinates")
            fixed.append(name)
    return tuple(fixed)
