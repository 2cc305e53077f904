"""Random errors of a rotary axis in the datum: error motions without mean and co-rotating part, errors of its line."""

import numpy as np

from exact_chain.motions import COMPONENTS, MICRO, MICROMETRE, ROTARY
from exact_chain.truth import Smooth
from exact_chain.waves import dense, signed, wave


def rotary_functions(machine, axis, rng, waviness, scale) -> dict[str, Smooth]:
    """Six functions of a rotary axis: zero mean, no co-rotating vector (CONVENTIONS 4); angle zero at the reference.

    Rotor-fixed vector v across the axis d, seen from the stator: cos(q) v +- sin(q) d x v, + on the tool side.
    """
    travel, d = one_turn(machine.travel[axis]), machine.frame[axis].T @ machine.direction[axis]
    along = ROTARY.index(axis)
    if abs(abs(d[along]) - 1.0) > 1e-12:
        raise ValueError(f"axis {axis}: random_truth needs a rotary axis parallel to its machine axis, or axis_frame")
    turn = -1.0 if machine.primed[axis] else 1.0
    q, weight = dense(travel)
    cos, sin = np.cos(np.deg2rad(q)), turn * np.sin(np.deg2rad(q))
    functions = {}
    for names, size in ((COMPONENTS[:3], MICROMETRE), (COMPONENTS[3:], MICRO)):
        low, high = (2, 8) if size == MICROMETRE else (10, 30)
        f = [_periodic_or_wave(machine, axis, rng, waviness) for _ in names]
        across = [k for k in range(3) if k != along]
        v1, v2 = np.eye(3)[across[0]], np.eye(3)[across[1]]
        fields = [np.outer(cos, v) + np.outer(sin, np.cross(d, v)) for v in (v1, v2)]  # co-rotating
        fields += [np.tile(v, (len(q), 1)) for v in (v1, v2)]  # mean
        A = np.stack([vectors[:, across] for vectors in fields], axis=-1)  # (nodes, 2, 4)
        value = np.stack([f[k](q) for k in across], axis=-1)
        normal = np.einsum("n,nca,ncb->ab", weight, A, A)
        c = np.linalg.solve(normal, np.einsum("n,nca,nc->a", weight, A, value))
        turned = [turn * np.cross(d, v) for v in (v1, v2)]
        for k in across:
            cosine, sine = c[0] * v1[k] + c[1] * v2[k], c[0] * turned[0][k] + c[1] * turned[1][k]
            f[k] = f[k].plus_first_harmonic(-cosine, -sine).plus(-(c[2] * v1[k] + c[3] * v2[k]))
        f[along] = f[along].plus(-(weight @ f[along](q)) if size == MICROMETRE else -f[along](machine.reference[axis]))
        pair = max(np.abs(f[k](q)).max() for k in across)  # one factor for the pair: keeps it free of co-rotation
        peak = [np.abs(f[along](q)).max() if k == along else pair for k in range(3)]
        amplitude = {k: rng.uniform(low, high) * size for k in ("pair", "along")}
        for k, name in enumerate(names):
            factor = amplitude["along" if k == along else "pair"] / peak[k]
            functions[name + axis] = f[k].times(scale * factor)
    return functions


def one_turn(travel) -> tuple[float, float]:
    """The travel, or one turn of an axis that makes more: its errors repeat."""
    return travel if np.ptp(travel) <= 360 else (-180.0, 180.0)


def _periodic_or_wave(machine, axis, rng, waviness) -> Smooth:
    """Harmonics 1 to 3 (x waviness) for whole turns, otherwise a wave over the travel."""
    if np.ptp(machine.travel[axis]) < 360:
        return wave(machine, axis, rng, waviness)
    order = np.unique(np.maximum(1, np.round(waviness * np.arange(1, 4))))
    phase = rng.uniform(0, 2 * np.pi, len(order))
    amplitude = rng.uniform(0.5, 1.0, len(order)) / np.sqrt(np.arange(1, len(order) + 1))
    return Smooth(amplitude, order / 360, phase, np.zeros(2), machine.reference[axis], 360.0)


def location_errors(machine, axis, rng, scale) -> dict[str, float]:
    """Position and orientation of the axis line across its direction: four constants."""
    along = ROTARY.index(axis)
    position = {f"{COMPONENTS[k]}0{axis}": scale * signed(rng, 5, 25) * MICROMETRE for k in range(3) if k != along}
    tilt = {f"{COMPONENTS[k + 3]}0{axis}": scale * signed(rng, 20, 40) * MICRO for k in range(3) if k != along}
    return position | tilt
