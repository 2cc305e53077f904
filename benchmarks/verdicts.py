"""Is the verdict right, and is the cause named? Simulated campaigns with one mistake each, by the exact chain of the tests.

python -m benchmarks.verdicts causes --seeds 20 -o causes.csv      # every mistake at 1, 3 and 10 u of the field, three machines
python -m benchmarks.verdicts sound --seeds 200 -o sound.csv       # nothing wrong, from 1,200 readings on
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
from typing import Any, NamedTuple

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

import numpy as np
from exact_chain import ExactMachine, Truth, default_tools, random_truth
from exact_chain.tracker import TrackerCampaign, tracker_campaign
from exact_chain.truth import Product
from support.machines import MACHINES, volid_machine
from support.trackers import distance_campaign

import volid
from benchmarks.honesty import field
from volid.campaign import Campaign

SIZES = (1.0, 3.0, 10.0)
PER_STATION = 400
PITCHES = (5.0, 10.0, 20.0)


class Case(NamedTuple):
    """A machine with its truth, what was measured, and the exact places of the target (m, 3) [mm]."""

    exact: ExactMachine
    truth: Truth
    tracker: TrackerCampaign
    points: np.ndarray


class Made(NamedTuple):
    """A campaign as its user has it, and the truth and machine that it is judged by."""

    campaign: Campaign
    truth: Truth
    exact: ExactMachine


def case_of(
    layout: str, seed: int, *, n: int = PER_STATION, scale: float = 1.0, truth_of: Any = None, levels: int | None = None
) -> Case:
    """Six stations of n distances; every station sees every tool, one after another."""
    exact, rng = MACHINES[layout], np.random.default_rng(31_000 + seed)
    truth = random_truth(exact, rng, scale=scale)
    if truth_of is not None:
        truth = truth_of(exact, truth, rng)
    tracker = tracker_campaign(exact, truth, rng, n_per_station=n, every_station_sees_every_tool=True, n_grid=levels)
    return Case(exact, truth, tracker, exact.functional_point(tracker.q, tracker.tool, truth, tracker.direction))


def campaign_of(
    case: Case, distance: np.ndarray | None = None, stated: ExactMachine | None = None, **columns: Any
) -> Made:
    """The campaign with other distances, on another stated machine, with further columns."""
    tracker = case.tracker if distance is None else replace(case.tracker, distance=distance)
    machine = volid_machine(stated or case.exact)
    made = distance_campaign(volid_machine(case.exact), tracker, 5.0, 1)
    own = [case.exact.axes.index(a) for a in machine.letters]
    (s,) = made.sets
    s = replace(s, positions=s.positions[:, own], directions=s.directions[:, own], **columns)
    return Made(replace(made, machine=machine, sets=(s,)), case.truth, case.exact)


def _longer(case: Case, moved: np.ndarray, rows: np.ndarray | None = None) -> np.ndarray:
    """Distances when the target is displaced by `moved` (m, 3) [mm] in the workpiece frame, in some rows."""
    stations = np.array([case.tracker.station_positions[name] for name in case.tracker.station])
    ray = case.points - stations
    change = np.linalg.norm(ray + moved, axis=1) - np.linalg.norm(ray, axis=1)
    return case.tracker.distance + (change if rows is None else np.where(rows, change, 0.0))


def drift(layout: str, seed: int, size: float, **how: Any) -> Made:
    """One station moves on a straight line while it measures."""
    case, rng = case_of(layout, seed, **how), np.random.default_rng(seed)
    name = f"S{1 + seed % 6}"
    rows = case.tracker.station == name
    t = np.zeros(len(rows))
    t[rows] = np.linspace(-0.5, 0.5, int(rows.sum()))
    way = rng.standard_normal(3)
    way /= np.linalg.norm(way)
    return campaign_of(case, _longer(case, -size * np.outer(t, way), rows))


def growth(layout: str, seed: int, size: float, *, by_temperature: bool = False, **how: Any) -> Made:
    """Axes and spindle grow with time, or with a temperature that rises and falls."""
    case = case_of(layout, seed, **how)
    m = len(case.points)
    t = np.linspace(0.0, 1.0, m)
    grown = np.sin(5.0 * t + seed) + 0.3 * t if by_temperature else 1.0 - np.exp(-2.0 * t)
    low, high = (np.array([case.exact.travel[a][k] for a in case.exact.axes]) for k in (0, 1))
    share = (case.tracker.q - low) / (high - low) - 0.5
    moved = np.zeros((m, 3))
    for i, axis in enumerate(case.exact.axes):
        moved[:, "XYZ".index(axis)] = grown * share[:, i] * (1.0, 0.7, 0.4)[i]
    moved[:, 2] += 0.3 * grown
    columns: dict[str, Any] = {"time": 3600.0 * 6.0 * t}
    if by_temperature:
        columns["temperature"] = 20.0 + grown
    return campaign_of(case, _longer(case, size * moved), **columns)


def warmth(layout: str, seed: int, size: float, **how: Any) -> Made:
    """Growth with a recorded temperature."""
    return growth(layout, seed, size, by_temperature=True, **how)


def broken(layout: str, seed: int, size: float, **how: Any) -> Made:
    """A beam is broken inside a segment, and nobody notices."""
    case, rng = case_of(layout, seed, **how), np.random.default_rng(seed)
    tracker = case.tracker
    rows = np.flatnonzero((tracker.station == f"S{1 + seed % 6}") & (tracker.segment == 1 + seed % 3))
    first = rows[int(len(rows) * rng.uniform(0.25, 0.75))]
    later = np.isin(np.arange(len(tracker.distance)), rows) & (np.arange(len(tracker.distance)) >= first)
    return campaign_of(case, tracker.distance + size * later)


CROSSED = {
    "vertical": (("EYX", "Z"), ("EAX", "Y"), ("EZX", "Y"), ("ECY", "Z"), ("EXZ", "Y"), ("EAZ", "X")),
    "gantry": (("EYX", "Z"), ("EAY", "X"), ("EZY", "X"), ("EBX", "Z"), ("EXZ", "X"), ("ECX", "Y")),
    "horizontal": (("EXY", "Z"), ("EAY", "X"), ("EZX", "Y"), ("EBZ", "X"), ("EYZ", "X"), ("ECX", "Z")),
}


def crossed(layout: str, seed: int, size: float, **how: Any) -> Made:
    """A function of one axis changes with another: f(q) g(other)."""
    name, other = CROSSED[layout][seed % 6]

    def with_cross(exact: ExactMachine, truth: Truth, rng: Any) -> Truth:
        found = random_truth(exact, np.random.default_rng(500 + seed), cross={name: other}).cross[name][1]
        cross = {name: (other, Product(found.own.times(100.0 * size), found.across))}
        return Truth(truth.functions, truth.constants, truth.reversal, cross)

    return campaign_of(case_of(layout, seed, truth_of=with_cross, **how))


def tool(layout: str, seed: int, size: float, **how: Any) -> Made:
    """One tool is longer than stated."""
    case = case_of(layout, seed, **how)
    rows = np.all(case.tracker.tool == default_tools()[seed % 3], axis=1)
    longer = case.tracker.tool - size * np.outer(rows, [0.0, 0.0, 1.0])
    actual = case.exact.functional_point(case.tracker.q, longer, case.truth, case.tracker.direction)
    return campaign_of(case, _longer(case, actual - case.points))


def waves(layout: str, seed: int, size: float, **how: Any) -> Made:
    """A positioning function has waves of the screw's pitch, and nobody stated it."""
    axis, pitch = "XYZ"[seed % 3], PITCHES[(seed // 3) % 3]

    def with_waves(exact: ExactMachine, truth: Truth, rng: Any) -> Truth:
        name = f"E{axis}{axis}"
        smooth = truth.functions[name]
        functions = {
            **truth.functions,
            name: lambda q: smooth(q) + size * np.sin(2.0 * np.pi * np.asarray(q) / pitch + seed),
        }
        return Truth(functions, truth.constants, truth.reversal, truth.cross)

    return campaign_of(case_of(layout, seed, truth_of=with_waves, **how))


def reversed_(layout: str, seed: int, size: float, **how: Any) -> Made:
    """An axis has a reversal that the model leaves out."""
    axis = "XYZ"[seed % 3]
    name = (f"E{axis}{axis}", f"EC{axis}" if axis != "Z" else f"EA{axis}")[seed // 3 % 2]

    def with_reversal(exact: ExactMachine, truth: Truth, rng: Any) -> Truth:
        reversal = {name: lambda q: size * (1.0 if name[1] == axis else 2e-3) * np.ones_like(np.asarray(q, float))}
        return Truth(truth.functions, truth.constants, reversal, truth.cross)

    return campaign_of(case_of(layout, seed, truth_of=with_reversal, **how))


OTHER = {
    "order": {"vertical": "w Y' X' b Z (C) t", "gantry": "w b Y X Z (C) t", "horizontal": "w Z' b Y X (C) t"},
    "side": {"vertical": "w Y' b Z X (C) t", "gantry": "w Z' b X Y (C) t", "horizontal": "w b X Y Z (C) t"},
}


def _stated(kind: str, layout: str, seed: int, size: float, **how: Any) -> Made:
    case = case_of(layout, seed, scale=100.0 * size, **how)
    return campaign_of(case, stated=ExactMachine(OTHER[kind][layout], case.exact.travel))


def order(layout: str, seed: int, size: float, **how: Any) -> Made:
    """The machine file has two axes in the other order; the machine's errors are scaled."""
    return _stated("order", layout, seed, size, **how)


def side(layout: str, seed: int, size: float, **how: Any) -> Made:
    """The machine file has an axis on the other side of the bed."""
    return _stated("side", layout, seed, size, **how)


def outlying(layout: str, seed: int, size: float, **how: Any) -> Made:
    """Some readings in a thousand are wrong by up to a hundred times the size."""
    case, rng = case_of(layout, seed, **how), np.random.default_rng(seed)
    m = len(case.points)
    gross = np.zeros(m)
    chosen = rng.choice(m, max(4, m // 400), replace=False)
    gross[chosen] = rng.choice([-1.0, 1.0], len(chosen)) * rng.uniform(20.0, 100.0, len(chosen)) * size
    return campaign_of(case, case.tracker.distance + gross)


def worse(layout: str, seed: int, size: float, **how: Any) -> Made:
    """The instrument is worse than stated by the factor √(1 + (1000 size)²)."""
    case, rng = case_of(layout, seed, **how), np.random.default_rng(seed)
    return campaign_of(
        case, case.tracker.distance + 1e3 * size * case.tracker.u * rng.standard_normal(len(case.points))
    )


def sound(layout: str, seed: int, size: float, **how: Any) -> Made:
    """Nothing is wrong."""
    return campaign_of(case_of(layout, seed, **how))


MISTAKES = {
    "drift of a station": drift,
    "growth with time": growth,
    "growth with temperature": warmth,
    "beam break": broken,
    "cross effect": crossed,
    "tool length": tool,
    "pitch waves": waves,
    "reversal left out": reversed_,
    "order of the axes": order,
    "side of an axis": side,
    "outliers": outlying,
    "u as a whole": worse,
}
CALLED = {
    "order of the axes": "order or side of the axes",
    "side of an axis": "order or side of the axes",
}  # as the verdict has them
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
                with path.open("w", newline="") as file:
                    writer = csv.DictWriter(file, list(rows[0]))
                    writer.writeheader()
                    writer.writerows(rows)
                print(f"{len(rows)} of {len(tasks)}", file=sys.stderr, flush=True)


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
    parser.add_argument("what", choices=("causes", "sound", "show"))
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
