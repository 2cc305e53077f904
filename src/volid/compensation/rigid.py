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
from volid.compensation.residual.fields import volume_places
from volid.fitting.prediction.deviations import deviation_values
from volid.fitting.prediction.largest import Places, axes_with_reversal, largest_places, whole_volume
from volid.fitting.solution import Solution
from volid.model.error_model import build_model
from volid.model.machine import FunctionSettings, ModelSettings

if TYPE_CHECKING:
    from jaxtyping import Float

POINTS = 2048
RELATIVE_RANK = 1e-9  # of the singular values of scaled columns


class Remaining(NamedTuple):
    """What the best rigid functions leave of the functional point's deviation over the volume [mm]: RMS and largest length,
    and the same before compensation. The largest ones are of all tool vectors, corners and edges included."""

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
    solution.ask(tools, name="tools")
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
    found = replace(solution.mapped(model, mapping), campaign=rigid.campaign)
    return found, _remaining(solution, found, places, tool)


def _own_segments(settings: FunctionSettings) -> int | str | None:
    return settings.segments[0] if isinstance(settings.segments, tuple) else settings.segments


def _translations(solution: Solution, places: Places, tool: np.ndarray) -> np.ndarray:
    """Translations of the functional point as linear map of θ, (3 m, n)."""
    rows = deviation_rows(solution, places.positions, places.directions, tool)[:, :3]
    return rows.reshape(-1, rows.shape[2])


def _remaining(solution: Solution, rigid: Solution, places: Places, tool: np.ndarray) -> Remaining:
    """RMS at the places, each with its tool vector (m, 3); largest over the volume, for all of these tool vectors."""
    tools, start = np.unique(tool, axis=0), whole_volume(solution.model)

    def left(q: np.ndarray, way: np.ndarray, tool: np.ndarray, compensated: bool) -> np.ndarray:
        """Length of what remains, (m,) [mm]."""
        vectors = np.broadcast_to(tool, (len(q), 3))
        full, single = (
            deviation_values(s.model, np.asarray(s.parameters), q, vectors, way)[:, :3] for s in (solution, rigid)
        )
        return np.asarray(np.linalg.norm(full - compensated * single, axis=1))

    found = []
    for compensated in (True, False):

        def sizes(q: np.ndarray, way: np.ndarray, compensated: bool = compensated) -> np.ndarray:
            return np.column_stack([left(q, way, t, compensated) for t in tools])

        worst = largest_places(solution.machine, sizes, start, axes_with_reversal(solution.model))
        found += [rms(left(*places[:2], tool, compensated)), float(sizes(*worst[:2]).max())]
    return Remaining(*found)
