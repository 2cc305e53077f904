"""Vectors of Fanuc's three-dimensional error compensation, blended here by the manual's formula, written out again."""

import numpy as np
import pytest
from support.control_cases import MACHINE, TOOL, job, pitch, spatial, written

import volid
from volid.compensation.package import Compensation
from volid.controllers import CONTROLS
from volid.controllers.base import options_of
from volid.exceptions import InputError

FANUC = CONTROLS["fanuc-3d"]


def stated(sign: str, **options):
    return {**options_of(FANUC.declaration, options), "sign": sign}


def rows(text: str) -> np.ndarray:
    return np.array(
        [[float(v) for v in line.split(",")] for line in text.splitlines() if not line.startswith(("#", "n,"))]
    )


def blended(vectors: np.ndarray, at: np.ndarray) -> np.ndarray:
    """The manual's formula: eight vertices of the box around a position, each with its share along X, Y and Z."""
    lines = [np.unique(vectors[:, k]) for k in (1, 2, 3)]
    total = np.zeros(3)
    cell = [
        int(np.clip(np.searchsorted(line, p, side="right") - 1, 0, len(line) - 2))
        for line, p in zip(lines, at, strict=True)
    ]
    share = [(p - line[i]) / (line[i + 1] - line[i]) for line, p, i in zip(lines, at, cell, strict=True)]
    for corner in np.ndindex(2, 2, 2):
        place = [line[i + c] for line, i, c in zip(lines, cell, corner, strict=True)]
        (row,) = np.flatnonzero((vectors[:, 1:4] == place).all(axis=1))
        total += vectors[row, 4:] * np.prod([s if c else 1.0 - s for s, c in zip(share, corner, strict=True)])
    return total


def test_the_list_is_written_as_it_says():
    """10 µm of X at its end, -5 µm of Z/500, 2 µm everywhere; compensation values; X runs fastest."""
    found = rows(written("fanuc-3d", spatial(), "compensation")["fanuc_3d.csv"])
    assert found[0].tolist() == [1, 0, 0, -500, 0, -5, -2]
    assert found[2].tolist() == [3, 1000, 0, -500, -10, -5, -2]
    assert found[-1].tolist() == [12, 1000, 600, 0, -10, 0, -2]
    coarse = rows(written("fanuc-3d", spatial(), "error", detection_unit="0.0005", magnification="5")["fanuc_3d.csv"])
    assert coarse[2].tolist() == [3, 1000, 0, -500, 4, 2, 1]  # 10, 5 and 2 µm in steps of 2.5 µm


def rough(seed: int) -> Compensation:
    (grid,) = spatial((np.linspace(0, 1000, 5), np.linspace(0, 600, 4), np.linspace(-500, 0, 3))).grids
    rng = np.random.default_rng(seed)
    grid.values[:, :3] = rng.normal(scale=0.02, size=(len(grid.values), 3))
    return Compensation(("L-VOL",), (), (grid,))


@pytest.mark.parametrize("sign", ["error", "compensation"])
@pytest.mark.parametrize("structure", ["wYXbZt_vertical", "wbXYZt_gantry"])
def test_the_blend_moves_the_axes_as_the_grid_asks(sign, structure):
    machine = volid.load_machine(f"models/{structure}.toml")
    made, rng = rough(3), np.random.default_rng(8)
    asked = job("fanuc-3d", made, sign, machine=machine)
    text = FANUC.write(asked).files[0].content
    vectors, (grid,) = rows(text), made.grids
    back = FANUC.read({"fanuc_3d.csv": text}, machine, stated(sign)).control(machine)
    for _ in range(60):
        place = dict(zip("XYZ", rng.uniform([0, 0, -500], [1000, 600, 0]), strict=True))
        q = machine.order(**place)[None]
        want = made.control(machine).command(q, TOOL) - q
        put = 0.001 * blended(vectors, np.array([place[a] for a in "XYZ"])) * (-1.0 if sign == "error" else 1.0)
        by_axis = {a: want[0, machine.index(a)] for a in "XYZ"}
        np.testing.assert_allclose(put, [by_axis[a] for a in "XYZ"], atol=0.0005 + 1e-9)
        held = back.command(q, TOOL) - q
        np.testing.assert_allclose([held[0, machine.index(a)] for a in "XYZ"], put, atol=1e-9)
    assert grid.positions.shape == (60, 3)


def test_the_order_of_rows_does_not_matter():
    text = written("fanuc-3d", rough(1), "error")["fanuc_3d.csv"]
    head, body = text.splitlines()[:4], text.splitlines()[4:]
    mixed = "\n".join([*head, *np.random.default_rng(0).permutation(body)])
    one, other = (FANUC.read({"a.csv": t}, MACHINE, stated("error")).grids[0] for t in (text, mixed))
    np.testing.assert_array_equal(one.values, other.values)


def test_a_tool_of_another_length_is_told():
    (grid,) = spatial().grids
    grid.values[:, 3] = 20e-6
    notes = FANUC.write(job("fanuc-3d", Compensation(("L-VOL",), (), (grid,)), "error")).notes
    assert any("right for the tool vector 0, 0, -150 mm" in n and "off by up to 2 µm" in n for n in notes)


def uneven():
    return spatial(((0.0, 400.0, 1000.0), (0.0, 600.0), (-500.0, 0.0)))


def gap():
    made = spatial()
    made.grids[0].values[3, 1] = np.nan
    return made


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (pitch, "table of EXX; table of EYY; expected one grid over X, Y and Z"),
        (uneven, "positions of X are 0, 400, 1000 …; expected equal distances"),
        (gap, "the grid has gaps"),
        (lambda: Compensation((), (), ()), "fanuc-3d: nothing; expected one grid"),
    ],
)
def test_what_it_cannot_hold_is_refused(make, message):
    with pytest.raises(InputError, match=message):
        written("fanuc-3d", make(), "error")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("12,1000,600,0,10", "12,1000,600,1,10", "its 12 positions are no grid"),
        ("1,0,0,-500,0", "1,0,0,-500,0.5", "line 5: CX is '0.5'; expected a whole number"),
        ("Z,CX", "Z,KX", "line 4: the columns are"),
        ("# values: error", "# values: compensation", "are 'compensation' values"),
    ],
)
def test_lists_that_are_wrong_are_refused(old, new, message):
    text = written("fanuc-3d", spatial(), "error")["fanuc_3d.csv"]
    assert old in text
    with pytest.raises(InputError, match=message):
        FANUC.read({"fanuc_3d.csv": text.replace(old, new, 1)}, MACHINE, stated("error"))


def test_its_list_is_recognised():
    assert FANUC.recognises("a.csv", written("fanuc-3d", spatial(), "error")["fanuc_3d.csv"])
    assert not FANUC.recognises("a.csv", "X,Y\n")
