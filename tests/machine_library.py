"""The rotary machine files of `models/` for tests: the exact chain of each, and its R-test as `volid plan` would make it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import jax.numpy as jnp
import numpy as np
from exact_chain import ExactMachine, Truth, apply, random_truth
from five_axis import TOOLS, rotary_only

from volid.campaign import Campaign
from volid.fitting.diagnosis.adequacy import Adequacy
from volid.fitting.diagnosis.identifiability import analyse
from volid.fitting.equations.problem import build_problem
from volid.fitting.prior import prior_of
from volid.fitting.solution import Residuals, Solution, Statistics
from volid.fitting.starts import find_starts
from volid.io.machines import parse_machine
from volid.model.error_functions import motion_names, settings_for
from volid.model.error_model import build_model
from volid.model.machine import Machine
from volid.planning.rtest import rtest_static_grid

MODELS = Path(__file__).parents[1] / "models"
ROTARY_FILES = sorted(f for f in MODELS.glob("*.toml") if "[axis.A]" in (t := f.read_text()) or "[axis.B]" in t)
LINEAR_KNOWN = '"E?[XYZ]" = false\n"E?0[XYZ]" = false\n'
TURN, TILT = 37, 13  # positions of an axis that makes whole turns, and of one that does not


def machine_of(file: Path, functions: str = LINEAR_KNOWN) -> Machine:
    """The machine of a file with resolutions that its positions carry: 12 intervals over a turn, 9 over 13 positions."""
    machine = parse_machine(file.read_text(), file.name)
    tilting = "".join(f'"E?{a.letter}" = {{ segments = 9 }}\n' for a in machine.axes if _tilts(a))
    return parse_machine(
        f"{file.read_text()}\n[model]\nsegments = 12\n[model.functions]\n{functions}{tilting}", file.name
    )


def _tilts(axis) -> bool:
    return not axis.is_linear and not axis.is_full_turn


def exact_of(machine: Machine) -> ExactMachine:
    """The same chain in plain matrices, from the numbers of the file."""
    rotary = [a for a in machine.axes if not a.is_linear]
    return ExactMachine(
        machine.structure,
        {a.letter: a.travel for a in machine.axes},
        point={a.letter: a.point for a in rotary},
        direction={a.letter: a.direction for a in rotary},
        axis_frame=[a.letter for a in rotary if a.axis_frame],
    )


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


def truth_of(exact: ExactMachine, seed: int) -> Truth:
    """Random errors of the rotary axes, and of the spindle where a head shows it with several tool vectors."""
    head = any(a in "ABC" and not exact.primed[a] for a in exact.axes)
    return rotary_only(random_truth(exact, np.random.default_rng(seed)), keep="ABCS" if head else "ABC")


def measured(plan: Campaign, readings: np.ndarray, off_by: float = 1.0) -> Campaign:
    """The plan with readings; approximate sphere positions wrong by `off_by` mm."""
    (one,) = plan.sets
    near = {name: [c + off_by for c in place] for name, place in one.options["sphere"].items()}
    options = {k: v for k, v in one.options.items() if k != "u"} | {"sphere": near}
    return replace(plan, sets=(replace(one, readings=readings, options=options),))


def quick_fit(campaign: Campaign, steps: int = 3, prior: Solution | None = None) -> Solution:
    """Gauss-Newton with the fit's own model, rank decision and normal equations, one program for each machine.

    `steps` 0: the nominal machine, parameters 0, which tells what a campaign determines and how well. The solver, leverages and
    hold-out of `fit` would each compile another program; test_five_axis_recovery runs it whole.
    """
    machine = campaign.machine
    given = {n: settings_for(machine, n).segments for n in motion_names(machine)}
    segments = {n: s if isinstance(s, tuple) else (int(s),) for n, s in given.items()}
    model = build_model(machine, segments)
    known = None if prior is None else prior_of(prior, model)
    problem = build_problem(campaign, model, find_starts(campaign), known)
    found = analyse(problem, campaign)
    free, z, x = problem.free @ found.basis, problem.start, np.zeros(found.basis.shape[1])
    for step in range(steps + 1):
        at = problem.equations.normal(problem.start + free @ x)
        normal = free.T @ np.asarray(at.matrix) @ free
        scale = 1.0 / np.sqrt(np.diagonal(normal))
        half = np.linalg.solve(np.linalg.cholesky(normal * np.outer(scale, scale)), np.diag(scale)).T
        if step < steps:
            x = x - half @ (half.T @ (free.T @ np.asarray(at.gradient)))
    z, half = problem.start + free @ x, found.basis @ half
    n, coefficients = problem.model.n_parameters, problem.model.layout.n_coefficients
    fixed = np.array([e.prior_u == 0.0 for e in problem.nuisance], dtype=bool)
    root = np.zeros((n + len(fixed), half.shape[1]))
    root[np.flatnonzero(np.concatenate([np.ones(n, dtype=bool), ~fixed]))] = half
    return Solution(
        parameters=jnp.asarray(np.linalg.lstsq(problem.model.parametrisation, z[:coefficients], rcond=None)[0]),
        nuisance=jnp.asarray(z[coefficients:]),
        covariance=jnp.asarray(root @ root.T),
        null_space=jnp.asarray(found.null_space),
        held_directions=jnp.asarray(found.tool_rotation),
        model=problem.model,
        campaign=campaign,
        nuisance_table=problem.nuisance,
        adequacy=Adequacy(
            2.0 * float(at.cost), campaign.n_readings - free.shape[1], 1.0, 1.0, (), (), False, "not judged"
        ),
        statistics=Statistics(campaign.n_readings, free.shape[1], {}, 0, True),
        readings=Residuals((), (), ()),
        statements=found.statements,
        undetermined=found.undetermined,
    )
