"""What a control holds already: its tables in both directions, and sections of its grids. Values in µm or µrad, error sense."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from pathlib import PurePosixPath
from typing import TYPE_CHECKING, Any

import numpy as np

from volid.compensation.grids.grid import AnyGrid
from volid.controllers.existing.looks import Look, looks
from volid.controllers.existing.reading import RECOGNISED, ExistingCompensation
from volid.exceptions import cut
from volid.model.machine import Machine
from volid.report.language import ENGLISH, Texts
from volid.report.plot.palette import BLACK, BLUE, FAINT, NEUTRAL, ORANGE, SIGNED
from volid.report.plot.panels import (
    figure_in_language,
    figure_with_panels,
    heading,
    level_lines,
    note_below,
    signs,
)
from volid.report.text.basics import scale_of, unit_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLUMNS = 3
PANEL, HEAD = (3.6, 2.4), 1.3  # inches of a panel, and of title, legend and notes together
MARKED = 60  # positions of a table up to which each has a mark
DASHES = (0, (4, 1.5))


def existing_figure(found: ExistingCompensation, *, texts: Texts = ENGLISH) -> Figure:
    """Tables and grids that a control holds, as errors (actual - nominal), one panel each.

    Tables have a line for each direction, and marks at their positions; all of one unit have the same scale. Of a grid the three
    translations are shown, on planes through the middle of its other axes, with one scale.

    Args:
        found: What the control holds, as `volid.load_compensation` reads it.
        texts: The language.

    Raises:
        KeyError: `texts` lacks a text.

    >>> import volid
    >>> path = getfixture("tmp_path") / "x.comp"
    >>> _ = path.write_text("0 0.000 0.002\\n500 500.010 500.013\\n1000 999.996 999.999\\n")
    >>> figure = volid.plot.existing_figure(volid.load_compensation([path], "linuxcnc"))
    >>> [panel.get_title(loc="left") for panel in figure.axes]
    ['X over X (x.comp)']
    """
    tables = looks(found)
    pieces = [(g, k, plane) for g in found.compensation.grids for k in range(3) for plane in _planes(g)]
    count = len(tables) + len(pieces)
    columns = min(COLUMNS, count)
    rows = -(-count // columns)
    size = (max(PANEL[0] * columns + 0.3, 5.6), PANEL[1] * rows + HEAD)
    figure, panels = figure_with_panels(rows, columns, figsize=size, squeeze=False)
    flat = panels.ravel()
    ends = {u: 1.08 * max((scale_of(t.unit) * t.largest for t in tables if t.unit == u), default=0.0) for u in _UNITS}
    for panel, look in zip(flat, tables, strict=False):
        _draw_table(panel, look, ends[look.unit] or 1.0, texts)
    for panel, (grid, k, plane) in zip(flat[len(tables) :], pieces, strict=False):
        _draw_piece(figure, panel, grid, k, plane, texts)
    for panel in flat[count:]:
        panel.set_axis_off()
    handles = {label: h for p in flat for h, label in zip(*p.get_legend_handles_labels(), strict=True)}
    heading(figure, _title(found, texts), list(handles.values()), list(handles))
    note_below(figure, [texts("existing.corrects"), *(_assumed(t, found.machine, texts) for t in found.assumed)])
    figure_in_language(figure, texts)
    return figure


def _assumed(text: str, machine: Machine, texts: Texts) -> str:
    """What was taken for granted, in the language of the figure."""
    if text.startswith(RECOGNISED):
        return texts("existing.recognised", control=text.removeprefix(RECOGNISED).strip())
    if text.startswith("no machine given"):
        return texts("existing.plain", axes=", ".join(machine.letters), structure=machine.structure)
    return texts("existing.assumed", text=text)


_UNITS = ("mm", "rad")


def _title(found: ExistingCompensation, texts: Texts) -> str:
    names = [PurePosixPath(name).name for name in found.files]
    shown = ", ".join(names[:4]) + (f", … ({len(names)})" if len(names) > 4 else "")
    declared = found.declaration
    return texts(
        "existing.title", name=cut(shown), control=texts("existing.own") if declared is None else declared.name
    )


def _draw_table(panel: Any, look: Look, end: float, texts: Texts) -> None:
    """One table: a line for each direction, or one line where they are the same."""
    panel.axhline(0.0, color=FAINT, lw=0.8, zorder=0)
    mark, scale = "." if len(look.positions) <= MARKED else "", scale_of(look.unit)
    ways = [(look.forward, "up", BLUE, "-"), (look.reverse, "down", ORANGE, DASHES)]
    if np.array_equal(look.forward, look.reverse):
        ways = [(look.forward, "both", BLACK, "-")]
    for values, key, colour, style in ways:
        label = texts(f"existing.{key}")
        panel.plot(look.positions, scale * values, color=colour, ls=style, marker=mark, ms=4, lw=1.3, label=label)
    output = look.name.split(" over ")
    words = {"output": output[0], "argument": look.argument, "factor": look.factor}
    title = texts("existing.times" if look.factor else "existing.table", **words) if len(output) > 1 else look.name
    panel.set_title(title + (f" ({look.source})" if look.source not in ("", look.name) else ""), **_TITLE)
    panel.set_ylim(-end, end)
    _axes_named(panel, look.argument, unit_of(look.unit))


_TITLE = {"fontsize": 8, "loc": "left", "color": NEUTRAL}


def _axes_named(panel: Any, letter: str, unit: str) -> None:
    panel.set_xlabel(f"{letter} / {_unit(letter)}", fontsize=8)
    panel.set_ylabel(unit, fontsize=8)
    panel.tick_params(labelsize=8)


def _unit(letter: str) -> str:
    return "°" if letter in "ABC" else "mm"


def _planes(grid: AnyGrid) -> list[tuple[int, ...]]:
    """Pairs of axes with several nodes each, as numbers; the one axis where there is one."""
    long = [i for i, nodes in enumerate(grid.nodes) if len(nodes) > 1]
    return list(combinations(long, 2)) if len(long) > 1 else [tuple(long) or (0,)]


def _draw_piece(figure: Figure, panel: Any, grid: AnyGrid, k: int, plane: Sequence[int], texts: Texts) -> None:
    """One translation of a grid on a plane through the middle of the others, or along its one axis."""
    axes = [grid.nodes[i] for i in plane]
    values = 1e3 * _values(grid, plane)[..., k]
    words = {"kind": grid.type, "direction": "XYZ"[k]}
    letters = [grid.axes[i] for i in plane]
    if len(plane) == 1:
        panel.axhline(0.0, color=FAINT, lw=0.8, zorder=0)
        panel.plot(axes[0], values, color=BLACK, marker=".", lw=1.3)
        panel.set_title(texts("existing.line", **words), **_TITLE)
        _axes_named(panel, letters[0], "µm")
        return
    largest = 1e3 * float(np.nanmax(np.abs(grid.values[:, :3]), initial=0.0)) or 1.0
    areas = level_lines(panel, axes[0], axes[1], values.T, largest, SIGNED)
    figure.colorbar(areas, ax=panel).set_label("µm", fontsize=8)
    others = [f"{grid.axes[i]} = {signs(f'{m:g}', texts)}" for i, m in _middle(grid).items() if i not in plane]
    title = texts("existing.grid", **words, plane="".join(letters), at=", ".join(others))
    panel.set_title(title.rstrip(", "), **_TITLE)
    _axes_named(panel, letters[0], f"{letters[1]} / {_unit(letters[1])}")


def _middle(grid: AnyGrid) -> dict[int, float]:
    """The middle of every axis, by its number [mm or °]."""
    return {i: float(0.5 * (nodes[0] + nodes[-1])) for i, nodes in enumerate(grid.nodes)}


def _values(grid: AnyGrid, plane: Sequence[int]) -> np.ndarray:
    """Values at the nodes of a plane, the others in the middle, shape (n, 6) or (n, m, 6) [mm, rad]."""
    mesh = np.meshgrid(*(grid.nodes[i] for i in plane), indexing="ij")
    q = np.tile(list(_middle(grid).values()), (*mesh[0].shape, 1))
    for i, values in zip(plane, mesh, strict=True):
        q[..., i] = values
    return grid.interpolate(q.reshape(-1, len(grid.axes))).reshape(*mesh[0].shape, 6)
