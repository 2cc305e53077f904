"""What is said where points of an artefact do not lie as calibrated, and where sets contradict each other."""

from dataclasses import replace

import numpy as np
import pytest
from exact_chain import ExactMachine
from support.machines import volid_machine

from volid.campaign import Campaign
from volid.exceptions import InputError
from volid.fitting.equations.problem import build_problem
from volid.fitting.fit import fit
from volid.model.error_functions import motion_names
from volid.model.error_model import build_model
from volid.observations.artefact_places import places_of
from volid.planning.ball_plate import Placing, ball_plate, plate_plan
from volid.plausibility.checks import check_campaign

MACHINE = volid_machine(ExactMachine("w b X Y Z t", {"X": (0.0, 600.0), "Y": (0.0, 500.0), "Z": (-400.0, 0.0)}))
TOOL = [[0.0, 0.0, -150.0]]


def measured(points=None) -> Campaign:
    """The plate as a machine without errors finds it; or another artefact with some depth."""
    if points is None:
        plan = ball_plate(MACHINE, TOOL)
    else:
        place = Placing("1", (300.0, 250.0, -350.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
        plan = plate_plan(MACHINE, points, [place], TOOL, u=5e-4)
    (s,) = plan.sets
    return replace(plan, sets=(replace(s, readings=np.zeros_like(s.readings), source="plate.csv"),))


def changed(campaign: Campaign, **what) -> Campaign:
    (s,) = campaign.sets
    options = s.options | what.pop("options", {})
    labels = s.labels | what.pop("labels", {})
    return replace(campaign, sets=(replace(s, options=options, labels=labels, **what),))


def with_points(campaign: Campaign, factor) -> Campaign:
    points = campaign.sets[0].options["points"]["plate"]
    rows = {n: [*(np.array(r[:3]) * factor).tolist(), *r[3:]] for n, r in points.items()}
    return changed(campaign, options={"points": {"plate": rows}})


def exchanged(values, i, j):
    values = values.copy()
    values[[i, j]] = values[[j, i]]
    return values


CUBE = {f"P{i}{j}{k}": [200.0 * i, 150.0 * j, 90.0 * k, 0.0] for i in range(2) for j in range(2) for k in range(2)}
CUBE["P000"] = [10.0, -20.0, 5.0, 0.0]


def slips():
    """A mistake, and what names it."""
    plate, cube = measured(), measured(CUBE)
    (s,), (c,) = plate.sets, cube.sets
    yield (
        "metres",
        with_points(plate, 1e-3),
        "placement 'flat low' of artefact 'plate': the calibrated coordinates seem to be in metres",
    )
    yield "inches", with_points(plate, 1 / 25.4), "the calibrated coordinates seem to be in inches; expected mm"
    yield (
        "left-handed",
        with_points(cube, [1.0, -1.0, 1.0]),
        "the calibrated coordinates are left-handed; negate one of",
    )
    rng = np.random.default_rng(1)
    yield (
        "readings in µm",
        changed(plate, readings=rng.normal(scale=10.0, size=s.readings.shape)),
        "the readings x, y, z seem to be in micrometres; expected mm",
    )
    yield (
        "two names",
        changed(plate, labels={"point": exchanged(s.labels["point"], 30, 41)}),
        r"row 31 \(point 'B2'\) and plate.csv, row 42 \(point 'D2'\): the points seem to be exchanged|"
        r"row 31 .* and plate.csv, row 42 .*: the points seem to be exchanged",
    )
    wrong = s.labels["point"].copy()
    wrong[60] = "E5"
    yield (
        "one name",
        changed(plate, labels={"point": wrong}),
        r"row 61 \(point 'E5'\): this is not the place of that point",
    )
    yield (
        "two placements",
        changed(
            plate,
            labels={"placement": np.where(s.labels["placement"] == "flat high", "flat low", s.labels["placement"])},
        ),
        r"the artefact stands elsewhere from plate.csv, row 26 \(point 'A1'\) on; give that placement another name",
    )
    lost = c.positions + rng.normal(scale=20.0, size=c.positions.shape)
    yield (
        "something else",
        changed(cube, positions=lost),
        r"the points lie [\d.]+ mm \(root mean square\) off the calibrated ones",
    )
    strange = s.labels["point"].copy()
    strange[3] = "A9"
    yield (
        "no such point",
        changed(plate, labels={"point": strange}),
        r"row 4: point 'A9' is not among the 25 calibrated points",
    )


@pytest.mark.parametrize(("campaign", "said"), [pytest.param(c, w, id=n) for n, c, w in slips()])
def test_the_mistake_is_named(campaign, said):
    with pytest.raises(InputError, match=said):
        (s,) = campaign.sets
        from volid.observations import KINDS

        KINDS[s.kind].check(s)
        check_campaign(campaign)


def test_nothing_is_said_where_nothing_is_wrong():
    assert check_campaign(measured()) == () and check_campaign(measured(CUBE)) == ()


def test_large_errors_are_taken_where_that_is_said():
    (s,) = measured(CUBE).sets
    lost = s.positions * np.linspace(1.0, 1.2, len(s))[:, None]
    campaign = changed(measured(CUBE), positions=lost, options={"large_errors": True})
    assert isinstance(check_campaign(campaign), tuple)


# ------------------------------------------------------------------------------------------------- several sets


def two_sets(**second) -> Campaign:
    (s,) = measured().sets
    half = len(s) // 2
    a, b = s.rows_of(np.arange(half)), s.rows_of(np.arange(half, len(s)))
    b = replace(b, name="second", options=b.options | second.pop("options", {}), **second)
    return replace(measured(), sets=(a, b))


def nuisance_of(campaign: Campaign):
    model = build_model(campaign.machine, {n: (1,) for n in motion_names(campaign.machine)})
    return build_problem(campaign, model).nuisance


def test_an_artefact_of_one_name_is_one_artefact_in_all_sets():
    whole, parts = nuisance_of(measured()), nuisance_of(two_sets())
    assert {e.key for e in whole} == {e.key for e in parts} and len(whole) == len(parts)


@pytest.mark.slow
def test_the_same_answer_when_a_set_is_split():
    machine = volid_machine(
        ExactMachine("w b X Y Z t", {"X": (0.0, 600.0), "Y": (0.0, 500.0), "Z": (-400.0, 0.0)}),
        '[model]\nsegments = 1\n[model.functions]\n"E?0S" = false\n',
    )
    rng = np.random.default_rng(5)
    (s,) = measured().sets
    noisy = replace(s, positions=s.positions + 5e-4 * rng.normal(size=s.positions.shape))
    numbers = rng.permutation(len(s))  # rows of every placement in both
    halves = (noisy.rows_of(numbers[:60]), replace(noisy.rows_of(numbers[60:]), name="second"))
    one, two = (fit(Campaign(machine, (), sets)) for sets in ((noisy,), halves))
    # the iteration stops at some 0.01 nm
    np.testing.assert_allclose(np.asarray(two.parameters), np.asarray(one.parameters), rtol=0, atol=1e-7)
    np.testing.assert_allclose(
        np.diag(two.parameter_covariance), np.diag(one.parameter_covariance), rtol=1e-5, atol=1e-20
    )


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"scale_u": 1e-6}, "u of 'scale of artefact plate' is 1e-06 here and 5e-07 in another set"),
        ({"body": "X"}, "stands on another body than in set"),
        ({"body": "table"}, "body is 'table'; expected what the artefact stands on, one of workpiece, bed, X, Y, Z"),
    ],
)
def test_sets_that_contradict_each_other_are_named(options, said):
    (s,) = measured().sets
    both = replace(s, name="second", options=s.options | options)
    with pytest.raises(InputError, match=said):
        nuisance_of(replace(measured(), sets=(s, both)))


def test_other_points_of_one_artefact_are_named():
    (s,) = measured().sets
    points = {"plate": {n: [r[0] + 0.01, *r[1:]] for n, r in s.options["points"]["plate"].items()}}
    with pytest.raises(InputError, match="artefact 'plate' has other calibrated points than in set 'plate'"):
        nuisance_of(replace(measured(), sets=(s, replace(s, name="second", options=s.options | {"points": points}))))


def test_an_artefact_without_a_name_belongs_to_its_set():
    (s,) = measured().sets
    unnamed = replace(
        s,
        labels=s.labels | {"artefact": np.full(len(s), "1")},
        options=s.options | {"points": {"1": s.options["points"]["plate"]}},
    )
    both = replace(measured(), sets=(unnamed, replace(unnamed, name="second")))
    assert len(nuisance_of(both)) == 2 * len(nuisance_of(measured()))
    assert len(places_of(both)) == 2 * len(places_of(measured()))


# --------------------------------------------------------------------------------------------------- options that are none


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"components": "XW"}, "components is 'XW'; expected the calibrated coordinates that count"),
        ({"components": "XX"}, "components is 'XX'"),
        ({"points": {}}, 'there are no calibrated points; expected points = "plate.csv"'),
        (
            {"points": {"plate": {"A1": [0.0, 1.0]}}},
            "row 2: point 'A2' is not among the 1 calibrated points|point 'A1' of",
        ),
        (
            {"points": {"disc": {"A1": [0.0, 1.0, 2.0]}}},
            "row 1: artefact 'plate' has no calibrated points; they are those of disc",
        ),
        (
            {"covariance": {"names": ["A1 x", "A1 x"], "values": [[1.0, 0.0], [0.0, 1.0]]}},
            "each once, and a square of numbers",
        ),
        ({"covariance": {"names": ["A1 x"], "values": [[1.0, 0.0]]}}, "each once, and a square of numbers"),
        ({"covariance": {"names": ["Q1 x"], "values": [[1.0]]}}, "'Q1 x' is no coordinate of a calibrated point"),
        (
            {"covariance": {"names": ["A1 x", "A1 y"], "values": [[1e-8, 1e-9], [0.0, 1e-8]]}},
            "A1 x, A1 y is 1e-09 and A1 y, A1 x is 0; expected a symmetric matrix",
        ),
        (
            {"covariance": {"names": ["A1 x", "A1 y"], "values": [[1e-8, 2e-8], [2e-8, 1e-8]]}},
            "its smallest eigenvalue is -1e-08 mm².*negative variance",
        ),
        (
            {"covariance": {"names": ["A1 x"], "values": [[1e-6]]}},
            r"uncertainty of A1 x is 0.001 mm there and 0.0003 mm in `points`",
        ),
    ],
)
def test_options_that_are_none_are_named(options, said):
    from volid.observations import KINDS

    (s,) = changed(measured(), options=options).sets
    with pytest.raises(InputError, match=said):
        KINDS[s.kind].check(s)
