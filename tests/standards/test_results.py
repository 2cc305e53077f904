"""Limits and verdicts of evaluations."""

import math

import pytest

from volid.backend.consent import accept_unusual
from volid.exceptions import InputError
from volid.io.evaluations.limits import judge_all
from volid.report.text.evaluations import evaluation_lines, unproved
from volid.standards.results import GUARD_BAND, LEFT_OUT, SIMPLE, Evaluation, Quantity, judged, withhold


def evaluations():
    first = Evaluation("ISO 230-2", "X", (Quantity("E", 0.0318, "mm", U=0.002), Quantity("A", 0.0342, "mm")))
    return [first, Evaluation("ISO 230-2", "Y", (Quantity("E", 0.0129, "mm"),))]


def judge(tmp_path, text):
    (tmp_path / "limits.toml").write_text(text)
    return judge_all(evaluations(), tmp_path / "limits.toml")


def test_a_limit_of_one_axis_stands_before_that_of_all(tmp_path):
    x, y = judge(tmp_path, "E = 0.020\n[X]\nE = 0.033\nA = 0.034\n")
    assert (x["E"].limit, x["E"].verdict) == (0.033, "undecided")  # 31.8 + 2 is above 33
    assert (x["A"].verdict, y["E"].verdict) == ("fail", "pass")


def test_simple_acceptance_compares_the_value_alone_where_the_limits_say_so(tmp_path):
    """31.8 ± 2 µm against 33 µm: undecided with the guard band, pass without; against 31 µm undecided, and fail."""
    for limit, with_guard, alone in (
        (0.033, "undecided", "pass"),
        (0.031, "undecided", "fail"),
        (0.028, "fail", "fail"),
    ):
        guarded, _ = judge(tmp_path, f"E = {limit}\n")
        named, _ = judge(tmp_path, f'rule = "guard band"\nE = {limit}\n')
        simple, _ = judge(tmp_path, f'rule = "simple"\nE = {limit}\n')
        assert (guarded["E"].verdict, named["E"].verdict, simple["E"].verdict) == (with_guard, with_guard, alone)
        assert simple["E"].U == 0.002


def test_the_rule_is_said_with_the_verdict(tmp_path):
    simple, _ = judge(tmp_path, 'rule = "simple"\nE = 0.033\n')
    assert "verdict by simple acceptance" in "\n".join(evaluation_lines(simple))
    guarded, _ = judge(tmp_path, "E = 0.033\n")
    assert "verdict by ISO 14253-1" in "\n".join(evaluation_lines(guarded))


def test_a_limit_of_a_form_holds_for_all_symbols_of_it_that_have_none_of_their_own(tmp_path):
    x, y = judge(tmp_path, '"[EA]" = 0.020\nE = 0.050\n')
    assert (x["E"].limit, x["A"].limit, y["E"].limit) == (0.050, 0.020, 0.050)


def test_what_is_not_determined_is_not_decided():
    found = judge_all(
        [Evaluation("ISO 230-1", "machine", (Quantity("V_X", math.nan, "mm", U=math.nan),))], {"V_X": 0.01}
    )
    assert found[0]["V_X"].verdict == "undecided"
    assert unproved(found) == ["machine: V_X is not determined, so that its limit of 10 µm is not judged"]


@pytest.mark.parametrize(
    ("value", "U", "unit", "limit", "rule", "said"),
    [
        (0.0445, 0.0005, "mm", 0.040, GUARD_BAND, "V = 44.5 µm (U 0.5 µm) exceeds 40 µm"),
        (0.0402, 0.0005, "mm", 0.040, GUARD_BAND, "V = 40.2 µm (U 0.5 µm) is within U of its limit of 40 µm, so"),
        (0.04002, 0.0, "mm", 0.040, GUARD_BAND, "V = 40.02 µm (U 0.00 µm) exceeds 40 µm"),  # 40.0 would not exceed 40
        (0.04002, 0.0005, "mm", 0.040, SIMPLE, "V = 40.02 µm (U 0.50 µm) exceeds 40 µm"),
        (-2.1e-5, 1e-6, "rad", 1.5e-5, GUARD_BAND, "V = -21.0 µrad (U 1.0 µrad) exceeds 15 µrad in size"),
        (0.0342, None, "mm", 0.034, GUARD_BAND, "V = 34.2 µm exceeds 34 µm"),
    ],
)
def test_what_is_not_proved_is_said_with_its_numbers(value, U, unit, limit, rule, said):
    found = judged(Evaluation("ISO 230-1", "machine", (Quantity("V", value, unit, U=U),)), {"V": limit}, rule)
    (sentence,) = unproved([found])
    assert sentence.startswith(f"machine: {said}") and (said.endswith("so") or sentence == f"machine: {said}")


def test_a_withheld_verdict_names_numbers_and_reason():
    found = judged(Evaluation("ISO 230-1", "machine", (Quantity("V_X", 0.0445, "mm", U=0.0005),)), {"V_X": 0.04})
    (sentence,) = unproved([withhold(found, {"V_X": LEFT_OUT})])
    assert sentence == (
        "machine: V_X = 44.5 µm (U 0.5 µm) is not judged by its limit of 40 µm: "
        "error motions that the model leaves out are not in its value"
    )


def test_one_limit_does_not_stand_for_lengths_and_rotations():
    """0.005 mm is a limit of EXX; the same number would let every EAX up to 5000 µrad pass."""
    both = Evaluation("ISO 230-1", "machine", (Quantity("EXX", 0.004, "mm"), Quantity("EAX", 0.004, "rad")))
    with pytest.raises(InputError, match=r"E\?X.*different units: EXX in mm, EAX in rad"):
        judge_all([both], {"E?X": 0.005})
    assert judge_all([both], {"E[XYZ]X": 0.005})[0]["EAX"].verdict == ""


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            'rule = "none"\nE = 0.02\n',
            'limits.toml: rule is "none"; expected the decision rule, one of guard band, simple',
        ),
        ('"Q*" = 0.02\n', r"limits.toml: Q\* is no quantity of this test; expected one of E, A"),
        ("[Z]\nE = 0.02\n", r"limits.toml: \[Z\] was not evaluated; expected one of X, Y"),
        ("[Y]\nA = 0.02\n", r"limits.toml: \[Y\] A is no quantity of this test; expected one of E"),
        ("R = 0.02\n", r"limits.toml: R is no quantity of this test; expected one of E, A"),
        ("E = -0.02\n", "E"),
        ('E = "small"\n', "E"),
    ],
)
def test_limits_of_what_was_not_evaluated_are_refused(tmp_path, text, message):
    with pytest.raises(InputError, match=message):
        judge(tmp_path, text)


@pytest.mark.parametrize(
    ("unit", "limit", "smaller"), [("mm", 20.0, "µm"), ("°", 5.0, "arcsec"), ("rad", 20.0, "µrad")]
)
def test_limits_in_a_smaller_unit_are_asked_about(tmp_path, unit, limit, smaller):
    """A limit of 20 µm written as 20 would let everything pass."""
    (tmp_path / "limits.toml").write_text(f"E = {limit}\n")
    found = [Evaluation("ISO 230-2", "X", (Quantity("E", 0.0318, unit),))]
    with pytest.raises(InputError, match=rf"limits.toml: E = {limit:g} .* Expected {unit}: is it in {smaller}[?,]"):
        judge_all(found, tmp_path / "limits.toml")
    with accept_unusual():
        assert judge_all(found, tmp_path / "limits.toml")[0]["E"].verdict == "pass"
