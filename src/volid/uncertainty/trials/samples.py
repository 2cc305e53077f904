"""Samples of the parameters, by Monte Carlo: kept on disk in batches, read batch by batch, so that memory stays bounded.

A folder of trials holds `run.json` (what makes the trials: seed, hash of the solution) and one file per finished batch, written
whole or not at all: a killed run loses the batches in work and nothing else. Every batch names its run; those of another are
not taken.
"""

from __future__ import annotations

import hashlib
import json
import os
import struct
import uuid
import zipfile
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from volid.exceptions import InputError, OutputError

RECORD = "run.json"
COLUMNS = ("chi_square", "error", "solved", "outliers")  # of a batch, beside x: one value per trial
# What the archive, NumPy and the system make of a damaged file
_DAMAGED = (
    OSError,
    RuntimeError,
    ValueError,
    LookupError,
    EOFError,
    MemoryError,
    zipfile.BadZipFile,
    zlib.error,
    struct.error,
)
LARGEST = 16_000_000  # values of one group of output columns in memory: 128 MB


@dataclass(frozen=True, eq=False)
class Samples:
    """Monte Carlo samples of x = (θ, ν).

    `trials`: M. `batches`: function that yields (b, p) arrays, in the order of the trials. `chi_square`, `error` (distance to
    the exact minimum in standard uncertainties), `solved` (by the full solver), `outliers` (set aside in the trial): (M,).
    `seed`: of the run. `tolerance`: achieved numerical tolerance over the one aimed at, NaN for a fixed number of trials.
    """

    trials: int
    batches: Callable[[], Iterator[np.ndarray]]
    chi_square: np.ndarray
    error: np.ndarray
    solved: np.ndarray
    outliers: np.ndarray
    seed: int
    tolerance: float = float("nan")

    def outputs(self, values: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        """`values`, a function from (b, p) to (b, q), for all trials that converged, shape (M', q)."""
        return np.concatenate([np.asarray(values(x)) for x in self._converged()])

    def _converged(self) -> Iterator[np.ndarray]:
        """Batches without the trials that did not converge."""
        return (x[np.isfinite(x).all(axis=1)] for x in self.batches())

    def linear(self, rows: np.ndarray) -> Iterator[tuple[slice, np.ndarray]]:
        """Linear outputs `rows` (q, p) by groups of columns small enough for memory: (slice, samples (M', columns))."""
        width = max(1, LARGEST // max(self.trials, 1))
        for start in range(0, len(rows), width):
            part = slice(start, min(start + width, len(rows)))
            values, done = np.empty((len(rows[part]), self.trials)), 0
            for x in self._converged():
                np.matmul(rows[part], x.T, out=values[:, done : done + len(x)])
                done += len(x)
            yield part, values[:, :done].T

    def scattered(self, root: np.ndarray) -> Samples:
        """Samples with noise of the covariance `root` · `root`ᵀ, (n, h), added to the first n of x; always the same noise."""
        source = self.batches

        def batches() -> Iterator[np.ndarray]:
            rng = np.random.default_rng([self.seed, 1])
            for x in source():
                more = x.copy()
                more[:, : len(root)] += rng.standard_normal((len(x), root.shape[1])) @ root.T
                yield more

        return replace(self, batches=batches)

    def mapped(self, matrix: np.ndarray) -> Samples:
        """Samples of matrix · x."""
        source = self.batches

        def batches() -> Iterator[np.ndarray]:
            return (x @ matrix.T for x in source())

        return Samples(
            self.trials, batches, self.chi_square, self.error, self.solved, self.outliers, self.seed, self.tolerance
        )


class TrialFolder:
    """Finished batches of a run on disk; `record`: seed, batch size and fingerprint of the solution.

    Raises `InputError` when the folder holds trials and `resume` is not asked for, or those of another run.
    """

    def __init__(self, path: Path, record: dict[str, Any], resume: bool) -> None:
        self.path, self.fingerprint, self.record = path, str(record["solution"]), record
        self.run = hashlib.sha256(json.dumps(record, sort_keys=True).encode()).hexdigest()
        existing = path / RECORD
        if existing.exists():
            if not resume:
                raise InputError(
                    f"{path} holds the trials of an interrupted run; go on with `resume=True`, or remove it"
                )
            found = _read_record(existing)
            if found != record:
                different = ", ".join(k for k in record if found.get(k) != record[k])
                raise InputError(
                    f"{path} holds the trials of another run ({different} differs); remove the folder, or go on with what made it"
                )
        for left in path.glob(".*.part"):
            left.unlink(missing_ok=True)

    def _begin(self) -> None:
        """The folder appears with its first batch: a run that never started leaves nothing."""
        self.path.mkdir(parents=True, exist_ok=True)
        if not (self.path / RECORD).exists():
            self._write(self.path / RECORD, lambda p: p.write_text(json.dumps(self.record), encoding="utf-8"))

    def _write(self, place: Path, write: Callable[[Path], Any]) -> None:
        temporary = self.path / f".{uuid.uuid4().hex[:12]}.part"
        try:
            write(temporary)
            os.replace(temporary, place)
        finally:
            temporary.unlink(missing_ok=True)

    def place(self, batch: int) -> Path:
        """File of a batch."""
        return self.path / f"{batch:07d}.npz"

    def done(self, batch: int) -> bool:
        """Whether a batch of this run is there, whole; one that is damaged is made again."""
        if not self.place(batch).exists():
            return False
        try:
            return str(self.load(batch)["run"]) == self.run
        except InputError:
            return False

    def save(self, batch: int, arrays: dict[str, np.ndarray]) -> None:
        """Keep a finished batch. Raises `OutputError` when there is no space."""

        def write(place: Path) -> None:
            with place.open("wb") as file:
                np.savez(file, run=np.array(self.run), **arrays)  # type: ignore[arg-type]
                file.flush()
                os.fsync(file.fileno())

        try:
            self._begin()
            self._write(self.place(batch), write)
        except OSError as error:
            raise OutputError(
                f"{self.path}: trials cannot be kept: {error.strerror or error}; make room and go on with `resume=True`"
            ) from None

    def load(self, batch: int) -> dict[str, np.ndarray]:
        """Arrays of a finished batch. Raises `InputError` when its file is damaged."""
        place = self.place(batch)
        try:
            return _read_arrays(place)
        except _DAMAGED as error:
            raise InputError(
                f"{place}: damaged ({str(error)[:80]}); remove it, and its trials are made again"
            ) from None


def _read_record(place: Path) -> dict[str, Any]:
    """What makes the trials of a folder. Raises `InputError` when it is damaged."""
    try:
        found = json.loads(place.read_text(encoding="utf-8"))
        if isinstance(found, dict):
            return found
    except (OSError, ValueError, RecursionError):
        pass
    raise InputError(f"{place}: damaged; expected the record of an interrupted run. Remove the folder {place.parent}")


def _read_arrays(place: Path) -> dict[str, np.ndarray]:
    """The arrays of a batch, every byte held against the checksums of the archive."""
    with zipfile.ZipFile(place) as archive:
        size = place.stat().st_size
        if any(item.file_size > size for item in archive.infolist()) or archive.testzip() is not None:
            raise ValueError("a checksum is wrong")
    with np.load(place) as file:
        arrays = {name: file[name] for name in file.files}
    columns = [arrays[name] for name in COLUMNS]
    if arrays["x"].ndim != 2 or any(c.shape != (len(arrays["x"]),) for c in columns) or arrays["run"].ndim:
        raise ValueError("the shapes are wrong")
    return arrays
