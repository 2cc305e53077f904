"""The linear effect of quartic error motions of a machine bed-X-Y-Z-tool on its functional point."""

import numpy as np

HALF = np.array([500.0, 300.0, 250.0])  # of the travels [mm]
ONE = [[0.0, 0.0, -150.0]]
ON_AXIS = [*ONE, [0.0, 0.0, -250.0]]
THREE = [*ONE, [80.0, 0.0, -250.0], [0.0, 90.0, -200.0]]


def rows(t, tool):
    """Deviation by 72 coefficients, (m, 3, 72); t (m, 3) from -1 to 1 over the travels, tool (m, 3) [mm]."""
    q, columns = t * HALF, []
    for axis in range(3):
        arm = np.where(np.arange(3) > axis, q, 0.0) + tool  # what the carriage of this axis carries
        for power in range(1, 5):
            shape = t[:, axis, None] ** power
            for unit in np.eye(3):
                columns += [shape * unit, shape * np.cross(unit, arm) / 300.0]
    return np.stack(columns, axis=2)


def rank(matrix, nuisance):
    """How many combinations remain when the unknowns of the instrument take their part."""
    u, s, _ = np.linalg.svd(nuisance, full_matrices=False)
    u = u[:, s > 1e-10 * s[0]]
    return int(np.linalg.matrix_rank(matrix - u @ (u.T @ matrix), tol=1e-6))


def of_positions(tools, n=150):
    """Determined combinations, of 72, from 3-D positions in a frame that is not known, modulo a rotation of the tool."""
    t = np.random.default_rng(1).uniform(-1.0, 1.0, (n * len(tools), 3))
    tool = np.repeat(np.asarray(tools), n, axis=0)
    point = t * HALF + tool
    free = [np.broadcast_to(unit, point.shape) for unit in np.eye(3)]
    free += [np.cross(unit, arm) / 300.0 for unit in np.eye(3) for arm in (point, tool)]
    return rank(rows(t, tool).reshape(-1, 72), np.stack(free, axis=2).reshape(-1, 9))


def of_diagonals(n=60):
    """The same from displacements along the four body diagonals, each with its own zero and no other unknown."""
    s = np.linspace(-1.0, 1.0, n)[:, None]
    signs = np.array([[1, 1, 1], [-1, 1, 1], [1, -1, 1], [1, 1, -1]])
    beams = signs * HALF / np.linalg.norm(HALF)
    tool = np.tile(ONE, (n, 1))
    readings = [np.einsum("k,mkn->mn", beam, rows(s * sign, tool)) for sign, beam in zip(signs, beams, strict=True)]
    return rank(np.concatenate(readings), np.kron(np.eye(4), np.ones((n, 1))))
