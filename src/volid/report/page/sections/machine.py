"""Section "machine" of the page: the machine drawn, its chain, its axes with travels and measured ranges, and the datum."""

from __future__ import annotations

from typing import Any

from markupsafe import Markup

from volid.fitting.solution import Solution
from volid.model.machine import Machine
from volid.report.contents.contents import Contents
from volid.report.language import Texts
from volid.report.page.section import Section, svg
from volid.report.page.templates import render
from volid.report.plot.machine.drawing import machine_panel, of_solution, scheme_of
from volid.report.plot.machine.layout import PRIME, has_own_direction, tokens_of
from volid.report.plot.machine.row import SIDE, chain_panel
from volid.report.plot.panels import figure_with_places


def build(contents: Contents, texts: Texts) -> Section | None:
    """Drawing, chain, axes and datum."""
    machine = of_solution(contents.solution)
    body = render(
        "machine.html",
        texts,
        machine=machine,
        structure=machine.structure.strip().strip("[]"),
        drawing=_drawing(machine, contents.tool, texts),
        chain=_chain(machine, texts),
        axes=_axes(machine, contents.solution),
        datum=contents.solution.datum,
    )
    return Section("machine", texts("page.section_machine"), body)


def _drawing(machine: Machine, tool: tuple[float, float, float], texts: Texts) -> Markup:
    scheme = scheme_of(machine, tool, texts)
    figure, (panel,) = figure_with_places(scheme.size, [(0.0, 0.0, *scheme.size)])
    machine_panel(panel, scheme)
    return svg(figure, texts("machine.drawn", structure=machine.structure))


def _chain(machine: Machine, texts: Texts) -> Markup:
    size = (SIDE * len(tokens_of(machine)), SIDE)
    figure, (panel,) = figure_with_places(size, [(0.0, 0.0, *size)])
    chain_panel(panel, machine)
    return svg(figure, texts("machine.chain", structure=machine.structure))


def _axes(machine: Machine, solution: Solution) -> list[dict[str, Any]]:
    """One row for each axis, from workpiece to tool."""
    return [
        {
            "letter": axis.letter,
            "label": axis.letter + (PRIME if axis.primed else ""),
            "unit": axis.unit,
            "carries": "workpiece" if axis.primed else "tool",
            "travel": axis.travel,
            "measured": tuple(measured),
            "reference": axis.reference,
            "point": None if axis.is_linear else axis.point,
            "direction": axis.unit_vector if has_own_direction(axis) else None,
            "own_frame": axis.axis_frame,
        }
        for axis, measured in zip(machine.axes, solution.measured_range(), strict=True)
    ]
