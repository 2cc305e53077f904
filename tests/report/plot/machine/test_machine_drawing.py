"""The drawing of a machine says what its structural code says, and its arrows show what the exact chain does."""

import re
from pathlib import Path

import numpy as np
import pytest
from exact_chain import Truth
from support.figures import faults
from support.machines import exact_of
from support.places import ROOT

from volid.io.machines import parse_machine, read_machine
from volid.report.language import Texts
from volid.report.plot.machine.drawing import machine_figure
from volid.report.plot.machine.layout import layout
from volid.report.plot.machine.solids import project

MODELS = sorted((ROOT / "models").glob("*.toml"))
ODD = (
    "w X' Y' Z' b t",
    "w b Z t",
    "w (C) X' b Z t",
    "w C' Y' b X Z B A t",
    "w C' B' A' b t",
    "[w b C B A X Y Z (S) t]",
    "w A' b t",
)
PRIME = "\N{PRIME}"


def odd(code):
    """A machine with this structural code, travels and points with many digits, C counting the other way."""
    text = f'format = "volid-machine/1"\nname = "{code}"\nstructure = "{code}"\n'
    for letter in re.findall(r"(?<![(])\b[A-Z]\b(?![)])", code):
        text += f"[axis.{letter}]\ntravel = [-1234.567, 1234.567]\n"
        text += "" if letter in "XYZ" else "point = [-1234.567, 123.4, -1234.567]\n"
        text += "direction = [0.0, 0.0, -1.0]\n" if letter == "C" else ""
    return parse_machine(text, "odd.toml")


def machines():
    yield from (pytest.param(read_machine(f), id=f.stem) for f in MODELS)
    yield from (pytest.param(odd(code), id=code) for code in ODD)


def texts_of(panel):
    return [text.get_text() for text in panel.texts]


@pytest.mark.parametrize("machine", list(machines()))
def test_every_element_of_the_code_stands_once_and_in_its_order(machine):
    """Written from the code itself: from the workpiece down to the bed, then from the arm down to the tool."""
    upper, lower = machine_figure(machine).axes
    code = [t.replace("'", PRIME) for t in machine.structure.strip("[]").split()]
    assert texts_of(lower) == code
    assert list(np.diff([text.get_position()[0] for text in lower.texts]) > 0.0) == [True] * (len(code) - 1)
    on_bodies = {t.get_text(): t.get_position()[1] for t in upper.texts if t.get_fontweight() == "bold"}
    bed = code.index("b")
    for side in (code[:bed], code[bed + 1 : -1]):  # "t" is a line with words
        heights = [on_bodies.pop(token) for token in side]
        assert heights == sorted(heights, reverse=True)
    assert not on_bodies


@pytest.mark.parametrize("machine", list(machines()))
def test_arrows_move_as_the_bodies_of_the_exact_chain_do(machine):
    """A body's own motion, seen from the bed, for a small step of its axis: exact 4x4 matrices against drawn arrows."""
    exact = exact_of(machine)
    panel = machine_figure(machine).axes[0]
    arrows = {a.get_gid().removeprefix("arrow-"): a for a in panel.texts if a.get_gid()}
    assert sorted(arrows) == sorted(machine.letters)
    for k, axis in enumerate(machine.axes):
        q = np.zeros((2, len(machine.axes)))
        q[1, k] = 1e-3
        bed = np.linalg.inv(exact.body_pose("bed", q, Truth()))
        start, end = bed @ exact.body_pose(axis.letter, q, Truth())
        drawn = np.subtract(arrows[axis.letter].xy, arrows[axis.letter].xyann)
        middle = np.array([2.3, next(b.height for b in layout(machine).bodies if b.axis == axis)])
        if axis.is_linear:
            moved = project((end - start)[:3, 3])
        else:
            place = 0.5 * np.add(arrows[axis.letter].xy, arrows[axis.letter].xyann) - middle
            moved = turned_in_the_drawing(start, end, place, axis)
        cosine = drawn @ moved / np.linalg.norm(drawn) / np.linalg.norm(moved)
        assert cosine > 0.95, (axis.letter, drawn, moved)


def turned_in_the_drawing(start, end, place, axis):
    """Where a small turn moves the point of the plane across the axis's line that is drawn at `place`."""
    across = np.linalg.svd(np.asarray(axis.unit_vector)[None])[2][1:]
    point = np.linalg.solve(project(across).T, place) @ across
    turn = end[:3, :3] @ start[:3, :3].T
    return project(turn @ point - point)


@pytest.mark.parametrize("machine", list(machines()))
def test_texts_lie_free(machine):
    assert faults(machine_figure(machine, (80.25, -40.5, -150.125), Texts("de"))) == []  # German words are longer


def test_texts_lie_free_in_english():
    assert faults(machine_figure(odd(ODD[3]), (80.25, -40.5, -150.125))) == []


def test_words_say_travels_references_lines_and_the_tool():
    machine = read_machine(ROOT / "models/wCBYbXZt_nutating_table.toml")
    words = "\n".join(texts_of(machine_figure(machine, (0.0, 0.5, -150.0)).axes[0]))
    for text in (
        f"C{PRIME}: 0 … 360°",
        f"Y{PRIME}: −500 … 300 mm",
        "reference −100 mm",
        "line through (0, 0, 0) mm",
        "along (0, 0.707, 0.707)",
        "vector (0, 0.5, −150) mm",
        "spindle (S), no axis",
    ):
        assert text in words
    assert words.count("along") == 1  # C' has the direction of its letter
    german = "\n".join(texts_of(machine_figure(machine, (0.0, 0.5, -150.0), Texts("de")).axes[0]))
    assert "Vektor (0; 0,5; −150) mm" in german
    assert not re.search("workpiece|spindle|reference|bed|through", german)


def test_a_name_with_signs_of_formulas_is_drawn_as_it_is():
    text = Path(MODELS[0]).read_text(encoding="utf-8").replace('name = "', 'name = "$x_{2}$ & <b> 100 % ')
    figure = machine_figure(parse_machine(text, "machine.toml"))
    assert figure.get_suptitle().startswith("$x_{2}$ & <b> 100 %")
    assert faults(figure) == []
