"""One builder for all grids: no uncertainty asked for changes no value; exact and linearised evaluation, by their words."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.compensated import TOOL, machine_and_solution

from volid.compensation.alignment import aligned_to_spindle
from volid.compensation.base import base_of
from volid.compensation.grids.builder import build_grids
from volid.compensation.grids.linear import linear_grid
from volid.compensation.grids.request import GridRequest
from volid.compensation.grids.rotary import rotary_grids
from volid.compensation.types import GRID, TYPES
from volid.exceptions import InputError, NotDeterminedError

LAYOUTS = ("tilting table", "fork head")
WITH_GRID = [name for name, t in TYPES.items() if GRID in t.forms]
SECOND_ORDER = (
    5e-5  # mm, rad: products of the errors of `machine_and_solution`, some 100 µrad, with lever arms of up to a metre
)


def both_ways(solution, name, **options):
    """The grids of a type with and without uncertainty."""
    base = options.pop("base", base_of(solution, TOOL, functions=("EAX", "EXX", "EXC", "EAC")))
    request = GridRequest(TYPES[name], base, points=3, **options)
    return build_grids(solution, request), build_grids(solution, replace(request, uncertainty=False))


def assert_same_values(with_u, without):
    assert [(g.type, g.side) for g in with_u] == [(g.type, g.side) for g in without] and with_u
    for a, b in zip(with_u, without, strict=True):
        np.testing.assert_array_equal(a.values, b.values)
        assert np.isfinite(a.values[:, :3]).all() and np.isfinite(a.u[:, :3]).all() and np.isnan(b.u).all()


@pytest.fixture(scope="module", params=LAYOUTS)
def solution(request):
    return machine_and_solution(request.param)[1]


@pytest.mark.parametrize("name", WITH_GRID)
def test_values_are_the_same_without_uncertainty(solution, name):
    assert_same_values(*both_ways(solution, name))


@pytest.mark.parametrize("name", ["L-VOL", "R-VOL", "R-VOL+"])
def test_also_in_an_aligned_frame(solution, name):
    assert_same_values(*both_ways(solution, name, base=aligned_to_spindle(solution, base_of(solution, TOOL))))


@pytest.mark.parametrize("name", ["L-VOL", "L-POS"])
def test_also_with_a_stated_zero(solution, name):
    with_u, without = both_ways(solution, name, zero={"X": 0.0, "Y": 0.0, "Z": 150.0})
    assert_same_values(with_u, without)
    middle = np.flatnonzero((with_u[0].positions == [0.0, 0.0, 150.0]).all(axis=1))
    assert len(middle) == 1
    np.testing.assert_allclose(with_u[0].values[middle, :3], 0.0, atol=1e-15)  # mm: rounding of two sums


@pytest.mark.parametrize(
    ("name", "function"), [("L-VOL", "EC0Y"), ("L-ANG", "EBX"), ("R-VOL", "EB0A"), ("FOR", "EB0A")]
)
@pytest.mark.parametrize("evaluation", [None, "linearised"])
def test_what_is_not_determined_is_blank_either_way(name, function, evaluation):
    _, solution = machine_and_solution("tilting table")
    column = np.zeros((solution.model.n_parameters, 1))
    part = "location" if "0" in function else "mean"
    column[solution.model.by_name[function, part].parameters] = 1e-3
    solution = replace(solution, null_space=column, statements=(f"{function}: of a test.",))
    outcomes = []
    request = GridRequest(TYPES[name], base_of(solution, TOOL), points=3, evaluation=evaluation)
    for one in (request, replace(request, uncertainty=False)):
        try:
            outcomes.append([g.values for g in build_grids(solution, one)])
        except NotDeterminedError as error:  # both ways must end alike
            outcomes.append([str(error)])
    assert len(outcomes[0]) == len(outcomes[1])
    for a, b in zip(*outcomes, strict=True):
        np.testing.assert_array_equal(a, b)
    refused = isinstance(outcomes[0][0], str)
    assert refused or any(np.isnan(values).any() for values in outcomes[0])


def test_exact_and_linearised_differ_by_products_of_errors_alone(solution):
    base = base_of(solution, TOOL)
    for name in ("L-VOL", "R-VOL"):
        exact = build_grids(solution, GridRequest(TYPES[name], base, points=3, evaluation="exact"))
        linear = build_grids(solution, GridRequest(TYPES[name], base, points=3, evaluation="linearised"))
        for a, b in zip(exact, linear, strict=True):
            assert 0.0 < np.abs(a.values - b.values).max() < SECOND_ORDER < 0.02 * np.abs(a.values).max()


def test_grids_of_the_public_functions_are_those_of_the_builder(solution):
    base = base_of(solution, TOOL)
    (linear,) = build_grids(solution, GridRequest(TYPES["L-VOL"], base, points=3, uncertainty=False))
    np.testing.assert_array_equal(linear_grid(solution, points=3, tool=TOOL).values, linear.values)
    rotary = build_grids(solution, GridRequest(TYPES["R-VOL"], base, points=3, uncertainty=False))
    for a, b in zip(rotary_grids(solution, points=3), rotary, strict=True):
        assert a.side == b.side
        np.testing.assert_array_equal(a.values, b.values)


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("L-POS", {"evaluation": "exact"}, "'exact' exists for L-VOL, .* L-POS as asked for is evaluated 'linearised'"),
        ("L-VOL", {"evaluation": "exact", "zero": {"X": 0.0}}, "without a stated zero"),
        ("L-VOL", {"evaluation": "quick"}, "evaluation 'quick'; expected 'exact' or 'linearised'"),
        ("R-POS", {}, "R-POS has no grid"),
    ],
)
def test_evaluations_that_do_not_exist_are_refused(solution, name, options, message):
    with pytest.raises(InputError, match=message):
        GridRequest(TYPES[name], base_of(solution, TOOL), **options)
