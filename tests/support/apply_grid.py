"""What a control does with an L-VOL grid, without volid: python apply_grid.py GRID.csv POINTS.csv OUT.csv

POINTS.csv: columns X, Y, Z, commanded positions [mm]. OUT.csv: the positions that a control drives to instead, command plus
compensation value, interpolated trilinearly between the eight nodes around (ISO/TR 16907 7.5). NumPy and the standard library
only, so that what the file says is all it can know. Ends with an error when the values are not compensation values.
"""

import csv
import sys

import numpy as np

AXES, VALUES = ("X", "Y", "Z"), ("dX", "dY", "dZ")


def read(path):
    """Header lines "# key: value" as a dictionary, and the columns as arrays."""
    with open(path, encoding="utf-8", newline="") as stream:
        lines = stream.read().splitlines()
    header = dict(line[2:].split(": ", 1) for line in lines if line.startswith("# ") and ": " in line)
    rows = list(csv.DictReader(line for line in lines if not line.startswith("#")))
    return header, {name: np.array([float(row[name]) for row in rows]) for name in rows[0] if rows[0][name] != ""}


def table(columns):
    """Nodes per axis, and the values on them, (n_X, n_Y, n_Z, 3) [mm]."""
    nodes = [np.unique(columns[axis]) for axis in AXES]
    values = np.full([*map(len, nodes), 3], np.nan)
    index = tuple(np.searchsorted(n, columns[axis]) for n, axis in zip(nodes, AXES, strict=True))
    values[index] = np.stack([columns[name] for name in VALUES], axis=1)
    return nodes, values


def interpolate(nodes, values, points):
    """Trilinear interpolation at points (m, 3): the eight nodes around, weighted by the opposite volumes."""
    below, share = [], []
    for n, q in zip(nodes, points.T, strict=True):
        i = np.clip(np.searchsorted(n, q, side="right") - 1, 0, len(n) - 2)
        below.append(i)
        share.append((q - n[i]) / (n[i + 1] - n[i]))
    total = np.zeros_like(points)
    for corner in np.ndindex(2, 2, 2):
        weight = np.prod([s if c else 1.0 - s for c, s in zip(corner, share, strict=True)], axis=0)
        i, j, k = (b + c for b, c in zip(below, corner, strict=True))
        total += weight[:, None] * values[i, j, k]
    return total


def main(grid, points, out):
    header, columns = read(grid)
    if header["type"] != "L-VOL" or header["values"] != "compensation" or "mm" not in header["units"]:
        sys.exit(
            f"{grid}: type {header['type']}, values {header['values']}; expected compensation values of L-VOL in mm"
        )
    q = np.stack([read(points)[1][axis] for axis in AXES], axis=1)
    target = q + interpolate(*table(columns), q)
    if not np.isfinite(target).all():
        sys.exit(f"{grid}: nodes are missing")
    np.savetxt(out, target, delimiter=",", header="X,Y,Z", comments="", fmt="%.9f")


if __name__ == "__main__":
    main(*sys.argv[1:])
