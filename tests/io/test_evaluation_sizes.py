"""Readings and limits of evaluations by a standard that stand in another unit than the one expected are asked about."""

import math

import pytest

import volid


def table(folder, header, rows, *above):
    path = folder / "readings.csv"
    path.write_text("\n".join([*above, header, *(",".join(str(cell) for cell in row) for row in rows)]) + "\n")
    return path


def runs(folder, header):
    return "iso230-2", table(folder, header, [(100 * i, 2 * i, 2 * i + 1) for i in range(6)])


def circle(folder, header):
    rows = [(a, 5 * math.sin(math.radians(2 * a))) for a in range(0, 361, 5)]
    return "iso230-4", table(folder, header, rows, "# plane: XY", "# radius: 150")


def diagonals(folder, header):
    rows = [(d, 200 * i, w, 2 * i) for d in ("PPP", "NPP", "PNP", "PPN") for w in (1, -1) for i in range(5)]
    return "iso230-6", table(folder, header, rows)


def steps(folder, header):
    above = ("# box: X 0 800, Y 0 600, Z 0 600", "# u: 0.0005", "# values: deviation")
    return "step-diagonal", table(folder, header, [(i, i, i, i) for i in range(13)], *above)


@pytest.mark.parametrize(
    ("written", "plain", "stated", "symbol", "expected"),
    [
        (runs, "target,up_1,down_1", "target,up_1 [µm],down_1 [µm]", "E", 0.011),
        (circle, "angle,deviation", "angle,deviation [µm]", "G_XY", 0.010),
        (diagonals, "diagonal,target,direction,deviation", "diagonal,target,direction,deviation [µm]", "E_d", 0.008),
        (steps, "PPP,NPP,PNP,PPN", "PPP [µm],NPP [µm],PNP [µm],PPN [µm]", "EYX", None),
    ],
)
def test_micrometres_are_asked_about_and_read_where_the_header_says_so(
    tmp_path, written, plain, stated, symbol, expected
):
    standard, path = written(tmp_path, plain)
    with pytest.raises(volid.InputError, match=r"from their median. Expected mm: is it in µm\? .* \[µm\]"):
        volid.evaluate(standard, path)
    standard, path = written(tmp_path, stated)
    value = volid.evaluate(standard, path)[0][symbol].value
    assert value < 0.1 if expected is None else value == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize(("limit", "other"), [("E = 10", "µm"), ("[X]\nE = 12.5", "µm")])
def test_a_limit_that_everything_would_pass_is_asked_about(tmp_path, limit, other):
    _, path = runs(tmp_path, "target,up_1 [µm],down_1 [µm]")
    (tmp_path / "limits.toml").write_text(limit + "\n")
    with pytest.raises(volid.InputError, match=rf"limits.toml: E = .* mm. Expected mm: is it in {other}\?"):
        volid.evaluate("iso230-2", path, axis="X", limits=tmp_path / "limits.toml")
    with volid.accept_unusual():
        assert volid.evaluate("iso230-2", path, axis="X", limits=tmp_path / "limits.toml")[0]["E"].verdict == "pass"


def test_what_python_shows_is_short_and_names_what_there_is(tmp_path):
    _, path = circle(tmp_path, "angle,deviation [µm]")
    (found,) = volid.evaluate("iso230-4", path, plane="XY", radius=150.0, feed=1000.0, u=0.0002, length_u=0.0005)
    assert found["G_XY"].U is not None and "array(" not in repr(found)
    with pytest.raises(KeyError, match="G; expected one of G_XY"):
        found["G"]


def test_what_was_taken_for_granted_is_said(tmp_path):
    _, path = runs(tmp_path, "target,up_1 [µm],down_1 [µm]")
    (found,) = volid.evaluate("iso230-2", path)
    assert any("no axis is stated: targets and deviations were read in mm" in text for text in found.remarks)
    assert any("U is left out" in text for text in found.remarks)
    (found,) = volid.evaluate("iso230-2", path, axis="X")
    assert not any("no axis is stated" in text for text in found.remarks)
