"""Plans of ball plates: where the points lie on every machine, what is wrong with a plan, and the command."""

import numpy as np
import pytest
from exact_chain.plate import plate_at
from support.machines import exact_of
from support.places import MODELS

from volid.exceptions import InputError
from volid.io import load_campaign, read_machine
from volid.planning.ball_plate import PLACES, Placing, ball_plate, plate_plan

TOOLS = [[0.0, 0.0, -150.0], [40.0, 0.0, -180.0], [0.0, 30.0, -120.0]]
MACHINE = read_machine(MODELS / "wXYbZt_vertical.toml")
ROOMY = [f for f in sorted(MODELS.glob("*.toml")) if {"X", "Y", "Z"} <= set(read_machine(f).letters)]


@pytest.mark.parametrize("file", ROOMY, ids=lambda f: f.stem)
def test_points_lie_on_the_plate_within_the_travels_on_every_machine(file):
    machine = read_machine(file)
    exact, plan = exact_of(machine), ball_plate(machine, TOOLS, (4, 3))
    (s,) = plan.sets
    assert len(s) == 4 * 12 * 3 and plan.warnings == ()
    low, high = np.array([a.travel for a in machine.axes]).T
    assert (s.positions >= low - 1e-6).all() and (s.positions <= high + 1e-6).all()
    points = s.options["points"]["plate"]
    xyz = np.array([points[p][:3] for p in s.labels["point"]])
    for name, (x, y) in PLACES.items():
        for tool in TOOLS:
            rows = (s.labels["placement"] == name) & (s.tool == tool).all(axis=1)
            found = exact.functional_point(s.positions[rows], s.tool[rows])
            expected = plate_at(xyz[rows], found.mean(axis=0), x, y)
            np.testing.assert_allclose(found, expected, rtol=0, atol=2e-6)  # positions are rounded to 1e-6
    middles = {n: exact.functional_point(s.positions, s.tool)[s.labels["placement"] == n].mean(axis=0) for n in PLACES}
    assert middles["flat high"][2] - middles["flat low"][2] > 0.2 * machine.axis("Z").length - 60.0


def test_positions_of_the_four_places_lie_between_each_other():
    (s,) = ball_plate(MACHINE).sets
    levels = [len(np.unique(np.round(q, 3))) for q in s.positions.T]
    assert min(levels) > 8, "five balls, but more positions of every axis"


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"length": 900.0}, "`length` is 900 mm; expected more than 0 and at most"),
        ({"length": -1.0}, "`length` is -1 mm"),
        ({"points": (1, 5)}, "`points=1`: expected a whole number from 2"),
        ({"u": 0.0}, "`u"),
        ({"scale_u": -1e-6}, "`scale_u=-1e-06`: expected a finite number >= 0"),
        ({"scale_u": np.nan}, "`scale_u=nan`: expected a finite number"),
    ],
)
def test_wrong_plans_are_named(change, said):
    with pytest.raises(InputError, match=said):
        ball_plate(MACHINE, **change)


def test_directions_and_places_that_are_none_are_named():
    beam = {"B1": [0.0, 0.0, 0.0], "B2": [100.0, 0.0, 0.0]}
    skewed = Placing("askew", (300.0, 200.0, -300.0), (1.0, 0.0, 0.0), (0.5, 1.0, 0.0))
    with pytest.raises(InputError, match=r"placement 'askew': x .* are not at right angles"):
        plate_plan(MACHINE, beam, [skewed], TOOLS, u=5e-4)
    far = Placing("far", (9000.0, 200.0, -300.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    with pytest.raises(InputError, match="placement 'far': no position lies within the travels"):
        plate_plan(MACHINE, beam, [far], TOOLS, u=5e-4)


def test_a_machine_without_an_axis_is_named():
    machine = read_machine(MODELS / "wYXbZt_vertical.toml")
    axes = tuple(a for a in machine.axes if a.letter != "Z")
    with pytest.raises(InputError, match="has no axis Z; a ball plate needs X, Y and Z"):
        ball_plate(type(machine)(machine.name, "w Y' X' b t", axes))


@pytest.mark.slow
def test_the_command_writes_a_plan_that_is_simulated_and_fitted(tmp_path, capsys):
    from volid.cli import main

    plan, campaign, solution = (str(tmp_path / n) for n in ("plan.toml", "c.h5", "s.h5"))
    model = str(MODELS / "wXYbZt_vertical.toml")
    assert main(["plan", model, "ball-plate", "--points", "3,3", "--tool", "0,0,-150", "-o", plan]) == 0
    assert {s.kind for s in load_campaign(plan, plan=True).sets} == {"artefact"}
    assert (tmp_path / "plan.plate.points.csv").exists()
    assert main(["simulate", model, "--plan", plan, "-o", campaign, "--seed", "2"]) == 0
    assert main(["fit", campaign, "-o", solution]) == 1, "not everything is determined by one tool vector"
    assert "NOT DETERMINED" in capsys.readouterr().out
