"""Several solutions of one machine in one datum, over the range that all of them have measured.

Reference lines, squareness and zeros depend on the range and the datum (CONVENTIONS 4), so numbers of two solutions compare only
after both are in the same ones: θ' = S θ of one model that all share. S is exact where all have measured the same ranges. Where
they have not, it is the nearest field over the common range.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from volid.exceptions import InputError
from volid.fitting.change_of_datum import EXTRAPOLATED, hold_tool_rotation
from volid.fitting.datum import s_transformation
from volid.fitting.diagnosis.identifiability import parameter_units
from volid.fitting.prior import check_prior
from volid.fitting.solution import Solution
from volid.model.error_functions import settings_for, squareness_names
from volid.model.error_model import LOCATION, ErrorModel, build_model
from volid.model.machine import Datum, Machine
from volid.model.rigid_fields import column_space

LEAST_RANGE = 0.05  # of the travel: common ranges shorter than this carry no functions


@dataclass(frozen=True, eq=False)
class State:
    """One solution in the model that all share.

    `name`: in messages. `solution`: as it was given. `map` S (n', n): θ' = S θ.
    """

    name: str
    solution: Solution
    map: np.ndarray

    @cached_property
    def theta(self) -> np.ndarray:
        """θ', shape (n',)."""
        return np.asarray(self.map @ np.asarray(self.solution.parameters))

    @cached_property
    def covariance(self) -> np.ndarray:
        """Of θ', with the factor of enlarged u, shape (n', n')."""
        return np.asarray(self.map @ self.solution.parameter_covariance @ self.map.T)

    @cached_property
    def reach(self) -> np.ndarray:
        """S C of the unknowns (θ, ν) without the factor, shape (n', n + k): what pseudo-readings act through."""
        n = self.solution.model.n_parameters
        return np.asarray(self.map @ self.solution.bare_covariance[:n])

    @cached_property
    def null(self) -> np.ndarray:
        """Directions of θ' that the readings do not determine, in its units, shape (n', d)."""
        solution = self.solution
        held = np.zeros((solution.model.n_parameters, solution.held_directions.shape[1]))
        places = [f.parameters.start for f in solution.model.tool_frame]
        held[places] = np.asarray(solution.held_directions) * parameter_units(solution.model)[places, None]
        return np.asarray(self.map @ np.hstack([np.asarray(solution.null_space), held]))


@dataclass(frozen=True, eq=False)
class States:
    """Solutions in one model. `exact`: all have measured the same ranges. `notes`: what was done to bring them together."""

    model: ErrorModel
    states: tuple[State, ...]
    exact: bool
    notes: tuple[str, ...]

    @property
    def machine(self) -> Machine:
        """The machine over the common range."""
        return self.model.machine

    def open_directions(self, who: Sequence[int] | np.ndarray | None = None) -> np.ndarray:
        """Orthonormal basis (n', d), in units of 0.1 mm and 0.1 mrad, of what some solution does not determine; `who`: numbers of
        the solutions that are asked, None: all."""
        asked = self.states if who is None else [self.states[i] for i in who]
        null = np.hstack([s.null for s in asked]) / parameter_units(self.model)[:, None]
        return column_space(null) if null.shape[1] else null

    def only(self, who: Sequence[int]) -> States:
        """Some of the solutions, in the same model."""
        return replace(self, states=tuple(self.states[i] for i in who))


def in_one_model(solutions: Sequence[Solution], names: Sequence[str], datum: Datum | None = None) -> States:
    """Two solutions or more, in the datum of the first or a stated one, over the range that all have measured.

    Raises `InputError` for other machines, other error functions, or ranges that hardly overlap.
    """
    first = solutions[0]
    for solution, name in zip(solutions, names, strict=True):
        _check(first, names[0], solution, name)
    ranges, notes = _common_ranges(solutions)
    machine = first.machine.over(ranges)
    wanted = _within(machine, first.datum if datum is None else datum)
    finest = {
        n: tuple(max(own) for own in zip(*(s.model.segments[n] for s in solutions), strict=True))
        for n in first.model.segments
    }
    exact = all(s.machine.axes == machine.axes for s in solutions)
    own = first.model if exact and all(s.model.segments == finest for s in solutions) else None
    carrier = None if own is None else own.carrier
    model = (
        own if own is not None and own.datum == wanted else build_model(machine, finest, carrier=carrier, datum=wanted)
    )
    states = tuple(State(n, s, _map(s, model)) for n, s in zip(names, solutions, strict=True))
    return States(model, states, own is not None, notes)


def _map(solution: Solution, model: ErrorModel) -> np.ndarray:
    """S of one solution."""
    if solution.model.layout == model.layout and solution.datum == model.datum:
        return np.eye(model.n_parameters)
    return s_transformation(solution.model, model, hold_tool_rotation(solution, model), exact=False)[0]


def _check(first: Solution, name_of_first: str, solution: Solution, name: str) -> None:
    """Raises `InputError` unless both describe the same machine with the same error functions."""
    if EXTRAPOLATED in solution.options:
        raise InputError(f"{name}: the solution is extrapolated; compare the solution as it was fitted")
    if first.machine.structure.split() != solution.machine.structure.split():
        raise InputError(
            f"{name}: its machine is '{solution.machine.structure}', that of {name_of_first} '{first.machine.structure}'; "
            "expected solutions of one machine"
        )
    try:
        check_prior(solution, first.campaign.machine)
    except InputError as error:
        raise InputError(f"{name} and {name_of_first}: {str(error).removeprefix('prior: ')}") from None
    of_first, of_other = _functions(first), _functions(solution)
    only = ((name, of_other - of_first), (name_of_first, of_first - of_other))
    for holder, extra in only:
        if extra:
            words = ", ".join(sorted(" ".join(e).removesuffix(" mean").removesuffix(" location") for e in extra))
            raise InputError(
                f"{name} and {name_of_first}: only {holder} has {words}; expected the same [model.functions] in both. Fit one "
                "of them again with the model of the other"
            )


def _functions(solution: Solution) -> set[tuple[str, str]]:
    """Symbols and parts of a model, squareness as the machine's own datum names it."""
    machine = solution.campaign.machine
    here = set(squareness_names(machine, solution.datum))
    own = {(f.name, f.part) for f in solution.model.functions if f.name not in here}
    return own | {(n, LOCATION) for n in squareness_names(machine, machine.datum) if settings_for(machine, n).use}


def _common_ranges(solutions: Sequence[Solution]) -> tuple[dict[str, tuple[float, float]], tuple[str, ...]]:
    """The range of every axis that all have measured, and notes on axes of which that is a part only.

    Raises `InputError` where there is hardly any.
    """
    ranges, notes = {}, []
    for axis in solutions[0].machine.axes:
        own = [s.machine.axis(axis.letter).travel for s in solutions]
        low, high = max(r[0] for r in own), min(r[1] for r in own)
        travel = solutions[0].campaign.machine.axis(axis.letter)
        if high - low < LEAST_RANGE * travel.length:
            found = ", ".join(f"{r[0]:g} … {r[1]:g}" for r in own)
            raise InputError(
                f"axis {axis.letter}: the solutions have measured {found} {axis.unit}, and hardly any of it in common; "
                "expected ranges that overlap"
            )
        ranges[axis.letter] = (low, high)
        if len(set(own)) > 1:
            notes.append(f"{axis.letter} {low:g} … {high:g} {axis.unit}")
    said = "measured ranges differ; everything refers to the part that all have measured, reference lines and squareness too"
    return ranges, (f"{said}: {', '.join(notes)}",) if notes else ()


def _within(machine: Machine, datum: Datum) -> Datum:
    """The datum with references inside the common ranges."""
    moved = tuple((a, float(np.clip(v, *machine.axis(a).travel))) for a, v in datum.reference)
    return replace(datum, reference=moved)
