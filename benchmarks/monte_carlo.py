"""Monte Carlo: 10,000 exact refits by `Solution.monte_carlo` against loops of warm single fits, ours and the peers'."""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import volid
from benchmarks import cases
from benchmarks.ceres_peer import Ceres
from benchmarks.fits import fastest_ceres
from benchmarks.measure import Row, peak_memory
from benchmarks.peers import Scaled, optimistix_fit, scipy_fit
from volid.fitting.equations.compiled import Compiled
from volid.fitting.equations.engine import Engine
from volid.fitting.equations.interpreted import Interpreted
from volid.fitting.equations.problem import build_problem
from volid.fitting.equations.solver import solve
from volid.fitting.starts import find_starts
from volid.uncertainty.trials.draws import trial_generator, trial_noise
from volid.uncertainty.trials.monte_carlo import monte_carlo
from volid.uncertainty.trials.run import BATCH, run_of, run_trials

LOOP = 50  # trials of every warm loop that are really run


def monte_carlo_row(name: str, quick: bool) -> Row:
    """`trials` refits of a case (S, M, or the bundled campaign), rounds of loops and batches in turn."""
    trials, loop, rounds = (2 * BATCH, 10, 2) if quick else (10 * BATCH, LOOP, 5)
    campaign = volid.load_campaign(_BUNDLED) if name == "bundled" else cases.three_axis(name).campaign
    solution = volid.fit(campaign)
    began = time.perf_counter()
    run = run_of(solution, 0)
    run_trials(run, 0, BATCH)
    start_up = {"trace, compile, first batch": time.perf_counter() - began}
    loops = _Loops(name, solution, run)
    seconds: dict[str, list[float]] = {}
    for number in range(rounds):
        for what, spent in _round(solution, loops, trials, loop // rounds, number).items():
            seconds.setdefault(what, []).append(spent)
    own = np.array(seconds.pop("volid"))
    limit = np.array(seconds.pop("product and random numbers"))
    ratios = {
        w: (float(np.median(t / own)), float((t / own).min()), float((t / own).max()))
        for w, t in ((w, np.array(v)) for w, v in seconds.items())
    }
    result = Row(
        f"Monte Carlo {trials:,} refits, {name}", float(np.median(own)), {w: float(np.median(t)) for w, t in seconds.items()},
        ratios, float(np.median(limit)), "three products and random numbers", peak_memory(), start_up,
    )  # fmt: skip
    result.accuracy = {"volid": loops.distance(min(8, loop))}
    result.notes += [*loops.notes, f"loops: {loop // rounds * rounds} trials really run, scaled to {trials:,}"]
    loops.close()
    return result


def million_row(quick: bool) -> Row:
    """A million refits of S (ten thousand with `quick`); memory is the question."""
    trials = 10 * BATCH if quick else 1_000_000
    solution = volid.fit(cases.three_axis("S").campaign)
    monte_carlo(solution, BATCH, seed=1)
    before = peak_memory()
    began = time.perf_counter()
    samples = monte_carlo(solution, trials, seed=0).samples
    result = Row(f"Monte Carlo {samples.trials:,} refits, S", time.perf_counter() - began, memory_mb=peak_memory())
    result.notes.append(f"peak before them {before:.0f} MB (fit and one batch); samples go to a file as they come")
    return result


_BUNDLED = "datasets/vertical_multilateration/campaign.toml"


class _Loops:
    """Warm single fits, begun at the solution, each with noise of the same distribution as the batch's."""

    def __init__(self, name: str, solution: Any, run: Any) -> None:
        self.solution, self.run, self.notes = solution, run, []
        self.refitter = run.refitter
        self.z = np.asarray(self.refitter.frozen.z)
        self.free = np.asarray(self.refitter.frozen.basis) @ self.refitter.whitened_directions()
        self.ceres: Ceres | None = None
        problem = build_problem(solution.campaign, solution.model, find_starts(solution.campaign))
        self.problem = problem._replace(free=self.free)
        self.peers: dict[str, Callable[[Any], Any]] = {}
        if name in cases.SIZES:
            self.ceres = fastest_ceres(name, cases.three_axis(name), self.notes)
            self.peers = self._peers(name)

    def _peers(self, name: str) -> dict[str, Callable[[Any], Any]]:
        """Fits of a problem from the solution on; 50 of M by optimistix' Levenberg-Marquardt would take an hour."""
        scaled = Scaled(cases.Case(self.solution.campaign, self.problem, self.z), self.z)
        peers = {f"scipy {method}": partial(scipy_fit, scaled, method) for method in ("dogbox", "trf")}
        solvers = ("GN", "LM") if name == "S" else ("GN",)
        peers |= {f"optimistix {solver}": optimistix_fit(scaled, solver) for solver in solvers}

        def of(fit: Callable[[], Any], problem: Any) -> Any:
            scaled.system = jax.tree.map(jnp.asarray, problem.system)
            return fit()

        return {peer: partial(of, fit) for peer, fit in peers.items()}

    def drawn(self, number: int) -> Any:
        """The problem with the readings of one trial."""
        noise, _ = self._noise(number)
        flat = self.refitter.flat_predictions() + noise * np.concatenate(
            [s.u.ravel() for s in self.solution.campaign.sets]
        )
        campaign = self.solution.campaign.__class__(
            **{**vars(self.solution.campaign), "sets": self._sets(self.refitter.by_set(flat))}
        )
        return build_problem(campaign, self.solution.model, find_starts(self.solution.campaign))._replace(
            free=self.free
        )

    def _sets(self, readings: list[np.ndarray]) -> tuple[Any, ...]:
        from dataclasses import replace

        return tuple(replace(s, readings=r) for s, r in zip(self.solution.campaign.sets, readings, strict=True))

    def _noise(self, number: int) -> tuple[np.ndarray, np.ndarray]:
        r = self.refitter
        return tuple(a[0] for a in trial_noise(self.run.seed, number, 1, r.n_readings, r.n_prior, self.run.pseudo))

    def distance(self, count: int) -> float:
        """Largest distance of `count` trials to their minimum by full re-convergence, in standard uncertainties."""
        found = run_trials(self.run, 0, BATCH)["x"][:count]
        u, worst = self.refitter.u, 0.0
        for i in range(count):
            z = np.asarray(self.refitter.frozen.basis) @ found[i]
            again = solve(self.drawn(i), solve(self.drawn(i), z).z).z
            x = np.linalg.lstsq(np.asarray(self.refitter.frozen.basis), again, rcond=None)[0]
            worst = max(worst, float(np.max(np.abs(x - found[i])[u > 0] / u[u > 0])))
        return worst

    def close(self) -> None:
        if self.ceres is not None:
            self.ceres.close()


def _round(solution: Any, loops: _Loops, trials: int, loop: int, number: int) -> dict[str, float]:
    """Seconds of volid, of the limit, and of every loop scaled to `trials`."""
    began = time.perf_counter()
    monte_carlo(solution, trials, seed=number)
    seconds = {"volid": time.perf_counter() - began}
    seconds["product and random numbers"] = _limit(solution, trials)
    problems = [loops.drawn(number * loop + i) for i in range(loop)]
    engines: dict[str, Engine] = {"own warm loop": Compiled(), "own warm loop, interpreted": Interpreted()}
    for what, engine in engines.items():
        own = [p._replace(equations=engine.equations(p.system)) for p in problems]
        solve(own[0], loops.z)
        began = time.perf_counter()
        for problem in own:
            solve(problem, loops.z)
        seconds[what] = (time.perf_counter() - began) * trials / loop
    if loops.ceres is not None:
        seconds["Ceres warm loop"] = loops.ceres.loop(loop) * trials / loop
    for peer, fit in loops.peers.items():
        fit(problems[0])
        began = time.perf_counter()
        for problem in problems:
            fit(problem)
        seconds[f"{peer} warm loop"] = (time.perf_counter() - began) * trials / loop
    return seconds


def _limit(solution: Any, trials: int) -> float:
    """Seconds of the random numbers of all readings on two threads, and of the products that an exact refit needs.

    JᵀE with J (m x n), and for one gradient the error values of all readings from the coefficients and back: three products in
    double precision.
    """
    m = solution.campaign.n_readings
    n = len(solution.parameters) + len(solution.nuisance_table)
    width = 256
    g = jnp.asarray(np.random.default_rng(0).standard_normal((n, m)))
    multiply = jax.jit(lambda g, e: g @ e)
    multiply(g, jnp.zeros((m, width))).block_until_ready()
    generators = [trial_generator(1, i) for i in range(2)]
    halves = [np.empty((width // 2, m)) for _ in generators]
    with ThreadPoolExecutor(2) as pool:
        for _ in range(2):  # the second time into memory that is there
            began = time.perf_counter()
            list(pool.map(lambda p: p[0].standard_normal(out=p[1]), zip(generators, halves, strict=True)))
            drawing = time.perf_counter() - began
    e = jnp.asarray(np.concatenate(halves).T)
    began = time.perf_counter()
    multiply(g, e).block_until_ready()
    once = time.perf_counter() - began
    curves = solution.model.layout.n_coefficients
    return (drawing + once * (1.0 + 2.0 * curves / n)) * trials / width
