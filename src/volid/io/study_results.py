"""Results of a study: campaigns kept while it runs, then one HDF5 file (`volid-study-results/1`) and two tables as CSV.

In the HDF5 file, group `campaigns` has one dataset per column and one row per campaign, group `summary` one row per machine,
design, noise and quantity; attribute `unit` of a dataset is its unit. RESULTS.csv and RESULTS.summary.csv hold the same.
"""

from __future__ import annotations

import hashlib
import json
import os
import uuid
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import h5py

from volid.exceptions import InputError, OutputError
from volid.io.basics.hdf5_values import write_array, write_text
from volid.io.basics.hdf5_writing import hdf5_output
from volid.io.functions_csv import Sheet, text_output, write_csv
from volid.study.campaigns import COLUMNS, Record, Study, Task
from volid.study.summary import SUMMARY

FORMAT = "volid-study-results/1"
_CHECKSUM = "sha256"  # of the other entries of a campaign's file
_BY_QUANTITY = ("differences", "u_of")  # of a campaign beside its columns: lists of numbers
ENDINGS = (".h5", ".hdf5", ".csv")
_UNITS = {
    "values": "rms, largest: 3-D difference of the deviation fields from the truth, gauge removed; u: RMS of its stated u, mm",
    "coverage": "share with |difference| <= 1.96 u of field components and of functions; noise: factor on u; seconds: wall clock",
}
_SUMMARY_UNITS = {
    "values": "differences from the truth over the campaigns that did not fail, mm or rad; deviation field: 3-D, gauge removed",
    "coverage": "share with |difference| <= 1.96 u; failed, rejected, not_converged: numbers of campaigns",
}


class Places(NamedTuple):
    """Where results go."""

    hdf5: Path
    campaigns: Path
    summary: Path
    folder: Path


def places(output: str | Path) -> Places:
    """RESULTS.h5, RESULTS.csv, RESULTS.summary.csv and the folder RESULTS.campaigns, from one of the first two.

    Raises `OutputError` for another ending.
    """
    path = Path(output)
    if path.suffix.lower() not in ENDINGS:
        raise OutputError(f"{path}: expected a name ending in .h5 or .csv; both files are written")
    hdf5 = path if path.suffix.lower() != ".csv" else path.with_suffix(".h5")
    return Places(hdf5, *(path.with_suffix(ending) for ending in (".csv", ".summary.csv", ".campaigns")))


class CampaignFolder:
    """Finished campaigns of a study, one small JSON file each, named by the hash of what was to be done.

    Each is written completely or not at all. Raises `InputError` when the folder holds campaigns and `resume` is not asked for.
    """

    def __init__(self, path: Path, study: Study, resume: bool) -> None:
        self.path, self.study = path, study
        if not resume and path.exists() and any(path.glob("*.json")):
            raise InputError(f"{path} holds campaigns of an interrupted study; go on with `resume=True`, or remove it")
        try:
            path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise OutputError(f"{path}: cannot be made: {error.strerror}; choose another output") from None
        for leftover in path.glob(".*.part"):
            leftover.unlink(missing_ok=True)

    def place(self, task: Task) -> Path:
        """File of a campaign."""
        return self.path / f"{self.study.fingerprint(task)[:24]}.json"

    def save(self, task: Task, record: Record) -> None:
        """Keep a finished campaign. Raises `OutputError` when there is no space."""
        temporary = self.path / f".{uuid.uuid4().hex[:12]}.part"
        try:
            with temporary.open("w", encoding="utf-8") as file:
                json.dump({**record, _CHECKSUM: _checksum(record)}, file, ensure_ascii=False)
                file.flush()
                os.fsync(file.fileno())
            os.replace(temporary, self.place(task))
        except OSError as error:
            raise OutputError(
                f"{self.path}: a campaign cannot be kept: {error.strerror}; go on with `resume=True`"
            ) from None
        finally:
            temporary.unlink(missing_ok=True)

    def done(self) -> dict[Task, Record]:
        """Campaigns of this study that are there; failed ones are done again, and so are those whose file is damaged."""
        records = {task: _read_record(self.place(task)) for task in self.study.tasks}
        return {task: record for task, record in records.items() if record is not None and not record["error"]}


def _checksum(record: Record) -> str:
    return hashlib.sha256(json.dumps(record, sort_keys=True).encode()).hexdigest()


def _read_record(place: Path) -> Record | None:
    """The record of a campaign; None when there is none or it is damaged. Earlier versions wrote no checksum."""
    try:
        record = json.loads(place.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return None
    if not isinstance(record, dict) or record.pop(_CHECKSUM, _checksum(record)) != _checksum(record):
        return None
    if record.keys() != {*COLUMNS, *_BY_QUANTITY} or not all(
        _fits(record[n], kind) for n, (kind, _) in COLUMNS.items()
    ):
        return None
    differences, u_of = (record[name] for name in _BY_QUANTITY)
    return record if _lengths(differences) == _lengths(u_of) is not None else None


def _lengths(by_quantity: Any) -> dict[str, int] | None:
    """How many numbers there are by quantity; None for anything but lists of numbers."""
    if not isinstance(by_quantity, dict):
        return None
    if not all(isinstance(v, list) and all(_fits(x, float) for x in v) for v in by_quantity.values()):
        return None
    return {name: len(values) for name, values in by_quantity.items()}


def _fits(value: Any, kind: type) -> bool:
    return type(value) is kind or (kind is float and type(value) is int)


def write_results(
    output: Places,
    records: Sequence[Record],
    summary: Sequence[Record],
    provenance: Mapping[str, str],
    overwrite: bool = False,
) -> None:
    """Both tables, as HDF5 and as CSV. Raises `OutputError` when one exists (unless `overwrite`) or cannot be written."""
    with hdf5_output(output.hdf5, overwrite) as file:
        file.attrs["format"] = FORMAT
        file.create_group("provenance").attrs.update(dict(provenance))
        _write_table(file.create_group("campaigns"), records, COLUMNS)
        _write_table(file.create_group("summary"), summary, SUMMARY)
    for path, rows, columns, header in (
        (output.campaigns, records, COLUMNS, _UNITS),
        (output.summary, summary, SUMMARY, _SUMMARY_UNITS),
    ):
        cells = ([_cell(row[name], kind) for name, (kind, _) in columns.items()] for row in rows)
        with text_output(path, overwrite) as stream:
            write_csv(stream, Sheet({**header, **provenance}, tuple(columns), cells))


def _cell(value: Any, kind: type) -> Any:
    return int(value) if kind is bool else kind(value)


def _write_table(group: h5py.Group, rows: Sequence[Record], columns: Mapping[str, tuple[type, str]]) -> None:
    for name, (kind, unit) in columns.items():
        values = [row[name] for row in rows]
        if kind is str:
            write_text(group, name, values)
        else:
            write_array(group, name, values, kind, unit)
