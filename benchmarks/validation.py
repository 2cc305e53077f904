"""Does a right solution pass its validation in 95 %, and what is found when something is wrong? By the exact chain of the tests.

python -m benchmarks.validation --seeds 500 -o validation.csv     # every seed: a fit and a right campaign; 30 of them with faults
python -m benchmarks.validation show validation.csv               # the figures as text

A small machine is fitted from six stations of 100 distances and validated by three other stations of 40, each with two
other tools. Truth and readings come from code apart from the package (`tests/exact_chain`). A fault of the smallest size that is
said to be found with 90 % is put into the truth of the second campaign, and others of stated size.
"""

from __future__ import annotations

import argparse
import csv
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

import numpy as np
from exact_chain import Truth, random_truth
from exact_chain.tracker import tracker_campaign
from support.machines import MACHINES, volid_machine
from support.trackers import distance_campaign
from support.validations import OTHER_TOOLS, changed, other_stations

import volid

FIT, TEST = 100, 40  # distances of each station
# fault: sizes [mm, rad, mm/mm; factor for a sign]
FAULTS: dict[str, tuple[float, ...]] = {
    "squareness": (2e-6, 5e-6, 10e-6),
    "scale": (2e-6, 5e-6),
    "cross effect": (0.001, 0.002, 0.005),
    "sign": (1.0,),
    "tool length": (0.001, 0.002, 0.005),
    "bump": (0.002, 0.005, 0.010),
}
STALE = (5e-6, 10e-6)  # rad of squareness, since the machine was compensated
NAMES = {"squareness": "EC0Y", "scale": "scale of X", "bump": "bump in EYY, wherever it is"}  # in `Validation.smallest`
EXACT = MACHINES["vertical"]
Drive = Callable[[np.ndarray], np.ndarray]


def measured(
    truth: Truth, rng: np.random.Generator, seed: int, tools: np.ndarray = OTHER_TOOLS, drive: Drive | None = None
) -> volid.Campaign:
    """The second campaign: other stations, other positions, each station with both tools.

    `drive`: positions to which a control moves instead of those programmed.
    """
    tracker = tracker_campaign(
        EXACT,
        truth,
        rng,
        stations=other_stations(EXACT),
        tools=tools,
        n_per_station=TEST,
        every_station_sees_every_tool=True,
    )
    if drive is not None:
        places = np.array([tracker.station_positions[s] for s in tracker.station])
        there, here = (
            np.linalg.norm(EXACT.functional_point(q, tracker.tool, truth, None) - places, axis=1)
            for q in (drive(tracker.q), tracker.q)
        )
        tracker = replace(tracker, distance=tracker.distance + there - here)
    return distance_campaign(volid_machine(EXACT), tracker, 5.0, seed + 1)


class Case:
    """A machine, its solution, and what happens to it."""

    def __init__(self, seed: int) -> None:
        self.seed, self.rng = seed, np.random.default_rng(31_000 + seed)
        self.truth = random_truth(EXACT, self.rng)
        first = tracker_campaign(EXACT, self.truth, self.rng, n_per_station=FIT, every_station_sees_every_tool=True)
        self.solution = volid.fit(distance_campaign(volid_machine(EXACT), first, 5.0, seed))

    def row(self, fault: str, size: float, campaign: volid.Campaign, control: Any = None) -> dict[str, Any]:
        """One validation."""
        found = volid.validate(self.solution, campaign, control=control)
        self.last = found
        return {
            "seed": self.seed,
            "fault": fault,
            "size": size,
            "confirmed": int(found.confirmed),
            "probability": found.probability,
            "above 1": found.e_n_above_1,
            "cause": found.causes[0].cause if found.causes else "",
        }

    def faulty(self, fault: str, size: float) -> volid.Campaign:
        """The second campaign with a fault."""
        rng = np.random.default_rng(77_000 + self.seed)
        if fault != "tool length":
            return measured(changed(EXACT, self.truth, fault, size), rng, self.seed)
        longer = OTHER_TOOLS + np.array([[0.0, 0.0, -size], [0.0, 0.0, 0.0]])
        campaign = measured(self.truth, rng, self.seed, longer)
        readings = campaign.sets[0]  # as its user states it
        which = np.argmin(np.linalg.norm(readings.tool[:, None] - longer, axis=2), axis=1)
        return replace(campaign, sets=(replace(readings, tool=OTHER_TOOLS[which]),))

    def compensated(self) -> Iterator[dict[str, Any]]:
        """The machine with positioning tables: as it should be, with one of the wrong sign, one that does not act, and stale."""
        base = volid.compensation_base(self.solution, (0.0, 0.0, -150.0))
        tables = tuple(
            t for t in volid.compensate(self.solution, ["L-POS"], base, points=21).tables if t.function[1] == t.axis
        )
        control = volid.Control(volid_machine(EXACT), tables)
        cases = {"none, compensated": {}, "sign of table EXX": {"X": -1.0}, "table EYY does not act": {"Y": 0.0}}
        for name, signs in cases.items():
            rng = np.random.default_rng(78_000 + self.seed)
            campaign = measured(self.truth, rng, self.seed, drive=partial(driven, tables, signs))
            yield self.row(name, 0.0, campaign, control)
        for size in STALE:
            rng, since = np.random.default_rng(79_000 + self.seed), changed(EXACT, self.truth, "squareness", size)
            campaign = measured(since, rng, self.seed, drive=partial(driven, tables, {}))
            yield self.row("stale compensation", size, campaign, control)


def driven(tables: Sequence[volid.ErrorTable], signs: dict[str, float], q: np.ndarray) -> np.ndarray:
    """Where a control with positioning tables drives: q - E(q), by linear interpolation."""
    moved = q.copy()
    for t in tables:
        i = EXACT.column(t.axis)
        moved[:, i] -= signs.get(t.axis, 1.0) * np.interp(q[:, i], t.positions, t.forward)
    return moved


def one(task: tuple[int, bool]) -> list[dict[str, Any]]:
    """All rows of one seed; the second number says whether with faults."""
    seed, with_faults = task
    case = Case(seed)
    rows = [case.row("none", 0.0, measured(case.truth, case.rng, seed))]
    rows[0] |= {"accepted": int(not case.solution.adequacy.rejected), "factor": case.solution.factor}
    smallest = {s.name.split(" (")[0]: s.value for s in case.last.smallest}
    if not with_faults:
        return rows
    for fault, sizes in FAULTS.items():
        rows += [case.row(fault, size, case.faulty(fault, size)) for size in sizes]
        if fault in NAMES:
            stated = smallest[NAMES[fault]]
            rows.append(case.row(f"{fault}, as stated", stated, case.faulty(fault, stated)))
    return [*rows, *case.compensated()]


def show(path: Path) -> str:
    """Shares by fault and size."""
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    lines = ["| fault | size | n | confirmed | first cause named |", "|---|---|---|---|---|"]
    for key in dict.fromkeys((r["fault"], r["size"] if "stated" not in r["fault"] else "") for r in rows):
        own = [r for r in rows if r["fault"] == key[0] and (not key[1] or r["size"] == key[1])]
        size = float(np.mean([float(r["size"]) for r in own]))
        confirmed = float(np.mean([int(r["confirmed"]) for r in own]))
        found = [r["cause"] or "none" for r in own if r["confirmed"] == "0"]
        names = sorted(set(found), key=lambda c: -found.count(c))[:3]
        causes = ", ".join(f"{c} {found.count(c) / max(len(found), 1):.2f}" for c in names)
        lines.append(f"| {key[0]} | {size:.3g} | {len(own)} | {confirmed:.3f} | {causes} |")
    right = [float(r["above 1"]) for r in rows if r["fault"] == "none"]
    return "\n".join([*lines, f"E_n > 1 with nothing wrong: {100 * np.mean(right):.2f} % of the readings"])


def main() -> None:
    """Run or show."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", nargs="?", default="run")
    parser.add_argument("file", nargs="?", type=Path)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--faults", type=int, default=30, help="seeds that have faults too")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("-o", "--output", type=Path)
    args = parser.parse_args()
    if args.what == "show":
        print(show(args.file))
        return
    rows: list[dict[str, Any]] = []
    with ProcessPoolExecutor(args.jobs) as pool:
        for i, found in enumerate(pool.map(one, [(seed, seed < args.faults) for seed in range(args.seeds)])):
            rows += found
            if i % 10 == 9 or i == args.seeds - 1:
                _write(args.output, rows)
    print(show(args.output))


def _write(path: Path, rows: list[dict[str, Any]]) -> None:
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, list(dict.fromkeys(k for r in rows for k in r)))
        writer.writeheader()
        writer.writerows(rows)


if __name__ == "__main__":
    main()
