"""`[[environment]]` of a campaign manifest with its log, a CSV file, and the same in HDF5."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from volid.campaign import AIR, CO2, HENE, HOUR, TIME, Campaign, Environment, Expansion
from volid.effects.environment.checks import check_column
from volid.effects.environment.factors import INDEX
from volid.effects.environment.matching import DEGREES_C, OWN, named_in
from volid.effects.environment.remarks import remarks_on
from volid.exceptions import InputError
from volid.io.basics.cells import CellWriter
from volid.io.basics.csv_form import CsvForm
from volid.io.basics.csv_table import CsvTable
from volid.io.basics.hdf5_group import Group
from volid.io.basics.hdf5_values import to_json, write_array
from volid.io.basics.toml_table import REQUIRED, Table, format_lines
from volid.io.campaign.sets import named_csv

_NUMBERS = {"wavelength": HENE, "co2": CO2, "dead_path": 0.0, "longest_gap": HOUR, "beyond": 0.0}
_KEYS = (
    "name",
    "file",
    "csv",
    "columns",
    "ignore",
    "values",
    "sets",
    "corrected",
    "group",
    "at",
    "u",
    "machine",
    "artefact",
    *_NUMBERS,
)
_UNITS = {"pressure_hPa": "hPa", "humidity_percent": "%"}
_PURPOSE = "leave the cell empty where it was not recorded"


def read_environment(table: Table, folder: Path, form: CsvForm) -> tuple[Environment, tuple[str, ...]]:
    """An environment from its table and the log that it names in `folder`, and how the log was read.

    Raises `InputError` naming file, row or key.
    """
    table.only(_KEYS)
    log, notes, source = _log(table, folder, form.with_stated(table))
    log |= {name: np.full(_length(log), value) for name, value in _constants(table, log).items()}
    if not log:
        raise InputError(
            f"{table.where}: there is no log; expected file = …, or values = {{ air_temperature_C = …, … }}"
        )
    return _from_keys(table, log, source or table.where), notes


def _from_keys(table: Table, log: dict[str, np.ndarray], source: str) -> Environment:
    """An environment with what its keys say."""
    given = table.get("sets", [])
    if not isinstance(given, list | tuple) or not all(isinstance(name, str) for name in given):
        raise table.wrong("sets", 'a list of names of sets, such as ["volume"]')
    columns = tuple(name for name in log if name != TIME)
    numbers: dict[str, float] = {name: table.number(name, default) for name, default in _NUMBERS.items()}
    return Environment(
        name=table.text("name", Path(source).stem if "file" in table.data else REQUIRED),
        log=log,
        sets=tuple(given),
        corrected=table.flag("corrected") if "corrected" in table.data else None,
        group=table.flag("group", False),
        at=_numbers(table, "at", (*AIR, INDEX)),
        u=_numbers(table, "u", (*columns, OWN)),
        machine=_body(table, "machine"),
        artefact=_body(table, "artefact"),
        source=source,
        **numbers,
    )


def _log(table: Table, folder: Path, form: CsvForm) -> tuple[dict[str, np.ndarray], tuple[str, ...], str]:
    """The columns of the log's file, how it was read, and its name; nothing where there is none."""
    if "file" not in table.data:
        for key in ("csv", "columns", "ignore"):
            if key in table.data:
                raise table.wrong(key, "nothing where there is no file")
        return {}, (), ""
    csv = named_csv(table, folder, form)
    csv.require((TIME,), "a log tells when its entries were made", tuple(csv.columns))
    strange = [name for name in csv.columns if name not in (TIME, *AIR) and not name.endswith(DEGREES_C)]
    if strange:
        csv.only((TIME, *AIR, "material_1_C", *(name for name in csv.columns if name.endswith(DEGREES_C))))
    return {name: _column(csv, name) for name in csv.columns}, csv.notes, csv.source


def _column(csv: CsvTable, name: str) -> np.ndarray:
    if name == TIME:
        times = csv.times(name, "a log tells when its entries were made")
        if np.isnan(times).any():
            raise InputError(
                f"{csv.where(int(np.argmax(np.isnan(times))))}: time is empty; expected one in every row of a log"
            )
        back = np.diff(times) < 0.0
        if back.any():
            raise InputError(
                f"{csv.where(int(np.argmax(back)) + 1)}: time goes back; expected entries in the order of time. Was the clock "
                "set back, or are days or two logs mixed up?"
            )
        return times
    values = csv.numbers(name, _UNITS.get(name, "°C"), _PURPOSE, gaps=True)
    known = np.flatnonzero(np.isfinite(values))
    check_column(name, values[known], csv.source, lambda i: f"row {int(csv.rows[known[i]])}")
    return values


def _length(log: Mapping[str, np.ndarray]) -> int:
    return len(next(iter(log.values()))) if log else 1


def _constants(table: Table, log: Mapping[str, np.ndarray]) -> dict[str, float]:
    """Columns that stayed the same, from the key `values`."""
    found = _numbers(table, "values", None)
    for name in found:
        if name in log:
            raise table.wrong("values", f"no {name}, which the log has; keep one of them")
        if name not in AIR and not name.endswith(DEGREES_C):
            raise table.wrong("values", f"{', '.join(AIR)}, or temperatures of materials such as material_1_C")
    return found


def _numbers(table: Table, key: str, known: tuple[str, ...] | None) -> dict[str, float]:
    """A table of numbers, its keys among those that are `known`."""
    given = Table(table.table(key, {}).data, f"{table.where}, {key}")
    if known is not None:
        given.only(known)
    return {name: float(given.number(name)) for name in given.data}


def _body(table: Table, key: str) -> Expansion | None:
    if key not in table.data:
        return None
    given = Table(table.table(key).data, f"{table.where}, {key}")
    given.only(("expansion", "u", "material"))
    return Expansion(
        given.number("expansion", above=0.0), given.number("u", 0.0, least=0.0), given.text("material", "")
    )


def resolved(campaign: Campaign) -> Campaign:
    """The campaign whose environments name the sets that they hold for, so that sets of another campaign are not meant; with
    what is odd about them among its warnings."""
    found = []
    for environment in campaign.environments:
        sets = tuple(named_in(environment, campaign))
        if not sets:
            raise InputError(
                f"{environment.source}, environment '{environment.name}': no set is meant; expected sets that are read in light "
                "(a 'component' set says interferometer = true) or, with artefact = { … }, against an artefact, with a column "
                "time, or their names: sets = [..]"
            )
        found.append(replace(environment, sets=sets))
    campaign = replace(campaign, environments=tuple(found))
    return replace(campaign, warnings=tuple(dict.fromkeys((*campaign.warnings, *remarks_on(campaign)))))


def joined(given: Sequence[tuple[Environment, ...]]) -> tuple[Environment, ...]:
    """Environments of several campaigns: the same one of several of them once, for all its sets; others of one name renamed."""
    found: list[Environment] = []
    for environment in (e for environments in given for e in environments):
        same = next((i for i, other in enumerate(found) if _alike(environment, other)), None)
        if same is not None:
            found[same] = replace(found[same], sets=(*found[same].sets, *environment.sets))
            continue
        name, n = environment.name, 2
        while name in [other.name for other in found]:
            name, n = f"{environment.name} {n}", n + 1
        found.append(replace(environment, name=name))
    return tuple(found)


def _alike(a: Environment, b: Environment) -> bool:
    """Whether two environments say the same, of whatever sets."""
    same = _keys(replace(a, sets=())) == _keys(replace(b, sets=())) and list(a.log) == list(b.log)
    return same and all(np.array_equal(a.log[name], b.log[name], equal_nan=True) for name in a.log)


# ------------------------------------------------------------------------------------------------------------------- writing


def _keys(environment: Environment) -> dict[str, Any]:
    """The keys of an environment but for its log, those with their default left out."""
    keys: dict[str, Any] = {
        "name": environment.name,
        "sets": list(environment.sets) or None,
        "corrected": environment.corrected,
    }
    keys["group"] = environment.group or None
    for name, default in _NUMBERS.items():
        value = getattr(environment, name)
        keys[name] = None if value == default else value
    for name in ("at", "u"):
        keys[name] = dict(getattr(environment, name)) or None
    for name in ("machine", "artefact"):
        body = getattr(environment, name)
        keys[name] = body and {key: value for key, value in asdict(body).items() if value}
    return {key: value for key, value in keys.items() if value is not None}


def environment_lines(environment: Environment, file: str) -> list[str]:
    """Lines of a manifest; the log stands in `file`, or with the keys where it is one entry that always holds."""
    log = (
        {"file": file} if TIME in environment.log else {"values": {n: float(v[0]) for n, v in environment.log.items()}}
    )
    return ["", "[[environment]]", *format_lines(_keys(environment) | log)]


def write_log(environment: Environment, path: Path) -> None:
    """Write the log of an environment as CSV."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = CellWriter(file)
        writer.writerow(environment.log)
        for row in zip(*(values.tolist() for values in environment.log.values()), strict=True):
            writer.writerow(["" if math.isnan(value) else value for value in row])


def write_environments(group: h5py.Group, environments: tuple[Environment, ...]) -> None:
    """Write environments into an open group, one group each: attributes `keys` (JSON) and `source`, a dataset for each column."""
    for i, environment in enumerate(environments, start=1):
        here = group.create_group(str(i))
        here.attrs["keys"] = to_json(_keys(environment))
        here.attrs["source"] = environment.source
        here.attrs["columns"] = list(environment.log)
        for name, values in environment.log.items():
            write_array(here, name, values)


def read_environments(group: Group) -> tuple[Environment, ...]:
    """The environments in an open group. Raises `InputError` when something in them is wrong."""
    found = []
    for here in group.numbered():
        attributes, names = here.attributes, here.attributes.texts("columns")
        keys = attributes.json("keys", dict)
        if not names:
            raise InputError(f"{here.where}: has no columns; expected those of a log, write the file again")
        n = here.length(names[0])
        log = {name: here.array(name, (n,)) for name in names}
        table = Table(keys, here.where)
        table.only(key for key in _KEYS if key not in ("file", "csv", "columns", "ignore", "values"))
        found.append(_from_keys(table, log, attributes.text("source")))
    return tuple(found)
