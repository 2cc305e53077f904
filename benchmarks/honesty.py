"""Is the printed u true? Simulated campaigns by the exact chain of the tests, fitted as users do, judged by the same chain.

python -m benchmarks.honesty table --seeds 100 -o table.csv          # positions scattered and on 6 … 21 levels, three layouts
python -m benchmarks.honesty confidence --machines 1000 -o all.csv    # random machines and plans: accepted, yet far off?
python -m benchmarks.honesty show table.csv                           # the figures as text

The truth is no spline and comes from code apart from the package (`tests/exact_chain`); the functions and squareness of the
measured range follow from it by elementary formulas (`exact_chain.measured_range`). Two processes share the work, each campaign
follows from its seed.
"""

from __future__ import annotations

import argparse
import csv
import os
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

import numpy as np
from exact_chain import ExactMachine, Truth, default_stations, default_tools, gauge_basis, gauge_free, random_truth
from exact_chain.measured_range import truth_of_range
from exact_chain.tracker import tracker_campaign
from scipy.stats import qmc
from support.machines import LAYOUTS, MACHINES, exact_machine
from support.rtests import NO_LINEAR, SPHERES, r_test, r_test_campaign, rotary_only
from support.trackers import distance_campaign, volid_machine

import volid
from volid.fitting.location_errors import location_parameter
from volid.fitting.prediction.deviations import gradient_matrix

POINTS = 256  # of a field
PLACES = 9  # of a function


def field(
    solution: volid.Solution, exact: ExactMachine, truth: Truth, ranges: np.ndarray, tools: np.ndarray, gauge: bool
) -> Any:
    """Difference of the fields and its u over the ranges, (m, 3) each, what cannot be known taken out of both."""
    q = ranges[:, 0] + qmc.Sobol(len(ranges), seed=3).random(POINTS) * np.ptp(ranges, axis=1)
    tool = np.asarray(tools)[np.arange(POINTS) % len(tools)]
    difference = np.asarray(solution.deviation(q, tool))[:, :3] - exact.deviation(q, tool, truth)[:, :3]
    rows = gradient_matrix(solution.model, np.asarray(solution.parameters), q, tool, np.zeros_like(q))[:, :3]
    values, vectors = np.linalg.eigh(solution.parameter_covariance)
    root = rows.reshape(3 * POINTS, -1) @ (vectors * np.sqrt(np.maximum(values, 0.0)))
    removed = gauge_basis(q, tool, exact, tool_rotation=gauge)
    flat = difference.ravel() - removed @ (removed.T @ difference.ravel())
    u = np.linalg.norm(root - removed @ (removed.T @ root), axis=1)
    return flat, u


def judged(
    solution: volid.Solution, exact: ExactMachine, truth: Truth, tools: np.ndarray, gauge: bool
) -> dict[str, float]:
    """Numbers of one solution: field, and for three linear axes functions, squareness."""
    ranges = np.array([a.travel for a in solution.machine.axes])
    error, u = field(solution, exact, truth, ranges, tools, gauge)
    found = {
        "error": 1e3 * float(np.sqrt(np.mean(error**2))),
        "u": 1e3 * float(np.sqrt(np.mean(u**2))),
        "covered": float(np.mean(np.abs(error) <= 1.96 * u)),
        "worst": float(np.max(np.abs(error) / u)),
    }
    if len(exact.axes) == 3:
        own = dict(zip(exact.axes, map(tuple, ranges.tolist()), strict=True))
        functions, squareness = truth_of_range(truth, own, {a.letter: a.reference for a in solution.machine.axes})
        ratios = [
            (row.value - float(value(np.array([row.position]))[0])) / row.u
            for name, value in functions.items()
            for row in solution.motion(name, np.linspace(*own[name[2]], PLACES))
            if row.u > 1e-9
        ]
        found_places = [solution.location(name) for name in squareness]
        places = [(row.value - squareness[row.name]) / row.u for row in found_places]
        found["functions"] = float(np.nanmean(np.abs(ratios) <= 1.96))
        found["squareness"] = float(np.nanmean(np.abs(places) <= 1.96))
        found["worst"] = float(np.nanmax([found["worst"], *np.abs(ratios), *np.abs(places)]))
    return found


def fitted(campaign: Any) -> tuple[volid.Solution, float]:
    """The solution and how long it took [s]."""
    begin = time.perf_counter()
    solution = volid.fit(campaign)
    return solution, time.perf_counter() - begin


def three_axis(layout: str, levels: int | None, seed: int) -> dict[str, Any]:
    """One row of the table: six stations of 400 distances, three tools, every station with one of them."""
    exact, rng = MACHINES[layout], np.random.default_rng(5000 + seed)
    truth = random_truth(exact, rng, waviness=1.2)
    tracker = tracker_campaign(exact, truth, rng, n_per_station=400, n_grid=levels)
    solution, seconds = fitted(distance_campaign(volid_machine(exact), tracker, 5.0, seed))
    tool = tuple(default_tools()[0])
    grid = solution.grid(points=6, tool=tool)
    q = grid.positions[:, [grid.axes.index(a) for a in exact.axes]]
    tools = np.tile(tool, (len(q), 1))
    away = grid.values[:, :3] - exact.deviation(q, tools, truth)[:, :3]
    away, _ = gauge_free(
        away, q, tools, machine=exact
    )  # each station saw one tool: a constant tool rotation is held at 0
    found = judged(solution, exact, truth, default_tools(), True)
    return _row(solution, seconds) | found | {"grid": float(np.mean(np.abs(away) <= 1.96 * grid.u[:, :3]))}


def five_axis(layout: str, levels: int | None, seed: int) -> dict[str, Any]:
    """An R-test on three spheres, linear axes known; `levels` of the tilting axis, twice as many and one of C."""
    exact, rng = exact_machine(LAYOUTS[layout]), np.random.default_rng(7000 + seed)
    truth = rotary_only(random_truth(exact, rng, waviness=0.6))
    n = levels or 25
    letters = [a for a in exact.axes if a in "ABC"]
    counts = {a: 2 * n + 1 if a == "C" else n for a in letters}
    data = r_test(exact, truth, rng, counts=counts, spheres=SPHERES)
    solution, seconds = fitted(r_test_campaign(volid_machine(exact, NO_LINEAR), data))
    ranges = np.array([a.travel for a in solution.machine.axes])
    tools = np.unique(data.tool, axis=0)
    error, u = field(solution, exact, truth, ranges, tools, False)
    functions = [
        (row.value - float(np.ravel(function(np.array([row.position])))[0])) / row.u
        for name, function in truth.functions.items()
        for row in solution.motion(name, np.linspace(*exact.travel[name[2]], PLACES))
        if row.u > 1e-9
    ]
    places = [location_parameter(solution, n) for n in solution.model.names if n[2] == "0" and n[3] in "ABC"]
    locations = [(row.value - truth.constants.get(row.name, 0.0)) / row.u for row in places if np.isfinite(row.value)]
    return _row(solution, seconds) | {
        "functions": float(np.mean(np.abs(functions) <= 1.96)),
        "locations": float(np.mean(np.abs(locations) <= 1.96)),
        "error": 1e3 * float(np.sqrt(np.mean(error**2))),
        "u": 1e3 * float(np.sqrt(np.mean(u**2))),
        "covered": float(np.mean(np.abs(error) <= 1.96 * u)),
        "worst": float(np.max(np.abs(error) / u)),
    }


def _row(solution: volid.Solution, seconds: float) -> dict[str, Any]:
    unseen = solution.unseen
    accepted = not solution.adequacy.rejected and solution.statistics.converged
    return {
        "seconds": seconds,
        "accepted": int(accepted),
        "sound": int(accepted and solution.fully_determined and not unseen),
        "readings": solution.statistics.n_readings,
        "seen": min((e.ratio for e in solution.seen_lengths), default=float("nan")),
        "note": " | ".join(unseen)[:400],
    }


def random_plan(seed: int) -> dict[str, Any]:
    """A random machine and plan: levels five to scattered, parts of travels, one tool or several, truth calm or wavy."""
    rng = np.random.default_rng(90_000 + seed)
    layout = str(rng.choice(list(MACHINES)))
    exact = MACHINES[layout]
    waviness = float(np.exp(rng.uniform(np.log(0.5), np.log(3.0))))
    truth = random_truth(exact, rng, waviness=waviness)
    levels = rng.choice([0, 5, 6, 7, 8, 9, 11, 13, 16, 21, 31])
    n, stations, tools = int(rng.integers(60, 500)), int(rng.integers(4, 9)), int(rng.choice([1, 2, 3, 3, 3, 3]))
    part = {a: (0.0, 1.0) for a in exact.axes}
    for a in exact.axes:
        if rng.random() < 0.3:
            width = rng.uniform(0.5, 0.9)
            low = rng.uniform(0.5 - width, 0.5) if rng.random() < 0.5 else 0.0
            part[a] = (max(low, 0.0), min(max(low, 0.0) + width, 1.0))
    narrow = ExactMachine(
        exact.structure,
        {a: tuple(lo + (hi - lo) * np.array(part[a])) for a, (lo, hi) in exact.travel.items()},
        reference=exact.reference,
    )
    vectors, places = default_tools()[:tools], list(default_stations(exact).values())
    places = [*places, places[0] + [0.0, 300.0, 400.0], places[3] + [-250.0, 0.0, -300.0]][:stations]
    scale = float(rng.choice([1.0, 1.0, 3.0, 10.0]))
    tracker = tracker_campaign(
        narrow, truth, rng, stations=places, tools=vectors, n_per_station=n, n_grid=None if levels == 0 else int(levels),
        u_constant=0.0003 * scale, u_proportional=3e-7 * scale,
        every_station_sees_every_tool=bool(rng.random() < 0.5),
    )  # fmt: skip
    row = {
        "seed": seed,
        "layout": layout,
        "levels": int(levels),
        "waviness": waviness,
        "tools": tools,
        "stations": stations,
    }
    row |= {f"part of {a}": part[a][1] - part[a][0] for a in exact.axes} | {"scale": scale}
    try:
        solution, seconds = fitted(distance_campaign(volid_machine(exact), tracker, 5.0, seed))
    except volid.VolidError as problem:
        return row | {"note": f"refused: {problem}"[:200]}
    gauge = bool(solution.held_tool_rotation) or tools == 1 or not solution.fully_determined
    return (
        row
        | _row(solution, seconds)
        | {"determined": int(solution.fully_determined)}
        | judged(solution, exact, truth, vectors, gauge)
    )


LEVELS = (21, 11, 9, 6)
CASES = {
    **{f"{m}, {n or 'scattered'}": (three_axis, m, n) for m in MACHINES for n in (None, *LEVELS)},
    **{f"R-test {m}, {n}": (five_axis, m, n) for m in ("table C on A", "fork C A") for n in LEVELS},
}


def _case(task: tuple[str, int]) -> dict[str, Any]:
    name, seed = task
    if name == "random":
        return random_plan(seed)
    function, layout, levels = CASES[name]
    return {"case": name, "seed": seed} | function(layout, levels, seed)


def _carry_out(tasks: list[tuple[str, int]], path: Path) -> None:
    """All tasks, two processes; the file is written again and again, so that nothing is lost when the run is cut off."""
    rows: list[dict[str, Any]] = []
    with ProcessPoolExecutor(2) as pool:
        for row in pool.map(_case, tasks, chunksize=4):
            rows.append(row)
            if len(rows) % 20 == 0 or len(rows) == len(tasks):
                names = list(dict.fromkeys(k for r in rows for k in r))
                with path.open("w", newline="") as file:
                    writer = csv.DictWriter(file, names)
                    writer.writeheader()
                    writer.writerows(rows)
                print(f"{len(rows)} of {len(tasks)}", file=sys.stderr, flush=True)


def show(path: Path) -> str:
    """A table of the figures by case."""
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    if rows and "case" not in rows[0]:
        return _confidence(rows)
    lines = [
        "| positions | error / u [µm] | ratio | field | grid | functions | squareness, locations | rejected | n |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for name in dict.fromkeys(r["case"] for r in rows):
        own = [r for r in rows if r["case"] == name]

        def mean(key: str, own: list[dict[str, str]] = own) -> float:
            values = [float(r[key]) for r in own if r.get(key)]
            return float(np.mean(values)) if values else float("nan")

        error, u = (float(np.sqrt(np.mean([float(r[k]) ** 2 for r in own]))) for k in ("error", "u"))
        shares = [mean("covered"), mean("grid"), mean("functions"), np.nanmax([mean("squareness"), mean("locations")])]
        rejected = sum(r["accepted"] == "0" for r in own)
        columns = [
            name,
            f"{error:.3f} / {u:.3f}",
            f"{error / u:.2f}",
            *(f"{v:.3f}" for v in shares),
            rejected,
            len(own),
        ]
        lines.append(f"| {' | '.join(map(str, columns))} |")
    return "\n".join(lines)


def _confidence(rows: list[dict[str, str]]) -> str:
    judged_rows = [r for r in rows if r.get("worst")]
    far = [r for r in judged_rows if float(r["worst"]) > 5.0]
    false = [r for r in far if r["sound"] == "1"]
    lines = [
        f"{len(rows)} machines and plans, {len(rows) - len(judged_rows)} refused, "
        f"{sum(r['sound'] == '1' for r in judged_rows)} sound"
    ]
    lines.append(f"off by more than 5 u: {len(far)}; of these called sound: {len(false)}")
    lines += [
        str({k: r[k] for k in ("seed", "layout", "levels", "waviness", "tools", "worst", "covered", "u")})
        for r in false
    ]
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("table", "confidence", "show"))
    parser.add_argument("file", nargs="?", type=Path, help="CSV file that `show` reads")
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--machines", type=int, default=1000)
    parser.add_argument("--only", default="", help="cases whose name begins so")
    parser.add_argument("-o", "--output", type=Path, default=Path("honesty.csv"))
    options = parser.parse_args()
    if options.what == "show":
        print(show(options.file))
        return
    tasks = [("random", i) for i in range(options.machines)]
    if options.what == "table":
        tasks = [(name, seed) for name in CASES if name.startswith(options.only) for seed in range(options.seeds)]
    _carry_out(tasks, options.output)
    print(show(options.output))


if __name__ == "__main__":
    main()
