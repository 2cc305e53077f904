"""Small problems without compiled programs: the same functions as in `problem`, on NumPy arrays, with recorded derivatives.

Tracing and compiling takes seconds, a fit of a few thousand readings milliseconds; so `fit` interprets campaigns of up to
`LARGEST` readings. Both paths share the kinematic chain, the observation kinds and the bases; they agree to rounding.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from typing import Any

import numpy as np

from volid.backend.reverse import Recorded, gradients
from volid.campaign import Campaign
from volid.effects.prediction import Form, predict_readings
from volid.model.error_model import Layout, coefficient_rows, error_values, evaluate_bases, summed_rows

LARGEST = 12_000  # readings: up to here the whole fit takes less than tracing its programs, let alone compiling them
REMEMBERED = 64  # chunks whose bases are kept
FEW = 0.5  # share of rows with a weight below which they are taken out of a chunk

_interpreting: ContextVar[bool] = ContextVar("interpreting", default=False)
_bases: OrderedDict[Any, tuple[Any, Any, list[np.ndarray]]] = OrderedDict()


def interpreting() -> bool:
    """Whether `problem`, `solver` and their like are to do without compiled programs here."""
    return _interpreting.get()


def is_small(campaign: Campaign) -> bool:
    """Whether a fit of this campaign is interpreted."""
    return campaign.n_readings <= LARGEST


@contextmanager
def interpreted(wanted: bool = True) -> Iterator[None]:
    """Within it, problems are interpreted (or, with False, compiled)."""
    token = _interpreting.set(wanted)
    try:
        yield
    finally:
        _interpreting.reset(token)


def chunks_of(block: Any, used_only: bool = False) -> Iterator[Any]:
    """The chunks of a block as NumPy arrays; with `used_only` without the rows after the last one that has a weight, or, where
    few have one, without all others."""
    for i in range(block.q.shape[0]):
        arrays = {name: np.asarray(getattr(block, name))[i] for name in _ARRAYS}
        whole = _Chunk(arrays, (id(block.q), id(block.direction), i), (block.q, block.direction))
        if not used_only:
            yield whole
            continue
        seen = np.flatnonzero(arrays["weight"].any(axis=0))
        if seen.size:
            last = int(seen[-1]) + 1
            yield _Some(whole, seen) if seen.size < FEW * last else whole.rows(last)


_ARRAYS = ("q", "direction", "tool", "reading", "weight", "slots", "constants")


class _Chunk:
    """Arrays of one chunk, each (width, m), and what its bases are remembered by."""

    def __init__(self, arrays: dict[str, np.ndarray], key: Any, owners: Any) -> None:
        self.key, self.owners, self.arrays = key, owners, arrays
        self.m = arrays["q"].shape[1]
        self.q, self.direction, self.tool = arrays["q"], arrays["direction"], arrays["tool"]
        self.reading, self.weight = arrays["reading"], arrays["weight"]
        self.slots, self.constants = arrays["slots"], arrays["constants"]

    def rows(self, first: int) -> _Chunk:
        """The first rows of this chunk."""
        return _Chunk({k: a[:, :first] for k, a in self.arrays.items()}, self.key, self.owners)

    def bases(self, layout: Layout) -> list[np.ndarray]:
        """Basis values, each (size, m): they depend on the positions alone, so the last ones are kept."""
        key = (*self.key, self.m, layout.bases)
        known = _bases.get(key)  # threads share them
        if known is None:
            known = _bases[key] = (*self.owners, evaluate_bases(layout, self.q, self.direction))
            if len(_bases) > REMEMBERED:
                with suppress(KeyError):
                    _bases.popitem(last=False)
        return known[2]


class _Some(_Chunk):
    """Some rows of a chunk, anywhere in it."""

    def __init__(self, whole: _Chunk, rows: np.ndarray) -> None:
        super().__init__({k: a[:, rows] for k, a in whole.arrays.items()}, whole.key, whole.owners)
        self._whole, self._rows = whole, rows

    def bases(self, layout: Layout) -> list[np.ndarray]:
        """Those of the whole chunk, which other rows of it ask for, too."""
        return [b[:, self._rows] for b in self._whole.bases(layout)]


def _predict(system: Any, form: Form, chunk: _Chunk, errors: Any, slots: Any) -> Any:
    tool, constants = tuple(chunk.tool), tuple(chunk.constants)
    return predict_readings(system.machine, form, chunk.q, tool, errors, slots, constants)


def _partials(system: Any, form: Form, chunk: _Chunk, z: np.ndarray) -> tuple[np.ndarray, np.ndarray, list[np.ndarray]]:
    """Predictions (k, m), partial derivatives (k, errors + slots, m), and the bases."""
    n, bases = system.layout.n_coefficients, chunk.bases(system.layout)
    rows = np.concatenate([_error_values(system.layout, chunk, z), z[n + chunk.slots]])
    return *_partials_at(system, form, chunk, rows), bases


def _partials_at(system: Any, form: Form, chunk: _Chunk, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Predictions (k, m) and partial derivatives (k, errors + slots, m) at stated error and slot values `rows`."""
    notes: list[Recorded] = []
    leaves = [Recorded(row, notes) for row in rows]
    split = len(leaves) - len(chunk.slots)
    found = _predict(system, form, chunk, leaves[:split], leaves[split:])
    values = np.stack([np.broadcast_to(getattr(f, "value", f), chunk.m) for f in found])
    return values, np.stack([gradients(f, leaves, chunk.m) for f in found])


def second_derivatives(
    system: Any, form: Form, chunk: _Chunk, z: np.ndarray, rows: tuple[int, ...], steps: np.ndarray
) -> np.ndarray:
    """Gradient and Hessian of the whitened predictions in the error values `rows` and all slots: (k, m, d + 1, d), gradient last.

    Forward differences of the exact gradient, by `steps` (d,): of 0.1 µm and 0.1 µrad, where truncation is 1e-7 of a Hessian
    whose arms are 1 m, and rounding of the gradient less.
    """
    n = system.layout.n_coefficients
    at = np.concatenate([_error_values(system.layout, chunk, z), z[n + chunk.slots]])
    split = len(at) - len(chunk.slots)
    places = [*rows, *range(split, len(at))]
    result = np.empty((form.n_readings, chunk.m, len(places) + 1, len(places)), dtype=np.float32)
    weight = chunk.weight[:, None, :]
    gradient = _partials_at(system, form, chunk, at)[1][:, places]
    result[:, :, -1] = (gradient * weight).transpose(0, 2, 1)
    for j, (place, step) in enumerate(zip(places, steps, strict=True)):
        moved = at.copy()
        moved[place] += step
        moved_gradient = _partials_at(system, form, chunk, moved)[1][:, places]
        result[:, :, j] = ((moved_gradient - gradient) * (weight / step)).transpose(0, 2, 1)
    return result


def residual_rows(system: Any, form: Form, chunk: _Chunk, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Whitened residuals of one chunk, (k·m,), and their Jacobian, (size, k·m); as `equations.residual_rows`."""
    values, partials, bases = _partials(system, form, chunk, z)
    return _residual(chunk, values).reshape(-1), _rows(system, chunk, partials, bases, np.float64)


def _residual(chunk: _Chunk, values: np.ndarray) -> np.ndarray:
    return np.where(chunk.weight > 0.0, (values - chunk.reading) * chunk.weight, 0.0)


def _rows(system: Any, chunk: _Chunk, partials: np.ndarray, bases: list[np.ndarray], kind: Any) -> np.ndarray:
    k, width, m = partials.shape
    split, n = width - len(chunk.slots), system.layout.n_coefficients
    rows = np.zeros((system.size, k, m), dtype=kind)
    columns, bases = np.arange(m), [b.astype(kind, copy=False) for b in bases]
    for c in range(k):
        weighted = (partials[c] * chunk.weight[c]).astype(kind, copy=False)
        rows[:n, c] = coefficient_rows(system.layout, weighted[:split], bases)
        for slot, extra in zip(chunk.slots, weighted[split:], strict=True):
            rows[n + slot, c, columns] += extra
    return rows.reshape(system.size, -1)


def _prior(system: Any, z: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    root = np.asarray(system.prior_root)
    offset = root @ (z - np.asarray(system.prior_mean))
    return 0.5 * float(offset @ offset), root.T @ offset, root.T @ root


def assemble(system: Any, z: np.ndarray, rough: bool = False) -> tuple[float, np.ndarray, np.ndarray]:
    """Cost, gradient and Gauss-Newton matrix in z; as `equations.assemble`."""
    cost, gradient, matrix = _prior(system, z)
    for block in system.blocks:
        for chunk in chunks_of(block, used_only=True):
            values, partials, bases = _partials(system, block.form, chunk, z)
            residual = _residual(chunk, values)
            cost += 0.5 * float(np.sum(residual**2))
            rows = _rows(system, chunk, partials, bases, np.float32 if rough else np.float64)
            matrix += rows @ rows.T
            if rough:
                _add_gradient(system, chunk, partials, bases, residual, gradient)
            else:
                gradient += rows @ residual.reshape(-1)
    return cost, gradient, matrix


def _add_gradient(
    system: Any,
    chunk: _Chunk,
    partials: np.ndarray,
    bases: list[np.ndarray],
    residual: np.ndarray,
    gradient: np.ndarray,
) -> None:
    n, split = system.layout.n_coefficients, partials.shape[1] - len(chunk.slots)
    pulled = np.einsum("kwm,km->wm", partials, residual * chunk.weight)
    gradient[:n] += summed_rows(system.layout, pulled[:split], bases)
    for slot, extra in zip(chunk.slots, pulled[split:], strict=True):
        gradient[n:] += np.bincount(slot, extra, minlength=system.n_nuisance)


def slope(system: Any, z: np.ndarray) -> tuple[float, np.ndarray]:
    """Cost and gradient alone; as `equations.slope`."""
    cost, gradient, _ = _prior(system, z)
    for block in system.blocks:
        for chunk in chunks_of(block, used_only=True):
            values, partials, bases = _partials(system, block.form, chunk, z)
            residual = _residual(chunk, values)
            cost += 0.5 * float(np.sum(residual**2))
            _add_gradient(system, chunk, partials, bases, residual, gradient)
    return cost, gradient


def nuisance_equations(system: Any, z: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Cost, gradient and Gauss-Newton matrix in the nuisance parameters alone; as `equations.nuisance_equations`."""
    n = system.layout.n_coefficients
    cost, gradient, matrix = _prior(system, z)
    gradient, matrix = gradient[n:].copy(), matrix[n:, n:].copy()
    for block in system.blocks:
        for chunk in chunks_of(block, used_only=True):
            notes: list[Recorded] = []
            leaves = [Recorded(row, notes) for row in z[n + chunk.slots]]
            found = _predict(system, block.form, chunk, _error_values(system.layout, chunk, z), leaves)
            values = np.stack([np.broadcast_to(getattr(f, "value", f), chunk.m) for f in found])
            residual = _residual(chunk, values)
            rows, columns = np.zeros((system.n_nuisance, *values.shape)), np.arange(chunk.m)
            for c, f in enumerate(found):
                partials = gradients(f, leaves, chunk.m)
                for slot, extra in zip(chunk.slots, partials * chunk.weight[c], strict=True):
                    rows[slot, c, columns] += extra
            whole = rows.reshape(system.n_nuisance, -1)
            cost += 0.5 * float(np.sum(residual**2))
            gradient, matrix = gradient + whole @ residual.reshape(-1), matrix + whole @ whole.T
    return cost, gradient, matrix


def _error_values(layout: Layout, chunk: _Chunk, z: np.ndarray) -> np.ndarray:
    errors = error_values(layout, z[: layout.n_coefficients], chunk.bases(layout))
    return errors if errors.shape[1] else np.zeros((len(errors), chunk.m))


def _by_chunks(block: Any, function: Any) -> np.ndarray:
    return np.stack([function(chunk) for chunk in chunks_of(block)])


def predict_all(system: Any, z: np.ndarray) -> list[np.ndarray]:
    """Predicted readings of every block, (n_chunks, k, chunk)."""
    n = system.layout.n_coefficients

    def of_chunk(form: Form, chunk: _Chunk) -> np.ndarray:
        errors = _error_values(system.layout, chunk, z)
        return np.asarray(_predict(system, form, chunk, errors, z[n + chunk.slots]))

    return [_by_chunks(b, lambda chunk, form=b.form: of_chunk(form, chunk)) for b in system.blocks]


def over_rows(system: Any, z: np.ndarray, function: Any) -> list[np.ndarray]:
    """`function` of every chunk's Jacobian (size, k·chunk) and form, stacked by blocks."""
    z = np.asarray(z)
    return [
        _by_chunks(b, lambda chunk, form=b.form: function(residual_rows(system, form, chunk, z)[1], form))
        for b in system.blocks
    ]
