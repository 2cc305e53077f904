"""Is the verdict right, and is the cause named? Simulated campaigns with one mistake each, by the exact chain of the tests.

python -m benchmarks.verdicts causes --seeds 20 -o causes.csv      # every mistake at 1, 3 and 10 u of the field, three machines
python -m benchmarks.verdicts sound --seeds 200 -o sound.csv       # nothing wrong, from 1,200 readings on
python -m benchmarks.verdicts drawn --seeds 3000 -o drawn.csv      # the same by drawing the noise of one fit again and again
python -m benchmarks.verdicts show causes.csv                      # the figures as text

A mistake of c u moves the fitted field by c times the root mean square of its u, rigid motion removed; how large it has to be for
that is found by a pair of fits with the same noise. The truth comes from code apart from the package (`tests/exact_chain`).
"""

from __future__ import annotations

import argparse
import csv
import os
import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

import numpy as np
from exact_chain import ExactMachine, Truth, default_tools
from scipy.special import chdtrc
from support.machines import MACHINES
from support.mistakes import CALLED, MISTAKES, PER_STATION, Made, sound

import volid
from benchmarks.honesty import field
from volid.fitting.assembly import Assembly
from volid.fitting.diagnosis.tally import assess
from volid.fitting.diagnosis.verdict import judge
from volid.fitting.equations.choice import engine_for_fit
from volid.fitting.equations.solver import solve
from volid.fitting.stages import How, Stages

SIZES = (1.0, 3.0, 10.0)
UNIT = 1e-3  # mm, size of a mistake at which its effect is measured; also 1 % of the errors, 100 % of u


def judged(made: Made) -> tuple[volid.Solution, np.ndarray, np.ndarray]:
    """The solution, the error of its field and its u."""
    solution = volid.fit(made.campaign)
    ranges = np.array([a.travel for a in solution.machine.axes])
    own = [made.exact.axes.index(a) for a in solution.machine.letters]
    turned = _Turned(made.exact, own)
    error, u = field(solution, turned, made.truth, ranges, default_tools(), False)
    u = np.hypot(u, np.resize(solution.scatter_u()[:3], u.shape))
    return solution, error, u


class _Turned:
    """The exact machine with the axes in the order of a stated machine that has another one."""

    def __init__(self, exact: ExactMachine, own: list[int]) -> None:
        self.exact, self.back = exact, np.argsort(own)

    def deviation(self, q: np.ndarray, tool: np.ndarray, truth: Truth) -> np.ndarray:
        return self.exact.deviation(q[:, self.back], tool, truth)

    def functional_point(self, q: np.ndarray, tool: np.ndarray) -> np.ndarray:
        return self.exact.functional_point(q[:, self.back], tool)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.exact, name)


def size_of(mistake: str, layout: str, seed: int, wanted: float, **how: Any) -> float:
    """Size of the mistake that moves the field by `wanted` u (RMS)."""
    make = MISTAKES[mistake]
    if mistake == "u as a whole":
        return UNIT * float(np.sqrt(max((1.0 + wanted) ** 2 - 1.0, 0.0)))
    _, before, u = judged(make(layout, seed, 0.01 * UNIT if mistake in OTHER_SCALES else 0.0, **how))
    if mistake in OTHER_SCALES:  # the field itself grows with the size
        size = UNIT
        _, after, _ = judged(make(layout, seed, size, **how))
        return size * wanted / float(np.sqrt(np.mean(after**2) / np.mean(u**2)))
    size = UNIT
    _, after, _ = judged(make(layout, seed, size, **how))
    moved = float(np.sqrt(np.mean((after - before) ** 2) / np.mean(u**2)))
    return size * wanted / moved


OTHER_SCALES = ("order of the axes", "side of an axis")


def row(task: tuple[str, str, int, float, float, dict[str, Any]]) -> dict[str, Any]:
    """One campaign: `task` holds mistake, layout, seed, size in u of the field, size [mm], further options."""
    mistake, layout, seed, wanted, size, how = task
    make = MISTAKES.get(mistake, sound)
    solution, error, u = judged(make(layout, seed, size, **how))
    adequacy = solution.adequacy
    first = adequacy.causes[0] if adequacy.causes else None
    return {
        "mistake": mistake,
        "layout": layout,
        "seed": seed,
        "wanted": wanted,
        "size": size,
        "readings": solution.statistics.n_readings,
        "grade": adequacy.grade,
        "factor": adequacy.factor,
        "unit_weight": adequacy.unit_weight,
        "first": first.cause if first else "",
        "what": first.what if first else "",
        "all": " | ".join(c.cause for c in adequacy.causes),
        "change": first.change if first else 0.0,
        "covered": float(np.mean(np.abs(error) <= 1.96 * u)),
        "error": 1e3 * float(np.sqrt(np.mean(error**2))),
        "u": 1e3 * float(np.sqrt(np.mean(u**2))),
        "scatter": str(dict(solution.scatter)),
        "verdict": adequacy.verdict[:300],
    }


def drawn(task: tuple[str, int, int, int]) -> list[dict[str, Any]]:
    """Verdicts on `trials` draws of the noise around one linearised fit of n readings per station: nothing is wrong.

    The residuals of a draw are those of the linear fit to it; the smoothness stays as it was estimated once.
    """
    layout, n, first, trials = task
    made = sound(layout, 0, 0.0, n=n)
    stages = Stages.begin(made.campaign, None, print_nothing, How(solve, engine_for_fit(made.campaign)))
    fitter = stages.solved()
    assembly = Assembly(fitter, [np.zeros(s.readings.shape, bool) for s in made.campaign.sets])
    assembly.solution((), {"robust": False, "prior": False}, stages.task.starts)
    assert assembly.tests is not None
    seen, fit = assembly.tests
    total, width, n_known = fitter.campaign.n_readings, seen.rows.shape[1], len(fitter.problem.system.prior_value)
    values, vectors = np.linalg.eigh(np.eye(width) - seen.rows.T @ seen.rows)
    told = values > 1e-9
    known = (vectors[:, told] * np.sqrt(values[told])).T  # what is known beforehand, in as few rows as say the same
    rows, leverages = [], np.sum(seen.rows**2, axis=1)
    freedom = total + n_known - width
    for trial in range(first, first + trials):
        rng = np.random.default_rng([n, trial])
        noise, prior = rng.standard_normal(len(seen.v)), rng.standard_normal(len(known))
        step = seen.rows.T @ noise + known.T @ prior
        v = noise - seen.rows @ step
        rest = float(np.sum((prior - known @ step) ** 2)) + float(rng.chisquare(max(n_known - len(known), 1)))
        others = float(rng.chisquare(total - len(v))) if total > len(v) else 0.0
        shapes = [s.readings.shape for s in seen.campaign.sets]
        ends = np.cumsum([int(np.prod(shape)) for shape in shapes])[:-1]
        parts = [p.reshape(shape) for p, shape in zip(np.split(v, ends), shapes, strict=True)]
        levers = [p.reshape(shape) for p, shape in zip(np.split(leverages, ends), shapes, strict=True)]
        used = [np.ones(shape, bool) for shape in shapes]
        tested = assess(seen.campaign, parts, levers, used, freedom, rest)
        chi = float(v @ v) + others + rest
        probability = float(chdtrc(freedom, chi))
        tested = replace(tested, chi_square=chi, unit_weight=float(np.sqrt(chi / freedom)), probability=probability)
        now = replace(seen, v=v, chi_square=chi, freedom=freedom)
        found = judge(now, fit, fitter.problem.model.machine, tested, {})
        first_cause = found.causes[0].cause if found.causes else ""
        rows.append(
            {
                "mistake": "sound", "layout": layout, "seed": trial, "wanted": 0.0, "size": 0.0, "readings": total,
                "grade": found.grade, "factor": found.factor, "unit_weight": found.unit_weight, "first": first_cause,
                "what": "", "all": first_cause, "change": 0.0, "covered": float("nan"), "error": 0.0, "u": 0.0,
                "scatter": "", "verdict": found.verdict[:300],
            }
        )  # fmt: skip
    return rows


def print_nothing(message: str) -> None:
    """No progress."""
    del message


def tasks_of(mistakes: list[str], layouts: list[str], seeds: int, sizes: tuple[float, ...], **how: Any) -> list[Any]:
    """All campaigns; how large a mistake is, is found once for each seed of six."""
    found = []
    pairs = [(m, layout, s) for m in mistakes for layout in layouts for s in range(min(seeds, 6))]
    with ProcessPoolExecutor(2) as pool:
        units = dict(zip(pairs, pool.map(_unit, [(*p, how) for p in pairs]), strict=True))
    for m in mistakes:
        for layout in layouts:
            for s in range(seeds):
                for wanted in sizes:
                    size = wanted * units[m, layout, s % 6] if m != "u as a whole" else size_of(m, layout, s, wanted)
                    found.append((m, layout, s, wanted, size, how))
    return found


def _unit(task: Any) -> float:
    mistake, layout, seed, how = task
    return size_of(mistake, layout, seed, 1.0, **how)


def carry_out(tasks: list[Any], path: Path) -> None:
    """All tasks, two processes; the file is written again and again."""
    rows: list[dict[str, Any]] = []
    with ProcessPoolExecutor(2) as pool:
        for found in pool.map(row, tasks, chunksize=2):
            rows.append(found)
            if len(rows) % 10 == 0 or len(rows) == len(tasks):
                write(path, rows)
                print(f"{len(rows)} of {len(tasks)}", file=sys.stderr, flush=True)


def write(path: Path, rows: list[dict[str, Any]]) -> None:
    """Rows as a CSV file."""
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)


def show(path: Path) -> str:
    """Shares of verdicts and of causes named first, by mistake and size."""
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    lines = [
        "| mistake | size [u] | n | accepted | enlarged | rejected | named first | among the causes | covered | factor |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    keys = list(
        dict.fromkeys((r["mistake"], r["wanted"], r["readings"] if r["mistake"] == "sound" else "") for r in rows)
    )
    grades = ("accepted", "accepted, u enlarged", "rejected")
    for mistake, wanted, readings in keys:
        own = [r for r in rows if (r["mistake"], r["wanted"]) == (mistake, wanted) and readings in ("", r["readings"])]
        called = CALLED.get(mistake, mistake)
        named = [r["first"] == called if mistake != "sound" else r["first"] != "" for r in own]
        kept = [float(r["covered"]) for r in own if r["grade"] != "rejected"]
        columns = [
            f"{mistake}, {readings} readings" if readings else mistake,
            f"{float(wanted):g}",
            str(len(own)),
            *(f"{np.mean([r['grade'] == g for r in own]):.3f}" for g in grades),
            f"{np.mean(named):.2f}",
            f"{np.mean([called in r['all'].split(' | ') for r in own]):.2f}",
            f"{np.mean(kept):.3f}" if kept else "",
            f"{np.median([float(r['factor']) for r in own]):.2f}",
        ]
        lines.append("| " + " | ".join(columns) + " |")
    return "\n".join(lines)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("causes", "sound", "drawn", "show"))
    parser.add_argument("file", nargs="?", type=Path)
    parser.add_argument("--seeds", type=int, default=6)
    parser.add_argument("--only", nargs="*", default=list(MISTAKES))
    parser.add_argument("--layouts", nargs="*", default=list(MACHINES))
    parser.add_argument("--per-station", type=int, nargs="*", default=[PER_STATION])
    parser.add_argument("--sizes", type=float, nargs="*", default=list(SIZES))
    parser.add_argument("--levels", type=int, default=None)
    parser.add_argument("-o", "--output", type=Path, default=Path("verdicts.csv"))
    args = parser.parse_args()
    if args.what == "show":
        print(show(args.file))
        return
    if args.what == "drawn":
        part = 100
        pieces = [
            (layout, n, k, part)
            for n in args.per_station
            for layout in args.layouts
            for k in range(0, args.seeds, part)
        ]
        with ProcessPoolExecutor(2) as pool:
            write(args.output, [r for rows in pool.map(drawn, pieces) for r in rows])
        print(show(args.output))
        return
    how = {"n": args.per_station[0], "levels": args.levels}
    if args.what == "causes":
        tasks = tasks_of(args.only, args.layouts, args.seeds, tuple(args.sizes), **how)
    else:
        tasks = [
            ("sound", layout, s, 0.0, 0.0, {"n": n, "levels": args.levels})
            for n in args.per_station
            for layout in args.layouts
            for s in range(args.seeds)
        ]
    carry_out(tasks, args.output)
    print(show(args.output))


if __name__ == "__main__":
    main()
