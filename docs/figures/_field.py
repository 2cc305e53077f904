"""The deviation of a working volume as a deformed lattice, before compensation and after types of it, at one scale."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

import volid
from volid.report.plot.palette import NEUTRAL, SIZES

TOOL = (0.0, 0.0, -150.0)
NODES = 7  # along each edge of the lattice


def lattice(machine: volid.Machine) -> np.ndarray:
    """Positions over the travels, shape (n, n, n, 3), X, Y, Z [mm]."""
    edges = [np.linspace(*machine.axis(a).travel, NODES) for a in "XYZ"]
    return np.stack(np.meshgrid(*edges, indexing="ij"), axis=-1)


def remaining(solution: volid.Solution, places: np.ndarray, types: Sequence[str]) -> np.ndarray:
    """Deviation of the functional point with these types in the control, best rigid motion taken out, shape as `places` [mm]."""
    machine, flat = solution.campaign.machine, places.reshape(-1, 3)
    order = ["XYZ".index(a) for a in machine.letters]
    q = flat[:, order]
    moved = q
    if types:
        made = volid.compensate(solution, types, volid.compensation_base(solution, TOOL), points=21)
        moved = volid.Control(machine, tables=made.tables, grids=made.grids).command(q, np.array(TOOL))
    step = (moved - q)[:, np.argsort(order)]
    return without_rigid(flat, step + np.asarray(solution.deviation(moved, TOOL))[:, :3]).reshape(places.shape)


def without_rigid(places: np.ndarray, e: np.ndarray) -> np.ndarray:
    """e without the small rotation and translation that take up most of it, by least squares."""
    middle = places - places.mean(axis=0)
    turned = [np.cross(unit, middle) for unit in np.eye(3)]
    shifted = [np.broadcast_to(unit, places.shape) for unit in np.eye(3)]
    design = np.stack([*turned, *shifted], axis=-1).reshape(-1, 6)
    return e - (design @ np.linalg.lstsq(design, e.ravel(), rcond=None)[0]).reshape(e.shape)


def faces(nodes: np.ndarray) -> list[np.ndarray]:
    """The three sides of a lattice that are seen: front, right, top; shape (n, n, k) each."""
    return [nodes[:, 0], nodes[-1], nodes[:, :, -1]]


def quads(nodes: np.ndarray) -> np.ndarray:
    """Meshes of the sides that are seen, shape (m, 4, k)."""
    found = [np.stack([f[:-1, :-1], f[1:, :-1], f[1:, 1:], f[:-1, 1:]], axis=2) for f in faces(nodes)]
    return np.concatenate([f.reshape(-1, 4, nodes.shape[-1]) for f in found])


def field_figure(solution: volid.Solution, lists: Sequence[Sequence[str]]) -> Figure:
    """One lattice for each list of types, all at one magnification and one colour scale."""
    places = lattice(solution.campaign.machine)
    fields = [remaining(solution, places, types) for types in lists]
    sizes = [1e3 * np.linalg.norm(e, axis=-1) for e in fields]
    largest = max(float(s.max()) for s in sizes)
    factor = magnification(places, largest)
    figure = Figure(figsize=(11.0, 3.7))
    titles = named(solution, lists)
    for k, (e, size) in enumerate(zip(fields, sizes, strict=True)):
        axes = figure.add_axes((-0.012 + 0.305 * k, -0.03, 0.34, 1.0), projection="3d")
        drawn = draw_sides(axes, places, places + factor * e, size, largest)
        figure.text(0.158 + 0.305 * k, 0.86, titles[k], ha="center", fontsize=11.5, linespacing=1.4)
    bar = figure.colorbar(drawn, cax=figure.add_axes((0.935, 0.24, 0.013, 0.52)))
    bar.set_label("deviation / µm", fontsize=10)
    tool = ", ".join(f"{v:g}" for v in TOOL)
    figure.text(0.46, 0.02, f"tool vector ({tool}) mm, deviations drawn {factor:.0f} times", ha="center", color=NEUTRAL)
    return figure


def named(solution: volid.Solution, lists: Sequence[Sequence[str]]) -> list[str]:
    """Types, and the largest deviation of the whole volume that `volid residual` expects with them."""
    base = volid.compensation_base(solution, TOOL)
    columns = volid.forecast(solution, [t for t in lists if t], base, grids=None, points=21).columns
    found = {c.name: c.predictions[0] for c in columns}
    texts = []
    for types in lists:
        p = found[" + ".join(types) if types else "none"]
        title = f"with {' + '.join(types)}" if types else "not compensated"
        texts.append(f"{title}\nup to {1e3 * p.value[0]:.1f} µm (95 %: {1e3 * p.low[0]:.1f} … {1e3 * p.high[0]:.1f})")
    return texts


def magnification(places: np.ndarray, largest: float) -> float:
    """A round factor that makes the largest deviation [µm] at most as long as a mesh of the lattice [mm]."""
    mesh = float(np.ptp(places.reshape(-1, 3), axis=0).mean()) / (NODES - 1)
    exact = 1.1 * mesh / (1e-3 * largest)
    unit = 10.0 ** np.floor(np.log10(exact))
    return float(unit * max(f for f in (1, 2, 5) if f * unit <= exact))


def draw_sides(axes: Any, places: np.ndarray, moved: np.ndarray, size: np.ndarray, largest: float) -> Poly3DCollection:
    """The sides of the deformed lattice that are seen, coloured by the length of the deviation, in the nominal box."""
    low, high = places.reshape(-1, 3).min(axis=0), places.reshape(-1, 3).max(axis=0)
    sides = Poly3DCollection(quads(moved), cmap=SIZES, edgecolors="white", linewidths=0.7)
    sides.set_array(quads(size[..., None]).mean(axis=(1, 2)))
    sides.set_clim(0.0, largest)
    axes.add_collection3d(sides)
    for edge in box(low, high):
        axes.plot(*edge.T, color=NEUTRAL, lw=1.0, ls=(0, (4, 3)), zorder=10)
    axes.set_box_aspect(high - low, zoom=0.84)
    axes.patch.set_visible(False)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.set_axis_off()
    axes.view_init(elev=24, azim=-58)
    name_edges(axes, low, high)
    return sides


def name_edges(axes: Any, low: np.ndarray, high: np.ndarray) -> None:
    """Letter and travel of each axis beside an edge of the box."""
    places = {"X": (0.45, -0.25, -0.18), "Y": (1.08, 0.5, -0.16), "Z": (-0.05, -0.08, 0.5)}
    for k, (name, share) in enumerate(places.items()):
        at = low + np.array(share) * (high - low)
        axes.text(*at, f"{name} {low[k]:g} … {high[k]:g} mm", name.lower(), ha="center", va="center", fontsize=8.5)


def box(low: np.ndarray, high: np.ndarray) -> list[np.ndarray]:
    """The nine edges of the nominal volume that border a side that is seen."""
    corners = [np.array([(low, high)[i][0], (low, high)[j][1], (low, high)[k][2]]) for i, j, k in np.ndindex(2, 2, 2)]
    hidden = corners[0b010]  # low X, high Y, low Z: behind
    pairs = [(a, b) for n, a in enumerate(corners) for b in corners[n + 1 :] if np.sum(a != b) == 1]
    return [np.stack(p) for p in pairs if not any(np.array_equal(end, hidden) for end in p)]
