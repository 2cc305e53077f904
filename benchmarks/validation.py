"""Does a right solution pass its validation in 95 %, and what is found when something is wrong? By the exact chain of the tests.

python -m benchmarks.validation --seeds 500 -o validation.csv     # every seed: a fit, a right campaign, and one for each fault
python -m benchmarks.validation show validation.csv               # the figures as text

A small machine is fitted from six stations of 48 distances and validated by three other stations of 40, each with two other
tools. Truth and readings come from code apart from the package (`tests/exact_chain`). A fault of the smallest size that is said to
be found with 90 % is put into the truth of the second campaign, and others of stated size.
"""

from __future__ import annotations

import argparse
import copy
import csv
import os
import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

import numpy as np
from exact_chain import ExactMachine, Truth, default_tools, random_truth
from exact_chain.tracker import tracker_campaign
from support.machines import MACHINES, volid_machine
from support.trackers import distance_campaign
from support.validations import OTHER_TOOLS, changed, other_stations

import volid

FIT, TEST = 48, 40  # distances of each station
LAYOUT = "vertical"
# fault: sizes [mm, rad, mm/mm; factor for a sign]
FAULTS: dict[str, tuple[float, ...]] = {
    "squareness": (2e-6, 5e-6, 10e-6),
    "scale": (2e-6, 5e-6),
    "cross effect": (0.001, 0.002, 0.005),
    "sign": (1.0,),
    "tool length": (0.001, 0.002, 0.005, 0.010),
    "bump": (0.002, 0.005, 0.010),
}


def measured(exact: ExactMachine, truth: Truth, rng: np.random.Generator, seed: int, tools: Any = None) -> volid.Campaign:
    """The second campaign: other stations, other positions, each station with both tools."""
    tracker = tracker_campaign(
        exact,
        truth,
        rng,
        stations=other_stations(exact),
        tools=OTHER_TOOLS if tools is None else tools,
        n_per_station=TEST,
        every_station_sees_every_tool=True,
    )
    return distance_campaign(volid_machine(exact), tracker, 5.0, seed + 1)


def one(seed: int) -> list[dict[str, Any]]:
    """All rows of one seed."""
    exact, rng = MACHINES[LAYOUT], np.random.default_rng(31_000 + seed)
    truth = random_truth(exact, rng)
    first = tracker_campaign(exact, truth, rng, n_per_station=FIT, every_station_sees_every_tool=True)
    solution = volid.fit(distance_campaign(volid_machine(exact), first, 5.0, seed))
    right = volid.validate(solution, measured(exact, truth, rng, seed))
    rows = [_row(seed, "none", 0.0, right) | {"accepted": int(not solution.adequacy.rejected), "factor": solution.factor}]
    smallest = {s.name: s.value for s in right.smallest}
    names = {"squareness": "EC0Y", "scale": "scale of X", "bump": "bump in EYY, wherever it is"}
    stated = {fault: smallest[name] for fault, name in names.items()}
    for fault, sizes in FAULTS.items():
        for size in sizes:
            rows.append(_row(seed, fault, size, _faulty(exact, truth, fault, size, seed, solution)))
        if fault in stated:
            found = _faulty(exact, truth, fault, stated[fault], seed, solution)
            rows.append(_row(seed, f"{fault}, as stated", stated[fault], found))
    return rows


def _faulty(
    exact: ExactMachine, truth: Truth, fault: str, size: float, seed: int, solution: volid.Solution
) -> volid.Validation:
    rng = np.random.default_rng(77_000 + seed)
    if fault != "tool length":
        return volid.validate(solution, measured(exact, changed(exact, truth, fault, size), rng, seed))
    longer = OTHER_TOOLS + np.array([[0.0, 0.0, -size], [0.0, 0.0, 0.0]])
    campaign = measured(exact, truth, rng, seed, longer)
    return volid.validate(solution, with_tools(campaign, longer, OTHER_TOOLS))


def with_tools(campaign: volid.Campaign, true: np.ndarray, stated: np.ndarray) -> volid.Campaign:
    """The campaign as its user states it: with the tool vectors that he believes in."""
    found = copy.copy(campaign.sets[0])
    which = np.argmin(np.linalg.norm(found.tool[:, None] - true, axis=2), axis=1)
    object.__setattr__(found, "tool", stated[which])
    changed_ = copy.copy(campaign)
    object.__setattr__(changed_, "sets", (found,))
    return changed_


def _row(seed: int, fault: str, size: float, found: volid.Validation) -> dict[str, Any]:
    return {
        "seed": seed,
        "fault": fault,
        "size": size,
        "confirmed": int(found.confirmed),
        "probability": found.probability,
        "above 1": found.e_n_above_1,
        "cause": found.causes[0].cause if found.causes else "",
    }


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
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("-o", "--output", type=Path)
    args = parser.parse_args()
    if args.what == "show":
        print(show(args.file))
        return
    rows: list[dict[str, Any]] = []
    with ProcessPoolExecutor(args.jobs) as pool:
        for i, found in enumerate(pool.map(one, range(args.seeds))):
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
