"""The simulator of the tests ends, whatever happens, and is started again as if nothing had been."""

import os
import shutil
import signal
import subprocess
import sys
import time

import pytest
from support.linuxcnc_simulator import LOCK, OWN_LOCK, Joint, LinuxCNCError, Setup, needs_linuxcnc, run, running

pytestmark = [needs_linuxcnc, pytest.mark.slow]
JOINTS = [Joint("X", -10, 1010), Joint("Y", -10, 610), Joint("Z", -510, 10)]
PINS = ["joint.0.motor-pos-cmd", "joint.1.motor-pos-cmd", "joint.2.motor-pos-cmd"]


def test_a_run_that_hangs_is_stopped():
    with pytest.raises(LinuxCNCError, match=r"(?s)or was stopped.*Starting LinuxCNC"):
        run(Setup(JOINTS), [{"home": True}, {"wait": 300}], PINS, stop_after=4.0)
    assert running() == [] and not OWN_LOCK.exists()


ORPHAN = """from test_simulator_stops import *
run(Setup(JOINTS), [{"home": True}, {"wait": 300}], PINS)"""


def test_linuxcnc_ends_when_the_tests_are_killed():
    paths = os.pathsep.join([*sys.path, os.path.dirname(__file__)])
    tests = subprocess.Popen([sys.executable, "-c", ORPHAN], env={**os.environ, "PYTHONPATH": paths})
    end = time.monotonic() + 30.0
    while "milltask" not in str(running()) and time.monotonic() < end:
        time.sleep(0.2)
    assert "milltask" in str(running())
    os.kill(tests.pid, signal.SIGKILL)
    tests.wait()
    while (running() or OWN_LOCK.exists()) and time.monotonic() < end:
        time.sleep(0.2)
    for task in LOCK.parent.glob("volid-linuxcnc-*/task.json"):
        if f'"owner": {tests.pid}' in task.read_text():  # nobody is left to remove its folder; others are in use
            shutil.rmtree(task.parent)
    assert running() == [] and not OWN_LOCK.exists()


def test_a_line_that_is_not_carried_out_is_told():
    with pytest.raises(LinuxCNCError, match=r"G53 G0 X5000.*limit"):
        run(Setup(JOINTS), [{"home": True}, {"mdi": "G53 G0 X5000"}], PINS, seconds=10)


def test_the_next_run_moves():
    steps = [{"home": True}, {"mdi": "G53 G0 X250 Y-5"}, {"mdi": "G53 G1 X1000 Z-500 F60000"}]
    rows = run(Setup(JOINTS), steps, PINS).rows
    assert rows[0] == [0.0, 0.0, 0.0]
    assert rows[1] + rows[2] == pytest.approx([250, -5, 0, 1000, -5, -500], abs=1e-6)
