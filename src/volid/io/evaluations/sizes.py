"""Deviations that are too large for what is evaluated: in all likelihood they stand in another unit than the one expected."""

from __future__ import annotations

import numpy as np

from volid.backend.consent import ask
from volid.standards.positioning.runs import LARGE

_OTHER = {"mm": ("mm", "µm"), "°": ("degrees", "arcsec")}


def ask_size(source: str, column: str, deviation: np.ndarray, unit: str = "mm") -> None:
    """Raises `InputError` for deviations that look like another unit, outside `accept_unusual`.

    Args:
        source: The file.
        column: What the header calls them, for the advice.
        deviation: In `unit`, "mm" or "°", of any shape; NaN where nothing was read.

    >>> ask_size("circle.csv", "deviation", np.array([0.0, 4.0]))
    Traceback (most recent call last):
    ...
    volid.exceptions.InputError: circle.csv: deviations reach 2 mm from their median. Expected mm: is it in µm? Then the header \
should say so, such as deviation [µm]. If that is meant, insist with `volid.accept_unusual`
    """
    found = deviation[np.isfinite(deviation)]
    size = float(np.abs(found - np.median(found)).max()) if found.size else 0.0
    if size > LARGE[unit]:
        expected, other = _OTHER[unit]
        ask(
            f"{source}: deviations reach {size:.4g} {unit} from their median. Expected {expected}: is it in {other}? Then the "
            f"header should say so, such as {column} [{other}]."
        )
