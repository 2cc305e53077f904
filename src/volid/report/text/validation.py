"""A validation in text, as rows of a table, as data for machines, and as a figure."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from volid.report.text.basics import bullets, micro, paragraph, probability_words, table, unit_of
from volid.validation.readings.chi_squares import Smallest
from volid.validation.readings.groups import Group
from volid.validation.readings.validation import Validation
from volid.validation.readings.verdict import MEMBERS

if TYPE_CHECKING:
    pass

COLUMNS = ("set", "row", "reading_of_row", "predicted", "reading", "residual", "u", "E_n")
SHOWN, REGIONS = 12, 6
TOGETHER = 15.0  # %: a share of readings with E_n > 1 that is usual only where they have errors in common
_PER_LENGTH = {"mm/mm": (1e6, "µm/m")}


def validation_lines(found: Validation) -> list[str]:
    """What a person reads."""
    lines = [
        *paragraph(found.verdict[:1].upper() + found.verdict[1:], "VERDICT"),
        "",
        *table(("test", "chi-square", "degrees of freedom", "limit", "probability"), [_test(t) for t in found.tests]),
        "",
        *_shares(found),
        "",
        *table(GROUP_HEADER, [_group(g) for g in _listed(found)]),
        "",
        "Smallest changes that this campaign finds with a probability of 90 %:",
        *table(("change", "from", "unit", "at the functional point / µm"), [_smallest(s) for s in found.smallest]),
    ]
    parts = (
        ("What the disagreement looks like", [f"{c.what}. {c.cure[:1].upper()}{c.cure[1:]}" for c in found.causes]),
        ("Not independent of the fit (ISO/TR 16907 11.3)", list(found.dependences)),
        ("Weak points of this validation", list(found.weak)),
        ("Notes", list(found.notes)),
    )
    for title, texts in parts:
        lines += ["", *bullets(title, texts)] if texts else []
    return lines


def _shares(found: Validation) -> list[str]:
    """How many readings have E_n > 1, and how many do so if the solution is right."""
    low, high = (100 * share for share in found.usual_e_n_above_1)
    common = " (errors of the prediction move many readings together)" if high > TOGETHER else ""
    return [
        f"E_n > 1 (U, k = 2): {100 * found.e_n_above_1:.1f} % of {len(found.e_n)} readings. Largest E_n: "
        f"{float(found.e_n.max(initial=0.0)):.2f}",
        f"95 of 100 right solutions have {low:.1f} … {high:.1f} %, on average 5 %{common}",
    ]


GROUP_HEADER = ("readings", "n", "RMS", "expected", "unit", "E_n > 1 / %")


def _test(t: Any) -> tuple[str, ...]:
    return t.what, f"{t.chi_square:.1f}", str(t.freedom), f"{t.limit:.1f}", probability_words(t.probability)


def _listed(found: Validation) -> list[Group]:
    """All sets, and of the other groups those that fit worst."""
    sets = [g for g in found.groups if g.sort == "set"]
    others = [g for g in found.groups if g.sort != "set" and g.n >= MEMBERS]
    return [*sets, *others[:REGIONS]]


def _group(g: Group) -> tuple[str, ...]:
    share = f"{100 * g.e_n_above_1:.0f}"
    if not np.isfinite(g.rms):  # lengths and angles together
        return g.what, str(g.n), "", "", g.unit, share
    return g.what, str(g.n), micro(g.rms, g.unit, 2), micro(g.expected, g.unit, 2), unit_of(g.unit), share


def _smallest(s: Smallest) -> tuple[str, ...]:
    if not np.isfinite(s.value):
        return s.name, "not found", "", ""
    factor, unit = _PER_LENGTH.get(s.unit, (0.0, unit_of(s.unit)))
    value = f"{factor * s.value:.2f}" if factor else micro(s.value, s.unit, 2)
    return s.name, value, unit, micro(s.at_point, "mm", 1)


def reading_rows(found: Validation) -> Iterator[tuple[Any, ...]]:
    """One row for every reading, as `COLUMNS` names them; rows count from 1. Empty where the set's own unknowns take it up."""
    for s in found.sets:
        for i, k in np.ndindex(*s.residual.shape):
            numbers = (float(v[i, k]) for v in (s.predicted, s.reading, s.residual, s.u, s.e_n))
            yield (s.set, int(s.rows[i]) + 1, k + 1, *numbers)


def validation_data(found: Validation) -> dict[str, Any]:
    """The same for machines: mm, rad; `inf` as null."""
    return {
        "confirmed": found.confirmed,
        "verdict": found.verdict,
        "level": found.level,
        "probability": found.probability,
        "tests": [
            {"what": t.what, "chi_square": t.chi_square, "degrees_of_freedom": t.freedom, "limit": t.limit,
             "probability": t.probability, "passed": t.passed}
            for t in found.tests
        ],
        "readings": len(found.e_n),
        "E_n_above_1": found.e_n_above_1,
        "usual_E_n_above_1": [s if np.isfinite(s) else None for s in found.usual_e_n_above_1],
        "largest_E_n": float(found.e_n.max(initial=0.0)),
        "groups": [
            {"sort": g.sort, "what": g.what, "n": g.n, "rms": g.rms, "expected": g.expected, "unit": g.unit,
             "E_n_above_1": g.e_n_above_1}
            for g in found.groups
        ],
        "causes": [{"cause": c.cause, "what": c.what, "cure": c.cure} for c in found.causes],
        "smallest_changes": [
            {"sort": s.sort, "change": s.name, "value": s.value if np.isfinite(s.value) else None, "unit": s.unit}
            for s in found.smallest
        ],
        "independent": found.is_independent,
        "dependences": list(found.dependences),
        "weak": list(found.weak),
        "left_out": dict(found.left_out),
        "notes": list(found.notes),
    }  # fmt: skip
