"""Fits: the minimum of a problem that is set up, from the nominal machine with stations 5 mm off, against peers."""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import volid
from benchmarks import cases
from benchmarks.ceres_peer import SOLVERS, Ceres, build
from benchmarks.measure import REPEATS, Row, interleaved, row
from benchmarks.peers import Scaled, optimistix_fit, scipy_fit
from volid.fitting.equations.interpreted import Interpreted
from volid.fitting.equations.solver import solve

SLOW = 3  # rounds of a peer that takes seconds


def product_limit(m: int, n: int) -> Callable[[], Any]:
    """One dense JᵀJ of this shape by JAX, in slices of at most 20,000 rows: the arithmetic that no dense method avoids."""
    part = min(m, 20_000)
    a = jnp.asarray(np.random.default_rng(0).standard_normal((n, part)))
    multiply = jax.jit(lambda a: a @ a.T)

    def run() -> None:
        for _ in range(max(1, m // part)):
            multiply(a).block_until_ready()

    return run


def fit_row(name: str, quick: bool) -> Row:
    """Case S or M against every peer, or a five-axis case against scipy."""
    began = time.perf_counter()
    case = {"five-axis R-test": cases.five_axis, "mixed five-axis": cases.mixed}.get(
        name, lambda: cases.three_axis(name)
    )()
    start_up = {"case": time.perf_counter() - began}
    peers, notes, accuracy = _peers(name, case, quick, start_up)
    m, n = case.campaign.n_readings, case.problem.free.shape[1]
    contestants: dict[str, Callable[[], Any]] = {"volid": lambda: solve(case.problem), **peers}
    contestants["volid, interpreted"] = _interpreted(case)
    contestants["one dense JᵀJ"] = product_limit(m, n)
    began = time.perf_counter()
    best = solve(case.problem)
    start_up["volid: trace and compile"] = time.perf_counter() - began
    times = interleaved(contestants, 2 if quick else REPEATS)
    result = row(f"fit {name} ({m:,} × {n})", times, "one dense JᵀJ", start_up=start_up, notes=notes)
    result.accuracy = {"volid": _distance(case, best.z, best), **accuracy(best)}
    result.notes.append(f"{best.iterations} steps; the covariance takes one assembly more: {_covariance(best):.4f} s")
    return result


def _interpreted(case: cases.Case) -> Callable[[], Any]:
    problem = case.problem._replace(equations=Interpreted().equations(case.problem.system))
    return lambda: solve(problem)


def _covariance(best: Any) -> float:
    began = time.perf_counter()
    _ = best.normal
    return time.perf_counter() - began


def _distance(case: cases.Case, z: np.ndarray, best: Any) -> float:
    """Distance to the minimum, reconverged from volid's, in standard uncertainties: the largest over the unknowns."""
    tight = solve(case.problem, best.z)
    free = case.problem.free
    covariance = np.linalg.inv(_scaled(best.normal.matrix)[0])
    scale = _scaled(best.normal.matrix)[1]
    u = np.sqrt(np.diagonal(covariance)) * scale
    y = np.linalg.lstsq(free, z - tight.z, rcond=None)[0]
    return float(np.abs(y / u).max())


def _scaled(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    scale = 1.0 / np.sqrt(np.diagonal(matrix))
    return matrix * np.outer(scale, scale), scale


def _peers(name: str, case: cases.Case, quick: bool, start_up: dict[str, float]) -> Any:
    notes: list[str] = []
    scaled = Scaled(case)
    peers: dict[str, Callable[[], Any]] = {f"scipy {m}": (lambda m=m: scipy_fit(scaled, m)) for m in ("dogbox", "trf")}
    found: dict[str, np.ndarray] = {}
    if name in cases.SIZES and not (quick and name == "M"):
        for kind in ("GN", "LM"):
            began = time.perf_counter()
            peers[f"optimistix {kind}"] = run = optimistix_fit(scaled, kind)
            found[f"optimistix {kind}"] = run()
            start_up[f"optimistix {kind}: compile and first"] = time.perf_counter() - began
    ceres = fastest_ceres(name, case, notes) if name in cases.SIZES else None
    if ceres is not None:
        peers["Ceres"] = ceres.solve
    for m in ("dogbox", "trf"):
        found[f"scipy {m}"] = scipy_fit(scaled, m)

    def accuracy(best: Any) -> dict[str, float]:
        result = {peer: _distance(case, z, best) for peer, z in found.items()}
        if ceres is not None:
            result["Ceres"] = _ceres_distance(case, ceres, best)
        return result

    return peers, notes, accuracy


def _ceres_distance(case: cases.Case, ceres: Ceres, best: Any) -> float:
    theta = ceres.theta(ceres.solve()[3])
    p = case.problem.model.parametrisation
    z = best.z.copy()
    tight = solve(case.problem, best.z).z
    z[: len(p)] = p @ theta
    z[len(p) :] = tight[len(p) :]
    return _distance(case, z, best)


def fastest_ceres(name: str, case: cases.Case, notes: list[str]) -> Ceres | None:
    """Ceres with the linear solver that is fastest on this case."""
    program = build(Path(tempfile.mkdtemp(prefix="volid-ceres-")))
    if isinstance(program, str):
        notes.append(f"Ceres skipped: {program}")
        return None
    trials = {s: Ceres(program, case, s) for s in SOLVERS if not (s == "qr" and name == "M")}
    seconds = {s: min(c.solve()[0] for _ in range(3)) for s, c in trials.items()}
    best = min(seconds, key=lambda s: seconds[s])
    notes.append("Ceres, " + ", ".join(f"{s} {t:.3f} s" for s, t in seconds.items()) + f": {best} taken, 2 threads")
    for s, c in trials.items():
        if s != best:
            c.close()
    return trials[best]


def large_row(name: str, quick: bool) -> Row:
    """Case L: the solve against one dense JᵀJ, and the dense assembly as volid's own peer."""
    case = cases.three_axis(name)
    m, n = case.campaign.n_readings, case.problem.free.shape[1]
    contestants = {"volid": lambda: solve(case.problem), "one dense JᵀJ": product_limit(m, n)}
    times = interleaved(contestants, 2 if quick else REPEATS)
    result = row(f"fit {name} ({m:,} × {n})", times, "one dense JᵀJ")
    best = solve(case.problem)
    result.notes.append(f"{best.iterations} steps; memory includes the campaign and setting it up")
    return result


STREAM = """
import re, sys, time
from volid.cli import main
began = time.perf_counter()
status = main(["fit", "--stream", sys.argv[1], "-o", sys.argv[2], "--force", "--json"])
peak = re.search(r"VmHWM:\\s+(\\d+)", open("/proc/self/status").read()).group(1)
print(f"\\nseconds {time.perf_counter() - began} peak {peak} status {status}")
"""


def streamed_row(quick: bool) -> Row:
    """Case L through `volid fit --stream`, a process of its own: time and the peak memory of that process."""
    case = cases.three_axis("M" if quick else "L lines")
    m, n = case.campaign.n_readings, case.problem.free.shape[1]
    folder = Path(tempfile.mkdtemp(prefix="volid-stream-"))
    volid.save_campaign(case.campaign, folder / "campaign.h5")
    limit = product_limit(m, n)
    limit()
    command = [sys.executable, "-c", STREAM, str(folder / "campaign.h5"), str(folder / "solution.h5")]
    spent, bound = [], []
    for _ in range(1 if quick else 2):
        found = subprocess.run(command, capture_output=True, text=True, check=False).stdout.splitlines()[-1].split()
        spent.append(float(found[1]))
        began = time.perf_counter()
        limit()
        bound.append(time.perf_counter() - began)
    result = Row(f"volid fit --stream ({m:,} × {n})", float(np.median(spent)), limit=float(np.median(bound)))
    result.limit_of, result.memory_mb = "one dense JᵀJ", float(found[3]) / 1024.0
    result.notes.append(
        "whole command in a process of its own, reading included: " + ", ".join(f"{s:.1f} s" for s in spent)
    )
    result.notes.append(f"exit status {found[5]}; the file has {(folder / 'campaign.h5').stat().st_size / 1e6:.0f} MB")
    shutil.rmtree(folder)
    return result


def whole_fit_row(name: str, quick: bool) -> Row:
    """`volid.fit` itself: starts, rank, smoothness, solve, leverages, verdict."""
    case = cases.five_axis() if "axis" in name else cases.three_axis(name)
    volid.fit(case.campaign)
    times = interleaved({"volid": lambda: volid.fit(case.campaign)}, 1 if quick else 3)
    result = row(f"volid.fit, whole call, {name}", times)
    result.notes.append("trilateration, rank decision, smoothness where it is estimated, solve, leverages, tests")
    return result
