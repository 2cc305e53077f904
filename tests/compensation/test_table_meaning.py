"""What a table of a rotary axis says of itself: location or error motion, and how the axis average line stands to its numbers."""

import re

import numpy as np
import pytest
from support.axis_lines import line_error
from support.machines import STRUCTURES, exact_machine, resolved
from support.made_up import made_up, truth_of

from volid.compensation.base import base_of
from volid.compensation.superposition import add_tables
from volid.compensation.tables.by_function import error_tables
from volid.compensation.types import TYPES
from volid.fitting.location_errors import location_errors
from volid.io.tables import TableForm, table_header, written_values

CONSTANTS_ONLY = '"E??" = false\n"E?0[XYZS]" = false'
TOOL = (0.0, 0.0, -150.0)


def made(layout, functions=CONSTANTS_ONLY):
    exact = exact_machine(STRUCTURES[layout])
    solution = made_up(resolved(exact, functions, segments=4), seed=6)
    return exact, solution, base_of(solution, TOOL)


def meaning(table, solution, **form):
    return table_header(table, TableForm(**form), solution)["meaning"]


@pytest.mark.parametrize("layout", ["tilting table C'A'", "table and head", "fork head CB"])
def test_location_tables_say_location_and_how_the_line_stands(layout):
    exact, solution, base = made(layout)
    truth = truth_of(solution)
    rotary = [a for a in exact.axes if a in "ABC"]
    known = {row.symbol: row.line for row in location_errors(solution)}
    for a in rotary:
        same_side = [b for b in rotary if exact.primed[b] == exact.primed[a] and b != a]
        for b in same_side:
            known |= {row.symbol: row.line for row in location_errors(solution, b)}
    tables = error_tables(solution, [TYPES["R-POR"]], base)
    assert len(tables) == 4 * len(rotary)
    for table in tables:
        said = meaning(table, solution)
        assert "error motion" not in said and said.startswith(("error of the position", "error of the orientation"))
        assert "(parameter, tool relative to workpiece; " in said
        symbol, minus = re.search(r"axis average line has (\S+) = (minus )?the error value\)", said).groups()
        values = written_values(table, TableForm(errors=True))[1][:, 0]
        assert np.ptp(values) == 0.0 and abs(values[0]) > 1e-6
        assert known[symbol] == pytest.approx(-values[0] if minus else values[0], rel=1e-9)
        if "(" not in symbol:  # on the machine itself: where the exact line stands
            line = line_error(exact, truth, table.axis)["XYZABC".index(symbol[1])]
            assert line == pytest.approx(-values[0] if minus else values[0], abs=1e-8 if symbol[1] in "ABC" else 2e-6)
        # and what is written as compensation value is minus the error value
        assert written_values(table, TableForm())[1][0, 0] == pytest.approx(-values[0], abs=1e-9)


def test_tables_with_both_say_both_and_others_are_as_before():
    _, solution, base = made("tilting table C'A'", '"E?[XYZ]" = false\n"E?0[XYZS]" = false')
    both = {t.function: meaning(t, solution) for t in error_tables(solution, [TYPES["R-VOL"]], base)}
    assert both["EXC"].startswith(
        "radial error motion of C in X direction, and error of the position of C in X direction ("
    )
    assert both["EBA"].startswith("tilt error motion of A about Y, and error of the orientation of A about Y (")
    assert both["EXC"].endswith("the axis average line has EX(0A)C = minus the mean error value)")
    assert both["EZC"] == "axial error motion of C" and both["EXA"] == "axial error motion of A"
    assert both["ECC"] == "angular positioning of C"
    radial = {t.function: meaning(t, solution) for t in error_tables(solution, [TYPES["R-RAX"]], base)}
    assert radial["EXC"] == "radial error motion of C in X direction"


def test_a_location_table_on_top_of_another_one_stays_one():
    _, solution, base = made("tilting table C'A'")
    tables = error_tables(solution, [TYPES["R-POR"]], base)
    for table in add_tables(tables, list(tables)):
        assert table.type == "R-POR on top of R-POR"
        assert meaning(table, solution).startswith("error of the ")
