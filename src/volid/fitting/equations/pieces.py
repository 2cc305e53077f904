"""Some thousand readings in the interpreted engine: linearised at once, then joined with basis values tile by tile.

A reading depends on few error values and nuisance values; their partial derivatives come from one reverse pass for each component
of a reading.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from volid.backend.reverse import Recorded, gradients
from volid.effects.prediction import predict_readings
from volid.fitting.equations.arranged import Arranged, Tile
from volid.model.error_model import ROWS
from volid.model.error_values import add_curves
from volid.model.machine import Machine


class Linear(NamedTuple):
    """A piece at some z: whitened residuals (k, m), and whitened partial derivatives (error values + slots, k, m)."""

    residual: np.ndarray
    partials: np.ndarray


class Piece(NamedTuple):
    """Tiles of a block that are taken at once."""

    block: Arranged
    tiles: list[Tile]

    @property
    def rows(self) -> slice:
        """Rows of the block."""
        return slice(self.tiles[0].first, self.tiles[-1].last)

    def linearised(self, machine: Machine, values: np.ndarray, slots_only: bool = False) -> Linear:
        """The piece at the `values` of all columns; with `slots_only` the derivatives in nuisance values alone."""
        block, own = self.block, self.rows
        errors = self.error_values(values)
        slots = values[block.columns.n_curves + block.slots[:, own]]
        notes: list[Recorded] = []
        leaves = [Recorded(row, notes) for row in (slots if slots_only else (*errors, *slots))]
        split = 0 if slots_only else len(errors)
        found = predict_readings(
            machine, block.form, block.q[:, own], tuple(block.tool[:, own]), errors if slots_only else leaves[:split],
            leaves[split:], tuple(block.constants[:, own]),
        )  # fmt: skip
        m, weight = own.stop - own.start, block.weight[:, own]
        predicted = np.stack([np.broadcast_to(getattr(f, "value", f), m) for f in found])
        partials = np.empty((len(leaves), len(weight), m))
        for k, f in enumerate(found):
            gradients(f, leaves, m, weight[k], partials[:, k])
        return Linear((predicted - block.reading[:, own]) * weight, partials)

    def error_values(self, values: np.ndarray) -> list[np.ndarray]:
        """Error values, one row (m,) each, from the `values` of all columns."""
        own, columns = self.rows, self.block.columns
        rows: list[Any] = [None] * (ROWS * (columns.layout.n_axes + 1) * (len(self.block.q) // columns.layout.n_axes))
        for k, run in enumerate(columns.runs):
            basis, curves = self.block.basis(k, own), np.empty((run.width, own.stop - own.start))
            for start, size, part in self._spans(k):
                coefficients = values[start : start + size * run.width].reshape(size, run.width)
                np.matmul(coefficients.T, basis[:size, part], out=curves[:, part])
            add_curves(rows, run.terms, curves)
        zero = np.zeros(own.stop - own.start)
        return [zero if row is None else row for row in rows]

    def _spans(self, k: int) -> Iterator[tuple[int, int, slice]]:
        """First column, coefficients and rows of the piece, of run k in every tile; without a window, all rows at once."""
        run, first = self.block.columns.runs[k], self.tiles[0].first
        if run.spline is None:
            yield run.start, run.size, slice(0, self.rows.stop - first)
            return
        for tile in self.tiles:
            yield run.start + tile.starts[k] * run.width, tile.widths[k], slice(tile.first - first, tile.last - first)

    def add_gradient(self, linear: Linear, total: np.ndarray) -> None:
        """Adds Jᵀr to `total`, in all columns."""
        block, columns = self.block, self.block.columns
        pulled = np.einsum("wkm,km->wm", linear.partials, linear.residual)
        for k, run in enumerate(columns.runs):
            basis, signed = block.basis(k, self.rows), pulled[run.rows] * run.signs
            for start, size, part in self._spans(k):
                total[start : start + size * run.width] += (basis[:size, part] @ signed[:, part].T).ravel()
        for slot, extra in zip(block.slots[:, self.rows], pulled[len(pulled) - len(block.slots) :], strict=True):
            total[columns.n_curves :] += np.bincount(slot, extra, minlength=columns.n_nuisance)

    def add_squares(self, linear: Linear, total: np.ndarray, kind: Any) -> None:
        """Adds JᵀJ to the upper triangle of `total`, in all columns, from products in numbers of type `kind`."""
        for tile, rows in self.jacobians(linear.partials, kind):
            product = rows @ rows.T
            for i, (own, target) in enumerate(tile.parts):
                for other, place in tile.parts[i:]:
                    total[target, place] += product[own, other]

    def add_nuisance(self, linear: Linear, total: Any) -> None:
        """Adds cost, gradient and JᵀJ in the nuisance parameters alone; `linear`: of those alone."""
        rows = np.zeros((self.block.columns.n_nuisance, *linear.residual.shape))
        _add_slots(rows, self.block.slots[:, self.rows], linear.partials)
        whole = rows.reshape(len(rows), -1)
        total.cost += 0.5 * float(np.sum(linear.residual**2))
        total.gradient += whole @ linear.residual.ravel()
        total.matrix += whole @ whole.T

    def jacobians(self, partials: np.ndarray, kind: Any) -> Iterator[tuple[Tile, np.ndarray]]:
        """Every tile with its Jacobian (columns, k · rows) in numbers of type `kind`.

        The next tile takes the memory of the one before.
        """
        block, first, k = self.block, self.tiles[0].first, partials.shape[1]
        partials = partials.astype(kind, copy=False)
        slots = partials[len(partials) - len(block.slots) :]
        runs = block.columns.runs
        signed = [partials[run.rows] * run.signs[:, :, None].astype(kind) for run in runs]
        bases = [block.basis(i, self.rows).astype(kind, copy=False) for i in range(len(runs))]
        room = np.empty(max(len(t.columns) * (t.last - t.first) for t in self.tiles) * k, dtype=kind)
        for tile in self.tiles:
            own, count, width = slice(tile.first - first, tile.last - first), tile.last - tile.first, len(tile.columns)
            rows, place = room[: width * k * count].reshape(width, k, count), 0
            for i, run in enumerate(runs):
                size = tile.widths[i] if run.spline is not None else run.size
                part = rows[place : place + size * run.width].reshape(size, run.width, k, count)
                np.multiply(bases[i][:size, None, None, own], signed[i][None, ..., own], out=part)
                place += size * run.width
            rows[place:] = 0.0
            number = np.searchsorted(tile.nuisance, block.slots[:, tile.first : tile.last])
            _add_slots(rows[place:], number, slots[:, :, own])
            yield tile, rows.reshape(width, k * count)


def _add_slots(rows: np.ndarray, numbers: np.ndarray, partials: np.ndarray) -> None:
    """Adds partial derivatives (slots, k, m) to the rows (parameters, k, m) with these `numbers` (slots, m)."""
    place = np.arange(numbers.shape[1])
    for number, extra in zip(numbers, partials, strict=True):
        rows[number, :, place] += extra.T
