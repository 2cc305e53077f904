"""Symbols in words: English as `describe` has them, German for every one."""

import itertools

import pytest

from volid.fitting.squareness import angle_in_words
from volid.model.iso230 import describe
from volid.report.language import Texts
from volid.report.symbols import angle_words, in_words

MOTIONS = [f"E{d}{a}" for d, a in itertools.product("XYZABC", "XYZABC")]
SQUARENESS = ["EC0Y", "EB0Z", "EA0Z", "EC0X"]
LOCATIONS = [f"E{d}0{a}" for a in "ABC" for d in "XYZABC"]
TOOL = [f"E{d}0S" for d in "XYZABC"]


@pytest.mark.parametrize("name", [*MOTIONS, *SQUARENESS, *LOCATIONS, *TOOL])
def test_english_words_are_those_of_the_terminal(name):
    assert in_words(name, Texts("en")) == describe(name)


@pytest.mark.parametrize("name", [*MOTIONS, *SQUARENESS, *LOCATIONS, *TOOL])
def test_german_words_name_axis_and_direction_and_are_not_the_english_ones(name):
    words = in_words(name, Texts("de"))
    assert words != describe(name)
    assert not {"of", "the", "about", "error", "axis", "direction"} & set(words.replace(":", "").split())


@pytest.mark.parametrize("name", SQUARENESS)
@pytest.mark.parametrize(("value", "expanded"), [(30e-6, 2e-6), (-30e-6, 2e-6), (1e-6, 2e-6)])
def test_english_angles_are_those_of_the_terminal(name, value, expanded):
    assert angle_words(name, value, expanded, Texts("en")) == angle_in_words(name, value, expanded)


def test_german_angle_of_the_convention():
    """CONVENTIONS 3: EXY gains -EC0Y·y, so a positive EC0Y opens the angle between +X and +Y."""
    assert angle_words("EC0Y", 30e-6, 2e-6, Texts("de")) == "Winkel zwischen +X und +Y größer als 90°"
    assert angle_words("EC0Y", -30e-6, 2e-6, Texts("de")) == "Winkel zwischen +X und +Y kleiner als 90°"
    assert angle_words("EC0Y", None, None, Texts("de")) == ""
