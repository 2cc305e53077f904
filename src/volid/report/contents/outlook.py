"""What each compensation type of ISO/TR 16907 that the machine can have is expected to leave, for one tool vector."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from volid.compensation.base import base_of
from volid.compensation.package import CompensationRequest, compensation_of
from volid.compensation.residual.forecast import Forecast, forecast
from volid.compensation.types import TYPES, select
from volid.exceptions import InputError, NotDeterminedError
from volid.fitting.solution import Solution
from volid.model.iso230 import LINEAR_AXES, ROTARY_AXES, parse

DRAWS = 400  # of the parameters: intervals to some percent of their width, in seconds
TOGETHER = (("L-VOL", "R-VOL"), ("L-VOL+", "R-VOL+"))


@dataclass(frozen=True, eq=False)
class Outlook:
    """What each compensation type is expected to leave.

    Args:
        forecast: The predictions, "none" first; None where there are none.
        reason: Why there are none, as the library says it.
        refused: Types that could not be predicted, with the reason.
    """

    forecast: Forecast | None = None
    reason: str = ""
    refused: tuple[tuple[str, str], ...] = ()


def lists_of(solution: Solution) -> list[tuple[str, ...]]:
    """Types, and pairs of them, that the machine can have and whose errors are in the model, in the order of ISO/TR 16907.

    >>> import volid
    >>> lists_of(volid.fit(volid.load_campaign("datasets/published_positioning/campaign.toml")))
    [('L-POS',), ('L-STR',), ('L-SQU',), ('L-ANG',), ('L-VOL',)]
    """
    axes = {parse(name).axis for name in solution.model.names}
    linear, rotary = bool(axes & set(LINEAR_AXES)), bool(axes & set(ROTARY_AXES))
    kinds = [t for t in TYPES.values() if not t.is_chosen]
    single = [(t.name,) for t in kinds if (t.is_linear and linear) or (t.is_rotary and rotary) or t.only_turns]
    return [names for names in (*single, *(TOGETHER if linear and rotary else ())) if _can_have(names, solution)]


def _can_have(names: tuple[str, ...], solution: Solution) -> bool:
    try:
        select(names, solution.machine)
    except InputError:
        return False
    return True


def outlook(solution: Solution, tool: tuple[float, float, float]) -> Outlook:
    """Predictions for all types of `lists_of`.

    Args:
        solution: As `volid.fit` makes it.
        tool: Tool vector, (3,) [mm].
    """
    lists = lists_of(solution)
    try:
        return Outlook(_predicted(solution, tool, lists))
    except NotDeterminedError as error:
        return Outlook(reason=str(error).removeprefix("residual: "))
    except InputError:  # one of the types cannot be made of what is determined: which one?
        return _one_by_one(solution, tool, lists)


def _one_by_one(solution: Solution, tool: tuple[float, float, float], lists: list[tuple[str, ...]]) -> Outlook:
    """The same, without the types that cannot be predicted."""
    kept, refused = [], []
    request = CompensationRequest(base_of(solution, tool), uncertainty=False)
    for names in lists:
        try:
            compensation_of(solution, names, request)
        except (InputError, NotDeterminedError) as error:
            refused.append((" + ".join(names), str(error)))
        else:
            kept.append(names)
    return Outlook(_predicted(solution, tool, kept), refused=tuple(refused))


def _predicted(solution: Solution, tool: tuple[float, float, float], lists: list[tuple[str, ...]]) -> Forecast:
    return forecast(solution, lists, base_of(solution, tool), np.array([tool]), most_draws=DRAWS)
