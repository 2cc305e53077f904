"""Each set among the others: what was found of it, and by which factor its u was changed; data and text."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from volid.fitting.solution import Solution
from volid.report.text import paragraph, table


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
    for row in rows:
        lines += paragraph(row[-1], f"{row[0]}: ", len(row[0]) + 2)
    return lines + paragraph(
        "unit weights, 1 where all is as stated; scatter: of its own, whatever other sets say; disagrees: what its residuals share "
        "with an error of the machine; predicted: its readings from all other sets, E_n the largest; without it: the others alone",
        " ",
    )


def _component(c: dict[str, Any]) -> list[str]:
    if c["u"] is None:
        return paragraph(f"set {c['set']}, {c['part']}: {c['state']}", "u")
    text = f"set {c['set']}, {c['part']}: estimated, {c['factor']:.3g} ± {c['u']:.2g} times the stated u"
    return paragraph(f"{text} ({c['redundancy']:.0f} degrees of freedom; standard uncertainty)", "u")


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.2f}"
