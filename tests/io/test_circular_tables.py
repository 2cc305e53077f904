"""Circular tests as tables: what is read, what is refused and how it is said."""

import numpy as np
import pytest
from support.places import DATASETS

from volid.exceptions import InputError
from volid.io.evaluations.circular import Stated, read_circular, vendors_evaluations

UP = np.arange(0.0, 361.0, 10.0)


def table(tmp_path, header, columns, rows):
    path = tmp_path / "circle.csv"
    lines = [*(f"# {line}" for line in header), ",".join(columns), *(",".join(map(str, row)) for row in rows)]
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")
    return path


def test_radius_or_deviation_with_what_the_file_says(tmp_path):
    header = ["plane: YZ", "radius: 100", "feed: 1500", "u: 0.0004", "length_u: 0.0006"]
    (test,) = read_circular(table(tmp_path, header, ["angle", "radius"], [(a, 100.002) for a in UP]))
    assert (test.plane, test.radius, test.feed, test.length_u) == ("YZ", 100.0, 1500.0, 0.0006)
    assert np.allclose(test.deviation, 0.002) and np.all(test.u == 0.0004)
    (other,) = read_circular(table(tmp_path, header, ["angle", "deviation"], [(a, 0.002) for a in UP]))
    assert np.allclose(test.deviation, other.deviation)


def test_what_is_stated_stands_before_what_the_file_says(tmp_path):
    path = table(
        tmp_path, ["plane: YZ", "radius: 100", "length_u: unknown"], ["angle", "deviation"], [(a, 0) for a in UP]
    )
    (test,) = read_circular(path, Stated(plane="XY", u=0.001))
    assert test.plane == "XY" and test.u[0] == 0.001 and not test.is_calibrated and test.feed is None


@pytest.mark.parametrize("words", [("+", "-"), ("anticlockwise", "clockwise"), ("CCW", "CW"), ("1", "-1")])
def test_senses_and_runs_in_columns(tmp_path, words):
    rows = [(a, 0.001, sense, run) for run in (1, 2) for sense in words for a in UP]  # all listed by rising angle
    path = table(tmp_path, ["plane: XY", "radius: 100"], ["angle", "deviation", "sense", "run"], rows)
    (test,) = read_circular(path)
    assert [int(test.sense[r[0]]) for r in test.runs] == [1, -1, 1, -1] and test.u is None


def test_several_planes_in_one_table(tmp_path):
    rows = [(a, 0.0, plane) for plane in ("XY", "ZX") for a in UP]
    path = table(tmp_path, ["radius: 100"], ["angle", "deviation", "plane"], rows)
    assert [t.plane for t in read_circular(path)] == ["XY", "ZX"]


@pytest.mark.parametrize(
    "header, columns, row, message",
    [
        (["radius: 100"], ["angle", "deviation"], (0,), r"circle\.csv: the plane is missing; add a line '# plane: XY'"),
        (["plane: XY"], ["angle", "deviation"], (0,), r"the nominal radius is missing; add a line '# radius: 150'"),
        (
            ["plane: XY", "radius: big"],
            ["angle", "deviation"],
            (0,),
            r"circle\.csv: radius is 'big'; expected a positive",
        ),
        (["plane: XY", "radius: 100"], ["angle", "devaition"], (0,), r"devaition"),
        (["plane: XY", "radius: 100"], ["angle", "sense"], ("+",), "expected one of the columns radius and deviation"),
        (
            ["plane: XY", "radius: 100"],
            ["angle", "deviation", "sense"],
            (0, "up"),
            r"row 4: sense is 'up'; expected \+",
        ),
        (["plane: XY", "radius: 100"], ["angle", "deviation", "u"], (0, 0), r"row 4: u is not above 0"),
        (["plane: XY", "radius: 100"], ["angle", "deviation"], ("much",), r"row 4.*much"),
    ],
)
def test_what_is_wrong_is_named(tmp_path, header, columns, row, message):
    path = table(tmp_path, header, columns, [(a, *row) for a in UP])
    with pytest.raises(InputError, match=message):
        read_circular(path)


def test_a_table_has_no_sets(tmp_path):
    path = table(tmp_path, ["plane: XY", "radius: 100"], ["angle", "deviation"], [(a, 0) for a in UP])
    with pytest.raises(InputError, match="a table has no sets"):
        read_circular(path, sets=["circle"])
    assert vendors_evaluations(path) == []


def test_a_campaign_says_itself_what_a_table_has_to_be_told():
    with pytest.raises(InputError, match="a campaign says itself what `radius` is"):
        read_circular(DATASETS / "ball_bar_circles/campaign.toml", Stated(radius=100.0))
