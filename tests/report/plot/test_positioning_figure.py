"""The figure of a positioning test: its bars are as long as the quantities."""

import numpy as np
import pytest

from volid.report.plot.standards.positioning import _bars, positioning_figure
from volid.standards.positioning.evaluation import evaluate_positioning
from volid.standards.positioning.runs import PositioningRuns
from volid.standards.results import judged


def evaluation(seed=0, ways=(0, 1), n=5):
    rng = np.random.default_rng(seed)
    deviations = 5e-3 * rng.standard_normal((6, 2, 1)) + 1e-3 * rng.standard_normal((6, 2, n))
    for way in {0, 1} - set(ways):
        deviations[:, way] = np.nan
    return evaluate_positioning(PositioningRuns("X", np.arange(6) * 100.0, deviations))


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize(
    ("ways", "symbols"), [((0, 1), "A E R B"), ((0,), "A_up E_up R_up"), ((1,), "A_down E_down R_down")]
)
def test_a_bar_is_as_long_as_its_quantity(seed, ways, symbols):
    bars = _bars(evaluation(seed, ways))
    assert [b.quantity.symbol for b in bars] == symbols.split()
    for bar in bars:
        assert bar.high - bar.low == pytest.approx(bar.quantity.value, abs=1e-12)


def test_what_is_not_determined_has_no_bar():
    assert [b.quantity.symbol for b in _bars(evaluation(n=1))] == ["E", "B"]


def test_every_evaluation_has_a_row_with_its_values(tmp_path):
    whole = judged(evaluation(), {"E": 1e-4})
    figure = positioning_figure([whole, evaluation(1, (1,))])
    assert len(figure.axes) == 4
    labels = [text.get_text() for text in figure.axes[1].get_xticklabels()]
    assert labels[1] == f"E\n{1e3 * whole['E'].value:.1f}\n≤ 0.1\nfail"
    figure.savefig(tmp_path / "figure.svg")
    assert (tmp_path / "figure.svg").stat().st_size > 10_000


def test_every_entry_of_the_legend_stands_once():
    figure = positioning_figure([evaluation()])
    labels = [t.get_text() for t in figure.axes[0].get_legend().get_texts()]
    assert len(labels) == 4 and len(set(labels)) == 4
