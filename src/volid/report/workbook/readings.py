"""The sheet of residuals: every reading with its place, its u, and what the model leaves of it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from volid.campaign import ObservationSet
from volid.fitting.solution import Solution
from volid.observations import KINDS
from volid.observations.base import DEGREES
from volid.report.contents.names import label_words, reading_name
from volid.report.language import Texts
from volid.report.workbook.table import Column, Table


def readings_sheet(solution: Solution, texts: Texts) -> Table:
    """Readings in the unit of their kind; their u and residuals in µm or µrad; residual / (u sqrt(1 - h)) has none."""
    machine = solution.machine
    columns = [
        Column(texts("workbook.set"), width=20),
        Column(texts("workbook.where"), width=24),
        Column(texts("workbook.label"), width=28),
        Column(texts("workbook.component")),
        *(Column(axis.letter, axis.unit) for axis in machine.axes),
        *(Column(f"{texts('workbook.tool_vector')} {c}", "mm") for c in "xyz"),
        Column(texts("workbook.time"), "s"),
        Column(texts("workbook.reading"), "mm, rad, °", 16),
        Column(texts("workbook.reading_unit")),
        Column(texts("workbook.residual"), "µm, µrad", spread=1),
        Column("u (k = 1)", "µm, µrad", spread=0),
        Column(texts("workbook.unit")),
        Column(texts("workbook.normalised")),
        Column(texts("workbook.outlier")),
    ]
    return Table(texts("workbook.sheet_residuals"), columns, _rows(solution, texts))


def _rows(solution: Solution, texts: Texts) -> Iterator[list[Any]]:
    found = solution.readings
    for number, observations in enumerate(solution.campaign.sets):
        parts = (found.residuals[number], found.normalised[number], found.outliers[number])
        for i in range(len(observations)):
            words, place = _words(observations, i, texts), _place(observations, i)
            for k in range(observations.readings.shape[1]):
                name = reading_name(KINDS[observations.kind].readings[k], texts)
                yield [observations.name, *words, name, *place, *_numbers(observations, i, k, parts)]


def _words(observations: ObservationSet, i: int, texts: Texts) -> list[str]:
    """File and row, and what the row belongs to, such as its station."""
    return [
        observations.where(i),
        ", ".join(label_words(key, values[i], texts) for key, values in observations.labels.items()),
    ]


def _place(observations: ObservationSet, i: int) -> list[Any]:
    """Positions, tool vector and time of a row."""
    time = None if observations.time is None else float(observations.time[i])
    return [*observations.positions[i].tolist(), *observations.tool[i].tolist(), time]


def _numbers(observations: ObservationSet, i: int, k: int, parts: tuple[np.ndarray, ...]) -> list[Any]:
    """Reading, its unit, residual, u, their unit, normalised residual, and whether it was set aside."""
    unit = KINDS[observations.kind].unit_at(observations, i, k)
    scale, small = (1e3, "µm") if unit == "mm" else (1e6 * (np.pi / 180.0 if unit == DEGREES else 1.0), "µrad")
    residual, normalised, outlier = (part[i, k] for part in parts)
    read, u = float(observations.readings[i, k]), float(observations.u[i, k])
    return [read, unit, scale * float(residual), scale * u, small, float(normalised), bool(outlier)]
