"""A fit in a few Gauss-Newton steps, with one compiled program for each machine."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np

from volid.campaign import Campaign
from volid.fitting.diagnosis.adequacy import Adequacy
from volid.fitting.diagnosis.identifiability import analyse
from volid.fitting.equations.problem import build_problem
from volid.fitting.prior import prior_of
from volid.fitting.results import Residuals, Statistics
from volid.fitting.solution import Solution
from volid.fitting.starts import find_starts
from volid.model.error_functions import motion_names, settings_for
from volid.model.error_model import build_model


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
