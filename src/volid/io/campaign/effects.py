"""One `[[set.effect]]` of a campaign manifest: a systematic effect, its distribution and its scope."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from volid.campaign import Effect
from volid.effects import TYPES, EffectType
from volid.effects.base import COMPONENTS, POINT, Choice, FileKey, Letters, Number, PerAxis, labelled_scopes
from volid.effects.distributions import DISTRIBUTIONS, HALF_WIDTH, NORMAL, SAMPLES
from volid.exceptions import InputError
from volid.io.basics.csv_table import read_csv
from volid.io.basics.toml_table import REQUIRED, Table, is_number
from volid.model.machine import Machine

_COMMON = ("name", "type", "u", "per", "distribution", "half_width", "samples", "file")


def read_effect(table: Table, folder: Path, machine: Machine) -> Effect:
    """A systematic effect from its table; a sample file is looked for in `folder`. Raises `InputError` naming the key."""
    kind = TYPES[table.text("type", choices=tuple(TYPES))]
    table.only((*_COMMON, *kind.keys))
    options, u = _distribution(table, folder)
    scopes = kind.scopes(labelled_scopes())
    return Effect(
        name=table.text("name"),
        type=kind.name,
        u=u,
        per=table.text("per", POINT if kind.always_random else REQUIRED, choices=scopes),
        options=options | _own_options(table, kind, machine),
    )


def check_effect(entry: Mapping[str, Any], machine: Machine, where: str) -> None:
    """Holds an effect from another file than a manifest, its fields by name, against what a manifest may say of one.

    Raises `InputError` naming the key.
    """
    options = dict(entry["options"])
    for name in ("file", "half_width", *(key for key in _COMMON[:4] if key in options)):
        if name in options:
            raise InputError(f"{where}: options hold '{name}'; expected it to be resolved, leave it out")
    kept = {key: value for key, value in entry.items() if key != "options"}
    read_effect(Table({**options, **kept}, where), Path(), machine)


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


def _own_options(table: Table, kind: EffectType, machine: Machine) -> dict[str, Any]:
    """Keys of one type of effect, checked; those left out that have a default get it."""
    found = {name: _value(table, name, key, machine) for name, key in kind.keys.items()}
    return {name: value for name, value in found.items() if value is not None}


def _value(table: Table, name: str, key: FileKey, machine: Machine) -> Any:
    """Value of one key as its declaration says; None where it may be left out and is."""
    if isinstance(key, Choice):
        return table.text(name, key.texts[0], choices=key.texts)
    if name not in table.data and not (isinstance(key, Number) and key.required):
        return None
    if isinstance(key, Number):
        bounds = {bound: value for bound, value in (("above", key.above), ("least", key.least)) if value is not None}
        return table.number(name, **bounds)
    if isinstance(key, Letters):
        return _letters(table, name)
    return _per_axis(table, name, key, machine)


def _letters(table: Table, name: str) -> str:
    text = table.data[name]
    if not isinstance(text, str) or not text or set(text) - set(COMPONENTS) or len(set(text)) < len(text):
        raise table.wrong(name, 'one or several of X, Y, Z, such as "Z" or "XYZ"')
    return text


def _per_axis(table: Table, name: str, key: PerAxis, machine: Machine) -> dict[str, float]:
    axes = Table(table.table(name).data, f"{table.where}, {name}")
    axes.only(machine.letters)
    return {letter: axes.number(letter, least=key.least) for letter in axes.data}
