"""Limits (TOML) that evaluated quantities are judged by: the largest size that is allowed, in mm, degrees, rad or mm/mm.

```
rule = "guard band"  # or "simple": the value alone is compared; the decision rule that both sides agreed on
E = 0.010            # of every evaluated axis, plane or diagonal
"E_*" = 0.012        # of every symbol of this form, unless it has a limit of its own
[X]                  # of this one only; it stands before the one above
E = 0.008
R_up = 0.005
```
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from fnmatch import fnmatchcase
from math import inf
from pathlib import Path
from typing import Any

from volid.backend.consent import ask
from volid.exceptions import InputError
from volid.io.basics.toml_table import Table, is_finite, read_toml
from volid.standards.results import GUARD_BAND, RULES, Evaluation, Quantity, judged

# unit of a quantity: the limit above which another unit is likely, and which
_LARGE = {"mm": (1.0, "µm"), "°": (0.1, "arcsec"), "rad": (0.01, "µrad, or in mm/m"), "mm/mm": (0.01, "µm/m")}


Limits = Mapping[str, Any]  # what the file above holds
RULE_KEY = "rule"


def read_limits(limits: str | Path | Limits) -> dict[str, dict[str, float]]:
    """Limits by subject and symbol, from a file or a mapping of its form; those for every subject stand under "".

    Raises `InputError` naming file and key for what is no positive number.

    >>> read_limits({"E": 0.010, "X": {"E": 0.008}})
    {'': {'E': 0.01}, 'X': {'E': 0.008}}
    """
    top = _table(limits)
    subjects = [key for key, value in top.data.items() if isinstance(value, Mapping)]
    tables = {"": top, **{subject: top.table(subject) for subject in subjects}}
    return {
        subject: {key: _limit(table, key) for key in table.data if subject or key not in (*subjects, RULE_KEY)}
        for subject, table in tables.items()
    }


def read_rule(limits: str | Path | Limits) -> str:
    """The decision rule that limits state, "guard band" where they state none. Raises `InputError` for another one.

    >>> read_rule({"rule": "simple", "E": 0.010}), read_rule({"E": 0.010})
    ('simple', 'guard band')
    """
    table = _table(limits)
    rule = table.get(RULE_KEY, GUARD_BAND)
    if rule not in RULES:
        raise table.wrong(RULE_KEY, f"the decision rule, one of {', '.join(RULES)}")
    return str(rule)


def _table(limits: str | Path | Limits) -> Table:
    return Table(dict(limits), "limits") if isinstance(limits, Mapping) else Table(read_toml(limits), str(limits))


def _limit(table: Table, key: str) -> float:
    value = table.get(key)
    if not is_finite(value) or value <= 0.0:
        raise table.wrong(key, "a number above 0 in mm (degrees of a rotary axis, rad of squareness), such as 0.010")
    return float(table.number(key))


def _ask_size(path: str | Path, quantity: Quantity) -> None:
    """Raises `InputError` for a limit that everything would pass, outside `accept_unusual`."""
    largest, likely = _LARGE.get(quantity.unit, (inf, ""))
    if quantity.limit is not None and quantity.limit >= largest:
        ask(
            f"{path}: {quantity.symbol} = {quantity.limit:g} is a limit of {quantity.limit:g} {quantity.unit}. Expected "
            f"{quantity.unit}: is it in {likely}?"
        )


def judge_all(evaluations: Iterable[Evaluation], limits: str | Path | Limits | None) -> list[Evaluation]:
    """Evaluations with the verdicts of limits, from a file or a mapping of its form; as they are without them.

    A limit for every subject counts where a subject has its quantity. Raises `InputError` naming file and key for a subject or
    quantity that is not there and for a form of symbols that have different units, and outside `accept_unusual` for a limit that
    looks like another unit.
    """
    evaluations = list(evaluations)
    if limits is None:
        return evaluations
    own, path = read_limits(limits), "limits" if isinstance(limits, Mapping) else limits
    general, rule = own.pop(""), read_rule(limits)
    _require_known(path, general, own, evaluations)
    result = []
    for evaluation in evaluations:
        for form in {**general, **own.get(evaluation.subject, {})}:
            _require_one_unit(path, form, evaluation)
        mine = _of_symbols(general, evaluation) | _of_symbols(own.get(evaluation.subject, {}), evaluation)
        result.append(judged(evaluation, mine, rule))
        for quantity in result[-1].quantities:
            _ask_size(path, quantity)
    return result


def _of_symbols(limits: Mapping[str, float], evaluation: Evaluation) -> dict[str, float]:
    """Limits by symbol of an evaluation: those of a form such as "E?X" first, which a symbol's own limit replaces."""
    known = [q.symbol for q in evaluation.quantities]
    forms = {name: value for form, value in limits.items() for name in known if _is_of(name, form)}
    return forms | {name: value for name, value in limits.items() if name in known}


def _is_of(symbol: str, form: str) -> bool:
    return symbol == form or fnmatchcase(symbol, form)


def _require_one_unit(path: str | Path, form: str, evaluation: Evaluation) -> None:
    """Raises `InputError` for a form of lengths and rotations alike: 0.005 mm is a limit, 0.005 rad lets everything pass."""
    by_unit: dict[str, str] = {}
    for q in evaluation.quantities:
        if _is_of(q.symbol, form):
            by_unit.setdefault(q.unit, q.symbol)
    if len(by_unit) > 1:
        found = ", ".join(f"{symbol} in {unit}" for unit, symbol in by_unit.items())
        raise InputError(
            f'{path}: "{form}" stands for quantities of different units: {found}. Expected one unit; write one form for each, '
            'such as "E[XYZ]?" and "E[ABC]?"'
        )


def _require_known(
    path: str | Path, general: Mapping[str, float], own: Mapping[str, Mapping[str, float]], found: list[Evaluation]
) -> None:
    subjects = {e.subject: [q.symbol for q in e.quantities] for e in found}
    symbols = list(dict.fromkeys(symbol for names in subjects.values() for symbol in names))
    for subject, table in {"": general, **own}.items():
        if subject and subject not in subjects:
            raise InputError(f"{path}: [{subject}] was not evaluated; expected one of {', '.join(subjects)}")
        for symbol in table:
            known = subjects[subject] if subject else symbols
            if not any(_is_of(name, symbol) for name in known):
                where = f"[{subject}] {symbol}" if subject else symbol
                raise InputError(f"{path}: {where} is no quantity of this test; expected one of {', '.join(known)}")
