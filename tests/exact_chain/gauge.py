"""Deviation fields compared: what a rigid motion of the workpiece frame and the tool frame explain is taken out."""

import numpy as np

from exact_chain.machine import ExactMachine


def gauge_basis(
    q, tool, machine: ExactMachine | None = None, tool_rotation: bool = True, tool_translation: bool = False
) -> np.ndarray:
    """Orthonormal basis (3n, r), by SVD rank, of e_k, e_k x p and, if asked for, e_k x tool and e_k of the tool frame.

    p: the nominal functional points; fields in the machine frame. Without `machine`: three linear axes, q is (n, 3) in the order
    X, Y, Z. With it: q in machine axis order, any axes.
    """
    n = len(q)
    tool = np.broadcast_to(np.asarray(tool, float), (n, 3))
    identity = np.tile(np.eye(3), (n, 1, 1))
    if machine is None:
        to_machine, tool_to_machine, p = identity, identity, np.asarray(q, float) + tool
    else:
        to_machine = machine.table_rotation(q).transpose(0, 2, 1)
        tool_to_machine = to_machine @ machine.nominal_pose(q)[:, :3, :3]
        p = machine.functional_point(q, tool)
    columns = [to_machine, to_machine @ _lever(p - p.mean(axis=0))]
    if tool_rotation:
        columns.append(tool_to_machine @ _lever(tool))
    if tool_translation:
        columns.append(tool_to_machine)
    G = np.concatenate(columns, axis=2).reshape(3 * n, -1)
    size = np.linalg.norm(G, axis=0)
    U, s, _ = np.linalg.svd(G / np.where(size > 0, size, 1.0), full_matrices=False)
    return U[:, s > 1e-9 * s[0]]


def gauge_free(
    difference,
    q,
    tool,
    covariance=None,
    tool_rotation: bool = True,
    *,
    tool_translation: bool = False,
    machine: ExactMachine | None = None,
) -> tuple[np.ndarray, np.ndarray | None]:
    """Difference of two translation fields (n, 3) without rigid workpiece motion and tool rotation: P d, P C P^T.

    P = I - Q Q^T, Q the `gauge_basis`. `covariance` (3n, 3n): point by point.
    """
    difference = np.asarray(difference, float)
    Q = gauge_basis(q, tool, machine, tool_rotation, tool_translation)
    d = difference.reshape(-1)
    projected = (d - Q @ (Q.T @ d)).reshape(difference.shape)
    if covariance is None:
        return projected, None
    half = covariance - Q @ (Q.T @ covariance)
    return projected, half - (half @ Q) @ Q.T


def _lever(points: np.ndarray) -> np.ndarray:
    """Matrices (n, 3, 3) whose column k is e_k x point."""
    return np.cross(np.eye(3)[None], points[:, None, :]).transpose(0, 2, 1)
