"""Random smooth functions over a travel, and what is taken out of them or how they are scaled."""

import functools

import numpy as np

from exact_chain.machine import ExactMachine
from exact_chain.truth import Smooth


def signed(rng, low, high) -> float:
    """Random value with magnitude between low and high and random sign."""
    return float(rng.uniform(low, high) * rng.choice([-1.0, 1.0]))


def wave(machine: ExactMachine, axis: str, rng, waviness: float) -> Smooth:
    """Four sines, periods log-uniform in 0.45-2 travels / waviness, power falling with frequency, plus a cubic."""
    low, high = machine.travel[axis]
    length = high - low
    period = length / waviness * np.exp(rng.uniform(np.log(0.45), np.log(2.0), 4))
    amplitude = rng.uniform(0.5, 1.0, 4) * np.sqrt(period / period.max())
    cubic = rng.normal(0.0, 0.7, 4) * [0, 1, 1, 1]
    return Smooth(amplitude, 1 / period, rng.uniform(0, 2 * np.pi, 4), cubic, machine.reference[axis], length)


@functools.cache
def _gauss_legendre(n: int) -> tuple[np.ndarray, np.ndarray]:
    return np.polynomial.legendre.leggauss(n)


def dense(travel, n: int = 400) -> tuple[np.ndarray, np.ndarray]:
    """Gauss-Legendre nodes over the travel and weights that sum to one."""
    node, weight = _gauss_legendre(n)
    return np.mean(travel) + np.ptp(travel) / 2 * node, weight / 2


def unit_peak(function: Smooth, travel) -> Smooth:
    """The function scaled to a largest absolute value of 1 over the travel."""
    return function.times(1 / np.abs(function(np.linspace(*travel, 401))).max())


def without_slope(function: Smooth, travel) -> Smooth:
    """The function minus its least-squares slope, uniform weight over the travel; zero at the reference."""
    q, weight = dense(travel)
    lever = q - weight @ q
    function = function.plus(slope=-(weight @ (lever * function(q))) / (weight @ lever**2))
    return function.plus(-function(function.centre))
