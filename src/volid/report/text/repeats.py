"""Repeatability as plain data and as text: what readings show of it, and what of it predictions contain. µm and µrad in the
text."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from volid.compensation.residual.repeats import Repeats
from volid.fitting.repeatability import Repeatability
from volid.model.machine import Machine
from volid.report.text.basics import micro, paragraph, unit_of

DIGITS = 2


def repeatability_data(found: Sequence[Repeatability]) -> list[dict[str, Any]]:
    """Rows for JSON, mm and rad."""
    return [asdict(r) | {"label": r.label, "unit": r.unit, "seen": r.seen} for r in found]


def repeatability_lines(rows: Sequence[dict[str, Any]]) -> list[str]:
    """What was seen, one entry per row of `repeatability_data`: "repeatability X up 0.40 µm (12 degrees of freedom), u 0.08 µm";
    then in one entry what was not, with its upper limit and degrees of freedom."""
    lines: list[str] = []
    for r in (r for r in rows if r["seen"]):
        s, u, longer, seen = (_size(r[key], r["unit"]) for key in ("s", "u", "long_term", "observed"))
        text = f"{r['label']} {s} ({r['degrees_of_freedom']:.0f} degrees of freedom), u {u}; readings show {seen}; "
        text += f"with drift between visits {longer}" if r["drift_apart"] else "drift between visits is in it"
        lines += paragraph(text, "repeatability", 14)
    below = [
        f"{r['label']} {_size(r['upper'], r['unit'])} ({r['degrees_of_freedom']:.0f})" for r in rows if not r["seen"]
    ]
    if below:
        text = "not seen above the instrument's u; at most, with 95 % probability (degrees of freedom): "
        lines += paragraph(text + ", ".join(below), "repeatability", 14)
    return lines


def _size(value: float, unit: str) -> str:
    return f"{micro(value, unit, DIGITS)} {unit_of(unit)}"


def repeats_data(repeats: Repeats, rms: Sequence[float] | None) -> dict[str, Any]:
    """What predictions contain, for JSON; mm, rad, degrees."""
    return {
        "source": repeats.source or None,
        "functional_point": repeats.common or None,
        "positions": dict(repeats.positions or {}),
        "motions": [{"what": n, "direction": way, "s": s} for (n, way), s in (repeats.motions or {}).items()],
        "rms": None if rms is None else list(rms),
        "found": repeatability_data(repeats.found),
        "not_included": list(repeats.not_included),
        "thermal_limit": repeats.thermal,
    }


def repeats_lines(repeats: Repeats, machine: Machine, rms: float | None) -> list[str]:
    """What of repeatability is in a prediction, what is missing, and what temperature adds."""
    lines: list[str] = []
    if repeats.is_known:
        alone = "" if rms is None else f": alone it leaves {1e3 * rms:.2f} µm RMS, which no compensation removes"
        text = f"repeatability, in all rows, one approach to each place{alone}; {_parts(repeats, machine)}"
        text += f" (from {repeats.source})"
        lines += paragraph(text)
    for text in repeats.not_included:
        lines += paragraph(text)
    return [*lines, *paragraph(_thermal_words(repeats))]


def _parts(repeats: Repeats, machine: Machine) -> str:
    parts = [f"functional point {_size(repeats.common, 'mm')} in X, Y and Z"] if repeats.common else []
    for letter, value in (repeats.positions or {}).items():
        unit = machine.axis(letter).unit
        parts.append(f"{letter} {_size(value, 'mm')}" if unit == "mm" else f"{letter} {value:g}°")
    for (name, way), s in (repeats.motions or {}).items():
        like = Repeatability(name, way, s, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, True)
        parts.append(f"{like.label} {_size(s, like.unit)}")
    return ", ".join(parts) or "none"


def _thermal_words(repeats: Repeats) -> str:
    if repeats.thermal is None:
        return (
            "thermal change: not known and not included; state what tests after ISO 230-3 give, [conditions] thermal_limit in "
            "mm, to have it here"
        )
    return f"thermal change: up to {1e3 * repeats.thermal:.2f} µm on top of every row, as [conditions] thermal_limit states"
