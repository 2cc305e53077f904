"""Positioning runs from files of instruments, compensation tables, and the conditions of a test."""

import numpy as np
import pytest
from support.instrument_files import TARGETS, averages_file, run_file

from volid.exceptions import InputError
from volid.io.evaluations.positioning import read_positioning
from volid.io.evaluations.positioning_conditions import read_conditions
from volid.standards.positioning.evaluation import evaluate_positioning

UP = [0.1 * i * i for i in range(len(TARGETS))]  # µm
DOWN = [v + 2.0 for v in UP]


def read(tmp_path, name, text, axis=None, **more):
    (tmp_path / name).write_bytes(text.encode())
    [found] = read_positioning(tmp_path / name, axis, **more)
    return found.runs


def test_linear_readings_of_a_laser_have_runs_up_and_down(tmp_path):
    runs = read(tmp_path, "x.rtl", run_file([UP, DOWN, UP, DOWN]))
    assert (runs.axis, runs.unit, runs.deviations.shape) == ("X", "mm", (len(TARGETS), 2, 2))
    np.testing.assert_allclose(1e3 * runs.deviations[:, 0], np.array([UP, UP]).T, rtol=0, atol=1e-6)
    np.testing.assert_allclose(1e3 * runs.deviations[:, 1], np.array([DOWN, DOWN]).T, rtol=0, atol=1e-6)


def test_the_axis_that_the_user_names_goes_before_that_of_the_file(tmp_path):
    runs = read(tmp_path, "x.rtl", run_file([UP, DOWN]), axis="Y")
    assert runs.axis == "Y" and any("calls the axis 'X'" in note for note in runs.notes)


def test_angular_readings_of_a_rotary_axis_are_in_degrees(tmp_path):
    runs = read(
        tmp_path, "c.rta", run_file([[1e-3 * v for v in UP]] * 2, file_type="rta", axis="C"), keys={"unit": "mrad"}
    )
    assert (runs.axis, runs.unit) == ("C", "°")
    np.testing.assert_allclose(runs.deviations[:, 0, 0], np.rad2deg(1e-6 * np.array(UP)), rtol=0, atol=1e-9)


def test_a_pitch_is_no_positioning(tmp_path):
    with pytest.raises(InputError, match="component B while X moved; ISO 230-2 evaluates positioning: component X"):
        read(tmp_path, "x.rta", run_file([UP, DOWN], file_type="rta"), keys={"component": "B"})


def test_averages_are_means(tmp_path):
    text = averages_file([1e-3 * v for v in UP], [1e-3 * v for v in DOWN])
    runs = read(tmp_path, "x.pos", text, axis="X", keys={"sign": 1})
    assert runs.are_means
    assert {q.symbol for q in evaluate_positioning(runs).quantities} == {"E", "E_up", "E_down", "M", "B", "B_mean"}
    with pytest.raises(InputError, match="'sign' is missing"):
        read(tmp_path, "x.pos", text, axis="X")


TABLE = "# values: {values}\n# rows: {rows}\nX,EXX(+),EXX(-)\n0,0.001,0.002\n100,0.003,0.001\n200,-0.001,0.002\n"


@pytest.mark.parametrize(
    ("values", "rows", "up", "down"),
    [
        ("error", "absolute", [1, 3, -1], [2, 1, 2]),
        ("compensation", "absolute", [-1, -3, 1], [-2, -1, -2]),
        ("compensation", "incremental", [-1, -4, -3], [-2, -3, -5]),
    ],
)
def test_a_compensation_table_holds_minus_the_means(tmp_path, values, rows, up, down):
    runs = read(tmp_path, "t.csv", TABLE.format(values=values, rows=rows))
    np.testing.assert_allclose(1e3 * runs.deviations[:, :, 0], np.array([up, down]).T, rtol=0, atol=1e-12)
    assert runs.axis == "X" and runs.are_means
    minus = "minus " if values == "compensation" else ""
    assert runs.notes[0].endswith(
        f"taken for {minus}the mean deviations that it was made from; its rows were read as {rows}"
    )


def test_a_compensation_table_that_does_not_say_its_rows_is_told_how_it_was_read(tmp_path):
    """Increments read as absolute values made 3.5 µm of 31.8 µm."""
    text = TABLE.format(values="compensation", rows="absolute")
    text = "".join(line + "\n" for line in text.splitlines() if "rows" not in line)
    (note,) = read(tmp_path, "t.csv", text).notes
    assert note.endswith("its rows were read as absolute, because the file has no line '# rows: incremental'")


def test_a_table_of_another_function_is_refused(tmp_path):
    text = TABLE.format(values="error", rows="absolute").replace("EXX", "EYX")
    with pytest.raises(InputError, match="a table of EYX; ISO 230-2 evaluates positioning"):
        read(tmp_path, "t.csv", text)


def test_sets_are_of_campaigns_only(tmp_path):
    with pytest.raises(InputError, match="no campaign and has no sets"):
        read(tmp_path, "t.csv", TABLE.format(values="error", rows="absolute"), sets=["X"])


CONDITIONS = """
device = { U = 0.0002, U_per_length = 5e-7 }
misalignment = { offset = 0.5 }
temperature = { u = 0.2, expansion = 11.5e-6, at = 22.0, u_expansion = 1e-6 }
drift = { range = 0.0008, form = "linear" }
setup = { u = 0.0003 }
noise = { u = 0.0001 }
"""


def conditions(tmp_path, text, length=1000.0):
    (tmp_path / "conditions.toml").write_text(text)
    return read_conditions(tmp_path / "conditions.toml", length)


def test_conditions_are_read_as_they_are_meant(tmp_path):
    found = conditions(tmp_path, CONDITIONS)
    assert (found.device, found.device_scale, found.misalignment) == pytest.approx((1e-4, 2.5e-7, 5e-4))  # k = 2
    assert (found.temperature_u, found.temperature, found.expansion, found.expansion_u) == (0.2, 22.0, 11.5e-6, 1e-6)
    assert (found.drift, found.drift_form, found.setup, found.noise) == (8e-4, "linear", 3e-4, 1e-4)
    assert conditions(tmp_path, "device = { U = 0.0003, k = 3 }").device == pytest.approx(1e-4)
    assert conditions(tmp_path, "").drift == 0.0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("devise = { U = 1 }", "conditions.toml: unknown key 'devise'; did you mean 'device'"),
        ("[device]\nu = 1", r"\[device\]: unknown key 'u'"),
        ("[noise]\nu = -1", r"\[noise\]: u is -1; expected a finite number >= 0"),
        ("[temperature]\nu = 0.2", r"\[temperature\]: key 'expansion' is missing"),
        ('[drift]\nrange = 1e-3\nform = "wild"', r"\[drift\]: form is \"wild\"; expected one of"),
    ],
)
def test_wrong_conditions_are_refused(tmp_path, text, message):
    with pytest.raises(InputError, match=message):
        conditions(tmp_path, text)


def test_how_a_campaign_was_read_is_told(tmp_path):
    """Decimal commas and µm of a header that were recognised, and not stated."""
    head = 'format = "volid-machine/1"\nname = "m"\nstructure = "w b X t"\n[axis.X]\ntravel = [0.0, 100.0]\n'
    (tmp_path / "m.toml").write_text(head)
    rows = [
        "X;X_dir;component;line;value [µm]",
        *(f"{x};{w};X;1;{x / 100.0 + w}".replace(".", ",") for x in (0, 50, 100) for w in (1, -1)),
    ]
    (tmp_path / "r.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    keys = 'format = "volid-campaign/1"\nmachine = "m.toml"\n[[set]]\nname = "s"\nkind = "component"\nfile = "r.csv"\n'
    (tmp_path / "c.toml").write_text(keys + "u = 0.0002\ntool = [0, 0, 0]\n")
    (found,) = read_positioning(tmp_path / "c.toml")
    np.testing.assert_allclose(
        found.runs.deviations[:, :, 0], [[0.001, -0.001], [0.0015, -0.0005], [0.002, 0.0]], rtol=0, atol=1e-12
    )
    said = " ".join(found.runs.notes)
    assert "decimal commas" in said and "µm" in said
