"""Elementary functions of numbers and arrays of any sort: NumPy arrays, JAX arrays and tracers, recorded arrays (`reverse`).

The kinematic chain and the observation kinds are written once, with these functions. On NumPy arrays they compute immediately,
without tracing and compiling a program. On JAX arrays they are the functions of JAX.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from volid.backend.lazy import jnp
from volid.backend.reverse import Recorded
from volid.backend.reverse import arctan2 as recorded_arctan2

_PLAIN = (np.ndarray, np.generic, float, int)


def is_plain(x: Any) -> bool:
    """Whether `x` is a number or NumPy array."""
    return isinstance(x, _PLAIN)


def space(x: Any) -> Any:
    """The array functions that go with `x`: `numpy` or `jax.numpy`."""
    if is_plain(x):
        return np
    return jnp


def sqrt(x: Any) -> Any:
    """Square root."""
    return x.sqrt() if isinstance(x, Recorded) else space(x).sqrt(x)


def arctan2(y: Any, x: Any) -> Any:
    """Angle of (x, y) [rad]."""
    if isinstance(x, Recorded) or isinstance(y, Recorded):
        return recorded_arctan2(y, x)
    return space(y if is_plain(x) else x).arctan2(y, x)


def nearest_integer(x: Any) -> Any:
    """The integer nearest to `x`, a constant: its derivative is 0."""
    value = x.value if isinstance(x, Recorded) else x
    return space(value).round(value)


def cos_sin(angle: Any) -> tuple[Any, Any]:
    """Cosine and sine of an angle [rad]."""
    if isinstance(angle, Recorded):
        return angle.cos_sin()
    functions = space(angle)
    return functions.cos(angle), functions.sin(angle)


def constant_like(x: Any, value: float) -> Any:
    """`value` wherever `x` is: a number beside NumPy and recorded arrays, an array of the shape of `x` beside JAX arrays."""
    return value if is_plain(x) or isinstance(x, Recorded) else space(x).full_like(x, value)


def in_rows(parts: Sequence[Any], shape: tuple[int, ...]) -> Any:
    """Array (k, *shape) of k parts, each of `shape` or a number; a list of them while they are being recorded.

    With JAX, `stack` is not used: XLA on a CPU would merge its operands into it and compute the entire chain again for every use
    of every intermediate point. That takes seconds instead of a millisecond per thousand points of a five-axis machine.
    """
    if any(isinstance(p, Recorded) for p in parts):
        return list(parts)
    if all(is_plain(p) for p in parts):
        result = np.empty((len(parts), *shape))
        for i, part in enumerate(parts):
            result[i] = part
        return result
    if len(parts) == 1:
        return jnp.broadcast_to(parts[0], shape)[None]
    rows = jnp.zeros((len(parts), *shape))
    for i, part in enumerate(parts):
        rows = rows.at[i].set(part)
    return rows


def computed_once(parts: Any) -> Any:
    """The parts of a vector. JAX arrays become rows of one array, so that XLA does not compute them again for every use."""
    if any(is_plain(p) or isinstance(p, Recorded) for p in parts):
        return parts
    rows = in_rows(parts, parts[0].shape)
    return tuple(rows[i] for i in range(len(parts)))
