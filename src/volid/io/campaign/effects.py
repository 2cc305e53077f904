"""One `[[set.effect]]` of a campaign manifest: a systematic effect, its distribution and its scope."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from volid.campaign import Effect
from volid.effects.base import COMPONENTS, FORMS, SCOPES, TYPES
from volid.effects.distributions import DISTRIBUTIONS, HALF_WIDTH, NORMAL, SAMPLES
from volid.io.basics.csv_table import read_csv
from volid.io.basics.toml_table import REQUIRED, Table, is_number
from volid.model.machine import Machine

_COMMON = ("name", "type", "u", "per", "distribution", "half_width", "samples", "file")
_OWN = {
    "scale": ("components",),
    "drift": ("form",),
    "tool_length": ("components",),
    "temperature": ("expansion", "u_expansion", "temperature"),
    "repeatability": ("axes",),
}


def read_effect(table: Table, folder: Path, machine: Machine) -> Effect:
    """A systematic effect from its table; a sample file is looked for in `folder`. Raises `InputError` naming the key."""
    kind = table.text("type", choices=TYPES)
    table.only((*_COMMON, *_OWN.get(kind, ())))
    options, u = _distribution(table, folder)
    return Effect(
        name=table.text("name"),
        type=kind,
        u=u,
        per=table.text("per", "point" if kind == "repeatability" else REQUIRED, choices=_scopes(kind)),
        options=options | _own_options(table, kind, machine),
    )


def _scopes(kind: str) -> tuple[str, ...]:
    if kind == "repeatability":
        return ("point",)
    return tuple(s for s in SCOPES if not (kind == "drift" and s == "point"))


def _distribution(table: Table, folder: Path) -> tuple[dict[str, Any], float]:
    """Options that describe the distribution, and the standard uncertainty."""
    name = table.text(
        "distribution", SAMPLES if {"samples", "file"} & set(table.data) else NORMAL, choices=DISTRIBUTIONS
    )
    options: dict[str, Any] = {} if name == NORMAL else {"distribution": name}
    if name == SAMPLES:
        values = _samples(table, folder)
        return {**options, "samples": values.tolist()}, table.number("u", float(values.std(ddof=1)), above=0.0)
    for key in ("samples", "file"):
        if key in table.data:
            raise table.wrong(key, f'no samples with distribution = "{name}"; leave it out or take "{SAMPLES}"')
    if "half_width" in table.data:
        if name not in HALF_WIDTH:
            raise table.wrong("half_width", f"u, or a distribution that has bounds: {', '.join(HALF_WIDTH)}")
        return options, table.number("half_width", above=0.0) / float(HALF_WIDTH[name])
    return options, table.number("u", above=0.0)


def _samples(table: Table, folder: Path) -> np.ndarray:
    """The values of the key `samples`, or of the column `value` of a CSV file."""
    if "file" in table.data:
        csv = read_csv(folder / table.text("file"))
        csv.require(["value"], "a sample file has one column, value", ("value",))
        values = np.asarray(csv.numbers("value", "", "every row is a sample"))
    else:
        given = table.get("samples")
        if not isinstance(given, list) or not all(is_number(v) for v in given):
            raise table.wrong("samples", "a list of numbers")
        values = np.array(given, dtype=float)
    if len(values) < 2 or not values.std() > 0.0:
        raise table.wrong("file" if "file" in table.data else "samples", "at least two different values")
    return values


def _own_options(table: Table, kind: str, machine: Machine) -> dict[str, Any]:
    """Keys of one type of effect, checked."""
    options: dict[str, Any] = {key: table.data[key] for key in _OWN.get(kind, ()) if key in table.data}
    if kind == "drift":
        options["form"] = table.text("form", FORMS[0], choices=FORMS)
    if "components" in options:
        text = options["components"]
        if not isinstance(text, str) or not text or set(text) - set(COMPONENTS) or len(set(text)) < len(text):
            raise table.wrong("components", 'one or several of X, Y, Z, such as "Z" or "XYZ"')
    if kind == "temperature":
        options["expansion"] = table.number("expansion", above=0.0)
        for key in ("u_expansion", "temperature"):
            if key in options:
                options[key] = table.number(key, least=0.0 if key == "u_expansion" else -273.15)
    if "axes" in options:
        axes = Table(table.table("axes").data, f"{table.where}, axes")
        axes.only(machine.letters)
        options["axes"] = {letter: axes.number(letter, least=0.0) for letter in axes.data}
    return options
