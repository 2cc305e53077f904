"""The summary as text for a terminal: µm and µrad, U with k = 2, aligned columns of at most 100 characters."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

from volid.model.axis_lines import AXIS_LINE, MACHINE, PARAMETER
from volid.model.iso230 import DIRECTIONS, ROTATIONS
from volid.report.text.basics import bullets, micro, paragraph, table, unit_of, vector
from volid.report.text.environment import environment_words
from volid.report.text.repeats import repeatability_lines
from volid.report.text.sets import set_test_lines

_LISTED = {"outliers": 10, "suspects": 6}  # readings
_FEW = 3  # readings beyond the critical value, where a likely cause is named
_CAUSES = 3  # likely causes
_NAMED = 6  # functions left out of the model


def format_summary(data: dict[str, Any]) -> str:
    """The text of `summary` from the numbers of `summary_data`."""
    blocks = [
        _verdict_lines(data),
        _cause_lines(data),
        [] if data["barrier"] else _missing_lines(data),
        _head_lines(data),
        _set_lines(data),
        set_test_lines(data),
        _environment_lines(data),
        _held_out_lines(data),
        *([_barrier_lines(data)] if data["barrier"] else _number_blocks(data)),
        _reading_lines(data),
        bullets("notes", data["notes"]),
    ]
    return "\n\n".join("\n".join(block) for block in blocks if block)


def _number_blocks(data: dict[str, Any]) -> list[list[str]]:
    """What the readings say about the machine."""
    return [_constant_lines(data), _volume_lines(data), _function_lines(data)]


def _barrier_lines(data: dict[str, Any]) -> list[str]:
    return paragraph(
        "No squareness, volume and functions are shown, and no table or grid is made of this solution, because they would "
        "follow from a mistake. Mend it, and fit again."
    )


def _verdict_lines(data: dict[str, Any]) -> list[str]:
    """What stands above everything, the verdict, and what it depends on."""
    lines = [f"*** {banner} ***" for banner in _banners(data)] + paragraph(_verdict_words(data))
    for question in data["questions"][0 if data["rejected"] else 1 :]:
        lines += paragraph(f"Question: {question['text']}.")
    if data["not_determined"] and not data["accepted"]:
        lines.append("Not everything is determined; see below. n.d.: not determined.")
    for text in data["unseen"] if not (data["rejected"] and data["causes"]) else ():  # they follow from the misfit then
        lines += paragraph(f"Attention: {text}.")
    return lines


def _banners(data: dict[str, Any]) -> Iterator[str]:
    if data["rejected"]:
        yield "MODEL REJECTED BY THE DATA: the uncertainties below do not hold"
    elif data["questions"]:
        yield "QUESTION: the result is not accepted before it is answered"
    if not data["converged"]:
        yield "NOT CONVERGED: the iteration stopped early; do not use these numbers"


def _verdict_words(data: dict[str, Any]) -> str:
    verdict = data["verdict"][:1].upper() + data["verdict"][1:]
    if data["accepted"] and not data["converged"]:
        verdict = "Not judged, because the iteration stopped early"
    if data["accepted"] and data["not_determined"]:
        verdict += ", but not everything is determined (n.d.); see below"
    return verdict if verdict.endswith((".", "?")) else f"{verdict}."


def _cause_lines(data: dict[str, Any]) -> list[str]:
    """What explains the misfit, the best first, the others what is left then: itself, what it gains and does, and its cure."""
    texts: list[str] = []
    for cause in data["causes"][:_CAUSES]:
        numbers = []
        if cause["unknowns"]:
            several = "s" if cause["unknowns"] > 1 else ""
            numbers.append(f"gain {cause['gain']:.0f} with {cause['unknowns']} unknown{several}")
        elif cause["gain"]:
            numbers.append(f"gain {cause['gain']:.0f}")
        if cause["change"]:
            numbers.append(f"moves results by up to {cause['change']:.1f} U")
        more = f" ({'; '.join(numbers)})" if numbers else ""
        what = cause["what"] if not texts else cause["what"].split(": drift of")[0]  # what was tried is a long list
        texts.append(f"{what}{more}. What to do: {cause['cure']}.")
    return bullets("likely causes of the misfit (gain: fall of -2 ln likelihood; U: of the stated u, k = 2)", texts)


def _head_lines(data: dict[str, Any]) -> list[str]:
    machine = data["machine"]
    code = machine["structure"].strip().strip("[]")
    axes = [
        f"{a['axis']} {_span(a['travel'])} {a['unit']}"
        + ("" if a["measured"] == a["travel"] else f" (measured {_span(a['measured'])})")
        for a in data["axes"]
    ]
    lines = paragraph(f"{machine['name']}  [{code}]", "machine")
    lines += paragraph("; ".join(axes), "travel")
    lines += paragraph(data["campaign"] or "(no title)", "campaign")
    if data["active_compensations"]:
        active = "; ".join(data["active_compensations"])
        lines += paragraph(f"{active}. The errors below are those that remain with them", "active")
    return lines + paragraph(data["datum"], "datum")


def _span(pair: Sequence[float]) -> str:
    return f"{pair[0]:g} … {pair[1]:g}"


def _set_lines(data: dict[str, Any]) -> list[str]:
    rows = [
        [
            s["set"],
            s["kind"],
            str(s["n_readings"]),
            str(s["n_outliers"]),
            f"{micro(s['stated_u_rms'], s['unit'], 2)} {unit_of(s['unit'])}",
            f"{micro(s['residual_rms'], s['unit'], 2)} {unit_of(s['unit'])}",
        ]
        for s in data["sets"]
    ]
    lines = table(["set", "kind", "readings", "outliers", "stated u (RMS)", "residual RMS"], rows, left=2)
    return [*lines, *_fit_lines(data), *_repeat_lines(data["repeats"]), *repeatability_lines(data["repeatability"])]


def _environment_lines(data: dict[str, Any]) -> list[str]:
    """What was done to the readings of every set for air and temperature."""
    return bullets(
        "air and temperature", [f"{a['set']}: {'; '.join(environment_words(a))}" for a in data["environment"]]
    )


def _fit_lines(data: dict[str, Any]) -> list[str]:
    freedom = data["degrees_of_freedom"]
    counts = f"{data['n_readings']} readings, {data['n_parameters']} parameters, "
    counts += f"{freedom} degrees of freedom, {data['iterations']} iterations"
    if freedom <= 0:
        lines = paragraph(f"no redundancy, {counts}", "fit")
    else:
        weight = f"unit weight {data['unit_weight']:.2f} (1: residuals agree with the stated u)"
        lines = paragraph(f"{weight}, probability {data['probability']:.2g}, {counts}", "fit")
    return lines + paragraph(f"lack of fit: {data['lack_of_fit']['words']}", " ")


def _repeat_lines(repeats: list[dict[str, Any]]) -> list[str]:
    lines, sets = [], [c["set"] for c in repeats]
    for c in repeats:
        size = f"{c['rms_over_u']:.1f} times their u"
        if c["unit"]:
            rms, largest = (f"{micro(c[key], c['unit'], 2)} {unit_of(c['unit'])}" for key in ("rms", "max"))
            size = f"{rms} RMS, {size}; largest {largest}"
        rows = " and ".join(str(r) for r in c["rows"])
        name = f"{c['set']}, {c['reading']}" if sets.count(c["set"]) > 1 else c["set"]
        lines += paragraph(f"set {name}: {c['n']} later minus first readings, {size} (rows {rows})", "repeats")
    return lines


def _held_out_lines(data: dict[str, Any]) -> list[str]:
    """Residuals by angle: within the fit, and predicted from all other rotary positions; µm, lengths of vectors."""
    lines: list[str] = []
    for name in dict.fromkeys(b["set"] for b in data["held_out"]):
        bins = [b for b in data["held_out"] if b["set"] == name]
        unit, k = bins[0]["unit"], len(bins[0]["mean"])
        rows = [
            [
                f"{b['axis']} {_angles(b)}" if b["axis"] else "all",
                str(b["poses"]),
                *(micro(b[key], unit, 2) for key in ("residual", "held_out")),
                *(micro(m, unit, 2) for m in b["mean"]),
            ]
            for b in bins
        ]
        columns = [f"residuals of {name} by angle", "positions", "RMS", "held out"]
        columns += [f"mean {c}" for c in (("x", "y", "z") if k == 3 else [""] * k)]
        lines += table([c.strip() for c in columns], rows, left=1)
        vectors = "lengths of vectors; " if k == 3 else ""
        text = f"{unit_of(unit)}; {vectors}held out: the whole rotary position predicted from the others"
        if bins[0]["alone"]:
            text += f"; {bins[0]['alone']} rows left out, whose position alone determines something"
        lines += paragraph(text, "")
    return lines


def _angles(b: dict[str, Any]) -> str:
    return f"{b['low']:g}°" if b["low"] == b["high"] else f"{b['low']:g} … {b['high']:g}°"


def _missing_lines(data: dict[str, Any]) -> list[str]:
    fixed = data["held_tool_frame"]
    texts = list(data["not_determined"])
    if fixed:
        texts.append(
            f"{', '.join(fixed)}: tool-frame constants held at 0 and not stated; what is stated is relative to them."
        )
    return bullets("NOT DETERMINED by the data", texts)


def _constant_lines(data: dict[str, Any]) -> list[str]:
    lines: list[str] = []
    for title, key in (("squareness", "squareness"), ("location", "location_errors"), ("tool frame", "tool_frame")):
        digits = decimals(min((_in_micro(c["U"], c["unit"]) for c in data[key] if c["U"]), default=0.1))
        rows = [
            [
                c["name"],
                _said_of(c),
                micro(c["value"], c["unit"], digits),
                micro(c["U"], c["unit"], digits),
                "µm/m" if key == "squareness" else unit_of(c["unit"]),
            ]
            for c in data[key]
        ]
        if rows:
            lines += table([title.ljust(10), "", "value", "U (k = 2)", ""], rows, left=2, right=1)
            lines += _location_lines(data) if key == "location_errors" else []
    return lines


def _said_of(constant: dict[str, Any]) -> str:
    """A constant in words; a squareness error by its full symbol and the angle, where it has a value."""
    if constant.get("angle"):
        return f"{constant['symbol']}, {constant['angle']}"
    symbol = f"{constant['symbol']}, " if "symbol" in constant else ""
    return symbol + str(constant["description"]).removeprefix("squareness: ")


def _location_lines(data: dict[str, Any]) -> list[str]:
    """What the values under the symbols of location errors refer to."""
    carried = [c for c in data["location_errors"] if c["relative_to"] != MACHINE]
    text = f"{AXIS_LINE}, as ISO 230-1 has it"
    if carried:
        c = carried[0]
        text += f"; {c['name']}: relative to the line of {c['relative_to']}, which carries {c['name'][-1]}"
    return paragraph(f"{text} ({PARAMETER}: see volid locations)", "")


def _in_micro(value: float, unit: str) -> float:
    return value * (1e3 if unit == "mm" else 1e6)


def decimals(u: float) -> int:
    """Decimal places that give `u` two significant digits (GUM 7.2.6), 0 to 3."""
    return min(max(1 - math.floor(math.log10(u)), 0), 3) if u > 0 else 1


def _volume_lines(data: dict[str, Any]) -> list[str]:
    lines, before = _range_lines(data), data["volume"]["before"]
    if before["max"] is None:
        return [*lines, "deviation of the functional point: not determined for this tool vector"]
    return [*lines, *_deviation_lines(data)]


def _range_lines(data: dict[str, Any]) -> list[str]:
    """Volumetric accuracy of ISO 230-1, component by component, and what of it is not in the model."""
    accuracy, left_out = data["volume"]["accuracy"], data["volume"]["left_out"]
    units = {letter: "rad" if letter in ROTATIONS else "mm" for letter in DIRECTIONS}
    columns = [f"{letter} [{unit_of(unit)}]" for letter, unit in units.items()]
    ranges = ["–" if left_out and accuracy[c] == 0.0 else micro(accuracy[c], unit, 1) for c, unit in units.items()]
    name = "V_" + "".join(a["axis"] for a in data["axes"])
    lines = table([f"volume, tool {vector(data['tool'])} mm", *columns], [[f"{name}, ranges (ISO 230-1)", *ranges]])
    if left_out:
        more = f", … ({len(left_out)} functions)" if len(left_out) > _NAMED else ""
        names = f"{', '.join(left_out[:_NAMED])}{more}"
        lines += paragraph(f"not in the model: {names}; their effect is not in these numbers")
    return lines


def _deviation_lines(data: dict[str, Any]) -> list[str]:
    """The deviation of the functional point before compensation, and as it is expected after it."""
    volume = data["volume"]
    before, after = volume["before"], volume["after"]
    indent = 30 if after and "+" in after["type"] else 25
    text = (
        f"largest {micro(before['max'], 'mm', 1)} µm at {_place(before['at'])}; RMS {micro(before['rms'], 'mm', 1)} µm"
    )
    lines = paragraph(text, "deviation", indent) + _other_lines(before, data["tool"], indent)
    if after is None:
        return lines + paragraph(f"not predicted: {volume['not_predicted']}", "after L-VOL, expected", indent)
    nodes = " × ".join(str(n) for n in after["nodes"])
    limit = after["thermal_limit"]
    warm = "" if limit is None else f"; thermal change up to {micro(limit, 'mm', 1)} µm on top"
    return lines + paragraph(
        f"{_with_interval(after)}; {nodes} nodes{warm}", f"after {after['type']}, expected", indent
    )


def _other_lines(before: dict[str, Any], tool: Sequence[float], indent: int) -> list[str]:
    """The same with the campaign's other tool vectors, and without the rigid motion that a user's set-up takes away."""
    lines, tools, free = [], before["tools"], before["without_rigid_motion"]
    if tools and tools["tool"] == tool:
        lines += paragraph(f"no larger with any other of {tools['n']} tool vectors of the campaign", " ", indent)
    elif tools:
        text = (
            f"of {tools['n']} tool vectors: largest {micro(tools['max'], 'mm', 1)} µm with {vector(tools['tool'])} mm"
        )
        lines += paragraph(text, " ", indent)
    if free:
        text = "the deviation above contains the workpiece's motion, what follows and volid residual do not"
        lines += paragraph(f"{_with_interval(free)}; {text}", "rigid motion taken out", indent)
    return lines


def _place(at: dict[str, float]) -> str:
    return ", ".join(f"{letter} {at[letter]:.5g}" for letter in sorted(at, key=DIRECTIONS.index))


def _with_interval(found: dict[str, Any]) -> str:
    low, high = (micro(v, "mm", 1) for v in found["max_interval_95"])
    return f"largest {micro(found['max'], 'mm', 1)} µm (95 %: {low} … {high}); RMS {micro(found['rms'], 'mm', 1)} µm"


def _shape(function: dict[str, Any]) -> str:
    """Over which distance a function's values stay alike, or the segments that were stated for it."""
    segments = "×".join(str(n) for n in function["segments"])
    unit = "mm" if function["name"][2] in "XYZ" else "°"
    return f"{segments} segments" if function["smooth_over"] is None else f"{function['smooth_over']:.0f} {unit}"


def _function_lines(data: dict[str, Any]) -> list[str]:
    known = [_in_micro(f["largest_u"], f["unit"]) for f in data["functions"] if f["largest_u"]]
    digits = decimals(min(known, default=0.1))
    reversal = any(f["largest_reversal"] is not None for f in data["functions"])
    rows = []
    for f in data["functions"]:
        row = [f["name"], f["description"], *(micro(f[key], f["unit"], digits) for key in ("range", "largest_u"))]
        row += [unit_of(f["unit"]), _shape(f)]
        if reversal:
            row.insert(4, "" if f["largest_reversal"] is None else micro(f["largest_reversal"], f["unit"], digits))
        rows.append(row)
    columns = ["function".ljust(10), "", "range", "largest u", *(["reversal"] if reversal else []), "", "smooth over"]
    lines = table(columns, rows, left=2) if rows else []
    weakest = data["weakest"]
    if weakest:
        place = "" if weakest["position"] is None else f" at {weakest['axis']} = {weakest['position']:g}"
        u, unit = micro(weakest["u"], weakest["unit"], digits), unit_of(weakest["unit"])
        lines += paragraph(f"{weakest['name']}{place}: u = {u} {unit} ({weakest['description']})", "weakest")
    return lines


def _reading_lines(data: dict[str, Any]) -> list[str]:
    lines = []
    for key, what in (
        ("outliers", "readings set aside as outliers, and not used"),
        ("suspects", "readings beyond the critical value, all used (a robust fit sets such aside)"),
    ):
        readings = data[key]
        if not readings:
            continue
        shown = readings[: _FEW if data["causes"] and key == "suspects" else _LISTED[key]]
        rows = [
            [
                f"{micro(r['residual'], r['unit'], 1)} {unit_of(r['unit'])}",
                f"{r['normalised']:.1f}",
                r["label"],
                r["where"],
            ]
            for r in shown
        ]
        more = f"; the first {len(shown)}" if len(readings) > len(shown) else ""
        lines += paragraph(f"{len(readings)} {what}{more}:")
        lines += table(["residual", "normalised", "", "reading"], rows, left=0, right=2)
    return lines
