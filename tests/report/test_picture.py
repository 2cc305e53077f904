"""Pictures in characters show the function where it is, with its band, in plain characters where a terminal has no others."""

import re

import numpy as np
import pytest

from volid.report.text.picture import HEIGHT, picture

WIDTH = 100


def drawn(lines, marks):
    """Places of characters within the frame: x as a share of its width, y as a share of its height from below."""
    inside = [re.search(r"[|┤│](.*)[|│]$", line) for line in lines]
    rows = [m[1] for m in inside if m]
    high, wide = len(rows), max(map(len, rows))
    at = [(j, i) for i, row in enumerate(rows) for j, c in enumerate(row) if c in marks]
    return np.array([((j + 0.5) / wide, 1.0 - (i + 0.5) / high) for j, i in at]), 1.0 / high


def shares(solution, name, x):
    """Value, and value -U and +U, as shares of the range that they span over the travel."""
    rows = solution.motion(name, np.linspace(*solution.machine.axis(name[2]).travel, 121))
    value, u = np.array([r.value for r in rows]), np.array([r.u for r in rows])
    low, high = (value - 2.0 * u).min(), (value + 2.0 * u).max()
    at = np.linspace(0.0, 1.0, len(rows))
    return [np.interp(x, at, (curve - low) / (high - low)) for curve in (value, value - 2.0 * u, value + 2.0 * u)]


@pytest.mark.parametrize("name", ["EXX", "EYX", "EAZ"])
def test_the_line_is_the_function_and_the_dots_are_its_band(solution, name):
    lines = picture(solution, name, WIDTH, plain=True)
    line, cell = drawn(lines[1:], "*")
    assert len(line) > 60 and all(len(text) <= WIDTH for text in lines)
    slack = 1.0 * cell + np.abs(np.gradient(shares(solution, name, np.linspace(0, 1, WIDTH))[0])).max()
    assert np.abs(line[:, 1] - shares(solution, name, line[:, 0])[0]).max() < slack
    dots, _ = drawn(lines[1:], ".")
    _, low, high = shares(solution, name, dots[:, 0])
    assert np.minimum(np.abs(dots[:, 1] - low), np.abs(dots[:, 1] - high)).max() < slack


def test_directions_have_marks_of_their_own(rich_solution):
    lines = picture(rich_solution, "EXX", WIDTH, plain=True)
    assert "+ o approached in + and -" in lines[0]
    assert sum(text.count("o") for text in lines[1:]) > 10 and sum(text.count("+") for text in lines[2:-3]) > 10


def test_plain_pictures_are_ascii_and_others_are_not_coloured(solution, rotary_solution):
    assert "\n".join(picture(rotary_solution, "ECC", WIDTH, plain=True)).isascii()
    text = "\n".join(picture(solution, "EXX", WIDTH))
    assert "\x1b" not in text and "┌" in text and "[µm]" in text


def test_what_is_not_determined_is_said(single_tool_solution):
    unknown = [name for name, directions in single_tool_solution.undetermined.items() if directions and name[2] != "0"]
    named = [name for name in unknown if len(picture(single_tool_solution, name)) == 1]
    assert named and picture(single_tool_solution, named[0])[0].endswith("not determined by the data")


@pytest.mark.parametrize(("asked", "found"), [(10, 40), (70, 70), (500, 120)])
def test_the_width_is_kept_within_reason(solution, asked, found, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    lines = picture(solution, "EXX", asked)
    assert max(map(len, lines[1:])) == found and len(lines) <= HEIGHT + 1
