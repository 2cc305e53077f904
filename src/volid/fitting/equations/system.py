"""The unknowns and readings of a least-squares problem, as arrays that programs work on.

Unknowns z = [c, ν]: coefficients of the error functions, then nuisance parameters (stations, dead paths, offsets).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from volid.backend.pytrees import STATIC, map_arrays, register_dataclass
from volid.effects.prediction import Form
from volid.model.error_model import Layout
from volid.model.machine import Machine


@register_dataclass
@dataclass(frozen=True, eq=False)
class Block:
    """Readings of one form, padded with zero weight to whole chunks: every array is (n_chunks, width, chunk).

    Readings that see the machine at several positions have these one after another in `q`, `direction` and `tool`.
    `weight`: 1/u, times the square root of a robust weight, 0 for padding.
    """

    form: Form = field(metadata=STATIC)
    q: Any
    direction: Any
    tool: Any
    reading: Any
    weight: Any
    slots: Any
    constants: Any


@register_dataclass
@dataclass(frozen=True, eq=False)
class System:
    """Everything a residual needs: kinematic chain, coefficient layout, blocks, and prior knowledge of z.

    `prior_root` W, shape (r, size), and `prior_value` t, shape (r,): pseudo-readings W z = t with unit variance, from calibrated
    artefacts, from an earlier solution, and from the smoothness of the error functions.
    """

    machine: Machine = field(metadata=STATIC)
    layout: Layout = field(metadata=STATIC)
    n_nuisance: int = field(metadata=STATIC)
    blocks: tuple[Block, ...]
    prior_value: Any
    prior_root: Any

    @property
    def size(self) -> int:
        """Length of z."""
        return self.layout.n_coefficients + self.n_nuisance

    @property
    def ends(self) -> int:
        """At how many positions a reading sees the machine, at most."""
        return max((block.q.shape[1] // self.layout.n_axes for block in self.blocks), default=1)

    def prior_residual(self, z: Any) -> Any:
        """W z - t, shape (r,)."""
        return self.prior_root @ z - self.prior_value


def thinned(system: System, rows: int) -> System:
    """The system with `rows` of the readings of every block that has more, spread evenly over it."""
    blocks = []
    for block in system.blocks:
        seen = np.flatnonzero(np.asarray(block.weight).any(axis=1).ravel())
        if len(seen) > rows:
            chunk, place = np.divmod(seen[np.linspace(0, len(seen) - 1, rows).astype(int)], block.q.shape[2])
            block = map_arrays(partial(_columns, chunk, place), block)
        blocks.append(block)
    return replace(system, blocks=tuple(blocks))


def _columns(chunk: np.ndarray, place: np.ndarray, values: Any) -> np.ndarray:
    """Columns of (n_chunks, width, rows) as one chunk."""
    return np.asarray(values)[chunk, :, place].T[None]


def flat(values: np.ndarray) -> np.ndarray:
    """(n_chunks, width, rows) -> (width, n_chunks · rows)."""
    chunks, width, rows = np.shape(values)
    return np.asarray(values).transpose(1, 0, 2).reshape(width, chunks * rows)


class Normal(NamedTuple):
    """cost = |r|²/2, gradient Jᵀr and Gauss-Newton matrix JᵀJ, in z."""

    cost: Any
    gradient: Any
    matrix: Any
