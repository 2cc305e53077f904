"""Runs along targets: which target every reading belongs to, in which run and direction, and what is missing or only filled in.

Targets count from 1. Odd runs go from the first target to the last, even runs come back; the number in the second column tells
the target, never the place of the row. Some programs fill the runs back that a file of one direction has not with zeros.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from volid.exceptions import InputError
from volid.io.basics.toml_table import Table
from volid.io.instruments.base import ForeignFile
from volid.io.instruments.numerals import decimal_of, integer, number
from volid.io.instruments.sections import DEVIATIONS, END, RUN_DATA, RUNS, TARGETS, Sections, pair_of

KEYS = ("one_way", "incomplete")
MOST_TARGETS = 100_000
_ONE_WAY = 1  # place among the flags, and their value for runs in one direction


class Runs(NamedTuple):
    """Readings, one each in (m,): target [unit of the file], run, direction along the targets (±1), value, line in the file."""

    target: np.ndarray
    run: np.ndarray
    way: np.ndarray
    value: np.ndarray
    rows: np.ndarray
    notes: tuple[str, ...] = ()

    def rows_of(self, which: np.ndarray, note: str) -> Runs:
        """Some of the readings, with a note why."""
        cut = {name: getattr(self, name)[which] for name in ("target", "run", "way", "value", "rows")}
        return self._replace(notes=(*self.notes, note), **cut)


def read_runs(file: ForeignFile, sections: Sections, table: Table) -> Runs:
    """The runs of a file. `table`: keys of the set. Raises `InputError` naming the line that is wrong."""
    lines = _data_lines(sections)
    decimal = decimal_of(token for line in (*_target_lines(sections), *lines) for token in line[1].split())
    if decimal is None:
        raise InputError(
            f"{file.path}: numbers hold points and commas; expected one decimal sign and no separated thousands"
        )
    targets = _targets(file, sections, decimal)
    cells = [_row(file, line, len(targets), decimal) for line in lines]
    if not cells:
        raise InputError(f"{file.path}: there is no row below 'Run Target Data:'; expected run, target and deviation")
    run, index, value = (np.array(column) for column in zip(*cells, strict=True))
    rising = np.sign(targets[-1] - targets[0])
    way = np.where(run % 2 == 1, rising, -rising)
    notes = (*_cut_off(sections), *_listed_otherwise(run, index))
    runs = Runs(targets[index - 1], run, way, value, np.array([n for n, _ in lines]), notes)
    _check_repeated(file, runs, index)
    _check_complete(file, runs, sections, len(targets), table)
    return _without_filling(file, runs, sections, table)


def _cut_off(sections: Sections) -> tuple[str, ...]:
    return () if END in sections else ("there is no section EOF:: at its end; the file may have been cut off",)


def _listed_otherwise(run: np.ndarray, index: np.ndarray) -> tuple[str, ...]:
    """A remark where the rows of every odd run stand in the order of a run back."""
    within = (np.diff(run) == 0) & (run[1:] % 2 == 1)
    if not within.any() or (np.diff(index)[within] > 0).any():
        return ()
    return (
        "odd runs are listed from the last target to the first; they were taken to go towards the last, as the layout says",
    )


def _target_lines(sections: Sections) -> list[tuple[int, str]]:
    """What stands between "Targets :" and the next key, that line's own end included."""
    found: list[tuple[int, str]] = []
    inside = False
    for n, line in sections.of(TARGETS):
        pair = pair_of(line)
        if pair:
            inside = pair[0].casefold() == "targets"
            line = pair[1]
        if inside and line.strip():
            found.append((n, line))
    return found


def _targets(file: ForeignFile, sections: Sections, decimal: str) -> np.ndarray:
    """Targets (n,), which rise or fall throughout. Raises `InputError`."""
    found: list[float] = []
    for n, line in _target_lines(sections):
        for token in line.split():
            value = number(token, decimal)
            if value is None:
                raise file.wrong(n, f"target {len(found) + 1} is '{token}'", "a number")
            found.append(value)
    if not 2 <= len(found) <= MOST_TARGETS:
        raise InputError(f"{file.path}: {len(found)} target(s) below 'Targets :'; expected 2 to {MOST_TARGETS}")
    count = _count(sections, TARGETS, "target-count")
    if count is not None and count != len(found):
        raise InputError(f"{file.path}: Target-count is {count}, but there are {len(found)} targets; expected as many")
    steps = np.diff(found)
    if not ((steps > 0.0).all() or (steps < 0.0).all()):
        i = int(np.argmax(np.sign(steps) != np.sign(steps[0])))
        raise InputError(
            f"{file.path}: target {i + 2} ({found[i + 1]:g}) does not go on from target {i + 1} ({found[i]:g}); expected "
            "targets that rise or fall throughout, from which the direction of every run follows"
        )
    return np.array(found)


def _count(sections: Sections, name: str, key: str) -> int | None:
    """A count that a section states; None where it does not."""
    named = {found.casefold(): value for found, value in sections.pairs(name).items()}
    return integer(named[key]) if key in named else None


def _data_lines(sections: Sections) -> list[tuple[int, str]]:
    return [(n, line) for n, line in sections.of(DEVIATIONS) if not RUN_DATA.fullmatch(line)]


def _row(file: ForeignFile, line: tuple[int, str], targets: int, decimal: str) -> tuple[int, int, float]:
    """Run, target and value of a line."""
    n, text = line
    cells = text.split()
    if len(cells) != 3:
        raise file.wrong(n, f"'{text.strip()}' has {len(cells)} parts", "run, target and deviation")
    run, index, value = integer(cells[0]), integer(cells[1]), number(cells[2], decimal)
    if not run:
        raise file.wrong(n, f"the run is '{cells[0]}'", "a whole number from 1")
    if not index or index > targets:
        raise file.wrong(n, f"the target is '{cells[1]}'", f"the number of a target, 1 to {targets}")
    if value is None:
        raise file.wrong(n, f"the deviation is '{cells[2]}'", "a number")
    return run, index, value


def _check_repeated(file: ForeignFile, runs: Runs, index: np.ndarray) -> None:
    seen: dict[tuple[int, int], int] = {}
    for run, target, n in zip(runs.run.tolist(), index.tolist(), runs.rows.tolist(), strict=True):
        if (run, target) in seen:
            raise file.wrong(n, f"run {run} has target {target} a second time, after row {seen[run, target]}", "once")
        seen[run, target] = n


def _without_filling(file: ForeignFile, runs: Runs, sections: Sections, table: Table) -> Runs:
    """Without runs back that are only filled in, all zeros; in a file of one direction all runs go the same way.

    Raises `InputError` for a run of zeros that nobody explains, and where flags of one direction contradict the readings.
    """
    numbers = np.unique(runs.run)
    zero = np.setdiff1d(numbers, runs.run[runs.value != 0.0]).tolist()
    back = numbers[numbers % 2 == 0].tolist()
    if len(zero) == len(numbers):
        raise InputError(f"{file.path}: every deviation is 0; expected readings")
    if table.flag("one_way", _flag(sections)):
        if back and set(back) <= set(zero):
            note = f"{_who_says(table)} one direction: {len(back)} run(s) back, all zeros, were left out"
            return runs.rows_of(~np.isin(runs.run, back), note)
        if back and "one_way" not in table.data:
            raise InputError(
                f"{file.path}: {_who_says(table)} one direction, but run {back[0]} has readings; state one_way = true if all "
                "runs go from the first target to the last, one_way = false if even runs come back"
            )
        return runs._replace(way=np.abs(runs.way) * runs.way[0] * (1 if runs.run[0] % 2 == 1 else -1))
    if zero:
        raise InputError(
            f"{file.path}: every deviation of run {zero[0]} is 0; expected readings. State one_way = true if the machine was "
            "measured in one direction and the other runs were only filled in"
        )
    return runs


def _who_says(table: Table) -> str:
    return f"{table.where} says" if "one_way" in table.data else "the second flag says"


def _flag(sections: Sections) -> bool:
    named = {key.casefold(): value for key, value in sections.pairs(TARGETS).items()}
    flags = named.get("flags", "").split()
    return len(flags) > _ONE_WAY and flags[_ONE_WAY] == "1"


def _check_complete(file: ForeignFile, runs: Runs, sections: Sections, targets: int, table: Table) -> None:
    """Raises `InputError` where runs or targets are missing, unless the user says so."""
    if table.flag("incomplete", False):
        return
    advice = "the file may have been cut off; state incomplete = true to take the readings that are there"
    numbers, counts = np.unique(runs.run, return_counts=True)
    for run, there in zip(numbers.tolist(), counts.tolist(), strict=True):
        if there != targets:
            raise InputError(f"{file.path}: run {run} has {there} of {targets} targets; {advice}")
    stated = _count(sections, RUNS, "run-count")
    if stated is not None and stated != len(numbers):
        raise InputError(f"{file.path}: Run-count is {stated}, but there are {len(numbers)} runs; {advice}")
