"""Lists of the Fanuc pitch memory: written out by hand from the manual's description and its examples."""

import numpy as np
import pytest
from support.control_cases import MACHINE, error_table, job, pitch, written

import volid
from volid.compensation.package import Compensation
from volid.compensation.tables.error_table import ITSELF, ErrorTable
from volid.controllers import CONTROLS
from volid.controllers.axis_values import by_axis
from volid.controllers.base import options_of
from volid.exceptions import InputError

FANUC = CONTROLS["fanuc-pitch"]
TRUNNION = volid.load_machine("models/wCAYXbZt_trunnion.toml")
REACH = np.array([-400.0 + 50.0 * i for i in range(18)])


def rows(text: str) -> list[list[str]]:
    return [line.split(",") for line in text.splitlines() if not line.startswith("#")][1:]


def stated(sign: str, **options):
    return {**options_of(FANUC.declaration, options), "sign": sign}


def values_of(files, axis: str, direction: str = "both") -> dict[int, int]:
    return {int(r[0]): int(r[5]) for r in rows(files["fanuc_pitch.csv"]) if r[1] == axis and r[2] == direction}


def settings_of(files, axis: str) -> dict[str, float]:
    return {r[0]: float(r[2]) for r in rows(files["fanuc_parameters.csv"]) if r[1] == axis}


def put_out(values: dict[int, int], reference: int, k: int) -> int:
    """What the control has put out on its way from the reference position over k sections, one after the other."""
    total, n = 0, reference
    for _ in range(abs(k)):
        if k > 0:
            n += 1
            total += values[n]
        else:
            total -= values[n]
            n -= 1
    return total


def test_the_example_of_the_manual():
    """Numbers 33 … 49, reference 40, every 50 mm, and the curve that the manual draws: highest at -250 mm with +4."""
    given = dict(zip(range(33, 50), [2, 1, 1, -2, 0, -1, 0, -1, 2, 1, 0, -1, -1, -2, 0, 1, 2], strict=True))
    files = {
        "parameters.csv": "parameter,axis,value\n3620,X,40\n3621,X,33\n3622,X,49\n3623,X,1\n3624,X,50\n",
        "pitch.csv": "number,value\n" + "".join(f"{n},{v}\n" for n, v in given.items()),
    }
    (table,) = FANUC.read(files, MACHINE, stated("compensation")).axis_tables
    np.testing.assert_allclose(table.positions, REACH)
    drawn = [0, 2, 3, 4, 2, 2, 1, 1, 0, 2, 3, 3, 2, 1, -1, -1, 0, 2]
    np.testing.assert_allclose(table.forward, -0.001 * np.array(drawn), atol=1e-12)
    np.testing.assert_array_equal(table.forward, table.reverse)


def test_values_and_parameters():
    """In the mean X is 1, 11.5 and -2.5 µm off: against 0 at the reference 10.5 and -3.5. Y: 0, 6 and 18."""
    files = written("fanuc-pitch", pitch(), "compensation", magnification="Y=2", detection_unit="X=0.0005,Y=0.001")
    assert values_of(files, "Y") == {0: 0, 1: -3, 2: -6}
    assert values_of(files, "X") == {3: 0, 4: -21, 5: 28}
    assert settings_of(files, "Y") | {
        "3620": 0,
        "3621": 0,
        "3622": 2,
        "3623": 2,
        "3624": 300,
        "1851": 0,
    } == settings_of(files, "Y")
    # E(+) - E(-) of X is -2, -3, -3 µm: it lags behind after each reversal, by 2.67 µm in the mean
    assert settings_of(files, "X") | {
        "3620": 3,
        "3621": 3,
        "3622": 5,
        "3623": 1,
        "3624": 500,
        "1851": 5,
    } == settings_of(files, "X")


def test_the_reference_position_within_the_travel():
    files = written(
        "fanuc-pitch", pitch(), "error", reference_position="X=500,Y=600", interval="X=250", first_number="10"
    )
    # Y: -18 µm at 0 and -12 at 300, seen from 600; it takes two sections below and the numbers 10, 11
    assert values_of(files, "Y") == {10: 6, 11: 12} and settings_of(files, "Y")["3620"] == 11
    x = settings_of(files, "X")
    assert (x["3621"], x["3620"], x["3622"]) == (12, 13, 15)
    assert [put_out(values_of(files, "X"), 13, k) for k in (-2, -1, 0, 1, 2)] in (
        [-10, -5, 0, -7, -14],
        [-11, -5, 0, -7, -14],
    )


def test_two_tables_begin_at_3627():
    files = written("fanuc-pitch", pitch(), "error", bidirectional="1")
    assert values_of(files, "X", "+") == {6: 0, 7: 10, 8: -14}
    # in -: 2, 13, -1 µm against 0 in + at the reference
    assert values_of(files, "X", "-") == {9: 0, 10: 11, 11: -14}
    x = settings_of(files, "X")
    assert (x["3605#0"], x["3621"], x["3626"], x["3627"], x["1851"]) == (1, 6, 9, 2, 0)


def test_a_return_in_minus_takes_that_direction_as_zero():
    files = written("fanuc-pitch", pitch(), "error", bidirectional="1", reference_return="-")
    assert settings_of(files, "X")["3627"] == -2
    (table,) = [
        t for t in FANUC.read(files, MACHINE, stated("error", bidirectional="1")).axis_tables if t.output == "X"
    ]
    np.testing.assert_allclose(table.reverse, [0.0, 0.0, 0.011, -0.003], atol=1e-12)
    np.testing.assert_allclose(table.forward, [-0.002, -0.002, 0.008, -0.006], atol=1e-12)


@pytest.mark.parametrize("sign", ["error", "compensation"])
@pytest.mark.parametrize("both", ["0", "1"])
@pytest.mark.parametrize("home", ["+", "-"])
def test_what_the_control_puts_out_is_the_table(sign, both, home):
    """The memory played through section by section, at rough tables with the reference anywhere."""
    rng = np.random.default_rng(12)
    for at in (0.0, 1000.0, 400.0, -200.0, 1300.0):
        x, up = np.linspace(0.0, 1000.0, 11), rng.normal(scale=0.02, size=11)
        lost = rng.normal(scale=0.004) if both == "0" else rng.normal(scale=0.004, size=11)
        made = Compensation(("L-POS",), (error_table("EXX", x, up, up - lost),), ())
        options = {"reference_position": str(at), "bidirectional": both, "reference_return": home}
        files = written("fanuc-pitch", made, sign, **options)
        setting, factor = settings_of(files, "X"), 1.0 if sign == "error" else -1.0
        curves = {w: values_of(files, "X", w) for w in (("+", "-") if both == "1" else ("both",))}
        (back,) = FANUC.read(files, MACHINE, stated(sign, **options)).axis_tables
        for i, q in enumerate(x):
            k = round((q - at) / 100.0)
            for w, exact, held in (("+", up, back.forward), ("-", up - lost, back.reverse)):
                n = int(setting["3620"] + (setting["3626"] - setting["3621"] if both == "1" and w == "-" else 0))
                error = factor * put_out(curves["both" if both == "0" else w], n, k)
                if w != home:
                    error += factor * setting.get("3627", 0.0)
                    error += setting["1851"] * (-1.0 if w == "+" else 1.0)
                r = int(np.argmin(np.abs(x - at)))  # beyond the travel its end values are held
                zero = (up if home == "+" else up - lost)[r]
                allowed = 0.0005 if both == "1" or w == home else 0.001  # both the table and 1851 are rounded
                assert abs(0.001 * error - (exact[i] - zero)) <= allowed + 1e-9
                there = float(np.interp(q, back.positions, held))
                assert there == pytest.approx(0.001 * error, abs=1e-9)


def rotary(values) -> Compensation:
    x, up = np.linspace(0.0, 360.0, len(values)), np.deg2rad(values)
    table = ErrorTable("R-POS", "ECC", x, up, up, np.zeros((len(x), 2)), x > 1e9, ITSELF, 0.0, period=360.0)
    return Compensation(("R-POS",), (table,), ())


def test_a_turn_adds_up_to_nothing_and_the_first_number_repeats_the_last():
    """As in the manual's second example: sections of 45°, the reference at number 60."""
    made = rotary([0.0, 0.001, 0.003, 0.002, 0.0, -0.002, -0.003, -0.001, 0.0])
    files = _rotary_files(made)
    values = values_of(files, "C")
    assert values == {60: 1, 61: 1, 62: 2, 63: -1, 64: -2, 65: -2, 66: -1, 67: 2, 68: 1}
    assert sum(v for n, v in values.items() if n > 60) == 0
    setting = settings_of(files, "C")
    assert (setting["3620"], setting["3621"], setting["3622"], setting["3625"]) == (60, 60, 68, 360)


def _rotary_files(made, **options):
    asked = job("fanuc-pitch", made, "error", machine=TRUNNION, first_number="60", **options)
    return {f.name: f.content for f in FANUC.write(asked).files}


def test_a_turn_with_the_reference_elsewhere():
    made = rotary([0.0, 0.001, 0.003, 0.002, 0.0, -0.002, -0.003, -0.001, 0.0])
    files = _rotary_files(made, reference_position="90")
    (back,) = FANUC.read(files, TRUNNION, stated("error")).axis_tables
    found = back.of_argument(np.array([0.0, 45.0, 90.0, 135.0, 270.0, 360.0]), np.ones(6))
    np.testing.assert_allclose(np.rad2deg(found), [-0.003, -0.002, 0.0, -0.001, -0.006, -0.003], atol=1e-12)


def test_a_turn_with_a_table_for_each_direction():
    x, up = np.linspace(0.0, 360.0, 5), np.deg2rad([0.0, 0.004, 0.007, 0.001, 0.0])
    down = up + np.deg2rad([0.002, 0.003, 0.001, 0.002, 0.002])
    table = ErrorTable("R-POS", "ECC", x, up, down, np.zeros((5, 2)), x > 1e9, ITSELF, 0.0, period=360.0)
    made = Compensation(("R-POS",), (table,), ())
    files = _rotary_files(made, bidirectional="1")
    plus, minus = values_of(files, "C", "+"), values_of(files, "C", "-")
    assert plus == {60: -1, 61: 4, 62: 3, 63: -6, 64: -1} and minus == {65: -1, 66: 5, 67: 1, 68: -5, 69: -1}
    (back,) = FANUC.read(files, TRUNNION, stated("error")).axis_tables
    q = np.array([90.0, 180.0, 630.0, -90.0])
    np.testing.assert_allclose(np.rad2deg(back.of_argument(q, np.ones(4))), [0.004, 0.007, 0.001, 0.001], atol=1e-12)
    np.testing.assert_allclose(np.rad2deg(back.of_argument(q, -np.ones(4))), [0.007, 0.008, 0.003, 0.003], atol=1e-12)


def test_what_3627_means_beside_a_magnification_is_not_guessed():
    names = {"3605#0": 1, "3620": 0, "3621": 0, "3622": 1, "3623": 2, "3624": 50, "3626": 2, "3627": 4}
    files = {
        "parameters.csv": "parameter,axis,value\n" + "".join(f"{n},X,{v}\n" for n, v in names.items()),
        "pitch.csv": "number,value\n0,0\n1,5\n2,0\n3,5\n",
    }
    with pytest.raises(InputError, match="parameters of X: 3623 is 2 and 3627 4; public sources do not say"):
        FANUC.read(files, MACHINE, stated("error"))
    files["parameters.csv"] += "3620,X,0\n"
    with pytest.raises(InputError, match="line 10: parameter 3620 of X stands there a second time"):
        FANUC.read(files, MACHINE, stated("error"))


def test_a_turn_that_does_not_close_is_refused():
    with pytest.raises(InputError, match="table of C: its first and last value, one turn apart, differ by 3 steps"):
        _rotary_files(rotary([0.0, 0.001, 0.003]))


# Harja and Candra: incremental compensation of X in steps of 25 mm [µm], forward and reverse
PUBLISHED = (
    "0 0.751 1.488 1.467 0.962 1.056 2.622 0.352 1.726 2.162 0.514 2.227 1.786 2.099 1.688 2.104 2.634 0.904 1.715 2.486 -0.245",
    "-0.716 1.014 1.512 1.668 1.44 1.132 2.605 0.133 1.75 2.112 0.621 2.058 1.723 1.718 1.848 2.137 2.787 1.085 2.087 2.394 "
    "-0.251",
)


def published() -> tuple[Compensation, list[list[int]]]:
    """The deviations that the published increments remove, and the increments [nm]."""
    steps = [[round(1000 * float(v)) for v in line.split()] for line in PUBLISHED]
    up, down = (-1e-6 * np.cumsum(s) for s in steps)
    return Compensation(("L-POS",), (error_table("EXX", np.arange(21) * 25.0, up, down),), ()), steps


def test_published_increments_come_out_again():
    """In a detection unit of 1 nm, the values of both tables are those that were published, behind 0 and what 3627 says."""
    made, (up, down) = published()
    files = written("fanuc-pitch", made, "compensation", bidirectional="1", detection_unit="0.000001")
    assert list(values_of(files, "X", "+").values()) == up
    assert list(values_of(files, "X", "-").values()) == [0, *down[1:]]
    assert settings_of(files, "X")["3627"] == -716


def test_published_increments_in_whole_micrometres_stay_within_half_of_one():
    made, (up, _) = published()
    files = written("fanuc-pitch", made, "compensation", bidirectional="1")
    values = values_of(files, "X", "+")
    amounts = [put_out(values, int(settings_of(files, "X")["3620"]), k) for k in range(21)]
    assert np.abs(np.array(amounts) - np.cumsum(up) / 1000).max() <= 0.5
    assert np.abs(np.cumsum(np.rint(np.array(up) / 1000)) - np.cumsum(up) / 1000).max() > 0.5  # each rounded by itself


def test_lines_of_a_program_and_back():
    options = {"data_number": "10000"}
    files = written("fanuc-pitch", pitch(), "compensation", **options)
    assert files["fanuc_pitch.nc"].splitlines()[:4] == ["%", "N10000P0", "N10001P-6", "N10002P-12"]
    only = {n: c for n, c in files.items() if n != "fanuc_pitch.csv"}
    one, other = (FANUC.read(f, MACHINE, stated("compensation", **options)).axis_tables for f in (files, only))
    for a, b in zip(one, other, strict=True):
        np.testing.assert_array_equal(a.forward, b.forward)


def test_a_limit_carries_and_says_so():
    made = Compensation(("L-POS",), (error_table("EXX", [0, 10, 20, 30], [0.0, 0.010, 0.011, 0.011]),), ())
    done = FANUC.write(job("fanuc-pitch", made, "error", limit="7"))
    assert done.rounding == pytest.approx(0.003)
    assert any("1 sections need more than 7; 0.003 mm are off there" in n for n in done.notes)


def test_sections_meet_the_positions_of_the_table_where_they_can():
    """Uneven positions, and a reference between two of them: the interval is their common step, and nothing is lost."""
    made = Compensation(("L-POS",), (error_table("EXX", [0, 40, 50, 100], [0.0, 0.004, -0.003, 0.007]),), ())
    for at, interval, numbers in (("0", 10, 11), ("45", 5, 20), ("-10", 10, 12)):
        done = FANUC.write(job("fanuc-pitch", made, "error", reference_position=at))
        files = {f.name: f.content for f in done.files}
        assert settings_of(files, "X")["3624"] == interval and len(values_of(files, "X")) == numbers
        assert not any("other positions" in n for n in done.notes)
    done = FANUC.write(job("fanuc-pitch", made, "error", reference_position="45", numbers="12"))
    assert settings_of({f.name: f.content for f in done.files}, "X")["3624"] == 10
    assert any("other positions than those of the table: up to" in n for n in done.notes)


def test_what_is_left_out_is_said():
    notes = FANUC.write(job("fanuc-pitch", pitch(), "error", interval="X=400")).notes
    assert any(n.startswith("Y: 6.00 µm are added to its error values everywhere") for n in notes)
    assert any(n.startswith("X: other positions than those of the table") for n in notes)
    assert any("put out at one place of its section" in n and "Y 0.012" in n for n in notes)


def test_one_backlash_for_a_reversal_that_changes_along_the_axis_is_said():
    """E(+) - E(-) of X is -2, -3 and -3 µm: 1851 is 3, which is 1 µm too much at 0, and a third of that off on the mean."""
    one, two = (FANUC.write(job("fanuc-pitch", pitch(), "error", bidirectional=both)) for both in ("0", "1"))
    said = "X: the reversal changes along the axis; one backlash (1851) leaves up to 0.000333 mm"
    assert any(n.startswith(said) for n in one.notes) and not any("reversal changes" in n for n in two.notes)
    assert (
        one.rounding == pytest.approx(0.0005 + 0.001 / 3.0) and two.rounding < 1e-12
    )  # means of whole and half micrometres


def test_with_one_table_the_shift_is_that_of_the_direction_of_the_reference_return():
    """In the direction of the return the amount is 0 at the reference, where the error is 0 in + and 2 µm in -; B is -2.67 µm."""
    for way, words in (("+", "0.33 µm are added to"), ("-", "2.33 µm are taken off")):  # 1 µm and half of 2.67 µm
        notes = FANUC.write(job("fanuc-pitch", pitch(), "error", reference_return=way)).notes
        assert any(n.startswith(f"X: {words} its error values") for n in notes)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"numbers": "2"}, "table of Y needs 3 position numbers; the control holds 2"),
        ({"bidirectional": "1", "magnification": "2"}, "magnification of Y is 2; with bidirectional=1 expected 1"),
        ({"limit": "5"}, "table of Y: 8 steps of the control are left at its last position"),
        ({"detection_unit": "0"}, "detection_unit is '0'; expected a number above 0"),
        ({"reference_return": "up"}, r"reference_return is 'up'; expected \+ or -"),
        ({"interval": "XY=3"}, "interval is 'XY=3'; expected one value, or pairs such as X=1,Y=2"),
    ],
)
def test_what_the_memory_cannot_hold_is_refused(options, message):
    with pytest.raises(InputError, match=message):
        written("fanuc-pitch", pitch(), "error", **options)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("fanuc_pitch.csv", "4,X", "44,X"), "position number 4 of X has no value"),
        (("fanuc_pitch.csv", "5,X", "4,X"), "line 9: position number 4 stands there a second time"),
        (
            ("fanuc_pitch.csv", "number,", "no,"),
            "fanuc_pitch.csv, line 3: the columns are no, .*expected number, value",
        ),
        (("fanuc_pitch.csv", ",-14,", ",-1.5,"), "line 9: value is '-1.5'; expected a whole number"),
        (("fanuc_pitch.csv", ",-14,", ",,"), "line 9: value is ''; expected a number"),
        (("fanuc_parameters.csv", "3624,X,500", "3624,X,0"), "parameters of X: .*interval 0; expected"),
        (("fanuc_parameters.csv", "3620,X,3", "3620,Q,3"), "line 14: parameter '3620' of axis 'Q'"),
        (("fanuc_parameters.csv", "3622,X,5,highest number\n", ""), "parameters of X: 3622 is missing, highest number"),
        (
            ("fanuc_parameters.csv", "# values: error", "# values: compensation"),
            "are 'compensation' values, and `sign=error`",
        ),
    ],
)
def test_lists_that_are_wrong_are_refused(change, message):
    files = written("fanuc-pitch", pitch(), "error")
    name, old, new = change
    assert old in files[name]
    files[name] = files[name].replace(old, new)
    with pytest.raises(InputError, match=message):
        FANUC.read(files, MACHINE, stated("error"))


def test_a_spreadsheet_may_have_written_the_list_again():
    files = written("fanuc-pitch", pitch(), "error")
    wanted = FANUC.read(files, MACHINE, stated("error")).axis_tables
    again = {n: c.replace(",", ";").replace("\n", "\r\n") + "\r\n;;\r\n" for n, c in files.items()}
    for a, b in zip(wanted, FANUC.read(again, MACHINE, stated("error")).axis_tables, strict=True):
        np.testing.assert_array_equal(a.forward, b.forward)


def test_its_lists_are_recognised():
    files = written("fanuc-pitch", pitch(), "error")
    assert all(FANUC.recognises(n, c) for n, c in files.items())
    assert not FANUC.recognises("x.comp", "0 0 0\n") and not FANUC.recognises("a.csv", "")


def test_an_option_for_all_axes_or_for_one():
    assert by_axis(int, 1)("3") == {"": 3} and by_axis(int, 1)("x=3, Y=4") == {"": 1, "X": 3, "Y": 4}


def test_without_its_reversal_value_both_directions_are_the_amounts_of_the_list():
    """1851 acts only against the direction of the return to the reference; at 0 the amounts stand alone: X 0, 10, -4 µm."""
    done = job("fanuc-pitch", pitch(), "error")
    files = {f.name: f.content for f in FANUC.write(done).files}
    assert settings_of(files, "X")["1851"] == 3
    held = FANUC.read(files, MACHINE, {**done.options, "sign": "error"})
    (x,) = [FANUC.without_reversal_value(t, done.options) for t in held.axis_tables if t.output == "X"]
    for values in (x.forward, x.reverse):
        np.testing.assert_allclose(values, [0.0, 0.0, 0.010, -0.004], atol=1e-12)
