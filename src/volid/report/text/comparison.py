"""What changed between solutions in words, as plain data and as table rows. µm and µrad in the text, mm and rad elsewhere."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from volid.model.iso230 import LINEAR_AXES, describe, parse
from volid.report.text.basics import bullets, micro, paragraph, probability_words, table, unit_of, vector
from volid.validation.solutions.comparison import Comparison
from volid.validation.solutions.dates import Times
from volid.validation.solutions.function_changes import LEVEL, FunctionChange
from volid.validation.solutions.series import FunctionDrift, K, Series
from volid.validation.solutions.volume_change import VolumeChange

DIGITS = 2
CHANGE_COLUMNS = ("function", "position", "direction", "beside", "change", "u", "unit", "significant")
SERIES_COLUMNS = ("function", "position", "direction", "beside", "survey", "time", "change_since_first", "u", "unit")
_PROBABILITY = (
    f"probability: of a test value as large without change; * significant: at most {100 * LEVEL:g} % false alarms"
)
_COLUMNS = (
    "u: standard uncertainty (k = 1). found: the size that nine of ten such comparisons find; of a function, of a bump over half "
    "of its range at the least favourable place"
)
_WAYS = {1: " +", -1: " -", 0: ""}


# ------------------------------------------------------------------------------------------------------ two solutions


def comparison_lines(found: Comparison) -> list[str]:
    """The verdict, the change over the volume, every function, notes."""
    lines = [f"from {found.names[0]} to {found.names[1]}", *paragraph(_verdict(found)), ""]
    lines += paragraph(_volume_words(found.volume), "volume")
    lines += paragraph(found.datum, "datum")
    lines += ["", *_change_table(found.functions, "change"), ""]
    lines += paragraph(f"{_PROBABILITY} over all functions together (Holm). {_COLUMNS}")
    return [*lines, *_ends(found.not_tested, found.notes)]


def comparison_data(found: Comparison) -> dict[str, Any]:
    """For JSON, lengths in mm, rotations in rad: per function its largest change, u, where, and whether it is significant."""
    return {
        "from": found.names[0],
        "to": found.names[1],
        "changed": [f.name for f in found.significant],
        **{f.name: change_data(f) for f in found.functions},
        "volume": found.volume._asdict(),
        "datum": found.datum,
        "notes": found.notes,
        "attention": found.attention,
    }


def change_data(change: FunctionChange) -> dict[str, Any]:
    """One function for JSON."""
    return {
        "largest_change": change.largest_change,
        "u": change.u,
        "significant": change.significant,
        "at": change.at,
        "direction": change.direction,
        "unit": change.unit,
        "probability": change.probability,
        "chi_square": change.chi_square,
        "degrees_of_freedom": change.degrees_of_freedom,
        "smallest_found": change.smallest_found if np.isfinite(change.smallest_found) else None,
    }


def change_rows(found: Comparison) -> Iterator[tuple[Any, ...]]:
    """Every function over its range, as `CHANGE_COLUMNS`."""
    for f in found.functions:
        cells = zip(f.positions, f.directions, f.beside, f.values, f.values_u, strict=True)
        for x, way, other, value, u in cells:
            yield f.name, float(x), int(way), float(other), float(value), float(u), f.unit, int(f.significant)


def attention_of(found: Comparison) -> list[str]:
    """What a user has to know: every changed function, doubts."""
    changed = [f"{f.name} changed by {_size(f)}{_place(f)}" for f in found.significant]
    return [*changed, *found.attention]


def _verdict(found: Comparison) -> str:
    names = [f.name for f in found.significant]
    if not names:
        return "no function has changed significantly"
    return f"changed: {', '.join(names)}"


def _volume_words(volume: VolumeChange) -> str:
    if not np.isfinite(volume.largest):
        return "the change of the deviation field is not determined by both solutions"
    return (
        f"the functional point changed by {1e3 * volume.rms:.2f} µm RMS, rigid motion removed, where noise alone makes "
        f"{1e3 * volume.expected_rms:.2f} µm; most at {_position_words(volume)} with tool {vector(volume.tool)} mm: "
        f"{1e3 * volume.largest:.2f} µm, u {1e3 * volume.u:.2f} µm"
    )


def _position_words(volume: VolumeChange) -> str:
    where = zip(volume.axes, volume.position, strict=True)
    return ", ".join(f"{a} {round(v, 1):g}{' mm' if a in LINEAR_AXES else '°'}" for a, v in where)


def _change_table(functions: Sequence[FunctionChange], word: str) -> list[str]:
    header = ["", word, "u", "unit", "at", "probability", "found", "", "meaning"]
    rows = [
        [
            f.name,
            size_cell(f.largest_change, f.unit),
            size_cell(f.u, f.unit),
            unit_of(f.unit),
            "" if not np.isfinite(f.at) else f"{place_words(f.name, f.at)}{_WAYS[f.direction]}",
            probability_cell(f.probability),
            size_cell(f.smallest_found, f.unit),
            "*" if f.significant else "",
            describe(f.name),
        ]
        for f in functions
        if f.degrees_of_freedom
    ]
    return table(header, rows, right=2)


def size_cell(value: float, unit: str) -> str:
    """A size of mm or rad in µm or µrad; "n.d." where it is not determined."""
    return micro(value if np.isfinite(value) else None, unit, DIGITS)


def probability_cell(value: float) -> str:
    """A probability with as many digits as matter; "n.d." where it is not determined."""
    return probability_words(value) if np.isfinite(value) else "n.d."


def _size(change: FunctionChange) -> str:
    if not np.isfinite(change.largest_change):
        return "an amount that is not determined as such"
    unit = unit_of(change.unit)
    return f"{size_cell(change.largest_change, change.unit)} {unit} (u {size_cell(change.u, change.unit)} {unit})"


def _place(change: FunctionChange) -> str:
    return f" at {place_words(change.name, change.at)}" if np.isfinite(change.at) else ""


def place_words(name: str, at: float) -> str:
    """Where a function changed most: "X 950 mm"."""
    axis = parse(name).axis
    return f"{axis} {at:.4g}{' mm' if axis in LINEAR_AXES else '°'}"


def _ends(not_tested: Sequence[str], notes: Sequence[str]) -> list[str]:
    lines = paragraph(f"not determined, and not compared: {', '.join(not_tested)}") if not_tested else []
    return [*lines, *bullets("notes", notes)]


# ------------------------------------------------------------------------------------------------------ a series


def series_lines(found: Series, times: Times) -> list[str]:
    """Until when a compensation holds, what drifts, notes."""
    span = f"{times.words(0.0)} to {times.words(float(found.times[-1]))}"
    lines = [f"{len(found.names)} surveys, {span}", *paragraph(_series_verdict(found)), ""]
    for name, when, change in zip(found.names[1:], found.times[1:].tolist(), found.volume, strict=True):
        lines += paragraph(f"{times.words(when)}: {_since_words(change)}; {name}", "volume")
    lines += paragraph(holding_words(found, times), "holds")
    lines += paragraph(found.datum, "datum")
    lines += ["", *_change_table([f.drift for f in found.functions], "drift"), ""]
    lines += paragraph(
        f"drift: the change from the first survey to the last along a line. {_PROBABILITY} over all functions, drifts and steps "
        f"together. {_COLUMNS}"
    )
    not_tested = [f.drift.name for f in found.functions if not f.drift.degrees_of_freedom]
    return [*lines, *_ends(not_tested, found.notes)]


def _since_words(change: VolumeChange) -> str:
    if not np.isfinite(change.largest):
        return "the change of the field since the first survey is not determined"
    size = f"{1e3 * change.largest:.2f} µm (u {1e3 * change.u:.2f} µm)"
    return f"since the first up to {size}, {1e3 * change.rms:.2f} µm RMS"


def holding_words(found: Series, times: Times) -> str:
    """The date from which a compensation made from the first survey no longer holds."""
    hold = found.holding
    if not np.isfinite(hold.limit):
        return "not determined: the first survey does not determine the deviation field that a compensation would be made from"
    limit = f"the limit of {1e3 * hold.limit:.2f} µm"
    if hold.exceeded > 0:
        between = f"between {times.words(float(found.times[hold.before]))} and"
        sure = "" if hold.clearly else ", though by less than its U"
        return (
            f"a compensation made from the first survey no longer holds: {between} "
            f"{times.words(float(found.times[hold.exceeded]))} the change of the field exceeded {limit}{sure}"
        )
    if not np.isfinite(hold.rate):
        return f"not determined: no two surveys determine the whole deviation field, so its change is not judged against {limit}"
    if not hold.significant:
        return f"{_within_words(found, limit)}; {_excluded_words(found, times, limit)}"
    latest = f"and {times.words(hold.latest)}" if np.isfinite(hold.latest) else "and an open end"
    return (
        f"not exceeded within the series; going on at {1e3 * hold.rate:.3g} µm per {'day' if times.dated else 'unit of time'} "
        f"the change of the field reaches {limit} on {times.words(hold.until)} (extrapolated; between "
        f"{times.words(hold.earliest)} {latest}, k = {K:g})"
    )


def _within_words(found: Series, limit: str) -> str:
    sizes = [c.largest for c in found.volume if np.isfinite(c.largest)]
    if max(sizes, default=0.0) <= found.holding.limit:
        return f"no function drifts significantly, and the change of the field stays within {limit}"
    return (
        f"no function has changed significantly, so the change of the field, up to {1e3 * max(sizes):.2f} µm and above {limit}, "
        "is not told from what noise alone makes"
    )


def _excluded_words(found: Series, times: Times, limit: str) -> str:
    earliest = found.holding.earliest
    if earliest <= found.times[-1]:
        return f"nor do these surveys exclude that {limit} was reached"
    return f"a drift that these surveys cannot exclude reaches it not before {times.words(earliest)}"


def _series_verdict(found: Series) -> str:
    drifting = [f.drift.name for f in found.functions if f.drift.significant and f.steady]
    stepped = [f for f in found.functions if not f.steady]
    parts = [f"drifting: {', '.join(drifting)}"] if drifting else []
    parts += [_step_words(f, found.names) for f in stepped]
    return "; ".join(parts) or "no function has changed significantly"


def _step_words(function: FunctionDrift, names: Sequence[str]) -> str:
    step = function.step_change
    return (
        f"{step.name} did not change steadily, most between {names[function.before_step]} and {names[function.step]}: "
        f"{_size(step)}{_place(step)}"
    )


def series_attention(found: Series, times: Times) -> list[str]:
    """What a user has to know: every function that drifts or stepped, a limit that is exceeded, doubts."""
    lines = [
        f"{f.drift.name} drifts: {_size(f.drift)}{_place(f.drift)} over the series"
        if f.steady
        else _step_words(f, found.names)
        for f in found.significant
    ]
    over = [holding_words(found, times)] if found.holding.exceeded > 0 else []
    return [*lines, *over, *found.attention]


def series_data(found: Series, times: Times) -> dict[str, Any]:
    """For JSON: per function its drift over the series, and whether it went along a line; the field; until when it holds."""
    hold = found.holding
    return {
        "surveys": [
            {"name": name, "time": times.words(t), "volume": change}
            for name, t, change in zip(
                found.names, found.times.tolist(), [None, *(c._asdict() for c in found.volume)], strict=True
            )
        ],
        "span": float(found.times[-1]),
        "changed": [f.drift.name for f in found.significant],
        **{f.drift.name: change_data(f.drift) | _steadiness(f, found.names) for f in found.functions},
        "volume": found.drift._asdict(),
        "holds": {
            "limit": hold.limit,
            "exceeded_by": found.names[hold.exceeded] if hold.exceeded > 0 else None,
            "clearly": hold.clearly,
            "until": times.words(hold.until) if np.isfinite(hold.until) else None,
            "earliest": times.words(hold.earliest) if np.isfinite(hold.earliest) else None,
            "latest": times.words(hold.latest) if np.isfinite(hold.latest) else None,
            "rate": hold.rate,
            "u": hold.u,
        },
        "datum": found.datum,
        "notes": found.notes,
        "attention": found.attention,
    }


def _steadiness(function: FunctionDrift, names: Sequence[str]) -> dict[str, Any]:
    step = (
        None
        if function.steady
        else {"before": names[function.step], "after": names[function.before_step], **change_data(function.step_change)}
    )
    own = [names[i] for i in function.surveys]
    return {"steady": function.steady, "probability_steady": function.probability, "step": step, "surveys": own}


def series_rows(found: Series, times: Times) -> Iterator[tuple[Any, ...]]:
    """Every function over its range at every survey, less that of the first, as `SERIES_COLUMNS`."""
    for f in found.functions:
        for i, name in enumerate(found.names):
            places = f.drift.positions, f.drift.directions, f.drift.beside
            when = times.words(float(found.times[i]))
            for x, way, other, value, u in zip(*places, f.since_first[i], f.since_first_u[i], strict=True):
                yield f.drift.name, float(x), int(way), float(other), name, when, float(value), float(u), f.drift.unit
