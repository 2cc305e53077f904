"""No verdict on a number that does not hold: rejected models, and numbers of the volume without part of the machine."""

from dataclasses import replace

import numpy as np
import pytest

import volid
from volid.fitting.diagnosis.adequacy import ENLARGED, QUESTIONED, REJECTED
from volid.report.contents.contents import gather
from volid.report.language import ENGLISH
from volid.report.page.sections.limits import build
from volid.report.text.evaluations import unproved
from volid.uncertainty.budget import headline_rows
from volid.uncertainty.outputs import headline_outputs

WIDE = {"largest_deviation": 0.9, "V_X": 0.9, "EXX": 0.9}


@pytest.fixture(scope="module")
def positioning():
    """EXX and EZZ alone: 19 motions are not in the model."""
    return volid.fit(volid.load_campaign("datasets/published_positioning/campaign.toml"))


def judged(solution, limits=WIDE):
    return gather(solution, limits=limits, expected=False)


def test_a_volume_without_the_rest_of_the_machine_is_not_judged(positioning, tmp_path):
    contents = judged(positioning)
    found = {symbol: contents.evaluation[symbol].verdict for symbol in WIDE}
    assert found == {"largest_deviation": "undecided", "V_X": "undecided", "EXX": "pass"}
    assert [s for s in unproved([contents.evaluation]) if "EXX" in s] == []
    body = build(contents, ENGLISH).body
    assert ENGLISH("limits.withheld_left_out") in body and ENGLISH("limits.withheld_model") not in body
    volid.save_dcc(positioning, tmp_path / "result.xml", limits=WIDE)
    assert (tmp_path / "result.xml").read_text(encoding="utf-8").count("<dcc:conformity>") == 1


@pytest.mark.parametrize(("grade", "verdict"), [(REJECTED, "undecided"), (QUESTIONED, "undecided"), (ENLARGED, "pass")])
def test_a_model_that_is_not_accepted_proves_nothing(positioning, grade, verdict):
    """However wide the limit is; nor does it prove that a limit is exceeded."""
    solution = replace(positioning, adequacy=replace(positioning.adequacy, grade=grade))
    assert judged(solution).evaluation["EXX"].verdict == verdict
    narrow = judged(solution, {"EXX": 1e-6}).evaluation["EXX"]
    assert narrow.verdict == ("fail" if grade == ENLARGED else "undecided") and np.isfinite(narrow.value)


def test_a_budget_has_no_component_that_nothing_acts_on(positioning):
    """V_Y of positioning of X and Z alone: not 0 ± 0."""
    outputs = headline_outputs(positioning, np.zeros(3))
    rows = headline_rows(positioning, outputs)
    assert {"V_X", "V_Z"} <= set(rows.names) and "V_Y" not in rows.names
    assert len(rows.names) == len(rows.units) == len(rows.positions) == len(rows.matrix) == len(rows.scatter)


@pytest.mark.parametrize(("limit", "shown"), [(0.01225, "12.25"), (0.05, "50.0"), (0.0123456, "12.3456")])
def test_a_limit_is_shown_as_it_was_stated(positioning, limit, shown):
    """12.2 µm would be another limit."""
    body = build(judged(positioning, {"EXX": limit}), ENGLISH).body
    assert f'data-key="evaluation.EXX.limit">{shown}</data>' in body
