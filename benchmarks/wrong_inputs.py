"""Wrong inputs: how many are recognised by their cause, how many only rejected, and whether any is accepted.

    python -m benchmarks.wrong_inputs            # every mistake on every kind and layout, one seed
    python -m benchmarks.wrong_inputs --sound 300  # sound campaigns of all kinds: is any refused or asked about?

Truth and readings come from the exact chain of the tests, which is written apart from the package.
"""

from __future__ import annotations

import argparse
import sys
import warnings
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

import numpy as np
from support.machines import MACHINES
from support.wrong_inputs import (
    MISTAKES,
    ball_bar,
    components,
    distances,
    is_named,
    is_same,
    points,
    sound_campaigns,
    spheres,
)

import volid
from volid.fitting.diagnosis.adequacy import ACCEPTED, ENLARGED, NOT_TESTABLE
from volid.observations.base import with_large_errors

NAMED, REJECTED, NOTED, TAKEN = "named", "only rejected", "accepted, with a note that names it", "accepted"
GOOD = (ACCEPTED, ENLARGED, NOT_TESTABLE)
MAKERS = {"distance": distances, "point": points, "ball bar": ball_bar, "component": components}
LARGEST = 0.03  # mm, of the errors that random truths have


def outcome(mistake, campaign):
    """What becomes of a campaign with a mistake, and what was said."""
    try:
        solution = volid.fit(campaign)
    except volid.VolidError as problem:
        return (NAMED if is_named(mistake, str(problem)) else REJECTED), str(problem)
    adequacy = solution.adequacy
    said = " ".join([adequacy.verdict, *(q.text for q in adequacy.questions), *(c.what for c in adequacy.causes[:1])])
    if adequacy.grade in GOOD:
        warned = " ".join((*campaign.warnings, *solution.notes))
        return (NOTED if is_named(mistake, warned) else TAKEN), said
    return (NAMED if is_named(mistake, said) else REJECTED), said


def wrong_ones(task: tuple[str, int, str]) -> list[tuple[str, str, str, str]]:
    """Mistake, campaign, outcome and what was said, for every mistake that can be made in one campaign."""
    name, seed, only = task
    sound = next(s for s in sound_campaigns(seed) if s.name == name)
    found = []
    for mistake in MISTAKES:
        made = mistake.make(sound.campaign) if only in f"{mistake.name} | {name}" else None
        if made is not None and not is_same(made, sound.campaign):
            found.append((mistake.name, name, *outcome(mistake, made)))
    return found


def wrong(seed: int, only: str, jobs: int) -> None:
    """The table of mistakes."""
    counts: dict[str, Counter] = {m.name: Counter() for m in MISTAKES}
    tasks = [(s.name, seed, only) for s in sound_campaigns(seed)]
    with ProcessPoolExecutor(jobs) as pool:
        for rows in pool.map(wrong_ones, tasks):
            for mistake, name, found, said in rows:
                counts[mistake][found] += 1
                if found != NAMED:
                    print(f"{found:14} {mistake:45} {name:30} {said[:220]}", flush=True)
    columns = (NAMED, REJECTED, NOTED, TAKEN)
    print(f"\n| mistake | tried | {' | '.join(columns)} |\n|---|{'---|' * (len(columns) + 1)}")
    for name, found in counts.items():
        if found:
            print(f"| {name} | {found.total()} | {' | '.join(str(found[c]) for c in columns)} |")


def sound_one(seed: int) -> tuple[str, str]:
    """Grade and words of a sound campaign: u 0.1 µm to 0.1 mm, errors of 1 µm to 10 mm and below 0.4 % of the travel."""
    rng = np.random.default_rng(50_000 + seed)
    kind = ["distance", "point", "ball bar", "component", "displacement"][seed % 5]
    u, layout = float(10.0 ** rng.uniform(-4, -1)), list(MACHINES)[int(rng.integers(3))]
    travel = min(b - a for a, b in MACHINES[layout].travel.values())
    size = min(float(10.0 ** rng.uniform(-3, 1)), 0.004 * travel)  # mm, about the largest error
    if kind == "displacement":
        size = min(size, 1.0)
        structure = ["w C' A' Y' X' b Z t", "w b X Y Z C B t"][int(rng.integers(2))]
        campaign = spheres(structure, seed, u, size / LARGEST)
    else:
        campaign = MAKERS[kind](MACHINES[layout], seed, u, size / LARGEST)
    if kind == "component" and size > 0.2:  # whoever measures such a machine says so
        campaign = with_large_errors(campaign)
    what = f"{kind}, {layout}, seed {seed}, u {u:.2g}, errors {size:.2g} mm"
    try:
        found = volid.fit(campaign).adequacy
    except volid.VolidError as problem:
        return "refused", f"{what}: {str(problem)[:250]}"
    asked = " ".join(q.text for q in found.questions)
    return found.grade, f"{what}: {found.verdict[:250]} {asked[:250]}"


def sound(n: int, first: int, jobs: int) -> None:
    """Sound campaigns: is any refused or asked about?"""
    counts: Counter = Counter()
    with ProcessPoolExecutor(jobs) as pool:
        for grade, what in pool.map(sound_one, range(first, first + n)):
            counts[grade] += 1
            if grade not in GOOD:
                print(f"{grade}: {what}", flush=True)
    print(f"{n} sound campaigns: {dict(counts)}")


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sound", type=int, metavar="N", help="sound campaigns instead of wrong ones")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--only", default="", help="part of a mistake's or campaign's name")
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    if args.sound:
        sound(args.sound, args.seed, args.jobs)
    else:
        wrong(args.seed, args.only, args.jobs)


if __name__ == "__main__":
    main()
