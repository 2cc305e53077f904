"""The standard plan of every machine: round positions within the travels, stations outside what the tool sweeps."""

import numpy as np
import pytest
from support.machines import exact_of
from support.places import MODELS

from volid.io import load_campaign, read_machine
from volid.planning.standard import TOOLS, levels, standard_plan

FILES = sorted(MODELS.glob("*.toml"))
HEADS = ((0.0, 0.0, -80.0), (400.0, 0.0, -300.0), (0.0, -350.0, -250.0))  # mm: an angle head reaches far to the side


@pytest.mark.parametrize("tools", [TOOLS, HEADS], ids=["tools", "angle head"])
@pytest.mark.parametrize("file", FILES, ids=lambda f: f.stem)
def test_stations_stand_outside_and_positions_are_round(file, tools):
    machine = read_machine(file)
    plan = standard_plan(machine, 100, tools=tools)
    readings = plan.sets[0]
    swept = exact_of(machine).functional_point(readings.positions, readings.tool)  # of another implementation
    for station in plan.stations:
        place = np.array(station.position)
        beside = np.maximum(swept.min(axis=0) - place, place - swept.max(axis=0)).max()
        assert beside >= 100.0, f"{station.name} {station.position}"
        np.testing.assert_array_equal(place, np.round(place))
    low, high = np.array([a.travel for a in machine.axes]).T
    assert (readings.positions >= low).all() and (readings.positions <= high).all()
    np.testing.assert_allclose(
        readings.positions * 4, np.round(readings.positions * 4), atol=1e-9
    )  # quarters of mm, degrees
    assert plan.warnings == ()


@pytest.mark.parametrize(
    ("travel", "step"),
    [((0.0, 1000.0), 25.0), ((-300.0, 300.0), 15.0), ((0.0, 762.0), 20.0), ((-317.3, 201.7), 10.0), ((0.0, 25.4), 0.5)],
)
def test_levels_are_round_and_hold_the_ends(travel, step):
    axis = read_machine(MODELS / "wYXbZt_vertical.toml").axis("X")
    found = levels(type(axis)(**{**vars(axis), "travel": travel, "reference": travel[0]}))
    assert (found[0], found[-1]) == travel
    inner = found[1:-1]
    np.testing.assert_allclose(np.diff(inner), step, atol=1e-9)
    np.testing.assert_allclose(
        (inner - travel[0]) / step % 1 if travel[0] % step == 0 else inner / step % 1, 0.0, atol=1e-9
    )
    assert 0.5 * step < inner[0] - found[0] <= 1.5 * step and 0.5 * step < found[-1] - inner[-1] <= 1.5 * step


def test_tools_and_u_on_the_command_line(tmp_path, capsys):
    from volid.cli import main

    path = tmp_path / "p.toml"
    command = ["plan", str(MODELS / "wYXbZt_vertical.toml"), "--test", "standard", "--points", "30", "-o", str(path)]
    assert main([*command, "--tool", "0,0,-150", "--tool", "60,0,-200", "--tool", "0,60,-180", "--u", "0.001"]) == 0
    plan = load_campaign(path, plan=True)
    assert plan.tool_vectors().tolist() == [[0.0, 0.0, -150.0], [0.0, 60.0, -180.0], [60.0, 0.0, -200.0]]
    assert (plan.sets[0].u == 0.001).all() and len(plan.sets[0]) == 180
    for tools, words in (
        (["--tool", "0,0,-150"], "one tool vector does"),
        (["--tool", "0,0,-150", "--tool", "0,0,-250"], "on one line do"),
    ):
        assert main([*command, *tools, "--force"]) == 1
        assert f"{words} not determine all rotations" in capsys.readouterr().err
