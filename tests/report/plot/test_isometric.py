"""Drawings of space on paper: the projection is parallel and right-handed, and the field is drawn where it is, in its colours."""

from dataclasses import replace

import numpy as np
import pytest
from support.compensated import machine_and_solution

from volid.report.contents.deviation_field import deviation_fields
from volid.report.plot.field import Scale, deviation_volume, draw_field, scale_of
from volid.report.plot.isometric import RIGHT, TOWARDS, UP, projected
from volid.report.plot.panels import figure_with_panels

TOOL = (0.0, 0.0, -150.0)


def test_the_projection_is_parallel_with_z_up_x_right_and_y_away():
    axes = np.stack([RIGHT, UP, TOWARDS])
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(axes) == pytest.approx(1.0)  # seen from outside, not in a mirror
    x, y, z = projected(np.eye(3))
    assert x[0] > 0.5  # to the right
    assert z[0] == pytest.approx(0.0, abs=1e-12)
    assert z[1] > 0.5  # up
    assert TOWARDS[1] < 0  # the smallest Y is nearest to the eye
    assert y[1] > 0  # farther is higher


@pytest.fixture(scope="module")
def found():
    return deviation_fields(machine_and_solution("three-axis", seed=2)[1], TOOL, [["L-VOL"]], most=4)


def drawn(found, state, scale):
    """Segments (n, 2, 2) of the deformed lattice and their colours' values [µm]."""
    _, panel = figure_with_panels()
    draw_field(panel, found, state, scale)
    lines = panel.collections[-1]
    return np.array(lines.get_segments()), np.asarray(lines.get_array()), lines.get_clim()


def test_segments_are_as_far_from_the_lattice_as_the_factor_says(found):
    """A factor twice as large moves every end twice as far; the colour stays, and is the mean length of both ends."""
    plain, _, _ = drawn(found, 0, Scale(1e-12, 1.0))
    once, colours, limits = drawn(found, 0, Scale(500.0, 0.05))
    twice, again, _ = drawn(found, 0, Scale(1000.0, 0.05))
    np.testing.assert_allclose(twice - plain, 2.0 * (once - plain), atol=1e-6)
    np.testing.assert_array_equal(colours, again)
    assert limits == (0.0, 50.0)
    points, size = found.lattice.points, 1e3 * np.linalg.norm(found.values[0, 0, 0], axis=1)
    flat = projected(points)
    for segment, colour in zip(plain, colours, strict=True):
        ends = [int(np.argmin(np.linalg.norm(flat - end, axis=1))) for end in segment]
        near = np.isclose(np.linalg.norm(flat[:, None] - segment[None], axis=2), 0.0, atol=1e-6).sum(axis=0)
        if (near == 1).all():  # no other node lies behind this one
            assert colour == pytest.approx(size[ends].mean(), rel=1e-9)


def test_both_states_are_drawn_in_one_scale(found):
    scale = scale_of(found)
    assert scale.largest == pytest.approx(np.linalg.norm(found.values[0, 0, 0], axis=1).max())
    assert drawn(found, 0, scale)[2] == drawn(found, 1, scale)[2]
    moved = scale.factor * scale.largest
    assert 0.4 * found.lattice.spacing < moved <= 0.8 * found.lattice.spacing  # factors are 1, 1.5, 2, 3, 5, 7, 10, …


def test_nodes_that_are_not_known_are_not_drawn(found):
    values = found.values.copy()
    corner = len(found.lattice.points) - 1
    values[0, 0, 0, corner] = np.nan
    whole, part = (len(drawn(f, 0, Scale(100.0, 0.05))[0]) for f in (found, replace(found, values=values)))
    assert whole - part in (2, 3)  # edges of the corner on faces that are seen


def test_nothing_known_is_said():
    _, solution = machine_and_solution("three-axis")
    with pytest.raises(ValueError, match="do not determine"):
        deviation_volume(replace(solution, null_space=np.eye(solution.model.n_parameters)), TOOL)
