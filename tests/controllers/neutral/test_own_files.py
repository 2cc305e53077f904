"""Plain CSV and HDF5: every type, from a machine with rotary axes, comes back as it was."""

import io

import h5py
import numpy as np
import pytest
from support.control_cases import MACHINE, job, levered, pitch, spatial, written
from support.made_up import made_up

import volid
from volid.compensation.package import Compensation
from volid.compensation.tables.axis_table import AxisTable
from volid.compensation.types import GRID, TABLES, TYPES
from volid.controllers import CONTROLS
from volid.exceptions import InputError

CSV, HDF5 = CONTROLS["csv"], CONTROLS["hdf5"]


def rows(text: str) -> list[str]:
    return [line for line in text.splitlines() if not line.startswith("#")]


def test_a_table_is_written_as_its_columns_say():
    files = written("csv", pitch())
    assert rows(files["EXX.csv"])[:3] == [
        "X,EXX(+),EXX(-),u_EXX(+),u_EXX(-),outside",
        "0.0,0.000000000,-0.002000000,0.000000000,0.000000000,0",
        "500.0,-0.010000000,-0.013000000,0.000000000,0.000000000,0",
    ]
    assert "# values: compensation" in files["EXX.csv"] and "# applied: kinematic model" in files["EXX.csv"]


def test_increments_add_up_to_it():
    text = written("csv", pitch(), incremental="1")["EXX.csv"]
    steps = np.array([[float(v) for v in row.split(",")[1:3]] for row in rows(text)[1:]])
    np.testing.assert_allclose(steps[1:], [[-0.010, -0.011], [0.014, 0.014]], atol=1e-12)
    found = CSV.read({"EXX.csv": text}, MACHINE, {"sign": "compensation"}).tables[0]
    np.testing.assert_allclose(found.reverse, [0.002, 0.013, -0.001], atol=1e-12)


def test_a_grid_as_hdf5_opens_in_any_program():
    content = written("hdf5", spatial())["grid.h5"]
    with h5py.File(io.BytesIO(content)) as file:
        assert file.attrs["values"] == "compensation" and list(file["positions"].attrs["columns"]) == ["X", "Y", "Z"]
        at = file["positions"][:].tolist().index([1000.0, 600.0, -500.0])
        np.testing.assert_allclose(file["values"][at], [-0.010, -0.005, -0.002, 0, 0, 0], atol=1e-15)


@pytest.fixture(scope="module")
def five_axis():
    return made_up(volid.load_machine("models/wCAYXbZt_trunnion.toml"))


@pytest.mark.parametrize("name", TYPES)
@pytest.mark.parametrize(("control", "asked_for"), [(CSV, "tables"), (CSV, "grids"), (HDF5, "")])
def test_each_type_comes_back_bit_for_bit_as_it_is_written_again(control, asked_for, name, five_axis):
    form = control.declared_for(five_axis.machine, {"form": asked_for}).carries.get(name)
    if form is None:
        assert (control, TYPES[name].forms) == (HDF5, (TABLES,))
        return
    chosen = {"L-SPEC": ("EXX", "EAY"), "R-SPEC": ("EXC",)}.get(name, ())
    base = volid.compensation_base(five_axis, (0.0, 0.0, -150.0), functions=chosen)
    made = volid.compensate(five_axis, [name], base, points=3, form=form, uncertainty=False)
    asked = job(control.declaration.name, made, machine=five_axis.machine)
    files = {f.name: f.content for f in control.write(asked).files}
    back = control.read(files, five_axis.machine, {**asked.options, "sign": "compensation"})
    assert (len(made.grids) + len(made.tables) > 0) and len(back.tables) == len(made.tables)
    assert [g.type for g in back.grids] == [g.type for g in made.grids]
    found = {t.function: t for t in back.tables}
    for one in made.tables:
        np.testing.assert_allclose(found[one.function].reverse, one.reverse, rtol=0, atol=1e-9)
    for one, other in zip(made.grids, back.grids, strict=True):
        np.testing.assert_allclose(other.values, one.values, rtol=0, atol=1e-9)
        np.testing.assert_array_equal(other.positions, one.positions)
    again = job(control.declaration.name, back, machine=five_axis.machine)
    twice = {f.name: f.content for f in control.write(again).files}
    if control is CSV:
        assert {n: rows(t) for n, t in twice.items()} == {n: rows(t) for n, t in files.items()}


def test_they_carry_all_that_has_such_a_form():
    assert set(CSV.declaration.carries) == set(TYPES)
    assert {n for n, kind in TYPES.items() if GRID in kind.forms} == set(HDF5.declaration.carries)


def test_a_wrong_file_is_named_without_the_place_where_it_was_read():
    with pytest.raises(InputError, match=r"^EXX\.csv, row 4: EXX is 'a'"):
        CSV.read({"EXX.csv": "# values: error\nX,EXX\n0,0\n5,a\n"}, MACHINE, {"sign": "compensation"})
    with pytest.raises(InputError, match="csv: no file; expected tables or grids"):
        CSV.read({}, MACHINE, {"sign": "compensation"})


@pytest.mark.parametrize(
    ("control", "made", "message"),
    [
        ("hdf5", levered(), "hdf5: tables have no HDF5 file of their own"),
        (
            "csv",
            Compensation((), (), (), (AxisTable("X", "Y", np.array([0.0, 1.0]), np.zeros(2), np.zeros(2)),)),
            "the table of X over Y is one of axes",
        ),
    ],
)
def test_what_they_cannot_hold_is_refused(control, made, message):
    with pytest.raises(InputError, match=message):
        written(control, made)
