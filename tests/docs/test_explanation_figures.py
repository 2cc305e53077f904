"""The drawn figures of the explanations are readable, and say what the pages beside them say."""

import importlib
import sys

import numpy as np
import pytest
from support.figures import faults
from support.places import ROOT

FOLDER = ROOT / "docs" / "figures"
NAMES = sorted(p.stem for p in FOLDER.glob("explanation_*.py"))


@pytest.fixture
def module(monkeypatch):
    """A module of the folder of figures by its name, forgotten afterwards."""
    known = set(sys.modules)
    monkeypatch.syspath_prepend(str(FOLDER))
    yield importlib.import_module
    for name in set(sys.modules) - known:
        if str(getattr(sys.modules[name], "__file__", "")).startswith(str(FOLDER)):
            del sys.modules[name]


@pytest.mark.parametrize("name", NAMES)
def test_every_figure_is_readable_and_stands_on_its_page(name, module):
    assert faults(module(name).draw()) == []
    page = ROOT / "docs" / "explanation" / f"{name.removeprefix('explanation_')}.md"
    assert f"_generated/figures/{name}.svg" in page.read_text(encoding="utf-8")


def test_determined_combinations_are_those_of_the_exact_chain(module):
    """As exact matrices count them: 19 in tests/planning/test_diagonals.py, the others in tests/exact_chain/test_ranks.py."""
    assert list(module("explanation_determination").counts().values()) == [19, 53, 61, 69]


def test_moved_networks_have_equal_lengths(module):
    gauge = module("explanation_gauge")
    points = gauge.lattice().reshape(-1, 2)
    lengths = [np.linalg.norm(p[:, None] - s, axis=2) for p, s in ((points, gauge.STATIONS),)]
    lengths.append(np.linalg.norm(gauge.moved(points)[:, None] - gauge.moved(gauge.STATIONS), axis=2))
    np.testing.assert_allclose(*lengths, rtol=1e-12)


def test_the_lever_arm_is_that_of_a_rotation(module):
    """ω × t for a tool along -Z: 20 µrad at 300 mm are 6 µm; the sketch leans to the side of the plotted curve."""
    arms = module("explanation_lever_arms")
    rotation, tool = np.array([0.0, 1e-6 * arms.pitch(800.0), 0.0]), np.array([0.0, 0.0, -300.0])
    assert arms.deviation(800.0, 300.0) == pytest.approx(1e3 * np.cross(rotation, tool)[0])
    assert arms.pitch(800.0) > 0.0 > arms.deviation(800.0, 300.0)
    panel = arms.draw().axes[0]
    tips = [np.subtract(t.xy, t.xyann) for t in panel.texts if not t.get_text()]
    assert all(tip[0] < 0.0 for tip in tips)  # EBX > 0 moves the tip of a hanging tool towards -X
