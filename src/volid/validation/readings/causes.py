"""What a disagreement looks like: the alternatives of a fit's diagnosis, and changes of the machine, tested beside the solution.

Further unknowns are tested as in a fit of both campaigns together, in which the machine may move within the solution's covariance
only (`fitting.diagnosis.alternatives.base`). The best one is named, then what explains the rest once it is in the model.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from volid.compensation.control import Control
from volid.fitting.diagnosis.adequacy import Cause
from volid.fitting.diagnosis.alternatives.base import Alternative, Judged, judged, with_unknowns
from volid.fitting.diagnosis.alternatives.functions import cross_effects, left_out, reversals
from volid.fitting.diagnosis.alternatives.ranking import CHANCE, WORTH
from volid.fitting.diagnosis.alternatives.readings import OUTLIERS, TOOL, scales
from volid.fitting.diagnosis.alternatives.shapes import low_order
from volid.fitting.diagnosis.alternatives.time import breaks, drifts, growths
from volid.fitting.diagnosis.around import Around
from volid.fitting.diagnosis.outcome import Outcome
from volid.model.error_model import ROWS
from volid.model.iso230 import DIRECTIONS
from volid.validation.readings.changes import ORDER, Change, function_columns
from volid.validation.readings.compensated import OtherTool, parts_of, shifts
from volid.validation.readings.equations import Linear
from volid.validation.readings.whitened import Whitened

SIGN, CHANGED, SHAPE = "sign of a function", "change of the machine", "change of a function"
TABLE, ALL = "compensation that does not act as it should", "compensation that is not stated"
CONTROL_TOOL = "tool vector that the control uses"
TOOL_STEP, LEAST_SEEN = 10.0, 1e-3  # mm, and what that must do to some reading, over its u
NAMED = 3
CARRIED = 1e-6  # share of a reading that the others check, below which nothing does
# what a function of the opposite sign adds to itself, one that does not act at all, and how near an estimate must come
OPPOSITE, MISSING, NEAR = -2.0, -1.0, 0.4
ROTATION = {"rad": (1e6, "µrad"), "mm": (1e3, "µm"), "mm/mm": (1e6, "µm/m")}
CURES = {
    SIGN: "look for a sign error between the solution, the table and the control",
    CHANGED: "identify the machine anew, or look for what has moved",
    SHAPE: "identify the machine anew, or look for what has moved",
    ALL: "state the tables and grids that were active",
    TABLE: "look at its sign and whether it is switched on",
    CONTROL_TOOL: "look at the tool data of the control, or state with `control_tool` what it uses",
    OUTLIERS: "look at it; leave it out where it is a mistake",
    TOOL: "measure the tool again, and correct its vector in the campaign",
}


def causes(
    whitened: Whitened, changes: tuple[Change, ...], parameters: np.ndarray, control: Control | None = None
) -> list[Cause]:
    """What explains the disagreement beyond chance, the best first; none where chance may.

    `changes`: of one number each; `parameters`: θ of the solution; `control`: what compensated.
    """
    now, found = around_of(whitened), list[Judged]()
    own = [*_of_changes(changes), *_of_functions(whitened.linear, parameters)]
    own += (
        [] if control is None else [*_of_the_control(whitened.linear, control), *_of_its_tool(whitened.linear, control)]
    )
    for _ in range(NAMED):
        tested = list(judged(now, [*own, *_of_the_diagnosis(now, whitened.linear)]))
        limit = float(np.log(CHANCE / max(len(tested), 1)))
        certain = [j for j in tested if j.log_probability < limit and j.score > 0.0 and _is_possible(j)]
        best = max(certain, key=lambda j: j.score, default=None)
        if best is None or (found and best.score < WORTH * found[0].score):
            break
        found.append(best)
        now = with_unknowns(now, best)
    return [_cause(j) for j in found]


def around_of(whitened: Whitened) -> Around:
    """The readings as a joint fit of both campaigns would leave them."""
    linear, rows, seen = whitened.linear, whitened.leverage_rows, whitened.linear.seen
    nothing = replace(
        Outcome.nothing(rows.shape[1]),
        errors=np.zeros((0, len(seen.errors))),
        positions=np.zeros((0, seen.positions.shape[1])),
    )
    return Around(
        linear.campaign,
        1.0,
        whitened.whitened(whitened.v),
        rows,
        np.ones(len(linear.r)),
        seen,
        nothing,
        float(whitened.v @ whitened.v),
        whitened.freedom,
    )


def _of_changes(changes: tuple[Change, ...]) -> Iterator[Alternative]:
    for c in changes:
        sort = TOOL if c.sort == "tool length" else CHANGED
        yield Alternative(sort, f"{c.name}|{c.unit}", CURES[sort], c.column[:, None])


def _of_the_control(linear: Linear, control: Control) -> Iterator[Alternative]:
    """Every table and grid, and all of them, with another factor."""
    place = linear.problem, linear.campaign, linear.z
    whole = _joined(shifts(*place, control))
    for name, without in parts_of(control):
        yield Alternative(TABLE, name, CURES[TABLE], ((whole - _joined(shifts(*place, without))) / linear.u)[:, None])
    if len(control.tables) + len(control.grids) > 1:
        yield Alternative(TABLE, "the compensation as a whole", CURES[TABLE], (whole / linear.u)[:, None])


def _of_its_tool(linear: Linear, control: Control) -> Iterator[Alternative]:
    """Tool vectors that differ by the same from those that the control is said to use."""
    place = linear.problem, linear.campaign, linear.z
    whole = _joined(shifts(*place, control))
    steps = [_joined(shifts(*place, OtherTool(control, by))) - whole for by in TOOL_STEP * np.eye(3)]
    columns = np.stack(steps, axis=1) / linear.u[:, None]
    seen = np.abs(columns).max(axis=0) > LEAST_SEEN
    if seen.any():
        letters = "".join(np.array([*DIRECTIONS[:3]])[seen])
        yield Alternative(CONTROL_TOOL, letters, CURES[CONTROL_TOOL], columns[:, seen] / TOOL_STEP)


def _joined(parts: tuple[np.ndarray, ...]) -> np.ndarray:
    return np.concatenate([p.ravel() for p in parts])


def _of_functions(linear: Linear, parameters: np.ndarray) -> Iterator[Alternative]:
    """Every function with another factor, which a sign error makes -1, and with another shape of low order."""
    every = list(function_columns(linear, parameters))
    for name, column in every:
        if np.any(column != 0.0):
            yield Alternative(SIGN, name, CURES[SIGN], column[:, None])
    yield Alternative(ALL, "the machine", CURES[ALL], np.sum([c for _, c in every], axis=0)[:, None])
    for i, axis in enumerate(linear.model.machine.axes):
        q = linear.seen.positions[:, i]
        for component in range(ROWS) if np.ptp(q) > 0.0 else ():
            shape = linear.seen.errors[ROWS * i + component] * low_order(axis, q, ORDER)
            name = f"E{DIRECTIONS[component]}{axis.letter}"
            yield Alternative(SHAPE, f"{name} has another shape", CURES[SHAPE], linear.seen.summed(shape.T))


def _of_the_diagnosis(around: Around, linear: Linear) -> Iterator[Alternative]:
    yield from drifts(around)
    yield from growths(around, linear.model.machine)
    yield from breaks(around)
    yield from scales(around)
    yield _outlier(around)
    yield from reversals(around, linear.model)
    yield from cross_effects(around, linear.model)
    yield from left_out(around, linear.model)


def _outlier(around: Around) -> Alternative:
    """The one reading that fits worst; further ones come in the next turns."""
    redundancy = 1.0 - np.sum(around.rows**2, axis=1)
    normalised = np.where(redundancy > CARRIED, np.abs(around.v) / np.sqrt(np.maximum(redundancy, CARRIED)), 0.0)
    worst = int(np.argmax(normalised))
    column = np.zeros((len(around.v), 1))
    column[worst] = 1.0
    what = f"the reading of {around.where(worst)} does not fit the others"
    return Alternative(OUTLIERS, what, CURES[OUTLIERS], column, tried=float(len(around.v)))


def _is_possible(j: Judged) -> bool:
    """A factor is named only where it is that of the opposite sign, or none: another one is a change of the machine."""
    factors = {SIGN: (OPPOSITE,), TABLE: (OPPOSITE, MISSING), ALL: (MISSING,)}.get(j.alternative.cause)
    return factors is None or any(abs(float(j.values[0]) - f) < NEAR for f in factors)


def _cause(j: Judged) -> Cause:
    return Cause(
        j.alternative.cause,
        _words(j),
        j.alternative.cure,
        j.drop,
        j.gain,
        j.k,
        j.log_probability / float(np.log(10.0)),
        0.0,
    )


def _words(j: Judged) -> str:
    """The alternative in words, with its size where it is one number."""
    what, _, unit = j.alternative.what.partition("|")
    if j.alternative.cause in (SIGN, TABLE):
        is_opposite = abs(float(j.values[0]) - OPPOSITE) < NEAR
        return f"{what} acts with the opposite sign" if is_opposite else f"{what} does not act"
    if j.alternative.cause == CONTROL_TOOL:
        by = ", ".join(f"{float(v):+.0f} mm in {a}" for a, v in zip(what, j.values.tolist(), strict=True))
        return f"the control uses another tool vector, by about {by}"
    if j.alternative.cause == ALL:
        return "the readings are those of a machine whose errors are compensated"
    if not unit:
        return what
    factor, said = ROTATION[unit]
    u = float(np.linalg.norm(j.values)) / np.sqrt(max(j.drop, 1e-300))
    return f"{what} differs by {factor * float(j.values[0]):+.2f} ± {factor * 2.0 * u:.2f} {said} (U, k = 2)"
