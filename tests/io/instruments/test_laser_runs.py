"""Runs of laser interferometers: numbers, directions and record of files composed from the layout, by hand."""

import numpy as np
import pytest
from support.instrument_files import ENVIRONMENT, MEASURED, TARGETS, averages_file, run_file
from support.places import MODELS

from volid.exceptions import InputError
from volid.io.campaign.imported import import_files

MACHINE = MODELS / "wYXbZt_vertical.toml"
FIVE = MODELS / "wCAYXbZt_trunnion.toml"
LINE = {"axis": "X", "at": {"Y": 300.0, "Z": -250.0}, **MEASURED}
THREE = (0.0, 400.0, 1000.0)
RUNS = [[1.0, 2.0, 3.0], [1.5, 2.5, 3.5], [1.25, 2.25, 3.25], [1.75, 2.75, 3.75]]  # of each target, up and down in turn


def read(tmp_path, text, name="x.rtl", machine=MACHINE, **keys):
    """The set and the campaign of a file, from text or bytes."""
    (tmp_path / name).write_bytes(text if isinstance(text, bytes) else text.encode())
    stated = {key: value for key, value in {**LINE, **keys}.items() if value is not None}
    campaign = import_files([tmp_path / name], machine, stated)
    return campaign.sets[0], campaign


def test_every_reading_has_its_target_run_and_direction(tmp_path):
    found, campaign = read(tmp_path, run_file(RUNS, THREE))
    x, direction = campaign.machine.letters.index("X"), found.directions[:, campaign.machine.letters.index("X")]
    np.testing.assert_array_equal(found.positions[:, x], [0, 400, 1000, 1000, 400, 0] * 2)
    np.testing.assert_allclose(
        found.readings[:, 0],
        np.array([1.0, 2, 3, 3.5, 2.5, 1.5, 1.25, 2.25, 3.25, 3.75, 2.75, 1.75]) * 1e-3,
        rtol=1e-14,
    )
    np.testing.assert_array_equal(direction, [1, 1, 1, -1, -1, -1] * 2)
    assert found.labels["run"].tolist() == list("111222333444")
    assert set(found.labels["component"]) == {"X"}
    assert np.delete(found.directions, x, axis=1).any() == False  # noqa: E712
    np.testing.assert_array_equal(
        found.positions[0], [{"X": 0.0, "Y": 300.0, "Z": -250.0}[a] for a in campaign.machine.letters]
    )
    np.testing.assert_array_equal(found.tool, np.tile([0, 0, -150], (12, 1)))


def test_rows_in_another_order_are_the_same_readings(tmp_path):
    """The number in the second column tells the target, never the place of the row."""
    text = run_file(RUNS, THREE)
    rows = [line for line in text.split("\r\n") if len(line.split()) == 3 and line.split()[0].isdigit()]
    mixed = text.replace("\r\n".join(rows), "\r\n".join(sorted(rows, key=lambda row: (row.split()[1], row))))
    assert mixed != text
    (one, _), (other, _) = read(tmp_path, text), read(tmp_path, mixed)

    def content(s):
        return sorted(zip(s.positions[:, 1], s.directions[:, 1], s.labels["run"], s.readings[:, 0], strict=True))

    assert content(one) == content(other)


def test_odd_runs_that_are_listed_backwards_are_said(tmp_path):
    text = run_file(RUNS, THREE)
    rows = [line for line in text.split("\r\n") if len(line.split()) == 3 and line.split()[0].isdigit()]
    backwards = text.replace(
        "\r\n".join(rows), "\r\n".join(sorted(rows, key=lambda r: (r.split()[0], -int(r.split()[1]))))
    )
    found, campaign = read(tmp_path, backwards)
    assert found.directions[0, campaign.machine.letters.index("X")] == 1.0
    assert any("odd runs are listed from the last target to the first" in w for w in campaign.warnings)
    assert not any("odd runs are listed" in w for w in read(tmp_path, text)[1].warnings)


def test_targets_count_from_where_the_user_says(tmp_path):
    found, campaign = read(tmp_path, run_file(RUNS, (-400.0, 0.0, 400.0)), offset=450.0)
    np.testing.assert_array_equal(found.positions[:3, campaign.machine.letters.index("X")], [50, 450, 850])


def test_falling_targets_turn_the_directions(tmp_path):
    found, campaign = read(tmp_path, run_file(RUNS, THREE[::-1]))
    x = campaign.machine.letters.index("X")
    np.testing.assert_array_equal(found.positions[:4, x], [1000, 400, 0, 0])
    np.testing.assert_array_equal(found.directions[:, x], [-1, -1, -1, 1, 1, 1] * 2)


FORMS = {
    "decimal commas": lambda t: t.replace(".", ","),
    "line feeds": lambda t: t.replace("\r\n", "\n"),
    "blanks behind headings": lambda t: t.replace("::", "::   ").replace("Run Target Data:", "Run Target Data: \t"),
    "tabs": lambda t: t.replace("   ", "\t"),
    "exponents": lambda t: t.replace("1.500000", "1.5E+000").replace("3.750000", "375e-2"),
    "targets on one line": lambda t: t.replace("Targets :\r\n", "Targets : "),
    "targets one a line": lambda t: t.replace("0.000000 400.000000 1000.000000 ", "0\r\n400\r\n1000"),
    "no runs, no user's texts": lambda t: t[: t.index("USER")] + t[t.index("DEVIATIONS") :],
    "no header": lambda t: t[t.index("TARGET DATA") :],
    "equipment": lambda t: t.replace("ENVIRONMENT::", "EQUIPMENT::\r\nLaser: 1 2 3\r\n\r\nENVIRONMENT::"),
    "small letters": lambda t: t.replace("TARGET DATA", "Target Data").replace("Target-count: ", "Target-Count:"),
}


@pytest.mark.parametrize("form", FORMS)
def test_other_forms_are_the_same_readings(form, tmp_path):
    text = FORMS[form](run_file(RUNS, THREE))
    assert text != run_file(RUNS, THREE)
    (one, _), (other, _) = read(tmp_path, run_file(RUNS, THREE)), read(tmp_path, text)
    for name in ("positions", "directions", "readings"):
        np.testing.assert_allclose(getattr(other, name), getattr(one, name), rtol=1e-15)


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "cp1252", "gbk"])
def test_encodings_are_recognised_or_stated(encoding, tmp_path):
    text = run_file(RUNS, THREE).replace("Machine: Mill", "Machine: Fräse" if encoding != "gbk" else "Machine: 铣床")
    stated = "gbk" if encoding == "gbk" else None
    _, campaign = read(tmp_path, text.encode(encoding), encoding=stated)
    assert campaign.conditions["imported"]["x"]["as_written"]["Machine"] == ("铣床" if stated else "Fräse")


def test_a_file_of_chinese_text_is_read_without_its_encoding_too(tmp_path):
    found, _ = read(tmp_path, run_file(RUNS, THREE).replace("Mill", "铣床").encode("gbk"))
    assert len(found) == 12


def test_the_environment_is_kept_in_the_units_of_its_keys(tmp_path):
    """Pressure comes in kPa; -10 °C is a sensor that is not connected; the temperature is the mean of the others."""
    found, campaign = read(tmp_path, run_file(RUNS, THREE))
    record = campaign.conditions["imported"]["x"]
    kept = record["environment"]
    assert kept["air_temperature_C"] == [20.337280, 20.384956]
    np.testing.assert_allclose(kept["pressure_hPa"], [990.39005, 990.49346], rtol=1e-12)
    assert kept["humidity_percent"] == [46.954897, 46.893887]
    assert "material_2_C" not in kept and kept["material_3_C"] == [20.6, 20.7]
    np.testing.assert_allclose(found.temperature, (20.2 + 20.3 + 20.6 + 20.7) / 4, rtol=1e-12)
    assert record["date_time"] == ["10:46 Dec 12 2016", "11:01 Dec 12 2016"]
    assert record["as_written"]["TITLE"] == "made up"
    assert any("material_2_C: -10 °C was taken for a sensor that is not connected" in w for w in campaign.warnings)
    assert any("expansion of 8 ppm/K, by which its program reduces readings to 20 °C" in w for w in campaign.warnings)


def test_temperatures_of_the_material_are_known_by_their_long_name(tmp_path):
    lines = [line.replace("Mat temp", "Material temp.") for line in ENVIRONMENT]
    found, _ = read(tmp_path, run_file(RUNS, THREE, environment=lines))
    np.testing.assert_allclose(found.temperature, (20.2 + 20.3 + 20.6 + 20.7) / 4, rtol=1e-12)


def test_a_file_without_environment_has_no_temperature(tmp_path):
    found, campaign = read(tmp_path, run_file(RUNS, THREE, environment=()))
    assert found.temperature is None
    assert "environment" not in campaign.conditions["imported"]["x"]


def test_a_pressure_of_neither_unit_is_left_out(tmp_path):
    changed = [line.replace("99.039005 99.049346", "29.2 29.3") for line in ENVIRONMENT]
    _, campaign = read(tmp_path, run_file(RUNS, THREE, environment=changed))
    assert "pressure_hPa" not in campaign.conditions["imported"]["x"]["environment"]


# ------------------------------------------------------------------------------------------------- one direction

PADDED = [RUNS[0], [0.0] * 3, RUNS[2], [0.0] * 3]


def test_runs_that_are_filled_in_with_zeros_are_left_out_by_the_flag(tmp_path):
    found, campaign = read(tmp_path, run_file(PADDED, THREE, flags="0 1 2 0"))
    assert found.labels["run"].tolist() == list("111333")
    assert set(found.directions[:, campaign.machine.letters.index("X")]) == {1.0}
    assert any(
        "the second flag says one direction: 2 run(s) back, all zeros, were left out" in w for w in campaign.warnings
    )


def test_runs_of_zeros_without_the_flag_are_asked_about(tmp_path):
    with pytest.raises(
        InputError, match=r"x.rtl: every deviation of run 2 is 0; expected readings. State one_way = true"
    ):
        read(tmp_path, run_file(PADDED, THREE))
    found, _ = read(tmp_path, run_file(PADDED, THREE), one_way=True)
    assert found.labels["run"].tolist() == list("111333")


def test_a_flag_that_the_readings_contradict_is_asked_about(tmp_path):
    text = run_file(RUNS, THREE, flags="0 1 2 0")
    with pytest.raises(InputError, match="one direction, but run 2 has readings; state one_way = true if all runs go"):
        read(tmp_path, text)
    up, campaign = read(tmp_path, text, one_way=True)
    x = campaign.machine.letters.index("X")
    assert set(up.directions[:, x]) == {1.0} and len(up) == 12
    both, _ = read(tmp_path, text, one_way=False)
    np.testing.assert_array_equal(both.directions[:, x], [1, 1, 1, -1, -1, -1] * 2)


def test_a_file_of_zeros_is_no_measurement(tmp_path):
    with pytest.raises(InputError, match=r"x\.rtl: every deviation is 0"):
        read(tmp_path, run_file([[0.0] * 3] * 2, THREE, flags="0 1 2 0"))


# --------------------------------------------------------------------------------------------------- what is wrong

DAMAGE = {
    "2   2      2.500000": ("2   2      2.5x", "row {n}: the deviation is '2.5x'; expected a number"),
    "2   1      1.500000": ("2   4      1.5", "row {n}: the target is '4'; expected the number of a target, 1 to 3"),
    "3   1      1.250000": ("0   1      1.25", "row {n}: the run is '0'; expected a whole number from 1"),
    "3   2      2.250000": (
        "3   1      2.25",
        "row {n}: run 3 has target 1 a second time, after row {before}; expected once",
    ),
    "4   3      3.750000": ("4   3", "row {n}: '4   3' has 2 parts; expected run, target and deviation"),
    "4   1      1.750000\r\n": (
        "",
        "run 4 has 2 of 3 targets; the file may have been cut off; state incomplete = true",
    ),
    "Run-count: 4": ("Run-count: 6", "Run-count is 6, but there are 4 runs; the file may have been cut off"),
    "Target-count: 3": ("Target-count: 5", "Target-count is 5, but there are 3 targets"),
    "400.000000": ("4oo", "row {n}: target 2 is '4oo'; expected a number"),
    "1000.000000": (
        "300",
        r"target 3 \(300\) does not go on from target 2 \(400\); expected targets that rise or fall",
    ),
    "2.500000": ("2,500000", "numbers hold points and commas; expected one decimal sign"),
}


@pytest.mark.parametrize("old", DAMAGE)
def test_damage_is_named_by_its_line(old, tmp_path):
    new, message = DAMAGE[old]
    text = run_file(RUNS, THREE)
    assert text.count(old) == 1 or old == "2.500000"
    line = text[: text.index(old)].count("\n") + 1
    message = message.format(n=line, before=line - 1)
    with pytest.raises(InputError, match=rf"x\.rtl(, |: ){message}"):
        read(tmp_path, text.replace(old, new, 1))


def test_a_file_that_was_cut_off_is_read_on_request_and_said(tmp_path):
    text = run_file(RUNS, THREE)
    text = text[: text.index("4   2")]
    found, campaign = read(tmp_path, text, incomplete=True)
    assert len(found) == 10
    assert any("there is no section EOF:: at its end; the file may have been cut off" in w for w in campaign.warnings)


KEYS = {
    "another axis": ({"axis": "U"}, 'axis is "U"; expected one of "Y", "X", "Z"'),
    "no place of an axis": (
        {"at": {"Y": 300.0}},
        r"\[at\]: no position of Z; expected where every axis stood while X moved",
    ),
    "a place of no axis": ({"at": {"W": 0.0, "Y": 300.0, "Z": 0.0}}, r"\[at\]: unknown key 'W'"),
    "no tool": ({"tool": None}, r"there is no tool vector; add tool = \[x, y, z\]"),
    "no u": ({"u": None}, "there is no standard uncertainty; add u"),
    "a rotation": ({"component": "A"}, 'component is "A"; expected one of "X", "Y", "Z"'),
    "a unit of angles": ({"unit": "arcsec"}, 'unit is "arcsec"; expected one of mm, m, cm'),
    "another kind": ({"kind": "distance"}, "kind is \"distance\"; expected 'component', as what readings of a linear"),
    "a key of tables": ({"columns": {"X": "x"}}, "columns is for delimited text, and .* is read as 'rtl'; remove it"),
    "an unknown key": ({"axes": "X"}, "unknown key 'axes'"),
}


@pytest.mark.parametrize("what", KEYS)
def test_keys_that_are_wrong_or_missing_are_named(what, tmp_path):
    keys, message = KEYS[what]
    with pytest.raises(InputError, match=rf"set 'x'.*{message}"):
        read(tmp_path, run_file(RUNS, THREE), **keys)


def test_the_axis_is_that_of_the_file_unless_the_user_says_otherwise(tmp_path):
    _, campaign = read(tmp_path, run_file(RUNS, THREE), axis=None)
    assert any("axis X as the file says" in w for w in campaign.warnings)
    _, campaign = read(tmp_path, run_file(RUNS, (0.0, 300.0, 600.0)), axis="Y", at={"X": 0.0, "Z": 0.0})
    assert any("it calls the axis 'X', and Y is taken as stated" in w for w in campaign.warnings)
    with pytest.raises(InputError, match="key 'axis' is missing, and the file calls it 'Main'; add it, one of Y, X, Z"):
        read(tmp_path, run_file(RUNS, THREE, axis="Main"), axis=None)


# ----------------------------------------------------------------------------------------------- angles, averages


def test_angles_are_in_mrad_and_that_is_said(tmp_path):
    text = run_file([[0.010, 0.020, -0.030]], THREE, file_type="rta")
    found, campaign = read(tmp_path, text, "x.rta", component="B", u=1e-6)
    np.testing.assert_allclose(found.readings[:, 0], [1e-5, 2e-5, -3e-5], rtol=1e-14)
    assert any("does not tell the unit of its deviations; they were taken in mrad" in w for w in campaign.warnings)
    assert not any("expansion" in w for w in campaign.warnings), "turns are not reduced to 20 °C"


def test_the_unit_of_angles_can_be_stated(tmp_path):
    """One second of arc is π / 648000 rad."""
    text = run_file([[1.0, 2.0, -3.0]], THREE, file_type="rta")
    found, campaign = read(tmp_path, text, "x.rta", component="B", u=1e-6, unit="arcsec")
    np.testing.assert_allclose(found.readings[:, 0], np.array([1, 2, -3]) * np.pi / 648000, rtol=1e-14)
    assert not any("mrad" in w for w in campaign.warnings)


def test_angles_along_a_linear_axis_need_a_component(tmp_path):
    with pytest.raises(
        InputError, match="key 'component' is missing; add it, one of A, B, C: what was read while X moved"
    ):
        read(tmp_path, run_file(RUNS, THREE, file_type="rta"), "x.rta")


def test_angles_of_a_rotary_axis_are_its_own_and_targets_are_degrees(tmp_path):
    text = run_file([[0.0, 0.01, 0.02], [0.0, 0.012, 0.022]], (0.0, 120.0, 360.0), file_type="rta", axis="C")
    still = {a: 0.0 for a in "AYXZ"}
    found, campaign = read(tmp_path, text, "c.rta", FIVE, axis=None, at=still, u=1e-6)
    c = campaign.machine.letters.index("C")
    np.testing.assert_array_equal(found.positions[:, c], [0, 120, 360, 360, 120, 0])
    assert set(found.labels["component"]) == {"C"}
    with pytest.raises(InputError, match="axis C is rotary; linear readings need a linear axis"):
        read(tmp_path, run_file(RUNS, THREE), "x.rtl", FIVE, axis="C", at=still, component="X")


def test_averages_have_directions_and_a_stated_sign(tmp_path):
    forward, back = [0.001, 0.002, 0.003], [0.0015, 0.0025, 0.0035]
    found, campaign = read(tmp_path, averages_file(forward, back, THREE), "x.pos", sign=-1)
    x = campaign.machine.letters.index("X")
    np.testing.assert_allclose(found.readings[:, 0], -np.array([*forward, *back]), rtol=1e-12)
    np.testing.assert_array_equal(found.directions[:, x], [1, 1, 1, -1, -1, -1])
    assert any("it holds averages of the runs, not the runs" in w for w in campaign.warnings)


def test_averages_of_both_directions_have_none(tmp_path):
    text = averages_file([0.001, 0.002, 0.003], [0.002, 0.003, 0.004], THREE)
    text = text[: text.index("Position   \tForward")] + "ENVIRONMENT::\r\n"
    found, _ = read(tmp_path, text, "x.pos", sign=1)
    np.testing.assert_allclose(found.readings[:, 0], [0.0015, 0.0025, 0.0035], rtol=1e-12)
    assert not found.directions.any()


def test_runs_of_that_maker_are_in_mm(tmp_path):
    found, _ = read(tmp_path, run_file([[0.001, 0.002, 0.003]], THREE, file_type="pos"), "x.pos", sign=1)
    np.testing.assert_allclose(found.readings[:, 0], [0.001, 0.002, 0.003], rtol=1e-14)


def test_the_sign_of_averages_is_not_guessed(tmp_path):
    text = averages_file([0.001, 0.002, 0.003], [0.001, 0.002, 0.003], THREE)
    with pytest.raises(InputError, match="key 'sign' is missing"):
        read(tmp_path, text, "x.pos")
    with pytest.raises(InputError, match="sign is 2; expected 1 where error is actual - nominal, -1 where"):
        read(tmp_path, text, "x.pos", sign=2)


@pytest.mark.parametrize("bad", ["400.000\t0.0020000\t7", "-400.000\tx", "400.000", "x400.000\t0.0020000"])
def test_a_damaged_row_of_averages_is_named(bad, tmp_path):
    text = averages_file([0.001, 0.002, 0.003], [0.001, 0.002, 0.003], THREE).replace("400.000\t0.0020000", bad, 1)
    line = text[: text.index(bad)].count("\n") + 1
    with pytest.raises(InputError, match=rf"x.pos, row {line}: '.*'; expected position and error, two numbers"):
        read(tmp_path, text, "x.pos", sign=1)


def test_tables_of_averages_have_the_same_positions(tmp_path):
    text = averages_file([0.001, 0.002, 0.003], [0.001, 0.002, 0.003], THREE)
    end = text.rindex("400.000")
    text = text[:end] + text[text.index("\n", end) + 1 :]
    with pytest.raises(InputError, match=r"x.pos: the tables differ in their positions \(3 both, 3 forward, 2 back\)"):
        read(tmp_path, text, "x.pos", sign=1)
    assert len(read(tmp_path, text, "x.pos", sign=1, incomplete=True)[0]) == 5


def test_one_list_of_places_serves_the_files_of_all_axes(tmp_path):
    """Each axis moves in its own file and stands where the list says in the others."""
    ends = {"X": (0.0, 1000.0), "Y": (0.0, 600.0), "Z": (-500.0, 0.0)}
    for letter, (low, high) in ends.items():
        (tmp_path / f"{letter}.rtl").write_text(run_file(RUNS, (low, (low + high) / 4, high), axis=f"{letter} axis"))
    places = {"X": 500.0, "Y": 300.0, "Z": -250.0}
    campaign = import_files([tmp_path / f"{a}.rtl" for a in ends], MACHINE, {"at": places, **MEASURED})
    for letter, readings in zip(ends, campaign.sets, strict=True):
        for i, axis in enumerate(campaign.machine.letters):
            moved = set(readings.positions[:, i])
            assert moved == ({places[axis]} if axis != letter else {*ends[letter], sum(ends[letter]) / 4})
        assert set(readings.labels["component"]) == {letter}


def test_a_file_of_another_interferometer_is_named(tmp_path):
    with pytest.raises(InputError, match="seems to be runs of a laser interferometer in a file of another type"):
        read(tmp_path, run_file(RUNS, THREE, file_type="rts"), "x.rts")


def test_several_files_are_several_sets(tmp_path):
    for name in ("x.rtl", "x.rta"):
        (tmp_path / name).write_text(run_file(RUNS, THREE, file_type=name[2:]))
    with pytest.raises(InputError, match="component"):
        import_files([tmp_path / "x.rtl", tmp_path / "x.rta"], MACHINE, LINE)
    (tmp_path / "y").mkdir()
    (tmp_path / "y/x.rtl").write_text(run_file(RUNS, TARGETS[:3]))
    campaign = import_files([tmp_path / "x.rtl", tmp_path / "y/x.rtl"], MACHINE, LINE)
    assert [s.name for s in campaign.sets] == ["x", "x 2"]
