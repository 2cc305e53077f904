"""The deviation that the effects of a type cause, at the places of a grid: linear map of θ, and values alone."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from volid.compensation.base import Base, condensed, model_errors
from volid.compensation.effects import effect_errors
from volid.compensation.grids.parts import full_positions, part_letters, rotary_letters, tool_reaching
from volid.compensation.types import ORIENTATION, CompensationType
from volid.fitting.solution import Solution
from volid.model.error_model import ROWS
from volid.model.iso230 import LINEAR_AXES, ROTARY_AXES, SPINDLE
from volid.model.jacobian import influence
from volid.model.machine import Machine

CHUNK = 256  # places at a time


class Place(NamedTuple):
    """A grid before it has values: axes, full positions (m, n_axes), tool vectors (m, 3), letters whose errors it holds."""

    axes: tuple[str, ...]
    full: np.ndarray
    tool: np.ndarray
    letters: frozenset[str]


def linear_place(machine: Machine, positions: np.ndarray, base: Base) -> Place:
    axes = tuple(a for a in LINEAR_AXES if a in machine.letters)
    full = full_positions(machine, axes, positions)
    return Place(axes, full, np.broadcast_to(base.tool, (len(full), 3)), part_letters(machine, None))


def rotary_place(machine: Machine, side: str, positions: np.ndarray, point: np.ndarray) -> Place:
    axes = tuple(a for a in ROTARY_AXES if a in rotary_letters(machine, side))
    full = full_positions(machine, axes, positions)
    return Place(axes, full, tool_reaching(machine, side, full, point), part_letters(machine, side))


def _errors(solution: Solution, t: CompensationType, base: Base, place: Place, rows: slice) -> np.ndarray:
    """Error values of the type (m, 6·(n_axes + 1), n), of the axes that this grid holds; for FOR the whole model's."""
    q = place.full[rows]
    if t.name == "FOR":
        return model_errors(solution, q, np.zeros_like(q), lambda e: e.axis in place.letters, base.turn)
    effects = tuple(e for e in t.effects if e != ORIENTATION)
    errors = effect_errors(solution, effects, base, q, np.zeros_like(q))
    for i, letter in enumerate((*solution.machine.letters, SPINDLE)):
        if letter not in place.letters:
            errors[:, ROWS * i : ROWS * i + ROWS] = 0.0
    return errors


def field_gradient(solution: Solution, t: CompensationType, base: Base, place: Place, rows: slice) -> np.ndarray:
    """Deviation as linear map of θ, (m, 6, n)."""
    caused = influence(solution.machine, place.full[rows], place.tool[rows])
    gradient = np.asarray(caused @ _errors(solution, t, base, place, rows))
    if t.name == "FOR":
        gradient[:, :3] = 0.0
    return gradient


def field_values(solution: Solution, t: CompensationType, base: Base, place: Place) -> np.ndarray:
    """Values (m, 6) alone, without uncertainty."""
    small, plain = condensed(solution, base)
    parts = [slice(s, s + 4 * CHUNK) for s in range(0, len(place.full), 4 * CHUNK)]
    return np.concatenate([field_gradient(small, t, plain, place, rows).sum(axis=2) for rows in parts])
