"""The figure of the budget: contributions are absolute, and their root sum of squares is the U that is drawn."""

import numpy as np
import pytest
from support.figures import faults

from volid.report.contents.contributions import headline_contributions
from volid.report.language import Texts
from volid.report.plot.asked import Asked
from volid.report.plot.budget import LEAST, budget_bars, draw
from volid.uncertainty.budget import budget, budget_lines, headline_rows
from volid.uncertainty.outputs import headline_outputs

TOOL = (0.0, 0.0, -150.0)


def drawn(panel, gid):
    """Values of the marks of that name, one a row of the panel."""
    (line,) = [line for line in panel.get_lines() if line.get_gid() == gid]
    return line.get_xdata()


@pytest.fixture(scope="module")
def figure(rich_solution):
    return draw(Asked(rich_solution, TOOL))


def test_root_sum_of_squares_of_what_is_drawn_is_u(figure):
    for panel in figure.axes:
        total, sources = (
            drawn(panel, "total"),
            [g for g in (x.get_gid() for x in panel.get_lines()) if g and g != "total"],
        )
        squares = sum(np.nan_to_num(drawn(panel, gid)) ** 2 for gid in sources)
        assert np.sqrt(squares) == pytest.approx(
            total, rel=len(sources) * LEAST**2
        )  # those below 1 % of U are not drawn


def test_rows_are_the_contributions_in_micrometres_and_microradians(figure, rich_solution):
    found = {o.output: o for o in headline_contributions(rich_solution, TOOL, Texts())}
    seen = 0
    for panel in figure.axes[1:]:
        scale = 1e6 if "µrad" in panel.get_xlabel() else 1e3
        names = [t.get_text() for t in panel.get_yticklabels()]
        assert drawn(panel, "total") == pytest.approx([scale * found[n].expanded for n in names])
        for i, source in enumerate(next(iter(found.values())).parts):
            expected = np.array([scale * found[n].parts[source] for n in names])
            shown = drawn(panel, f"source {i}")
            assert shown[~np.isnan(shown)] == pytest.approx(expected[~np.isnan(shown)])
        seen += len(names)
    assert seen + 5 == sum(o.expanded > 0.0 for o in found.values())  # five numbers of the volume, in words


def test_small_contributions_are_drawn_small(rich_solution):
    """Bars of shares showed a source as large wherever U is small."""
    lines = list(
        budget_lines(
            budget(rich_solution), headline_rows(rich_solution, headline_outputs(rich_solution, np.array(TOOL)))
        )
    )
    whole = budget_bars(lines)
    small = [
        line._replace(u=1e-3 * line.u, contribution=1e-3 * line.contribution) if line.output == "EXX" else line
        for line in lines
    ]
    other = budget_bars(small)
    at = [t.get_text() for t in whole.axes[1].get_yticklabels()].index("EXX")
    assert drawn(other.axes[1], "total")[at] == pytest.approx(1e-3 * drawn(whole.axes[1], "total")[at])


@pytest.mark.parametrize(("name", "language"), [("rich_solution", "de"), ("rotary_solution", "en")])
def test_figure_can_be_read(name, language, request):
    assert faults(draw(Asked(request.getfixturevalue(name), TOOL, Texts(language)))) == []
