"""What a reader has to know of a circular test: how it was evaluated, what it does not tell, what needs a second look."""

from __future__ import annotations

from typing import TYPE_CHECKING

from volid.standards.circular.geometry import decompose

if TYPE_CHECKING:
    from volid.standards.circular.evaluation import CircularDetails

_POOR = (110.0, 200.0)  # degrees
_SCATTERED = 2.0  # u: more is worth a remark
_WIDER = 15.0  # degrees: with so much more the geometry is tried again
WIDEST = 45.0  # degrees: half of a quadrant is left for the geometry
_LEAST_CHANGE = 5e-4  # mm: a reversal value that changes less is the same
_SEEN = 3.0  # u: a spike that counts


def remarks(details: CircularDetails, blank: list[str], window: float, setup_centre: bool) -> tuple[str, ...]:
    test = details.test
    x, y = 1e3 * details.circle.centre
    found = [
        f"{len(test.runs)} runs of {test.arc:.0f}° with radius {test.radius:g} mm"
        f"{f', feed {test.feed:g} mm/min' if test.feed else ''}; anticlockwise is from +{test.plane[0]} to +{test.plane[1]}",
        f"the least-squares circle of all readings, spikes with them, says that the socket stands {x:.1f} µm in "
        f"{test.plane[0]} and {y:.1f} µm in {test.plane[1]} from the programmed centre"
        f"{', which the radial deviations contain' if setup_centre else ', which is taken out of the radial deviations'}",
        f"geometry is taken from the readings outside {window:g}° behind changes of quadrant, spikes from those within",
    ]
    if not test.is_calibrated:
        found.append("the length of the bar is unknown: F_max, F_min and D are not determined")
    found.append(
        "squareness and scale are those of this path: straightness and angular errors at its place are part of them, and only "
        "a fit of more paths tells them apart"
    )
    if details.geometry.ratio > _SCATTERED:
        found.append(
            f"the residuals scatter by {details.geometry.ratio:.1f} times the stated u of the readings, and U of the geometry is "
            "enlarged by that"
        )
    if len(test.senses) == 1:
        found.append(
            "one sense only: no bidirectional quantities, and squareness cannot be told from a lag of the axes"
        )
    if not test.is_full:
        found.append(
            f"the arc of {test.arc:.0f}° is no full circle: D is not determined, and centre, radius and shape of the path can "
            "exchange"
        )
    if _POOR[0] < test.arc < _POOR[1]:
        found.append(
            "in simulations U of squareness was too small by a quarter on such arcs, which hardly show waves of the path"
        )
    if test.u is None:
        found.append("no u of the readings is known: U of the geometry is from the residuals, ISO quantities have none")
    if blank:
        found.append(f"not determined: {', '.join(blank)}")
    return tuple(found)


def attention(details: CircularDetails, window: float) -> tuple[str, ...]:
    """Reversal values that a wider window changes: pulses last longer than the window, and are taken for reversal."""
    test, narrow = details.test, details.geometry.terms
    wide = min(window + _WIDER, WIDEST)
    if wide <= window or not any(abs(s.height) > _SEEN * s.u for s in details.geometry.spikes):
        return ()
    other, found = decompose(test, details.circle, wide).terms, []
    for term, letter in (("reversal aa", test.plane[0]), ("reversal bb", test.plane[1])):
        before, after = narrow[term], other[term]
        if abs(after.value - before.value) > _SEEN * max(after.u, _LEAST_CHANGE / _SEEN):
            values = f"{1e3 * before.value:.1f} µm behind {window:g}°, {1e3 * after.value:.1f} µm behind {wide:g}°"
            found.append(
                f"{test.plane}: B_E{letter}{letter} depends on the window, {values}: reversal spikes last longer, "
                "and bend scale and reversal; choose a wider `spike_window`"
            )
    return tuple(found)
