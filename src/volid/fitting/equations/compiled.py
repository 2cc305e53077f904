"""The compiled engine: programs that JAX traces and compiles for the shapes of a problem, then runs fast, on a GPU too.

Large arrays are put where JAX computes, once; on a processor two threads take half of the chunks each.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Any, NamedTuple

import numpy as np

from volid.backend.lazy import jax, jnp
from volid.effects.prediction import Form
from volid.fitting.equations import programs
from volid.fitting.equations.engine import Calls, PointFunction, slices, taken
from volid.fitting.equations.system import Block, Normal, System, flat
from volid.fitting.equations.tiles import Tiles, reweighted, tiles_of
from volid.model.error_model import Layout
from volid.model.machine import Machine

CHUNK, SLICE = 512, 16_384  # points of a program at once, whose values stay in the cache, and of one call
WORTH_HALVING = 8  # chunks of a block from which two threads pay
_THREADS = ThreadPoolExecutor(2, thread_name_prefix="volid-compiled")


@dataclass(frozen=True)
class Compiled:
    """The engine of compiled programs. `tiles` False: large blocks are taken chunk by chunk, so that one program serves all parts
    of a stream, whatever their cells."""

    tiles: bool = True
    name = "compiled"

    def equations(self, system: System) -> CompiledEquations:
        """The least-squares equations of a system."""
        return CompiledEquations(self, system)

    def readings(
        self, machine: Machine, form: Form, q: Any, tool: Any, errors: Any, slots: Any, constants: Any
    ) -> np.ndarray:
        """Predicted readings (k, m) of one group from its numbers, each (width, m)."""
        arrays = (jnp.asarray(a, dtype=float) for a in (q, tool, errors, slots, constants))
        return np.asarray(programs.readings(machine, form, *arrays))

    def sensitivities(
        self, machine: Machine, form: Form, q: Any, tool: Any, slots: Any, constants: Any
    ) -> tuple[np.ndarray, np.ndarray]:
        """∂reading/∂q (n_axes, k, m) and ∂reading/∂tool (3, k, m) at the nominal machine."""
        arrays = (jnp.asarray(a, dtype=float) for a in (q, tool, slots, constants))
        by_axis, by_tool = programs.sensitivities(machine, form, *arrays)
        return np.asarray(by_axis), np.asarray(by_tool)

    def by_points(
        self, function: PointFunction, machine: Machine, layout: Layout, shared: tuple[Any, ...], points: Any
    ) -> Calls:
        """`function` slice by slice of the points, all of one length, so that one program is compiled."""
        m, program = len(points[0]), _over_chunks(function)
        coefficients, *extra = jax.tree.map(jnp.asarray, shared)

        def call(part: slice) -> np.ndarray:
            rows = np.minimum(np.arange(part.start, part.start + SLICE), m - 1)  # the last repeats the last point
            chunks = jax.tree.map(_in_chunks, taken(points, rows))
            found = np.asarray(program(machine, layout, coefficients, chunks, *extra))
            whole = np.moveaxis(found, 0, -2).reshape(*found.shape[1:-1], SLICE)
            return whole[..., : part.stop - part.start]

        return slices(m, SLICE), call


@cache
def _over_chunks(function: PointFunction) -> PointFunction:
    """The program that carries a function out on chunks (n_chunks, …, `CHUNK`), one after another."""

    def over_chunks(machine: Machine, layout: Layout, coefficients: Any, chunks: Any, *extra: Any) -> Any:
        return jax.lax.map(lambda chunk: function(machine, layout, coefficients, chunk, *extra), chunks)

    program: PointFunction = jax.jit(over_chunks, static_argnames=("layout",))
    return program


def _in_chunks(values: np.ndarray) -> np.ndarray:
    return np.moveaxis(values.reshape(-1, SLICE // CHUNK, CHUNK), 1, 0)


class _Part(NamedTuple):
    """A system, or half of one, with its tiles, where JAX computes."""

    system: System
    tiles: tuple[Tiles | None, ...]


class CompiledEquations:
    """A system as compiled programs take it; see `engine.Equations`."""

    def __init__(self, engine: Compiled, system: System, tiles: tuple[Tiles | None, ...] | None = None) -> None:
        self.engine, self.system = engine, system
        if tiles is not None:
            self.tiles = tiles

    @cached_property
    def tiles(self) -> tuple[Tiles | None, ...]:
        """The readings of large blocks again, by cells of the working volume."""
        if not self.engine.tiles:
            return (None,) * len(self.system.blocks)
        layout, n = self.system.layout, self.system.n_nuisance
        return tuple(tiles_of(layout, n, block, _length(block)) for block in self.system.blocks)

    def changed(self, system: System) -> CompiledEquations:
        """The equations of `system`: the same rows with other readings, weights or prior knowledge."""
        new = zip(self.tiles, system.blocks, strict=True)
        return CompiledEquations(self.engine, system, tuple(reweighted(own, block) for own, block in new))

    @cached_property
    def _whole(self) -> System:
        return jax.tree.map(jnp.asarray, self.system)

    @cached_property
    def _parts(self) -> list[_Part]:
        """Halves where two processors share the work and no accelerator does it."""
        alone = (os.cpu_count() or 1) < 2 or jax.default_backend() != "cpu"
        parts = [_Part(self.system, self.tiles)] if alone else halves(self.system, self.tiles)
        return [jax.tree.map(jnp.asarray, part) for part in parts]

    def _sums(self, function: Callable[[_Part], Any]) -> list[np.ndarray]:
        """What `function` gives for the parts, summed, each on a thread of its own."""

        def of(part: _Part) -> list[np.ndarray]:
            return [np.asarray(a) for a in function(part)]

        if len(self._parts) == 1:
            return of(self._parts[0])
        first, second = _THREADS.map(of, self._parts)
        return [a + b for a, b in zip(first, second, strict=True)]

    def normal(self, z: np.ndarray, rough: bool = False) -> Normal:
        """Cost, gradient and JᵀJ; JᵀJ from products in single precision when `rough`."""
        return Normal(*self._sums(lambda part: programs.normal_equations(part.system, part.tiles, z, rough)))

    def slope(self, z: np.ndarray) -> tuple[float, np.ndarray]:
        """Cost and gradient alone."""
        cost, gradient = self._sums(lambda part: programs.slope(part.system, z))
        return float(cost), gradient

    def nuisance(self, z: np.ndarray) -> Normal:
        """Cost, gradient and JᵀJ in the nuisance parameters alone, all others held."""
        return Normal(*map(np.asarray, programs.nuisance_equations(self._whole, z)))

    def predictions(self, z: np.ndarray) -> list[np.ndarray]:
        """Predicted readings of every block, (n_chunks, k, chunk)."""
        return [np.asarray(a) for a in programs.predictions(self._whole, z)]

    def quadratic_forms(self, z: np.ndarray, factor: np.ndarray) -> list[np.ndarray]:
        """|F J_i|² of every whitened reading i, (n_chunks, k, chunk); `factor` F (r, size)."""
        return [np.asarray(a) for a in programs.quadratic_forms(self._whole, z, pad_rows(factor))]

    def projected(self, z: np.ndarray, factor: np.ndarray) -> list[np.ndarray]:
        """F Jᵀ of every block, (n_chunks, r, k · chunk); `factor` F (r, size)."""
        rows = len(factor)
        return [np.asarray(a)[:, :rows] for a in programs.projected(self._whole, z, pad_rows(factor))]

    def jacobian(self, z: np.ndarray) -> list[np.ndarray]:
        """Whitened Jacobian of every block, (n_chunks, size, k · chunk). For rank decisions only: it is large."""
        return [np.asarray(a) for a in programs.jacobian(self._whole, z)]


def _length(block: Block) -> int:
    """Number of rows up to the last one with a weight."""
    used = np.flatnonzero(flat(block.weight).any(axis=0))
    return int(used[-1]) + 1 if used.size else 0


def pad_rows(factor: np.ndarray, step: int = 32) -> np.ndarray:
    """Zero rows added up to a multiple of `step`, so that models of similar size share one compiled program."""
    return np.pad(np.asarray(factor), ((0, -len(factor) % step), (0, 0)))


def halves(system: System, tiles: tuple[Tiles | None, ...]) -> list[_Part]:
    """The system in two parts of equal shapes, whose sums are those of the whole; itself where a block is small or odd."""

    def cut(tree: Any, n: int) -> list[Any]:
        return [jax.tree.map(lambda a, p=p: a[p], tree) for p in (slice(0, n // 2), slice(n // 2, n))]

    found = []
    for block, own in zip(system.blocks, tiles, strict=True):
        n_chunks, n_tiles = block.q.shape[0], 0 if own is None else own.numbers.shape[0]
        if n_chunks < WORTH_HALVING or n_chunks % 2 or n_tiles % 2:
            return [_Part(system, tiles)]
        found.append([*zip(cut(block, n_chunks), cut(own, n_tiles), strict=True)])
    if not found:
        return [_Part(system, tiles)]
    first, second = (
        _Part(replace(system, blocks=tuple(f[i][0] for f in found)), tuple(f[i][1] for f in found)) for i in range(2)
    )
    return [
        first,
        second._replace(
            system=replace(
                second.system,
                prior_root=np.zeros_like(system.prior_root),
                prior_value=np.zeros_like(system.prior_value),
            )
        ),
    ]
