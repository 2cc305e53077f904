"""Batches on a Dask cluster: every worker rebuilds the refits once, batches of a worker that dies go to another."""

from __future__ import annotations

import pickle
from dataclasses import replace
from typing import Any

import numpy as np

from volid.backend.cluster import cluster, gather
from volid.backend.processes import single_threaded_environment
from volid.backend.steps import Step
from volid.fitting.solution import Solution
from volid.uncertainty.trials.run import BATCH, CarryOut, Progress, batches_to_do, run_of, run_trials
from volid.uncertainty.trials.samples import TrialFolder

_RUNS: dict[str, Any] = {}  # of this worker process by the solution, the last one only


def carry_out_on(solution: Solution, seed: int, address: str) -> CarryOut:
    """Carries out batches of trials on a cluster."""
    payload = pickle.dumps(replace(solution, samples=None))

    def carry_out(store: TrialFolder, first: int, last: int, progress: Progress) -> None:
        waiting = batches_to_do(store, first, last)
        with cluster(address) as client:
            tasks = [(store.fingerprint, seed, batch * BATCH, BATCH) for batch in waiting]
            for done, (i, arrays) in enumerate(gather(client, _batch, tasks, payload), start=1):
                store.save(waiting[i], arrays)
                progress(Step(done, len(waiting), f"batches of {BATCH} trials"))

    return carry_out


def _batch(payload: bytes, key: str, seed: int, first: int, count: int) -> dict[str, np.ndarray]:
    """One batch, in a worker; in a fresh one JAX and NumPy take one thread, so that all workers make the same last digits.

    A worker may be a thread of the user's own process, whose environment stays as it was.
    """
    with single_threaded_environment():
        if key not in _RUNS:
            _RUNS.clear()
            _RUNS[key] = run_of(pickle.loads(payload), seed)
        return run_trials(_RUNS[key]._replace(seed=seed), first, count)
