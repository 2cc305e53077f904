"""LinuxCNC itself, in simulation, loads volid's files and moves the machine: motor commands are those that volid predicts."""

from support.linuxcnc_simulator import Joint, Setup, needs_linuxcnc, run

pytestmark = needs_linuxcnc


def test_simulator_moves_without_compensation():
    joints = [Joint("X", -10, 1010), Joint("Y", -10, 610), Joint("Z", -510, 10)]
    pins = [f"joint.{n}.motor-pos-cmd" for n in range(3)]
    steps = [{"home": True}, {"mdi": "G53 G0 X250 Y-5"}, {"mdi": "G53 G1 X1000 Z-500 F60000"}]
    rows = run(Setup(joints), steps, pins).rows
    assert rows[0] == [0.0, 0.0, 0.0]
    assert max(abs(a - b) for a, b in zip(rows[1] + rows[2], [250, -5, 0, 1000, -5, -500], strict=True)) < 1e-6
