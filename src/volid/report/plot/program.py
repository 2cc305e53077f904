"""The path of a program of G-code, and the corrections along it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from volid.controllers.programs.program import CorrectedProgram
from volid.exceptions import InputError, cut
from volid.report.language import ENGLISH, Texts
from volid.report.plot.isometric import draw_box, prepare, projected
from volid.report.plot.palette import BLUE, FAINT, NEUTRAL, SERIES, STYLES
from volid.report.plot.panels import figure_in_language, figure_with_panels, heading, note_below, signs
from volid.report.plot.sections import grouped, round_down

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SHARE = 0.08  # of the path's size: the largest correction as it is drawn
NEAR = 1e-6  # mm: ends of lines that meet
MOST = 20_000  # lines in a drawing


def program_figure(made: CorrectedProgram, name: str, *, texts: Texts = ENGLISH) -> Figure:
    """The programmed path in feed with the corrected one, corrections enlarged, and the corrections of X, Y, Z along it.

    Args:
        made: As `volid.apply_to_program` gives it.
        name: Of the program, for the title.
        texts: The language.

    Raises:
        InputError: the program has no motion in feed.

    >>> import numpy as np
    >>> import volid
    >>> x, values = np.array([0.0, 1000.0]), np.array([[0.0] * 6, [0.010] + [0.0] * 5])
    >>> grid = volid.Grid("L-POS", ("X",), (x,), x[:, None], values, values, x > 1e4, (0.0, 0.0, 0.0), "machine", "")
    >>> setting = volid.ProgramSetting(offsets={"G54": (100.0, 0.0, 0.0)}, tool=(0.0, 0.0, 0.0))
    >>> made = volid.apply_to_program(grid, "G21 G90 G0 X0 Y0 Z5" + chr(10) + "G1 X400 Y50 F500", setting)
    >>> len(volid.plot.program_figure(made, "part.nc").axes)
    2
    """
    if not len(made.nominal):
        raise InputError(f"{name}: has no motion in feed, so there is nothing to draw")
    step = -(-len(made.nominal) // MOST)
    figure, (left, right) = figure_with_panels(1, 2, figsize=(10.5, 4.6), width_ratios=(1, 1))
    gap = _gaps(made.nominal, step)
    _draw_path(left, (made.nominal[::step], made.corrected[::step]), gap, texts)
    _draw_corrections(right, made, gap, texts)
    heading(figure, texts("program.title", name=cut(Path(name).name, 60)))
    before, after = made.counted.blocks
    chord = signs(f"{1e3 * made.counted.chord:.2f}", texts)
    note_below(figure, [texts("program.note", before=before, after=after, chord=chord)])
    figure_in_language(figure, texts)
    return figure


def _draw_path(panel: Any, paths: tuple[np.ndarray, np.ndarray], gap: np.ndarray, texts: Texts) -> None:
    """Both paths in parallel projection, within the box about the programmed one."""
    nominal, corrected = paths
    places = nominal.reshape(-1, 3)
    low, high = places.min(axis=0), places.max(axis=0)
    size, largest = float(np.linalg.norm(high - low)), float(np.abs(corrected - nominal).max())
    factor = round_down(SHARE * size / largest) if largest > 0.0 and size > 0.0 else 1.0
    enlarged = nominal + factor * (corrected - nominal)
    prepare(panel, np.concatenate([places, enlarged.reshape(-1, 3)]))
    draw_box(panel, low, high, texts)
    panel.plot(
        *projected(_joined(nominal, gap)).T, color=NEUTRAL, lw=0.9, ls="--", label=texts("program.programmed"), zorder=2
    )
    label = texts("program.corrected", factor=grouped(factor))
    panel.plot(*projected(_joined(enlarged, gap)).T, color=BLUE, lw=1.2, label=label, zorder=3)
    panel.legend(fontsize=8, frameon=False, loc="upper center", bbox_to_anchor=(0.5, 0.0), ncols=2)


def _draw_corrections(panel: Any, made: CorrectedProgram, gap: np.ndarray, texts: Texts) -> None:
    """Corrections of the axes over the length of the path."""
    length = np.linalg.norm(made.nominal[:, 1] - made.nominal[:, 0], axis=1)
    end = np.cumsum(length)
    step = -(-len(length) // len(gap))
    way = _joined(np.stack([end - length, end], axis=1)[::step, :, None], gap)[:, 0]
    shift = _joined(1e3 * (made.corrected - made.nominal)[::step], gap)
    for k, letter in enumerate("XYZ"):
        label = texts("program.axis", letter=letter)
        panel.plot(way, shift[:, k], color=SERIES[k], ls=STYLES[k], lw=1.2, label=label)
    panel.axhline(0.0, color=FAINT, lw=0.8, zorder=0)
    panel.set_xlabel(texts("program.way"), fontsize=9)
    panel.set_ylabel(texts("program.correction"), fontsize=9)
    panel.tick_params(labelsize=8)
    panel.legend(fontsize=8, frameon=False, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3)


def _joined(lines: np.ndarray, gap: np.ndarray) -> np.ndarray:
    """Values (k) at the ends of lines, (m, 2, k), as one polyline (3 m, k), with a gap where `gap` (m,) says."""
    breaks = np.where(gap[:, None, None], np.nan, lines[:, :1])
    return np.concatenate([breaks, lines], axis=1).reshape(-1, lines.shape[2])


def _gaps(nominal: np.ndarray, step: int) -> np.ndarray:
    """Whether, of lines (m, 2, 3), one of every `step` does not begin where the last one ended."""
    each = np.r_[False, np.abs(nominal[1:, 0] - nominal[:-1, 1]).max(axis=1) > NEAR]
    return np.asarray(np.logical_or.reduceat(each, np.arange(0, len(each), step)))
