"""Displacements along diagonals of the box of travels, by rays and planes: plain ones, and steps with a flat mirror."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from exact_chain.beams import flat_lengths, retro_lengths
from exact_chain.machine import ExactMachine
from exact_chain.motions import LINEAR
from exact_chain.truth import Truth

BODY = {"PPP": (1, 1, 1), "NPP": (-1, 1, 1), "PNP": (1, -1, 1), "PPN": (1, 1, -1)}
FACE = {
    "XY_PP": (1, 1, 0),
    "XY_NP": (-1, 1, 0),
    "XZ_PP": (1, 0, 1),
    "XZ_NP": (-1, 0, 1),
    "YZ_PP": (0, 1, 1),
    "YZ_NP": (0, -1, 1),
}


@dataclass(frozen=True)
class Way:
    """Commanded positions `q` (m, n_axes) along a diagonal there and back, approach directions, and the beam's unit vector."""

    q: np.ndarray
    direction: np.ndarray
    beam: np.ndarray

    @property
    def half(self) -> int:
        return len(self.q) // 2


def way(machine: ExactMachine, senses, shares, height: float = 0.5) -> Way:
    """From one end to the other and back; `shares` (m, 3) of the travels of X, Y, Z; an axis of sense 0 stands at `height`."""
    senses, shares = np.array(senses, float), np.asarray(shares, float)
    low, high = np.array([machine.travel[a] for a in LINEAR]).T
    shares = np.where(senses > 0, shares, np.where(senses < 0, 1.0 - shares, height))
    there = low + shares * (high - low)
    q = machine.in_axis_order({a: np.concatenate([there[:, i], there[::-1, i]]) for i, a in enumerate(LINEAR)})
    direction = np.concatenate([np.tile(senses, (len(there), 1)), np.tile(-senses, (len(there), 1))])
    direction = machine.in_axis_order({a: direction[:, i] for i, a in enumerate(LINEAR)})
    beam = senses * (high - low)
    return Way(q, direction, beam / np.linalg.norm(beam))


def stepped(machine: ExactMachine, name: str, n: int) -> Way:
    """Along a body diagonal in n steps of X, then Y, then Z: 3 n + 1 places there, the same back."""
    count = np.array([[(k + 2) // 3, (k + 1) // 3, k // 3] for k in range(3 * n + 1)])
    return way(machine, BODY[name], count / n)


def straight(machine: ExactMachine, name: str, n: int) -> Way:
    """Along a body or face diagonal, at n places there and n back."""
    return way(machine, (BODY | FACE)[name], np.repeat(np.linspace(0.0, 1.0, n)[:, None], 3, axis=1))


def displacements(
    machine: ExactMachine,
    going: Way,
    tool,
    truth: Truth,
    *,
    mirror: str = "flat",
    tilt=(0.0, 0.0),
    altered: Callable | None = None,
) -> np.ndarray:
    """What the interferometer reads beyond the nominal displacement from the first place on, (m,) [mm].

    The beam runs along the nominal diagonal. A flat mirror is adjusted square to it in the first place, but for `tilt` (2,) [rad]
    about two directions across. `altered`: what a control makes of commanded positions, tool and approach directions.
    """
    q = going.q if altered is None else altered(going.q, np.asarray(tool, float), going.direction)
    nominal = machine.functional_point(going.q, tool)
    if mirror == "retro":
        read = retro_lengths(machine, q, tool, truth, going.beam, nominal[0], direction=going.direction)
    else:
        across = np.linalg.svd(going.beam[None, :])[2][1:]
        turned = machine.pose(q[:1], truth, going.direction[:1])[0, :3, :3]
        normal = turned.T @ (going.beam + np.asarray(tilt, float) @ across)
        read = flat_lengths(machine, q, tool, truth, going.beam, nominal[0], normal, direction=going.direction)
    return read - (nominal - nominal[0]) @ going.beam


def range_of(deviations: np.ndarray) -> float:
    """E of a diagonal that was read once each way: largest less smallest deviation of both ways together."""
    return float(np.ptp(deviations))
