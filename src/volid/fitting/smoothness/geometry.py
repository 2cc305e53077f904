"""What a campaign's geometry determines, whatever lies between its positions: the same readings at positions spread out.

On a grid of few levels no reading sees between them, and a fine spline has more coefficients than there are levels. That is not a
matter of geometry: the smoothness of the functions tells how much it matters. What is not determined are combinations that no
position would tell apart: one tool vector, two stations, an axis that stood still. So the rank is decided on a campaign whose
positions are moved at random between their neighbours, each reading several times where there are few, some of them where there
are many (`spreading`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from volid.campaign import Campaign
from volid.fitting.diagnosis.identifiability import ROTATION_UNIT, UNIT, Identifiability, analyse
from volid.fitting.equations.problem import Prior, Problem, build_problem
from volid.fitting.smoothness.processes import Process, stacked_rows
from volid.fitting.smoothness.spreading import SAME, levels_of, spread_out
from volid.model.error_functions import motion_names
from volid.model.error_model import ErrorModel
from volid.model.iso230 import parse
from volid.model.machine import Axis, Machine
from volid.observations import KINDS
from volid.observations.base import NuisanceTable

SINGULAR = 1e-13  # smallest pivot of scaled normal equations
ORDINARY = 2e3  # `_level` of a hundred readings with u = 0.5 µm: there smoothness and readings stand as in the fit
LARGEST_GAP = 60.0  # degrees: positions all around a turn leave none larger, or all of one size
NEAR = 0.01  # of the travel: as near to its end a position measures the end


def measured_machine(campaign: Campaign, earlier: Mapping[str, tuple[float, float]] | None = None) -> Machine:
    """The campaign's machine with every travel cut to what was measured; `earlier`: what an earlier solution has measured.

    An axis that stood still keeps its travel: nothing of it is determined. A rotary axis measured all around keeps its turn,
    and an end of the travel that was measured to within `NEAR` of the travel is kept.
    """
    ranges = {}
    for i, axis in enumerate(campaign.machine.axes):
        low, high = campaign.measured_range()[i].tolist()
        if axis.letter in (earlier or {}):
            before = (earlier or {})[axis.letter]
            low, high = min(low, before[0]), max(high, before[1])
        low, high = _kept_ends(low, high, axis)
        if high - low > SAME * axis.length and not (
            axis.is_full_turn and _goes_round(levels_of(campaign, i), low, high)
        ):
            ranges[axis.letter] = (low, high)
    return campaign.machine.over(ranges)


def _kept_ends(low: float, high: float, axis: Axis) -> tuple[float, float]:
    slack = NEAR * axis.length
    if high - low <= slack:
        return low, high
    start, end = axis.travel
    return (start if low <= start + slack else low, end if high >= end - slack else high)


def _goes_round(levels: np.ndarray, low: float, high: float) -> bool:
    """Whether rotary positions stand all around the turn; `low` … `high`: their range, an earlier solution's included."""
    if high - low >= 360.0 - LARGEST_GAP:
        return True
    around = np.unique(np.round(np.mod(levels, 360.0), 6))
    gaps = np.diff(np.concatenate([around, [around[0] + 360.0]]))
    return bool(len(around) > 2 and gaps.max() <= max(LARGEST_GAP, 1.5 * float(np.median(gaps))))


def range_notes(travelled: Machine, measured: Machine) -> tuple[str, ...]:
    """Notes on axes that were measured over a part of their travel, and on references that lie outside of it."""
    modelled = {n[2] for n in motion_names(travelled)}
    parts = [
        f"{m.letter} {m.travel[0]:g} … {m.travel[1]:g} of {a.travel[0]:g} … {a.travel[1]:g} {a.unit}"
        for a, m in zip(travelled.axes, measured.axes, strict=True)
        if a.travel != m.travel and a.letter in modelled
    ]
    said = "functions, reference lines, squareness and V_XYZ refer to the measured part of the travel, and compare only with such"
    partly = (f"{said}: {', '.join(sorted(parts))}",) if parts else ()
    return partly + tuple(
        f"the reference of axis {a.letter} at {a.reference:g} {a.unit} lies outside the measured range {m.travel[0]:g} … "
        f"{m.travel[1]:g} {a.unit}; functions are zero at {m.reference:g} {a.unit}"
        for a, m in zip(travelled.axes, measured.axes, strict=True)
        if a.reference != m.reference
    )


def determined(
    campaign: Campaign,
    problem: Problem,
    known: Prior,
    processes: tuple[Process, ...],
    factors: list[np.ndarray] | None = None,
) -> Identifiability:
    """What the geometry of a campaign determines of a problem's free parameters; `factors`: 0 for readings set aside.

    `known`: what is known of θ from elsewhere, without the smoothness. Functions with stated segments have no smoothness:
    positions of their axes stay where they are, and there the `processes` of other functions count as readings. So they do
    everywhere when what the spread-out campaign determines is singular for the campaign itself, whose positions are too few.
    """
    used = campaign if factors is None else _taking_part(campaign, factors)
    still = _axes_to_leave(problem.model, processes) | _pinned_axes(campaign)
    table = NuisanceTable.of(problem.nuisance)
    beside = [p for p in processes if still & {parse(n).axis for n in p.names}]
    own = known.and_smooth(_level(problem) / ORDINARY * _rows(beside, problem.model)) if beside else known
    spread = spread_out(used, problem.free.shape[1], still)
    found = analyse(build_problem(spread, problem.model, prior=own, table=table), campaign)
    if _are_many(used, processes):
        return found
    whole = build_problem(used, problem.model, prior=known.and_smooth(_rows(processes, problem.model)), table=table)
    free = whole.free @ found.basis
    matrix = free.T @ np.asarray(whole.equations.normal(problem.start).matrix) @ free
    if not _is_singular(matrix):
        return found
    own = known.and_smooth(_level(problem) / ORDINARY * _rows(processes, problem.model))
    return analyse(build_problem(used, problem.model, prior=own, table=table), campaign)


def count_determined(campaign: Campaign, problem: Problem, known: Prior, factors: list[np.ndarray]) -> int:
    """Number of combinations of θ that readings determine at their own positions, smoothness not counted as knowledge."""
    table = NuisanceTable.of(problem.nuisance)
    bare = build_problem(_taking_part(campaign, factors), problem.model, prior=known, table=table)
    found = analyse(bare, campaign)
    return int(problem.model.n_parameters - found.null_space.shape[1] - found.tool_rotation.shape[1])


def _taking_part(campaign: Campaign, factors: list[np.ndarray]) -> Campaign:
    """The campaign with the readings whose weight is not 0; as it is where none is left."""
    rows = [np.flatnonzero(np.any(f > 0.0, axis=1)) for f in factors]
    kept = tuple(s.rows_of(r) for s, r in zip(campaign.sets, rows, strict=True) if len(r))
    return replace(campaign, sets=kept or campaign.sets)


def _are_many(campaign: Campaign, processes: tuple[Process, ...]) -> bool:
    """Whether there are more positions of every axis that moves than coefficients over it: then none is too many."""
    sizes = {s.axis: s.size for p in processes for splines, _ in p.members for s in splines if s.high - s.low > 0.0}
    return all(len(levels_of(campaign, i)) > 2 * size for i, size in sizes.items())


def _level(problem: Problem) -> float:
    """Largest sensitivity of all readings together, over their u, to one coefficient in units of 0.1 mm or 0.1 mrad."""
    n = problem.model.layout.n_coefficients
    bare = replace(problem.system, prior_root=np.zeros((0, problem.system.size)), prior_value=np.zeros(0))
    diagonal = np.diagonal(np.asarray(problem.equations.changed(bare).normal(problem.start).matrix))[:n]
    units = np.ones(n)
    for f in problem.model.functions:
        units[f.coefficients] = ROTATION_UNIT if parse(f.name).is_rotation else UNIT
    return float(np.sqrt(np.max(diagonal * units**2, initial=1e-300)))


def _rows(processes: Sequence[Process], model: ErrorModel) -> np.ndarray:
    """Pseudo-readings of the processes at their medians, on θ."""
    return stacked_rows(processes, [p.median for p in processes], model.n_parameters)


def _is_singular(matrix: np.ndarray) -> bool:
    """Whether a covariance cannot be had from normal equations."""
    scale = 1.0 / np.sqrt(np.maximum(np.diagonal(matrix), 1e-300))
    try:
        lower = np.linalg.cholesky(matrix * np.outer(scale, scale))
    except np.linalg.LinAlgError:
        return True
    return bool(np.any(np.diagonal(lower) ** 2 < SINGULAR))


def _pinned_axes(campaign: Campaign) -> set[str]:
    """Letters of axes that move in sets whose unknowns belong to the positions."""
    pinned = [s for s in campaign.sets if KINDS[s.kind].is_pinned(s)]
    moved = [np.ptp(s.all_ends.positions, axis=0) > 0.0 for s in pinned]
    return {letter for own in moved for letter, moves in zip(campaign.machine.letters, own, strict=True) if moves}


def _axes_to_leave(model: ErrorModel, processes: tuple[Process, ...]) -> set[str]:
    """Letters of axes over which no function has a process, or some function has a spline without one."""
    smooth = {(name, p.part) for p in processes for name in p.names}
    stated = [f for f in model.functions if f.splines and (f.name, f.part) not in smooth]
    moving = {model.machine.letters[s.axis] for p in processes for splines, _ in p.members for s in splines}
    return set(model.machine.letters) - moving | {model.machine.letters[s.axis] for f in stated for s in f.splines}
