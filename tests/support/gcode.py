"""Programs of G-code read without volid: a plain reader of absolute and incremental lines, and LinuxCNC's interpreter."""

import os
import re
import shutil
import subprocess
from itertools import pairwise

import numpy as np
from scipy.spatial import cKDTree

RS274 = shutil.which("rs274")
_PLANES = {"XY": (0, 1, 2), "XZ": (2, 0, 1), "YZ": (1, 2, 0)}


def lines_of(text: str, offsets: dict, lengths: dict, start=(np.nan,) * 3) -> list[tuple[int, np.ndarray, np.ndarray]]:
    """Motions of a program of G0 and G1: (code, start, end) in machine coordinates [mm]; offsets, units, G90, G91, G43."""
    place, base, unit, absolute, code = np.array(start, float), np.array(offsets["G54"], float), 1.0, True, None
    length, found = 0.0, []
    for row in re.sub(r"\([^)]*\)|;.*", "", text).upper().splitlines():
        words = re.findall(r"([A-Z])\s*([-+]?[\d.]+)", row)
        numbers = {letter: float(v) for letter, v in words}
        for v in (float(v) for letter, v in words if letter == "G"):
            unit = {20: 25.4, 21: 1.0}.get(v, unit)
            absolute = {90: True, 91: False}.get(v, absolute)
            code = int(v) if v in (0, 1) else code
            assert v not in (2, 3), row
            if f"G{v:g}" in offsets:
                base = np.array(offsets[f"G{v:g}"], float)
            if v == 43:
                length = lengths[int(numbers["H"])]
        moved = place.copy()
        for k, letter in enumerate("XYZ"):
            if letter in numbers:
                zero = base[k] + (length if k == 2 else 0.0) if absolute else place[k]
                moved[k] = zero + unit * numbers[letter]
        if any(a in numbers for a in "XYZ"):
            found.append((code, place, moved))
            place = moved
    return found


def interpreted(text: str, folder, offsets: dict, lengths: dict) -> list[tuple[int, np.ndarray]]:
    """The same by LinuxCNC's interpreter: (0 or 1, dense places (m, 3) in machine coordinates [mm]) of each of its motions."""
    (folder / "tool.tbl").write_text("".join(f"T{n} P{n} Z{v / 25.4:.9f}\n" for n, v in lengths.items()))
    rows = [
        f"{5221 + 20 * (int(name[1:]) - 54) + k}\t{v[k] / 25.4:.9f}\n" for name, v in offsets.items() for k in range(3)
    ]
    (folder / "rs274.var").write_text("".join(rows))
    (folder / "program.ngc").write_text(text)
    command = [RS274, "-g", "-v", "rs274.var", "-t", "tool.tbl", "program.ngc"]
    own = {
        **os.environ,
        "HOME": str(folder),
    }  # its tools stand in ~/.tool.mmap, which several runs at a time would share
    done = subprocess.run(
        command, cwd=folder, env=own, capture_output=True, text=True, stdin=subprocess.DEVNULL, timeout=60
    )
    assert "PROGRAM_END" in done.stdout, done.stdout[-600:] + done.stderr[-600:]
    return _canonical(done.stdout)


def _canonical(text: str) -> list[tuple[int, np.ndarray]]:
    unit, base, length, plane, place, found = 1.0, np.zeros(3), np.zeros(3), "XY", np.full(3, np.nan), []
    for name, inside in re.findall(r"N\S+\s+(\w+)\((.*)\)", text):
        numbers = np.array([float(v) for v in re.findall(r"-?\d+\.?\d*", inside)])
        if name == "USE_LENGTH_UNITS":
            unit = 25.4 if "INCH" in inside else 1.0
        elif name == "SET_G5X_OFFSET":
            base = unit * numbers[1:4]
        elif name == "USE_TOOL_LENGTH_OFFSET":
            length = unit * numbers[:3]
        elif name == "SELECT_PLANE":
            plane = inside.removeprefix("CANON_PLANE_")
        elif name in ("STRAIGHT_TRAVERSE", "STRAIGHT_FEED"):
            end = unit * numbers[:3] + base + length
            found.append((int(name == "STRAIGHT_FEED"), np.stack([place, end])))
            place = end
        elif name == "ARC_FEED":
            points = _arc(numbers, _PLANES[plane], place, (base + length, unit))
            found.append((1, points))
            place = points[-1]
    return found


def _arc(numbers, axes, start, frame) -> np.ndarray:
    """Places on an ARC_FEED: end and centre in the plane, turns (positive: counter-clockwise), end along the normal."""
    base, unit = frame
    end, centre = start.copy(), np.zeros(2)
    for k, axis in enumerate(axes[:2]):
        end[axis] = unit * numbers[k] + base[axis]
        centre[k] = unit * numbers[2 + k] + base[axis]
    end[axes[2]] = unit * numbers[5] + base[axes[2]]
    a, b = axes[:2]
    begin, stop = (np.arctan2(p[b] - centre[1], p[a] - centre[0]) for p in (start, end))
    turns = int(numbers[4])
    sweep = np.mod(stop - begin, 2 * np.pi) if turns > 0 else -np.mod(begin - stop, 2 * np.pi)
    if abs(sweep) < 1e-4:
        sweep = 2 * np.pi * np.sign(turns)
    sweep += 2 * np.pi * (turns - np.sign(turns))
    share = np.linspace(0.0, 1.0, 2 + int(1000 * abs(sweep)))
    points = start + share[:, None] * (end - start)
    radius = np.hypot(start[a] - centre[0], start[b] - centre[1])
    points[:, a] = centre[0] + radius * np.cos(begin + share * sweep)
    points[:, b] = centre[1] + radius * np.sin(begin + share * sweep)
    return points


def dense(polyline: np.ndarray, step: float = 1.0) -> np.ndarray:
    """Places on a polyline (k, 3), at most `step` mm apart, its corners among them."""
    parts = [polyline[:1]]
    for a, b in pairwise(polyline):
        n = max(4, int(np.ceil(np.linalg.norm(b - a) / step)))
        parts.append(a + np.arange(1, n + 1)[:, None] / n * (b - a))
    return np.concatenate(parts)


def distances(points: np.ndarray, polyline: np.ndarray, corners: int = 3) -> np.ndarray:
    """Distance of each point (m, 3) from a fine polyline (k, 3): from the lines that meet at its nearest corners;
    more of them where other parts of it pass nearby."""
    new = np.r_[True, np.abs(np.diff(polyline, axis=0)).max(axis=1) > 0.0]
    polyline = polyline[new]
    nearest = cKDTree(polyline).query(points, k=corners)[1]
    best = np.full(len(points), np.inf)
    for corner, shift in ((c, s) for c in nearest.T for s in (-1, 0)):
        i = np.clip(corner + shift, 0, len(polyline) - 2)
        a, span = polyline[i], polyline[i + 1] - polyline[i]
        share = np.einsum("mi,mi->m", points - a, span) / np.maximum(np.einsum("mi,mi->m", span, span), 1e-300)
        foot = a + np.clip(share, 0.0, 1.0)[:, None] * span
        best = np.minimum(best, np.linalg.norm(points - foot, axis=1))
    return best
