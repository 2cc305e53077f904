"""The root mean square, in one place."""

from __future__ import annotations

from typing import Any, overload

import numpy as np


@overload
def rms(values: Any) -> float: ...


@overload
def rms(values: Any, axis: int) -> np.ndarray: ...


def rms(values: Any, axis: int | None = None) -> Any:
    """√(mean of values²), over all values or along `axis`, in their unit; NaN when there are none, or one of them is NaN.

    >>> rms([3.0, -4.0, 0.0, 0.0])
    2.5
    """
    values = np.asarray(values, dtype=float)
    if axis is not None:
        return np.sqrt(np.mean(np.square(values), axis=axis))
    return float(np.sqrt(np.mean(np.square(values)))) if values.size else float("nan")
