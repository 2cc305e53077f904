"""The forecast of compensation types as text, as plain data, as a table for files, and as a figure.

The text and the figure have lengths in µm and rotations in µrad.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from volid.compensation.motion import asked_speed
from volid.compensation.orientation import poles
from volid.compensation.residual.fields import ANGLES, QUANTITIES
from volid.compensation.residual.forecast import Column, Forecast
from volid.compensation.residual.prediction import Prediction
from volid.model.machine import Machine
from volid.report.text.basics import paragraph, table, vector
from volid.report.text.repeats import repeats_data, repeats_lines

if TYPE_CHECKING:
    pass

COLUMNS = ("type", "tool_x", "tool_y", "tool_z", "quantity", "unit", "value", "low", "high", "exact")
MOST_DRAWN = 3  # tool vectors in a figure


def _scale(k: int) -> float:
    return 1e6 if QUANTITIES[k] in ANGLES else 1e3


def _number(value: float, scale: float) -> str:
    return "n.d." if np.isnan(value) else f"{scale * value:.2f}"


def forecast_text(found: Forecast, machine: Machine, feeds: np.ndarray, shown: int = 1) -> list[str]:
    """The lists of types side by side in one table per tool vector, "none" first, for the first `shown` tool vectors; the largest
    of all tool vectors; then what is asked of the axes."""
    lines = []
    for i, tool in enumerate(found.tools[:shown]):
        lines += [f"remaining deviation over the working volume, tool {vector(tool.tolist())} mm"]
        lines += [*_side_by_side(found.columns, i), *_bridge(found, i), ""]
    if len(found.tools) > 1:
        lines += [*_over_tools(found), ""]
    lines += paragraph(
        f"95 % coverage intervals [ ] from {found.draws} draws of {found.source}; X … C: largest of each component. "
        "Largest values are those of the whole volume, corners, edges and both approach directions included; RMS and 95 % are "
        "over its inside. A rigid motion of the workpiece frame is taken out."
    )
    lines += repeats_lines(found.repeats, machine, None if found.repeats_rms is None else float(found.repeats_rms[0]))
    lines += found.notes
    return [*lines, "", *_motion(found.columns, machine, feeds), *_pole_lines(found, machine)]


def _bridge(found: Forecast, i: int) -> list[str]:
    """Why the row "none" is not the largest deviation of the summary."""
    if np.isnan(found.in_datum[i]):
        return []
    free = found.columns[0].predictions[i].value[0]
    return paragraph(
        f"In the stated datum the largest deviation is {1e3 * found.in_datum[i]:.2f} µm, as volid summary has it: mean of both "
        "approach directions, and with the rigid motion of the workpiece that its set-up takes away; the "
        f"{1e3 * free:.2f} µm of the row none are without that motion."
    )


def largest_over_tools(found: Forecast) -> list[tuple[str, int, Prediction]]:
    """For each list of types: its name, the number of the tool vector with which most remains, and what remains with it."""
    worst = [int(np.argmax([p.value[0] for p in c.predictions])) for c in found.columns]
    return [(c.name, i, c.predictions[i]) for c, i in zip(found.columns, worst, strict=True)]


def _over_tools(found: Forecast) -> list[str]:
    rows = []
    for name, i, p in largest_over_tools(found):
        low, high = (_number(v[0], _scale(0)) for v in (p.low, p.high))
        rows.append([name, _number(p.value[0], _scale(0)), f"{low} … {high}", vector(found.tools[i].tolist())])
    return table([f"largest of {len(found.tools)} tool vectors", "µm", "[95 %]", "tool  mm"], rows)


def _side_by_side(columns: Sequence[Column], i: int) -> list[str]:
    header = ["type", "largest", "[95 %]", "95 %", "RMS", "[95 %]", "X", "Y", "Z  µm", "A", "B", "C", "tool axis  µrad"]
    rows = []
    for column in columns:
        p = column.predictions[i]
        text = [_number(v, _scale(k)) for k, v in enumerate(p.value)]
        spans = [f"{_number(p.low[k], _scale(k))} … {_number(p.high[k], _scale(k))}" for k in (0, 2)]
        rows.append([column.name, text[0], spans[0], text[1], text[2], spans[1], *text[3:]])
    return table(header, rows)


def _motion(columns: Sequence[Column], machine: Machine, feeds: np.ndarray) -> list[str]:
    moving = ", ".join(f"{a.letter} {f:g} {a.unit}/min" for a, f in zip(machine.axes, feeds, strict=True))
    header = ["largest correction", *(f"{a.letter} {a.unit}" for a in machine.axes)]
    header += [f"{a.letter} {a.unit}/min" for a in machine.axes]
    rows = []
    for column in columns[1:]:
        speed = asked_speed(column.motion, feeds)
        rows.append([column.name, *(f"{v:.4f}" for v in column.motion.largest), *(f"{v:.3f}" for v in speed)])
    lines = [*table(header, rows), f"speeds for one axis moving at a time: {moving}"] if rows else []
    for column in columns:
        if column.unintended > 0:
            done = "not corrected" if column.name == "FOR" else "corrected by X, Y, Z"
            lines.append(
                f"{column.name}: turned rotary axes move the functional point by up to {1e3 * column.unintended:.2f} µm, {done}"
            )
    return lines


def _pole_lines(found: Forecast, machine: Machine) -> list[str]:
    if not any(c.unintended > 0 for c in found.columns):
        return []
    named = poles(machine)
    return [f"kinematic pole at {p}" for p in named] or ["no kinematic pole within the travels"]


def forecast_data(found: Forecast, machine: Machine, feeds: np.ndarray) -> dict[str, Any]:
    """The forecast as plain data, mm and rad."""
    letters = machine.letters
    columns = []
    for c in found.columns:
        columns.append(
            {
                "type": c.name,
                "predictions": [
                    {k: dict(zip(QUANTITIES, getattr(p, k).tolist(), strict=True)) for k in p._fields}
                    for p in c.predictions
                ],
                "largest_correction": dict(zip(letters, c.motion.largest.tolist(), strict=True)),
                "speed_per_min": dict(zip(letters, asked_speed(c.motion, feeds).tolist(), strict=True)),
                "unintended_motion": c.unintended,
            }
        )
    named = [str(p) for p in poles(machine)] if len([a for a in machine.axes if not a.is_linear]) > 1 else []
    return {
        "tools": found.tools.tolist(),
        "largest_in_datum": [None if np.isnan(v) else float(v) for v in found.in_datum],
        "largest_over_tools": {
            name: {
                "tool": found.tools[i].tolist(),
                "value": float(p.value[0]),
                "low": float(p.low[0]),
                "high": float(p.high[0]),
            }
            for name, i, p in largest_over_tools(found)
        },
        "draws": found.draws,
        "source": found.source,
        "repeatability": repeats_data(found.repeats, None if found.repeats_rms is None else found.repeats_rms.tolist()),
        "columns": columns,
        "poles": named,
    }


def forecast_rows(found: Forecast) -> list[tuple[Any, ...]]:
    """Rows of the CSV file, columns `COLUMNS`; mm and rad."""
    rows: list[tuple[Any, ...]] = []
    for column in found.columns:
        for tool, p in zip(found.tools.tolist(), column.predictions, strict=True):
            for k, name in enumerate(QUANTITIES):
                numbers = (float(v[k]) for v in p)
                rows.append((column.name, *tool, name, "rad" if name in ANGLES else "mm", *numbers))
    return rows
