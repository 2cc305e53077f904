"""Solutions made without a fit, and the truth of the exact chain that equals one."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from exact_chain import Truth

from volid.campaign import Campaign, ObservationSet
from volid.fitting.diagnosis.adequacy import Adequacy
from volid.fitting.location_errors import location_parameter
from volid.fitting.results import Residuals, Statistics
from volid.fitting.solution import Solution
from volid.model.error_functions import spline_axes
from volid.model.error_model import build_model
from volid.model.iso230 import parse
from volid.model.machine import Datum, Machine


def made_up(
    machine: Machine, seed: int = 0, scale: float = 1.0, u: float = 0.05, segments: int = 6, datum: Datum | None = None
) -> Solution:
    """A solution with random errors (about 5 µm, 15 µrad, times `scale`) and uncertainties of `u` of that: no fit needed."""
    rng = np.random.default_rng(seed)
    names = [f"E{d}{a}" for d in "XYZABC" for a in machine.letters]
    every = {n: (segments,) * len(spline_axes(machine, n)) for n in names}
    model = build_model(machine, every, datum=datum)
    size = np.empty(model.n_parameters)
    for f in model.functions:
        size[f.parameters] = 15e-6 if parse(f.name).is_rotation else 5e-3
    travel = np.array([a.travel for a in machine.axes])
    ends = ObservationSet(
        "ends",
        "displacement",
        travel.T.copy(),
        np.zeros((2, len(travel))),
        np.zeros((2, 3)),
        np.zeros((2, 3)),
        np.ones((2, 3)),
        {"sphere": np.array(["1", "1"])},
        options={"sensor_on": "tool", "sphere": (0.0, 0.0, 0.0), "nest_u": 0.0, "rotation_u": 0.0, "scale_u": 0.0},
    )
    root = rng.standard_normal((model.n_parameters, model.n_parameters)) / np.sqrt(model.n_parameters)
    half = u * scale * size[:, None] * root
    values = rng.uniform(0.5, 1.5, model.n_parameters) * rng.choice([-1, 1], model.n_parameters)
    return Solution(
        parameters=jnp.asarray(scale * size * values),
        nuisance=jnp.zeros(0),
        covariance=jnp.asarray(half @ half.T),
        null_space=jnp.zeros((model.n_parameters, 0)),
        held_directions=jnp.zeros((sum(n.endswith("0S") for n in model.names), 0)),
        model=model,
        campaign=Campaign(machine, (), (ends,)),
        nuisance_table=(),
        adequacy=Adequacy(0.0, 0, 1.0, 1.0, (), (), False, "model accepted by the data"),
        statistics=Statistics(6, 0, {}, 1, True),
        readings=Residuals((), (), ()),
    )


def truth_of(solution: Solution) -> Truth:
    """What the exact chain must be told to have the same errors: functions sampled from the tables, and constants."""
    theta = np.asarray(solution.parameters)

    def function(name: str):
        return lambda q: (solution.motion_rows(name, np.ravel(q), 0) @ theta).reshape(np.shape(q))

    constants = {n: location_parameter(solution, n).value for n in solution.model.names if parse(n).location}
    return Truth({n: function(n) for n in solution.model.names if not parse(n).location}, constants)
