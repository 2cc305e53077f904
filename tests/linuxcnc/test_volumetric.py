"""A machine measured, fitted and compensated by a grid that LinuxCNC applies through HAL: what remains is what was predicted."""

from typing import NamedTuple

import numpy as np
import pytest
from support.linuxcnc_simulator import Joint, Setup, needs_compiler, needs_linuxcnc, run
from support.places import ROOT
from support.volumetric import STEP, TRAVEL, VirtualMachine, corrections, measured, places, predicted, rms

import volid
from volid.cli import main
from volid.compensation.tables.sampling import Sampling
from volid.fitting.prediction.largest import Places

pytestmark = [needs_linuxcnc, needs_compiler, pytest.mark.slow]

COMPONENT = ROOT / "examples" / "linuxcnc" / "volid_grid.comp"
SEED, POINTS = 0, 30
RMS = 2  # of the quantities of a prediction
DRIVES = [f"drive.{a}.out" for a in "xyz"]
CORRECTIONS = [f"volid-l-vol.d-{a}" for a in "xyz"]
SHOWN = [f"joint.{n}.pos-fb" for n in range(3)]
# drives that go where they are told; what happens in each servo period is kept
HAL = """source volid_grid.hal
setp volid-l-vol.fade-time 0.02
loadrt sum2 names=drive.x,drive.y,drive.z
addf drive.x servo-thread
addf drive.y servo-thread
addf drive.z servo-thread
net volid-x-motor => drive.x.in0
net volid-y-motor => drive.y.in0
net volid-z-motor => drive.z.in0
net volid-x-drive <= drive.x.out
net volid-y-drive <= drive.y.out
net volid-z-drive <= drive.z.out
loadrt sampler depth=4000 cfg=fffffff
addf sampler.0 servo-thread
setp sampler.0.enable 0
net volid-x-position => sampler.0.pin.0
net volid-y-position => sampler.0.pin.1
net volid-z-position => sampler.0.pin.2
net volid-x-drive => sampler.0.pin.3
net volid-y-drive => sampler.0.pin.4
net volid-z-drive => sampler.0.pin.5
net following joint.0.f-error => sampler.0.pin.6
loadusr halsampler -n 3000 path.txt
"""


class Live(NamedTuple):
    """The machine, the grid file, and what LinuxCNC did: positions X, Y, Z asked for, of the drives without and with the grid,
    corrections, positions shown with it, each (m, 3); each period of a path: asked for, drives, following error of X."""

    machine: VirtualMachine
    grid: str
    asked: np.ndarray
    before: np.ndarray
    after: np.ndarray
    added: np.ndarray
    shown: np.ndarray
    path: np.ndarray


@pytest.fixture(scope="module")
def live(tmp_path_factory) -> Live:
    folder = tmp_path_factory.mktemp("volumetric")
    machine = measured(folder / "campaign", SEED)
    machine.solution.save(folder / "solution.h5")
    asked = ["--cnc", "linuxcnc-hal", "--type", "L-VOL", "--step", f"{STEP:g}", "--tool", "0,0,-150"]
    assert main(["export", str(folder / "solution.h5"), *asked, "-o", str(folder / "control")]) == 0
    return driven(machine, {n: (folder / "control" / n).read_text() for n in ("l_vol.grid", "volid_grid.hal")})


def driven(machine: VirtualMachine, files) -> Live:
    asked = places(POINTS)
    joints = [Joint(a, low - 1.0, high + 1.0) for a, (low, high) in TRAVEL.items()]
    steps = [{"home": True}]
    for x, y, z in asked:
        steps.append({"set": {"volid-l-vol.enable": 1}, "mdi": f"G53 G0 X{x} Y{y} Z{z}"})
        steps.append({"set": {"volid-l-vol.enable": 0}, "wait": 0.1})
    steps += [{"set": {"volid-l-vol.enable": 1}, "mdi": "G53 G0 X10 Y10 Z-240"}, {"set": {"sampler.0.enable": 1}}]
    steps += [{"mdi": "G53 G1 X390 Y280 Z-10 F12000"}, {"mdi": "G53 G1 X200 Y20 Z-200"}, {"wait": 1.5}]
    setup = Setup(
        joints,
        files={**files, "volid_grid.h": COMPONENT.with_suffix(".h").read_text()},
        hal=HAL,
        drives=False,
        components=[COMPONENT],
    )
    answer = run(setup, steps, [*DRIVES, *CORRECTIONS, *SHOWN], keep=["path.txt"])
    rows = np.array(answer.rows)[1 : 1 + 2 * POINTS]
    path = np.array([line.split() for line in answer.files["path.txt"].decode().splitlines()], float)
    on, off = rows[0::2], rows[1::2]
    return Live(machine, files["l_vol.grid"], asked, off[:, :3], on[:, :3], on[:, 3:6], on[:, 6:], path)


def test_drives_go_where_the_grid_says(live):
    np.testing.assert_allclose(live.before, live.asked, rtol=0, atol=1e-6)
    np.testing.assert_allclose(live.after, live.asked + corrections(live.grid)(live.asked), rtol=0, atol=1e-6)
    np.testing.assert_allclose(live.added, live.after - live.asked, rtol=0, atol=1e-6)


def test_linuxcnc_does_not_see_the_corrections(live):
    np.testing.assert_allclose(live.shown, live.asked, rtol=0, atol=1e-6)
    assert np.abs(live.path[:, 6]).max() == 0.0  # following error of X while moving, to 1e-6 mm


def test_what_remains_is_what_was_predicted(live):
    """Interpolation and fit; by the covariance the ratio has a standard deviation of 7 %."""
    machine, asked = live.machine, live.asked
    before, after = (machine.without_motion(machine.off(asked, q), asked) for q in (live.before, live.after))
    left = predicted(machine, asked, live.added)
    print(f"RMS {1e3 * rms(before):.3f} µm before, {1e3 * rms(after):.3f} µm after; predicted {1e3 * left.both:.3f} µm")
    print(f"interpolation {1e3 * left.interpolation:.3f} µm, fit {1e3 * left.fit:.3f} µm")
    assert rms(after) < 0.1 * rms(before)
    assert left.draws.std() < 0.08 * left.both and min(left.interpolation, left.fit) > 0.3 * left.both
    assert rms(after) == pytest.approx(left.both, rel=0.20)


def test_volid_forecasts_it_too(live):
    solution, q = live.machine.solution, live.machine.ordered(live.asked)
    base = volid.compensation_base(solution, (0.0, 0.0, -150.0))
    given = Places(q, np.zeros_like(q))
    found = volid.forecast(solution, [["L-VOL"]], base, places=given, grids=Sampling(step=STEP), repeatability=0.0)
    after = live.machine.without_motion(live.machine.off(live.asked, live.after), live.asked)
    assert rms(after) == pytest.approx(found.columns[1].predictions[0].value[RMS], rel=0.20)


def test_path_is_compensated_in_every_period(live):
    """Positions on a path at up to 200 mm/s, one per period; halsampler prints 1e-6 mm."""
    asked, drives = live.path[:, :3], live.path[:, 3:6]
    added, way = drives - asked, np.linalg.norm(np.diff(asked, axis=0), axis=1)
    assert (way > 0.19).sum() > 2000
    np.testing.assert_allclose(added, corrections(live.grid)(asked), rtol=0, atol=1.5e-6)
    assert (np.abs(np.diff(added, axis=0)).max(axis=1) <= steepest(live.grid) * way + 2e-6).all()
    machine = live.machine
    left = [np.linalg.norm(machine.without_motion(machine.off(asked, q), asked), axis=1) for q in (asked, drives)]
    jumps = np.linalg.norm(np.diff(added, axis=0), axis=1).max()
    print(
        f"path: largest {1e3 * left[0].max():.2f} µm before, {1e3 * left[1].max():.2f} µm after; jump {1e3 * jumps:.3f} µm"
    )
    assert rms(left[1][:, None]) < 0.15 * rms(left[0][:, None])


def steepest(grid: str) -> float:
    """Largest change of a correction per mm of way: the norm of its largest changes along X, Y and Z between neighbours."""
    table = corrections(grid)
    along = [np.diff(table.values, axis=i) / STEP for i in range(3)]
    return float(np.linalg.norm([np.abs(c).max() for c in along]))
