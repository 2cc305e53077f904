"""Batches on a Dask cluster: every worker rebuilds the refits once, batches of a worker that dies go to another."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np

from volid.backend.processes import single_threaded_environment
from volid.exceptions import InputError
from volid.fitting.solution import Solution
from volid.uncertainty.trials.monte_carlo import BATCH, Progress, batches_to_do, run_of, run_trials
from volid.uncertainty.trials.samples import TrialFolder

_RUNS: dict[str, Any] = {}  # of this worker process by the solution, the last one only


@contextmanager
def cluster(address: str) -> Iterator[Any]:
    """A client of the Dask scheduler at `address`. Raises `InputError` when Dask is missing or nobody answers."""
    try:
        from distributed import Client
    except ImportError:
        raise InputError("`scheduler` needs Dask: pip install 'volid[distributed]'") from None
    try:
        client = Client(address, timeout="10s")
    except (OSError, ValueError, TimeoutError) as error:
        raise InputError(f"`scheduler={address}`: no Dask scheduler answers there ({error or 'time out'})") from None
    try:
        yield client
    finally:
        client.close()


def gather(
    client: Any, function: Callable[..., Any], tasks: list[tuple[Any, ...]], shared: Any
) -> Iterator[tuple[int, Any]]:
    """(number, result) of function(shared, *task) for every task, as they finish; dead workers' tasks are done again."""
    from distributed import as_completed

    handle = client.submit(_hold, shared, pure=False)
    futures = {client.submit(function, handle, *task, pure=False, retries=3): i for i, task in enumerate(tasks)}
    for future in as_completed(list(futures)):
        yield futures.pop(future), future.result()


def _hold(value: Any) -> Any:
    """A task whose result Dask can make again when the worker that holds it dies."""
    return value


def carry_out_on(solution: Solution, seed: int, address: str) -> Callable[[TrialFolder, int, int, Progress], None]:
    """Carries out batches of trials on a cluster."""
    payload = pickle.dumps(replace(solution, samples=None))

    def carry_out(store: TrialFolder, first: int, last: int, progress: Progress) -> None:
        waiting = batches_to_do(store, first, last)
        with cluster(address) as client:
            tasks = [(store.fingerprint, seed, batch * BATCH, BATCH) for batch in waiting]
            for done, (i, arrays) in enumerate(gather(client, _batch, tasks, payload), start=1):
                store.save(waiting[i], arrays)
                progress(f"{done} of {len(waiting)} batches of {BATCH} trials")

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
