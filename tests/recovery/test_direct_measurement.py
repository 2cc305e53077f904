"""Direct measurement, instrument by instrument on the exact chain: all 18 functions and three squareness errors within u.

The exact chain reads lasers, levels against gravity, and gauges against surfaces that stand turned, have an angle and a form; the
package never sees how. Everything passes through files.
"""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from exact_chain import Truth
from exact_chain.instruments import Instruments, Virtual, measure
from scipy.spatial.transform import Rotation
from scipy.stats import chi2, norm
from support.direct import Measured, measured, normalised, with_u, without
from support.machines import VERTICAL, exact_of, volid_machine
from support.places import MODELS

from volid.exceptions import InputError
from volid.fitting.diagnosis.statements import likely_reasons
from volid.fitting.fit import fit
from volid.io import load_campaign, read_machine, write_manifest
from volid.io.machines import format_machine, parse_machine
from volid.planning.direct import direct_plan

CROSS_BED = read_machine(MODELS / "wXZbYt_cross_bed.toml")
SQUARENESS = {"EC0Y", "EA0Z", "EB0Z"}
FUNCTIONS = {f"E{c}{axis}" for c in "XYZABC" for axis in "XYZ"}
CHANCE = 1e-3
ONLY_EC0Y = """
[model]
segments = 2
[model.functions]
"*" = false
EC0Y = true
"""
ELSEWHERE = {"X": 200.0, "Y": 300.0, "Z": 650.0}


def assert_recovered(found: Measured, **options) -> None:
    """Every function and squareness is there, and the truth within its u."""
    solution = fit(found.campaign, **options)
    assert not solution.adequacy.rejected and solution.statements == ()
    z = normalised(solution, found.truth)
    assert set(z) == FUNCTIONS | SQUARENESS
    # values of one function depend on each other: some three are independent, with the squareness errors 18 · 3 + 3
    mean_square = np.mean([np.mean(values**2) for values in z.values()])
    low, high = chi2.ppf([CHANCE / 2, 1 - CHANCE / 2], 57) / 57
    assert low < mean_square < high
    largest = norm.ppf(1 - CHANCE / 2 / 57)
    worst = max(z, key=lambda name: np.abs(z[name]).max())
    assert np.abs(z[worst]).max() < largest, worst


@pytest.mark.slow
def test_the_plan_determines_every_function_on_the_cross_bed_machine(tmp_path):
    """Lines that do not cross in the middle, a lateral tool vector; few positions."""
    plan = direct_plan(CROSS_BED, "Y", (30.0, -20.0, -180.0), ELSEWHERE, points=7)
    assert_recovered(measured(plan, tmp_path / "c", seed=11, waviness=0.5))


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_ten_steps_on_the_cross_bed_machine(seed, tmp_path):
    assert_recovered(measured(direct_plan(CROSS_BED, "Y"), tmp_path / "c", seed))


@pytest.mark.slow
def test_a_vertical_machine_with_its_axes_in_another_order(tmp_path):
    """Z vertical on the tool side: the levels change sides, the square stands along Z."""
    plan = direct_plan(
        volid_machine(VERTICAL), "Z", (0.0, 40.0, -120.0), {"X": 100.0, "Y": 300.0, "Z": -50.0}, points=13
    )
    assert_recovered(measured(plan, tmp_path / "c", seed=5))


@pytest.mark.slow
def test_part_of_the_travels_and_a_laser_twenty_times_worse(tmp_path):
    """Y and Z over 450 of 800 mm, where the errors' waves are as much shorter."""
    text = CROSS_BED.text.replace("travel = [0.0, 800.0]", "travel = [150.0, 600.0]")
    part = parse_machine(text, "machine.toml")
    plan = with_u(direct_plan(part, "Y", points=9), 20.0, "laser")
    assert [a.travel for a in part.axes].count((150.0, 600.0)) == 2
    found = measured(plan, tmp_path / "c", seed=8)
    assert_recovered(found)
    u = {f.name: f.u for f in fit(found.campaign).functions(points=2)}
    assert u["EXX"] > 0.003 and u["EZZ"] > 0.002 and u["EYX"] < 0.002


@pytest.mark.slow
def test_errors_of_three_millimetres_with_a_workshop_s_instruments(tmp_path):
    """200 times the errors of a good machine, u of 10 µm and 20 µrad: nothing is taken to first order where it must not be."""
    plan = with_u(direct_plan(CROSS_BED, "Y"), 20.0)
    found = measured(plan, tmp_path / "c", seed=2, scale=200.0)
    largest = max(np.abs(f(np.linspace(0, 800, 50))).max() for n, f in found.truth.functions.items() if n[1] in "XYZ")
    assert largest > 2.0
    with pytest.raises(InputError, match="large_errors = true"):
        fit(found.campaign)
    assert_recovered(found, accept_large_errors=True)


# ---------------------------------------------------------------------------------------------- the artefacts' own errors


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """All instruments on the cross-bed machine, few positions; edges and squares that are 2 µm off straight."""
    plan = direct_plan(CROSS_BED, "Y", at=ELSEWHERE, points=7, form_u=0.002)
    return measured(plan, tmp_path_factory.mktemp("direct") / "c", seed=21, waviness=0.5, form=0.002)


@pytest.fixture(scope="module")
def solution(whole):
    return fit(whole.campaign)


@pytest.mark.slow
def test_turning_a_straightedge_over_separates_its_form(whole, solution):
    """The found form agrees with the surface of the exact chain but for its straight line, within the readings' u."""
    edge = "edge XZ"
    form = {
        float(e.name.split(" at ")[1].split()[0]): float(v)
        for e, v in zip(solution.nuisance_table, solution.nuisance, strict=True)
        if e.key[:2] == ("form of artefact", edge)
    }
    s = np.array(sorted(form))
    true = whole.instruments.surface_form(edge, "edge", s)
    difference = np.array([form[at] for at in s]) - true
    left = difference - np.polyval(np.polyfit(s, difference, 1), s)
    assert np.ptp(true) > 0.003
    # four readings at each place in each placement: u/√4 of either mean, half of their difference
    assert np.sqrt(np.mean(left**2)) < 2.0 * 5e-4 / np.sqrt(8.0)


@pytest.mark.slow
def test_without_reversal_the_form_of_the_edge_stays_in_the_straightness(whole, solution):
    once = fit(without(whole.campaign, "edge XY turned over", "square XY"))
    u = [max(f.u for f in s.functions(points=7) if f.name == "EYX") for s in (solution, once)]
    assert u[1] > 2.0 * u[0]
    assert np.abs(normalised(once, whole.truth)["EYX"]).max() < 3.8


def test_a_square_that_leans_about_both_legs_seems_out_of_square_by_the_product(tmp_path):
    """2 and 3 mrad on a perfect machine: 6 µrad, by the slopes of both surfaces as SciPy turns them; `angle_u` is to hold it."""
    plan = direct_plan(CROSS_BED, "Y", points=3, form_u=0.0)
    plan = replace(plan, sets=tuple(s for s in plan.sets if s.name in ("levels", "square XY")))
    exact, instruments = exact_of(CROSS_BED), Instruments(np.random.default_rng(1), angle_u=1e-12)
    lean = Rotation.from_rotvec([2e-3, 3e-3, 0.0])
    instruments.drawn["placement", "square XY"] = lean.as_rotvec()
    write_manifest(plan, tmp_path / "c")
    measure(tmp_path / "c", Virtual(exact, Truth(), instruments), None)
    along_x, along_y = lean.apply([0.0, 1.0, 0.0]), lean.apply([1.0, 0.0, 0.0])  # normals of the legs
    expected = -(along_x[0] / along_x[1] + along_y[1] / along_y[0])
    assert abs(expected) == pytest.approx(6e-6, rel=1e-3)
    machine = parse_machine(CROSS_BED.text + ONLY_EC0Y, "machine.toml")
    (tmp_path / "c" / "machine.toml").write_text(format_machine(machine), encoding="utf-8")
    found = fit(load_campaign(tmp_path / "c" / "campaign.toml")).location("EC0Y")
    assert found.value == pytest.approx(expected, abs=2e-8)
    assert found.u < abs(expected)


# ------------------------------------------------------------------------------------------------ what is left unread

MISSING = {
    "levels": (("levels",), "no line reads EAX, ECX, EAY, ECY, EAZ, ECZ; levels in pairs"),
    "laser": (("laser",), "no line reads EXX, EYY, EZZ; linear optics give positioning"),
    "square": (("square XY",), "no artefact in one place has lines along X and Y; both legs of a square"),
    "level on the square": (
        ("level on",),
        "EBY: read by lines apart on artefacts whose tilts are unknown; a level on the",
    ),
    "square in two places": (("level on", "square here", "square there"), "no line reads EBY; levels in pairs"),
}


@pytest.mark.parametrize("name", MISSING)
def test_an_instrument_that_is_missing_is_named_with_what_it_would_give(name, whole):
    left_out, said = MISSING[name]
    campaign = without(whole.campaign, *left_out)
    assert re.search(said, "; ".join(likely_reasons(campaign)))
    assert not re.search(said, "; ".join(likely_reasons(whole.campaign)))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["levels", "square"])
def test_what_a_missing_instrument_leaves_open_is_stated_by_the_fit(name, whole):
    left_out, said = MISSING[name]
    found = fit(without(whole.campaign, *left_out))
    assert found.undetermined
    assert re.search(said, "; ".join(found.statements))


def test_a_level_on_a_square_that_no_line_reads_is_named(whole):
    with pytest.raises(
        InputError, match=r"level_on_the_square.csv, row 2: no line that is read on 'square here' tells"
    ):
        fit(without(whole.campaign, "square here"))
