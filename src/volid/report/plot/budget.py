"""The uncertainty budget as bars."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from volid.report.plot.palette import SERIES
from volid.report.plot.panels import figure_with_panels
from volid.uncertainty.budget import Line

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def budget_bars(lines: Iterable[Line]) -> Figure:
    """Share of every source in u² of every output, functions as RMS over the travel; u beside each bar."""
    outputs: dict[str, dict[str, float]] = {}
    places: dict[str, set[float]] = {}
    units: dict[str, str] = {}
    for line in lines:
        by_source = outputs.setdefault(line.output, {})
        by_source[line.source] = by_source.get(line.source, 0.0) + line.contribution**2
        places.setdefault(line.output, set()).add(line.position if np.isfinite(line.position) else 0.0)
        units[line.output] = line.unit
    sources = list(dict.fromkeys(s for by_source in outputs.values() for s in by_source))
    figure, panel = figure_with_panels(figsize=(9, 0.26 * len(outputs) + 1.2))
    y = np.arange(len(outputs))
    ends = np.zeros(len(outputs))
    for i, source in enumerate(sources):
        share = np.array(
            [by_source.get(source, 0.0) / max(sum(by_source.values()), 1e-300) for by_source in outputs.values()]
        )
        panel.barh(y, 100.0 * share, left=ends, color=SERIES[i % len(SERIES)], label=source, height=0.8)
        ends += 100.0 * share
    for k, (name, by_source) in enumerate(outputs.items()):
        u = np.sqrt(sum(by_source.values()) / len(places[name]))
        panel.text(101.0, k, _said(float(u), units[name]), va="center", fontsize=8)
    panel.set_yticks(y, list(outputs), fontsize=8)
    panel.set_ylim(len(outputs) - 0.5, -0.5)
    panel.set_xlim(0.0, 100.0)
    panel.set_xlabel("share of u² / %; at the right the standard uncertainty u")
    panel.legend(fontsize=8, frameon=False, loc="lower center", bbox_to_anchor=(0.45, 1.0), ncols=2)
    for side in ("top", "right"):
        panel.spines[side].set_visible(False)
    return figure


def _said(u: float, unit: str) -> str:
    return f"{1e6 * u:.2f} µrad" if unit == "rad" else f"{1e3 * u:.2f} µm"
