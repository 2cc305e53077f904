"""Does `compare` call unchanged machines changed in 5 % of the cases, and find what it says it finds?

python -m benchmarks.comparison --pairs 100 -o pairs.csv      # every case, pairs of campaigns, each fitted
python -m benchmarks.comparison --checks 40 -o checks.csv     # quick checks by forty distances on as many machines
python -m benchmarks.comparison --show pairs.csv               # the table of either

Every pair is a machine with random errors that are no splines, measured twice by the exact chain of the tests with other
positions and noise, and fitted as users do. Then one function is changed in between by the size that the comparison of the
unchanged pair stated as found with 90 % power. A quick check takes forty distances with one tool from two stations, after
nothing has changed, or one squareness by 10 µm over the travel.
"""

from __future__ import annotations

import argparse
import copy
import csv
import os
import sys
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

import numpy as np
from exact_chain import Truth, default_stations, default_tools, random_truth
from exact_chain.tracker import tracker_campaign
from support.machines import VERTICAL, fixed, volid_machine
from support.trackers import distance_campaign

import volid
from volid.campaign import Effect
from volid.validation.solutions.function_changes import CENTRES, WIDTH

SCALE = 1.0e-6  # u of the tracker's scale, as a ratio
CASES: dict[str, dict[str, Any]] = {
    "scattered": {},
    "7 levels": {"levels": 7},
    "segments stated": {"extra": fixed(4), "waviness": 0.3},
    "scale in common": {"scale": True},
    "part of the travel": {"part": True},
}
CHANGED = ("EC0Y", "EXX", "EYX", "ECX")


def campaign(truth: Truth, seed: int, case: dict[str, Any], second: bool, scale: float) -> volid.Campaign:
    """One survey: six stations of 80 distances, three tools, every station with all of them."""
    rng = np.random.default_rng(seed)
    found = tracker_campaign(
        VERTICAL, truth, rng, n_per_station=80, n_grid=case.get("levels"), every_station_sees_every_tool=True
    )
    found.distance = found.distance * (1.0 + scale)
    kept = np.ones(len(found.q), dtype=bool)
    if case.get("part") and second:
        kept = found.q[:, VERTICAL.axes.index("X")] < 0.8 * VERTICAL.travel["X"][1]
    own = distance_campaign(volid_machine(VERTICAL, case.get("extra", "")), found, 5.0, seed)
    sets = tuple(s.rows_of(np.flatnonzero(kept)) for s in own.sets)
    if case.get("scale"):
        sets = tuple(replace(s, effects=(Effect("tracker scale", "scale", SCALE, "campaign"),)) for s in sets)
    return replace(own, sets=sets)


def changed(truth: Truth, name: str, size: float) -> Truth:
    """The truth with one constant changed, or with a bump over half of the travel in one function."""
    other = copy.deepcopy(truth)
    if name[2] == "0":
        other.constants[name] += size
        return other
    low, high = VERTICAL.travel[name[2]]
    before, centre = other.functions[name], low + CENTRES[1] * (high - low)

    def bumped(q: np.ndarray) -> np.ndarray:
        away = (np.asarray(q, float) - centre) / (WIDTH * (high - low))
        bump = np.where(np.abs(away) < 0.5, 0.5 + 0.5 * np.cos(2 * np.pi * away), 0.0)
        return np.asarray(before(q) + size * bump)

    other.functions[name] = bumped
    return other


def pair(task: tuple[str, int]) -> dict[str, Any]:
    """One row: an unchanged pair, and one with a change of the stated size."""
    name, seed = task
    case, rng = CASES[name], np.random.default_rng(90_000 + seed)
    truth = random_truth(VERTICAL, rng, waviness=case.get("waviness", 0.8))
    scale = SCALE * float(rng.standard_normal()) if case.get("scale") else 0.0
    before = volid.fit(campaign(truth, 2 * seed, case, False, scale))
    after = volid.fit(campaign(truth, 2 * seed + 1, case, True, scale))
    found = volid.compare(before, after)
    tested = [f for f in found.functions if f.degrees_of_freedom]
    row: dict[str, Any] = {"case": name, "seed": seed, "false alarm": int(bool(found.significant))}
    row["pointwise"] = float(np.mean([f.probability < 0.05 for f in tested]))
    row["volume"] = (found.volume.rms / found.volume.expected_rms) ** 2
    which = CHANGED[seed % len(CHANGED)]
    size = next(f.smallest_found for f in found.functions if f.name == which)
    moved = volid.fit(campaign(changed(truth, which, size), 2 * seed + 1, case, True, scale))
    now = volid.compare(before, moved)
    row |= {"changed": which, "size": size, "found": int(which in {f.name for f in now.significant})}
    row["others"] = len([f for f in now.significant if f.name != which])
    return row


CRASH = 0.010  # mm over the travel
CRASHES = {"": 0.0, "EC0Y": CRASH / 430.0, "EA0Z": CRASH / 460.0, "EB0Z": -CRASH / 460.0}


def checks(task: tuple[str, int]) -> list[dict[str, Any]]:
    """Rows of one machine: nothing changed, and each squareness."""
    _, seed = task
    truth = random_truth(VERTICAL, np.random.default_rng(95_000 + seed), waviness=0.8)
    old, rows = volid.fit(campaign(truth, 3 * seed, {}, False, 0.0)), []
    for i, (name, size) in enumerate(CRASHES.items()):
        now = changed(truth, name, size) if name else truth
        stations = dict(list(default_stations(VERTICAL).items())[:2])
        rng = np.random.default_rng(1000 * seed + i)
        few = tracker_campaign(VERTICAL, now, rng, stations=stations, tools=default_tools()[:1], n_per_station=20)
        found = volid.quick_check(old, distance_campaign(volid_machine(VERTICAL), few, 5.0, seed))
        row: dict[str, Any] = {"crash": name or "none", "seed": seed, "changed": int(found.changed)}
        row["named"] = int([f.name for f in found.findings] == [name])
        row["rivals"] = sum(len(f.rivals) for f in found.findings)
        updated = found.updated.location(name or "EC0Y")
        row["ratio"] = (updated.value - now.constants[name or "EC0Y"]) / updated.u
        rows.append(row)
    return rows


def run(tasks: list[tuple[str, int]], output: Path, worker: Callable[[tuple[str, int]], Any]) -> None:
    """All tasks, two processes; written as it goes."""
    begin = time.perf_counter()
    with ProcessPoolExecutor(2) as pool, output.open("w", newline="") as stream:
        writer: csv.DictWriter[str] | None = None
        for found in pool.map(worker, tasks):
            rows = found if isinstance(found, list) else [found]
            if writer is None:
                writer = csv.DictWriter(stream, list(rows[0]))
                writer.writeheader()
            writer.writerows(rows)
            stream.flush()
    print(f"{len(tasks)} tasks in {time.perf_counter() - begin:.0f} s")


def show(path: Path) -> None:
    """Shares per case, with the standard deviation of a share."""
    rows = list(csv.DictReader(path.open()))
    if "crash" in rows[0]:
        show_checks(rows)
        return
    print("| case | pairs | false alarms | single tests below 5 % | mean square change / expected | found |")
    print("|---|---|---|---|---|---|")
    for name in [*CASES, "all"]:
        own = [r for r in rows if name in (r["case"], "all")]
        if not own:
            continue
        alarm, single, volume, found = (
            np.array([float(r[k]) for r in own]) for k in ("false alarm", "pointwise", "volume", "found")
        )
        print(
            f"| {name} | {len(own)} | {100 * alarm.mean():.1f} % | {100 * single.mean():.1f} % | {np.nanmean(volume):.2f} | "
            f"{100 * found.mean():.0f} % |"
        )


def show_checks(rows: list[dict[str, str]]) -> None:
    """Shares per crash."""
    print("| changed by 10 µm | checks | found | named alone | updated value within 2 u |")
    print("|---|---|---|---|---|")
    for name in dict.fromkeys(r["crash"] for r in rows):
        own = [r for r in rows if r["crash"] == name]
        found, named, ratio = (np.array([float(r[k]) for r in own]) for k in ("changed", "named", "ratio"))
        within = np.mean(np.abs(ratio) <= 2.0)
        print(
            f"| {name} | {len(own)} | {100 * found.mean():.1f} % | {100 * named.mean():.1f} % | {100 * within:.0f} % |"
        )


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pairs", type=int, default=20, help="of every case")
    parser.add_argument("--checks", type=int, help="quick checks on so many machines instead")
    parser.add_argument("-o", "--output", type=Path, default=Path("pairs.csv"))
    parser.add_argument("--show", type=Path, help="only the table of a file")
    args = parser.parse_args()
    if args.show is None and args.checks:
        run([("", seed) for seed in range(args.checks)], args.output, checks)
    elif args.show is None:
        apart = [(name, seed + 1000 * i) for seed in range(args.pairs) for i, name in enumerate(CASES)]
        run(apart, args.output, pair)
    show(args.show or args.output)


if __name__ == "__main__":
    main()
