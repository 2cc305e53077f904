"""The best rigid compensation of a machine that is not rigid (ISO/TR 16907 7.4.2).

When a control can only hold single-axis functions, but the model has cross effects f(own axis, other axis), its functions
should not be those of one line. They are chosen so that the deviation that remains over the working volume is least, in the
least-squares sense over points and tool vectors. What remains is then due to the cross effects alone.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from volid.backend.rms import rms
from volid.compensation.base import deviation_rows
from volid.compensation.residual.fields import Places, volume_places
from volid.fitting.solution import Solution
from volid.model.error_model import build_model
from volid.model.machine import FunctionSettings, ModelSettings

if TYPE_CHECKING:
    from jaxtyping import Float

POINTS = 2048
RELATIVE_RANK = 1e-9  # of the singular values of scaled columns


class Remaining(NamedTuple):
    """What the best rigid functions leave of the functional point's deviation over the volume [mm]: RMS and largest length,
    and the same before compensation."""

    rms: float
    maximum: float
    rms_before: float
    maximum_before: float


def best_rigid(solution: Solution, tools: Float[np.ndarray, "k 3"]) -> tuple[Solution, Remaining]:
    """The solution with single-axis functions only, and what they leave.

    θ' = (A'ᵀA')⁺A'ᵀ A θ over 2048 points spread evenly (Halton), translations of the functional point; the covariance is
    transformed likewise. Directions that the tools do not determine have their least-norm value. Reversal and constants are
    kept as parts of the fit.

    Args:
        solution: A solution, as `volid.fit` makes it.
        tools: tool vectors for which the remaining deviation is minimised, shape (k, 3) [mm]; several that do not lie on one line
            distinguish angular functions from translations.

    Source: ISO/TR 16907 7.4.2.

    >>> import numpy as np
    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/five_axis_rtest/campaign.toml"))
    >>> tools = np.array([[0.0, 0.0, -150.0], [80.0, 0.0, -150.0], [0.0, 80.0, -150.0]])
    >>> rigid, remaining = volid.best_rigid(solution, tools)
    >>> remaining.rms < 1e-6 * remaining.rms_before  # its functions depend on one axis each: nothing remains
    True
    """
    machine = solution.machine
    settings = {n: replace(s, over=None, segments=_own_segments(s)) for n, s in machine.model.functions.items()}
    plain = replace(machine, model=ModelSettings(machine.model.degree, machine.model.segments, settings))
    segments = {n: k[:1] for n, k in solution.model.segments.items()}
    model = build_model(plain, segments, datum=solution.datum)
    rigid = replace(solution, model=model, campaign=replace(solution.campaign, machine=plain))
    places, several = volume_places(machine, POINTS), np.atleast_2d(tools)
    tool = several[np.arange(POINTS) % len(several)]
    before, after = (_translations(s, places, tool) for s in (solution, rigid))
    scale = np.linalg.norm(after, axis=0)
    scale = np.where(scale > 0, scale, 1.0)
    mapping = (np.linalg.pinv(after / scale, rcond=RELATIVE_RANK) @ before) / scale[:, None]
    theta = np.asarray(solution.parameters)
    remaining = (before @ theta - after @ (mapping @ theta)).reshape(-1, 3)
    found = replace(solution.mapped(model, mapping), campaign=rigid.campaign)
    return found, Remaining(*_sizes(remaining), *_sizes((before @ theta).reshape(-1, 3)))


def _own_segments(settings: FunctionSettings) -> int | str | None:
    return settings.segments[0] if isinstance(settings.segments, tuple) else settings.segments


def _translations(solution: Solution, places: Places, tool: np.ndarray) -> np.ndarray:
    """Translations of the functional point as linear map of θ, (3 m, n)."""
    rows = deviation_rows(solution, places.positions, places.directions, tool)[:, :3]
    return rows.reshape(-1, rows.shape[2])


def _sizes(field: np.ndarray) -> tuple[float, float]:
    size = np.linalg.norm(field, axis=1)
    return rms(size), float(size.max())
