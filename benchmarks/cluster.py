"""Dask: Monte Carlo of M on one and on two single-threaded worker processes."""

from __future__ import annotations

import time

import numpy as np

import volid
from benchmarks import cases
from benchmarks.measure import Row, peak_memory
from volid.uncertainty.monte_carlo import BATCH, monte_carlo

BATCHES = 8


def cluster_row(quick: bool) -> Row:
    """Efficiency = time on one worker / (2 x time on two); each cluster has worked once before it is timed."""
    from distributed import LocalCluster

    solution = volid.fit(cases.three_axis("S" if quick else "M").campaign)
    seconds = {}
    for workers in (1, 2):
        with LocalCluster(n_workers=workers, threads_per_worker=1, processes=True, dashboard_address=None) as cluster:
            address = cluster.scheduler_address
            monte_carlo(solution, 2 * workers * BATCH, seed=1, scheduler=address)
            spent = []
            for seed in range(2 if quick else 3):
                began = time.perf_counter()
                monte_carlo(solution, BATCHES * BATCH, seed=seed + 2, scheduler=address)
                spent.append(time.perf_counter() - began)
            seconds[workers] = float(np.median(spent))
    result = Row(f"Dask, Monte Carlo {BATCHES * BATCH:,}, two workers", seconds[2], {"one worker": seconds[1]})
    result.ratios = {"one worker": (seconds[1] / seconds[2],) * 3}
    result.memory_mb = peak_memory()
    result.notes.append(f"efficiency {seconds[1] / seconds[2] / 2:.2f}; workers compute on one thread each")
    return result
