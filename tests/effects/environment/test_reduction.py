"""Readings reduced for air and temperature, each against what follows in closed form."""

from dataclasses import replace

import numpy as np
import pytest
from support.campaign_files import MACHINE
from support.days import DAY, air, edlen

from volid.campaign import Campaign, End, Environment, Expansion, ObservationSet, Station
from volid.effects.environment.reduction import as_read, in_air, reduced
from volid.effects.environment.remarks import accounts, remarks_on
from volid.exceptions import InputError
from volid.io.machines import parse_machine
from volid.observations import KINDS
from volid.observations.base import LIGHT

THREE = parse_machine(MACHINE, "machine.toml")
M = 41
TIME = np.linspace(0.0, DAY, M)
X = np.stack([np.linspace(0.0, 1000.0, M), np.full(M, 300.0), np.full(M, -250.0)], axis=1)
N = 1.0 + edlen(*air(TIME))
SAME = 1e-8  # of a length: how well two formulas of the refractive index agree
STEEL, GLASS = 11.5e-6, 8e-6  # 1/K


def log(step=300.0, **more):
    times = np.arange(0.0, DAY + 1.0, step)
    columns = zip(("air_temperature_C", "pressure_hPa", "humidity_percent"), air(times), strict=True)
    return {"time": times, **dict(columns), **{name: value(times) for name, value in more.items()}}


def day(**keys):
    return Environment("day", **({"log": log(), "corrected": False} | keys))


def a_set(kind, readings, positions=X, **more):
    readings = np.asarray(readings, dtype=float).reshape(len(positions), -1)
    still = np.zeros((len(positions), 3))
    return ObservationSet(
        "own", kind, positions, still, still, readings, np.full(readings.shape, 1e-3), **({"time": TIME} | more)
    )


def campaign(own, *environments, stations=()):
    return Campaign(THREE, stations, (own,), environments=environments)


def laser(shown, **options):
    labels = {"component": np.full(M, "X"), "line": np.full(M, "1")}
    return a_set("component", shown, labels=labels, options={"interferometer": True, **options})


def test_a_positioning_line_with_a_dead_path():
    """Displayed: n (D + x + d) - n0 D, less the commanded x. Reduced, d remains, but for a constant."""
    dead, deviation = 400.0, 5e-3 * np.sin(X[:, 0] / 150.0)
    for side in (1.0, -1.0):  # the beam comes from the negative, or from the positive side
        path = dead + side * (X[:, 0] + deviation)
        shown = side * (N * path - N[0] * dead) - X[:, 0]
        found = reduced(campaign(laser(shown), day(dead_path=side * dead))).sets[0]
        left = found.readings[:, 0] - deviation
        assert np.ptp(left) < SAME * 1000.0 + 1e-6
        np.testing.assert_array_equal(found.as_read[:, 0], shown)
        without = reduced(campaign(laser(shown), day())).sets[0].readings[:, 0] - deviation
        # the air of the dead path changes the zero: n falls by 5e-6 over the day, 2 µm of 400 mm
        assert np.ptp(without) == pytest.approx(dead * np.ptp(N), rel=0.05)


def test_an_instrument_that_assumed_other_air_is_undone_first():
    shown = X[:, 0] * N / 1.000271 - X[:, 0]  # counted in air, divided by the instrument's own index
    found = reduced(campaign(laser(shown), day(at={"refractive_index": 1.000271}))).sets[0]
    assert np.abs(found.readings).max() < SAME * 1000.0
    (said,) = accounts(campaign(laser(shown), day(at={"refractive_index": 1.000271})))
    assert said["undone"] == pytest.approx(271e-6) and said["applied"]
    stated = {"air_temperature_C": 20.0, "pressure_hPa": 1013.25, "humidity_percent": 50.0}
    shown = X[:, 0] * N / (1.0 + edlen(*stated.values())) - X[:, 0]
    assert np.abs(reduced(campaign(laser(shown), day(at=stated))).sets[0].readings).max() < 2.0 * SAME * 1000.0


def test_readings_that_are_corrected_already_stay_and_the_log_is_told():
    found = campaign(laser(np.zeros(M)), day(corrected=True))
    np.testing.assert_array_equal(reduced(found).sets[0].readings, 0.0)
    (said,) = accounts(found)
    assert not said["applied"] and said["refractivity"] == pytest.approx([N.min() - 1.0, N.max() - 1.0], abs=SAME)


def test_scales_of_the_machine_are_reduced_to_20_degrees():
    """A machine that is α (T - 20) longer: an error of position that grows with temperature, and is none at 20 °C."""

    def body(t):
        return 22.0 + 3.0 * t / DAY

    grown = STEEL * (body(TIME) - 20.0)
    environment = day(
        log={"time": log()["time"], "scale_X_C": body(log()["time"])}, corrected=None, machine=Expansion(STEEL)
    )
    found = reduced(campaign(laser(X[:, 0] * grown), environment)).sets[0]
    assert np.abs(found.readings).max() < 1e-9
    (said,) = accounts(campaign(laser(X[:, 0] * grown), environment))
    assert said["machine"]["temperature"] == pytest.approx([22.0, 25.0])
    assert said["machine"]["change"] == pytest.approx([-5.0 * STEEL, -2.0 * STEEL], rel=1e-4)


def test_an_artefact_is_longer_than_at_20_degrees_and_the_machine_too():
    """A step gauge of L at 20 °C has L (1 + α_a (T - 20)), and the scales count 1 / (1 + α_m (T - 20)) of it."""
    lengths = np.linspace(20.0, 1000.0, M)
    to = End(X * [0.0, 1.0, 1.0] + np.outer(lengths, [1.0, 0.0, 0.0]), np.zeros((M, 3)), np.zeros((M, 3)))
    gauge = a_set("length", lengths, positions=X * [0.0, 1.0, 1.0], labels={"artefact": np.full(M, "gauge")}, to=to)
    warm = {"machine_C": np.array([24.0]), "gauge_C": np.array([22.5])}
    environment = Environment(
        "room", warm, machine=Expansion(STEEL, material="machine"), artefact=Expansion(GLASS, material="gauge")
    )
    found = reduced(campaign(gauge, environment)).sets[0].readings[:, 0]
    np.testing.assert_allclose(found, lengths * (1.0 + 2.5 * GLASS) / (1.0 + 4.0 * STEEL), rtol=1e-14)
    own = replace(gauge, temperature=np.full(M, 22.5))
    environment = Environment(
        "room", {"machine_C": np.array([24.0])}, artefact=Expansion(GLASS, material="temperature")
    )
    found = reduced(campaign(own, environment)).sets[0].readings[:, 0]
    np.testing.assert_allclose(found, lengths * (1.0 + 2.5 * GLASS), rtol=1e-14)


def distances():
    rng = np.random.default_rng(4)
    q = rng.uniform((0, 0, -500), (1000, 600, 0), (M, 3))
    labels = {"station": np.full(M, "S"), "segment": np.where(np.arange(M) < M // 2, "1", "2")}
    path = np.linalg.norm(q - np.array([-300.0, -200.0, 100.0]), axis=1)
    dead = np.where(np.arange(M) < M // 2, 250.0, -700.0)
    own = a_set("distance", N * path + dead, positions=q, labels=labels, options={"relative": True})
    return own, path, dead


def test_distances_with_unknown_dead_paths():
    """Displayed: n path + constant. Reduced, path + another constant; no air acts on the constant, and it need not be told."""
    own, path, _ = distances()
    found = reduced(campaign(own, day(), stations=(Station("S"),))).sets[0].readings[:, 0]
    for segment in ("1", "2"):
        rows = own.labels["segment"] == segment
        assert np.ptp((found - path)[rows]) < 2.0 * SAME * 2000.0
    divided = own.readings[:, 0] / N - path  # what dividing all of the reading would leave
    assert np.ptp(divided[own.labels["segment"] == "2"]) > 1e-3


def test_undone_and_done_again_is_the_same():
    own = distances()[0]
    given = campaign(
        own, day(machine=Expansion(STEEL, 1e-6, "temperature"), u={"temperature": 0.1}), stations=(Station("S"),)
    )
    given = replace(given, sets=(replace(own, temperature=np.linspace(19.0, 24.0, M)),))
    once = reduced(given)
    assert reduced(once) is once or reduced(once).sets[0].readings is once.sets[0].readings
    back = as_read(once).sets[0]
    np.testing.assert_array_equal(back.readings, own.readings)
    assert back.effects == () and back.as_read is None and len(once.sets[0].effects) == 1
    # the inverse: what an instrument shows in that air; its dead paths may be any
    starts = {("dead path", "S", "1"): 250.0, ("dead path", "S", "2"): -700.0}
    shown = in_air(replace(given, sets=once.sets), starts)
    np.testing.assert_allclose(reduced(shown, starts).sets[0].readings, once.sets[0].readings, rtol=0, atol=1e-9)


def test_ranges_are_scaled_and_angles_are_not():
    q = np.random.default_rng(4).uniform((0, 0, -500), (1000, 600, 0), (M, 3))
    polar = np.stack([N * 1500.0, np.full(M, 30.0), np.full(M, -10.0)], axis=1)
    own = a_set("polar", polar, positions=q, labels={"station": np.full(M, "S")})
    found = reduced(campaign(own, day(), stations=(Station("S"),))).sets[0].readings
    np.testing.assert_allclose(found[:, 0], 1500.0, rtol=SAME)
    np.testing.assert_array_equal(found[:, 1:], polar[:, 1:])
    wrong = campaign(own, day(dead_path=100.0), stations=(Station("S"),))
    with pytest.raises(InputError, match="dead_path is for single lengths"):
        reduced(wrong)


def test_the_u_of_a_log_becomes_effects():
    """0.1 K is 0.096 µm/m and 0.3 hPa 0.080 µm/m (n - 1 over T, and over p), humidity 5 % some 0.04 µm/m."""
    u = {"air_temperature_C": 0.1, "pressure_hPa": 0.3, "humidity_percent": 5.0, "bed_C": 0.2}
    environment = day(log=log(bed_C=lambda t: 21.0 + 0.0 * t), u=u, machine=Expansion(STEEL, 1e-6))
    air_effect, bed = reduced(campaign(laser(np.zeros(M)), environment)).sets[0].effects
    assert (air_effect.type, air_effect.per) == ("scale", "campaign")
    expected = np.sqrt((265e-6 * 0.1 / 295.0) ** 2 + (265e-6 * 0.3 / 1002.0) ** 2 + (5 * 1.0e-8) ** 2 + (2e-8) ** 2)
    assert air_effect.u == pytest.approx(expected, rel=0.05)
    assert (bed.type, bed.u, bed.options["expansion"], bed.options["u_expansion"]) == ("temperature", 0.2, STEEL, 1e-6)


def test_what_is_stated_twice_is_named():
    from volid.campaign import Effect

    u = {"air_temperature_C": 0.1, "bed_C": 0.2}
    environment = day(log=log(bed_C=lambda t: 21.0 + 0.0 * t), u=u, machine=Expansion(STEEL))
    stated = Effect("bed", "temperature", 0.5, "set", {"expansion": STEEL}), Effect("laser", "scale", 1e-7, "set")
    own = replace(laser(np.zeros(M)), effects=stated)
    found = reduced(campaign(own, environment))
    assert [e.name for e in found.sets[0].effects] == ["bed", "laser", "air of environment day"]
    assert "counts besides it" in found.warnings[0] and "counts alone" in found.warnings[1]


def test_a_set_in_light_that_no_environment_holds_for_is_named():
    own = replace(laser(np.zeros(M)), name="other", time=None)
    both = Campaign(THREE, sets=(laser(np.zeros(M)), own), environments=(day(),))
    (said,) = remarks_on(both)
    assert "set 'other'" in said and "no time" in said
    assert reduced(both).sets[1].as_read is None


def test_sets_that_are_not_reduced_to_20_degrees_beside_others_are_named():
    warm = day(log={"bed_C": np.array([24.0])}, corrected=None, machine=Expansion(STEEL), sets=("own",))
    other = replace(laser(np.zeros(M)), name="other")
    (said,) = remarks_on(Campaign(THREE, sets=(laser(np.zeros(M)), other), environments=(warm,)))
    assert said.startswith("set 'other': its lengths are not at 20 °C, as those of own are")


def test_ranges_by_the_phase_index_are_named():
    q = np.random.default_rng(4).uniform((0, 0, -500), (1000, 600, 0), (M, 3))
    own = a_set("polar", np.tile([1500.0, 30.0, -10.0], (M, 1)), positions=q, labels={"station": np.full(M, "S")})
    (said,) = remarks_on(campaign(own, day(), stations=(Station("S"),)))
    assert "state group = true" in said
    assert remarks_on(campaign(own, day(group=True, wavelength=780.0), stations=(Station("S"),))) == ()


def test_a_plan_stays_a_plan():
    plan = campaign(laser(np.full(M, np.nan)), day())
    assert reduced(plan) is plan


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"log": {**log(), "pressure_hPa": log()["pressure_hPa"] / 10.0}}, "entry 1: pressure_hPa is 100.4.*seems to be in kPa"),
        ({"log": {**log(), "pressure_hPa": log()["pressure_hPa"] * 100.0}}, "seems to be in Pa"),
        ({"log": {**log(), "air_temperature_C": log()["air_temperature_C"] + 273.15}}, "seems to be in kelvin"),
        ({"log": {**log(), "air_temperature_C": log()["air_temperature_C"] * 1.8 + 32.0}}, "seems to be in °F"),
        ({"log": {**log(), "humidity_percent": log()["humidity_percent"] / 100.0}}, "seems to be a fraction"),
        ({"log": {**log(), "time": log()["time"][::-1]}}, "entry 2: time goes back by 300 s"),
        ({"log": {**log(), "wind": log()["time"]}}, "column 'wind' is unknown"),
        ({"log": {k: v for k, v in log().items() if k != "humidity_percent"}}, "there is no humidity_percent"),
        ({"log": {**log(), "time": log()["time"] + 3600.0}}, "row 1 and 4 more: read 3600 s before the first entry"),
        ({"log": {**log(), "time": log()["time"] * 0.5}}, "after the last entry.*one clock for both"),
        ({"log": log(7200.0)}, "no entry for 7200 s around it.*longest_gap"),
        ({"corrected": None}, "corrected is missing"),
        ({"corrected": True, "at": {"refractive_index": 1.00027}}, "at states a correction to be undone"),
        ({"at": {"refractive_index": 271.0}}, "refractive_index is 271"),
        ({"at": {"air_temperature_C": 20.0}}, "at: has air_temperature_C; expected"),
        ({"wavelength": 0.633}, "wavelength is 0.633; expected 300"),
        ({"u": {"air_temperature_K": 0.1}}, "u states air_temperature_K"),
        ({"machine": Expansion(11.5)}, "machine: expansion is 11.5; expected 1/K"),
        ({"machine": Expansion(STEEL)}, "no material is named, and the log has no temperature"),
        ({"log": log(bed_C=lambda t: 0 * t + 20.0), "machine": Expansion(STEEL, 1e-6)}, "not that of bed_C; add u"),
        ({"sets": ("own", "volume")}, "sets names 'volume'; the sets are own"),
    ],
)  # fmt: skip
def test_what_cannot_be_right_is_refused(keys, said):
    with pytest.raises(InputError, match=said):
        reduced(campaign(laser(np.zeros(M)), day(**keys)))


def test_no_entry_holds_longer_than_stated():
    short = {**log(), "time": log()["time"] * 0.99}
    with pytest.raises(InputError, match="after the last entry"):
        reduced(campaign(laser(np.zeros(M)), day(log=short)))
    assert reduced(campaign(laser(np.zeros(M)), day(log=short, beyond=600.0))).sets[0].as_read is not None
    assert reduced(campaign(laser(np.zeros(M)), day(log=log(7200.0), longest_gap=7200.0))).sets[0].as_read is not None


def test_a_gap_of_one_column_is_a_gap():
    pressure = log()["pressure_hPa"].copy()
    pressure[10:40] = np.nan  # two and a half hours
    with pytest.raises(InputError, match="pressure_hPa has no entry for 9300 s"):
        reduced(campaign(laser(np.zeros(M)), day(log={**log(), "pressure_hPa": pressure})))


def test_sets_that_are_no_lengths_are_refused():
    own = replace(laser(np.zeros(M)), options={})
    with pytest.raises(InputError, match=r"no lengths in light.*interferometer = true"):
        reduced(campaign(own, day(sets=("own",))))
    with pytest.raises(InputError, match="there is no time"):
        reduced(campaign(replace(laser(np.zeros(M)), time=None), day(sets=("own",))))
    both = campaign(laser(np.zeros(M)), day(), replace(day(), name="other"))
    with pytest.raises(InputError, match="holds for this set too"):
        reduced(both)


def test_light_is_what_counts_wavelengths():
    assert KINDS["distance"].lengths_of(distances()[0]) == LIGHT
    bar = replace(distances()[0], options={"relative": False, "calibrated_u": 1e-3})
    assert KINDS["distance"].lengths_of(bar) == "artefact"
    assert KINDS["projection"].lengths_of(bar) == LIGHT


@pytest.mark.parametrize("zero", [0.0, 40.0])
def test_displacements_along_a_beam_with_a_dead_path(zero):
    """Displayed: n (D + s) - n0 D, and what the display showed at first; the line counts from a point of its own."""
    dead, deviation = 400.0, 5e-3 * np.sin(X[:, 0] / 150.0)
    for along, side in (
        ([1.0, 0.0, 0.0], 1.0),
        ([-1.0, 0.0, 0.0], -1.0),
    ):  # the display counts up, or down from the start
        way = side * (X[:, 0] + deviation)
        path = dead + (way - way[0])
        shown = N * path - N[0] * dead + zero
        lines = {"D": {"along": along, "point": [500.0, 300.0, -250.0]}}
        labels = {"line": np.full(M, "D"), "run": np.full(M, "1"), "segment": np.full(M, "1")}
        own = a_set("projection", shown, labels=labels, options={**KINDS["projection"].options, "lines": lines})
        found = reduced(campaign(own, day(dead_path=dead))).sets[0]
        left = found.readings[:, 0] - way
        assert np.ptp(shown - way) > 0.2, "270 µm/m"
        assert np.ptp(left) < 2 * SAME * 1500.0
