"""Products with the free directions: those of the dense matrix, whatever structure it has."""

import numpy as np
import pytest
from scipy.linalg import block_diag

from volid.fitting.equations.free_directions import FreeDirections

RNG = np.random.default_rng(0)


def blocks(*shapes):
    return block_diag(*(RNG.standard_normal(s) for s in shapes))


SHUFFLED = blocks((14, 12), (14, 12), (30, 8), *[(1, 1)] * 9)
GAPS = np.vstack([np.zeros((3, 20)), blocks((20, 9), (25, 11)), np.zeros((2, 20))])
CASES = {
    "dense": RNG.standard_normal((40, 7)),
    "identity": np.eye(50),
    "blocks": blocks((14, 12), (14, 12), (40, 3), (2, 1)),
    "columns in any order": SHUFFLED[:, RNG.permutation(SHUFFLED.shape[1])],
    "rows that nothing moves": GAPS,
    "a column of zeros": np.hstack([np.zeros((45, 1)), GAPS[3:-2, :], np.zeros((45, 1))]),
    "blocks that overlap": blocks((40, 5), (40, 5))
    + np.roll(blocks((40, 5), (40, 5)), 40, axis=0) * (np.arange(80) < 41)[:, None],
    "no column": np.zeros((12, 0)),
}


@pytest.mark.parametrize("name", CASES)
def test_same_as_the_dense_products(name):
    free = CASES[name]
    size, n = free.shape
    root = RNG.standard_normal((size, size))
    matrix, z, step = root @ root.T, RNG.standard_normal(size), RNG.standard_normal(n)
    found = FreeDirections(free)
    expected = free.T @ matrix @ free
    np.testing.assert_allclose(found.project(matrix), expected, atol=1e-12 * size**2)
    np.testing.assert_allclose(found.pull(z), free.T @ z, atol=1e-12)
    np.testing.assert_allclose(found.move(z, step), z - free @ step, atol=1e-12)
