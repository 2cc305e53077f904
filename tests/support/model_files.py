"""The rotary machine files of `models/` for tests: the exact chain of each, and its R-test as `volid plan` would make it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from exact_chain import ExactMachine, Truth, apply, random_truth

from support.places import MODELS
from support.rtests import TOOLS, rotary_only
from volid.campaign import Campaign
from volid.io.machines import parse_machine
from volid.model.machine import Machine
from volid.planning.rtest import rtest_static_grid

ROTARY_FILES = sorted(f for f in MODELS.glob("*.toml") if "[axis.A]" in (t := f.read_text()) or "[axis.B]" in t)
LINEAR_KNOWN = '"E?[XYZ]" = false\n"E?0[XYZ]" = false\n'
TURN, TILT = 37, 13  # positions of an axis that makes whole turns, and of one that does not


def machine_of(file: Path | str, more: str = "") -> Machine:
    """The machine of a file, or of one in `models/` by its name; `more` is appended to the text."""
    file = MODELS / f"{file}.toml" if isinstance(file, str) else file
    return parse_machine(file.read_text(encoding="utf-8") + more, file.name)


def resolved_machine(file: Path, functions: str = LINEAR_KNOWN) -> Machine:
    """The machine of a file with resolutions that its positions carry: 12 intervals over a turn, 9 over 13 positions."""
    tilting = "".join(f'"E?{a.letter}" = {{ segments = 9 }}\n' for a in machine_of(file).axes if _tilts(a))
    return machine_of(file, f"\n[model]\nsegments = 12\n[model.functions]\n{functions}{tilting}")


def _tilts(axis) -> bool:
    return not axis.is_linear and not axis.is_full_turn


def r_test_plan(machine: Machine) -> Campaign:
    """37 x 13 positions for three places of the sphere that the planner chooses, all within the travels.

    Under a head three tool vectors 60 and 70 mm beside the spindle: the place of the tool frame is unknown too. Where the travels
    are too short for these (mill-turn), the planner chooses them as well.
    """
    counts = [TILT if _tilts(a) else TURN for a in machine.axes if not a.is_linear]
    plan = rtest_static_grid(machine, None, TOOLS if has_head(machine) else None, *counts)
    return rtest_static_grid(machine, None, None, *counts) if plan.warnings else plan


def stated_at_the_spheres(machine: Machine) -> Machine:
    """The same machine with the `point` of a table beside a head moved along its line to the height of the spheres.

    Swivel head and mill-turn reach a sphere at all angles only 330 and 500 mm above that point: EY0C would hold the tilt's
    uncertainty at that lever, 0.23 µm, and not say how well the table's place is known where it was seen.
    """
    table = machine.axes[0]
    if not has_head(machine) or table.is_linear or not table.primed:
        return machine
    places = np.array(list(r_test_plan(machine).sets[0].options["sphere"].values()))
    along, at = np.asarray(table.unit_vector), np.asarray(table.point)
    x, y, z = (at + along * (along @ (places.mean(axis=0) - at))).tolist()
    return replace(machine, axes=(replace(table, point=(x, y, z), error_point=(x, y, z)), *machine.axes[1:]))


def has_head(machine: Machine) -> bool:
    """Whether a rotary axis carries the tool."""
    return any(not a.is_linear and not a.primed for a in machine.axes)


def readings_of(exact: ExactMachine, plan: Campaign, truth: Truth) -> np.ndarray:
    """Displacements (m, 3) without noise: d = T^-1 sphere - nest origin, the sphere where the plan has it. [mm]."""
    (one,) = plan.sets
    places = np.array([one.options["sphere"][name] for name in one.labels["sphere"]])
    return apply(np.linalg.inv(exact.pose(one.positions, truth)), places) - one.tool


def rotary_truth_of(exact: ExactMachine, seed: int) -> Truth:
    """Random errors of the rotary axes, and of the spindle where a head shows it with several tool vectors."""
    head = any(a in "ABC" and not exact.primed[a] for a in exact.axes)
    return rotary_only(random_truth(exact, np.random.default_rng(seed)), keep="ABCS" if head else "ABC")


def measured(plan: Campaign, readings: np.ndarray, off_by: float = 1.0) -> Campaign:
    """The plan with readings; approximate sphere positions wrong by `off_by` mm."""
    (one,) = plan.sets
    near = {name: [c + off_by for c in place] for name, place in one.options["sphere"].items()}
    options = {k: v for k, v in one.options.items() if k != "u"} | {"sphere": near}
    return replace(plan, sets=(replace(one, readings=readings, options=options),))
