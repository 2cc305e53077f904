"""The palette can be told apart by people who do not see red or green, and in grey.

Simulations: G. M. Machado, M. M. Oliveira, L. A. F. Fernandes, "A physiologically-based model for simulation of color vision
deficiency", IEEE TVCG 15 (2009) 1291: matrices of severity 1.0 on linear RGB. Differences: CIE 1976 L*a*b*.
"""

from itertools import combinations, pairwise

import numpy as np
import pytest
from matplotlib import colormaps
from matplotlib.colors import to_rgb

from volid.report.plot.palette import ATTENTION, BLACK, FAINT, GOOD, NEUTRAL, RATIOS, SERIES, SIGNED, SIZES, STYLES

SEEN = {
    "all": np.eye(3),
    "protanopia": np.array(
        [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]]
    ),
    "deuteranopia": np.array(
        [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]]
    ),
}
TO_XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
APART = 15.0  # ΔE: several times what is just noticed (about 2.3) side by side


def linear(colours):
    rgb = np.array([to_rgb(c) for c in colours])
    return np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)


def lab(rgb):
    """L*a*b* of linear RGB, shape (n, 3), white point D65."""
    t = np.clip(rgb, 0.0, 1.0) @ TO_XYZ.T / (TO_XYZ @ np.ones(3))
    f = np.where(t > (6 / 29) ** 3, np.cbrt(t), t / (3 * (6 / 29) ** 2) + 4 / 29)
    return np.stack([116 * f[:, 1] - 16, 500 * (f[:, 0] - f[:, 1]), 200 * (f[:, 1] - f[:, 2])], axis=1)


def contrast(a, b):
    """WCAG contrast of two colours."""
    bright = sorted(float(linear([c])[0] @ TO_XYZ[1]) for c in (a, b))
    return (bright[1] + 0.05) / (bright[0] + 0.05)


def test_the_yardstick_knows_black_and_white():
    np.testing.assert_allclose(lab(linear(["white", "black"]))[:, 0], [100.0, 0.0], atol=1e-6)
    assert contrast("white", "black") == pytest.approx(21.0)


@pytest.mark.parametrize("eyes", SEEN)
def test_every_two_colours_of_lines_differ(eyes):
    seen = lab(linear(SERIES) @ SEEN[eyes].T)
    nearest = min((np.linalg.norm(a - b), i, j) for (i, a), (j, b) in combinations(enumerate(seen), 2))
    assert nearest[0] > APART, nearest


def test_neighbours_differ_in_grey_and_by_their_style():
    assert len(set(STYLES)) == len(SERIES) == len(STYLES)
    lightness = lab(linear(SERIES))[:, 0]
    assert all(abs(a - b) > 7.0 for a, b in pairwise(lightness)), lightness


@pytest.mark.parametrize("eyes", SEEN)
def test_what_needs_attention_differs_from_what_is_good(eyes):
    a, b = lab(linear([ATTENTION, GOOD]) @ SEEN[eyes].T)
    assert np.linalg.norm(a - b) > APART


@pytest.mark.parametrize("text", [NEUTRAL, BLACK])
def test_texts_have_contrast_aa_on_white(text):
    assert contrast(text, "white") >= 4.5


def test_faint_lines_are_seen_and_do_not_compete():
    assert 1.2 < contrast(FAINT, "white") < contrast(NEUTRAL, "white") / 2


@pytest.mark.parametrize("eyes", SEEN)
def test_sizes_rise_evenly_in_grey_from_light_to_dark(eyes):
    colours = colormaps[SIZES](np.linspace(0.0, 1.0, 21))[:, :3]
    lightness = lab(linear(colours) @ SEEN[eyes].T)[:, 0]
    assert np.all(np.diff(lightness) < 0.0)


@pytest.mark.parametrize("eyes", SEEN)
def test_signs_differ_for_all_eyes(eyes):
    colours = colormaps[SIGNED](np.linspace(0.0, 1.0, 11))[:, :3]
    seen = lab(linear(colours) @ SEEN[eyes].T)
    assert all(np.linalg.norm(seen[i] - seen[-1 - i]) > APART for i in range(4))
    assert np.argmax(seen[:, 0]) in (4, 5, 6)  # zero is lightest


def test_black_letters_are_read_on_every_colour_of_a_ratio_and_1_is_the_lightest_in_grey():
    light = linear([*RATIOS, BLACK]) @ TO_XYZ[1]
    assert ((light[:-1] + 0.05) / (light[-1] + 0.05) > 7.0).all()  # contrast, WCAG AAA
    assert light[1] > max(light[0], light[2])
