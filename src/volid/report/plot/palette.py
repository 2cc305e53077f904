"""The colours of the whole project: one colour-blind safe palette for lines and areas, and maps for fields.

`SERIES` are the colours of Okabe and Ito, in an order in which neighbours also differ in grey; `STYLES` are the line styles
that go with them, because a figure must be readable without any colour. Meaning has its own names: `NEUTRAL` for what is
nominal or expected, `ATTENTION` for what a reader must see.

Source: M. Okabe, K. Ito, "Color universal design", 2008; the maps are those of matplotlib.
"""

from __future__ import annotations

BLUE, ORANGE, GREEN, YELLOW = "#0072B2", "#D55E00", "#009E73", "#E69F00"
PINK, SKY, BLACK = "#CC79A7", "#56B4E9", "#1A1A1A"
SERIES = (BLUE, ORANGE, BLACK, SKY, GREEN, YELLOW, PINK)
STYLES = ("-", "--", "-.", ":", (0, (5, 1, 1, 1)), (0, (3, 1)), (0, (1, 1)))

NEUTRAL = "#6B6B6B"  # nominal, expected, explanations: 5.3 : 1 on white
FAINT = "#D9D9D9"  # grids and lines at zero
ATTENTION = ORANGE  # significant, rejected, set aside
GOOD = GREEN
PAPER = "#FFFFFF"  # behind everything: seams around letters and marks

SIZES = "cividis_r"  # colour map of sizes, from zero: the largest is darkest
RATIOS = (
    "#B9DEF3",
    PAPER,
    "#F2A373",
)  # of ratios: below 1, 1, above 1; light enough for black letters, 1 lightest in grey
SIGNED = "RdYlBu_r"  # colour map of values of both signs, zero in its middle
