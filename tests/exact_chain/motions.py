"""Names, units and exact rigid motions as 4x4 matrices."""

import numpy as np
from scipy.spatial.transform import Rotation

LINEAR = "XYZ"
ROTARY = "ABC"
COMPONENTS = ("EX", "EY", "EZ", "EA", "EB", "EC")
MICRO = 1e-6  # 1 µrad in rad
MICROMETRE = 1e-3  # 1 µm in mm


def unit(letter: str) -> np.ndarray:
    """Unit vector that belongs to a letter: X, A -> e_x; Y, B -> e_y; Z, C -> e_z."""
    return np.eye(3)[(LINEAR if letter in LINEAR else ROTARY).index(letter)]


def rigid(rotation_vector, translation, centre=(0.0, 0.0, 0.0)) -> np.ndarray:
    """Exact motion x -> c + R (x - c) + e as matrices (m, 4, 4); R = exp[rotation vector x]. [rad, mm, mm]."""
    rotation_vector, translation = np.atleast_2d(rotation_vector), np.atleast_2d(translation)
    m = max(len(rotation_vector), len(translation))
    rotation_vector, centre = np.broadcast_to(rotation_vector, (m, 3)).copy(), np.asarray(centre, float)
    matrix = np.tile(np.eye(4), (m, 1, 1))
    matrix[:, :3, :3] = Rotation.from_rotvec(rotation_vector).as_matrix()
    matrix[:, :3, 3] = centre + translation - matrix[:, :3, :3] @ centre
    return matrix


def apply(matrix: np.ndarray, point) -> np.ndarray:
    """Points T p, shape (m, 3), of one point (3,) or one per matrix (m, 3)."""
    point = np.broadcast_to(np.asarray(point, float), (len(matrix), 3))
    return np.einsum("mij,mj->mi", matrix[:, :3, :3], point) + matrix[:, :3, 3]
