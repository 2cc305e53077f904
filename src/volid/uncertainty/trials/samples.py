"""Samples of the parameters, by Monte Carlo: kept on disk in batches, read batch by batch, so that memory stays bounded.

A folder of trials holds `run.json` (what makes the trials: seed, hash of the solution) and one file per finished batch, written
whole or not at all: a killed run loses the batches in work and nothing else. Every batch names its run; those of another are
not taken.
"""

from __future__ import annotations

import hashlib
import json
import os
import uuid
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from volid.exceptions import InputError

RECORD = "run.json"
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
            found = json.loads(existing.read_text(encoding="utf-8"))
            if not resume:
                raise InputError(
                    f"{path} holds the trials of an interrupted run; go on with `resume=True`, or remove it"
                )
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
        write(temporary)
        os.replace(temporary, place)

    def place(self, batch: int) -> Path:
        """File of a batch."""
        return self.path / f"{batch:07d}.npz"

    def done(self, batch: int) -> bool:
        """Whether a batch of this run is there."""
        if not self.place(batch).exists():
            return False
        with np.load(self.place(batch)) as file:
            return "run" in file.files and str(file["run"]) == self.run

    def save(self, batch: int, arrays: dict[str, np.ndarray]) -> None:
        """Keep a finished batch."""

        def write(place: Path) -> None:
            with place.open("wb") as file:
                np.savez(file, run=np.array(self.run), **arrays)  # type: ignore[arg-type]
                file.flush()
                os.fsync(file.fileno())

        self._begin()
        self._write(self.place(batch), write)

    def load(self, batch: int) -> dict[str, np.ndarray]:
        """Arrays of a finished batch."""
        with np.load(self.place(batch)) as file:
            return {name: file[name] for name in file.files}
