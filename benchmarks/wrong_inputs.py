"""Wrong inputs: how many are recognised by their cause, how many only rejected, and whether any is accepted.

    python benchmarks/wrong_inputs.py            # every mistake on every kind and layout, one seed
    python benchmarks/wrong_inputs.py --sound 300  # sound campaigns of all kinds: is any refused or asked about?

Truth and readings come from the exact chain of the tests, which is written apart from the package.
"""

from __future__ import annotations

import argparse
import sys
import warnings
from collections import Counter
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

NAMED, REJECTED, TAKEN, HARMLESS = "named", "only rejected", "ACCEPTED", "harmless"


def outcome(mistake, campaign):
    """What becomes of a campaign with a mistake, and what was said."""
    try:
        solution = volid.fit(campaign)
    except volid.VolidError as problem:
        return (NAMED if is_named(mistake, str(problem)) else REJECTED), str(problem)
    adequacy = solution.adequacy
    said = " ".join([adequacy.verdict, *(q.text for q in adequacy.questions), *(c.what for c in adequacy.causes[:1])])
    if adequacy.grade in (ACCEPTED, ENLARGED, NOT_TESTABLE):
        warned = " ".join((*campaign.warnings, *solution.notes))
        return (TAKEN if not is_named(mistake, warned) else "accepted, with a note that names it"), said
    return (NAMED if is_named(mistake, said) else REJECTED), said


def wrong(seed: int, only: str) -> None:
    """The table of mistakes."""
    counts: dict[str, Counter] = {m.name: Counter() for m in MISTAKES}
    for sound in sound_campaigns(seed):
        for mistake in MISTAKES:
            if only and only not in f"{mistake.name} | {sound.name}":
                continue
            made = mistake.make(sound.campaign)
            if made is None or is_same(made, sound.campaign):
                continue
            found, said = outcome(mistake, made)
            counts[mistake.name][found] += 1
            if found != NAMED:
                print(f"{found:14} {mistake.name:45} {sound.name:30} {said[:220]}", flush=True)
    print(
        "\n| mistake | tried | named | only rejected | accepted, with a note that names it | accepted |\n|---|---|---|---|---|---|"
    )
    for name, found in counts.items():
        if found:
            print(
                f"| {name} | {found.total()} | {found[NAMED]} | {found[REJECTED]} | "
                f"{found['accepted, with a note that names it']} | {found[TAKEN]} |"
            )


def sound(n: int, first: int) -> None:
    """Sound campaigns: u 0.1 µm to 0.1 mm, errors of 1 µm to 10 mm and below 1 % of the travel."""
    makers = {"distance": distances, "point": points, "ball bar": ball_bar, "component": components}
    counts: Counter = Counter()
    for seed in range(first, first + n):
        rng = np.random.default_rng(50_000 + seed)
        kind = ["distance", "point", "ball bar", "component", "displacement"][seed % 5]
        u = float(10.0 ** rng.uniform(-4, -1))
        layout = list(MACHINES)[int(rng.integers(3))]
        size = float(10.0 ** rng.uniform(-3, 1))  # mm, about the largest error
        travel = min(b - a for a, b in MACHINES[layout].travel.values())
        size = min(size, 0.004 * travel)
        if kind == "displacement":
            size = min(size, 1.0)
            campaign = spheres(["w C' A' Y' X' b Z t", "w b X Y Z C B t"][int(rng.integers(2))], seed, u, size / 0.03)
        else:
            campaign = makers[kind](MACHINES[layout], seed, u, size / 0.03)
        if kind == "component" and size > 0.2:  # whoever measures such a machine says so
            campaign = volid.fitting.stages.with_large_errors(campaign)
        try:
            found = volid.fit(campaign)
            grade = found.adequacy.grade
            if grade not in (ACCEPTED, ENLARGED, NOT_TESTABLE):
                print(
                    f"{grade}: {kind}, {layout}, seed {seed}, u {u:.2g}, errors {size:.2g} mm: {found.adequacy.verdict[:250]}",
                    flush=True,
                )
        except volid.VolidError as problem:
            grade = "refused"
            print(
                f"refused: {kind}, {layout}, seed {seed}, u {u:.2g}, errors {size:.2g} mm: {str(problem)[:250]}",
                flush=True,
            )
        counts[grade] += 1
        if seed % 20 == 19:
            print(dict(counts), flush=True)
    print(f"{n} sound campaigns: {dict(counts)}")


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sound", type=int, metavar="N", help="sound campaigns instead of wrong ones")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="", help="part of a mistake's or campaign's name")
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    if args.sound:
        import volid.fitting.stages  # noqa: F401

        sound(args.sound, args.seed)
    else:
        wrong(args.seed, args.only)


if __name__ == "__main__":
    main()
