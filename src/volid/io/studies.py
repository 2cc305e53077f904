"""Studies (TOML, `volid-study/1`): which campaigns to simulate, fit and compare with their truth.

```
format = "volid-study/1"
machines = ["models/wYXbZt_vertical.toml"]   # machine files; a machine is called by its file name without ending
noise = [1.0, 2.0]       # factors on the u of all readings, simulated and stated; default 1
seeds = 20               # so many seeds 0, 1, …, or a list of them
robust = false           # as in volid fit
segments = 12            # of the splines, in place of each machine's [model] segments; or "auto"
[truth]                  # of the random machines
scale = 1.0              # of all errors
waviness = 1.0           # the shortest wave is 0.45 travels / waviness
seed = 1                 # one truth for all campaigns; default: each seed its own
[[design]]
name = "standard"        # the standard plan: six stations, three tool vectors
n_per_station = 400
seed = 0                 # of its positions
[[design]]
name = "mine"
plan = "plan.toml"       # a manifest without readings, or a campaign whose readings are replaced
```
Paths are relative to the file.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from volid.exceptions import InputError
from volid.io.basics.toml_table import REQUIRED, Table, check_format, is_number, read_toml
from volid.io.campaign.files import load_campaign
from volid.io.machines import MOST_SEGMENTS, read_machine
from volid.model.machine import Machine
from volid.study.campaigns import Design, Study, Truths

FORMAT = "volid-study/1"
_STANDARD = ("n_per_station", "seed")
_MOST_SEEDS, _MOST_READINGS = 100_000, 1_000_000


def read_study(path: str | Path) -> Study:
    """The study described by a TOML file, with its machines and plans.

    Raises `InputError` naming file and key for what it does not understand, and for a plan whose axes a machine has not.
    """
    path = Path(path)
    top = Table(read_toml(path), str(path))
    check_format(top, FORMAT)
    top.only(("format", "machines", "design", "noise", "seeds", "robust", "segments", "truth"))
    machines = _machines(top, path.parent)
    return Study(
        machines=machines,
        designs=_designs(top, path.parent, machines),
        noise=_noise(top),
        seeds=_seeds(top),
        robust=top.flag("robust", False),
        segments="auto" if top.data.get("segments") == "auto" else _integer(top, "segments", None, 1, MOST_SEGMENTS),
        truths=_truths(top.table("truth", {})),
        source=str(path),
    )


def study_files(path: str | Path) -> tuple[list[Path], list[Path]]:
    """Study and machine files, and the plans, for provenance; of a study that can be read."""
    path = Path(path)
    data = read_toml(path)
    plans = dict.fromkeys(d["plan"] for d in data["design"] if "plan" in d)
    return [path, *(path.parent / name for name in data["machines"])], [path.parent / name for name in plans]


def _machines(top: Table, folder: Path) -> dict[str, Machine]:
    names = top.get("machines")
    if not isinstance(names, list) or not names or not all(isinstance(n, str) and n for n in names):
        raise top.wrong("machines", 'a list of machine files, such as ["machine.toml"]')
    found: dict[str, Machine] = {}
    for name in names:
        key = Path(name).stem
        if key in found:
            raise InputError(f"{top.where}: machines has two files called '{key}'; expected different names")
        try:
            found[key] = read_machine(folder / name)
        except InputError as error:
            raise InputError(f"{top.where}: machines: {error}") from None
    return found


def _designs(top: Table, folder: Path, machines: Mapping[str, Machine]) -> tuple[Design, ...]:
    tables = top.tables("design")
    if not tables:
        raise InputError(f'{top.where}: [[design]] is missing; add one, such as [[design]] name = "standard"')
    designs: list[Design] = []
    for table in tables:
        design = _design(table, folder)
        if design.name in [d.name for d in designs]:
            raise InputError(f"{table.where}: name '{design.name}' is taken by another design; choose another")
        for name, machine in machines.items() if design.plan else ():
            try:
                design.on(machine)
            except InputError as error:
                raise InputError(f"{table.where}: plan does not fit machines '{name}': {error}") from None
        designs.append(design)
    return tuple(designs)


def _design(table: Table, folder: Path) -> Design:
    table.only(("name", "plan", *_STANDARD))
    name = table.text("name")
    if "plan" not in table.data:
        return Design(
            name, None, _integer(table, "n_per_station", 400, 1, _MOST_READINGS), _integer(table, "seed", 0, 0)
        )
    for key in _STANDARD:
        if key in table.data:
            raise InputError(f"{table.where}: {key} belongs to the standard plan; with a plan of its own, leave it out")
    try:
        return Design(name, load_campaign(folder / table.text("plan"), plan=True))
    except InputError as error:
        raise InputError(f"{table.where}: plan: {error}") from None


def _noise(top: Table) -> tuple[float, ...]:
    found = top.get("noise", 1.0)
    values = found if isinstance(found, list) else [found]
    good = values and all(is_number(v) and 0.0 < v < float("inf") for v in values)
    if not good or len(set(values)) < len(values):
        raise top.wrong("noise", "a number > 0, or a list of different ones")
    return tuple(float(v) for v in values)


def _seeds(top: Table) -> tuple[int, ...]:
    found = top.get("seeds", 20)
    if _is_integer(found) and found > _MOST_SEEDS:
        raise top.wrong("seeds", f"at most {_MOST_SEEDS}, each of which is a campaign to be fitted")
    values = list(range(found)) if _is_integer(found) else found
    good = isinstance(values, list) and values and all(_is_integer(v) and v >= 0 for v in values)
    if not good or len(set(values)) < len(values):
        raise top.wrong("seeds", "how many (a whole number >= 1), or a list of different whole numbers >= 0")
    return tuple(values)


def _truths(table: Table) -> Truths:
    table.only(("scale", "waviness", "seed"))
    return Truths(
        table.number("scale", 1.0, least=0.0),
        table.number("waviness", 1.0, above=0.0),
        _integer(table, "seed", None, 0),
    )


def _integer(table: Table, key: str, default: Any = REQUIRED, least: int = 0, most: float = float("inf")) -> Any:
    """An integer, not less than `least` and not more than `most`."""
    value = table.get(key, default)
    if key in table.data and not (_is_integer(value) and least <= value <= most):
        limit = f">= {least}" if most == float("inf") else f"from {least} to {most}"
        raise table.wrong(key, f"a whole number {limit}" + (' or "auto"' if key == "segments" else ""))
    return value


def _is_integer(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)
