"""Each set among the others: what was found of it, and by which factor its u was changed; data and text."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Any

from volid.fitting.mixed.who import Share, WhoDetermines
from volid.fitting.solution import Solution
from volid.report.text.basics import bullets, micro, paragraph, table, unit_of

COLUMNS = 5  # sets beside each other


def set_data(solution: Solution) -> dict[str, Any]:
    """`set_tests` and `variance_components` of a solution; fields as `SetTest` and `VarianceComponent` have them."""
    return {
        "set_tests": [asdict(test) for test in solution.adequacy.sets],
        "variance_components": [asdict(component) for component in solution.variance_components],
    }


def set_test_lines(data: dict[str, Any]) -> list[str]:
    """The verdict on each set, where there are several, and estimated u."""
    tests = data["set_tests"]
    lines = _table(tests) if len(tests) > 1 else []
    return lines + [line for c in data["variance_components"] for line in _component(c)]


def _table(tests: list[dict[str, Any]]) -> list[str]:
    keys = ("unit_weight", "own_weight", "disagreement", "prediction_weight", "largest_en", "rest_weight")
    rows = [
        [t["set"], f"{t['redundancy']:.0f} of {t['n']}", *(_number(t[key]) for key in keys), t["verdict"]]
        for t in tests
    ]
    short = [row[:-1] for row in rows]
    header = ["each set", "checked", "weight", "scatter", "disagrees", "predicted", "E_n", "without it"]
    lines = table(header, short)
    for verdict in dict.fromkeys(row[-1] for row in rows):
        names = [row[0] for row in rows if row[-1] == verdict]
        each = "each " if names[1:] else ""
        lines += paragraph(f"{', '.join(names)}: {each}{verdict}")
    return lines + paragraph(
        "unit weights, 1 where all is as stated; scatter: of its own, whatever other sets say; disagrees: what its residuals "
        "share with an error of the machine; predicted: its readings from all other sets, E_n the largest; without it: the "
        "others alone",
        " ",
    )


def _component(c: dict[str, Any]) -> list[str]:
    if c["u"] is None:
        return paragraph(f"set {c['set']}, {c['part']}: {c['state']}", "u")
    text = f"set {c['set']}, {c['part']}: {c['state']}, {c['factor']:.3g} ± {c['u']:.2g} times the stated u"
    return paragraph(f"{text} ({c['redundancy']:.0f} degrees of freedom; standard uncertainty)", "u")


def who_data(found: WhoDetermines) -> dict[str, Any]:
    """`who_determines` as plain objects; fields as `Determined` and `Share` have them, NaN where nothing is determined."""
    return {"sets": [asdict(row) for row in found.sets], "functions": [asdict(share) for share in found.shares]}


def format_who(found: WhoDetermines) -> str:
    """Who determines what as text: combinations by set, then u of every function without each set, and from it alone."""
    rows = [
        [row.set, *(f"{n} of {row.parameters}" for n in (row.together, row.by_itself)), str(row.only)]
        for row in found.sets
    ]
    lines = table(["who determines what", "all sets", "the set alone", "only the set"], rows)
    lines += paragraph("combinations of the parameters of the error functions", " ")
    lost = [f"without set '{row.set}': {', '.join(row.functions)}" for row in found.sets if row.functions]
    lines += ["", *bullets("no longer wholly determined", lost)] if lost else []
    names = [row.set for row in found.sets]
    for start in range(0, len(names), COLUMNS):
        for what, key in (("without", "u_without"), ("from", "u_alone"))[
            : 1 if len(names) <= 2 else 2
        ]:  # the same of two
            lines += ["", *_shares(found, names[start : start + COLUMNS], what, key)]
    return "\n".join(lines)


def _shares(found: WhoDetermines, names: list[str], what: str, key: str) -> list[str]:
    """Largest u of every function with all sets, and `what` each of some sets."""
    by_function: dict[str, list[Share]] = {}
    for share in found.shares:
        if share.set in names:
            by_function.setdefault(share.function, []).append(share)
    rows = [
        [name, _u(s[0].u, s[0].unit), *(_u(getattr(share, key), share.unit) for share in s), unit_of(s[0].unit)]
        for name, s in by_function.items()
    ]
    return table(["largest u", "all sets", *(f"{what} {name}" for name in names), ""], rows, right=1)


def _u(value: float, unit: str) -> str:
    return micro(value if math.isfinite(value) else None, unit, 2)


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.2f}"
