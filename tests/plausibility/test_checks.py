"""Checks before a fit: mistakes are named, legitimate campaigns of any shape pass, repeated readings are compared."""

from dataclasses import replace

import numpy as np
import pytest
from support.campaign_files import MACHINE, csv_text, grid, level_rows, volume_rows, write_files
from support.plain_distances import STATION, VOLUME, distances, moved
from support.work import calls

from volid.campaign import Campaign, Station
from volid.exceptions import InputError
from volid.io import parse_machine, read_manifest
from volid.plausibility.checks import check_campaign, closures

ANGLES = np.linspace(0.0, 2 * np.pi, 100, endpoint=False)
CIRCLE = np.array([500.0, 300.0, -200.0]) + 150.0 * np.stack([np.cos(ANGLES), np.sin(ANGLES), 0 * ANGLES], axis=1)
CENTRE = (500.0, 300.0, -200.0)


def levels(tmp_path, **columns) -> Campaign:
    return read_manifest(write_files(tmp_path, levels=csv_text(level_rows() | columns)))


# -------------------------------------------------------------------------------------------- good and odd data


def test_a_clean_campaign_has_no_warning(tmp_path):
    assert check_campaign(read_manifest(write_files(tmp_path))) == ()


def test_positions_outside_the_travel_are_named(tmp_path):
    rows = volume_rows()
    rows["X"][0], rows["X"][7] = -2.0, 1001.5
    rows["Z"][0:27:3] = [-500.001] * 9
    warnings = check_campaign(read_manifest(write_files(tmp_path, volume=csv_text(rows))))
    assert len(warnings) == 2
    assert warnings[0].endswith(
        "volume.csv, rows 2, 9: X = -2 … 1001.5 mm lies outside the travel 0 … 1000; "
        "the error functions are not determined there"
    )
    assert "volume.csv, rows 2, 5, 8, 11, 14 and 4 more: Z = -500.001 … -500.001 mm lies outside" in warnings[1]


def test_ends_of_the_travel_are_inside(tmp_path):
    rows = volume_rows()
    rows["X"][0] = -1e-10  # rounding, not a position
    assert check_campaign(read_manifest(write_files(tmp_path, volume=csv_text(rows)))) == ()


def test_a_plan_cannot_be_fitted(tmp_path):
    text = csv_text({k: v for k, v in volume_rows().items() if k != "distance"})
    with pytest.raises(InputError, match=r"volume\.csv: the readings are missing"):
        check_campaign(read_manifest(write_files(tmp_path, volume=text), plan=True))


def test_no_sets_at_all():
    with pytest.raises(InputError, match="campaign: there are no readings"):
        check_campaign(replace(distances(VOLUME), sets=()))


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("readings", np.nan, r"volume\.csv, row 5: readings hold no finite number"),
        ("positions", np.inf, r"volume\.csv, row 5: positions hold no finite number"),
        ("tool", np.nan, r"volume\.csv, row 5: tool hold no finite number"),
        ("u", 0.0, r"volume\.csv, row 5: u is 0; expected a standard uncertainty > 0"),
        ("u", -0.001, r"volume\.csv, row 5: u is -0.001; expected a standard uncertainty > 0"),
    ],
)
def test_numbers_made_in_python(name, value, message):
    campaign = distances(VOLUME)
    array = getattr(campaign.sets[0], name).copy()
    array[3, 0] = value
    with pytest.raises(InputError, match=message):
        check_campaign(replace(campaign, sets=(replace(campaign.sets[0], **{name: array}),)))


def test_unknown_component(tmp_path):
    with pytest.raises(InputError, match=r"levels\.csv, row 3: component is 'EAX'; expected one of X, Y, Z, A, B, C"):
        check_campaign(levels(tmp_path, component=["A", "EAX"] + ["A"] * 8))


# --------------------------------------------------------------------------------------------------- unit slips


@pytest.mark.parametrize("approximate", [STATION, (-120.0, 60.0, -690.0), None])
@pytest.mark.parametrize(("scale", "unit"), [(1e-3, "metres"), (1e3, "micrometres"), (1 / 25.4, "inches")])
def test_distances_in_another_unit(approximate, scale, unit):
    message = rf"volume\.csv, set 'volume': distances seem to be in {unit}, .*; expected mm"
    for relative in (True, False):
        with pytest.raises(InputError, match=message):
            check_campaign(distances(VOLUME, approximate=approximate, scale=scale, relative=relative))


@pytest.mark.parametrize("approximate", [STATION, None])
@pytest.mark.parametrize(("scale", "message"), [(1e-3, "in metres, 1000"), (1 / 25.4, r"in inches, 25\.4")])
def test_positions_in_another_unit(approximate, scale, message):
    with pytest.raises(InputError, match=rf"set 'volume': (axis positions|distances) seem to be {message} times too"):
        check_campaign(moved(distances(VOLUME, approximate=approximate), scale))


def test_positions_in_metres_on_one_line():
    line = np.linspace(0, 1, 30)[:, None] * np.array([1000.0, 600.0, -500.0])
    with pytest.raises(InputError, match="axis positions seem to be in metres"):
        check_campaign(moved(distances(line, approximate=None), 1e-3))


def test_a_ball_bar_in_metres():
    with pytest.raises(InputError, match="distances seem to be in metres"):
        check_campaign(distances(CIRCLE, CENTRE, approximate=CENTRE, scale=1e-3, relative=False))


def test_one_station_of_many_does_not_condemn_a_set():
    good, bad = distances(VOLUME), distances(VOLUME, scale=1e-3)
    names = ("S", "S2", "S3")
    sets = [(bad if name == "S3" else good).sets[0] for name in names]
    joined = replace(
        good.sets[0],
        labels={"station": np.repeat(names, len(VOLUME)), "segment": np.full(3 * len(VOLUME), "1")},
        rows=None,
        **{n: np.vstack([getattr(s, n) for s in sets]) for n in ("positions", "directions", "tool", "readings", "u")},
    )
    stations = tuple(Station(name, position=STATION) for name in names)
    assert check_campaign(replace(good, stations=stations, sets=(joined,))) == ()


SHAPES = {
    "volume": VOLUME,
    "a few points": VOLUME[:9],
    "plane": VOLUME * [1, 1, 0],
    "flat box": VOLUME * [1, 1, 0.05],
    "line": VOLUME * [1, 0, 0],
    "small box": VOLUME * 0.004 + [500, 300, -250],
    "circle": CIRCLE,
    "two points": VOLUME[:2],
    "one point": np.tile(VOLUME[:1], (5, 1)),
}


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("station", [STATION, (500.0, 300.0, -2600.0), (500.0, -3000.0, -250.0), CENTRE])
@pytest.mark.parametrize("relative", [True, False])
def test_legitimate_distances_of_any_shape_pass(shape, station, relative):
    guesses = (None, tuple(np.add(station, (3.0, -2.0, 1.0))), tuple(np.add(station, (300.0, -200.0, 250.0))))
    for guess in guesses:
        check_campaign(distances(SHAPES[shape], station, approximate=guess, relative=relative))


@pytest.mark.parametrize("offset", [0.01, 0.05, 2.0])
@pytest.mark.parametrize("guess", [None, (501.0, 300.0, -200.0), (550.0, 300.0, -200.0)])
@pytest.mark.parametrize("relative", [True, False])
def test_a_ball_bar_off_centre_passes(offset, guess, relative):
    centre = (CENTRE[0] + offset, CENTRE[1], CENTRE[2])
    assert check_campaign(distances(CIRCLE, centre, approximate=guess, relative=relative)) == ()


@pytest.mark.parametrize("approximate", [STATION, None])
def test_broken_beams_and_outliers_are_no_unit_slip(approximate):
    random = np.random.default_rng(3)
    jumps = np.repeat([0.0, 12.0, -40.0], 40)
    outliers = np.where(random.random(120) < 0.2, random.normal(0.0, 300.0, 120), 0.0)
    for extra in (jumps, outliers, random.normal(0.0, 100.0, 120)):
        assert check_campaign(distances(VOLUME, approximate=approximate, extra=extra)) == ()


@pytest.mark.parametrize(("body", "seen"), [("bed", [0, 1, 1]), ("X", [1, 1, 1]), ("workpiece", [1, 1, 1])])
def test_station_on_another_body(body, seen):
    machine = parse_machine(MACHINE.replace("w b X Y Z t", "w X' b Y Z t"), "machine.toml")
    campaign = distances(VOLUME * seen)  # seen from the bed, X' does not move the tool; seen from its table it does
    campaign = replace(campaign, machine=machine, stations=(Station("S", body, STATION),))
    readings = replace(campaign.sets[0], positions=VOLUME)
    assert check_campaign(replace(campaign, sets=(readings,))) == ()
    with pytest.raises(InputError, match="distances seem to be in metres"):
        check_campaign(replace(campaign, sets=(replace(readings, readings=readings.readings * 1e-3),)))


def test_components_in_micrometres_or_microradians(tmp_path):
    micro = [1e6 * v for v in level_rows()["value"]]
    with pytest.raises(
        InputError, match=r"levels\.csv, row \d+: value .* 1 mrad .* in degrees, µrad or arcseconds\? Expected rad"
    ):
        check_campaign(levels(tmp_path / "a", value=micro))
    with pytest.raises(InputError, match=r"levels\.csv, row \d+: value .* 1 mm .* is it in µm\? Expected mm"):
        check_campaign(levels(tmp_path / "b", value=micro, component=["Y"] * 10))


def test_an_offset_of_a_component_is_no_slip(tmp_path):
    offset = [v + 5.0 for v in level_rows()["value"]]  # an indicator that was not zeroed
    assert check_campaign(levels(tmp_path, value=offset, component=["Y"] * 10)) == ()


def test_component_positions_in_metres_are_odd(tmp_path):
    small = {axis: [v / 1000 for v in level_rows()[axis]] for axis in "XYZ"}
    warnings = check_campaign(levels(tmp_path, **small))
    assert len(warnings) == 1 and "set 'levels': all positions lie within 2 % of the travels around zero" in warnings[0]


# --------------------------------------------------------------------------------------------------- duplicates


def with_repeats(tmp_path, rows: list[int], **changes) -> Campaign:
    """volume.csv with some rows once more at the end; `changes` are cells of the repeated rows, or whole columns."""
    columns = volume_rows()
    for name, cells in columns.items():
        cells += changes.get(name, [cells[i] for i in rows])
    columns |= {name: cells for name, cells in changes.items() if name not in columns}
    return read_manifest(write_files(tmp_path, volume=csv_text(columns)))


def test_duplicated_rows_are_an_error(tmp_path):
    with pytest.raises(
        InputError, match=r"volume\.csv, rows 6 and 56: the same row twice; remove one, or, .*`time` col"
    ):
        check_campaign(with_repeats(tmp_path / "a", [4]))
    with pytest.raises(
        InputError, match=r"volume\.csv, rows 2 and 56: the same row twice, and 53 more such rows; remove"
    ):
        check_campaign(with_repeats(tmp_path / "b", list(range(54))))


def test_a_path_that_ends_where_it_began_is_no_duplicate(tmp_path):
    """A ball bar on a circle reads the same at the end as at the beginning, to the digits of the instrument."""
    [warning] = check_campaign(with_repeats(tmp_path / "a", [0]))
    assert "volume.csv, row 56: equal to an earlier row; taken as repeated readings" in warning
    with pytest.raises(InputError, match=r"volume\.csv, rows 6 and 56: the same row twice; remove one"):
        check_campaign(with_repeats(tmp_path / "b", [4, 0]))


def test_a_duplicated_row_among_true_repeats_is_an_error(tmp_path):
    noise = np.random.default_rng(6).normal(0, 3e-4, 10)
    repeated = [volume_rows()["distance"][i] + noise[i] for i in range(10)]
    repeated[4] = volume_rows()["distance"][4]
    with pytest.raises(InputError, match=r"volume\.csv, rows 6 and 60: the same row twice"):
        check_campaign(with_repeats(tmp_path, list(range(10)), distance=repeated))


def test_a_set_that_repeats_another_one_is_an_error(tmp_path):
    """The same file twice, a copy under other names, a part of it; not another measurement at the same positions."""
    campaign = with_repeats(tmp_path, [])
    one = campaign.sets[0]
    labels = {**one.labels, "segment": np.full(len(one), "another")}
    for copy in (one, replace(one, labels=labels, u=2.0 * one.u), one.rows_of(np.arange(30, 5, -1))):
        with pytest.raises(InputError, match=r"set 'again': \d+ of its \d+ rows are those of .*count twice"):
            check_campaign(replace(campaign, sets=(one, replace(copy, name="again"))))
    noise = 3e-4 * np.random.default_rng(0).standard_normal(one.readings.shape)
    later = replace(one, time=np.arange(len(one)) + 1e4)
    for other in (replace(one, readings=one.readings + noise), later):
        sets = replace(one, time=np.arange(len(one)) + 0.0), replace(other, name="again")
        assert check_campaign(replace(campaign, sets=sets)) == ()


def test_rows_that_differ_in_anything_are_no_duplicates(tmp_path):
    q = volume_rows()
    assert check_campaign(with_repeats(tmp_path / "a", [4], distance=[q["distance"][4] + 1e-6])) == ()
    assert check_campaign(with_repeats(tmp_path / "b", [4], segment=["2"])) == ()
    assert check_campaign(with_repeats(tmp_path / "c", [4], time=list(range(55)))) == ()
    with pytest.raises(InputError, match="the same row twice"):
        check_campaign(with_repeats(tmp_path / "d", [4], time=[1.0] * 55))


@pytest.mark.parametrize("step", [1e-6, 0.7318e-6])
def test_zeroed_or_coarse_readings_that_repeat_are_only_a_warning(tmp_path, step):
    runs = {name: cells * 5 for name, cells in level_rows().items() if name != "time"}
    noise = np.random.default_rng(4).normal(0, 1e-6, 50)
    runs["value"] = (np.round((np.array(runs["value"]) + noise) / step) * step).tolist()
    runs["value"][::10] = [0.0] * 5
    warnings = check_campaign(read_manifest(write_files(tmp_path, levels=csv_text(runs))))
    assert len(warnings) == 1
    assert "levels.csv, rows 12, " in warnings[0]
    assert warnings[0].endswith("equal to an earlier row; taken as repeated readings")


# ----------------------------------------------------------------------------------------------------- closures


def test_closures_are_recognised(tmp_path):
    first = volume_rows()["distance"]
    repeated = [first[i] + drift for i, drift in ((0, 0.001), (5, -0.003), (30, 0.002))]
    campaign = with_repeats(tmp_path, [0, 5, 30], distance=repeated)
    (closure,) = closures(campaign)
    assert (closure.set, closure.reading, closure.n, closure.rows) == ("volume", "distance", 3, (7, 57))
    assert closure.max == pytest.approx(-0.003, abs=1e-12)
    assert closure.rms == pytest.approx(np.sqrt((1 + 9 + 4) / 3) * 1e-3, rel=1e-9)
    u = np.sqrt(2) * np.hypot(0.0003, 3e-7 * np.array([first[0], first[5], first[30]]))
    assert closure.u == pytest.approx(np.sqrt(np.mean(u**2)), rel=1e-5)
    ratio = np.array([0.001, -0.003, 0.002]) / u
    assert closure.rms_ratio == pytest.approx(np.sqrt(np.mean(ratio**2)), rel=1e-5)
    assert closure.max_ratio == pytest.approx(ratio[1], rel=1e-5)


def test_no_repeat_no_closure(tmp_path):
    assert closures(read_manifest(write_files(tmp_path))) == ()  # levels: same places, opposite directions


def test_what_counts_as_the_same_place(tmp_path):
    q = volume_rows()
    near, far = [q["X"][4] + 0.0009], [q["X"][4] + 0.0011]
    d = [q["distance"][4] + 0.001]
    assert closures(with_repeats(tmp_path / "a", [4], distance=d, X=near))[0].n == 1
    assert closures(with_repeats(tmp_path / "b", [4], distance=d, X=far)) == ()
    assert closures(with_repeats(tmp_path / "c", [4], distance=d, segment=["2"])) == ()
    assert closures(with_repeats(tmp_path / "d", [4], distance=d, station=["S2"]))[0].rows == (33, 56)  # S2's own
    assert closures(with_repeats(tmp_path / "e", [4], distance=d, X_dir=[1] * 54 + [-1])) == ()


def test_densely_spaced_positions_are_not_chained_into_one_place():
    q = np.tile([0.0, 300.0, -250.0], (2001, 1))
    q[:, 0] = np.arange(2001) * 0.0008
    assert sum(c.n for c in closures(distances(q))) == 1  # only the neighbour of the first is within 1 µm of it


def test_drift_follows_the_time_where_there_is_one(tmp_path):
    d = [volume_rows()["distance"][4] + 0.001]
    assert closures(with_repeats(tmp_path / "a", [4], distance=d))[0].max == pytest.approx(0.001)
    times = [float(100 + i) for i in range(54)] + [5.0]
    assert closures(with_repeats(tmp_path / "b", [4], distance=d, time=times))[0].max == pytest.approx(-0.001)
    assert closures(with_repeats(tmp_path / "c", [4], distance=d, time=["", *times[1:]]))[0].max == pytest.approx(0.001)


def test_large_campaigns_are_not_checked_row_by_row():
    q = np.random.default_rng(5).uniform((0, 0, -500), (1000, 600, 0), (100_000, 3))
    campaign = distances(q)
    assert check_campaign(campaign) == () and closures(campaign) == ()
    assert (
        calls(lambda: (check_campaign(campaign), closures(campaign))) < 100_000
    )  # not row by row, let alone pair by pair


def test_grid_helper_covers_the_travels():
    assert grid().min(axis=0).tolist() == [0.0, 0.0, -500.0] and grid().max(axis=0).tolist() == [1000.0, 600.0, 0.0]
