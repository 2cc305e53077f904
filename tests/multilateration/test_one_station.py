"""A station's position from its readings alone: exact where the data are, honest where they allow two answers."""

import numpy as np
import pytest
from support.work import calls

from volid.exceptions import InputError
from volid.multilateration.trilateration import trilaterate

VOLUME = np.array([1000.0, 600.0, 500.0])  # mm, a mid-size machining centre


def readings(n, station, dead_paths, seed=0, noise=0.0, flat=False):
    """Random targets in the volume, in `len(dead_paths)` uninterrupted beams; distances from the station, mm."""
    rng = np.random.default_rng(seed)
    targets = rng.uniform(0, 1, (n, 3)) * VOLUME
    if flat:
        targets[:, 2] = 250.0
    segments = np.sort(np.arange(n) % len(dead_paths))
    distances = np.linalg.norm(targets - station, axis=1) + np.asarray(dead_paths)[segments]
    return targets, distances + noise * rng.normal(size=n), segments


STATIONS = {
    "beside the machine": (1400.0, -300.0, -100.0),
    "inside the volume": (420.0, 310.0, 180.0),
    "10 m away": (8000.0, -6000.0, 900.0),
}


@pytest.mark.parametrize("station", STATIONS.values(), ids=STATIONS.keys())
@pytest.mark.parametrize("dead_paths", [[-731.0], [120.0, -55.5, 2044.0]], ids=["one beam", "three beams"])
def test_exact_readings_give_the_station_and_every_dead_path(station, dead_paths):
    targets, distances, segments = readings(400, station, dead_paths)
    found = trilaterate(targets, distances, segments, relative=True)
    # 1e-6 mm: rounding of 10 m in 64 bits is 2e-12 mm, and the range of a station 10 m away is 500 times as sensitive
    np.testing.assert_allclose(found.position, station, rtol=0, atol=1e-6)
    np.testing.assert_allclose(found.dead_paths, dead_paths, rtol=0, atol=1e-6)
    assert np.abs(found.residuals).max() < 1e-8
    assert found.alternative is None
    assert not found.outliers.any()


def test_absolute_distances_have_no_dead_path():
    station = (300.0, -900.0, 700.0)
    targets, distances, _ = readings(12, station, [0.0])
    found = trilaterate(targets, distances, None, relative=False)
    np.testing.assert_allclose(found.position, station, atol=1e-8)
    assert found.dead_paths.tolist() == [0.0]


def test_plane_networks_work_too():
    targets, distances, _ = readings(10, (0.0, 0.0, 0.0), [0.0])
    distances = np.linalg.norm(targets[:, :2] - [-300.0, 2000.0], axis=1) - 44.0
    found = trilaterate(targets[:, :2], distances, None, relative=True)
    np.testing.assert_allclose(found.position, [-300.0, 2000.0], atol=1e-6)


def test_any_unit_of_length_gives_the_same():
    targets, distances, segments = readings(60, (1400.0, -300.0, -100.0), [10.0, 20.0], noise=0.01)
    in_mm = trilaterate(targets, distances, segments, relative=True)
    in_m = trilaterate(targets / 1000, distances / 1000, segments, relative=True)
    np.testing.assert_allclose(in_m.position * 1000, in_mm.position, rtol=0, atol=1e-6)


def test_order_of_readings_does_not_matter():
    targets, distances, segments = readings(200, (1400.0, -300.0, -100.0), [10.0, 20.0, 30.0], noise=0.01)
    order = np.random.default_rng(3).permutation(200)
    straight = trilaterate(targets, distances, segments, relative=True)
    shuffled = trilaterate(targets[order], distances[order], segments[order], relative=True)
    np.testing.assert_allclose(shuffled.position, straight.position, rtol=0, atol=1e-4)  # a hundredth of the noise
    np.testing.assert_allclose(shuffled.residuals, straight.residuals[order], rtol=0, atol=1e-4)


@pytest.mark.parametrize("noise", [0.0, 0.1], ids=["exact", "0.1 mm"])
@pytest.mark.parametrize("station", STATIONS.values(), ids=STATIONS.keys())
def test_five_percent_outliers_of_centimetres_do_not_matter(station, noise):
    targets, distances, segments = readings(400, station, [120.0, -55.5, 2044.0], seed=2, noise=noise)
    clean = trilaterate(targets, distances, segments, relative=True)
    rng = np.random.default_rng(5)
    bad = rng.choice(400, 20, replace=False)
    distances[bad] += rng.choice([-1, 1], 20) * rng.uniform(5.0, 50.0, 20)
    found = trilaterate(targets, distances, segments, relative=True)
    assert set(bad) <= set(np.flatnonzero(found.outliers))
    # losing 5 % of the readings shifts an estimate by sqrt(0.05) = 0.2 of its standard uncertainty; 1 is ample
    tolerance = 1e-6 + noise * uncertainty(targets, np.array(station), segments)
    assert np.linalg.norm(found.position - clean.position) < tolerance


def uncertainty(targets, station, segments):
    """Length of the station's standard uncertainty for readings of u = 1: directions centred segment by segment."""
    directions = (station - targets) / np.linalg.norm(station - targets, axis=1)[:, None]
    for label in np.unique(segments):
        directions[segments == label] -= directions[segments == label].mean(axis=0)
    return np.sqrt((1 / np.linalg.svd(directions, compute_uv=False) ** 2).sum())


def test_noisy_readings_scatter_as_least_squares_says():
    station = np.array([1400.0, -300.0, -100.0])
    errors = []
    for seed in range(40):
        targets, distances, segments = readings(200, station, [120.0, -55.5], seed=seed, noise=0.05)
        found = trilaterate(targets, distances, segments, relative=True)
        errors.append(np.linalg.norm(found.position - station) / (0.05 * uncertainty(targets, station, segments)))
    # sum of 40 squares of mean 1 dominated by one direction: chi-square 40, 99.9 % quantiles 0.45 and 1.84 of the mean,
    # plus 5 % for the robust weights
    assert 0.45 < np.mean(np.square(errors)) < 1.93


def test_scale_is_the_standard_deviation_of_the_readings():
    targets, distances, segments = readings(2000, (1400.0, -300.0, -100.0), [1.0, 2.0], noise=0.05)
    found = trilaterate(targets, distances, segments, relative=True)
    assert found.scale == pytest.approx(0.05, rel=0.1)  # 4 standard deviations of a median of 2000


def test_coplanar_targets_leave_a_mirror_image_and_say_so():
    station = np.array([1400.0, -300.0, 900.0])
    mirror = station * [1, 1, -1] + [0, 0, 500.0]
    targets, distances, segments = readings(100, station, [77.0], flat=True)
    found = trilaterate(targets, distances, segments, relative=True)
    both = sorted([found.position.tolist(), found.alternative.tolist()], key=lambda p: p[2])
    np.testing.assert_allclose(both, [mirror, station], rtol=0, atol=1e-5)


@pytest.mark.parametrize("side", [1, -1])
def test_start_chooses_between_mirror_images(side):
    station = np.array([1400.0, -300.0, 250.0 + side * 650.0])
    targets, distances, segments = readings(100, station, [77.0], flat=True)
    found = trilaterate(targets, distances, segments, relative=True, start=station + 300.0)
    np.testing.assert_allclose(found.position, station, rtol=0, atol=1e-5)


def test_nearly_coplanar_targets_choose_the_right_side():
    station = np.array([1400.0, -300.0, 900.0])
    targets, distances, segments = readings(400, station, [77.0, -3.0], flat=True)
    targets[:, 2] += np.random.default_rng(1).uniform(-2, 2, 400)
    distances = np.linalg.norm(targets - station, axis=1) + 0.01 * np.random.default_rng(2).normal(size=400)
    found = trilaterate(targets, distances, segments, relative=True)
    assert found.alternative is None
    assert np.linalg.norm(found.position - station) < 1.0


def test_start_far_off_does_no_harm():
    targets, distances, segments = readings(100, (1400.0, -300.0, -100.0), [77.0, 3.0])
    found = trilaterate(targets, distances, segments, relative=True, start=[-5000.0, 4000.0, 3000.0])
    np.testing.assert_allclose(found.position, (1400.0, -300.0, -100.0), rtol=0, atol=1e-6)


def test_twenty_beams_of_five_readings():
    dead_paths = np.linspace(-900, 900, 20)
    targets, distances, segments = readings(100, (1400.0, -300.0, -100.0), dead_paths)
    found = trilaterate(targets, distances, segments, relative=True)
    np.testing.assert_allclose(found.position, (1400.0, -300.0, -100.0), rtol=0, atol=1e-6)
    np.testing.assert_allclose(found.dead_paths, dead_paths, rtol=0, atol=1e-6)


def test_segment_labels_need_not_be_counted_from_zero():
    targets, distances, segments = readings(60, (1400.0, -300.0, -100.0), [5.0, 9.0])
    found = trilaterate(targets, distances, np.array([17, 4])[segments], relative=True)
    assert found.segments.tolist() == [4, 17]
    np.testing.assert_allclose(found.dead_paths, [9.0, 5.0], rtol=0, atol=1e-6)


def test_readings_are_not_taken_one_by_one():
    def work(n):
        targets, distances, segments = readings(n, (1400.0, -300.0, -100.0), range(20), noise=0.05)
        return calls(lambda: trilaterate(targets, distances, segments, relative=True))

    assert work(20_000) < 3 * work(2_000)


@pytest.mark.parametrize(
    ("n", "dead_paths", "relative", "expected"),
    [
        (3, [0.0], True, "3 different targets.*at least 4"),
        (5, [0.0, 1.0, 2.0], True, "at least 6"),
        (2, [0.0], False, "3"),
    ],
)
def test_too_few_targets_are_refused(n, dead_paths, relative, expected):
    targets, distances, segments = readings(n, (1400.0, -300.0, -100.0), dead_paths)
    with pytest.raises(InputError, match=f"too few targets.*{expected}"):
        trilaterate(targets, distances, segments, relative)


def test_repeated_targets_do_not_count_twice():
    targets, distances, segments = readings(3, (1400.0, -300.0, -100.0), [0.0])
    with pytest.raises(InputError, match="3 different targets"):
        trilaterate(np.tile(targets, (4, 1)), np.tile(distances, 4), np.tile(segments, 4), relative=True)


def test_targets_on_a_line_are_refused():
    targets = np.outer(np.linspace(0, 1, 20), [300.0, 200.0, 100.0])
    with pytest.raises(InputError, match="on one line: the station may turn around it"):
        trilaterate(targets, np.linalg.norm(targets - [0, 900, 0], axis=1), None, relative=True)


def test_impossible_input_is_named():
    targets, distances, segments = readings(20, (1400.0, -300.0, -100.0), [0.0])
    with pytest.raises(InputError, match=r"distances \(19,\); expected"):
        trilaterate(targets, distances[1:], segments, relative=True)
    distances[7] = np.nan
    with pytest.raises(InputError, match=r"distances: reading 7 .* not a finite number"):
        trilaterate(targets, distances, segments, relative=True)
    with pytest.raises(InputError, match=r"u of reading 0 .* more than 0"):
        trilaterate(targets, np.ones(20), segments, relative=True, u=0.0)


def test_shapes_in_signatures_are_checked_under_pytest():
    from jaxtyping import TypeCheckError

    from volid.multilateration.one_station import closed_form

    with pytest.raises(TypeCheckError):
        closed_form(np.zeros(3))
