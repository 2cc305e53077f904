"""Sketches of constants lean to the side to which the exact chain leans."""

import numpy as np
import pytest
from exact_chain import ExactMachine, Truth
from support.axis_lines import axis_line, line_error
from support.figures import faults
from support.machines import NUTATING, STRUCTURES, exact_machine

from volid.report.language import ENGLISH, Texts
from volid.report.plot.axis_lines import line_panel, places_of, stands_in_its_frame
from volid.report.plot.constants import Constant, with_u
from volid.report.plot.squareness import angle, angle_panel, sketch_panels

TRAVEL = {"X": (0.0, 1000.0), "Y": (0.0, 600.0), "Z": (-500.0, 0.0)}
EVERY = ["EC0Y", "EA0Z", "EB0Z", "EC0X", "EB0X", "EA0Y"]
U = 5e-6


def path(structure, truth, letter):
    """Unit vector along which the functional point moves when one axis does, by exact matrices."""
    machine = ExactMachine(structure, TRAVEL)
    q = [machine.in_axis_order({"X": 400.0, "Y": 200.0, "Z": -300.0} | {letter: x}) for x in (-250.0, 350.0)]
    start, end = (machine.pose(p, truth)[0, :3, 3] for p in q)
    return (end - start) / np.linalg.norm(end - start)


@pytest.mark.parametrize("structure", ["w b X Y Z t", "w Y' X' b Z t", "w Z' Y' X' b t"])
@pytest.mark.parametrize("name", EVERY)
@pytest.mark.parametrize("value", [40e-6, -40e-6])
def test_the_drawn_angle_is_on_the_side_of_the_exact_one(structure, name, value):
    _, (panel,) = sketch_panels()
    found = angle(Constant(name, value, U))
    angle_panel(panel, found, ENGLISH)
    arrows = {a.get_gid()[-1]: np.subtract(a.xy, a.xyann) for a in panel.texts if a.get_gid()}
    assert tuple(arrows) == found.letters == tuple(sorted(found.letters))
    truth = Truth(constants={name: value})
    paths = {letter: path(structure, truth, letter) for letter in arrows}
    exact = np.arccos(paths[found.letters[0]] @ paths[found.letters[1]]) - np.pi / 2
    first, second = arrows.values()
    drawn = np.arccos(first @ second / np.linalg.norm(first) / np.linalg.norm(second)) - np.pi / 2
    assert np.sign(drawn) == np.sign(exact) == found.sign
    plane = ["XYZ".index(letter) for letter in arrows]
    for k, letter in enumerate(arrows):  # it leans the axis that leans, to its side; the other one is the datum
        aside = paths[letter][plane[1 - k]]
        assert np.sign(round(aside, 9)) == np.sign(round(arrows[letter][1 - k], 9))
    words = [t.get_text() for t in panel.texts]
    assert ("> 90°" if exact > 0 else "< 90°") in words
    assert "datum" in words


def test_within_its_uncertainty_an_axis_stands_upright_and_without_value_it_says_so():
    assert angle(Constant("EC0Y", 4e-6, U)).sign == 0.0
    np.testing.assert_array_equal(angle(Constant("EC0Y", 4e-6, U)).directions, np.eye(2))
    _, (panel,) = sketch_panels()
    angle_panel(panel, angle(Constant("EC0Y", np.nan, np.nan)), ENGLISH)
    assert "n.d." in [t.get_text() for t in panel.texts]
    assert panel.get_title() == "EC0Y, EC(0X)Y\nnot determined"


def test_a_line_that_is_known_in_one_direction_only_is_not_drawn():
    found = {"EX0C": Constant("EX0C", 0.02, 0.001), "EY0C": Constant("EY0C", np.nan, np.nan)}
    figure, (panel,) = sketch_panels()
    line_panel(panel, next(places_of("C", 2, found)), ENGLISH)
    assert "not determined" in [t.get_text() for t in panel.texts]
    assert panel.get_title().endswith("EX0C 20.0 ± 1.0 µm")  # what is known is said
    assert faults(figure) == []


@pytest.mark.parametrize("structure", [*STRUCTURES.values(), *NUTATING.values(), "w A' X' b Y Z t", "w b X Y Z A t"])
def test_lines_stand_and_lean_as_in_the_exact_chain(structure):
    """Parameters of all rotary axes at once; the drawn numbers are those of the physical lines in the machine frame."""
    exact = exact_machine(structure)
    rng = np.random.default_rng(5)
    rotary = [a for a in exact.axes if a in "ABC"]
    truth = Truth(
        constants={f"E{d}0{a}": s * rng.normal() for a in rotary for d, s in SIZES if d != a and d != MATE[a]}
    )
    for a in rotary:
        six = line_error(exact, truth, a)  # ISO's values: displacement, rotation
        found = {f"E{d}0{a}": Constant(f"E{d}0{a}", six[k], 1e-9) for k, (d, _) in enumerate(SIZES)}
        along = "ABC".index(a)
        place, leaning = places_of(a, along, found)
        u, v = (along + 1) % 3, (along + 2) % 3
        np.testing.assert_allclose(place.values, 1e3 * six[[u, v]])
        direction, _ = axis_line(exact, truth, a)
        leans = exact.frame[a].T @ (direction - exact.direction[a]) * np.sign(exact.frame[a][:, along] @ direction)
        np.testing.assert_allclose(leaning.values, 1e6 * leans[[u, v]], rtol=0.0, atol=0.05)  # second order: 1e-4²
        assert leaning.directions == ("XYZ"[u], "XYZ"[v])


SIZES = [(d, 0.02 if d in "XYZ" else 1e-4) for d in "XYZABC"]
MATE = {"A": "X", "B": "Y", "C": "Z"}


@pytest.mark.parametrize("language", ["en", "de"])
def test_sketches_are_readable(language):
    texts, numbers = Texts(language), {f"E{d}0C": Constant(f"E{d}0C", s, 0.1 * s) for d, s in SIZES}
    figure, panels = sketch_panels(1, 3)
    angle_panel(panels[0], angle(Constant("EB0X", -123.4e-6, U)), texts)
    for panel, place in zip(panels[1:], places_of("C", 2, numbers), strict=True):
        line_panel(panel, place, texts)
    assert faults(figure) == []


def test_u_has_two_significant_digits_and_leads_the_value():
    assert with_u(Constant("EX0C", 0.0196, 0.00996), ENGLISH) == "20 ± 10 µm"
    assert with_u(Constant("EA0C", -3.2e-7, 4.44e-8), Texts("de")) == "−0,320 ± 0,044 µrad"


def test_an_axis_that_counts_the_other_way_still_has_its_line():
    from volid.model.machine import Axis

    assert stands_in_its_frame(Axis("C", True, (0.0, 360.0), 0.0, direction=(0.0, 0.0, -1.0)))
    assert not stands_in_its_frame(Axis("B", True, (0.0, 180.0), 0.0, direction=(0.0, 0.6, 0.8)))
