"""The record: items of ISO/TR 16907 9.1, chain, squareness, datum, what remains, origin."""

from dataclasses import replace

import numpy as np
import pytest
from support.control_cases import MACHINE
from support.made_up import made_up

import volid
from volid.compensation.control import Control
from volid.compensation.residual.volume import predict_left, predict_residual
from volid.controllers.export import export
from volid.controllers.handover.record import MISSING, carto_chain, missing_items, record_text, squareness_words


def cell(text: str, name: str) -> str:
    """The cell beside a name in a table of the record."""
    (line,) = [line for line in text.splitlines() if line.startswith(f"| {name} ")]
    return line.strip("|").split("|")[1].strip()


@pytest.fixture(scope="module")
def solution():
    return made_up(MACHINE)


@pytest.mark.parametrize(
    "model, chain",
    [
        ("wYXbZt_vertical", "YXFZ"),
        ("wXbZYt_moving_column", "XFZY"),
        ("wbXYZt_gantry", "FXYZ"),
        ("wCAYXbZt_trunnion", "YXFZ"),
    ],
)
def test_the_chain_as_carto_spells_it(model, chain):
    assert carto_chain(volid.load_machine(f"models/{model}.toml")) == chain


def test_items_that_the_campaign_does_not_state_are_named(solution):
    conditions = {
        "warm_up": "30 min",
        "load": "none",
        "feed_m_min": 24.0,
        "active_compensations": ["L-POS: table of EXX"],
    }
    stated = replace(solution, campaign=replace(solution.campaign, conditions=conditions))
    text = record_text(export(stated, "linuxcnc", ["L-POS"]), predict=False)
    assert cell(text, "condition of the machine, warm-up") == "warm_up: 30 min"
    assert cell(text, "load") == "load: none" and cell(text, "feed") == "feed_m_min: 24 m/min"
    assert cell(text, "ambient temperature") == MISSING and cell(text, "acceleration") == MISSING
    assert "X 0 … 1000 mm" in cell(text, "positions of all linear and rotary axes")
    assert cell(text, "state of the machine") == "on top of: L-POS: table of EXX"
    assert missing_items(stated) == ["acceleration", "ambient temperature", "temperature of machine components"]


def test_what_the_files_mean(solution):
    base = volid.compensation_base(solution, (0.0, 0.0, -150.0), {"X": 400.0})
    text = record_text(
        export(solution, "linuxcnc", ["L-POS"], base=base), {"source": "s.h5", "date": "today"}, predict=False
    )
    assert cell(text, "kinematic chain, workpiece to tool") == "[w Y' X' b Z (C) t]; as CARTO spells it: YXFZ (F: bed)"
    assert cell(text, "values") == "absolute, not incremental"
    assert cell(text, "tool vector").startswith("0, 0, -150 mm") and "X = 400 mm" in cell(text, "lines cross at")
    assert cell(text, "datum").startswith("primary axis X, secondary axis Y")
    assert cell(text, "source") == "s.h5" and "volid residual" in text
    five = volid.load_machine("models/wCAYXbZt_trunnion.toml")
    assert cell(record_text(export(made_up(five), "linuxcnc"), predict=False), "frame of rotary values") == (
        "C: machine frame; A: machine frame"
    )


def test_squareness_is_said_as_an_angle(solution):
    """EC0Y = c turns +Y by c about Z from +X: the angle between both is 90° + c (CONVENTIONS 3: EXY gains -EC0Y·(y - y_ref))."""
    value = solution.location("EC0Y")
    (words,) = [w for w in squareness_words(solution) if w.startswith("EC(0X)Y")]
    size = "larger" if value.value > 0 else "smaller"
    assert words == (
        f"EC(0X)Y = {1e6 * value.value:.2f} µrad, U = {2e6 * value.u:.2f} µrad: angle between +X and +Y {size} than 90°"
    )


def test_what_remains_is_that_of_these_very_files(solution):
    """The grid of L-VOL by another way: the prediction for the same grid, drawn with the same seed."""
    grid = volid.linear_grid(solution, points=5, tool=(0.0, 0.0, -150.0))
    direct = predict_residual(solution, grid, most_draws=50)
    through = predict_left(solution, Control(MACHINE, grids=(grid,)), (0.0, 0.0, -150.0), 50)
    assert through == direct
    text = record_text(export(solution, "linuxcnc", ["L-POS"]))
    before, after = (
        [float(c) for c in next(x for x in text.splitlines() if x.startswith(f"| {n} ")).split("|")[2:4]]
        for n in ("before", "with these files")
    )
    assert after[0] < before[0] and after[1] < before[1]
    assert np.isfinite(before).all()
