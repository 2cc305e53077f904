"""Distance networks as CSV: distances `from,to,distance,u`, coordinates `point,x,y,z,fixed`; and their results.

All lengths are in one unit of any kind. Without a column `z` the network is plane. In the coordinates, the column `fixed` is
optional (1, true or yes: the point keeps its coordinates). Points may be missing or have empty cells; their start values are then
found from the data.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, TextIO

import numpy as np
from jaxtyping import Float, Int

from volid.exceptions import InputError
from volid.io.basics.atomic import atomic_output
from volid.io.basics.cells import CellWriter
from volid.io.basics.csv_table import CsvTable, read_csv
from volid.multilateration import NetworkSolution, adjust_network, starting_coordinates

_DISTANCES = ("from", "to", "distance", "u")
_COORDINATES = ("point", "x", "y", "z", "fixed")
_FIXED = {"1": True, "true": True, "yes": True, "0": False, "false": False, "no": False, "": False}
_UNIT = "the network's unit of length"


@dataclass(frozen=True)
class Network:
    """A distance network as read: `known` are the given coordinates, `rows` the line numbers of the observations."""

    points: tuple[str, ...]
    fixed: tuple[str, ...]
    observations: tuple[tuple[str, str, float], ...]
    u: Float[np.ndarray, " m"]
    known: dict[str, Float[np.ndarray, " d"]]
    dimension: int
    rows: Int[np.ndarray, " m"]

    def adjust(self, robust: bool = False) -> NetworkSolution:
        """Least-squares solution (`adjust_network`); coordinates not given are first found from the distances."""
        approximate = self.known
        if len(self.known) < len(self.points):
            u = float(np.median(self.u))
            approximate = starting_coordinates(self.points, self.observations, u, self.known, self.dimension)
        return adjust_network(
            self.points, self.fixed, self.observations, self.u, approximate, self.dimension, robust=robust
        )


def network_from_csv(path: str | Path, approximate: str | Path | None = None, dimension: int | None = None) -> Network:
    """Read distances, and coordinates where there are some.

    `dimension` is needed only without coordinates and is then 3 unless given. Raises `InputError` naming file, row and
    column.
    """
    table = read_csv(path)
    table.only(_DISTANCES)
    table.require(_DISTANCES, "a distance network needs from, to, distance and u", _DISTANCES)
    start, end = (table.labels(name, "expected the name of a point") for name in ("from", "to"))
    distances, u = _positive(table, "distance"), _positive(table, "u")
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
    )


def _positive(table: CsvTable, name: str) -> Float[np.ndarray, " m"]:
    """A column of numbers above 0."""
    values = table.numbers(name, _UNIT, "every row needs one")
    if (values <= 0).any():
        i = int(np.argmax(values <= 0))
        raise InputError(f"{table.where(i)}: {name} is {values[i]:g}; expected a number above 0 in {_UNIT}")
    return values


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
    x = np.column_stack([table.numbers(axis, _UNIT, "leave all empty if unknown", gaps=True) for axis in axes])
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
    for i, cell in enumerate(table.columns["fixed"]):
        if cell.strip().lower() not in _FIXED:
            raise InputError(f"{table.where(i)}: fixed is '{cell.strip()}'; expected 1 or 0 (or true, false, yes, no)")
        if _FIXED[cell.strip().lower()]:
            if np.isnan(x[i]).any():
                raise InputError(f"{table.where(i)}: fixed point '{names[i]}' has no coordinates")
            fixed.append(names[i])
    return tuple(fixed)


class Spread(NamedTuple):
    """What Monte Carlo adds to coordinates, (p, d) each: standard deviation and ends of the symmetric 95 % interval."""

    u: Float[np.ndarray, "p d"]
    low: Float[np.ndarray, "p d"]
    high: Float[np.ndarray, "p d"]


def write_coordinates(
    path: str | Path, solution: NetworkSolution, overwrite: bool = False, spread: Spread | None = None
) -> None:
    """Write `point,x,y,z,u_x,u_y,u_z,fixed`, with `spread` also `u_mc_x,low_x,high_x,…`, completely or not at all."""
    with atomic_output(path, overwrite) as temporary, temporary.open("w", newline="", encoding="utf-8") as stream:
        coordinates_csv(stream, solution, spread)


def coordinates_csv(stream: TextIO, solution: NetworkSolution, spread: Spread | None = None) -> None:
    """The same to an open text stream, with u a priori; lines that begin with # state what the numbers are based on."""
    axes = "xyz"[: solution.coordinates.shape[1]]
    stream.write(f"# adjusted coordinates and their standard uncertainty from the stated u ({_UNIT})\n")
    datum = " (inner constraints)" if solution.defect else ""
    stream.write(f"# rank {solution.rank}, defect {solution.defect}{datum}, ")
    stream.write(f"{solution.degrees_of_freedom} degrees of freedom, unit weight {solution.unit_weight:.4g}\n")
    header = ["point", *axes, *(f"u_{axis}" for axis in axes), "fixed"]
    if spread is not None:
        stream.write("# u_mc_, low_, high_: standard deviation and symmetric 95 % interval by Monte Carlo\n")
        header += [f"{what}_{axis}" for axis in axes for what in ("u_mc", "low", "high")]
    u = solution.standard_uncertainty
    rows = (
        [name, *_numbers(solution.coordinates[i], 13), *_numbers(u[i], 6), int(name not in solution.unknown)]
        + (_spread_cells(spread, i) if spread is not None else [])
        for i, name in enumerate(solution.points)
    )
    _write(stream, header, rows)


def _spread_cells(spread: Spread, i: int) -> list[str]:
    cells = []
    for u, low, high in zip(spread.u[i], spread.low[i], spread.high[i], strict=True):
        cells += [*_numbers([u], 6), *_numbers([low, high], 13)]
    return cells


def write_residuals(path: str | Path, solution: NetworkSolution, overwrite: bool = False) -> None:
    """Write `from,to,distance,u,residual,normalised_residual,blunder`, one row per observation in the order read."""
    header = [*_DISTANCES, "residual", "normalised_residual", "blunder"]
    rows = (
        [start, end, *_numbers([distance], 13), *_numbers([u, residual, z], 6), int(i in solution.blunders)]
        for i, ((start, end, distance), u, residual, z) in enumerate(
            zip(solution.observations, solution.u, solution.residuals, solution.normalised_residuals, strict=True)
        )
    )
    with atomic_output(path, overwrite) as temporary, temporary.open("w", newline="", encoding="utf-8") as stream:
        _write(stream, header, rows)


def _numbers(values: Iterable[float], digits: int) -> list[str]:
    """Numbers as text with so many significant digits, empty for NaN."""
    return ["" if np.isnan(value) else f"{value:.{digits}g}" for value in values]


def _write(stream: TextIO, header: list[str], rows: Iterable[list]) -> None:
    writer = CellWriter(stream)
    writer.writerow(header)
    writer.writerows(rows)
