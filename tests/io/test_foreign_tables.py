"""Tables of others in the layout of ISO/TR 16907 Table 1: what such a file does not say is asked for, never guessed."""

import numpy as np
import pytest

from volid.exceptions import InputError
from volid.io.table_reader import read_table

ROWS = "0,0\n90,0.01\n180,0\n"


def written(tmp_path, text):
    path = tmp_path / "table.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_rotary_positioning_in_degrees(tmp_path):
    found = read_table(written(tmp_path, f"# values: error\n# period: 360\nC,ECC [°]\n{ROWS}"))
    assert (found.type, found.applied, found.period) == ("R-POS", "the axis itself", 360.0)
    np.testing.assert_allclose(found.forward, np.deg2rad([0.0, 0.01, 0.0]), rtol=1e-12)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            f"# values: error\n# period: 360\nC,ECC\n{ROWS}",
            r"table.csv, header: ECC is a rotation without a unit; .* ECC \[°\]",
        ),
        (
            f"# values: error\nX,EAX(+),EAX(-) [µrad]\n{ROWS}".replace(",0\n", ",0,0\n").replace("1\n", "1,0\n"),
            r"EAX\(\+\) is a rotation",
        ),
        (f"# values: error\nC,ECC [°]\n{ROWS}", "period"),
        (f"# values: error\n# units: X mm; EXX µm\nX,EXX\n{ROWS}", "table.csv: units name 'µm'; EXX is read in mm"),
        (f"# values: error\n# units: X in; EXX in\nX,EXX\n{ROWS}", "units name 'in'; EXX is read in mm"),
        (f"# values: error\n# units: X mm; EXX rad\nX,EXX\n{ROWS}", "units name 'rad'; EXX is read in mm"),
        (
            f"# values: error\n# units: X mm; EAX degrees\nX,EAX [rad]\n{ROWS}",
            r"units name 'degrees'; EAX is read in rad: .* such as EAX \[degrees\]",
        ),
        (f"# values: error\n# period: 360\n# function: EXQ\nC,EXQ\n{ROWS}", "function: 'EXQ'"),
    ],
)
def test_what_nothing_tells_is_asked_for(tmp_path, text, message):
    with pytest.raises(InputError, match=message):
        read_table(written(tmp_path, text))


@pytest.mark.parametrize(("name", "type_"), [("EXX", "L-POS"), ("EYX", "L-STR")])
def test_lengths_of_linear_axes_are_mm(tmp_path, name, type_):
    found = read_table(written(tmp_path, f"# values: error\nX,{name}\n{ROWS}"))
    assert found.type == type_ and found.forward.tolist() == [0.0, 0.01, 0.0]


@pytest.mark.parametrize(
    ("units", "columns", "first"),
    [("X mm; EXX mm", "X,EXX", 0.01), ("X mm; EXX µm", "X,EXX [µm]", 1e-5), ("all lengths in mm", "X,EXX", 0.01)],
)
def test_units_that_are_those_of_the_columns_are_read(tmp_path, units, columns, first):
    found = read_table(written(tmp_path, f"# values: error\n# units: {units}\n{columns}\n{ROWS}"))
    np.testing.assert_allclose(found.forward, [0.0, first, 0.0], rtol=1e-12)
