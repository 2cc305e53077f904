"""Growth of time with readings, parameters, stations and trials: `python -m benchmarks.growth` writes growth.csv, growth.svg."""

from __future__ import annotations

import csv
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import volid
from benchmarks import cases
from benchmarks.measure import peak_memory
from volid.campaign import Campaign
from volid.fitting.equations.solver import solve
from volid.model.error_functions import motion_names
from volid.model.error_model import build_model
from volid.uncertainty.trials.monte_carlo import monte_carlo

READINGS = (1_250, 2_500, 5_000, 10_000, 20_000, 40_000, 80_000, 160_000)
SEGMENTS = (3, 5, 8, 11, 16, 22)
STATIONS = (3, 4, 5, 6, 7, 8)
TRIALS = (1_024, 2_048, 4_096, 8_192)
ROUNDS = 3


def case(m: int = 5_000, segments: int = 11, stations: int = 6) -> cases.Case:
    """A three-axis case of any size."""
    machine = cases.three_axis_machine()
    readings = cases._distance_set(m, stations, False)
    plan = Campaign(machine, cases._stations(stations, np.zeros(3)), (readings,))
    chosen = {n: (segments,) for n in motion_names(machine)}
    model = build_model(machine, chosen)
    return cases.read(plan, model, np.random.default_rng(5).normal(0.0, cases.OFF, (stations, 3)))


def _seconds(problem: Any) -> float:
    solve(problem)
    spent = []
    for _ in range(ROUNDS):
        began = time.perf_counter()
        solve(problem)
        spent.append(time.perf_counter() - began)
    return min(spent)


def measure() -> list[tuple[str, int, float, float]]:
    """(what grows, its size, seconds, peak memory so far [MB]); the least of `ROUNDS` rounds."""
    rows = []
    for what, sizes in (("readings", READINGS), ("segments", SEGMENTS), ("stations", STATIONS)):
        for n in sizes:
            own = case(**{"m" if what == "readings" else what: n})
            rows.append((what, n, _seconds(own.problem), peak_memory()))
            print(*rows[-1], flush=True)
    base = case(1_200, 11, 4)
    solution = volid.fit(replace(base.campaign, title="growth"))
    monte_carlo(solution, 1_024)
    for n in TRIALS:
        began = time.perf_counter()
        monte_carlo(solution, n, seed=n)
        rows.append(("trials", n, time.perf_counter() - began, peak_memory()))
        print(*rows[-1], flush=True)
    return rows


def plot(rows: list[tuple[str, int, float, float]], path: Path) -> None:
    """One panel for each thing that grows, logarithmic, with a line of slope one."""
    import matplotlib

    matplotlib.use("svg")
    import matplotlib.pyplot as plt
    from matplotlib.ticker import NullFormatter, ScalarFormatter

    names = list(dict.fromkeys(r[0] for r in rows))
    figure, panels = plt.subplots(2, len(names), figsize=(3.4 * len(names), 5.0), layout="constrained", sharex="col")
    for (above, below), name in zip(panels.T, names, strict=True):
        x, seconds, memory = np.array([(r[1], r[2], r[3]) for r in rows if r[0] == name]).T
        above.loglog(x, 1e3 * seconds, "o-", label="measured")
        above.loglog(x, 1e3 * seconds[-1] * x / x[-1], "--", color="0.6", label="linear")
        below.semilogx(x, memory, "o-")
        below.set(xlabel=name, ylim=(0.0, None))
        shown = x if len(x) < 7 else x[::3]
        below.set_xticks(shown, [f"{n:,.0f}" for n in shown])
        below.xaxis.set_minor_formatter(NullFormatter())
        above.yaxis.set_major_formatter(ScalarFormatter())
        crowded = x[-1] > 20 * x[0]
        above.yaxis.set_minor_formatter(NullFormatter() if crowded else ScalarFormatter())
    panels[0, 0].set_ylabel("time [ms]")
    panels[1, 0].set_ylabel("peak memory so far [MB]")
    panels[0, 0].legend()
    figure.savefig(path)


if __name__ == "__main__":
    folder = Path(__file__).parent
    found = measure()
    with (folder / "growth.csv").open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([("what", "size", "seconds", "peak_mb"), *found])
    plot(found, folder / "growth.svg")
    sys.exit(0)
