"""Sequential step diagonals as a table: one column per diagonal with its 3 n readings, in the order of the steps X, Y, Z, X, …

```
# box: X 0 800, Y 0 600, Z 0 600      mm: between which positions the diagonals run
# tool: 0, 0, -150                    mm: from the spindle to the point of the mirror that the beam meets first
# u: 0.0005                           mm: standard uncertainty of a reading
# values: displacement                or deviation (displacement - nominal), or increments (of every single step)
PPP,NPP,PNP,PPN
14.552,14.551,14.553,14.552
```

With 3 n rows the first reading, at the start, is 0; with 3 n + 1 rows it stands in the first one. `PPP_back` holds what was read
at the same places on the way back, `PPP_2` and `PPP_back_2` a second run. Diagonals are named by the senses of X, Y and Z:
NPP begins where X is largest and Y and Z are smallest. A table without machine is that of a bed-X-Y-Z-tool machine, which
makes no difference to the nine functions.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from volid.campaign import Campaign, ObservationSet
from volid.exceptions import InputError
from volid.io.basics.csv_table import CsvTable, read_csv
from volid.io.evaluations.sizes import ask_size
from volid.io.machines import parse_machine
from volid.io.record import read_header
from volid.model.iso230 import LINEAR_AXES
from volid.model.machine import Machine
from volid.observations.beam_lines import beams_of
from volid.observations.projection import PROJECTION
from volid.planning.diagonals import BODY, TOOL, step_diagonals

VALUES = ("displacement", "deviation", "increments")
_COLUMN = re.compile(rf"({'|'.join(BODY)})(_back)?(?:_(\d+))?")
_NUMBER = r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)"
_RANGE = re.compile(rf"([XYZ])\s+{_NUMBER}\s+{_NUMBER}")


def read_step_diagonals(path: str | Path, machine: Machine | None = None) -> Campaign:
    """Step diagonals of a table as a campaign with one `projection` set, its mirror's tilt unknown.

    Args:
        path: Path of a CSV file, as the docstring of the module describes it.
        machine: The machine that was measured; None: a bed-X-Y-Z-tool machine with the travels of the box.

    Raises:
        InputError: a line of the header or a column is missing or is none, the number of rows is neither 3 n nor 3 n + 1,
            or readings contradict the positions.

    >>> campaign = read_step_diagonals("datasets/step_diagonals_800/steps.csv")
    >>> campaign.n_readings, list(campaign.sets[0].options["lines"])
    (968, ['PPP', 'NPP', 'PNP', 'PPN'])
    """
    table, header = read_csv(path).renamed({}, (), str(path)), read_header(path)
    box, u = _box(header, path, machine), _one(header, "u", path)
    tool = _tool(header, path)
    measured = machine or _plain(box)
    inside = replace(measured, axes=tuple(replace(a, travel=box.get(a.letter, a.travel)) for a in measured.axes))
    plan = step_diagonals(inside, _steps(table), tool, u=u)
    own = _joined([_read(plan, table, header, run) for run in _runs(table)])
    own = replace(own, options={**own.options, "offset_per": "run"}, source=str(path))
    campaign = Campaign(measured, (), (own,), "Step diagonals", warnings=table.notes, source=str(path))
    PROJECTION.check_values(own, campaign)
    return campaign


def _joined(runs: list[ObservationSet]) -> ObservationSet:
    """The rows of all runs as one set."""
    arrays = ("positions", "directions", "tool", "readings", "u", "rows")
    labels = {key: np.concatenate([r.labels[key] for r in runs]) for key in runs[0].labels}
    joined: dict[str, Any] = {key: np.concatenate([getattr(r, key) for r in runs]) for key in arrays}
    return replace(runs[0], labels=labels, **joined)


def _box(header: Mapping[str, str], path: str | Path, machine: Machine | None) -> dict[str, tuple[float, float]]:
    """Lowest and highest position of X, Y, Z; of the machine's travels where the file does not say."""
    found = {a: (float(low), float(high)) for a, low, high in _RANGE.findall(header.get("box", ""))}
    if machine is not None and not found:
        found = {a.letter: a.travel for a in machine.axes if a.letter in LINEAR_AXES}
    wrong = [a for a in LINEAR_AXES if a not in found or not found[a][0] < found[a][1]]
    if wrong:
        said = f"'{header['box']}'" if "box" in header else "missing"
        raise InputError(
            f"{path}: the line box is {said}; expected rising positions of X, Y and Z in mm, '# box: X 0 800, Y 0 600, Z 0 600'"
        )
    return found


def _one(header: Mapping[str, str], key: str, path: str | Path) -> float:
    try:
        value = float(header.get(key, "").split()[0])
    except (ValueError, IndexError):
        value = np.nan
    if not 0.0 < value < np.inf:
        said = f"'{header[key]}'" if key in header else "missing"
        raise InputError(
            f"{path}: the line {key} is {said}; expected a positive number in mm, such as '# {key}: 0.0005'"
        )
    return value


def _tool(header: Mapping[str, str], path: str | Path) -> tuple[float, ...]:
    if "tool" not in header:
        return TOOL
    found = re.findall(_NUMBER, header["tool"])
    if len(found) != 3:
        raise InputError(
            f"{path}: the line tool is '{header['tool']}'; expected three numbers in mm, such as '# tool: 0, 0, -150'"
        )
    return tuple(map(float, found))


def _plain(box: Mapping[str, tuple[float, float]]) -> Machine:
    travels = "".join(f"[axis.{a}]\ntravel = [{low!r}, {high!r}]\n" for a, (low, high) in sorted(box.items()))
    return parse_machine(
        f'format = "volid-machine/1"\nname = "not stated"\nstructure = "w b X Y Z t"\n{travels}', "step diagonals"
    )


def _steps(table: CsvTable) -> int:
    """Steps of each axis. Raises `InputError` for columns that are none, a missing diagonal, another number of rows."""
    for name in table.columns:
        if not _COLUMN.fullmatch(name):
            raise InputError(
                f"{table.source}: column '{name}' is no diagonal; expected {', '.join(BODY)}, with _back for the way back "
                "and _2, _3 … for further runs"
            )
    table.require(BODY, "the nine functions need four body diagonals")
    if len(table) % 3 == 2 or len(table) < 3:
        raise InputError(
            f"{table.source}: {len(table)} rows; expected three for every step, X, Y, Z, or one more for the reading at the start"
        )
    return len(table) // 3


def _runs(table: CsvTable) -> list[str]:
    matches = [_COLUMN.fullmatch(name) for name in table.columns]
    return sorted({(m[3] or "1") for m in matches if m}, key=int)


def _read(plan: Campaign, table: CsvTable, header: Mapping[str, str], run: str) -> ObservationSet:
    """The planned set with the readings of one run, without the rows that were not read."""
    (planned,) = plan.sets
    readings, rows = np.full((len(planned), 1), np.nan), np.zeros(len(planned), dtype=np.int64)
    for line in beams_of(planned, plan):
        half = len(line.rows) // 2
        ways = ((line.name, line.rows[:half]), (f"{line.name}_back", line.rows[half:][::-1]))
        for name, places in ways:
            name = name if run == "1" else f"{name}_{run}"
            if name in table:
                readings[places, 0] = _displacements(table, name, header, line.nominal[:half])
                rows[places[-len(table) :]] = table.rows
    numbered = replace(
        planned, readings=readings, rows=rows, labels={**planned.labels, "run": np.full(len(planned), run)}
    )
    return numbered.rows_of(np.flatnonzero(np.isfinite(readings[:, 0])))


def _displacements(table: CsvTable, name: str, header: Mapping[str, str], nominal: np.ndarray) -> np.ndarray:
    """Displacements at the 3 n + 1 places of a diagonal [mm]; at the start where the table lacks it 0, on the way back NaN."""
    values, back = header.get("values", VALUES[0]), "_back" in name
    found = table.numbers(name, "mm", "every row has a reading")
    if values not in VALUES or (values == VALUES[2] and back):
        raise InputError(
            f"{table.source}: the line values is '{values}'; expected {' or '.join(VALUES[: 2 if back else 3])} for column {name}"
        )
    if len(found) < len(nominal):
        found = np.concatenate([[np.nan if back else 0.0], found])
    if values == VALUES[1]:
        ask_size(table.source, name, found)
        return found + nominal
    return np.asarray(np.cumsum(found)) if values == VALUES[2] else found
