"""Points exported by SpatialAnalyzer, composed from the published layout: from the simulated machine through file and fit."""

import numpy as np
import pytest
from exact_chain import Truth, machine_toml
from scipy.spatial.transform import Rotation
from support.machines import VERTICAL
from support.touch_files import save

from volid.exceptions import InputError
from volid.fitting.fit import fit
from volid.fitting.location_errors import location_parameter
from volid.io.campaign.imported import import_files

TOOL = np.array([30.0, 0.0, -150.0])
ONLY_SQUARENESS = '[model.functions]\n"E?[XYZ]" = false\n"E??" = false\n'
TRUTH = {"EC0Y": 40e-6, "EA0Z": -25e-6, "EB0Z": 60e-6}
U = 0.002


def grid():
    lines = [np.linspace(*VERTICAL.travel[a], 4) for a in VERTICAL.axes]
    return np.stack([m.ravel() for m in np.meshgrid(*lines, indexing="ij")], axis=1)


@pytest.fixture(scope="module")
def measured():
    """Positions, and points in the working frame of a tracker that stands somewhere, turned somehow."""
    q, rng = grid(), np.random.default_rng(3)
    points = VERTICAL.functional_point(q, TOOL, Truth({}, TRUTH))
    turn = Rotation.from_euler("xyz", [4.0, -3.0, 130.0], degrees=True)
    return q, turn.apply(points - [2100.0, -900.0, 300.0]) + U * rng.standard_normal(points.shape)


def positions(folder, q, targets=None):
    header = [*(["target"] if targets else []), *VERTICAL.axes, "tool_x", "tool_y", "tool_z"]
    rows = [[*([targets[i]] if targets else []), *row, *TOOL] for i, row in enumerate(q.tolist())]
    return str(save(folder / "positions.csv", [",".join(map(str, row)) for row in [header, *rows]]))


def exported(points, style="full", factor=1.0):
    lines = []
    for i, p in enumerate(points * factor):
        xyz = [f"{v:.6f}" for v in p]
        cells = {
            "full": ["Machine", "volume", f"p{i}", *xyz],
            "numbered": ["Machine", "volume", str(i), *xyz],
            "target": [f"p{i}", *xyz],
            "bare": xyz,
            "more": ["Machine", "volume", f"p{i}", *xyz, "0.004500", "0.001200"],
        }[style]
        lines.append(cells)
    return lines


def campaign(folder, lines, name="points.txt", **keys):
    (folder / "machine.toml").write_text(machine_toml(VERTICAL, extra=ONLY_SQUARENESS))
    return import_files([save(folder / name, lines)], folder / "machine.toml", {"u": U} | keys)


HEAD = ["// SpatialAnalyzer 2021.1", "// Frame: A::WORLD", "// Units: Millimeters"]


def test_squareness_from_points_within_u(measured, tmp_path):
    q, points = measured
    lines = HEAD + [" ".join(row) for row in exported(points)]
    found = campaign(tmp_path, lines, positions=positions(tmp_path, q, [f"p{i}" for i in range(64)]))
    (readings,) = found.sets
    assert readings.kind == "point" and set(readings.labels["station"]) == {"tracker"}
    solution = fit(found)
    assert not solution.adequacy.rejected
    for name, true in TRUTH.items():
        found = location_parameter(solution, name)
        assert abs(found.value - true) < 3.5 * found.u + 1e-8 and found.u < 3e-6, name


@pytest.mark.parametrize("style", ["full", "numbered", "target", "bare", "more"])
@pytest.mark.parametrize("separator", [" ", ", ", "\t"])
def test_every_form_gives_the_same_points(measured, style, separator, tmp_path):
    q, points = measured
    lines = HEAD + [separator.join(row) for row in exported(points, style)]
    found = campaign(
        tmp_path, lines, positions=positions(tmp_path, q), station="S1", unit="mm", **{"as": "spatial_analyzer"}
    )
    (readings,) = found.sets
    np.testing.assert_allclose(readings.readings, points, atol=1e-6)
    np.testing.assert_array_equal(readings.positions, q)
    assert set(readings.labels["station"]) == {"S1"}
    assert any("matched by their order" in w for w in found.warnings)
    assert any("2 columns behind the coordinates" in w for w in found.warnings) == (style == "more")


@pytest.mark.parametrize("separator", [" ", ";", "\t"])
def test_decimal_commas_of_a_computer_that_writes_them(measured, separator, tmp_path):
    q, points = measured
    lines = HEAD + [separator.join(row).replace(".", ",") for row in exported(points)]
    (readings,) = campaign(tmp_path, lines, positions=positions(tmp_path, q)).sets
    np.testing.assert_allclose(readings.readings, points, atol=1e-6)


def test_units_are_those_of_the_export(measured, tmp_path):
    q, points = measured
    metres = [" ".join(row) for row in exported(points, factor=1e-3)]
    (readings,) = campaign(tmp_path, metres, positions=positions(tmp_path, q), unit="m").sets
    np.testing.assert_allclose(readings.readings, points, atol=1e-3)
    with pytest.raises(InputError, match=r"key 'unit' is missing, and .*points.txt does not name it"):
        campaign(tmp_path, metres, positions=positions(tmp_path, q))
    with pytest.raises(InputError, match=r'unit is "inch"; expected mm, as the comments of the file say'):
        campaign(tmp_path, HEAD + metres, positions=positions(tmp_path, q), unit="inch")


def test_points_and_positions_that_do_not_match_are_named(measured, tmp_path):
    q, points = measured
    lines = HEAD + [" ".join(row) for row in exported(points)]
    with pytest.raises(
        InputError, match=r"positions.csv: 60 positions for 64 points; expected as many, in the same order"
    ):
        campaign(tmp_path, lines, positions=positions(tmp_path, q[:60]))
    found = campaign(tmp_path, lines[:-3], positions=positions(tmp_path, q[2:], [f"p{i}" for i in range(2, 64)]))
    assert len(found.sets[0]) == 59
    said = " ".join(found.warnings)
    assert (
        "2 without a position left out: p0, p1" in said
        and "3 positions have no reading, by target: p61, p62, p63" in said
    )
    np.testing.assert_array_equal(found.sets[0].positions, q[2:61])
    with pytest.raises(
        InputError, match=r"0 of 64 names of the file are in column target; the file has p0, .* the column n0"
    ):
        campaign(tmp_path, lines, positions=positions(tmp_path, q, [f"n{i}" for i in range(64)]))
    with pytest.raises(
        InputError, match=r"does not hold axis positions; expected positions = a CSV with columns target,X,Y,Z"
    ):
        campaign(tmp_path, lines)
    with pytest.raises(InputError, match=r"target 'p0' stands in several groups"):
        twice = [*lines[:-1], lines[3].replace("volume", "again")]
        campaign(tmp_path, twice, positions=positions(tmp_path, q, [f"p{i}" for i in range(64)]))


WRONG = {
    "short": (
        lambda rows: [*rows[:5], "Machine volume p5 1.0 2.0", *rows[6:]],
        r"points.txt, row 9: 5 cells; "
        "expected 6, as in row 4",
    ),
    "text": (
        lambda rows: [*rows[:5], "Machine volume p5 1.0 x 2.0", *rows[6:]],
        r"points.txt, row 9: a coordinate is 'x'",
    ),
    "comma": (
        lambda rows: [*rows[:5], rows[5].replace(".", ","), *rows[6:]],
        r"points.txt, row 9: a coordinate is '[^']*,",
    ),
}


@pytest.mark.parametrize("what", WRONG)
def test_damaged_rows_are_named(measured, what, tmp_path):
    q, points = measured
    damage, message = WRONG[what]
    lines = HEAD + damage([" ".join(row) for row in exported(points)])
    with pytest.raises(InputError, match=message):
        campaign(tmp_path, lines, positions=positions(tmp_path, q))


def test_random_damage_ends_in_messages(measured, tmp_path):
    q, points = measured
    text, rng, seen = (
        "\n".join(HEAD + [" ".join(row) for row in exported(points)]).encode(),
        np.random.default_rng(1),
        0,
    )
    place = positions(tmp_path, q, [f"p{i}" for i in range(64)])
    (tmp_path / "machine.toml").write_text(machine_toml(VERTICAL, extra=ONLY_SQUARENESS))
    for k in range(100):
        changed = bytearray(text)
        for i in rng.integers(0, len(text), rng.integers(1, 5)):
            changed[i] = rng.integers(1, 256) if k % 2 else rng.choice(list(b" .,-\n0/x"))
        (tmp_path / "x.txt").write_bytes(bytes(changed[: rng.integers(len(text) // 3, len(text))]))
        try:
            import_files([tmp_path / "x.txt"], tmp_path / "machine.toml", {"u": U, "positions": place})
        except InputError:
            seen += 1
    assert seen > 10
