"""Correlations of what a fit estimated: between error functions, and with stations and other unknowns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from volid.fitting.solution import Solution
from volid.model.error_model import MEAN

STRONG = 0.95  # from which on two parameters are told apart badly
LISTED = 12  # pairs of blocks that are named
DETERMINED = 1e-12  # of the largest variance of a block: below, a parameter is fixed or not determined


class Block(NamedTuple):
    """Parameters that belong together: the name of their function or kind, and their numbers in (θ, ν)."""

    name: str
    parameters: slice


class Pair(NamedTuple):
    """The two parameters of two blocks that are correlated most: names of the blocks and parameters, and ρ."""

    blocks: tuple[str, str]
    parameters: tuple[str, str]
    correlation: float


@dataclass(frozen=True, eq=False)
class Correlations:
    """Correlation coefficients of (θ, ν).

    Args:
        matrix: Shape (p, p); NaN in rows and columns of what is fixed or not determined.
        blocks: Functions in the order of θ, then the other unknowns by what they belong to.
        labels: A name for each of the p parameters.
    """

    matrix: np.ndarray
    blocks: tuple[Block, ...]
    labels: tuple[str, ...]

    def strong(self, limit: float = STRONG) -> list[Pair]:
        """Pairs of blocks with a correlation beyond `limit` by amount, the strongest first; within a block none is meant."""
        found = []
        for i, a in enumerate(self.blocks):
            for b in self.blocks[i + 1 :]:
                part = np.nan_to_num(self.matrix[a.parameters, b.parameters])
                k, m = np.unravel_index(int(np.argmax(np.abs(part))), part.shape)
                if abs(part[k, m]) > limit:
                    names = self.labels[a.parameters.start + int(k)], self.labels[b.parameters.start + int(m)]
                    found.append(Pair((a.name, b.name), names, float(part[k, m])))
        return sorted(found, key=lambda pair: -abs(pair.correlation))


def correlations_of(solution: Solution) -> Correlations:
    """Correlations of a solution's parameters θ and other unknowns ν, from its covariance.

    >>> import volid
    >>> found = correlations_of(volid.fit(volid.load_campaign("datasets/vertical_multilateration/campaign.toml")))
    >>> [block.name for block in found.blocks][:3], found.matrix.shape
    (['EXY', 'EYY', 'EZY'], (432, 432))
    """
    covariance = np.asarray(solution.covariance)
    variance = np.diagonal(covariance)
    blocks = _blocks(solution)
    known = _determined(solution, variance, blocks)
    size = np.where(known, np.sqrt(np.where(known, variance, 1.0)), np.nan)
    names = tuple(solution.model.parameter_labels()) + tuple(entry.name for entry in solution.nuisance_table)
    return Correlations(covariance / np.outer(size, size), blocks, names)


def _determined(solution: Solution, variance: np.ndarray, blocks: tuple[Block, ...]) -> np.ndarray:
    """Which of (θ, ν) are neither fixed nor part of a combination that is not determined, shape (p,).

    The covariance is zero along such combinations, so that what is left of their parameters looks known, and correlated.
    """
    known = np.zeros(len(variance), dtype=bool)
    for block in blocks:
        own = variance[block.parameters]
        known[block.parameters] = own > DETERMINED * max(float(own.max(initial=0.0)), 1e-300)
    n = solution.model.n_parameters
    known[:n] &= ~solution.is_not_determined(np.eye(n))
    return known


def _blocks(solution: Solution) -> tuple[Block, ...]:
    """Functions that share parameters, then consecutive unknowns of one kind and owner, as their keys have them."""
    found = [
        Block("+".join(names) + ("" if part in (MEAN, "location") else f" {part}"), parameters)
        for names, part, parameters in solution.model.groups
    ]
    start = solution.model.n_parameters
    for entry in solution.nuisance_table:
        owner = " ".join(str(part) for part in entry.key[:2]) if isinstance(entry.key, tuple) else entry.name
        if len(found) and found[-1].name == owner and found[-1].parameters.stop == start:
            found[-1] = Block(owner, slice(found[-1].parameters.start, start + 1))
        else:
            found.append(Block(owner, slice(start, start + 1)))
        start += 1
    return tuple(found)
