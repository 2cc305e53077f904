"""The geometric Jacobian against automatic differentiation of the deviation, on every machine of `models/`."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.places import MODELS

from volid import load_machine
from volid.model.jacobian import deviation_partials
from volid.model.kinematics import ROWS, deviation

FILES = sorted(MODELS.glob("*.toml"))
POINTS = 7


def case(file, seed=0):
    """Machine, positions, tools and errors of 1 mm and 10 mrad: so large that terms of second order show."""
    machine, rng = load_machine(file), np.random.default_rng(seed)
    low, high = np.array([a.travel for a in machine.axes]).T
    q = (low + (high - low) * rng.random((POINTS, len(low)))).T
    errors = (
        rng.standard_normal((ROWS * (len(low) + 1), POINTS)) * np.repeat(np.tile([1.0, 0.01], len(low) + 1), 3)[:, None]
    )
    return machine, q, rng.uniform(-300.0, 300.0, (3, POINTS)), errors


@pytest.mark.parametrize("file", FILES, ids=lambda f: f.stem)
def test_partials_are_those_of_automatic_differentiation(file):
    machine, q, tool, errors = case(file)

    def at(q, tool, e):
        return deviation(machine, q[:, None], tuple(tool[:, None]), e[:, None])[:, 0]

    expected = jax.vmap(jax.jacfwd(at, argnums=2), in_axes=1, out_axes=2)(*map(jnp.asarray, (q, tool, errors)))
    scale = np.abs(expected).max(axis=(1, 2), keepdims=True)
    for space in (np.asarray, jnp.asarray):
        rows = deviation_partials(machine, space(q), tuple(space(tool)), space(errors))
        found = np.array([[np.broadcast_to(p, (POINTS,)) for p in row] for row in rows])
        np.testing.assert_allclose(found / scale, expected / scale, atol=1e-13)


def test_translations_turn_nothing():
    machine, q, tool, errors = case(FILES[0])
    rows = deviation_partials(machine, q, tuple(tool), errors)
    translations = [r for r in range(len(rows[3])) if r % ROWS < 3]
    assert all(isinstance(row[r], float) and row[r] == 0.0 for row in rows[3:] for r in translations)
