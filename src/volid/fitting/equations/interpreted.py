"""The interpreted engine: NumPy arrays with recorded derivatives, nothing traced or compiled.

A piece of some thousand readings goes through the chain at once; its partial derivatives meet the basis values tile by tile
(`arranged`), where JᵀJ is a product of few columns. Two threads share the pieces, in sums whose order does not depend on how many
processors there are. Agrees with the compiled engine to rounding.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property, partial
from typing import Any

import numpy as np

from volid.backend.reverse import Recorded, gradients
from volid.effects.prediction import Form, predict_readings
from volid.fitting.equations.arranged import Arranged, arranged
from volid.fitting.equations.columns import columns_of
from volid.fitting.equations.engine import Calls, PointFunction, slices, taken
from volid.fitting.equations.pieces import Piece
from volid.fitting.equations.system import Block, Normal, System, flat
from volid.model.error_model import ROWS, Layout
from volid.model.error_values import error_values, evaluate_bases
from volid.model.machine import Machine

SHARED = 8192  # readings from which two threads pay
STRAIGHT = 4096  # readings, or points, that are predicted at once
_THREADS = ThreadPoolExecutor(2, thread_name_prefix="volid-interpreted")


class Interpreted:
    """The engine without compiled programs."""

    name = "interpreted"

    def equations(self, system: System) -> InterpretedEquations:
        """The least-squares equations of a system."""
        return InterpretedEquations(self, system)

    def readings(
        self, machine: Machine, form: Form, q: Any, tool: Any, errors: Any, slots: Any, constants: Any
    ) -> np.ndarray:
        """Predicted readings (k, m) of one group from its numbers, each (width, m)."""
        return np.asarray(predict_readings(machine, form, q, tuple(tool), errors, slots, constants))

    def sensitivities(
        self, machine: Machine, form: Form, q: Any, tool: Any, slots: Any, constants: Any
    ) -> tuple[np.ndarray, np.ndarray]:
        """∂reading/∂q (n_axes, k, m) and ∂reading/∂tool (3, k, m) at the nominal machine."""
        notes: list[Recorded] = []
        axes, tools = ([Recorded(row, notes) for row in np.asarray(a, dtype=float)] for a in (q, tool))
        m = np.shape(q)[1]
        errors = np.zeros((ROWS * (len(machine.axes) + 1) * (len(axes) // len(machine.axes)), m))
        found = predict_readings(machine, form, axes, tuple(tools), errors, slots, constants)
        rows = np.stack([gradients(f, [*axes, *tools], m) for f in found], axis=1)
        return rows[: len(axes)], rows[len(axes) :]

    def by_points(
        self, function: PointFunction, machine: Machine, layout: Layout, shared: tuple[Any, ...], points: Any
    ) -> Calls:
        """`function` slice by slice of the points."""

        def call(part: slice) -> np.ndarray:
            return np.asarray(function(machine, layout, shared[0], taken(points, part), *shared[1:]))

        return slices(len(points[0]), STRAIGHT), call


class _Sums:
    """Cost, gradient and upper triangle of JᵀJ (in columns of a number `size`), of one thread."""

    def __init__(self, size: int, square: bool = True) -> None:
        self.cost, self.gradient = 0.0, np.zeros(size)
        self.matrix = np.zeros((size, size) if square else (0, 0))

    def add(self, other: _Sums) -> None:
        """Add the sums of another thread."""
        self.cost += other.cost
        self.gradient += other.gradient
        self.matrix += other.matrix


class InterpretedEquations:
    """A system as NumPy takes it; see `engine.Equations`."""

    def __init__(self, engine: Interpreted, system: System, blocks: Sequence[Arranged | None] | None = None) -> None:
        self.engine, self.system = engine, system
        self.columns = columns_of(system.layout, system.n_nuisance, system.ends)
        if blocks is not None:
            self.blocks = blocks

    @cached_property
    def blocks(self) -> Sequence[Arranged | None]:
        """Every block's rows by tiles; None where none has a weight."""
        return [arranged(self.columns, block) for block in self.system.blocks]

    def changed(self, system: System) -> InterpretedEquations:
        """The equations of `system`: the same rows with other readings, weights or prior knowledge."""
        new = zip(self.blocks, system.blocks, strict=True)
        return InterpretedEquations(self.engine, system, [own and own.changed(block) for own, block in new])

    def normal(self, z: np.ndarray, rough: bool = False) -> Normal:
        """Cost, gradient and JᵀJ; JᵀJ from products in single precision when `rough`."""
        kind = np.float32 if rough else np.float64

        def add(piece: Piece, values: np.ndarray, sums: _Sums) -> None:
            linear = self._add_slope(piece, values, sums)
            piece.add_squares(linear, sums.matrix, kind)

        sums = self._summed(add, z, square=True)
        cost, gradient, root = self._prior(z)
        matrix = root.T @ root + self.columns.folded_square(sums.matrix)
        return Normal(cost + sums.cost, gradient + self.columns.folded(sums.gradient), matrix)

    def slope(self, z: np.ndarray) -> tuple[float, np.ndarray]:
        """Cost and gradient alone."""
        sums = self._summed(self._add_slope, z, square=False)
        cost, gradient, _ = self._prior(z)
        return cost + sums.cost, gradient + self.columns.folded(sums.gradient)

    def _add_slope(self, piece: Piece, values: np.ndarray, sums: _Sums) -> Any:
        linear = piece.linearised(self.system.machine, values)
        sums.cost += 0.5 * float(np.sum(linear.residual**2))
        piece.add_gradient(linear, sums.gradient)
        return linear

    def nuisance(self, z: np.ndarray) -> Normal:
        """Cost, gradient and JᵀJ in the nuisance parameters alone, all others held."""
        n, sums, values = self.system.layout.n_coefficients, _Sums(self.system.n_nuisance), self.columns.spread(z)
        for piece in self._pieces():
            piece.add_nuisance(piece.linearised(self.system.machine, values, slots_only=True), sums)
        cost, gradient, root = self._prior(z)
        matrix = root[:, n:].T @ root[:, n:]
        return Normal(cost + sums.cost, gradient[n:] + sums.gradient, matrix + sums.matrix)

    def _pieces(self) -> list[Piece]:
        used = [block for block in self.blocks if block is not None]
        return [Piece(block, tiles) for block in used for tiles in block.pieces()]

    def _summed(self, add: Callable[[Piece, np.ndarray, _Sums], Any], z: np.ndarray, square: bool) -> _Sums:
        """`add` adds every piece to sums; every second piece of a large set goes to a second thread, with sums of its own."""
        values, pieces = self.columns.spread(z), self._pieces()

        def all_of(own: list[Piece]) -> _Sums:
            sums = _Sums(self.columns.size, square)
            for piece in own:
                add(piece, values, sums)
            return sums

        if sum(block.m for block in self.blocks if block is not None) < SHARED:
            return all_of(pieces)
        first, second = _THREADS.map(all_of, (pieces[::2], pieces[1::2]))
        first.add(second)
        return first

    def _prior(self, z: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        root = np.asarray(self.system.prior_root)
        offset = np.asarray(self.system.prior_residual(np.asarray(z)))
        return 0.5 * float(offset @ offset), root.T @ offset, root

    def predictions(self, z: np.ndarray) -> list[np.ndarray]:
        """Predicted readings of every block, (n_chunks, k, chunk)."""
        return [_chunked(self._predicted(block, np.asarray(z)), block) for block in self.system.blocks]

    def _predicted(self, block: Block, z: np.ndarray) -> np.ndarray:
        layout, n = self.system.layout, self.system.layout.n_coefficients
        q, way, tool, slots, constants = map(flat, (block.q, block.direction, block.tool, block.slots, block.constants))
        result = np.empty((block.form.n_readings, q.shape[1]))
        for start in range(0, q.shape[1], STRAIGHT):
            own = slice(start, min(start + STRAIGHT, q.shape[1]))
            errors = error_values(layout, z[:n], evaluate_bases(layout, q[:, own], way[:, own]))
            if not errors.shape[1]:
                errors = np.zeros((len(errors) * (len(q) // layout.n_axes), own.stop - own.start))
            result[:, own] = predict_readings(
                self.system.machine, block.form, q[:, own], tuple(tool[:, own]), errors, z[n + slots[:, own]],
                tuple(constants[:, own]),
            )  # fmt: skip
        return result

    def quadratic_forms(self, z: np.ndarray, factor: np.ndarray) -> list[np.ndarray]:
        """|F J_i|² of every whitened reading i, (n_chunks, k, chunk); `factor` F (r, size)."""
        spread = self.columns.spread(factor)
        square = spread.T @ spread

        def of(rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
            if len(columns) >= len(spread):
                return np.einsum("ri,ri->i", *2 * [spread[:, columns] @ rows])
            return np.einsum("ri,ri->i", square[np.ix_(columns, columns)] @ rows, rows)

        return self._over_rows(z, of, ())

    def projected(self, z: np.ndarray, factor: np.ndarray) -> list[np.ndarray]:
        """F Jᵀ of every block, (n_chunks, r, k · chunk); `factor` F (r, size)."""
        spread = self.columns.spread(factor)
        found = self._over_rows(z, lambda rows, columns: spread[:, columns] @ rows, (len(spread),))
        return [_side_by_side(a) for a in found]

    def jacobian(self, z: np.ndarray) -> list[np.ndarray]:
        """Whitened Jacobian of every block, (n_chunks, size, k · chunk). For rank decisions only: it is large."""

        def of(rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
            whole = np.zeros((self.system.size, rows.shape[1]))
            np.add.at(whole, self.columns.source[columns], rows)
            return whole

        return [_side_by_side(a) for a in self._over_rows(z, of, (self.system.size,))]

    def _over_rows(self, z: np.ndarray, function: Any, lead: tuple[int, ...]) -> list[np.ndarray]:
        """`function` of every tile's Jacobian (columns, k · rows) and the numbers of its columns, (n_chunks, *lead, k, chunk).

        0 for readings without weight.
        """
        values, found = self.columns.spread(z), []
        for block, own in zip(self.system.blocks, self.blocks, strict=True):
            k = block.form.n_readings
            result = np.zeros((*lead, k, block.q.shape[0] * block.q.shape[2]))
            if own is not None:
                for piece in map(partial(Piece, own), own.pieces()):
                    partials = piece.linearised(self.system.machine, values).partials
                    for tile, rows in piece.jacobians(partials, np.float64):
                        part = function(rows, tile.columns)
                        result[..., own.numbers[tile.first : tile.last]] = part.reshape(*lead, k, -1)
            found.append(_chunked(result, block))
        return found


def _chunked(values: np.ndarray, block: Block) -> np.ndarray:
    """(…, k, n_chunks · chunk) -> (n_chunks, …, k, chunk)."""
    cut = values.reshape(*values.shape[:-1], block.q.shape[0], block.q.shape[2])
    return np.moveaxis(cut, -2, 0)


def _side_by_side(values: np.ndarray) -> np.ndarray:
    """(n_chunks, width, k, chunk) -> (n_chunks, width, k · chunk)."""
    return values.reshape(*values.shape[:2], -1)
