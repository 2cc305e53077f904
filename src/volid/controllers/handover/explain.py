"""What a control declares, in words: for a person who decides whether to use it, before there is a solution."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields
from typing import Any

import numpy as np

from volid.compensation.types import TYPES
from volid.controllers.base import COMPENSATION, ERROR, INCREMENTAL, OPEN, POSITION, Controller, Declaration, Fact
from volid.controllers.handover.markdown import bullets, heading, steps, table, text_of

SIGNS = {
    ERROR: "error values, actual - nominal: the control takes them off",
    COMPENSATION: "compensation values, -(actual - nominal): the control adds them",
    POSITION: "actual positions: nominal + error",
    OPEN: "not said by public sources: state it (`sign`), and prove it with the one-point check",
}
BEYOND = {"not stated by public sources": "not stated by public sources: stay within the tables, or try it"}


def explained(control: Controller) -> str:
    """The declaration of a control as a text with headings and tables."""
    d = control.declaration
    lines = [*heading(f"{d.name}: {d.title}", 1), *table(["property", "declared"], _properties(d))]
    lines += [*heading("Types of ISO/TR 16907 that it carries, the most complete first"), *_carried(d)]
    lines += ["", f"Others: {d.nearest}."]
    if d.options:
        rows = [[o.name, o.meaning, option_words(o.default)] for o in d.options]
        lines += [*heading("Options"), *table(["option", "meaning", "default"], rows)]
    lines += [*heading("What is known, and on what it rests"), *fact_lines(d.facts)]
    for title, texts in commissioning(d):
        lines += [*heading(title), *steps(texts)]
    return text_of(lines)


def option_words(value: Any) -> str:
    """The value of an option as a user would state it.

    >>> option_words(True), option_words(None), option_words({"X": "X1", "Y": "Y1"}), option_words({})
    ('1', 'not stated', 'X=X1,Y=Y1', 'not stated')
    """
    if value is None or value == {}:
        return "not stated"
    if isinstance(value, bool):
        return str(int(value))
    if type(value) is dict:
        return ",".join(f"{k}={v}" for k, v in value.items())
    return str(value)


def explained_data(control: Controller) -> dict[str, Any]:
    """The declaration of a control for JSON."""
    d = control.declaration
    found = {f.name: getattr(d, f.name) for f in fields(d)}
    options = [{"name": o.name, "meaning": o.meaning, "default": option_words(o.default)} for o in d.options]
    told = {"options": options, "facts": [asdict(f) for f in d.facts], "commissioning": asdict(d.commissioning)}
    return found | {"carries": dict(d.carries)} | told


def commissioning(d: Declaration) -> list[tuple[str, Sequence[str]]]:
    """Titles and steps of what a person does at the control; without what there is nothing to do for."""
    c = d.commissioning
    found = (
        ("Back up", c.backup),
        ("Load", c.load),
        ("Activate", c.activate),
        ("Where it is shown", c.watch),
        ("Remove again", c.remove),
    )
    return [(title, texts) for title, texts in found if texts]


def fact_lines(facts: Sequence[Fact]) -> list[str]:
    """Facts under their basis, each with its source."""
    lines: list[str] = []
    for basis in dict.fromkeys(f.basis for f in facts):
        told = (f"{f.text} ({f.source or 'no source found'})" for f in facts if f.basis == basis)
        lines += ["", f"{basis[:1].upper()}{basis[1:]}:", "", *bullets(told)]
    return lines


def properties_of_files(d: Declaration, sign: str, own: Mapping[str, str] | None = None) -> list[list[str]]:
    """How the values of its files are meant, where the sign is stated; `own`: properties that options decide."""
    rows = [
        ["sign", _sense(d, sign)],
        ["values", "increments from row to row" if d.rows == INCREMENTAL else "absolute, not incremental"],
        ["units", d.units],
        ["steps of the values", _quantum(d)],
        ["reversal", d.reversal],
        ["beyond the first and last position", BEYOND.get(d.outside, d.outside)],
        ["positions", f"{d.spacing} steps{_limit(d)}"],
        ["zero", d.zero],
        *(
            [["what of a table goes in", "its least-squares line alone, without constant and reversal"]]
            if d.linear
            else []
        ),
    ]
    return [[name, (own or {}).get(name, text)] for name, text in rows]


def _sense(d: Declaration, sign: str) -> str:
    """Sense of the values; where a user stated it, what the control does with them is not known."""
    words = SIGNS.get(sign, sign)
    if d.sign != OPEN or sign == OPEN:
        return words
    return f"{words.split(':')[0]}, as it was stated: public sources do not say what the control does with them"


def _limit(d: Declaration) -> str:
    """How many positions there may be."""
    found = [f"at most {d.most_points}"] if d.most_points else []
    return "".join(f", {text}" for text in (*found, *([d.limits] if d.limits else [])))


def _properties(d: Declaration) -> list[list[str]]:
    chain = "has a kinematic model" if d.model else "has none: every table moves one axis"
    lever = "multiplies two tables, so that rotations act through lever arms" if d.products else ""
    return [
        *properties_of_files(d, d.sign),
        ["kinematic model", "; it ".join(t for t in (chain, lever) if t)],
        ["switching on and off", d.switching],
    ]


def _quantum(d: Declaration) -> str:
    length, angle = d.quantum
    parts = [] if length is None else [f"{1e3 * length:g} µm"]
    parts += [] if angle is None else [f"{np.rad2deg(angle):.6g}°"]
    return ", ".join(parts) if parts else "as many digits as are written"


def _carried(d: Declaration) -> list[str]:
    return bullets(
        f"{n} as {form}: {', '.join(TYPES[n].effects)}; leaves {TYPES[n].leaves}" for n, form in d.carries.items()
    )
