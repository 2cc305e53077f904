"""The error model: which error functions exist, how coefficients make error values, and the datum's constraints.

Error values are linear in the coefficients c; the coefficients are c = P θ with free parameters θ, where the columns of P
span the coefficients that satisfy the datum (CONVENTIONS 4: zero at the reference, zero-slope straightness). So the datum
holds exactly and the problem keeps full rank without penalty terms.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import block_diag, null_space

from volid.model.datum_constraints import (
    Reach,
    linear_constraints,
    make_splines,
    range_of,
    refine_all,
    rotary_constraints,
)
from volid.model.error_functions import (
    location_names,
    motion_groups,
    motion_names,
    reference_of,
    settings_for,
    spindle_names,
    squareness_effect,
    squareness_names,
)
from volid.model.iso230 import SPINDLE, parse
from volid.model.machine import Datum, Machine
from volid.model.splines import Basis, Spline, mean_row, segments_within

ROWS = 6
BEYOND = 0.01  # of the travel, to which the end polynomials go on
MEAN, REVERSAL, LOCATION, WAVES = "mean", "reversal", "location", "waves"
WAVE_SEGMENTS, WAVE_DEGREE = 8, 3  # of one period: three harmonics and more


class Term(NamedTuple):
    """A block of coefficients: values[row] += sign · c[start : start + size] · basis."""

    name: str
    part: str
    row: int
    basis: Basis
    start: int
    sign: float


@dataclass(frozen=True)
class Layout:
    """Static structure of a model, hashable: one compiled program serves every model with the same layout."""

    n_axes: int
    n_coefficients: int
    terms: tuple[Term, ...]

    def __hash__(self) -> int:
        return self._hash

    def __reduce__(self) -> tuple[Any, ...]:  # without what is cached: hashes of strings differ between processes
        return Layout, (self.n_axes, self.n_coefficients, self.terms)

    @cached_property
    def _hash(self) -> int:  # programs with a layout as static argument ask for it at every call
        return hash((self.n_axes, self.n_coefficients, self.terms))

    @cached_property
    def bases(self) -> tuple[Basis, ...]:
        """The distinct bases, each evaluated once per reading."""
        return tuple(dict.fromkeys(term.basis for term in self.terms))

    @cached_property
    def runs(self) -> list[list[Term]]:
        """Consecutive terms with one basis: their coefficients form a matrix, which keeps the compiled program small."""
        return [list(run) for _, run in groupby(self.terms, key=lambda term: term.basis)]


@dataclass(frozen=True)
class Function:
    """One error motion or location error of a model, with where its numbers stand.

    `splines`: empty for a constant. `coefficients`: columns in c; `parameters`: in θ, shared by
    the members of a group whose datum constraints are coupled.
    """

    name: str
    part: str
    splines: tuple[Spline, ...]
    coefficients: slice
    parameters: slice


@dataclass(frozen=True, eq=False)
class ErrorModel:
    """Error functions of a machine in a datum.

    `layout`: coefficient structure. `functions`: one entry per function part, in the order of θ.
    `parametrisation`: P, shape (n_coefficients, n_parameters). `datum`: the datum whose constraints P satisfies.
    """

    machine: Machine
    datum: Datum
    layout: Layout
    functions: tuple[Function, ...]
    parametrisation: np.ndarray

    @property
    def n_parameters(self) -> int:
        """Number of free parameters θ."""
        return self.parametrisation.shape[1]

    @cached_property
    def projection(self) -> np.ndarray:
        """(PᵀP)⁻¹Pᵀ, (n_parameters, n_coefficients): θ of coefficients c = P θ."""
        p = self.parametrisation
        return np.asarray(np.linalg.solve(p.T @ p, p.T)) if p.shape[1] else np.zeros(p.T.shape)

    @cached_property
    def by_name(self) -> dict[tuple[str, str], Function]:
        """Functions by (ISO 230-1 symbol, part), part one of "mean", "reversal", "waves", "location"."""
        return {(f.name, f.part): f for f in self.functions}

    @property
    def names(self) -> tuple[str, ...]:
        """ISO 230-1 symbols in the model, each once."""
        return tuple(dict.fromkeys(f.name for f in self.functions))

    @property
    def tool_frame(self) -> tuple[Function, ...]:
        """The constants of the tool frame among the functions, in the order of θ."""
        return tuple(f for f in self.functions if parse(f.name).axis == SPINDLE)

    @property
    def segments(self) -> dict[str, tuple[int, ...]]:
        """Number of spline intervals of every error motion within the travels."""
        return {f.name: self._within(f.splines) for f in self.functions if f.part == MEAN}

    @property
    def carrier(self) -> dict[str, tuple[int, ...]]:
        """Number of spline intervals within the travels in which the coefficients of every error motion are stored."""
        return {t.name: self._within(t.basis.factors) for t in self.layout.terms if t.part == MEAN}

    def _within(self, splines: tuple[Spline, ...]) -> tuple[int, ...]:
        return tuple(segments_within(s, *range_of(self.machine, s)) for s in splines)

    def holds(self, positions: np.ndarray) -> np.ndarray:
        """Whether the splines reach positions (m, n_axes), to 1 % of the travel, shape (m,)."""
        inside = np.ones(len(positions), dtype=bool)
        for spline in {s for f in self.functions for s in f.splines if not s.periodic}:
            slack = BEYOND * self.machine.axes[spline.axis].length
            column = positions[:, spline.axis]
            inside &= (column >= spline.low - slack) & (column <= spline.high + slack)
        return inside

    def __repr__(self) -> str:
        return f"ErrorModel({self.machine.name!r}, {len(self.names)} functions, {self.n_parameters} parameters)"

    def parameter_labels(self) -> list[str]:
        """A name for each free parameter: "EXX[3]", "EXX reversal[0]", "EC0Y"."""
        labels: list[str] = []
        for names, part, parameters in self.groups:
            name = "+".join(names) + (f" {part}" if part in (REVERSAL, WAVES) else "")
            size = parameters.stop - parameters.start
            labels += [name] if part == LOCATION else [f"{name}[{i}]" for i in range(size)]
        return labels

    @property
    def groups(self) -> list[tuple[tuple[str, ...], str, slice]]:
        """Functions that share parameters, their part, and their parameters, in the order of θ."""
        found: dict[tuple[int, int], tuple[list[str], str, slice]] = {}
        for f in self.functions:
            key = (f.parameters.start, f.parameters.stop)
            found.setdefault(key, ([], f.part, f.parameters))[0].append(f.name)
        return [(tuple(names), part, parameters) for names, part, parameters in found.values()]


class _Builder:
    """Collects terms, functions and parametrisation blocks in order."""

    def __init__(self, machine: Machine) -> None:
        self.machine = machine
        self.terms: list[Term] = []
        self.functions: list[Function] = []
        self.blocks: list[np.ndarray] = []
        self.n_coefficients = 0
        self.n_parameters = 0

    def add(self, block: MotionBlock, signs: tuple[float, ...] = (), rows: tuple[int, ...] = ()) -> None:
        """Terms and functions of one block; `rows` default to the error motions' own rows."""
        free = slice(self.n_parameters, self.n_parameters + block.free.shape[1])
        for i, (name, basis) in enumerate(zip(block.names, block.bases, strict=True)):
            error = parse(name)
            row = rows[i] if rows else ROWS * self.machine.index(error.axis) + error.component
            self.terms.append(Term(name, block.part, row, basis, self.n_coefficients, signs[i] if signs else 1.0))
            columns = slice(self.n_coefficients, self.n_coefficients + basis.size)
            self.functions.append(Function(name, block.part, block.splines[i], columns, free))
            self.n_coefficients += basis.size
        self.n_parameters = free.stop
        self.blocks.append(block.free)

    def add_constant(self, name: str, basis: Basis, row: int, sign: float = 1.0) -> None:
        """A location error, squareness or tool-frame constant."""
        self.add(MotionBlock((name,), LOCATION, (basis,), np.eye(1), ((),)), (sign,), (row,))


@lru_cache(maxsize=1024)
def _null_space(numbers: bytes, shape: tuple[int, ...]) -> np.ndarray:
    """Orthonormal null space of a constraint matrix; the same one serves many functions and many stages of a fit."""
    return np.asarray(null_space(np.frombuffer(numbers).reshape(shape)))


class MotionBlock(NamedTuple):
    """One part (mean or reversal) of a group of error motions, and its free directions (a block of P)."""

    names: tuple[str, ...]
    part: str
    bases: tuple[Basis, ...]
    free: np.ndarray
    splines: tuple[tuple[Spline, ...], ...]


def motion_blocks(
    machine: Machine,
    datum: Datum,
    group: tuple[str, ...],
    chosen: Mapping[str, tuple[int, ...]],
    carrier: Mapping[str, tuple[int, ...]],
    reach: Reach | None = None,
) -> list[MotionBlock]:
    """Mean and, if modelled, reversal parts of a group of error motions, `chosen` segments stored in `carrier` ones."""
    axis = machine.index(parse(group[0]).axis)
    coarse = [make_splines(machine, n, chosen[n], reach) for n in group]
    fine = [make_splines(machine, n, carrier[n], reach) for n in group]
    refine = block_diag(*(refine_all(c, f) for c, f in zip(coarse, fine, strict=True)))
    if machine.axes[axis].is_linear:
        constraints = linear_constraints(machine, datum, group[0], coarse[0])
    else:
        constraints = rotary_constraints(machine, datum, group, coarse)
    free = refine @ _null_space(constraints.tobytes(), constraints.shape)
    blocks = [MotionBlock(group, MEAN, tuple(Basis(f) for f in fine), free, tuple(coarse))]
    for name, c, f in zip(group, coarse, fine, strict=True):
        reversal = settings_for(machine, name).reversal
        if reversal == "constant":
            blocks.append(MotionBlock((name,), REVERSAL, (Basis(directed=axis),), np.eye(1), ((),)))
        elif reversal:
            basis = Basis(f[:1], directed=axis)
            blocks.append(MotionBlock((name,), REVERSAL, (basis,), refine_all(c[:1], f[:1]), (c[:1],)))
    return blocks


def _wave_blocks(machine: Machine) -> list[MotionBlock]:
    """Short waves in the translations of the linear axes that have a pitch: periodic, with zero mean."""
    blocks = []
    for i, axis in enumerate(machine.axes):
        names = [n for n in motion_names(machine) if n[2] == axis.letter and not parse(n).is_rotation]
        spline = Spline(i, 0.0, axis.pitch, WAVE_SEGMENTS, WAVE_DEGREE, True)
        for name in names if axis.pitch else []:
            zero_mean = mean_row(spline, 0.0, axis.pitch)[None]
            free = _null_space(zero_mean.tobytes(), zero_mean.shape)
            blocks.append(MotionBlock((name,), WAVES, (Basis((spline,)),), free, ((spline,),)))
    return blocks


def build_model(
    machine: Machine,
    segments: Mapping[str, tuple[int, ...]],
    *,
    carrier: Mapping[str, tuple[int, ...]] | None = None,
    datum: Datum | None = None,
    reach: Reach | None = None,
) -> ErrorModel:
    """Error model of a machine with stated spline resolution over the travels, or beyond them up to `reach`.

    `segments`: intervals of every error motion, one number per axis it depends on. `carrier`: a multiple of `segments` in
    which the coefficients are stored (default: `segments`); models with one carrier share one compiled program.
    Raises `InputError` for a misused `over`.
    """
    datum = machine.datum if datum is None else datum
    builder = _Builder(machine)
    for group in motion_groups(machine):
        for block in motion_blocks(machine, datum, group, segments, segments if carrier is None else carrier, reach):
            builder.add(block)
    for block in _wave_blocks(machine):
        builder.add(block)
    for name in squareness_names(machine, datum):
        if settings_for(machine, name).use:
            target, sign = squareness_effect(name)
            axis = machine.index(parse(name).axis)
            basis = Basis(linear=(axis, reference_of(machine, datum, parse(name).axis)))
            builder.add_constant(name, basis, ROWS * axis + parse(target).component, sign)
    for name in location_names(machine):
        builder.add_constant(name, Basis(), ROWS * machine.index(parse(name).axis) + parse(name).component)
    for name in spindle_names(machine):
        builder.add_constant(name, Basis(), ROWS * len(machine.axes) + parse(name).component)
    layout = Layout(len(machine.axes), builder.n_coefficients, tuple(builder.terms))
    blocks = block_diag(*builder.blocks) if builder.blocks else np.zeros((0, 0))
    return ErrorModel(machine, datum, layout, tuple(builder.functions), blocks)
