"""A solution on one screen: the verdict first, then what was measured, the numbers most asked for, and what is missing.

`summary_data` holds the numbers in mm and rad, ready for JSON (None: not determined); `summary_text` prints them.
Expanded uncertainties have k = 2; ranges are largest minus smallest value over the measured range.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from volid.backend.rms import rms
from volid.campaign import Campaign
from volid.compensation.grids.linear import linear_grid
from volid.compensation.grids.parts import left_out
from volid.compensation.grids.rotary import rotary_grids
from volid.compensation.residual.prediction import MOST_SAMPLES
from volid.compensation.residual.tools import campaign_tools
from volid.compensation.residual.volume import (
    VolumeSummary,
    predict_residual,
    predict_uncompensated,
    volumetric_summary,
)
from volid.effects.environment.remarks import accounts
from volid.exceptions import InputError, NotDeterminedError
from volid.fitting.diagnosis.adequacy import ACCEPTED, ENLARGED, SuspectReading
from volid.fitting.diagnosis.hold_out import by_angle, total
from volid.fitting.repeatability import repeatability
from volid.fitting.results import FunctionValue
from volid.fitting.solution import Solution
from volid.fitting.squareness import angle_in_words, squareness_symbol
from volid.fitting.tabulation import constant, whole_motion
from volid.model.axis_lines import MACHINE, LineRow, constant_rows
from volid.model.error_functions import describe_datum
from volid.model.iso230 import DIRECTIONS, LINEAR_AXES, ROTARY_AXES, SPINDLE, describe, parse
from volid.observations import KINDS
from volid.observations.base import DEGREES
from volid.plausibility.checks import closures
from volid.plausibility.conditions import active_compensations, thermal_limit
from volid.report.text.repeats import repeatability_data
from volid.report.text.sets import set_data
from volid.report.text.summary_lines import format_summary
from volid.uncertainty.lack_of_fit import lack_of_fit

FORMAT = "volid-summary/1"
K = 2.0
_POINTS = 101  # of each function, for its range and largest u


def summary_data(
    solution: Solution, tool: Sequence[float] | None = None, most_draws: int = MOST_SAMPLES
) -> dict[str, Any]:
    """The summary as plain objects that JSON has, mm and rad; None is what is not determined.

    Args:
        solution: A solution, as `volid.fit` makes it.
        tool: Tool vector (3,) for which the volumetric numbers hold [mm]; None: the one of most readings.
        most_draws: At most so many draws of the parameters for the intervals.
    """
    x, y, z = solution.most_used_tool() if tool is None else map(float, tool)
    data = {
        "format": FORMAT,
        **_verdict(solution),
        **_origin(solution),
        **set_data(solution),
        "tool": [x, y, z],
        **(_NO_NUMBERS if solution.adequacy.barrier else _numbers(solution, (x, y, z), most_draws)),
        "not_determined": list(solution.statements),
        "unseen": list(solution.unseen),
        "held_tool_frame": list(solution.held_tool_rotation),
        "outliers": [_reading(r) for r in solution.readings.outlier_readings],
        "suspects": [_reading(r) for r in solution.adequacy.suspects],
        "repeats": _repeats(solution.campaign),
        "repeatability": repeatability_data(repeatability(solution.campaign, solution.readings.outliers)),
        "held_out": _held_out(solution),
        "environment": accounts(solution.campaign),
        "notes": list(solution.notes),
        "provenance": dict(solution.provenance),
    }
    return {key: plain(value) for key, value in data.items()}


_NO_NUMBERS: dict[str, Any] = {  # behind the barrier: they would follow from a mistake
    "squareness": [],
    "location_errors": [],
    "tool_frame": [],
    "volume": None,
    "functions": [],
    "weakest": None,
}


def _numbers(solution: Solution, tool: tuple[float, float, float], most_draws: int) -> dict[str, Any]:
    """What a solution says about the machine."""
    table = _tabulated(solution)
    return {
        **_constants(solution),
        "volume": _volume(solution, tool, most_draws),
        "functions": [_function(solution, n) for n in table if not parse(n).location],
        "weakest": _weakest(row for rows in table.values() for row in rows),
    }


def _verdict(solution: Solution) -> dict[str, Any]:
    """Whether the model agrees with the data, and the numbers of the fit."""
    adequacy, statistics, lack = solution.adequacy, solution.statistics, lack_of_fit(solution)
    return {
        "accepted": adequacy.grade in (ACCEPTED, ENLARGED),
        "grade": adequacy.grade,
        "factor": adequacy.factor,
        "causes": [asdict(cause) for cause in adequacy.causes],
        "rejected": adequacy.rejected,
        "verdict": adequacy.verdict,
        "questions": [asdict(question) for question in adequacy.questions],
        "barrier": adequacy.barrier or None,
        "unit_weight": adequacy.unit_weight,
        "probability": adequacy.probability,
        "degrees_of_freedom": adequacy.degrees_of_freedom,
        "lack_of_fit": lack._asdict() | {"words": str(lack)},
        "converged": statistics.converged,
        "iterations": statistics.iterations,
        "n_readings": statistics.n_readings,
        "n_parameters": statistics.n_parameters,
    }


def _origin(solution: Solution) -> dict[str, Any]:
    """What was measured: machine, axes, campaign, datum, sets."""
    sets = range(len(solution.campaign.sets))
    return {
        "machine": {"name": solution.machine.name, "structure": solution.machine.structure},
        "axes": _axes(solution),
        "campaign": solution.campaign.title,
        "active_compensations": active_compensations(solution.campaign.conditions),
        "datum": describe_datum(solution.machine, solution.datum),
        "sets": [row for i in sets for row in _set_rows(solution, i)],
    }


def _constants(solution: Solution) -> dict[str, Any]:
    """The constants by what they belong to, axis by axis."""
    order = (*DIRECTIONS, SPINDLE)
    lines = sorted(
        constant_rows(solution.model),
        key=lambda line: (order.index(parse(line.name).axis), line.relative_to != MACHINE, parse(line.name).component),
    )
    by_axis = [(line, parse(line.name).axis) for line in lines]
    return {
        "squareness": [_squareness(solution, line) for line, axis in by_axis if axis in LINEAR_AXES],
        "location_errors": [_location_error(solution, line) for line, axis in by_axis if axis in ROTARY_AXES],
        "tool_frame": [_constant(solution, line) for line, axis in by_axis if axis == SPINDLE],
    }


def plain(value: Any) -> Any:
    """The value in types that JSON has: None for NaN and infinities, lists for arrays."""
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _axes(solution: Solution) -> list[dict[str, Any]]:
    rows = zip(solution.campaign.machine.axes, solution.measured_range(), strict=True)
    found = [{"axis": a.letter, "unit": a.unit, "travel": a.travel, "measured": measured} for a, measured in rows]
    return sorted(found, key=lambda row: DIRECTIONS.index(row["axis"]))


def _set_rows(solution: Solution, i: int) -> Iterator[dict[str, Any]]:
    readings, results, stated = solution.campaign.sets[i], solution.readings, solution.stated_u[i]
    for kind, unit, rows, _ in KINDS[readings.kind].parts(readings):
        used = ~results.outliers[i][rows]
        to_rad = np.pi / 180.0 if unit == DEGREES else 1.0
        yield {
            "set": readings.name,
            "kind": kind,
            "n_readings": int(used.size),
            "n_outliers": int(used.size - used.sum()),
            "u_rms": to_rad * rms(readings.u[rows][used]),
            "stated_u_rms": to_rad * rms(stated[rows][used]),
            "residual_rms": to_rad * rms(results.residuals[i][rows][used]),
            "unit": "rad" if unit == DEGREES else unit,
        }


def _constant(solution: Solution, line: LineRow) -> dict[str, Any]:
    found = constant(solution, line)
    words = {"name": line.symbol, "description": describe(line.name), "unit": parse(line.name).unit}
    return words | {"value": found.value, "u": found.u, "U": K * found.u, "k": K}


def _squareness(solution: Solution, line: LineRow) -> dict[str, Any]:
    """A squareness error with its full `symbol` and the `angle` in words, "" where it is not determined."""
    found = _constant(solution, line)
    angle = angle_in_words(line.name, found["value"], found["U"])
    return found | {"symbol": squareness_symbol(line.name), "angle": angle}


def _location_error(solution: Solution, line: LineRow) -> dict[str, Any]:
    """A location error: `value` and `line` are the axis average line's, relative to `relative_to`; `parameter`: tool relative to
    workpiece."""
    found = _constant(solution, line)
    sign = -1.0 if solution.machine.axis(parse(line.name).axis).primed else 1.0
    return found | {"relative_to": line.relative_to, "line": found["value"], "parameter": sign * found["value"]}


def _volume(solution: Solution, tool: tuple[float, float, float], most_draws: int) -> dict[str, Any]:
    """ISO 230-1 volumetric accuracy, deviation before compensation, and as expected after L-VOL (and R-VOL) grids.

    `left_out`: error motions of the linear axes that are not in the model; `not_predicted`: why `after` is None.
    """
    found = {
        **_before(solution, tool, most_draws),
        "after": None,
        "left_out": left_out(solution.machine, LINEAR_AXES),
        "not_predicted": "not determined for this tool vector",
    }
    if found["left_out"]:
        return found | {"not_predicted": "the model leaves out error functions"}
    try:
        after = _expected(solution, tool, most_draws)
    except NotDeterminedError:
        return found
    except InputError:
        return found | {"not_predicted": "no grid holds the errors of these rotary axes"}
    return found | {"not_predicted": None, "after": after} if math.isfinite(after["max"]) else found


def _before(solution: Solution, tool: tuple[float, float, float], most_draws: int) -> dict[str, Any]:
    """`accuracy` and the deviation `before` compensation: in the stated datum, with which of the campaign's tool vectors it is
    largest where there are several, and with the rigid motion of the workpiece taken out."""
    before, letters = volumetric_summary(solution, tool), solution.machine.letters
    place = dict(zip(letters, before.before_at.tolist(), strict=True))
    found = {
        "max": before.before_max,
        "rms": before.before_rms,
        "at": place,
        "tools": None,
        "without_rigid_motion": None,
    }
    if math.isfinite(before.before_max):
        found["tools"] = _worst_tool(solution, tool, before)
        free = predict_uncompensated(solution, tool, most_draws)
        found["without_rigid_motion"] = {"max": free.maximum, "max_interval_95": free.interval, "rms": free.rms}
    return {"accuracy": dict(zip(DIRECTIONS, before.accuracy.tolist(), strict=True)), "before": found}


def _worst_tool(solution: Solution, tool: tuple[float, float, float], own: VolumeSummary) -> dict[str, Any] | None:
    """The largest deviation in the stated datum of the campaign's tool vectors, `n` that are determined; None if it has one.

    `own`: the numbers for `tool` (3,) [mm]."""
    others = [tuple(t) for t in campaign_tools(solution, np.asarray(tool))[1:].tolist()]
    found = {tool: own} | {t: volumetric_summary(solution, t) for t in others}
    known = {t: v for t, v in found.items() if math.isfinite(v.before_max)}
    if len(known) < 2:
        return None
    worst = max(known, key=lambda t: known[t].before_max)
    place = dict(zip(solution.machine.letters, known[worst].before_at.tolist(), strict=True))
    return {"n": len(known), "max": known[worst].before_max, "tool": list(worst), "at": place}


def _expected(solution: Solution, tool: tuple[float, float, float], most_draws: int) -> dict[str, Any]:
    """What is expected to remain after L-VOL (and R-VOL) grids [mm]. Raises `NotDeterminedError`, `InputError`."""
    grid = linear_grid(solution, tool=tool)
    tables = () if all(axis.is_linear for axis in solution.machine.axes) else rotary_grids(solution)
    try:
        after = predict_residual(solution, grid, rotary=tables, most_draws=most_draws)
    except InputError as blank:  # rotations of the grid, which a turned tool would need
        raise NotDeterminedError(str(blank)) from None
    return {
        "type": " + ".join(dict.fromkeys([grid.type, *(t.type for t in tables)])),
        "nodes": [len(nodes) for nodes in grid.nodes],
        "max": after.maximum,
        "max_interval_95": after.interval,
        "rms": after.rms,
        "interpolation": after.interpolation,
        "thermal_limit": thermal_limit(solution.campaign.conditions),
    }


def _tabulated(solution: Solution) -> dict[str, list[FunctionValue]]:
    """Rows of every function and constant by name, axis by axis in the order X, Y, Z, tool frame."""
    found: dict[str, list[FunctionValue]] = {}
    for row in solution.functions(points=_POINTS):
        found.setdefault(row.name, []).append(row)
    order = (*DIRECTIONS, SPINDLE)
    return {n: found[n] for n in sorted(found, key=lambda n: (order.index(parse(n).axis), parse(n).component))}


def _function(solution: Solution, name: str) -> dict[str, Any]:
    _, directions, values, u = whole_motion(solution, name, _POINTS)
    reversal = values[directions == 1] - values[directions == -1]
    known = bool(np.isfinite(values).all())
    return {
        "name": name,
        "description": describe(name),
        "unit": parse(name).unit,
        "range": float(np.ptp(values)) if known else math.nan,
        "largest_u": float(u.max()) if known else math.nan,
        "largest_reversal": float(np.abs(reversal).max()) if known and reversal.size else None,
        "segments": list(solution.model.segments[name]),
        "smooth_over": _smooth_over(solution, name),
    }


def _smooth_over(solution: Solution, name: str) -> float | None:
    """Distance over which a function's values stay alike, as estimated [mm or degrees]; None where segments are stated."""
    lengths = {e.function: e.length for e in solution.seen_lengths if e.axis == name[2]}
    return lengths.get(name)


def _weakest(rows: Iterable[FunctionValue]) -> dict[str, Any] | None:
    """Where the functions and constants that are completely determined have their largest u, 1 µm counting as 1 µrad."""
    rows = list(rows)
    partly = {row.name for row in rows if not math.isfinite(row.u)}
    known = [row for row in rows if row.name not in partly]
    if not known:
        return None
    worst = max(known, key=lambda row: row.u * (1e6 if parse(row.name).is_rotation else 1e3))
    words = {"name": worst.name, "description": describe(worst.name), "unit": parse(worst.name).unit}
    return words | {"axis": worst.axis, "position": worst.position, "u": worst.u, "U": K * worst.u, "k": K}


def _reading(reading: SuspectReading) -> dict[str, Any]:
    return {
        "where": reading.where,
        "label": reading.label,
        "residual": reading.residual * (np.pi / 180.0 if reading.unit == DEGREES else 1.0),
        "normalised": reading.normalised,
        "unit": "rad" if reading.unit == DEGREES else reading.unit,
    }


def _held_out(solution: Solution) -> list[dict[str, Any]]:
    """Residuals of every set with rotary motion, within the fit and held out, all together (axis "") and by angle."""
    results, found = solution.readings, []
    poses = solution.campaign.rotary_poses() if results.held_out else []
    for i, readings in enumerate(solution.campaign.sets if results.held_out else ()):
        units = [part.unit for part in KINDS[readings.kind].parts(readings)]
        held_out, residual = results.held_out[i], results.residuals[i]
        known = np.isfinite(held_out).all(axis=1)
        used = known & ~results.outliers[i].any(axis=1)
        if len(units) > 1 or not used.any():
            continue
        bins = by_angle(solution.machine, readings, poses[i], residual, held_out, used)
        overall = [total(readings.name, poses[i], residual, held_out, used)] if bins else []
        found += [asdict(b) | {"unit": units[0], "alone": int((~known).sum())} for b in (*overall, *bins)]
    return found


def _repeats(campaign: Campaign) -> list[dict[str, Any]]:
    """How well readings repeated at one place agree: drift and repeatability, before any model."""
    units = {s.name: [part.unit for part in KINDS[s.kind].parts(s)] for s in campaign.sets}
    return [
        {
            "set": c.set,
            "reading": c.reading,
            "n": c.n,
            "unit": units[c.set][0] if len(units[c.set]) == 1 else None,
            "rms": c.rms,
            "max": c.max,
            "rms_over_u": c.rms_ratio,
            "rows": c.rows,
        }
        for c in closures(campaign)
    ]


def summary(solution: Solution, tool: Sequence[float] | None = None) -> str:
    """The summary as text for a terminal: about 70 lines of at most 100 characters, the verdict first.

    Lengths in µm, rotations in µrad, expanded uncertainties with k = 2; "n.d." is what is not determined.

    Args:
        solution: A solution, as `volid.fit` makes it.
        tool: Tool vector (3,) for which the volumetric numbers hold [mm]; None: the one of most readings.

    Source: ISO 230-1 for V_XYZ and the symbols.

    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/published_positioning/campaign.toml"))
    >>> print(volid.summary(solution).splitlines()[0])
    Not testable: there are no more readings than unknowns.
    """
    return format_summary(summary_data(solution, tool))
