"""Direct measurement on the exact machine, through files: a plan is written, measured by the exact chain, and read again."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from exact_chain import ExactMachine, Truth, random_truth
from exact_chain.instruments import Instruments, Virtual, measure

from support.machines import exact_of
from volid.campaign import Campaign
from volid.fitting.solution import Solution
from volid.io import load_campaign, write_manifest

NEGLIGIBLE = {"mm": 2e-5, "rad": 2e-8}  # u that are smaller are those of a zero, at the reference


@dataclass(frozen=True)
class Measured:
    """A campaign as it was read, and what is true."""

    campaign: Campaign
    exact: ExactMachine
    truth: Truth
    instruments: Instruments


def measured(plan: Campaign, folder: Path, seed: int, *, form: float = 5e-4, **options) -> Measured:
    """The plan measured on a machine with random errors; `options`: of `random_truth`."""
    exact, rng = exact_of(plan.machine), np.random.default_rng(seed)
    truth = random_truth(exact, rng, tool_rotation=False, **options)
    instruments = Instruments(rng, form=form)
    write_manifest(plan, folder)
    return Measured(load_campaign(measure(folder, Virtual(exact, truth, instruments), rng)), exact, truth, instruments)


def with_u(plan: Campaign, factor: float, *names: str) -> Campaign:
    """The plan with the u of its sets, or of those that are named, larger by a factor."""
    sets = []
    for s in plan.sets:
        times = factor if not names or s.name in names else 1.0
        sets.append(replace(s, u=times * s.u, options={**s.options, "u": times * s.options["u"]}))
    return replace(plan, sets=tuple(sets))


def without(campaign: Campaign, *names: str) -> Campaign:
    """The campaign without the sets whose names begin so."""
    return replace(campaign, sets=tuple(s for s in campaign.sets if not s.name.startswith(names)))


def normalised(solution: Solution, truth: Truth) -> dict[str, np.ndarray]:
    """(found - true) / u of every error function along its travel, and of the squareness errors."""
    found: dict[str, list[float]] = {}
    for f in solution.functions(points=11):
        if f.name in truth.constants:
            found[f.name] = [(f.value - truth.constants[f.name]) / f.u]
        elif f.name in truth.functions and f.u > NEGLIGIBLE["rad" if f.name[1] in "ABC" else "mm"]:
            true = float(truth.functions[f.name](np.array([f.position]))[0])
            found.setdefault(f.name, []).append((f.value - true) / f.u)
    return {name: np.array(values) for name, values in found.items()}
