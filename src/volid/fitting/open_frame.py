"""The frame of a field that the readings leave open, chosen once: without the rigid motion that it would have otherwise.

Combinations of the parameters that are not determined may move the field of the measured tool vectors like one rigid body. Held
at 0 by themselves they leave the field in a frame that is uncertain by what nobody has measured. So they take the values with
which the field has no rigid motion over the measured range, for all measured tool vectors together:

    θ' = θ + N V a,  a = -(R⁺ G N V)⁺ R⁺ G θ,

N the combinations, V those of them that move the field (gradient G) rigidly (R), and stations and other unknowns on the workpiece
follow. No predicted reading changes, and values are those of θ' everywhere (CONVENTIONS 4: a field has one frame).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from volid.fitting.change_of_datum import mapped
from volid.fitting.diagnosis.identifiability import parameter_units, undetermined_directions
from volid.fitting.frames import Frames, unknown_rows
from volid.fitting.prediction.deviations import NOTICED, gradient_matrix
from volid.fitting.prediction.working_volume import spread_positions
from volid.fitting.solution import Solution
from volid.model.machine import WORKPIECE
from volid.model.rigid_fields import WorkpieceMotion

PLACES = 96  # over the measured range, tool vectors in turn
WELL = 0.1  # of the largest: combinations that hardly move the field would have to be large to do so
ARM = 1000.0  # mm: weighs rotations against translations


def in_open_frame(solution: Solution) -> Solution:
    """The solution with the rigid motion of its field taken out along what is not determined; itself where there is none."""
    rigid = _rigid_combinations(solution)
    if rigid is None:
        return solution
    combinations, motion, own = rigid
    size = np.array([1.0, 1.0, 1.0, ARM, ARM, ARM])
    answer = -np.linalg.pinv(size[:, None] * motion, rcond=WELL) @ (size[:, None] * own)
    change, moved = combinations @ answer, -motion @ answer
    bodies = np.zeros((len(solution.machine.axes) + 1, *moved.shape))
    bodies[0] = moved
    frames = Frames(bodies, np.zeros_like(moved), np.zeros((len(bodies), 1, *moved.shape)))
    unknowns = -unknown_rows(solution.machine, solution.nuisance_table, np.asarray(solution.nuisance), frames)
    units = parameter_units(solution.model)
    null = undetermined_directions(solution.null_space, units)
    back = np.eye(len(units)) - units[:, None] * (null @ null.T) / units
    found = mapped(solution, solution.model, np.eye(len(units)) + change, unknowns, back)
    return replace(found, null_space=solution.null_space)


def _rigid_combinations(solution: Solution) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Combinations (n, v) that move the field of all measured tool vectors rigidly, their motions (6, v), that of θ (6, n)."""
    bodies = {e.response.body for e in solution.nuisance_table if e.response.body}
    if not solution.null_space.shape[1] or bodies - {WORKPIECE}:
        return None
    machine, model = solution.machine, solution.model
    units = parameter_units(model)
    null = units[:, None] * undetermined_directions(solution.null_space, units)
    positions = spread_positions(machine, PLACES)
    vectors = solution.campaign.tool_vectors()
    tool = vectors[np.arange(PLACES) % len(vectors)]
    gradient = gradient_matrix(model, np.zeros(len(units)), positions, tool, np.zeros_like(positions))
    rows = gradient[:, :3].reshape(-1, len(units))
    motion = WorkpieceMotion(machine, positions, tool)
    along = motion.inverse @ (rows @ null)
    left = rows @ null - motion.translations @ along
    possible = float(np.abs(rows * units).max(initial=0.0))
    _, sizes, directions = np.linalg.svd(left, full_matrices=True)
    sizes = np.concatenate([sizes, np.zeros(len(directions) - len(sizes))])
    stiff = directions[sizes <= NOTICED * possible * np.sqrt(len(rows))].T
    if not stiff.shape[1] or np.abs((along @ stiff)[:3]).max() <= NOTICED * possible:
        return None
    return null @ stiff, along @ stiff, motion.inverse @ rows
