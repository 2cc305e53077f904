"""The terms of a circular test as quantities with symbol and words, and the table of its readings."""

from __future__ import annotations

import numpy as np

from volid.standards.circular.geometry import Decomposition, Spike, Term
from volid.standards.circular.readings import CircularReadings
from volid.standards.results import Quantity, Table

_K = 2.0
_ENDS = {0: "+{0}", 90: "+{1}", 180: "-{0}", 270: "-{1}"}
COLUMNS = (
    "angle_deg",
    "sense",
    "run",
    "as_read_mm",
    "deviation_mm",
    "geometry_mm",
    "with_waves_mm",
    "residual_mm",
    "behind_quadrant",
)


def geometry(test: CircularReadings, found: Decomposition) -> tuple[list[Quantity], list[str]]:
    """Quantities of what is determined, and symbols of what is not."""
    quantities, blank = [], []
    for name, (symbol, unit, text) in _names(test).items():
        if name in found.terms:
            term = found.terms[name]
            if np.isfinite(term.value):
                quantities.append(Quantity(symbol, term.value, unit, _K * term.u, text=text))
            else:
                blank.append(symbol)
    mismatch = _mismatch(test, found.terms["lag"])
    if mismatch is not None:
        quantities.append(mismatch)
    return [*quantities, *(_spike(test, s) for s in found.spikes), _left(test, found)], blank


def _names(test: CircularReadings) -> dict[str, tuple[str, str, str]]:
    """Symbol, unit and words by the name of the term."""
    a, b = tuple(test.plane)
    primary = {"XY": "EC0Y", "YZ": "EA0Z", "ZX": "-EB0Z"}[test.plane]
    return {
        "scale": (f"scale_{test.plane}", "mm/mm", f"scale of {a} less that of {b}"),
        "squareness": (
            f"squareness_{test.plane}",
            "rad",
            f"angle from +{a} to +{b} less 90°: {primary} with X as primary",
        ),
        "reversal aa": (f"B_E{a}{a}", "mm", f"reversal value of E{a}{a}, positioning of {a}"),
        "reversal bb": (f"B_E{b}{b}", "mm", f"reversal value of E{b}{b}, positioning of {b}"),
        "reversal ba": (f"B_E{b}{a}", "mm", f"reversal value of E{b}{a}, lateral play of {a}"),
        "reversal ab": (f"B_E{a}{b}", "mm", f"reversal value of E{a}{b}, lateral play of {b}"),
        "lag": (f"lag_{test.plane}", "mm", f"lag of {a} less that of {b} makes an ellipse at 45°, of this half-range"),
        "bow ba": (f"bow_E{b}{a}", "mm", f"parabola of straightness E{b}{a} over the diameter"),
        "bow ab": (f"bow_E{a}{b}", "mm", f"parabola of straightness E{a}{b} over the diameter"),
        "centre a": (
            f"centre_{a}",
            "mm",
            f"socket from the centre of the path in {a}; errors of the axes move that too",
        ),
        "centre b": (
            f"centre_{b}",
            "mm",
            f"socket from the centre of the path in {b}; errors of the axes move that too",
        ),
    }


def _mismatch(test: CircularReadings, lag: Term) -> Quantity | None:
    """Difference of the axes' lags as a time, where the feed is known: lag = v/2 (τ_a - τ_b)."""
    if not test.feed or not np.isfinite(lag.value):
        return None
    factor = 2.0 / (test.feed / 60.0) * 1e3  # ms/mm
    a, b = tuple(test.plane)
    text = f"time by which {a} lags behind the command, less that of {b}"
    return Quantity(f"mismatch_{test.plane}", factor * lag.value, "ms", _K * factor * lag.u, text=text)


def _spike(test: CircularReadings, spike: Spike) -> Quantity:
    sense = "anticlockwise" if spike.sense > 0 else "clockwise"
    end = _ENDS[spike.quadrant].format(*test.plane)
    symbol = f"spike_{test.name(spike.sense)}_{spike.quadrant}"
    return Quantity(
        symbol, spike.height, "mm", _K * spike.u, text=f"reversal spike at {end}, {sense}, outwards positive"
    )


def _left(test: CircularReadings, found: Decomposition) -> Quantity:
    """What the terms leave outside the windows: the range of the residual."""
    left = (found.residual + found.fitted - found.named)[~found.masked]
    text = "range of what these terms leave, spikes apart"
    return Quantity(f"residual_{test.plane}", float(np.ptp(left)), "mm", text=text)


def table(test: CircularReadings, deviation: np.ndarray, found: Decomposition) -> Table:
    """Reading by reading: as read, about the centre that was chosen, what the geometry explains, and with waves, and what
    is left."""
    columns = (
        test.angle.tolist(),
        test.sense.tolist(),
        (test.run + 1).tolist(),
        test.deviation.tolist(),
        deviation.tolist(),
        found.named.tolist(),
        found.fitted.tolist(),
        found.residual.tolist(),
        found.masked.astype(int).tolist(),
    )
    return Table(COLUMNS, tuple(zip(*columns, strict=True)))
