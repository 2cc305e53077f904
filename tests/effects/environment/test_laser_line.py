"""Positioning of one axis by a laser interferometer without compensation: files, fit and u, against closed forms."""

import numpy as np
import pytest
from support.days import air, edlen

import volid
from volid.exceptions import InputError
from volid.io import load_campaign

MACHINE = """format = "volid-machine/1"
name = "one axis"
structure = "w b X Y Z t"
[axis.X]
travel = [0.0, 1000.0]
[axis.Y]
travel = [0.0, 600.0]
[axis.Z]
travel = [-500.0, 0.0]
[model]
degree = 1
[model.functions]
"E*" = false
EXX = { segments = 10 }
"""
MANIFEST = """format = "volid-campaign/1"
machine = "machine.toml"
[[set]]
name = "X"
kind = "component"
file = "X.csv"
tool = [0.0, 0.0, 0.0]
interferometer = true
u = 0.0003
[[environment]]
file = "air.csv"
"""
X = np.tile(np.concatenate([np.linspace(0.0, 1000.0, 11), np.linspace(1000.0, 0.0, 11)]), 3)
TIME = np.linspace(60.0, 7200.0, len(X))
DEVIATION = 4e-3 * np.sin(X / 200.0)
STEEL = 11.5e-6
NAMES = ("air_temperature_C", "pressure_hPa", "humidity_percent")


def clock(t):
    return f"2026-03-02T{int(8 + t // 3600):02d}:{int(t % 3600 // 60):02d}:{t % 60:06.3f}"


def write(
    folder,
    keys="corrected = false\n",
    *,
    iso=False,
    readings=None,
    columns=NAMES,
    manifest=MANIFEST,
    change=lambda rows: rows,
):
    """Manifest, machine, readings and log; the readings are counted from the first one on, 350 mm from the optics."""
    folder.mkdir(exist_ok=True)
    n = 1.0 + edlen(*air(TIME))
    path = 350.0 + X + DEVIATION
    shown = n * path - n[0] * path[0] - X if readings is None else readings
    say = clock if iso else repr
    rows = ["X,Y,Z,component,value,time"]
    rows += [
        f"{x!r},300.0,-250.0,X,{v!r},{say(t)}"
        for x, v, t in zip(X.tolist(), shown.tolist(), TIME.tolist(), strict=True)
    ]
    (folder / "X.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    times = np.arange(0.0, 7500.0, 240.0)
    rows = [",".join(["time", *columns])]
    rows += [",".join([say(t), *(repr(float(c)) for c in air(t))]) for t in times.tolist()]
    (folder / "air.csv").write_text("\n".join(change(rows)) + "\n", encoding="utf-8")
    (folder / "machine.toml").write_text(MACHINE, encoding="utf-8")
    (folder / "campaign.toml").write_text(manifest + keys, encoding="utf-8")
    return folder / "campaign.toml"


def positioning(solution):
    rows = [r for r in solution.functions(points=11) if r.name == "EXX"]
    return np.array([r.position for r in rows]), np.array([r.value for r in rows]), np.array([r.u for r in rows])


@pytest.mark.parametrize("iso", [False, True])
def test_positioning_is_recovered_from_fringes(tmp_path, iso):
    """To the 1e-8 by which formulas differ; times of readings and log may be seconds, or date and time."""
    solution = volid.fit(load_campaign(write(tmp_path, "corrected = false\ndead_path = 350.0\n", iso=iso)))
    x, found, _ = positioning(solution)
    expected = 4e-3 * (np.sin(x / 200.0) - np.sin(500.0 / 200.0))
    assert np.abs(found - expected).max() < 2e-5
    assert "refraction -26" in volid.summary(solution)


def test_u_of_the_air_and_of_the_scales_grows_with_the_distance_from_the_reference(tmp_path):
    """u² = u_readings² + ((u_n² + (α u_T)²) + (u_α (T - 20))²) (x - 500)²: no reading tells a common scale."""
    plain = positioning(volid.fit(load_campaign(write(tmp_path / "a"))))
    keys = f"""corrected = false
u = {{ air_temperature_C = 0.2, scale_C = 0.3 }}
values = {{ scale_C = 24.0 }}
machine = {{ expansion = {STEEL!r}, u = 1.0e-6 }}
"""
    solution = volid.fit(load_campaign(write(tmp_path / "b", keys)))
    x, found, u = positioning(solution)
    # n - 1 falls by 1/T; at 45 % humidity 1 K more is 66 Pa more vapour, 3.6e-10 of n - 1 each; u of the formula is 2e-8
    u_air = np.hypot(0.2 * (268e-6 / 294.0 + 66.0 * 3.6e-10), 2e-8)
    scale = np.sqrt(u_air**2 + (STEEL * 0.3) ** 2 + (1e-6 * 4.0) ** 2)
    np.testing.assert_allclose(u, np.hypot(plain[2], scale * np.abs(x - 500.0)), rtol=0.01, atol=1e-7)
    # at 20 °C all lengths are shorter by 1 + 4 α; the rest is 4 α of the errors themselves
    np.testing.assert_allclose(found - plain[1], (1.0 / (1.0 + 4.0 * STEEL) - 1.0) * (x - 500.0), rtol=0, atol=1e-6)


def test_a_line_in_light_across_the_axis_is_refused(tmp_path):
    path = write(tmp_path)
    text = (tmp_path / "X.csv").read_text().replace(",X,", ",Y,")
    (tmp_path / "X.csv").write_text(text)
    with pytest.raises(InputError, match="component Y on a line along X, and the set says interferometer = true"):
        volid.fit(load_campaign(path), accept_large_errors=True)


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ("", "corrected is missing"),
        ('corrected = "no"\n', "corrected is .*expected true or false"),
        ("corrected = false\nwave_length = 633\n", "wave_length.*did you mean 'wavelength'"),
        ("corrected = false\nat = { temperature = 20 }\n", "temperature"),
        ('corrected = false\nsets = ["Y"]\n', "sets names 'Y'; the sets are X"),
        ("corrected = false\nsets = 1\n", "a list of names of sets"),
        ("corrected = false\nvalues = { pressure_hPa = 1000 }\n", "no pressure_hPa, which the log has"),
        ("corrected = false\nmachine = { expansion = 11.5 }\n", "expansion is 11.5; expected 1/K"),
        ("corrected = false\nmachine = { alpha = 11.5e-6 }\n", "alpha"),
        ('corrected = false\nmachine = { expansion = 1.15e-5, material = "bed" }\n', "material is 'bed', and the log has no"),
    ],
)  # fmt: skip
def test_wrong_keys_are_named(tmp_path, keys, said):
    with pytest.raises(InputError, match=said):
        load_campaign(write(tmp_path, keys))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda rows: [rows[0].replace("pressure_hPa", "pressure"), *rows[1:]], "pressure.*did you mean 'pressure_hPa'"),
        (lambda rows: [rows[0].replace("time", "t"), *rows[1:]], "time"),
        (lambda rows: [*rows[:5], rows[3], *rows[5:]], r"air.csv, row 6: time goes back"),
        (lambda rows: [*rows[:5], "," + rows[5].split(",", 1)[1], *rows[6:]], r"air.csv, row 6: time is empty"),
        (lambda rows: [*rows[:5], rows[5].replace(",100", ",10"), *rows[6:]], "row 6: pressure_hPa is 103.*seems to be in kPa"),
        (lambda rows: rows[:10], "after the last entry"),
        (lambda rows: rows[:1], "there is a header but no row below it"),
    ],
)  # fmt: skip
def test_wrong_logs_are_named_with_their_row(tmp_path, change, said):
    with pytest.raises(InputError, match=said):
        volid.fit(load_campaign(write(tmp_path, change=change)))


def test_columns_of_a_log_have_any_names(tmp_path):
    keys = 'corrected = false\ncolumns = { air_temperature_C = "t_air", pressure_hPa = "p" }\nignore = ["humid"]\n'
    keys += "values = { humidity_percent = 45.0 }\n"
    found = load_campaign(write(tmp_path, keys, columns=("t_air", "p", "humid"))).environments[0]
    assert list(found.log) == ["time", "air_temperature_C", "pressure_hPa", "humidity_percent"]
    assert set(found.log["humidity_percent"].tolist()) == {45.0} and found.sets == ("X",) and found.name == "air"


def test_an_environment_for_nothing_is_named(tmp_path):
    manifest = MANIFEST.replace("interferometer = true\n", "")
    with pytest.raises(InputError, match="no set is meant; expected sets that are read in light"):
        load_campaign(write(tmp_path, manifest=manifest))
