"""Monte Carlo: full nonlinear refits of synthetic campaigns drawn from the fitted model with all stated uncertainties.

A trial draws every reading anew within its u, and every pseudo-reading of prior knowledge (systematic effects with their
distribution, calibrated lengths, an earlier solution, the smoothness of the functions) within its own; the refit is exact
(`refit`). JCGM 101:2008, 102:2011.
"""

from __future__ import annotations

import hashlib
import json
import os
import tempfile
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from volid.backend.consent import ask_memory
from volid.backend.steps import Step
from volid.backend.threads import one_blas_thread
from volid.exceptions import InputError
from volid.fitting.solution import Solution
from volid.fitting.streamed import check_refittable
from volid.uncertainty.coverage import coverage_intervals, numerical_tolerance
from volid.uncertainty.outputs import Outputs, headline_outputs
from volid.uncertainty.trials.distributed import carry_out_on
from volid.uncertainty.trials.draws import GENERATOR
from volid.uncertainty.trials.run import BATCH, CarryOut, Progress, Run, batches_to_do, run_of, run_trials
from volid.uncertainty.trials.samples import Samples, TrialFolder

PAUSE = 1.0  # s between two messages while a batch is computed
TRIALS = 10_000  # JCGM 101 7.2: M = 10^6 often gives one or two digits; 10^4 suits costly models
STAGE = 10_000  # trials between two looks at the numerical tolerance, JCGM 101 7.9.4
STAGES = 100
BYTES = 16.0  # of an unknown of a trial, while samples are read and put together
FEWEST = 20  # 1/(1 - 0.95): fewer have no 95 % interval


@one_blas_thread()
def monte_carlo(
    solution: Solution,
    trials: int | None = None,
    *,
    digits: int | None = None,
    seed: int = 0,
    folder: str | Path | None = None,
    resume: bool = False,
    scheduler: str | None = None,
    progress: Progress | None = None,
) -> Solution:
    """The solution with samples of its parameters: `trials` refits (10,000 by default), or as many as `digits` need.

    With `digits`, stages of 10,000 trials follow one another until twice the standard deviation of the means over the stages of
    every headline output (estimate, u, end points of the 95 % interval) is below δ = 10^l/2, u having that many significant
    digits (JCGM 101 7.9.4); `samples.tolerance` says how far that was reached. Trials follow from `seed` and their number:
    neither batches nor workers change them.

    Args:
        solution: A solution, as `volid.fit` makes it.
        trials: Number of refits, at least 20; None: 10,000, or as many as `digits` need.
        digits: Number of significant digits of u that the results have to reach; it excludes `trials`.
        seed: Seed of the random numbers.
        folder: Folder where finished batches are kept; None: a temporary folder that is removed with the samples.
        resume: Whether an interrupted run in `folder` is continued.
        scheduler: Address of a Dask scheduler that distributes the trials; None: they run in this process.
        progress: Function that is called with messages about the progress.

    Returns:
        The same solution with `samples`.

    Raises:
        InputError: the solution has no redundancy or was fitted part by part, a number is out of range, or the folder contains
            another run.

    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/five_axis_rtest/campaign.toml"))
    >>> volid.monte_carlo(solution, 20, seed=1).samples.trials
    20
    """
    progress = progress or (lambda message: None)
    _check(solution, trials, digits, seed)
    progress("preparing the refits")
    keeper = None
    if folder is None:
        keeper = tempfile.TemporaryDirectory(prefix="volid-trials-")
        folder = keeper.name
    store = TrialFolder(
        Path(folder), {"seed": seed, "generator": GENERATOR, "batch": BATCH, "solution": fingerprint(solution)}, resume
    )
    carry_out = carry_out_on(solution, seed, scheduler) if scheduler else _local(run_of(solution, seed))
    if digits is None:
        total, reached = trials or TRIALS, float("nan")
        carry_out(store, 0, total, progress)
    else:
        total, reached = _adaptive(solution, carry_out, store, digits, progress)
    return replace(solution, samples=_samples(store, total, seed, reached, keeper))


def _check(solution: Solution, trials: int | None, digits: int | None, seed: int) -> None:
    """Raises `InputError` for numbers out of range, or a solution that does not hold all its readings."""
    if trials is not None and digits is not None:
        raise InputError("Monte Carlo: trials and digits exclude each other; give the number or the goal")
    if trials is not None and trials < FEWEST:
        raise InputError(
            f"Monte Carlo: {trials} trials; expected at least {FEWEST}, so that a 95 % interval has an end"
        )
    if digits is not None and not 1 <= digits <= 4:
        raise InputError(f"Monte Carlo: {digits} significant digits; expected 1 to 4")
    unknowns = solution.covariance.shape[0]
    size = float(trials or 0) * unknowns * BYTES
    what = f"Monte Carlo: {trials or 0:,} trials of {unknowns} unknowns, as many bytes in the file"
    ask_memory(what, size, "Take fewer trials, such as 10,000, or state the `digits` that you need")
    check_refittable(solution, "Monte Carlo")
    if seed < 0:
        raise InputError(f"seed is {seed}; expected a whole number >= 0")


def fingerprint(solution: Solution) -> str:
    """Hash of what the trials depend on: parameters, covariance, readings, effects with their distributions, the kind of fit."""
    stated = {
        s.name: [[e.name, e.type, e.u, e.per, dict(e.options)] for e in s.effects] for s in solution.campaign.sets
    }
    text = json.dumps([stated, dict(solution.options)], sort_keys=True, default=str)
    digest = hashlib.sha256(text.encode())
    arrays = [solution.parameters, solution.nuisance, solution.covariance]
    arrays += [
        a
        for s in solution.campaign.sets
        for a in (*(v for end in s.ends for v in (end.positions, end.tool)), s.readings, s.u)
    ]
    arrays += [*(o.astype(float) for o in solution.readings.outliers), solution.prior_rows, solution.smooth_spread]
    for a in arrays:
        digest.update(np.ascontiguousarray(np.asarray(a, dtype=float)).tobytes())
    return digest.hexdigest()


def _local(run: Run) -> CarryOut:
    """Batches on this machine, two at a time: one draws and waits while the other computes."""

    def carry_out(store: TrialFolder, first: int, last: int, progress: Progress) -> None:
        waiting = batches_to_do(store, first, last)
        said = before = BATCH * (len(range(first // BATCH, -(-last // BATCH))) - len(waiting))
        done: list[int] = []  # trials, a few at a time, by both threads; only this one says so
        with ThreadPoolExecutor(max(1, min(2, os.cpu_count() or 1))) as pool:
            running: dict[Future[Any], int] = {}
            try:
                while waiting or running:
                    while waiting and len(running) < 2:
                        batch = waiting.pop(0)
                        running[pool.submit(run_trials, run, batch * BATCH, BATCH, done.append)] = batch
                    ready, _ = wait(running, PAUSE, FIRST_COMPLETED)
                    for future in ready:
                        store.save(running.pop(future), future.result())
                    if ready or before + sum(done) > said:
                        said = before + sum(done)
                        progress(Step(min(said, last - first), last - first, "trials"))
            except BaseException:
                pool.shutdown(wait=False, cancel_futures=True)
                raise

    return carry_out


def _samples(store: TrialFolder, trials: int, seed: int, reached: float, keeper: Any) -> Samples:
    """The first `trials` trials of the folder; `keeper` keeps a temporary folder alive as long as the samples."""
    numbers = range(-(-trials // BATCH))

    def batches() -> Iterator[np.ndarray]:
        assert keeper is None or keeper.name
        for b in numbers:
            yield store.load(b)["x"][: trials - b * BATCH]

    parts: dict[str, list[np.ndarray]] = {"error": [], "chi_square": [], "solved": [], "outliers": []}
    for b in numbers:
        arrays = store.load(b)
        for name, column in parts.items():
            column.append(arrays[name])
    columns = {name: np.concatenate(column)[:trials] for name, column in parts.items()}
    return Samples(trials=trials, batches=batches, seed=seed, tolerance=reached, **columns)


def _adaptive(
    solution: Solution, carry_out: CarryOut, store: TrialFolder, digits: int, progress: Progress
) -> tuple[int, float]:
    """Stages until the headline outputs are stable; (trials, achieved over wanted tolerance). JCGM 101 7.9.4."""
    outputs = headline_outputs(solution)
    stages: list[np.ndarray] = []

    def of_stage(message: str) -> None:  # nobody knows how many stages there will be
        progress(message.within("this stage") if isinstance(message, Step) else message)

    ratio = float("inf")
    for h in range(STAGES):
        carry_out(store, h * STAGE, (h + 1) * STAGE, of_stage)
        stages.append(_stage(store, outputs, h))
        if h < 1:
            continue
        values = np.array(stages)  # (h, 4, q)
        scatter = 2.0 * values.std(axis=0, ddof=1) / np.sqrt(len(values))
        tolerance = numerical_tolerance(values[:, 1].mean(axis=0), digits)
        seen = tolerance > 0.0
        ratio = float((scatter[:, seen] / tolerance[seen]).max(initial=0.0))
        progress(f"{(h + 1) * STAGE} trials; numerical tolerance {ratio:.2f} of what {digits} digits need")
        if ratio <= 1.0:
            break
    return len(stages) * STAGE, ratio


def _stage(store: TrialFolder, outputs: Outputs, h: int) -> np.ndarray:
    """Mean, standard deviation and symmetric interval of the outputs in trials of one stage, (4, q)."""
    first, last = h * STAGE, (h + 1) * STAGE
    x = []
    for b in range(first // BATCH, -(-last // BATCH)):
        x.append(store.load(b)["x"][max(first - b * BATCH, 0) : last - b * BATCH])
    drawn = np.concatenate(x)
    values = outputs.values(drawn[np.isfinite(drawn).all(axis=1)])
    found = coverage_intervals(values)
    return np.stack([values.mean(axis=0), values.std(axis=0, ddof=1), found.low, found.high])
