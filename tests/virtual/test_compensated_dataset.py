"""The dataset of a compensated machine, computed by the exact chain and its control, against `volid simulate` with its tables."""

import importlib.util
from functools import cache

import numpy as np
import pytest
from exact_chain import ExactControl
from support.drives import both_truths
from support.places import DATASETS

from volid.cli import main
from volid.io import load_campaign
from volid.io.truths import write_truth

FOLDER = DATASETS / "compensated_machine"
CHANCE = 4.5  # standard uncertainties: some 250 readings of each state


@cache
def make():
    spec = importlib.util.spec_from_file_location("make_compensated", FOLDER / "make.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def lines_of(s):
    """Rows that share an unknown zero, as numbers (m,)."""
    if s.kind == "distance":
        return np.zeros(len(s), dtype=int)
    return np.unique(np.char.add(s.labels["line"], s.labels["component"]), return_inverse=True)[1]


def centred(values, lines):
    return values - np.array([values[lines == k].mean() for k in range(lines.max() + 1)])[lines]


@pytest.fixture(scope="module")
def states():
    return {
        state: load_campaign(FOLDER / f"{name}.toml") for state, name in (("before", "before"), ("after", "campaign"))
    }


@pytest.mark.parametrize("state", ["before", "after"])
def test_the_command_reads_what_the_exact_instruments_read(state, states, tmp_path):
    given, (_, truth) = states[state], make().virtual_machine()
    write_truth(both_truths(given.machine, truth), tmp_path / "truth.h5")
    plan = FOLDER / "before.toml"  # the same rows
    command = ["simulate", FOLDER / "machine.toml", "--plan", plan, "--truth", tmp_path / "truth.h5"]
    if state == "after":
        files = [FOLDER / name for name in make().tables(*make().virtual_machine())]
        command += ["--compensation", *files, "--control-tool", "0,0,-150"]
    assert main([str(c) for c in (*command, "-o", tmp_path / "again.h5")]) == 0
    for s, again in zip(given.sets, load_campaign(tmp_path / "again.h5").sets, strict=True):
        lines = lines_of(s)
        difference = (
            s.readings[:, 0] - again.readings[:, 0]
        )  # noise of both, and zeros of the lines or the bar's length
        z = centred(difference, lines) / (s.u[:, 0] * np.sqrt(2.0))
        assert np.abs(z).max() < CHANCE, s.name
        assert 0.7 < np.sqrt(np.mean(z**2)) < 1.3, s.name


def test_levels_see_the_same_rotations_before_and_after(states):
    before, after = (states[s].sets[0] for s in ("before", "after"))
    lines = lines_of(before)
    first, second = (centred(s.readings[:, 0], lines) for s in (before, after))
    assert np.ptp(first) > 30e-6
    z = (second - first) / (np.sqrt(2.0) * before.u[:, 0])
    assert 0.8 < np.sqrt(np.mean(z**2)) < 1.2


def form(values):
    """Distances along the circle without the bar's length and its centre, which nobody knows (least-squares circle) [mm]."""
    angle = np.deg2rad(np.arange(0.0, 360.0, make().DEGREES))
    circle = np.stack([np.ones_like(angle), np.cos(angle), np.sin(angle)], axis=1)
    return values - circle @ np.linalg.lstsq(circle, values, rcond=None)[0]


def test_the_bar_sees_rotation_times_offset_where_the_control_does_not_know_it(states):
    module, (machine, truth) = make(), make().virtual_machine()
    sets = {(s.name, state): s for state in states for s in states[state].sets}
    size = {key: np.ptp(form(s.readings[:, 0])) for key, s in sets.items() if key[0].startswith("bar")}
    assert size["bar told", "after"] < 0.1 * size["bar told", "before"]
    assert size["bar untold", "after"] > 2.0 * size["bar told", "after"]
    s = sets["bar untold", "after"]
    q = s.positions[:, [states["after"].machine.letters.index(a) for a in machine.axes]]
    along = (machine.functional_point(q, s.tool) - np.array(module.CENTRE)) / module.RADIUS
    rotation = machine.deviation(q, s.tool, truth)[:, 3:]
    offset = np.subtract(module.OFFSETS["untold"], module.TOLD)
    expected = form(np.einsum("mi,mi->m", along, np.cross(rotation, offset)))
    left = form(s.readings[:, 0]) - expected
    assert np.ptp(expected) > 0.004
    # the bar's u is 0.5 µm; what the tables leave by their rounding and steps is below it
    assert np.sqrt(np.mean(left**2)) < 1.3 * 5e-4
    assert np.sqrt(np.mean(form(s.readings[:, 0]) ** 2)) > 2.0 * np.sqrt(np.mean(left**2))


def test_the_mandrel_sees_the_spindle_against_the_compensated_z(states):
    """Tilt of the spindle along the tool vector; the rotations of Z, which the control corrects for its own tool alone; and X and
    Y, which rest, standing on either side of their reversal as they were corrected last."""
    module, (machine, truth) = make(), make().virtual_machine()
    files = [FOLDER / name for name in module.tables(machine, truth)]
    rows = module.programme(machine)["mandrel"]
    control = ExactControl.of(machine, files, tool=np.array(module.TOLD))
    way = control.arrivals(rows.q, control.command(rows.q, rows.tool, rows.direction), rows.direction)
    values, t = states["after"].sets[-1].readings[:, 0], rows.tool[:, 2]
    for component, sign, about in (("X", 1.0, "B"), ("Y", -1.0, "A")):
        here, i = rows.labels["component"] == component, machine.column(component)
        tilt, pitch = truth.constants[f"E{about}0S"], truth.functions[f"E{about}Z"](rows.q[here, machine.column("Z")])
        lost = truth.reversal[f"E{component}{component}"](rows.q[here, i]) / 2 * way[here, i]
        expected = sign * (tilt * t[here] + pitch * (t[here] - module.TOLD[2])) + lost
        assert np.std(values[here] - expected) < 1.3 * 3e-4  # mm: the indicator's u; the tables are rounded to 0.1 µm
        assert np.std(values[here] - expected + lost) > 3.0 * 3e-4
        slope = np.polyfit(t[here], values[here] - lost, 1)[0]
        assert abs(sign * slope - tilt) < 0.1 * abs(tilt)
