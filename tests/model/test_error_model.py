"""The error model: the datum's rules hold exactly, signs are CONVENTIONS', and every arrangement has full rank."""

import itertools
from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from exact_chain import COMPONENTS, LINEAR, ExactMachine, Truth, random_truth, tracker_campaign
from scipy.interpolate import BSpline
from support.machines import fixed, volid_machine
from support.trackers import distance_campaign

from volid.exceptions import InputError
from volid.fitting.diagnosis.identifiability import analyse
from volid.fitting.equations.problem import build_problem
from volid.fitting.starts import find_starts
from volid.model.error_functions import motion_names, squareness_effect, squareness_names
from volid.model.error_model import build_model
from volid.model.error_values import error_values, evaluate_bases
from volid.model.machine import Datum, FunctionSettings

TRAVEL = {"X": (0.0, 1000.0), "Y": (-100.0, 500.0), "Z": (-500.0, 0.0)}
EXACT = ExactMachine("w Y' b X Z t", TRAVEL, reference={"X": 300.0, "Y": 0.0, "Z": -100.0})
DATUMS = [Datum(a, b) for a, b in itertools.permutations(LINEAR, 2)]
ARRANGEMENTS = [
    " ".join(["w", *[a + "'" for a in order[:split]], "b", *order[split:], "t"])
    for order in itertools.permutations(LINEAR)
    for split in range(4)
]
# coefficients are of order 1 here, and rows of order 1: a few roundings
ZERO = 1e-13


def model_of(machine, n=5, datum=None, carrier=None, **special):
    """Model with `n` segments for every function, `special` for some."""
    segments = {name: special.get(name, (n,)) for name in motion_names(machine)}
    return build_model(machine, segments, datum=datum, carrier=carrier)


def values_of(model, theta, q, direction=None):
    """Error values by name for positions (m, axes): {"EXX": (m,)}; tool frame under "EXS"."""
    direction = np.zeros_like(q) if direction is None else direction
    bases = evaluate_bases(model.layout, jnp.asarray(q.T), jnp.asarray(direction.T))
    rows = np.asarray(error_values(model.layout, jnp.asarray(model.parametrisation @ theta), bases))
    letters = [*model.machine.letters, "S"]
    return {c + a: rows[6 * i + k] for i, a in enumerate(letters) for k, c in enumerate(COMPONENTS)}


def random_theta(model, seed=0):
    return np.random.default_rng(seed).normal(size=model.n_parameters)


def along(machine, letter, x, **at):
    """Positions (m, 3) with one axis at `x` and the others at stated positions (default: 0)."""
    return machine.order(**({a: 0.0 for a in machine.letters} | at | {letter: x}))


def least_squares_slope(x_of, travel):
    """Slope of a function of position by Gauss-Legendre quadrature on 20 intervals, independent of volid.model.splines."""
    node, weight = np.polynomial.legendre.leggauss(6)
    edges = np.linspace(*travel, 21)
    half = (edges[1] - edges[0]) / 2
    x = (edges[:-1, None] + half + half * node).ravel()
    w, arm = np.tile(weight, 20), x - np.mean(travel)
    return (w * arm) @ x_of(x) / (w @ arm**2)


# ------------------------------------------------------------------------------------------------ datum constraints


@pytest.mark.parametrize("datum", DATUMS, ids=lambda d: d.primary + d.secondary)
def test_functions_are_zero_at_the_reference_and_straightness_has_no_slope(datum):
    machine = volid_machine(EXACT)
    model = model_of(machine, 5, datum)
    theta = random_theta(model)
    for f in model.functions:
        if f.part == "location":
            theta[f.parameters] = 0.0
    for letter in LINEAR:
        at_reference = values_of(model, theta, along(machine, letter, [EXACT.reference[letter]]))
        for c in COMPONENTS:
            assert abs(at_reference[c + letter][0]) < ZERO
            slope = least_squares_slope(
                lambda x, c=c, letter=letter: values_of(model, theta, along(machine, letter, x))[c + letter],
                TRAVEL[letter],
            )
            straightness = c[1] in LINEAR and c[1] != letter
            assert (abs(slope) < ZERO) == straightness, f"{c}{letter}: only straightness loses its slope"


@pytest.mark.parametrize("n", [1, 3])
def test_constraints_take_exactly_one_or_two_parameters(n):
    model = model_of(volid_machine(EXACT), n)
    for f in model.functions:
        size = f.parameters.stop - f.parameters.start
        if f.part == "location":
            assert size == 1
        else:
            straightness = f.name[1] in LINEAR and f.name[1] != f.name[2]
            assert size == n + 3 - 1 - straightness, f.name
    # 18 functions of n + 3, 18 zeros, 6 slopes, 3 squareness, 3 tool rotations
    assert model.n_parameters == 18 * (n + 3) - 18 - 6 + 3 + 3 == len(model.parameter_labels())


def test_end_point_line():
    machine = volid_machine(EXACT)
    model = model_of(machine, 5, Datum(line="end_point"))
    theta = random_theta(model)
    theta[[f.parameters.start for f in model.functions if f.part == "location"]] = 0.0
    ends = values_of(model, theta, along(machine, "Z", TRAVEL["Z"]))
    assert abs(ends["EXZ"][0] - ends["EXZ"][1]) < ZERO * 10
    assert abs(ends["EZZ"][0] - ends["EZZ"][1]) > 1e-3


def test_reference_of_the_datum_wins():
    machine = volid_machine(EXACT)
    model = model_of(machine, 5, Datum(reference=(("Z", -400.0),)))
    assert abs(values_of(model, random_theta(model), along(machine, "Z", [-400.0]))["EAZ"][0]) < ZERO


def test_chosen_resolution_is_a_subspace_of_the_carrier():
    """A model of 4 segments stored in 12 gives functions of 4 segments, with the same datum."""
    machine = volid_machine(EXACT)
    model = model_of(machine, 4, carrier={n: (12,) for n in motion_names(machine)})
    theta = random_theta(model)
    x = np.linspace(*TRAVEL["X"], 40)
    values = values_of(model, theta, along(machine, "X", x))["EAX"]
    knots = 250.0 * np.arange(-3, 8)
    fitted = BSpline.design_matrix(np.clip(x, 0, 1000), knots, 3).toarray()
    left = values - fitted @ np.linalg.lstsq(fitted, values, rcond=None)[0]
    assert np.abs(left).max() < ZERO * 100
    assert model.n_parameters == model_of(machine, 4).n_parameters
    assert model.segments["EAX"] == (4,) and model.carrier["EAX"] == (12,)


# ------------------------------------------------------------------------------------------------------ cross effects


@pytest.mark.parametrize("name", ["EAZ", "EYZ", "EZZ"])
def test_cross_effect_rules(name):
    machine = volid_machine(EXACT, fixed(4, f'[model.functions]\n{name} = {{ over = ["Z", "X"], segments = [4, 3] }}'))
    model = model_of(machine, 4, **{name: (4, 3)})
    theta = random_theta(model)
    theta[[f.parameters.start for f in model.functions if f.part == "location"]] = 0.0
    x = np.linspace(*TRAVEL["X"], 7)
    at_own_reference = values_of(model, theta, along(machine, "X", x, Z=-100.0))[name]
    np.testing.assert_allclose(at_own_reference, 0.0, atol=ZERO)
    slopes = [
        least_squares_slope(lambda z, x=x: values_of(model, theta, along(machine, "Z", z, X=x))[name], TRAVEL["Z"])
        for x in (300.0, 900.0)
    ]
    assert (abs(slopes[0]) < ZERO) == (name == "EYZ"), (
        "the line at X = 300, its reference, obeys the one-dimensional rule"
    )
    assert abs(slopes[1]) > 1e-5, "elsewhere it does not"


def test_over_must_name_the_own_axis():
    machine = volid_machine(EXACT)
    wrong = replace(machine.model, functions={"EAZ": FunctionSettings(over=("X", "Y"), segments=(2, 2))})
    machine = type(machine)(machine.name, machine.structure, machine.axes, machine.datum, wrong)
    with pytest.raises(InputError, match=r"EAZ: over = \['X', 'Y'\] must name Z and one other axis"):
        model_of(machine, 4)


# -------------------------------------------------------------------------------------------------- location errors


@pytest.mark.parametrize("structure", ["w b X Y Z t", "w Z' Y' X' b t", "w Y' b X Z t"])
@pytest.mark.parametrize("datum", DATUMS, ids=lambda d: d.primary + d.secondary)
def test_squareness_and_tool_rotation_have_the_exact_chains_signs(structure, datum):
    exact = ExactMachine(structure, TRAVEL, reference=EXACT.reference)
    machine = volid_machine(exact)
    model = model_of(machine, 1, datum)
    truth = random_truth(exact, np.random.default_rng(0), primary=datum.primary, secondary=datum.secondary)
    truth = Truth(constants=truth.constants)
    theta = np.zeros(model.n_parameters)
    locations = {f.name: f.parameters.start for f in model.functions if f.part == "location"}
    assert set(locations) == set(truth.constants)
    for name, i in locations.items():
        theta[i] = truth.constants[name]
    q = np.random.default_rng(1).uniform(-500, 1000, (9, 3))
    found = values_of(model, theta, q)
    for a in exact.axes:
        expected = exact.errors(a, q, truth)
        for k, c in enumerate(COMPONENTS):
            np.testing.assert_allclose(found[c + a], expected[:, k], atol=1e-17)
    for c in COMPONENTS[3:]:
        np.testing.assert_allclose(found[c + "S"], truth.constants[c + "0S"])


def test_squareness_sentences_of_the_conventions():
    machine = volid_machine(EXACT)
    assert squareness_names(machine, Datum()) == ("EC0Y", "EA0Z", "EB0Z")
    assert squareness_names(machine, Datum("Z", "X")) == ("EB0X", "EA0Y", "EC0Y")
    assert squareness_effect("EC0Y") == ("EXY", -1.0)
    assert squareness_effect("EB0Z") == ("EXZ", 1.0)
    assert squareness_effect("EA0Z") == ("EYZ", -1.0)


# ------------------------------------------------------------------------------------------- switches and reversal


def test_patterns_switch_functions_off_and_later_entries_win():
    extra = '[model.functions]\n"E*X" = false\nEXX = { segments = 3 }\n"E[ABC]Z" = false\nEC0Y = false\n"E?0S" = false'
    machine = volid_machine(EXACT, extra)
    names = motion_names(machine)
    assert [n for n in names if n.endswith("X")] == ["EXX"]
    assert [n for n in names if n.endswith("Z")] == ["EXZ", "EYZ", "EZZ"]
    model = model_of(machine, 4)
    assert [f.name for f in model.functions if f.part == "location"] == ["EA0Z", "EB0Z"]
    values = values_of(model, random_theta(model), along(machine, "X", np.array([1.0, 900.0])))
    assert np.all(values["EYX"] == 0) and np.all(values["EAS"] == 0) and np.all(values["EXX"] != 0)


@pytest.mark.parametrize("kind, size", [('"constant"', 1), ("true", 7)])
def test_reversal_is_plus_minus_half(kind, size):
    machine = volid_machine(EXACT, fixed(4, f"[model.functions]\nEXX = {{ reversal = {kind} }}"))
    model = model_of(machine, 4)
    part = model.by_name["EXX", "reversal"]
    assert part.parameters.stop - part.parameters.start == size
    theta = random_theta(model)
    x = np.linspace(*TRAVEL["X"], 30)
    q, way = along(machine, "X", x), np.zeros((30, 3))
    column = machine.index("X")
    by_way = {}
    for sign in (-1, 0, 1):
        way[:, column] = sign
        by_way[sign] = values_of(model, theta, q, way)
    reversal = by_way[1]["EXX"] - by_way[-1]["EXX"]
    np.testing.assert_allclose(by_way[0]["EXX"], (by_way[1]["EXX"] + by_way[-1]["EXX"]) / 2, atol=1e-14)
    np.testing.assert_array_equal(by_way[1]["EYX"], by_way[-1]["EYX"])
    if size == 1:
        np.testing.assert_allclose(reversal, theta[part.parameters][0])
    else:
        knots = 250.0 * np.arange(-3, 8)
        coefficients = theta[part.parameters]
        np.testing.assert_allclose(reversal, BSpline(knots, coefficients, 3)(x), atol=1e-13)
        assert abs(reversal[10]) > 1e-2, "a reversal is not zero at the reference"


def test_degree_of_a_function():
    machine = volid_machine(EXACT, fixed(4, "[model.functions]\nEAX = { degree = 1 }"))
    model = model_of(machine, 4)
    values = values_of(model, random_theta(model), along(machine, "X", np.array([0.0, 100.0, 200.0, 240.0])))["EAX"]
    assert (values[3] - values[2]) / 40 == pytest.approx((values[1] - values[0]) / 100)


# ----------------------------------------------------------------------------------------------------- full rank


@pytest.mark.parametrize(
    "structure", [pytest.param(s, marks=[] if i % 4 == 1 else pytest.mark.slow) for i, s in enumerate(ARRANGEMENTS)]
)
def test_full_rank_for_every_arrangement(structure):
    """Six unknown stations that see three tools each: every function, and the constant tool rotation, is determined."""
    exact = ExactMachine(structure, TRAVEL)
    rng = np.random.default_rng(7)
    tracker = tracker_campaign(exact, Truth(), rng, n_per_station=60, every_station_sees_every_tool=True)
    campaign = distance_campaign(volid_machine(exact), tracker)
    model = model_of(campaign.machine, 4)
    assert model.n_parameters == 18 * 7 - 24 + 6
    found = analyse(build_problem(campaign, model, find_starts(campaign)), campaign)
    assert found.full_rank and found.tool_rotation.shape[1] == 0
    assert found.nuisance_defect == 0
    assert found.basis.shape[1] == model.n_parameters + 6 * (3 + 3)


@pytest.mark.parametrize(
    ("lines", "asked"),
    [
        ('"E[ABC]0[ABC]" = true', True),
        ('"E?0C" = true', True),
        ('"E[ABC]0[ABC]" = true\nEC0C = false', False),
        ('"E[ABC]*" = { segments = 6 }', False),
        ('"E*" = true', False),
        ("", False),
    ],
)
def test_zeros_are_asked_for_by_name_or_by_a_pattern_for_constants(lines, asked):
    text = f"[model.functions]\n{lines}\n" if lines else ""
    machine = volid_machine(ExactMachine("w C' b X Y Z t", TRAVEL | {"C": (0.0, 360.0)}), text)
    model = build_model(machine, {f"E{d}{a}": (4,) for d in "XYZABC" for a in machine.letters})
    assert ("EC0C" in model.names) == asked
    assert {"EX0C", "EY0C", "EA0C", "EB0C"} <= set(model.names)
