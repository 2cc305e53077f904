"""The numbers of a solution that a limit can be set for, under their symbols, each with U.

| symbol | what | unit |
|---|---|---|
| `V_X` … `V_C` | volumetric accuracy of ISO 230-1, range of a component over the working volume | mm, rad |
| `largest_deviation` | largest length of the deviation of the functional point, in the stated datum | mm |
| `EC0Y` … | squareness errors; their size is compared | rad |
| `EX0C`, `EX(0A)C` … | location errors of rotary axes; their size is compared | mm, rad |
| `EXX` … | range of an error motion over the measured travel | mm, rad |
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

from volid.compensation.residual.accuracy import VolumeSizes
from volid.fitting.diagnosis.adequacy import QUESTIONED, REJECTED
from volid.model.iso230 import DIRECTIONS, ROTATIONS
from volid.standards.results import LEFT_OUT, MODEL, Evaluation, Quantity

SUBJECT = "machine"
LARGEST = "largest_deviation"


def quantities(
    summary: Mapping[str, Any], ranges: Mapping[str, tuple[float, float]], sizes: VolumeSizes | None = None
) -> Evaluation:
    """All of them, not yet judged. What the data do not determine, or the model leaves out, is NaN.

    Args:
        summary: As `summary_data` gives it.
        ranges: Range and U of every error motion, as `motion_ranges` gives them.
        sizes: As `volume_sizes` gives them; None: no numbers are shown, and there are none here.
    """
    if sizes is None:
        return Evaluation("ISO 230-1", SUBJECT, ())
    found = (*_volume(summary, sizes), *_constants(summary), *_motions(summary, ranges))
    return Evaluation("ISO 230-1", SUBJECT, found)


def unproved(summary: Mapping[str, Any], found: Evaluation) -> dict[str, str]:
    """Symbols of the quantities whose value proves nothing about a limit, with the reason (`volid.standards.results.WITHHELD`).

    All of them where the model is rejected, in question or did not converge; what is not determined is undecided anyway. Numbers
    of the working volume where the model leaves out error motions of linear axes, which may add to them or cancel them.
    """
    determined = [q.symbol for q in found.quantities if math.isfinite(q.value)]
    if summary["grade"] in (REJECTED, QUESTIONED) or not summary["converged"]:
        return dict.fromkeys(determined, MODEL)
    if not (summary["volume"] or {}).get("left_out"):
        return {}
    return {symbol: LEFT_OUT for symbol in determined if symbol == LARGEST or symbol.startswith("V_")}


def _volume(summary: Mapping[str, Any], sizes: VolumeSizes) -> Iterator[Quantity]:
    left_out = summary["volume"]["left_out"]
    for letter, value, U in zip(DIRECTIONS, *(v.tolist() for v in sizes.accuracy), strict=True):
        missing = bool(left_out) and value == 0.0  # no function of the model acts in this direction
        unit = "rad" if letter in ROTATIONS else "mm"
        value, U = (math.nan, math.nan) if missing else (value, U)
        yield Quantity(f"V_{letter}", value, unit, U, text=f"volumetric accuracy, {letter}")
    (value,), (U,) = (v.tolist() for v in sizes.largest)
    yield Quantity(LARGEST, value, "mm", U, text="largest deviation of the functional point")


def _constants(summary: Mapping[str, Any]) -> Iterator[Quantity]:
    for found in (*summary["squareness"], *summary["location_errors"]):
        value, U = (math.nan if found[key] is None else found[key] for key in ("value", "U"))
        yield Quantity(found["name"], value, found["unit"], U, text=found["description"])


def _motions(summary: Mapping[str, Any], ranges: Mapping[str, tuple[float, float]]) -> Iterator[Quantity]:
    for found in summary["functions"]:
        value, U = ranges[found["name"]]
        yield Quantity(found["name"], value, found["unit"], U, text=f"range of {found['description']}")
