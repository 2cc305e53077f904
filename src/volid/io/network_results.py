"""Results of distance networks as CSV: coordinates, distances with how they check each other, error ellipsoids, offsets."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, TextIO

import numpy as np

from volid.io.basics.atomic import atomic_output
from volid.io.basics.cells import CellWriter
from volid.io.networks import DISTANCES, UNIT
from volid.multilateration import NetworkSolution

if TYPE_CHECKING:
    from jaxtyping import Float

_ROUNDING = 1e-14  # of the largest coordinate: below, a coordinate is 0


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
    stream.write(
        f"# adjusted coordinates and their standard uncertainty from the stated u ({UNIT}); blank: not determined\n"
    )
    datum = " (inner constraints)" if solution.defect else ""
    stream.write(f"# rank {solution.rank}, defect {solution.defect}{datum}, ")
    stream.write(f"{solution.degrees_of_freedom} degrees of freedom, unit weight {solution.unit_weight:.4g}\n")
    header = ["point", *axes, *(f"u_{axis}" for axis in axes), "fixed"]
    if spread is not None:
        stream.write("# u_mc_, low_, high_: standard deviation and symmetric 95 % interval by Monte Carlo\n")
        header += [f"{what}_{axis}" for axis in axes for what in ("u_mc", "low", "high")]
    u, coordinates = solution.standard_uncertainty, _rounded(solution.coordinates)
    rows = (
        [name, *_numbers(coordinates[i], 13), *_numbers(u[i], 6), int(name not in solution.unknown)]
        + (_spread_cells(spread, i) if spread is not None else [])
        for i, name in enumerate(solution.points)
    )
    _write(stream, header, rows)


def _rounded(coordinates: Float[np.ndarray, "p d"]) -> Float[np.ndarray, "p d"]:
    """Coordinates with what is only rounding set to 0."""
    return np.where(np.abs(coordinates) < _ROUNDING * np.abs(coordinates).max(), 0.0, coordinates)


def _spread_cells(spread: Spread, i: int) -> list[str]:
    cells = []
    for u, low, high in zip(spread.u[i], spread.low[i], spread.high[i], strict=True):
        cells += [*_numbers([u], 6), *_numbers([low, high], 13)]
    return cells


def write_residuals(path: str | Path, solution: NetworkSolution, overwrite: bool = False) -> None:
    """Write one row per observation in the order read, completely or not at all.

    Columns: `from,to,distance,u,residual,normalised_residual,redundancy,detectable_error,influence,influenced_point,blunder`.
    """
    check = solution.reliability
    header = [
        *DISTANCES,
        "residual",
        "normalised_residual",
        "redundancy",
        "detectable_error",
        "influence",
        "influenced_point",
    ]
    rows = []
    for i, (start, end, distance) in enumerate(solution.observations):
        numbers = (solution.u, solution.residuals, solution.normalised_residuals, check.redundancy, check.detectable)
        moved = check.influenced[i]
        cells = _numbers([*(column[i] for column in numbers), check.influence[i]], 6)
        point = solution.points[moved] if moved >= 0 else ""
        rows.append([start, end, *_numbers([distance], 13), *cells, point, int(i in solution.blunders)])
    _write_file(path, [*header, "blunder"], rows, overwrite)


def write_ellipsoids(path: str | Path, solution: NetworkSolution, overwrite: bool = False) -> None:
    """Write the standard error ellipsoid (ellipse) of each unknown point, completely or not at all.

    Columns: `point,a,b,c,scale_95,a_x,a_y,a_z,b_x,…`: semi-axes from the stated u, largest first, blank along directions that
    are not determined; the factor to the 95 % ellipsoid; the unit vector of each semi-axis.
    """
    found, d = solution.ellipsoids, solution.coordinates.shape[1]
    names, axes = "abc"[:d], "xyz"[:d]
    header = ["point", *names, "scale_95", *(f"{name}_{axis}" for name in names for axis in axes)]
    rows = [
        [
            point,
            *_numbers(found.axes[i], 6),
            *_numbers([found.scale], 6),
            *_numbers(found.directions[i].ravel() + 0.0, 9),
        ]
        for i, point in enumerate(solution.points)
        if point in solution.unknown
    ]
    _write_file(path, header, rows, overwrite)


def write_offsets(path: str | Path, solution: NetworkSolution, overwrite: bool = False) -> None:
    """Write the offsets of relative distances as `station,segment,offset,u,readings`, completely or not at all."""
    rows = [
        [station, segment, *_numbers([offset.value], 13), *_numbers([offset.u], 6), offset.readings]
        for (station, segment), offset in solution.offsets.items()
    ]
    _write_file(path, ["station", "segment", "offset", "u", "readings"], rows, overwrite)


def _numbers(values: Iterable[float], digits: int) -> list[str]:
    """Numbers as text with so many significant digits, empty for NaN."""
    return ["" if np.isnan(value) else f"{value:.{digits}g}" for value in values]


def _write_file(path: str | Path, header: list[str], rows: Sequence[list], overwrite: bool) -> None:
    with atomic_output(path, overwrite) as temporary, temporary.open("w", newline="", encoding="utf-8") as stream:
        _write(stream, header, rows)


def _write(stream: TextIO, header: list[str], rows: Iterable[list]) -> None:
    writer = CellWriter(stream)
    writer.writerow(header)
    writer.writerows(rows)
