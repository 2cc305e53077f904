"""Squareness in words: the angle between the directions in which the exact chain moves."""

import numpy as np
import pytest
from exact_chain import ExactMachine, Truth

from volid.fitting.squareness import angle_in_words, squareness_symbol
from volid.model.error_functions import squareness_names
from volid.model.machine import Datum

TRAVEL = {"X": (0.0, 1000.0), "Y": (0.0, 600.0), "Z": (-500.0, 0.0)}
EVERY = ["EC0Y", "EA0Z", "EB0Z", "EC0X", "EB0X", "EA0Y"]


def angle(structure, name, value, axes):
    """Angle [rad] between the paths of the functional point along the positive directions of two axes, by exact matrices."""
    machine = ExactMachine(structure, TRAVEL)
    truth, paths = Truth({}, {name: value}), []
    for axis in axes:
        q = [machine.in_axis_order({"X": 400.0, "Y": 200.0, "Z": -300.0} | {axis: x}) for x in (-250.0, 350.0)]
        start, end = (machine.pose(p, truth)[0, :3, 3] for p in q)
        paths.append((end - start) / np.linalg.norm(end - start))
    return float(np.arccos(paths[0] @ paths[1]))


@pytest.mark.parametrize("structure", ["w b X Y Z t", "w Y' X' b Z t", "w Z' Y' X' b t"])
@pytest.mark.parametrize("name", EVERY)
@pytest.mark.parametrize("value", [40e-6, -40e-6])
def test_larger_or_smaller_is_what_the_paths_do(structure, name, value):
    words = angle_in_words(name, value, 5e-6)
    axes = words.removeprefix("angle between +").split(" and +")
    axes = (axes[0], axes[1][0])
    assert set(axes) | {name[1].translate(str.maketrans("ABC", "XYZ"))} == set("XYZ")  # the plane, and its normal
    found = angle(structure, name, value, axes) - np.pi / 2
    assert abs(found) == pytest.approx(40e-6, abs=1e-9)
    assert words.endswith("larger than 90°" if found > 0 else "smaller than 90°")


def test_closed_forms_of_the_default_datum():
    """EXY gains -EC0Y (y - y_ref): +Y leans to -X, away from +X; EXZ gains +EB0Z: towards it; EYZ gains -EA0Z."""
    assert angle_in_words("EC0Y", 1e-5, 1e-6) == "angle between +X and +Y larger than 90°"
    assert angle_in_words("EB0Z", 1e-5, 1e-6) == "angle between +X and +Z smaller than 90°"
    assert angle_in_words("EA0Z", 1e-5, 1e-6) == "angle between +Y and +Z larger than 90°"
    assert angle_in_words("EC0Y", -1e-5, 1e-6) == "angle between +X and +Y smaller than 90°"


def test_what_is_within_its_uncertainty_has_no_direction():
    assert angle_in_words("EC0Y", 1e-6, 1.1e-6) == "angle between +X and +Y not distinguishable from 90°"
    assert angle_in_words("EC0Y", -1e-6, 1.1e-6) == "angle between +X and +Y not distinguishable from 90°"
    assert "larger" in angle_in_words("EC0Y", 1.2e-6, 1.1e-6)
    assert angle_in_words("EC0Y", float("nan"), float("nan")) == ""


@pytest.mark.parametrize("primary", "XYZ")
@pytest.mark.parametrize("secondary", "XYZ")
def test_full_symbols_name_both_axes_of_every_datum(vertical, primary, secondary):
    if primary == secondary:
        return
    third = ({*"XYZ"} - {primary, secondary}).pop()
    symbols = {squareness_symbol(n) for n in squareness_names(vertical, Datum(primary, secondary))}
    normal = {"X": "A", "Y": "B", "Z": "C"}
    assert symbols == {
        f"E{normal[third]}(0{primary}){secondary}",
        f"E{normal[secondary]}(0{primary}){third}",
        f"E{normal[primary]}(0{secondary}){third}",
    }


@pytest.fixture
def vertical():
    from volid.io import read_machine

    return read_machine("models/wYXbZt_vertical.toml")
