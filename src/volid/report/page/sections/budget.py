"""Section "budget" of the page: what every source contributes to U, absolutely, and what is told apart badly."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from markupsafe import Markup

from volid.exceptions import InputError
from volid.report.contents.contents import Contents
from volid.report.contents.contributions import Contributions, headline_contributions
from volid.report.contents.correlations import LISTED, STRONG, correlations_of
from volid.report.language import Texts
from volid.report.page.numbers import Numbers, places_of
from volid.report.page.section import Section, svg
from volid.report.page.templates import english, render
from volid.report.plot.asked import NothingToDrawError
from volid.report.plot.budget import ROW, budget_panel, output_words, parts_of
from volid.report.plot.dots import all_as_written
from volid.report.plot.panels import figure_in_language, figure_with_panels
from volid.report.plot.uncertainty_map import largest_of, said_cut, section_panel, sections_of
from volid.uncertainty.lack_of_fit import lack_of_fit

WIDTH, LEFT = 3.9, 1.1  # inch, of a panel, and of the names beside it


def build(contents: Contents, texts: Texts) -> Section | None:
    """Figures of the contributions, a table of them, and strong correlations; nothing where no number is worth looking at."""
    if contents.summary["barrier"]:
        return None
    try:
        found = headline_contributions(contents.solution, contents.tool, texts)
    except InputError as reason:
        body = Markup("<p>{} {}</p>").format(texts("budget.refused"), english(reason))
        return Section("budget", texts("page.section_budget"), body)
    known = [output for part in parts_of(found) for output in part]
    pairs = correlations_of(contents.solution).strong()
    body = render(
        "budget.html",
        texts,
        contents=contents,
        panels=list(panels_of(found, texts)),
        maps=list(maps_of(contents, texts)),
        outputs=[(o, output_words(o.output, texts), places_of(o.expanded, o.unit)) for o in known],
        sources=list(known[0].parts) if known else [],
        lack=str(lack_of_fit(contents.solution)),
        pairs=pairs,
        listed=LISTED,
        strong=Numbers(texts).digits(STRONG, 2),
    )
    return Section("budget", texts("page.section_budget"), body)


def maps_of(contents: Contents, texts: Texts) -> Iterator[Markup]:
    """U of the deviation field on sections of the volume, all in one scale; nothing where it is not determined."""
    try:
        sections = sections_of(contents.solution, contents.tool)
    except NothingToDrawError:
        return
    machine, largest = contents.solution.campaign.machine, largest_of(sections)
    for section in (s for s in sections if s.has_area):
        figure, panel = figure_with_panels(figsize=(WIDTH, 3.0))
        image = section_panel(panel, section, largest, machine)
        bar = figure.colorbar(image, ax=panel, shrink=0.9)
        bar.set_label("U (k = 2) / µm", fontsize=8)
        bar.ax.tick_params(labelsize=7)
        figure_in_language(figure, texts)
        yield svg(figure, f"U, {said_cut(section, machine)}")


def panels_of(found: Sequence[Contributions], texts: Texts) -> Iterator[Markup]:
    """One panel for the volume, one for lengths, one for rotations; the first one has the legend of all."""
    for number, part in enumerate(parts_of(found)):
        legend = 0.0 if number else 0.16 * (len(part[0].parts) + 1) + 0.1
        height = ROW * len(part) + 0.8 + legend
        figure, panel = figure_with_panels(figsize=(WIDTH, height))
        figure.set_layout_engine(None)
        figure.subplots_adjust(LEFT / WIDTH, 0.45 / height, 0.97, 1.0 - (0.35 + legend) / height)
        budget_panel(panel, part, texts)
        if legend:
            handles, labels = panel.get_legend_handles_labels()
            figure.legend(handles, labels, fontsize=7, frameon=False, loc="upper left")
        all_as_written(figure)
        yield svg(figure, panel.get_title(loc="left"))
