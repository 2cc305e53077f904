"""What the script of the page needs, made small: fields as 16-bit numbers in base64, and the library that draws, compressed."""

from __future__ import annotations

import base64
import gzip
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np

from volid.report.plot.palette import ATTENTION, BLACK, FAINT, NEUTRAL, SERIES, SIZES

UNKNOWN = -32768  # what stands for NaN
LARGEST = 32767
SHADES = 12  # of a colour map


def packed(values: np.ndarray) -> dict[str, Any]:
    """Numbers as 16-bit integers in base64 with their unit, to a 65,000th of the largest: {"scale": …, "data": …}.

    Args:
        values: Array of any shape, NaN where there is no number.

    >>> packed(np.array([32767.0, -16384.0, np.nan]))
    {'scale': 1.0, 'data': '/38AwACA'}
    """
    size = float(np.nanmax(np.abs(values))) if np.isfinite(values).any() else 0.0
    scale = size / LARGEST or 1.0
    counts = np.where(np.isfinite(values), np.rint(np.nan_to_num(values) / scale), UNKNOWN)
    return {"scale": scale, "data": base64.b64encode(counts.astype("<i2").tobytes()).decode("ascii")}


def shares(colour_map: str = SIZES) -> list[list[Any]]:
    """A colour map of matplotlib as pairs of share and colour, as plotly takes it."""
    from matplotlib import colormaps
    from matplotlib.colors import to_hex

    return [[round(float(x), 4), to_hex(colormaps[colour_map](x))] for x in np.linspace(0.0, 1.0, SHADES)]


def colours() -> dict[str, Any]:
    """The colours of the project by what they mean, for drawings that the page makes itself."""
    return {
        "sizes": shares(),
        "series": list(SERIES),
        "ink": BLACK,
        "neutral": NEUTRAL,
        "faint": FAINT,
        "attention": ATTENTION,
    }


@cache
def library() -> str:
    """plotly's script, compressed by gzip, in base64: 2.0 of 4.8 MB. The page unpacks it when something is to be drawn."""
    script = (files("plotly") / "package_data" / "plotly.min.js").read_bytes()
    return base64.b64encode(gzip.compress(script, 9, mtime=0)).decode("ascii")
