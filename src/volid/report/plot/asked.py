"""What a figure of a solution is asked for, and what it answers when there is nothing to draw."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from volid.exceptions import InputError
from volid.report.language import ENGLISH, Texts

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from volid.fitting.solution import Solution

    Drawn = Figure | Mapping[str, Figure]  # one figure, or several by what their names end with


class NothingToDrawError(InputError):
    """A figure does not apply to this solution; the text is the reason, such as "the machine has no rotary axes"."""


@dataclass(frozen=True)
class Asked:
    """What a figure is asked for.

    Args:
        solution: The solution.
        tool: Tool vector of what depends on it, shape (3,) [mm].
        texts: The language of the figure.
        own_scales: Whether each panel of functions has its own scale, instead of one for all that are compared.
    """

    solution: Solution
    tool: tuple[float, float, float]
    texts: Texts = ENGLISH
    own_scales: bool = False
