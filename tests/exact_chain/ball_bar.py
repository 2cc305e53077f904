"""A double ball bar on the exact machine: commanded circles, what the drives add, what the bar reads, and the true terms of
it."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from exact_chain.machine import ExactMachine
from exact_chain.motions import LINEAR
from exact_chain.truth import Truth

MIDDLE = {"XY": 180.0, "YZ": 90.0, "ZX": 0.0}  # degrees: arcs lie above the socket


@dataclass(frozen=True)
class Drives:
    """What drives add at a feed [mm/min]: lag by axis [s], spikes by axis at its + and - end [mm], which fall to 1/e in
    `decay` degrees."""

    feed: float = 1000.0
    lag: Mapping[str, float] = field(default_factory=dict)
    spike: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    decay: float = 1.5

    def moved(self, plane: str, angle: np.ndarray, sense: int) -> np.ndarray:
        """Displacement of the functional point, (m, 3) [mm]: against the velocity, and outwards behind changes of direction."""
        shift = np.zeros((len(angle), 3))
        for letter, turned in zip(plane, (0.0, 90.0), strict=True):
            phi = np.deg2rad(angle - turned)  # the axis goes as its cosine
            column = LINEAR.index(letter)
            shift[:, column] = self.lag.get(letter, 0.0) * sense * self.feed / 60.0 * np.sin(phi)
            for end, sign in ((0.0, 1), (180.0, -1)):
                behind = (sense * (angle - turned - end)) % 360.0
                height = self.spike.get(letter, (0.0, 0.0))[0 if sign > 0 else 1]
                shift[:, column] += sign * height * np.exp(-behind / self.decay) * (behind < 90.0)
        return shift


@dataclass(frozen=True)
class BallBar:
    """A bar whose socket stands `off` from where the program has it, and which is `length` longer than its calibration says
    [mm]."""

    machine: ExactMachine
    truth: Truth
    tool: tuple[float, float, float]
    socket: tuple[float, float, float]
    radius: float = 150.0
    off: tuple[float, float, float] = (0.0, 0.0, 0.0)
    length: float = 0.0
    digits: int = 9  # of commanded positions

    def command(self, plane: str, angle: np.ndarray, sense: int) -> tuple[np.ndarray, np.ndarray]:
        """Positions and approach directions (m, axes); at a change of quadrant an axis has the direction it came with."""
        a, b = plane
        phi, before = np.deg2rad(angle), np.deg2rad(angle - 0.01 * sense)
        place = dict(zip(LINEAR, np.subtract(self.socket, self.tool), strict=True))
        moved = {a: place[a] + self.radius * np.cos(phi), b: place[b] + self.radius * np.sin(phi)}
        ways = {a: -sense * np.sign(np.sin(before)), b: sense * np.sign(np.cos(before))}
        still = dict.fromkeys(LINEAR, 0.0)
        q = self.machine.in_axis_order({**place, **moved})
        return np.round(q, self.digits), self.machine.in_axis_order({**still, **ways})

    def read(self, plane: str, angle: np.ndarray, sense: int, drives: Drives | None = None) -> np.ndarray:
        """Lengths without noise, (m,) [mm]."""
        q, ways = self.command(plane, angle, sense)
        point = self.machine.functional_point(q, self.tool, self.truth, ways)
        point = point + (drives.moved(plane, angle, sense) if drives else 0.0)
        return np.linalg.norm(point - np.asarray(self.socket) - self.off, axis=1) + self.length

    def harmonics(self, plane: str) -> tuple[float, float]:
        """Squareness [rad] and difference of scales [1]: second harmonics of the mean of both senses over full circles."""
        angle = np.arange(0.125, 360.0, 0.25)
        mean = 0.5 * sum(self.read(plane, angle, sense) for sense in (1, -1)) - self.radius
        waves = [np.mean(mean * f(2.0 * np.deg2rad(angle))) for f in (np.sin, np.cos)]
        return -4.0 / self.radius * waves[0], 4.0 / self.radius * waves[1]

    def reversal(self, axis: str) -> float:
        """Reversal value of an axis's positioning [mm]: the mean over the circle, weighted as the radius sees it."""
        phi = np.linspace(0.0, np.pi, 1801)
        place = np.subtract(self.socket, self.tool)[LINEAR.index(axis)]
        values = self.truth.reversal[f"E{axis}{axis}"](place + self.radius * np.cos(phi))
        return float(np.average(values, weights=np.cos(phi) ** 2))


def turn(plane: str, arc: float, sense: int, step: float) -> np.ndarray:
    """Commanded angles of one run, both ends included [degrees]."""
    return (MIDDLE[plane] + np.arange(-0.5 * arc, 0.5 * arc + 0.5 * step, step))[::sense]
