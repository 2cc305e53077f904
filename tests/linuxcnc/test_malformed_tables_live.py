"""What LinuxCNC does in silence with tables that are not as it wants them."""

import pytest
from support.linuxcnc_simulator import Joint, Setup, needs_linuxcnc, run
from support.malformed_comp_files import CASES

pytestmark = [needs_linuxcnc, pytest.mark.slow]


@pytest.fixture(scope="module")
def simulated():
    """Corrections of all joints, each with another table, at the three positions, and what LinuxCNC said."""
    joints, files = [], {}
    for n, (letter, case) in enumerate(zip("XYZABCUVW", CASES.values(), strict=True)):
        lines = f"BACKLASH = 0.004\nCOMP_FILE_TYPE = 1\nCOMP_FILE = joint{n}.comp"
        joints.append(Joint(letter, -10, 300, 0.0, lines))
        files[f"joint{n}.comp"] = case.content
    places = (50, 150, 260)
    steps = [{"mdi": "G53 G0 " + " ".join(f"{j.letter}{x}" for j in joints)} for x in places]
    answer = run(Setup(joints, files), [{"home": True}, *steps], [f"joint.{n}.motor-pos-cmd" for n in range(9)])
    found = [[value - x for value in row] for row, x in zip(answer.rows[1:], places, strict=True)]
    return dict(zip(CASES, zip(*found, strict=True), strict=True)), answer


@pytest.mark.parametrize("name", CASES)
def test_linuxcnc_reads_it_so(simulated, name):
    assert simulated[0][name] == pytest.approx(CASES[name].found, abs=1e-6)


def test_only_rows_that_are_left_out_are_reported(simulated):
    said = "\n".join(simulated[1].messages)
    assert "joint 4: compensation values must increase" in said and "joint 5: too many compensation entries" in said
    assert all(f"joint {n}" not in said for n in (0, 1, 2, 3, 6))
