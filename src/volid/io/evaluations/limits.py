"""Limits (TOML) that evaluated quantities are judged by: the largest size that is allowed, mm or degrees.

```
E = 0.010            # of every evaluated axis, plane or diagonal
[X]                  # of this one only; it stands before the one above
E = 0.008
R_up = 0.005
```
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

from volid.backend.consent import ask
from volid.exceptions import InputError
from volid.io.basics.toml_table import Table, read_toml
from volid.standards.results import Evaluation, judged

_LARGE = {
    "mm": (1.0, "µm"),
    "°": (1.0, "arc sec"),
    "rad": (0.01, "µrad"),
    "mm/mm": (0.01, "µm/m"),
}  # asked about: meant in


def read_limits(path: str | Path) -> dict[str, dict[str, float]]:
    """Limits by subject and symbol; those for every subject stand under "".

    Raises `InputError` naming file and key for what is no positive number.
    """
    top = Table(read_toml(path), str(path))
    subjects = [key for key, value in top.data.items() if isinstance(value, Mapping)]
    tables = {"": top, **{subject: top.table(subject) for subject in subjects}}
    return {
        subject: {key: table.number(key, above=0.0) for key in table.data if subject or key not in subjects}
        for subject, table in tables.items()
    }


def judge_all(evaluations: Iterable[Evaluation], path: str | Path | None) -> list[Evaluation]:
    """Evaluations with the verdicts of the limits of a file; as they are without one.

    A limit for every subject counts where a subject has its quantity. Raises `InputError` naming file and key for a subject or
    quantity that is not there, and outside `accept_unusual` for a limit that looks like another unit.
    """
    evaluations = list(evaluations)
    if path is None:
        return evaluations
    limits = read_limits(path)
    general, own = limits.pop(""), limits
    _require_known(path, general, own, evaluations)
    result = []
    for evaluation in evaluations:
        known = {q.symbol for q in evaluation.quantities}
        mine = {key: value for key, value in general.items() if key in known} | own.get(evaluation.subject, {})
        result.append(judged(evaluation, mine))
    _ask_unit(path, result)
    return result


def _ask_unit(path: str | Path, found: Iterable[Evaluation]) -> None:
    """Raises `InputError` for a limit that nothing exceeds, because it is meant in a smaller unit."""
    for evaluation in found:
        for q in evaluation.quantities:
            most, smaller = _LARGE.get(q.unit, (float("inf"), ""))
            if q.limit is not None and q.limit >= most:
                ask(f"{path}: {q.symbol} = {q.limit:g} is a limit in {q.unit}. Expected less: is it in {smaller}?")


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
            if symbol not in known:
                where = f"[{subject}] {symbol}" if subject else symbol
                raise InputError(f"{path}: {where} is no quantity of this test; expected one of {', '.join(known)}")
