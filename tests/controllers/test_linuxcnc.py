"""Files of COMP_FILE."""

from support.control_cases import pitch, written


def test_actual_positions_as_the_manual_wants_them():
    files = written("linuxcnc", pitch())
    rows = [[float(v) for v in line.split()] for line in files["x.comp"].splitlines()]
    assert rows == [[0.0, 0.0, 0.002], [500.0, 500.010, 500.013], [1000.0, 999.996, 999.999]]
