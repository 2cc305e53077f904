"""Displacements that a laser interferometer reads, from exact poses and the geometry of rays and planes alone."""

import numpy as np

from exact_chain.machine import ExactMachine
from exact_chain.motions import apply
from exact_chain.truth import Truth


def seen_from(machine: ExactMachine, body: str, q, truth: Truth, direction=None) -> np.ndarray:
    """Exact pose of the tool in the frame of a body, (m, 4, 4)."""
    return np.linalg.inv(machine.body_pose(body, q, truth, direction)) @ machine.pose(q, truth, direction)


def retro_lengths(machine: ExactMachine, q, tool, truth: Truth, beam, point, body="workpiece", direction=None):
    """Length along a beam from its `point` to the foot of the reflector's apex, (m,) [mm]: half of the way there and back.

    A corner cube returns the beam antiparallel, and every ray through it has the length of the one through its apex.
    """
    apex = apply(seen_from(machine, body, q, truth, direction), tool)
    along = np.asarray(beam, float) / np.linalg.norm(beam)
    return np.array([along @ (a - np.asarray(point, float)) for a in apex])


def flat_lengths(machine: ExactMachine, q, tool, truth: Truth, beam, point, normal, body="workpiece", direction=None):
    """Length of a ray from `point` along `beam` to where it meets a mirror, (m,) [mm]: ray and plane, three equations.

    `normal`: of the mirror in the tool's frame; the tool vector is a point of its plane, which two vectors span.
    """
    poses = seen_from(machine, body, q, truth, direction)
    along = np.asarray(beam, float) / np.linalg.norm(beam)
    spanned = np.linalg.svd(np.asarray(normal, float)[None, :])[2][1:]  # two vectors of the plane
    start, lengths = np.asarray(point, float), []
    for pose, place in zip(poses, apply(poses, tool), strict=True):
        edges = pose[:3, :3] @ spanned.T
        lengths.append(np.linalg.solve(np.column_stack([along, -edges]), place - start)[0])
    return np.array(lengths)
