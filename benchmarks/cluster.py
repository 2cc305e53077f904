"""Dask: Monte Carlo of M on one and on two single-threaded worker processes."""

from __future__ import annotations

from contextlib import ExitStack

import numpy as np

import volid
from benchmarks import cases
from benchmarks.measure import REPEATS, Row, interleaved, row
from volid.uncertainty.trials.monte_carlo import monte_carlo
from volid.uncertainty.trials.run import BATCH

BATCHES = 8


def cluster_row(quick: bool) -> Row:
    """Efficiency = time on one worker / (2 x time on two), round by round; both clusters have worked before they are timed."""
    from distributed import LocalCluster

    solution = volid.fit(cases.three_axis("S" if quick else "M").campaign)
    with ExitStack() as stack:
        clusters = {
            name: stack.enter_context(
                LocalCluster(n_workers=workers, threads_per_worker=1, processes=True, dashboard_address=None)
            )
            for name, workers in (("volid", 2), ("one worker", 1))
        }
        trials = {name: iter(range(100)) for name in clusters}

        def run(name: str) -> None:
            monte_carlo(solution, BATCHES * BATCH, seed=next(trials[name]), scheduler=clusters[name].scheduler_address)

        times = interleaved({name: lambda name=name: run(name) for name in clusters}, 2 if quick else REPEATS, np.inf)
    result = row(f"Dask, Monte Carlo {BATCHES * BATCH:,}, two workers", times)
    middle, low, high = (r / 2 for r in result.ratios["one worker"])
    result.notes.append(f"efficiency {middle:.2f} ({low:.2f} … {high:.2f}); workers compute on one thread each")
    return result
