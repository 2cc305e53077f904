"""The figures that a solution can be drawn as, by name: each has a module in this folder with `draw(asked) -> Figure`.

`draw` may return several figures, by what their names end with, and raises `NothingToDrawError` with the reason where its figure
does not apply to the solution.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from importlib import import_module
from typing import TYPE_CHECKING, NamedTuple

from volid.exceptions import InputError, NotDeterminedError
from volid.report.plot.asked import Asked, NothingToDrawError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FIGURES = {  # name: (module of this folder, what it shows)
    "functions": ("functions", "error motions over their travels, with U"),
    "locations": ("locations", "location errors of the rotary axes, with U"),
    "sections": ("sections", "the deviation field on plane sections of the working volume"),
    "rotary": ("rotary", "rotary grids and residuals over the angles of two rotary axes"),
    "coverage": ("coverage", "distributions of the Monte Carlo samples beside propagation"),
    "forecast": ("forecast", "what each type of compensation leaves"),
}

IN_SPITE_OF_A_MISTAKE = ("residuals", "stations", "machine")  # what they show does not follow from it


class Named(NamedTuple):
    """A figure with its name, or the reason why there is none."""

    name: str
    figure: Figure | None
    reason: str = ""


def draw(asked: Asked, only: Sequence[str] = ()) -> Iterator[Named]:
    """The figures of a solution, one after the other, in the order of the table.

    Args:
        asked: The solution, the tool vector and the language.
        only: Names of figures; none: all.

    Raises `InputError` for a name that is not in the table.

    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/published_positioning/campaign.toml"))
    >>> [(found.name, found.reason) for found in draw(Asked(solution, (0.0, 0.0, 0.0)), ["locations"])]
    [('locations', 'the machine has no rotary axes')]
    """
    check_names(only)
    return (named for name in FIGURES if not only or name in only for named in _drawn(name, asked))


def check_names(only: Sequence[str]) -> None:
    """Raises `InputError` for a name that is not in the table."""
    for name in only:
        if name not in FIGURES:
            raise InputError(f"`only`: there is no figure '{name}'; choose among {', '.join(FIGURES)}")


def _drawn(name: str, asked: Asked) -> list[Named]:
    module, _ = FIGURES[name]
    barrier = asked.solution.adequacy.barrier
    if barrier and name not in IN_SPITE_OF_A_MISTAKE:
        return [Named(name, None, f"its numbers would follow from a mistake: {barrier}")]
    try:
        found = import_module(f"volid.report.plot.{module}").draw(asked)
    except (NothingToDrawError, NotDeterminedError) as reason:
        return [Named(name, None, str(reason))]
    if not isinstance(found, dict):
        return [Named(name, found)]
    return [Named(f"{name}_{end}" if end else name, figure) for end, figure in found.items()]
