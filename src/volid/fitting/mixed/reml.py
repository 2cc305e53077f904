"""Variance components by restricted maximum likelihood: score and information of the factors of u, in a linear fit.

Whitened readings v = J x + ε with the covariance D + (what is known of x beforehand), D the diagonal of variances
σ_g² u² + e² (u stated, e of effects that are drawn anew for each reading; in units of all of it, the share of the first is s).
The likelihood of what is independent of the unknowns x has, in τ_g = ln σ_g², at the fit with these variances,

    score        ½ (Σ s v² - Σ s (1 - h)),                            h = diagonal of H = J C Jᵀ
    information  ½ (δ_gg' Σ s² (1 - 2h) + tr K_g K_g'),               K_g = Lᵀ Jᵀ S_g J L,   C = L Lᵀ

with sums over the readings of component g. Without effects s is 1, and the score is 0 where the sum of squared residuals
equals the redundancy of the component: the iteration of Helmert and Förstner ends at the maximum of this likelihood.
What is known of x with a variance of its own (calibrated lengths, an earlier solution, the smoothness of functions) takes part
in C, and is not scaled. Where the parameters φ of the smoothness are estimated too, with covariance C_φ, the information loses
F_gφ C_φ F_φg, F_gφ = -½ tr(K_g Lᵀ ∂Q/∂φ L).

Patterson and Thompson, Biometrika 58 (1971) 545; Harville, J. Am. Stat. Assoc. 72 (1977) 320; Förstner, 1979; Koch, Parameter
Estimation and Hypothesis Testing in Linear Models, 1999, 3.6. Not modelled: correlation between readings; that the covariance of
the result is itself uncertain because the factors are (Kenward and Roger, 1997), which matters below some ten degrees of freedom.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

NEAR = (
    0.4  # of ln σ² from which on the information tells the step; farther away the ratio of squares to redundancy does
)
LONGEST = 3.0  # step of ln σ²
LEAST_INFORMATION = 1e-9  # of a component with next to no redundancy


class Score(NamedTuple):
    """Of G components: `squares` Σ s v², `redundancy` Σ s (1 - h), each (G,), and `information` (G, G) of τ."""

    squares: np.ndarray
    redundancy: np.ndarray
    information: np.ndarray

    @property
    def covariance(self) -> np.ndarray:
        """Covariance of τ, (G, G)."""
        n = len(self.squares)
        scale = 1.0 / np.sqrt(np.maximum(np.diagonal(self.information), LEAST_INFORMATION))
        scaled = self.information * np.outer(scale, scale)
        values, vectors = np.linalg.eigh(0.5 * (scaled + scaled.T) if n else scaled)
        inverse = (vectors / np.maximum(values, LEAST_INFORMATION)) @ vectors.T
        return np.asarray(inverse * np.outer(scale, scale))

    @property
    def step(self) -> np.ndarray:
        """The next step of τ, (G,)."""
        least = 1e-12 * np.maximum(self.redundancy, 1e-12)
        ratio = np.log(np.maximum(self.squares, least) / np.maximum(self.redundancy, 1e-12))
        if np.any(np.abs(ratio) > NEAR):
            return np.clip(ratio, -LONGEST, LONGEST)
        return np.clip(self.covariance @ (0.5 * (self.squares - self.redundancy)), -LONGEST, LONGEST)


def information(
    squared_shares: np.ndarray, products: list[np.ndarray], slopes: list[np.ndarray], phi_covariance: np.ndarray
) -> np.ndarray:
    """Information of τ, (G, G).

    `squared_shares`: Σ s² (1 - 2h), (G,). `products`: K_g (r, r). `slopes`: Lᵀ ∂Q/∂φ L (r, r) of every φ, `phi_covariance` C_φ.
    """
    flat = np.stack([k.ravel() for k in products])
    found = 0.5 * (np.diag(squared_shares) + flat @ flat.T)
    if slopes:
        cross = -0.5 * flat @ np.stack([s.ravel() for s in slopes]).T
        found = found - cross @ phi_covariance @ cross.T
    return np.asarray(found)
