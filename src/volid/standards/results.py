"""What an evaluation by a standard gives: quantities under the standard's symbols, each with U, limit and verdict.

A limit is judged by the rule of ISO 14253-1 where the expanded uncertainty U (k = 2) is known: conformity is proved below
limit - U, nonconformity above limit + U, and between them neither. Without U the value is compared with the limit, and the
verdict says so. Where both sides agreed on simple acceptance, the value alone is compared, whatever its U.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from volid.exceptions import InputError

PASS, FAIL, UNDECIDED = "pass", "fail", "undecided"
MODEL, LEFT_OUT = "model", "left_out"
WITHHELD = {  # why conformity is neither stated nor denied
    MODEL: "the model is not accepted, so that its value and U do not hold",
    LEFT_OUT: "error motions that the model leaves out are not in its value",
}
GUARD_BAND, SIMPLE = "guard band", "simple"
RULES = (GUARD_BAND, SIMPLE)
RULE = (
    "ISO 14253-1: pass below limit - U, fail above limit + U, undecided between; without U the value is compared alone"
)
SIMPLE_RULE = "simple acceptance, as the limits state it: pass up to the limit, fail above; U is not regarded"


@dataclass(frozen=True)
class Quantity:
    """One evaluated number.

    Args:
        symbol: As the standard writes it: `E`, `R_up`, `G_XY`.
        value: In `unit`.
        unit: mm, degrees as "°", mm/mm for slopes, rad.
        U: Expanded uncertainty (k = 2) in `unit`, None where it is not known.
        limit: Largest value that is allowed, in `unit`; None where none was stated.
        verdict: "pass", "fail", "undecided"; empty without a limit.
        text: What the symbol means, in words.
        withheld: Why there is no verdict although there is a value, one of `WITHHELD`; "" where nothing is withheld.
    """

    symbol: str
    value: float
    unit: str
    U: float | None = None
    limit: float | None = None
    verdict: str = ""
    text: str = ""
    withheld: str = ""


@dataclass(frozen=True)
class Table:
    """What stands behind the quantities, row by row (per target, per angle …). Units stand in the names of the columns."""

    columns: tuple[str, ...] = ()
    rows: tuple[tuple[Any, ...], ...] = ()


@dataclass(frozen=True)
class Section:
    """A further table that a reader sees below the quantities.

    Args:
        key: Its name in JSON.
        title: What it shows.
        columns: Names of its columns, the first of which names the rows.
        rows: Texts, and lengths in mm (NaN where not determined), which a report shows in µm.
    """

    key: str
    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str | float, ...], ...]


@dataclass(frozen=True)
class Evaluation:
    """One evaluated test: an axis, a plane, a diagonal.

    Args:
        standard: "ISO 230-2" …
        subject: What was tested: "X", "XY", "PPP".
        quantities: In the order in which a report shows them.
        remarks: What a reader has to know: how it was evaluated, rules of the standard that the test does not follow.
        attention: Why the numbers need a second look; with one of these the command ends with status 1.
        table: What stands behind the quantities.
        source: The file or set that was evaluated.
        details: The standard's own result, for figures.
        sections: Further tables below the quantities.
        rule: The decision rule of its verdicts, one of `RULES`.

    >>> Evaluation("ISO 230-2", "X", (Quantity("E", 0.0318, "mm", U=0.0013),))["E"].value
    0.0318
    """

    standard: str
    subject: str
    quantities: tuple[Quantity, ...]
    remarks: tuple[str, ...] = ()
    attention: tuple[str, ...] = ()
    table: Table = field(default_factory=Table, repr=False)
    source: str = ""
    details: Any = field(default=None, repr=False)
    sections: tuple[Section, ...] = field(default=(), repr=False)
    rule: str = GUARD_BAND

    def __getitem__(self, symbol: str) -> Quantity:
        """The quantity of this symbol. Raises `KeyError`, which names those that there are, where there is none."""
        for quantity in self.quantities:
            if quantity.symbol == symbol:
                return quantity
        raise KeyError(f"{symbol}; expected one of {', '.join(q.symbol for q in self.quantities)}")


def verdict_of(value: float, limit: float, U: float | None = None) -> str:
    """ "pass", "fail" or "undecided" for a value that must not exceed `limit`; all in one unit.

    Source: ISO 14253-1.

    >>> verdict_of(8.0, 10.0, U=1.0), verdict_of(9.5, 10.0, U=1.0), verdict_of(9.5, 10.0), verdict_of(12.0, 10.0, U=1.0)
    ('pass', 'undecided', 'pass', 'fail')
    """
    size, margin = abs(value), U or 0.0
    if size <= limit - margin:
        return PASS
    return FAIL if size > limit + margin else UNDECIDED


def judged(evaluation: Evaluation, limits: Mapping[str, float], rule: str = GUARD_BAND) -> Evaluation:
    """The evaluation with `limits` by symbol, and a verdict for each of their quantities; a quantity without limit stays.

    Each limit is the largest size that is allowed, in the quantity's unit; `rule`: one of `RULES`. Raises `InputError` for a
    limit of a symbol that the evaluation does not have.
    """
    known = [q.symbol for q in evaluation.quantities]
    for symbol in limits:
        if symbol not in known:
            raise InputError(
                f"limits: {symbol} is no quantity of {evaluation.standard}, {evaluation.subject}; "
                f"expected one of {', '.join(known)}"
            )
    found = tuple(_judged(q, limits.get(q.symbol), rule) for q in evaluation.quantities)
    return replace(evaluation, quantities=found, rule=rule)


def _judged(quantity: Quantity, limit: float | None, rule: str) -> Quantity:
    if limit is None:
        return quantity
    margin = None if rule == SIMPLE else quantity.U
    return replace(quantity, limit=limit, verdict=verdict_of(quantity.value, limit, margin))


def withhold(evaluation: Evaluation, reasons: Mapping[str, str]) -> Evaluation:
    """The evaluation with no verdict on the quantities of `reasons`, keys of `WITHHELD` by symbol: a limit is neither kept nor
    exceeded by a number that does not hold.

    >>> found = judged(Evaluation("ISO 230-1", "machine", (Quantity("V_X", 0.001, "mm", U=0.0001),)), {"V_X": 0.01})
    >>> found["V_X"].verdict, withhold(found, {"V_X": LEFT_OUT})["V_X"].verdict
    ('pass', 'undecided')
    """
    found = (
        replace(q, verdict=UNDECIDED, withheld=reasons[q.symbol]) if q.verdict and q.symbol in reasons else q
        for q in evaluation.quantities
    )
    return replace(evaluation, quantities=tuple(found))
