"""A virtual machine behind simulated drives: measured, fitted, compensated by a grid in HAL; and what is predicted to remain.

What the machine really does comes from `exact_chain`: smooth errors that are no splines, lever arms, squareness.
It is measured by distances with noise, from six stations and with three tool vectors. volid fits them and writes the files of
linuxcnc-hal. What remains is compared without a rigid motion of the workpiece frame over the same places, because the
fitted frame and that of the truth differ by one; it is fitted to, and taken out of, what remains and its prediction alike.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from exact_chain import ExactMachine, Truth, gauge_free, machine_toml, random_truth, tracker_campaign, write_campaign
from scipy.interpolate import RegularGridInterpolator

import volid
from volid.compensation.base import deviation_rows

TRAVEL = {"X": (0.0, 400.0), "Y": (0.0, 300.0), "Z": (-250.0, 0.0)}
TOOL = np.array([0.0, 0.0, -150.0])
TOOLS = np.array([TOOL, [80.0, 0.0, -250.0], [0.0, 90.0, -200.0], TOOL, TOOL, TOOL])  # one for each station
STEP = 25.0  # mm between nodes: interpolation leaves about as much as the noise of the readings
READINGS, U = 100, 0.0003  # per station; mm, and 0.3 µm per metre


@dataclass(frozen=True)
class VirtualMachine:
    """The machine, what it really does, and the solution from what was measured on it."""

    exact: ExactMachine
    truth: Truth
    solution: volid.Solution

    def off(self, asked: np.ndarray, driven: np.ndarray) -> np.ndarray:
        """Where the functional point is, less where it was asked to be; both positions in the order X, Y, Z; (m, 3) [mm]."""
        actual = self.exact.functional_point(self.ordered(driven), TOOL, self.truth)
        return actual - self.exact.functional_point(self.ordered(asked), TOOL)

    def ordered(self, xyz: np.ndarray) -> np.ndarray:
        """Positions in machine axis order."""
        return self.exact.in_axis_order(dict(zip("XYZ", xyz.T, strict=True)))

    def without_motion(self, field: np.ndarray, asked: np.ndarray) -> np.ndarray:
        """A field at places without its rigid motion, (m, 3)."""
        return gauge_free(field, self.ordered(asked), TOOL, machine=self.exact)[0]

    def gradient(self, xyz: np.ndarray) -> np.ndarray:
        """What the parameters of the solution do to the functional point at positions X, Y, Z, (3 m, n)."""
        q = self.ordered(xyz)
        return deviation_rows(self.solution, q, np.zeros_like(q), TOOL)[:, :3].reshape(3 * len(q), -1)


def measured(folder: Path, seed: int) -> VirtualMachine:
    """A machine with errors of its own, measured and fitted."""
    exact = ExactMachine("w Y' X' b Z t", TRAVEL)
    rng = np.random.default_rng(seed)
    truth = random_truth(exact, rng, tool_rotation=False)
    campaign = tracker_campaign(exact, truth, rng, tools=TOOLS, n_per_station=READINGS, u_constant=U)
    path = write_campaign(folder, campaign, machine_toml(exact), "synthetic", approximate_error=2.0, rng=rng)
    return VirtualMachine(exact, truth, volid.fit(volid.load_campaign(path)))


def places(m: int, seed: int = 100) -> np.ndarray:
    """Positions X, Y, Z off the nodes of the grid, evenly at random, in steps of 1 µm (m, 3) [mm]."""
    low, high = np.array([TRAVEL[a] for a in "XYZ"]).T
    return np.round(np.random.default_rng(seed).uniform(low, high, (m, 3)), 3)


def corrections(text: str) -> RegularGridInterpolator:
    """What a grid file adds to the commands at X, Y, Z; read and interpolated apart from volid and from the component."""
    words = re.sub(r"#.*", "", text).split()
    nodes, i = [], words.index("nodes")
    for _ in "XYZ":
        n = int(words[i + 2])
        nodes.append(np.array(words[i + 3 : i + 3 + n], float))
        i += 3 + n
    values = np.array(words[i + 2 : -1], float).reshape(*map(len, nodes), 3)
    return RegularGridInterpolator(nodes, values, bounds_error=True)


@dataclass(frozen=True)
class Residual:
    """What is predicted to remain at some places: RMS lengths over them [mm], and draws of the RMS (s,)."""

    interpolation: float
    fit: float
    draws: np.ndarray

    @property
    def both(self) -> float:
        """Interpolation error and uncertainty of the fitted field together."""
        return float(np.hypot(self.interpolation, self.fit))


def predicted(machine: VirtualMachine, asked: np.ndarray, added: np.ndarray) -> Residual:
    """From first principles: the fitted field e and its covariance C at the places, and what the grid adds there (m, 3).

    RMS² = (|P (e + added)|² + trace(P C P)) / m,    P: without rigid motion over the places.
    """
    solution, rows = machine.solution, machine.gradient(asked)
    fitted = (rows @ np.asarray(solution.parameters)).reshape(-1, 3)
    covariance = rows @ np.asarray(solution.parameter_covariance) @ rows.T
    left, of_fit = gauge_free(fitted + added, machine.ordered(asked), TOOL, covariance, machine=machine.exact)
    values, vectors = np.linalg.eigh(of_fit)
    drawn = np.random.default_rng(7).standard_normal((2000, len(values))) * np.sqrt(np.maximum(values, 0.0)) @ vectors.T
    return Residual(rms(left), float(np.sqrt(np.trace(of_fit) / len(asked))), rms(left + drawn.reshape(2000, -1, 3)))


def rms(field: np.ndarray):
    """RMS length over the places of fields (…, m, 3)."""
    found = np.sqrt((field**2).sum(axis=-1).mean(axis=-1))
    return float(found) if found.ndim == 0 else found
