"""Small campaigns on the independent virtual machine as files, and their solutions."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from exact_chain import (
    ExactMachine,
    TrackerCampaign,
    Truth,
    machine_toml,
    random_truth,
    tracker_campaign,
    write_campaign,
)

from volid.fitting.fit import fit
from volid.fitting.solution import Solution
from volid.io import load_campaign
from volid.io.basics.provenance import provenance

TRAVEL = {"X": (0.0, 1000.0), "Y": (0.0, 600.0), "Z": (-500.0, 0.0)}
SINGLE_TOOL = (0.0, 0.0, -150.0)
# fixtures of tests/conftest.py, one for each state that a solution can be in
SOLUTIONS = (
    "solution",
    "single_tool_solution",
    "rejected_solution",
    "outlier_solution",
    "rich_solution",
    "rotary_solution",
)
COARSE = "[model]\nsegments = 2\n"
RICH = """[model]
segments = 2
[model.functions]
EXX = { reversal = "constant" }
EYY = { reversal = true }
EZZ = { over = ["Z", "X"], segments = [2, 1] }
"""
ONLY_C = """[model]
segments = 8
[model.functions]
"E*[XYZS]" = false
"""
LEVELS = """
[[set]]
name = "levels"
kind = "component"
file = "levels.csv"
tool = [0.0, 0.0, -150.0]
u = 1.0e-6
"""


@dataclass(frozen=True)
class Virtual:
    """A campaign on the independent virtual machine: its manifest, and everything that is true about it."""

    manifest: Path
    machine: ExactMachine
    truth: Truth
    campaign: TrackerCampaign


def make_campaign(
    folder: Path, *, model: str = COARSE, waviness: float = 0.3, reversal=False, levels: bool = False, **options
) -> Virtual:
    """Write a small campaign of six stations on a cross-table vertical machine; `options` for `tracker_campaign`."""
    machine, rng = ExactMachine("w Y' X' b Z (C) t", TRAVEL), np.random.default_rng(5)
    truth = random_truth(machine, rng, waviness=waviness, scale=0.3, reversal=reversal)
    options = {"n_per_station": 60, "every_station_sees_every_tool": True} | options
    campaign = tracker_campaign(machine, truth, rng, **options)
    text = machine_toml(machine, name="Testmaschine Ω", extra=model)
    manifest = write_campaign(folder, campaign, text, "Abnahme 2026", approximate_error=5.0, rng=rng)
    if levels:
        _add_levels(manifest, machine, truth, rng)
    return Virtual(manifest, machine, truth, campaign)


def _add_levels(manifest: Path, machine: ExactMachine, truth: Truth, rng: np.random.Generator) -> None:
    """A level on the table: roll of X at eleven positions, forward and backward."""
    x = np.concatenate([np.linspace(0.0, 1000.0, 11), np.linspace(1000.0, 0.0, 11)])
    q = machine.in_axis_order({"X": x, "Y": 300.0, "Z": -250.0})
    roll = machine.deviation(q, SINGLE_TOOL, truth)[:, 3] + 1e-6 * rng.standard_normal(len(x))
    lines = [f"{a!r},300.0,-250.0,A,{v!r}" for a, v in zip(x.tolist(), roll.tolist(), strict=True)]
    (manifest.parent / "levels.csv").write_text("\n".join(["X,Y,Z,component,value", *lines]) + "\n")
    manifest.write_text(manifest.read_text(encoding="utf-8") + LEVELS, encoding="utf-8")


def fitted(virtual: Virtual, **options) -> Solution:
    """The solution of a virtual campaign, with provenance as `volid fit` records it."""
    record = provenance([virtual.manifest], ["volid", "fit"], options)
    return replace(fit(load_campaign(virtual.manifest), **options), provenance=record)
